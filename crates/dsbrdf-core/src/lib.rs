//! The kernel: collapse of measured tables, evaluation of lobes with curves over cos(theta_d), and their fit.
#![allow(clippy::needless_range_loop)]

pub mod arrow;
pub mod basis;
pub mod directions;
pub mod estimator;
pub mod evaluation;
pub mod exp;
pub mod growth;
pub mod isotonic;
pub mod levenberg_marquardt;
pub mod observations;
pub mod paper;
pub mod picture;
pub mod profile;
pub mod shape;
pub mod texels;
pub mod text;
