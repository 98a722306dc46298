//! Values of lobes at pairs of directions.

use dsbrdf_core::directions::{CHUNK, first_not_unit as find};
use dsbrdf_core::evaluation::{Given, Lobes};
use dsbrdf_core::paper::eval::Model;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Array, array, elements, shaped};
use crate::pool;

/// Values (direction, channel) at `wi` and `wo` (direction, xyz) of curves (lobe, coefficient), colours (channel, lobe,
/// coefficient).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn eval<'py>(
    py: Python<'py>,
    wi: Array<f64>,
    wo: Array<f64>,
    scale: Array<f64>,
    gamma: Array<f64>,
    beta: Array<f64>,
    falloff: Array<f64>,
    colour: Array<f64>,
    azimuthal_width: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let &[n_channels, n_lobes, _] = colour.shape() else {
        let got = colour.shape();
        return Err(PyValueError::new_err(format!(
            "'colour' must have shape (channel, lobe, coefficient), got {got:?}."
        )));
    };
    for (name, array) in [("scale", &scale), ("gamma", &gamma), ("beta", &beta), ("falloff", &falloff)] {
        if array.shape().len() != 2 || array.shape()[0] != n_lobes {
            let got = array.shape();
            return Err(PyValueError::new_err(format!(
                "'{name}' must have shape ({n_lobes}, coefficient), got {got:?}."
            )));
        }
    }
    let lobes = Lobes::new(&Given {
        n_lobes,
        n_channels,
        scale: elements(&scale, "scale")?,
        gamma: elements(&gamma, "gamma")?,
        beta: elements(&beta, "beta")?,
        falloff: elements(&falloff, "falloff")?,
        colour: elements(&colour, "colour")?,
        azimuthal_width,
    });
    values(py, &wi, &wo, n_channels, |wi, wo, values| lobes.eval(wi, wo, values))
}

/// Values (direction, channel) of slices with parameters (theta_d, channel, lobe) at `wi` and `wo` (direction, xyz).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn eval_slices<'py>(
    py: Python<'py>,
    wi: Array<f64>,
    wo: Array<f64>,
    theta_d: Array<f64>,
    kappa: Array<f64>,
    gamma: Array<f64>,
    beta: Array<f64>,
    spike: Array<f64>,
    azimuthal_width: f64,
    spike_sin2: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let &[n_d, n_channels, n_lobes] = kappa.shape() else {
        let got = kappa.shape();
        return Err(PyValueError::new_err(format!(
            "'kappa' must have shape (theta_d, channel, lobe), got {got:?}."
        )));
    };
    let theta_d = shaped(&theta_d, &[n_d], "theta_d")?;
    if n_d == 0 {
        return Err(PyValueError::new_err("'theta_d' must hold at least one slice."));
    }
    let shape = [n_d, n_channels, n_lobes];
    let model = Model {
        theta_d,
        n_channels,
        n_lobes,
        kappa: elements(&kappa, "kappa")?,
        gamma: shaped(&gamma, &shape, "gamma")?,
        beta: shaped(&beta, &shape, "beta")?,
        spike: shaped(&spike, &shape[..2], "spike")?,
        spike_sin2,
        azimuthal_width,
    };
    values(py, &wi, &wo, n_channels, |wi, wo, values| model.eval(wi, wo, values))
}

/// Values (direction, channel) that `eval` writes for pairs of directions.
fn values<'py>(
    py: Python<'py>,
    wi: &Array<f64>,
    wo: &Array<f64>,
    n_channels: usize,
    eval: impl Fn(&[f64], &[f64], &mut [f64]) + Send + Sync,
) -> PyResult<Bound<'py, PyAny>> {
    let wi = elements(wi, "wi")?;
    let wo = elements(wo, "wo")?;
    if wi.len() != wo.len() || wi.len() % 3 != 0 {
        let (got_i, got_o) = (wi.len(), wo.len());
        return Err(PyValueError::new_err(format!(
            "'wi' and 'wo' must hold the same number of directions, got {got_i} and {got_o} numbers."
        )));
    }
    let n = wi.len() / 3;
    let mut values = vec![0.0; n * n_channels];
    if n_channels > 0 {
        pool::run_if_above(CHUNK, n, py, || eval(wi, wo, &mut values));
    }
    array(py, &values, [n, n_channels])
}

/// Index of the first of the `directions` (direction, xyz) whose length is not 1 within `tolerance`.
#[pyfunction]
pub fn first_not_unit(py: Python<'_>, directions: Array<f64>, tolerance: f64) -> PyResult<Option<usize>> {
    let directions = elements(&directions, "directions")?;
    Ok(pool::run_if_above(CHUNK, directions.len() / 3, py, || find(directions, tolerance)))
}
