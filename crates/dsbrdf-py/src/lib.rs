//! Python binding of `dsbrdf-core`: registrations only.

mod arrays;
mod estimation;
mod evaluation;
mod paper;
mod pool;
mod profiles;

use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _core {
    /// Limits of the fit.
    #[pymodule_export]
    const MAX_HEIGHT: f64 = dsbrdf_core::paper::mixture::MAX_HEIGHT;
    #[pymodule_export]
    const MAX_LN_GAMMA: f64 = dsbrdf_core::paper::mixture::MAX_LN_GAMMA;
    #[pymodule_export]
    const MAX_ASIN_BETA: f64 = dsbrdf_core::paper::mixture::MAX_ASIN_BETA;
    #[pymodule_export]
    use crate::estimation::Observations;
    #[pymodule_export]
    use crate::evaluation::{eval, eval_slices, first_not_unit};
    #[pymodule_export]
    use crate::paper::{em, fit, grow};
    #[pymodule_export]
    use crate::profiles::{collapse, decreasing};
}
