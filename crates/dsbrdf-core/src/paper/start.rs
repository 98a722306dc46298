//! Starts that add one lobe at a time where the fit so far falls short.

use crate::levenberg_marquardt::Stop;
use crate::paper::em::estimate_lobe;
use crate::paper::lobe::{ABSENT, Lobe, values};
use crate::paper::mixture::Mixture;
use crate::paper::slice::Slice;

/// Values of beta that a new lobe may start from.
const PLAIN: [f64; 1] = [0.0];
const AZIMUTHAL: [f64; 3] = [0.0, 0.9, -0.9];

/// Best fits with 1, 2, ... `n_lobes` lobes, each from the one before plus a lobe at what it leaves; none is worse
/// than the one before.
#[must_use]
pub fn grow(slice: &Slice, n_lobes: usize, azimuthal: bool, stop: Stop) -> Vec<Vec<Lobe>> {
    let mut fits: Vec<Vec<Lobe>> = Vec::with_capacity(n_lobes);
    let mut least = f64::INFINITY;
    let betas: &[f64] = if azimuthal { &AZIMUTHAL } else { &PLAIN };
    for k in 1..=n_lobes {
        let last = fits.last().cloned().unwrap_or_default();
        let mut problem = Mixture::new(slice, k, azimuthal);
        let mut best = last.clone();
        best.push(ABSENT);
        for &beta in betas {
            let mut start = last.clone();
            start.push(lobe_at_remainder(slice, &last, beta));
            let (lobes, minimum) = problem.fit(&start, stop);
            if minimum.cost < least {
                (best, least) = (lobes, minimum.cost);
            }
        }
        fits.push(best);
    }
    fits
}

/// A lobe of given `beta` fitted to what the data have above the sum of `lobes`.
fn lobe_at_remainder(slice: &Slice, lobes: &[Lobe], beta: f64) -> Lobe {
    let mut remainder: Vec<f64> = (0..slice.ln_cos.len())
        .map(|i| slice.mean[i] + if slice.w_b[i] > 0.0 { beta * slice.y_b[i] / slice.w_b[i] } else { 0.0 })
        .collect();
    let mut value = vec![0.0; remainder.len()];
    for lobe in lobes {
        values(&slice.ln_cos, lobe.kappa, lobe.gamma, &mut value);
        for (remainder, value) in remainder.iter_mut().zip(&value) {
            *remainder -= (1.0 + beta * lobe.beta) * value;
        }
    }
    // Projection of (a, b) on (1, beta)
    for remainder in &mut remainder {
        *remainder = (*remainder / (1.0 + beta * beta)).max(0.0);
    }
    Lobe { beta, ..estimate_lobe(slice, &remainder) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::slice::{Loss, tests::Samples};

    #[test]
    fn more_lobes_fit_no_worse() {
        let samples = Samples::new(40, 11);
        let stop = Stop { max_iterations: 100, cost: 1e-4, floor: 0.0, energy: 0.0 };
        let nothing = Stop { max_iterations: 0, ..stop };
        for loss in [Loss::L2, Loss::Log { offset: 1e-3 }] {
            let slice = samples.slice(loss);
            for azimuthal in [false, true] {
                let fits = grow(&slice, 5, azimuthal, stop);
                let cost = |lobes: &Vec<Lobe>| {
                    Mixture::new(&slice, lobes.len(), azimuthal).fit(lobes, nothing).1.cost
                };
                let costs: Vec<f64> = fits.iter().map(cost).collect();
                assert_eq!(fits.iter().map(Vec::len).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
                // An absent lobe is not quite nothing
                let worse = |pair: &[f64]| pair[1] > pair[0] * (1.0 + 1e-9);
                assert!(!costs.windows(2).any(worse), "{costs:?}");
                assert!(costs[1] < 0.5 * costs[0], "two lobes made the samples: {costs:?}");
            }
        }
    }
}
