//! Pictures as linear functions of the reflectance.

use dsbrdf_core::picture::{AZIMUTHS, Lights, Nodes, Points, weights};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Array, array, elements, shaped};
use crate::pool;

/// Weights (pixel, theta_h, theta_d, azimuth, channel) of the values of a reflectance at nodes in the pixels of a picture.
///
/// Points (point, xyz) of pixel i are those from `start[i]` to `start[i + 1]`. Of lights, (light, xyz), (light, channel),
/// (light,), and (light, 4) for their parts; the first `n_roots` are no part of another.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn picture_weights<'py>(
    py: Python<'py>,
    normal: Array<f64>,
    view: Array<f64>,
    start: Vec<usize>,
    direction: Array<f64>,
    flux: Array<f64>,
    radius: Array<f64>,
    parts: Array<i32>,
    n_roots: usize,
    nodes: (usize, usize),
    azimuthal_width: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let &[n_lights, n_channels] = flux.shape() else {
        let got = flux.shape();
        return Err(PyValueError::new_err(format!("'flux' must have shape (light, channel), got {got:?}.")));
    };
    let n_points = normal.shape().first().copied().unwrap_or(0);
    if start.first() != Some(&0) || start.last() != Some(&n_points) || !start.is_sorted() {
        return Err(PyValueError::new_err(format!("'start' must ascend from 0 to {n_points}.")));
    }
    if nodes.0 < 4 || nodes.1 < 4 {
        return Err(PyValueError::new_err(format!("'nodes' must be 4 at least, got {nodes:?}.")));
    }
    let parts = shaped(&parts, &[n_lights, 4], "parts")?;
    // A light is before its parts, so that following them comes to an end
    let out_of_order =
        |(i, &part): (usize, &i32)| part >= 0 && !(i / 4 + 1..n_lights).contains(&(part as usize));
    if n_roots > n_lights || parts.iter().enumerate().any(out_of_order) {
        return Err(PyValueError::new_err(
            "'parts' must be indices of later lights, 'n_roots' of all at most.",
        ));
    }
    let lights = Lights {
        n_channels,
        direction: shaped(&direction, &[n_lights, 3], "direction")?,
        flux: elements(&flux, "flux")?,
        radius: shaped(&radius, &[n_lights], "radius")?,
        parts,
        n_roots,
    };
    let points = Points {
        normal: shaped(&normal, &[n_points, 3], "normal")?,
        view: shaped(&view, &[n_points, 3], "view")?,
        start: &start,
    };
    let n_pixels = start.len() - 1;
    let nodes = Nodes { n_h: nodes.0, n_d: nodes.1, azimuthal_width };
    let mut found = vec![0.0; n_pixels * n_channels * nodes.len()];
    pool::run(py, || weights(&points, &lights, nodes, &mut found));
    array(py, &found, [n_pixels, nodes.n_h, nodes.n_d, AZIMUTHS.len(), n_channels])
}
