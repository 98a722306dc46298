//! The paper's experiment: slices of fixed theta_d, each channel of each a mixture of its own.
//!
//! In the order of the data: `slice` from moments, `start` and `em`, the joint fit of a `mixture`, `follow` of lobes
//! over theta_d, `fit` of all slices, and `eval` of what was found.

pub mod assignment;
pub mod em;
pub mod eval;
pub mod fit;
pub mod follow;
pub mod lobe;
pub mod mixture;
pub mod slice;
pub mod slice_fit;
pub mod start;
