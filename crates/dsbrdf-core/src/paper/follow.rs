//! Which lobes of neighbouring slices, and of channels, are the same (Section 4).

use crate::paper::assignment::{assign, distance};
use crate::paper::lobe::Lobe;
use crate::paper::slice_fit::{SliceFit, Status, best};

/// A candidate within this of the best objective may be taken for the sake of smooth curves.
const AS_GOOD: f64 = 2e-4;

/// Lobes by falling kappa: the paper's order.
pub fn sorted(fit: &SliceFit) -> SliceFit {
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
pub fn follow(along: &[&Vec<SliceFit>]) -> Vec<SliceFit> {
    let mut curve: Vec<SliceFit> = along.iter().map(|fits| fits[0].clone()).collect();
    // Slices without data have no lobes to follow
    let known: Vec<usize> = (0..along.len()).filter(|&i| curve[i].status != Status::NoData).collect();
    let admissible: Vec<Vec<&SliceFit>> = known.iter().map(|&i| as_good_as_best(along[i])).collect();
    let mut last: Option<Vec<Lobe>> = None;
    for ((&slice, fits), choice) in known.iter().zip(&admissible).zip(smoothest(&admissible)) {
        curve[slice] = match &last {
            None => sorted(fits[choice]),
            Some(lobes) => permuted(fits[choice], &correspondence(lobes, &fits[choice].lobes).1),
        };
        last = Some(curve[slice].lobes.clone());
    }
    curve
}

/// Candidates as good as the best and (but for rounding) never above the EM alone.
fn as_good_as_best(fits: &[SliceFit]) -> Vec<&SliceFit> {
    let em = fits[0].em_history.last().copied().unwrap_or(f64::INFINITY);
    let least = best(fits).objective;
    let limit = (least * (1.0 + AS_GOOD)).min(em).max(least);
    fits.iter().filter(|fit| fit.objective <= limit).collect()
}

/// One candidate a slice with the least summed distance between neighbours (Viterbi).
fn smoothest(candidates: &[Vec<&SliceFit>]) -> Vec<usize> {
    let least =
        |costs: &[f64]| (0..costs.len()).reduce(|i, j| if costs[j] < costs[i] { j } else { i }).unwrap_or(0);
    let mut cost = vec![0.0; candidates.first().map_or(0, Vec::len)];
    let mut came_from: Vec<Vec<usize>> = Vec::new();
    for pair in candidates.windows(2) {
        let (costs, origins) = pair[1]
            .iter()
            .map(|to| {
                let step = |from: &&SliceFit| correspondence(&from.lobes, &to.lobes).0;
                let totals: Vec<f64> =
                    pair[0].iter().zip(&cost).map(|(from, cost)| cost + step(from)).collect();
                let origin = least(&totals);
                (totals[origin], origin)
            })
            .unzip();
        cost = costs;
        came_from.push(origins);
    }
    let mut path = vec![least(&cost)];
    for origins in came_from.iter().rev() {
        path.push(origins[path[path.len() - 1]]);
    }
    path.reverse();
    path
}

fn permuted(fit: &SliceFit, order: &[usize]) -> SliceFit {
    let mut fit = fit.clone();
    fit.lobes = order.iter().map(|&k| fit.lobes[k]).collect();
    fit
}

/// Gives the lobes of all channels the order of the first, and that one the order of mean `ln kappa`.
pub fn match_channels(mut curves: Vec<Vec<SliceFit>>) -> Vec<Vec<SliceFit>> {
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
