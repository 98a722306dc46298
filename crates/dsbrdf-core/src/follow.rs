//! Which lobes of neighbouring slices, and of channels, are the same (Section 4).

use crate::assignment::{assign, distance};
use crate::fit::{SliceFit, best};
use crate::lobe::Lobe;

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
