//! The fit of a whole BRDF: every slice from several starts, then lobes followed over theta_d.

use rayon::prelude::*;

use crate::levenberg_marquardt::Stop;
use crate::paper::em::{expectation_maximisation, halved_start};
use crate::paper::follow::{follow, match_channels, sorted};
use crate::paper::lobe::{ABSENT, Lobe};
use crate::paper::mixture::Mixture;
use crate::paper::slice::{Loss, Slice};
use crate::paper::slice_fit::{SliceFit, Status, best};
use crate::paper::start::grow;

/// Rounds of the EM, and the relative change of its objective at which it stops.
const EM_ROUNDS: usize = 60;
const EM_TOLERANCE: f64 = 1e-3;
/// Values of beta, of all lobes or in turn, that the azimuthal fit starts from.
const BETA_STARTS: [f64; 1] = [-0.4];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The paper's EM alone.
    Em,
    /// EM and other starts, each with a joint Levenberg-Marquardt fit.
    Joint,
}

/// What to fit.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    pub n_lobes: usize,
    pub method: Method,
    pub azimuthal: bool,
    /// Follow lobes over theta_d; otherwise sort by kappa, slice by slice (the paper).
    pub follow: bool,
}

/// The joint fit's stopping rule while candidates are compared.
fn scout(slice: &Slice) -> Stop {
    Stop { max_iterations: 40, cost: 3e-2, floor: 0.5 * slice.floor, energy: slice.energy }
}

/// The stopping rule of the joint fit that ends in the model.
fn finish(slice: &Slice) -> Stop {
    Stop { max_iterations: 500, cost: 1e-4, floor: 0.5 * slice.floor, energy: slice.energy }
}

/// Fits slices given theta_d by theta_d, `n_channels` after one another.
#[must_use]
pub fn fit(slices: &[Slice], l2_slices: &[Slice], n_channels: usize, plan: Plan) -> Vec<SliceFit> {
    let mut candidates: Vec<Vec<SliceFit>> =
        slices.par_iter().zip(l2_slices).map(|(slice, l2)| starts(slice, l2, plan)).collect();
    if plan.method == Method::Em {
        return in_order(&candidates, n_channels, plan.follow);
    }
    from_neighbours(slices, n_channels, &mut candidates, false);
    let azimuthal = plan.azimuthal && add_azimuthal(slices, n_channels, &mut candidates);
    let mut fits = in_order(&candidates, n_channels, plan.follow);
    fits.par_iter_mut().zip(slices).for_each(|(fit, slice)| polish(slice, azimuthal, fit));
    if plan.follow { fits } else { fits.iter().map(sorted).collect() }
}

/// Adds the azimuthal term to all candidates where the data call for it; whether they do.
fn add_azimuthal(slices: &[Slice], n_channels: usize, candidates: &mut Vec<Vec<SliceFit>>) -> bool {
    let total = |fits: &[Vec<SliceFit>]| -> f64 { fits.iter().map(|fits| best(fits).objective).sum() };
    let plain = total(candidates);
    let floor: f64 = slices.iter().map(|slice| slice.floor).sum();
    if !pays(slices, candidates[0][0].lobes.len(), plain, floor) {
        return false;
    }
    let mut azimuthal = candidates.clone();
    azimuthal.par_iter_mut().zip(slices).for_each(|(fits, slice)| azimuthal_starts(slice, fits));
    from_neighbours(slices, n_channels, &mut azimuthal, true);
    let keep = pays(slices, candidates[0][0].lobes.len(), plain, total(&azimuthal));
    if keep {
        *candidates = azimuthal;
    }
    keep
}

/// Whether squares that fall from `without` to `with` are worth one number more a lobe, slice and channel.
///
/// The Bayesian information criterion, with the residual rows of each theta_h as the observations.
fn pays(slices: &[Slice], n_lobes: usize, without: f64, with: f64) -> bool {
    let known = || slices.iter().filter(|slice| slice.energy > 0.0);
    let rounding = 1e-6 * known().map(|slice| slice.energy).sum::<f64>();
    let rows: f64 = known().map(|slice| slice.rows() as f64).sum();
    let price: f64 = known().map(|slice| n_lobes as f64 * (slice.rows() as f64).ln()).sum();
    rows * ((without + rounding) / (with + rounding)).ln() > price
}

