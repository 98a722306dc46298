//! Fits of texels that were measured at the same directions, and their values.

use dsbrdf_core::estimator::Prior;
use dsbrdf_core::shape::{Shape, Sizes};
use dsbrdf_core::texels::{Coordinates, Plan, Positions, Quality, Weighing, evaluate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Array, elements, shaped, vector};
use crate::pool;

/// Unknowns (texel, unknown), squares (texel,), uncertainties (texel,) and iterations (texel,).
type Found<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);
/// `ln cos(theta_h)`, `cos(theta_d)` and azimuth of positions.
type Angles<'py> = (Array<f64>, Array<f64>, Array<f64>);

/// Lobes, channels, and coefficients of scale, gamma, beta, falloff and colour.
#[derive(FromPyObject)]
pub struct Layout {
    n_lobes: usize,
    n_channels: usize,
    sizes: (usize, usize, usize, usize, usize),
}

impl Layout {
    fn shape(&self) -> PyResult<Shape> {
        let (scale, gamma, beta, falloff, colour) = self.sizes;
        if [scale, gamma, beta, falloff, colour, self.n_lobes, self.n_channels].contains(&0) {
            return Err(PyValueError::new_err(
                "a model must have a lobe, a channel, and a coefficient a curve.",
            ));
        }
        let sizes = Sizes { scale, gamma, beta, falloff, colour };
        Ok(Shape { n_lobes: self.n_lobes, n_channels: self.n_channels, sizes })
    }
}

fn positions(shape: &Shape, at: &Angles) -> PyResult<Positions> {
    let n = [at.1.len()];
    let at = Coordinates {
        ln_cos: shaped(&at.0, &n, "ln_cos")?,
        x: shaped(&at.1, &n, "x")?,
        azimuth: shaped(&at.2, &n, "azimuth")?,
    };
    Ok(Positions::new(&at, shape))
}

/// What texels are fitted with; made once for all texels.
#[pyclass(frozen)]
pub struct TexelPlan {
    plan: Plan,
}

#[pymethods]
impl TexelPlan {
    /// `weighing` is shares, offset, quantile and most independent observations; `prior` mean and precision.
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        layout: Layout,
        at: Angles<'_>,
        cell: Vec<u32>,
        cos_product: Vec<f64>,
        weighing: ([f64; 4], f64, f64, f64),
        prior: (Vec<f64>, Vec<f64>),
        starts: Array<f64>,
        reference: Angles<'_>,
        iterations: usize,
    ) -> PyResult<Self> {
        let shape = layout.shape()?;
        let (n, p) = (cos_product.len(), shape.n_unknowns());
        let (mean, precision) = prior;
        if mean.len() != p || precision.len() != p * p || starts.len() % p != 0 {
            return Err(PyValueError::new_err(format!("'prior' and 'starts' must be of {p} unknowns.")));
        }
        if at.1.len() != n || n == 0 || cell.iter().any(|&cell| cell as usize >= n) {
            return Err(PyValueError::new_err(format!("'cell' must be of {n} positions.")));
        }
        let (shares, offset, quantile, n_effective) = weighing;
        let (here, there) = (positions(&shape, &at)?, positions(&shape, &reference)?);
        let starts = elements(&starts, "starts")?.to_vec();
        let weighing = Weighing { shares, offset, quantile, n_effective };
        let prior = Prior { mean, precision };
        Ok(Self {
            plan: Plan::new(shape, here, cell, cos_product, weighing, prior, starts, there, iterations),
        })
    }

    /// Fits texels (texel, direction, channel) of single or double precision.
    fn fit<'py>(&self, py: Python<'py>, values: Bound<'py, PyAny>) -> PyResult<Found<'py>> {
        let (unknowns, quality) = if let Ok(values) = values.extract::<Array<f32>>() {
            let values = self.checked(&values)?;
            pool::run(py, || self.plan.fit(values))
        } else {
            let values = values.extract::<Array<f64>>()?;
            let values = self.checked(&values)?;
            pool::run(py, || self.plan.fit(values))
        };
        let numbers = |of: fn(&Quality) -> f64| vector(py, &quality.iter().map(of).collect::<Vec<_>>());
        Ok((
            vector(py, &unknowns)?,
            numbers(|q| q.squares)?,
            numbers(|q| q.uncertainty)?,
            vector(py, &quality.iter().map(|q| q.iterations).collect::<Vec<_>>())?,
        ))
    }
}

impl TexelPlan {
    fn checked<'a, T: pyo3::buffer::Element>(&self, values: &'a Array<T>) -> PyResult<&'a [T]> {
        let n = values.shape().first().copied().unwrap_or(0);
        shaped(values, &[n, self.plan.cell.len(), self.plan.shape.n_channels], "values")
    }
}

/// Values (texel, position, channel) of unknowns (texel, unknown).
#[pyfunction]
pub fn eval_texels<'py>(
    py: Python<'py>,
    layout: Layout,
    unknowns: Array<f64>,
    at: Angles<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = layout.shape()?;
    let n = unknowns.shape().first().copied().unwrap_or(0);
    let given = shaped(&unknowns, &[n, shape.n_unknowns()], "unknowns")?;
    let positions = positions(&shape, &at)?;
    vector(py, &pool::run(py, || evaluate(&shape, &positions, given)))
}
