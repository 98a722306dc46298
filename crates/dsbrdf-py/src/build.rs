//! What the module was built with, and what it runs on.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::pool;

/// Version, target, profile and compiler of the build; vector instructions that the kernel takes here, and its threads.
#[pyfunction]
pub fn build_info(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let info = PyDict::new(py);
    info.set_item("version", env!("CARGO_PKG_VERSION"))?;
    info.set_item("target", env!("BUILD_TARGET"))?;
    info.set_item("profile", env!("BUILD_PROFILE"))?;
    info.set_item("compiler", env!("BUILD_RUSTC"))?;
    info.set_item("vectors", vectors())?;
    info.set_item("threads", pool::n_threads())?;
    Ok(info)
}

/// As `dsbrdf-core` chooses among its versions of a function.
#[cfg(target_arch = "x86_64")]
fn vectors() -> &'static str {
    if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
        "AVX-512"
    } else if is_x86_feature_detected!("avx2") {
        "AVX2"
    } else {
        "SSE2"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> &'static str {
    "those of the target"
}
