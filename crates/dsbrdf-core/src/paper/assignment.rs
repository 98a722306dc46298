//! Which lobe of one set continues which lobe of another.

use crate::paper::lobe::Lobe;

/// Added to gamma before its logarithm: flatter lobes than this look alike.
const FLAT: f64 = 0.1;

/// How unlike two lobes are: squared distance of their log-parameters.
#[must_use]
pub fn distance(x: &Lobe, y: &Lobe) -> f64 {
    let kappa = (x.kappa / y.kappa).ln();
    let gamma = ((x.gamma + FLAT) / (y.gamma + FLAT)).ln();
    kappa * kappa + gamma * gamma
}

/// The permutation `p` with the least sum of `cost[i][p[i]]`, and that sum; by dynamic programming over subsets.
#[must_use]
pub fn assign(cost: &[Vec<f64>]) -> (f64, Vec<usize>) {
    let n = cost.len();
    // best[mask]: least cost of giving rows 0..count(mask) the columns in mask; and its last column
    let mut best = vec![(f64::INFINITY, 0); 1 << n];
    best[0].0 = 0.0;
    for mask in 0..1_usize << n {
        let row = mask.count_ones() as usize;
        for column in (0..n).filter(|c| mask & (1 << c) == 0) {
            let next = mask | 1 << column;
            let total = best[mask].0 + cost[row][column];
            if total < best[next].0 {
                best[next] = (total, column);
            }
        }
    }
    let mut mask = (1 << n) - 1;
    let mut permutation = vec![0; n];
    for row in (0..n).rev() {
        permutation[row] = best[mask].1;
        mask &= !(1 << permutation[row]);
    }
    (best[(1 << n) - 1].0, permutation)
}

#[cfg(test)]
mod tests {
    use super::assign;

    #[test]
    fn finds_the_cheapest_permutation() {
        let cost = vec![vec![4.0, 1.0, 3.0], vec![2.0, 0.0, 5.0], vec![3.0, 2.0, 2.0]];
        assert_eq!(assign(&cost), (5.0, vec![1, 0, 2]));
    }
}
