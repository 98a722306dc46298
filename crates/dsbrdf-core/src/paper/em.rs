//! The expectation-maximisation of Section 4: each lobe is fitted to its share of the slice, in turn.

use crate::levenberg_marquardt::Stop;
use crate::paper::lobe::{Lobe, values};
use crate::paper::mixture::Mixture;
use crate::paper::slice::Slice;

/// When a lobe's fit to its share (the M-step) stops.
const M_STEP: Stop = Stop { max_iterations: 30, cost: 1e-3, floor: 0.0, energy: 0.0 };
/// Smallest parameters of a start.
const TINY: f64 = 1e-12;

/// Lobes after the last round, and the objective (sum of squares) at the start and after each round.
pub struct EmFit {
    pub lobes: Vec<Lobe>,
    pub history: Vec<f64>,
    pub converged: bool,
}

/// The paper's start: one lobe from all points, its parameters halved for each further lobe.
#[must_use]
pub fn halved_start(slice: &Slice, n_lobes: usize) -> Vec<Lobe> {
    let first = estimate_lobe(slice, &slice.mean);
    (0..n_lobes)
        .map(|k| {
            let share = 0.5_f64.powi(i32::try_from(k).unwrap_or(i32::MAX));
            Lobe { kappa: first.kappa * share, gamma: first.gamma * share, beta: 0.0 }
        })
        .collect()
}

/// A lobe from values: kappa from the height, then gamma by linear least squares on `ln(ln(1 + f) / kappa)`.
#[must_use]
pub fn estimate_lobe(slice: &Slice, target: &[f64]) -> Lobe {
    let peak = target[..slice.len].iter().fold(0.0_f64, |peak, &f| peak.max(f));
    let kappa = peak.ln_1p().max(TINY);
    let (mut num, mut den) = (0.0, 0.0);
    for i in 0..slice.len {
        let height = target[i].ln_1p() / kappa;
        if height > 1e-6 {
            let weight = slice.w_a[i] * slice.w_a[i];
            num += weight * slice.ln_cos[i] * height.min(1.0).ln();
            den += weight * slice.ln_cos[i] * slice.ln_cos[i];
        }
    }
    let gamma = if den > 0.0 { (num / den).max(TINY) } else { 1.0 };
    Lobe { kappa, gamma, beta: 0.0 }
}

/// Runs at most `max_rounds` rounds from `lobes`, until the objective changes by less than `tolerance` of itself.
#[must_use]
pub fn expectation_maximisation(
    slice: &Slice,
    mut lobes: Vec<Lobe>,
    max_rounds: usize,
    tolerance: f64,
) -> EmFit {
    let n = slice.ln_cos.len();
    let mut value = vec![0.0; lobes.len() * n];
    let mut total = vec![0.0; n];
    let mut one_lobe = Mixture::new(slice, 1, false);
    let mut history = vec![e_step(slice, &lobes, &mut value, &mut total)];
    for _ in 0..max_rounds {
        // M-step: each lobe is fitted to its responsibility times the slice
        for (lobe, value) in lobes.iter_mut().zip(value.chunks_exact(n)) {
            for i in 0..n {
                let responsibility = if total[i] > 0.0 { value[i] / total[i] } else { 0.0 };
                one_lobe.target[i] = responsibility * slice.mean[i];
            }
            *lobe = one_lobe.fit(&[*lobe], M_STEP).0[0];
        }
        let last = history[history.len() - 1];
        let now = e_step(slice, &lobes, &mut value, &mut total);
        history.push(now);
        if (last - now).abs() <= tolerance * now {
            return EmFit { lobes, history, converged: true };
        }
    }
    EmFit { lobes, history, converged: false }
}

/// Values (lobe, theta_h) of the lobes and their `total`, whose ratio is the responsibility; the objective.
fn e_step(slice: &Slice, lobes: &[Lobe], value: &mut [f64], total: &mut [f64]) -> f64 {
    total.fill(0.0);
    for (lobe, value) in lobes.iter().zip(value.chunks_exact_mut(slice.ln_cos.len())) {
        values(&slice.ln_cos, lobe.kappa, lobe.gamma, value);
        for (total, value) in total.iter_mut().zip(value) {
            *total += *value;
        }
    }
    let misfit = |i: usize| (slice.w_a[i] * (total[i] - slice.mean[i])).powi(2);
    slice.bivariate_floor() + (0..slice.len).map(misfit).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::slice::{Loss, tests::Samples};

    #[test]
    fn starts_from_halved_parameters() {
        let slice = Samples::new(40, 11).slice(Loss::L2);
        let lobes = halved_start(&slice, 3);
        let peak = slice.mean.iter().fold(0.0_f64, |x, &y| x.max(y));
        assert!((lobes[0].kappa - peak.ln_1p()).abs() < 1e-15);
        for pair in lobes.windows(2) {
            assert_eq!((pair[1].kappa, pair[1].gamma), (0.5 * pair[0].kappa, 0.5 * pair[0].gamma));
        }
    }

    #[test]
    fn logs_the_sum_of_squares_of_each_round() {
        let slice = Samples::new(40, 11).slice(Loss::L2);
        let squares = |lobes: &[Lobe]| {
            let misfit = |i: usize| {
                let sum: f64 = lobes.iter().map(|lobe| lobe.value(slice.ln_cos[i])).sum();
                (slice.w_a[i] * (sum - slice.mean[i])).powi(2)
            };
            (0..slice.len).map(misfit).sum::<f64>() + slice.bivariate_floor()
        };
        let whole = expectation_maximisation(&slice, halved_start(&slice, 2), 5, -1.0);
        assert!(whole.history.len() == 6 && !whole.converged);
        for rounds in 0..6 {
            let fit = expectation_maximisation(&slice, halved_start(&slice, 2), rounds, -1.0);
            assert!((squares(&fit.lobes) / whole.history[rounds] - 1.0).abs() < 1e-12);
        }
        assert!(whole.history[5] < whole.history[0]);
    }
}
