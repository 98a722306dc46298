//! The fit of all slices of a BRDF, and the EM of one slice.

use dsbrdf_core::paper::em::{expectation_maximisation, halved_start};
use dsbrdf_core::paper::fit::{Method, Plan, fit as fit_slices, grow_all, slices};
use dsbrdf_core::paper::lobe::Lobe;
use dsbrdf_core::paper::slice::{Loss, Slice};
use dsbrdf_core::paper::slice_fit::SliceFit;
use dsbrdf_core::profile::MOMENTS;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, array, elements, shaped};
use crate::pool;

/// kappa and gamma as arrays.
type ScaleAndShape<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);
/// Lobes as (kappa, gamma), the history of the objective, and whether the EM converged.
type EmResult = (Vec<(f64, f64)>, Vec<f64>, bool);

/// Fits moments (theta_d, channel, theta_h, moment) at `ln_cos` (theta_d, theta_h); a dict of arrays.
#[pyfunction]
#[pyo3(signature = (moments, ln_cos, factor, *, n_lobes, method, azimuthal, follow, log_offset, max_height=None))]
#[allow(clippy::too_many_arguments)]
pub fn fit<'py>(
    py: Python<'py>,
    moments: Array<f64>,
    ln_cos: Array<f64>,
    factor: Array<f64>,
    n_lobes: usize,
    method: &str,
    azimuthal: bool,
    follow: bool,
    log_offset: Option<f64>,
    max_height: Option<Array<f64>>,
) -> PyResult<Bound<'py, PyDict>> {
    let shape @ [n_d, n_channels, n_h] = profile_shape(&moments)?;
    let method = match method {
        "em" => Method::Em,
        "joint" => Method::Joint,
        other => {
            return Err(PyValueError::new_err(format!("'method' must be 'em' or 'joint', got '{other}'.")));
        }
    };
    let moments = elements(&moments, "moments")?;
    let ln_cos = shaped(&ln_cos, &[n_d, n_h], "ln_cos")?;
    let factor = shaped(&factor, &[n_d, n_h], "factor")?;
    let max_height =
        max_height.as_ref().map(|height| shaped(height, &[n_d, n_channels], "max_height")).transpose()?;
    let plan = Plan { n_lobes, method, azimuthal, follow };
    let fits = pool::run(py, || {
        let build = |loss| slices(moments, ln_cos, factor, max_height, shape, loss);
        let l2 = build(Loss::L2);
        match log_offset {
            None => fit_slices(&l2, &l2, n_channels, plan),
            Some(offset) => fit_slices(&build(Loss::Log { offset }), &l2, n_channels, plan),
        }
    });

    let shape = [n_d, n_channels, n_lobes];
    let result = PyDict::new(py);
    result.set_item("kappa", lobes(py, &fits, shape, |l| l.kappa)?)?;
    result.set_item("gamma", lobes(py, &fits, shape, |l| l.gamma)?)?;
    result.set_item("beta", lobes(py, &fits, shape, |l| l.beta)?)?;
    result.set_item("objective", fits.iter().map(|f| f.objective).collect::<Vec<_>>())?;
    result.set_item("iterations", fits.iter().map(|f| f.iterations).collect::<Vec<_>>())?;
    result.set_item("status", fits.iter().map(|f| f.status as u8).collect::<Vec<_>>())?;
    result.set_item("em_history", fits.iter().map(|f| f.em_history.clone()).collect::<Vec<_>>())?;
    Ok(result)
}

/// The first three lengths of moments (theta_d, channel, theta_h, moment).
fn profile_shape(moments: &Array<f64>) -> PyResult<[usize; 3]> {
    match moments.shape() {
        &[n_d, n_channels, n_h, MOMENTS] => Ok([n_d, n_channels, n_h]),
        got => Err(PyValueError::new_err(format!(
            "'moments' must have shape (theta_d, channel, theta_h, {MOMENTS}), got {got:?}."
        ))),
    }
}

/// kappa and gamma (theta_d, channel, lobe) of the fits with 1, 2, ... `n_lobes` lobes, grown from one another.
#[pyfunction]
pub fn grow<'py>(
    py: Python<'py>,
    moments: Array<f64>,
    ln_cos: Array<f64>,
    n_lobes: usize,
) -> PyResult<Vec<ScaleAndShape<'py>>> {
    let shape @ [n_d, n_channels, n_h] = profile_shape(&moments)?;
    let moments = elements(&moments, "moments")?;
    let ln_cos = shaped(&ln_cos, &[n_d, n_h], "ln_cos")?;
    let fits = pool::run(py, || {
        let factor = vec![0.0; n_d * n_h];
        grow_all(&slices(moments, ln_cos, &factor, None, shape, Loss::L2), n_lobes)
    });
    let part = |k: usize, part: fn(&Lobe) -> f64| {
        let values: Vec<_> = fits.iter().flat_map(|grown| &grown[k - 1]).map(part).collect();
        array(py, &values, [n_d, n_channels, k])
    };
    (1..=n_lobes).map(|k| Ok((part(k, |l| l.kappa)?, part(k, |l| l.gamma)?))).collect()
}

fn lobes<'py>(
    py: Python<'py>,
    fits: &[SliceFit],
    shape: [usize; 3],
    part: impl Fn(&Lobe) -> f64,
) -> PyResult<Bound<'py, PyAny>> {
    let values: Vec<_> = fits.iter().flat_map(|fit| &fit.lobes).map(part).collect();
    array(py, &values, shape)
}

/// The EM of one slice with moments (theta_h, moment), from (kappa, gamma) lobes or the paper's start.
#[pyfunction]
#[pyo3(signature = (moments, ln_cos, n_lobes, *, max_rounds, tolerance, start=None))]
pub fn em(
    moments: Array<f64>,
    ln_cos: Array<f64>,
    n_lobes: usize,
    max_rounds: usize,
    tolerance: f64,
    start: Option<Vec<(f64, f64)>>,
) -> PyResult<EmResult> {
    let ln_cos = elements(&ln_cos, "ln_cos")?;
    let moments = shaped(&moments, &[ln_cos.len(), MOMENTS], "moments")?;
    let slice = Slice::new(moments, ln_cos, &vec![0.0; ln_cos.len()], Loss::L2);
    let start = match start {
        None => halved_start(&slice, n_lobes),
        Some(lobes) => lobes.into_iter().map(|(kappa, gamma)| Lobe { kappa, gamma, beta: 0.0 }).collect(),
    };
    let fit = expectation_maximisation(&slice, start, max_rounds, tolerance);
    Ok((fit.lobes.iter().map(|l| (l.kappa, l.gamma)).collect(), fit.history, fit.converged))
}
