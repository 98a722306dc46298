//! Python binding of `dsbrdf-core`: registrations only.

mod arrays;
mod build;
mod estimation;
mod evaluation;
mod paper;
mod picture;
mod pool;
mod profiles;
mod texels;
mod text;

use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use crate::build::build_info;
    #[pymodule_export]
    use crate::estimation::Observations;
    #[pymodule_export]
    use crate::evaluation::{eval, eval_slices, first_not_unit};
    #[pymodule_export]
    use crate::paper::{em, fit, grow};
    #[pymodule_export]
    use crate::picture::picture_weights;
    #[pymodule_export]
    use crate::profiles::{collapse, decreasing};
    #[pymodule_export]
    use crate::texels::{TexelPlan, eval_texels};
    #[pymodule_export]
    use crate::text::plain_numbers;
}
