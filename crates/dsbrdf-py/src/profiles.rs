//! Collapse of tables, and isotonic regression.

use dsbrdf_core::isotonic;
use dsbrdf_core::profile::{MOMENTS, Table};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

use crate::arrays::{Array, array, elements, shaped, vector};
use crate::pool;

/// Moments (slice, channel, theta_h, moment) over phi_d of the rows `theta_d` of a table.
///
/// The table is given as bytes: little-endian float64, (channel, theta_h, theta_d, phi_d).
#[pyfunction]
pub fn collapse<'py>(
    py: Python<'py>,
    bytes: Array<u8>,
    shape: [usize; 4],
    scale: Array<f64>,
    cos_2phi: Array<f64>,
    theta_d: Vec<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let [n_channels, n_h, n_d, n_phi] = shape;
    let size = shape.iter().try_fold(size_of::<f64>(), |size, &n| size.checked_mul(n));
    let Some(size) = size else {
        return Err(PyValueError::new_err(format!("'shape' {shape:?} is too large.")));
    };
    if let Some(row) = theta_d.iter().find(|&&d| d >= n_d) {
        return Err(PyIndexError::new_err(format!("'theta_d' row {row} is not among the table's {n_d}.")));
    }
    let table = Table {
        bytes: shaped(&bytes, &[size], "bytes")?,
        shape,
        scale: shaped(&scale, &[n_channels], "scale")?,
        cos_2phi: shaped(&cos_2phi, &[n_phi], "cos_2phi")?,
    };
    let moments = pool::run(py, || table.collapse(&theta_d));
    array(py, &moments, [theta_d.len(), n_channels, n_h, MOMENTS])
}

/// Non-increasing values nearest to `y` in weighted least squares.
#[pyfunction]
pub fn decreasing<'py>(py: Python<'py>, y: Array<f64>, weight: Array<f64>) -> PyResult<Bound<'py, PyAny>> {
    let y = elements(&y, "y")?;
    let weight = shaped(&weight, &[y.len()], "weight")?;
    vector(py, &isotonic::decreasing(y, weight))
}
