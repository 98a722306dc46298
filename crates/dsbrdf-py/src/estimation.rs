//! The estimator: observations kept by the kernel, and fits of lobes to them.

use dsbrdf_core::estimator::{Loss, Penalty, Prior};
use dsbrdf_core::growth::{Plan, Solution, refine, with_log_det};
use dsbrdf_core::levenberg_marquardt::LeastSquares;
use dsbrdf_core::observations::{Given, Observations as Core};
use dsbrdf_core::shape::{Shape, Sizes};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, elements, shaped, vector};
use crate::pool;

/// Half the cost, gradient and Hessian.
type Equations<'py> = (f64, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Observations (position, node, channel) that lobes are fitted to.
#[pyclass(frozen)]
pub struct Observations {
    core: Core,
}

/// Options as Python gives them: sizes (scale, gamma, beta, falloff, colour), loss, offsets (channel,), penalty (bend, slope,
/// size), and the independent observations that the data are worth.
#[derive(FromPyObject)]
pub struct Options {
    sizes: (usize, usize, usize, usize, usize),
    loss: String,
    offset: Vec<f64>,
    penalty: (f64, f64, f64),
    n_effective: f64,
}

impl Options {
    fn plan(&self, n_channels: usize) -> PyResult<Plan<'_>> {
        let (scale, gamma, beta, falloff, colour) = self.sizes;
        if [scale, gamma, beta, falloff, colour].contains(&0) {
            return Err(PyValueError::new_err("a curve must have a coefficient at least."));
        }
        if self.offset.len() != n_channels {
            return Err(PyValueError::new_err(format!(
                "'offset' must have shape ({n_channels},), got ({},).",
                self.offset.len()
            )));
        }
        let loss = match self.loss.as_str() {
            "log" => Loss::Log,
            "gamma" => Loss::Gamma,
            "l2" => Loss::L2,
            other => {
                let need = "'loss' must be 'log', 'gamma' or 'l2'";
                return Err(PyValueError::new_err(format!("{need}, got '{other}'.")));
            }
        };
        let (bend, slope, size) = self.penalty;
        Ok(Plan {
            sizes: Sizes { scale, gamma, beta, falloff, colour },
            loss,
            offset: &self.offset,
            penalty: Penalty { bend, slope, size },
            n_effective: self.n_effective,
        })
    }
}

#[pymethods]
impl Observations {
    #[new]
    fn new(
        ln_cos: Array<f64>,
        x: Array<f64>,
        azimuth: Array<f64>,
        value: Array<f64>,
        weight: Array<f64>,
    ) -> PyResult<Self> {
        let shape = value.shape().to_vec();
        let [n, n_nodes, n_channels] = shape[..] else {
            let need = "'value' must have shape (position, node, channel)";
            return Err(PyValueError::new_err(format!("{need}, got {shape:?}.")));
        };
        let given = Given {
            ln_cos: shaped(&ln_cos, &[n], "ln_cos")?,
            x: shaped(&x, &[n], "x")?,
            azimuth: shaped(&azimuth, &shape[..2], "azimuth")?,
            value: elements(&value, "value")?,
            weight: shaped(&weight, &shape, "weight")?,
        };
        Ok(Self { core: Core::new(&given, n_nodes, n_channels) })
    }

    /// Positions that count.
    fn __len__(&self) -> usize {
        self.core.len()
    }

    /// About `n` of the positions.
    fn thinned(&self, py: Python<'_>, n: usize) -> Self {
        Self { core: py.detach(|| self.core.thinned(n)) }
    }

    /// Fits with 1 to `max_lobes` lobes.
    fn grow<'py>(
        &self,
        py: Python<'py>,
        options: Options,
        max_lobes: usize,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let plan = options.plan(self.core.n_channels)?;
        let found = pool::run(py, || {
            plan.grow(&self.core, max_lobes)
                .into_iter()
                .map(|s| {
                    with_log_det(&mut plan.problem(&self.core, s.shape.clone(), None), s, plan.n_effective)
                })
                .collect::<Vec<_>>()
        });
        found.into_iter().map(|s| to_dict(py, s)).collect()
    }

    /// The fit of `n_lobes` lobes from `x`.
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (options, n_lobes, x, *, iterations, tolerance, prior=None))]
    fn refine<'py>(
        &self,
        py: Python<'py>,
        options: Options,
        n_lobes: usize,
        x: Vec<f64>,
        iterations: usize,
        tolerance: f64,
        prior: Option<(Vec<f64>, Vec<f64>)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let plan = options.plan(self.core.n_channels)?;
        let shape = Shape { n_lobes, n_channels: self.core.n_channels, sizes: plan.sizes };
        let p = shape.n_unknowns();
        if x.len() != p {
            return Err(PyValueError::new_err(format!("'x' must have shape ({p},), got ({},).", x.len())));
        }
        let prior = prior.map(|(mean, precision)| Prior { mean, precision });
        if let Some(prior) = &prior
            && (prior.mean.len() != p || prior.precision.len() != p * p)
        {
            return Err(PyValueError::new_err(format!("'prior' must be of {p} unknowns.")));
        }
        let solution = pool::run(py, || {
            let mut problem = plan.problem(&self.core, shape, prior.as_ref());
            let found = refine(&mut problem, x, plan.n_effective, iterations, tolerance);
            with_log_det(&mut problem, found, plan.n_effective)
        });
        to_dict(py, solution)
    }

    /// Half the cost, gradient and Hessian (unknown, unknown) at `x`, for unit precision.
    fn normal_equations<'py>(
        &self,
        py: Python<'py>,
        options: Options,
        n_lobes: usize,
        x: Vec<f64>,
    ) -> PyResult<Equations<'py>> {
        let plan = options.plan(self.core.n_channels)?;
        let shape = Shape { n_lobes, n_channels: self.core.n_channels, sizes: plan.sizes };
        let (cost, gradient, hessian) = pool::run(py, || {
            let mut problem = plan.problem(&self.core, shape, None);
            let cost = problem.cost(&x);
            let mut equations = problem.equations();
            problem.linearise(&mut equations);
            (cost, equations.gradient.clone(), equations.dense())
        });
        Ok((cost, vector(py, &gradient)?, vector(py, &hessian)?))
    }
}

fn to_dict(py: Python<'_>, solution: Solution) -> PyResult<Bound<'_, PyDict>> {
    let result = PyDict::new(py);
    result.set_item("n_lobes", solution.shape.n_lobes)?;
    result.set_item("x", vector(py, &solution.x)?)?;
    result.set_item("squares", solution.squares)?;
    result.set_item("objective", solution.objective)?;
    result.set_item("log_det", solution.log_det)?;
    result.set_item("iterations", solution.iterations)?;
    result.set_item("converged", solution.converged)?;
    Ok(result)
}
