//! Starts that add one lobe at a time where the fit so far falls short.

use crate::em::estimate_lobe;
use crate::levenberg_marquardt::Stop;
use crate::lobe::{Lobe, values};
use crate::mixture::Mixture;
use crate::slice::Slice;

/// Values of beta that a new lobe may start from.
const PLAIN: [f64; 1] = [0.0];
const AZIMUTHAL: [f64; 3] = [0.0, 0.9, -0.9];

/// Best fits with 1, 2, ... `n_lobes` lobes, each from the one before plus a lobe at what it leaves.
#[must_use]
pub fn grow(slice: &Slice, n_lobes: usize, azimuthal: bool, stop: Stop) -> Vec<Vec<Lobe>> {
    let mut fits: Vec<Vec<Lobe>> = Vec::with_capacity(n_lobes);
    let betas: &[f64] = if azimuthal { &AZIMUTHAL } else { &PLAIN };
    for k in 1..=n_lobes {
        let last = fits.last().cloned().unwrap_or_default();
        let mut problem = Mixture::new(slice, k, azimuthal);
        let grown = betas.iter().map(|&beta| {
            let mut start = last.clone();
            start.push(lobe_at_remainder(slice, &last, beta));
            problem.fit(&start, stop)
        });
        let best = grown.reduce(|best, next| if next.1.cost < best.1.cost { next } else { best });
        fits.extend(best.map(|(lobes, _)| lobes));
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
