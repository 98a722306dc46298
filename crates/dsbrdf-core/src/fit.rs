//! The fit of a whole BRDF: every slice from several starts, then lobes followed over theta_d.

use rayon::prelude::*;

use crate::assignment::{assign, distance};
use crate::em::{expectation_maximisation, halved_start};
use crate::levenberg_marquardt::Stop;
use crate::lobe::Lobe;
use crate::mixture::Mixture;
use crate::slice::{Loss, Slice};
use crate::start::grow;

/// Rounds of the EM, and the relative change of its objective at which it stops.
const EM_ROUNDS: usize = 60;
const EM_TOLERANCE: f64 = 1e-3;
/// Rounds in which every slice also starts from its neighbours in theta_d.
const NEIGHBOUR_ROUNDS: usize = 1;
/// A candidate within this of the best objective may be taken for the sake of smooth curves.
const AS_GOOD: f64 = 2e-4;
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

/// The joint fit's stopping rule while candidates are compared.
fn scout(slice: &Slice) -> Stop {
    Stop { max_iterations: 40, cost: 3e-2, floor: 0.5 * slice.floor, zero: 1e-28 * slice.energy }
}

/// The stopping rule of the joint fit that ends in the model.
fn finish(slice: &Slice) -> Stop {
    Stop { max_iterations: 500, cost: 1e-5, floor: 0.5 * slice.floor, zero: 1e-28 * slice.energy }
}