/// One candidate a slice, lobes followed over theta_d or sorted by kappa.
fn in_order(candidates: &[Vec<SliceFit>], n_channels: usize, following: bool) -> Vec<SliceFit> {
    let along = |channel: usize| -> Vec<&Vec<SliceFit>> {
        candidates.iter().skip(channel).step_by(n_channels).collect()
    };
    let curves: Vec<Vec<SliceFit>> = if following {
        match_channels((0..n_channels).into_par_iter().map(|channel| follow(&along(channel))).collect())
    } else {
        (0..n_channels)
            .map(|channel| along(channel).iter().map(|fits| sorted(best(fits))).collect())
            .collect()
    };
    // The history of the EM stays with the slice, whichever candidate was chosen
    let chosen = |(i, fits): (usize, &Vec<SliceFit>)| SliceFit {
        em_history: fits[0].em_history.clone(),
        ..curves[i % n_channels][i / n_channels].clone()
    };
    candidates.iter().enumerate().map(chosen).collect()
}

/// Runs the joint fit of the chosen candidate to its end.
fn polish(slice: &Slice, azimuthal: bool, fit: &mut SliceFit) {
    if fit.status == Status::NoData {
        return;
    }
    let (lobes, minimum) = Mixture::new(slice, fit.lobes.len(), azimuthal).fit(&fit.lobes, finish(slice));
    let floor = if azimuthal { slice.floor } else { slice.bivariate_floor() };
    fit.lobes = lobes;
    fit.objective = 2.0 * minimum.cost + floor;
    fit.iterations += minimum.iterations;
    fit.status = if minimum.converged { Status::Converged } else { Status::MaxIterations };
}

fn has_data(slice: &Slice) -> bool {
    slice.mean.iter().any(|&f| f > 0.0)
}

/// The EM's result, polished jointly, and what grows lobe by lobe.
fn starts(slice: &Slice, l2: &Slice, plan: Plan) -> Vec<SliceFit> {
    if !has_data(l2) {
        return vec![SliceFit {
            lobes: vec![ABSENT; plan.n_lobes],
            objective: slice.bivariate_floor(),
            iterations: 0,
            status: Status::NoData,
            em_history: Vec::new(),
        }];
    }
    let em = expectation_maximisation(l2, halved_start(l2, plan.n_lobes), EM_ROUNDS, EM_TOLERANCE);
    let iterations = em.history.len() - 1;
    if plan.method == Method::Em {
        let status = if em.converged { Status::Converged } else { Status::MaxIterations };
        let objective = em.history[iterations];
        return vec![SliceFit { lobes: em.lobes, objective, iterations, status, em_history: em.history }];
    }
    let mut polished = joint(slice, &em.lobes, false, iterations);
    polished.em_history = em.history;
    let mut fits = vec![polished];
    if plan.n_lobes > 1 {
        let mut grown = grow(slice, plan.n_lobes, false, scout(slice));
        fits.push(joint(slice, &grown.pop().expect("one fit a lobe"), false, 0));
    }
    fits
}

/// The joint fit from `start`, of which `spent` iterations have gone before.
fn joint(slice: &Slice, start: &[Lobe], azimuthal: bool, spent: usize) -> SliceFit {
    let (lobes, minimum) = Mixture::new(slice, start.len(), azimuthal).fit(start, scout(slice));
    let floor = if azimuthal { slice.floor } else { slice.bivariate_floor() };
    SliceFit {
        lobes,
        objective: 2.0 * minimum.cost + floor,
        iterations: spent + minimum.iterations,
        status: if minimum.converged { Status::Converged } else { Status::MaxIterations },
        em_history: Vec::new(),
    }
}

/// Adds to every slice the fits that start from the best of the slices before and after in theta_d, and of the
/// other channels.
fn from_neighbours(slices: &[Slice], n_channels: usize, candidates: &mut [Vec<SliceFit>], azimuthal: bool) {
    let bests: Vec<Vec<Lobe>> = candidates.iter().map(|fits| best(fits).lobes.clone()).collect();
    let empty: Vec<bool> = candidates.iter().map(|fits| fits[0].status == Status::NoData).collect();
    candidates.par_iter_mut().enumerate().for_each(|(i, fits)| {
        let channel = i % n_channels;
        let slice = [i.checked_sub(n_channels), Some(i + n_channels)].into_iter().flatten();
        let others = (0..n_channels).filter(|&c| c != channel).map(|c| i - channel + c);
        for j in slice.chain(others) {
            if j < slices.len() && !empty[i] && !empty[j] {
                fits.push(joint(&slices[i], &bests[j], azimuthal, 0));
            }
        }
    });
}

