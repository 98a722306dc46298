//! What the fit of one slice gives.

use crate::paper::lobe::Lobe;

/// How the fit of a slice ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    Converged,
    /// Out of iterations; the best so far is kept.
    MaxIterations,
    /// No valid sample, or all zero: the lobes are absent (kappa tiny).
    NoData,
}

#[derive(Clone, Debug)]
pub struct SliceFit {
    pub lobes: Vec<Lobe>,
    /// Sum of squares over all samples, or its counterpart under the logarithmic loss.
    pub objective: f64,
    pub iterations: usize,
    pub status: Status,
    /// Objective at the start of the EM and after each round.
    pub em_history: Vec<f64>,
}

/// The candidate with the least objective.
pub fn best(fits: &[SliceFit]) -> &SliceFit {
    fits.iter()
        .reduce(|best, fit| if fit.objective < best.objective { fit } else { best })
        .expect("a candidate")
}