/// Fits slices given theta_d by theta_d, `n_channels` after one another.
#[must_use]
pub fn fit(slices: &[Slice], l2_slices: &[Slice], n_channels: usize, plan: Plan) -> Vec<SliceFit> {
    let mut candidates: Vec<Vec<SliceFit>> =
        slices.par_iter().zip(l2_slices).map(|(slice, l2)| starts(slice, l2, plan)).collect();
    if plan.method == Method::Joint {
        for _ in 0..NEIGHBOUR_ROUNDS {
            from_neighbours(slices, n_channels, &mut candidates, false);
        }
        if plan.azimuthal {
            candidates.par_iter_mut().zip(slices).for_each(|(fits, slice)| add_azimuthal(slice, fits));
            from_neighbours(slices, n_channels, &mut candidates, true);
        }
    }
    let mut fits: Vec<Option<SliceFit>> = vec![None; slices.len()];
    let curves: Vec<Vec<SliceFit>> = (0..n_channels)
        .into_par_iter()
        .map(|channel| {
            let along: Vec<&Vec<SliceFit>> = candidates.iter().skip(channel).step_by(n_channels).collect();
            if plan.follow { follow(&along) } else { along.iter().map(|fits| sorted(best(fits))).collect() }
        })
        .collect();
    let curves = if plan.follow { match_channels(curves) } else { curves };
    for (channel, curve) in curves.into_iter().enumerate() {
        for (slice, fit) in curve.into_iter().enumerate() {
            fits[slice * n_channels + channel] = Some(fit);
        }
    }
    let mut fits: Vec<SliceFit> = fits.into_iter().flatten().collect();
    if plan.method == Method::Joint {
        fits.par_iter_mut().zip(slices).for_each(|(fit, slice)| polish(slice, plan.azimuthal, fit));
    }
    fits
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

fn best(fits: &[SliceFit]) -> &SliceFit {
    fits.iter()
        .reduce(|best, fit| if fit.objective < best.objective { fit } else { best })
        .expect("a candidate")
}

/// What stands for a lobe where there is nothing to fit.
const ABSENT: Lobe = Lobe { kappa: 1e-12, gamma: 1.0, beta: 0.0 };

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

/// Adds to every slice the fits that start from the best of the slices before and after in theta_d.
fn from_neighbours(slices: &[Slice], n_channels: usize, candidates: &mut [Vec<SliceFit>], azimuthal: bool) {
    let bests: Vec<Vec<Lobe>> = candidates.iter().map(|fits| best(fits).lobes.clone()).collect();
    let empty: Vec<bool> = candidates.iter().map(|fits| fits[0].status == Status::NoData).collect();
    candidates.par_iter_mut().enumerate().for_each(|(i, fits)| {
        let neighbours = [i.checked_sub(n_channels), Some(i + n_channels)];
        for j in neighbours.into_iter().flatten() {
            if j < slices.len() && !empty[i] && !empty[j] {
                fits.push(joint(&slices[i], &bests[j], azimuthal, 0));
            }
        }
    });
}

/// Replaces the candidates by azimuthal ones that start from the best of them.
fn add_azimuthal(slice: &Slice, fits: &mut Vec<SliceFit>) {
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

fn sorted(fit: &SliceFit) -> SliceFit {
    let mut fit = fit.clone();
    fit.lobes.sort_by(|x, y| y.kappa.total_cmp(&x.kappa));
    fit
}

/// Sum of distances between lobes under the best correspondence, and that correspondence.
fn correspondence(from: &[Lobe], to: &[Lobe]) -> (f64, Vec<usize>) {
    let cost: Vec<Vec<f64>> = from.iter().map(|x| to.iter().map(|y| distance(x, y)).collect()).collect();
    assign(&cost)
}

/// The smoothest path over theta_d through candidates as good as the best, its lobes in one order.
fn follow(along: &[&Vec<SliceFit>]) -> Vec<SliceFit> {
    let admissible: Vec<Vec<&SliceFit>> = along
        .iter()
        .map(|fits| {
            // As good as the best, and never above the EM alone (but for rounding)
            let em = fits[0].em_history.last().copied().unwrap_or(f64::INFINITY);
            let least = best(fits).objective;
            let limit = (least * (1.0 + AS_GOOD)).min(em).max(least);
            fits.iter().filter(|fit| fit.objective <= limit).collect()
        })
        .collect();

    // Viterbi: least summed distance to each candidate, and the candidate it came from
    let mut cost = vec![0.0; admissible.first().map_or(0, Vec::len)];
    let mut came_from: Vec<Vec<usize>> = Vec::new();
    for pair in admissible.windows(2) {
        let (costs, origins): (Vec<f64>, Vec<usize>) = pair[1]
            .iter()
            .map(|to| {
                let total = |i: usize| cost[i] + correspondence(&pair[0][i].lobes, &to.lobes).0;
                (0..pair[0].len())
                    .map(|i| (total(i), i))
                    .reduce(|best, next| if next.0 < best.0 { next } else { best })
                    .expect("a candidate")
            })
            .unzip();
        cost = costs;
        came_from.push(origins);
    }
    let mut at =
        (0..cost.len()).reduce(|best, next| if cost[next] < cost[best] { next } else { best }).unwrap_or(0);
    let mut path = vec![at];
    for origins in came_from.iter().rev() {
        at = origins[at];
        path.push(at);
    }
    path.reverse();

    let mut curve: Vec<SliceFit> = Vec::with_capacity(along.len());
    for (fits, &choice) in admissible.iter().zip(&path) {
        let mut fit = match curve.last() {
            None => sorted(fits[choice]),
            Some(last) => {
                let order = correspondence(&last.lobes, &fits[choice].lobes).1;
                permuted(fits[choice], &order)
            }
        };
        fit.em_history.clone_from(&along[curve.len()][0].em_history);
        curve.push(fit);
    }
    curve
}

fn permuted(fit: &SliceFit, order: &[usize]) -> SliceFit {
    let mut fit = fit.clone();
    fit.lobes = order.iter().map(|&k| fit.lobes[k]).collect();
    fit
}

/// Gives the lobes of all channels the order of the first, and that one the order of mean `ln kappa`.
fn match_channels(mut curves: Vec<Vec<SliceFit>>) -> Vec<Vec<SliceFit>> {
    let Some(n_lobes) = curves.first().and_then(|curve| curve.first()).map(|fit| fit.lobes.len()) else {
        return curves;
    };
    let height = |k: usize| -> f64 { curves[0].iter().map(|fit| fit.lobes[k].kappa.ln()).sum() };
    let mut order: Vec<usize> = (0..n_lobes).collect();
    order.sort_by(|&i, &j| height(j).total_cmp(&height(i)));
    curves[0] = curves[0].iter().map(|fit| permuted(fit, &order)).collect();
    let (first, others) = curves.split_at_mut(1);
    for curve in others {
        let cost: Vec<Vec<f64>> = (0..n_lobes)
            .map(|i| {
                let between =
                    |j| first[0].iter().zip(&*curve).map(move |(x, y)| distance(&x.lobes[i], &y.lobes[j]));
                (0..n_lobes).map(|j| between(j).sum()).collect()
            })
            .collect();
        let order = assign(&cost).1;
        *curve = curve.iter().map(|fit| permuted(fit, &order)).collect();
    }
    curves
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
/// (theta_d, theta_h).
#[must_use]
pub fn slices(moments: &[f64], ln_cos: &[f64], factor: &[f64], shape: [usize; 3], loss: Loss) -> Vec<Slice> {
    let [_, n_channels, n_h] = shape;
    moments
        .par_chunks_exact((n_h * crate::profile::MOMENTS).max(1))
        .enumerate()
        .map(|(i, moments)| {
            let row = i / n_channels * n_h..(i / n_channels + 1) * n_h;
            Slice::new(moments, &ln_cos[row.clone()], &factor[row], loss)
        })
        .collect()
}