/// Replaces the candidates by azimuthal ones that start from the best of them.
fn azimuthal_starts(slice: &Slice, fits: &mut Vec<SliceFit>) {
    let plain = best(fits).clone();
    if plain.status == Status::NoData {
        return;
    }
    let history = std::mem::take(&mut fits[0].em_history);
    fits.clear();
    for beta in BETA_STARTS {
        let tilt = |k: usize, lobe: &Lobe| Lobe { beta: if k % 2 == 0 { beta } else { -beta }, ..*lobe };
        let start: Vec<Lobe> = plain.lobes.iter().enumerate().map(|(k, lobe)| tilt(k, lobe)).collect();
        fits.push(joint(slice, &start, true, plain.iterations));
    }
    let start: Vec<Lobe> = plain.lobes.iter().map(|lobe| Lobe { beta: 1e-3, ..*lobe }).collect();
    fits.push(joint(slice, &start, true, plain.iterations));
    let mut grown = grow(slice, plain.lobes.len(), true, scout(slice));
    fits.push(joint(slice, &grown.pop().expect("one fit a lobe"), true, plain.iterations));
    // Never above the fit without the term
    fits.push(plain);
    fits[0].em_history = history;
}

/// For each slice the fits with 1, 2, ... `n_lobes` lobes, grown from one another (no azimuthal term).
#[must_use]
pub fn grow_all(slices: &[Slice], n_lobes: usize) -> Vec<Vec<Vec<Lobe>>> {
    slices
        .par_iter()
        .map(|slice| match has_data(slice) {
            true => grow(slice, n_lobes, false, scout(slice)),
            false => (1..=n_lobes).map(|k| vec![ABSENT; k]).collect(),
        })
        .collect()
}

/// Slices (theta_d, channel) from moments (theta_d, channel, theta_h, moment), with `ln_cos` and `factor`
/// (theta_d, theta_h), and the height (theta_d, channel) that no lobe may go above, NaN where it is not known.
#[must_use]
pub fn slices(
    moments: &[f64],
    ln_cos: &[f64],
    factor: &[f64],
    max_height: Option<&[f64]>,
    shape: [usize; 3],
    loss: Loss,
) -> Vec<Slice> {
    let [_, n_channels, n_h] = shape;
    moments
        .par_chunks_exact((n_h * crate::profile::MOMENTS).max(1))
        .enumerate()
        .map(|(i, moments)| {
            let row = i / n_channels * n_h..(i / n_channels + 1) * n_h;
            let mut slice = Slice::new(moments, &ln_cos[row.clone()], &factor[row], loss);
            slice.max_height = max_height.map_or(f64::NAN, |height| height[i]).min(slice.max_height);
            slice
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::slice::tests::Samples;

    const PLAN: Plan = Plan { n_lobes: 2, method: Method::Joint, azimuthal: true, follow: true };

    /// Three slices of two channels; the second slice of the second channel is empty.
    fn example() -> Vec<Slice> {
        let empty = Slice::new(&[], &[], &[], Loss::L2);
        let full = |n_h| Samples::new(n_h, 11).slice(Loss::L2);
        vec![full(40), full(30), full(25), empty, full(20), full(35)]
    }

    #[test]
    fn never_above_the_em_nor_the_plain_fit() {
        let slices = example();
        let fit = |plan: Plan| fit(&slices, &slices, 2, plan);
        let em = fit(Plan { method: Method::Em, azimuthal: false, ..PLAN });
        let plain = fit(Plan { azimuthal: false, ..PLAN });
        for ((em, plain), best) in em.iter().zip(&plain).zip(fit(PLAN)) {
            assert!(plain.objective <= em.objective * (1.0 + 1e-12));
            assert!(best.objective <= plain.objective * (1.0 + 1e-3));
            assert_eq!(plain.em_history, em.em_history);
        }
    }

    #[test]
    fn an_empty_slice_says_so() {
        let fits = fit(&example(), &example(), 2, PLAN);
        let empty: Vec<bool> = fits.iter().map(|fit| fit.status == Status::NoData).collect();
        assert_eq!(empty, [false, false, false, true, false, false]);
        assert!(fits.iter().all(|fit| fit.lobes.len() == 2 && fit.objective.is_finite()));
    }
}
