//! Python binding of `dsbrdf-core`: registrations only.

mod arrays;
mod evaluation;
mod fitting;
mod profiles;

use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use crate::evaluation::{eval, first_not_unit};
    #[pymodule_export]
    use crate::fitting::{em, fit, grow};
    #[pymodule_export]
    use crate::profiles::{collapse, decreasing};
}
