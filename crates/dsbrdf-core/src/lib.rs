//! Collapse of measured BRDF tables, and the fit of mixtures of hemi-EPD lobes to their slices.
#![allow(clippy::needless_range_loop)]

pub mod arrow;
pub mod assignment;
pub mod basis;
pub mod em;
pub mod estimator;
pub mod eval;
pub mod exp;
pub mod fit;
pub mod follow;
pub mod growth;
pub mod isotonic;
pub mod levenberg_marquardt;
pub mod lobe;
pub mod mixture;
pub mod observations;
pub mod profile;
pub mod shape;
pub mod slice;
pub mod slice_fit;
pub mod start;
