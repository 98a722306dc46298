//! Fits with one lobe, two lobes and so on, each grown from the one before.

use rayon::prelude::*;

use crate::estimator::{LN_GAMMA, LN_KAPPA, Loss, Penalty, Prior, Problem};
use crate::levenberg_marquardt::{LeastSquares, Stop, minimise};
use crate::observations::Observations;
use crate::shape::{GAMMA, SCALE, Shape, Sizes};

/// What is fitted, and how.
pub struct Plan<'a> {
    pub sizes: Sizes,
    pub loss: Loss,
    /// A channel's offset of the logarithm.
    pub offset: &'a [f64],
    pub penalty: Penalty,
    /// Independent observations that the data are worth.
    pub n_effective: f64,
}

/// Lobes found, and how good they are.
#[derive(Clone, Debug)]
pub struct Solution {
    pub shape: Shape,
    pub x: Vec<f64>,
    /// Weighted mean of squared residuals.
    pub squares: f64,
    /// Twice the negative logarithm of the posterior.
    pub objective: f64,
    /// Logarithm of the determinant of the Hessian of half the objective.
    pub log_det: f64,
    pub iterations: usize,
    pub converged: bool,
}

/// Mean squares below this are rounding.
pub const LEAST_SQUARES: f64 = 1e-22;
/// Iterations of a first look at a start, and of the best of them.
const LOOK: usize = 5;
const GROW: usize = 25;
/// Starts that are taken further.
const KEPT: usize = 3;
/// The noise is estimated again at most so many times.
const ROUNDS: usize = 6;
/// Height of a lobe that is not there yet, `ln kappa`.
const ABSENT: f64 = -30.0;

/// Minimises the objective from `x`, the noise level estimated along the way.
pub fn refine(
    problem: &mut Problem,
    mut x: Vec<f64>,
    n_effective: f64,
    iterations: usize,
    tolerance: f64,
) -> Solution {
    let mut spent = 0;
    let mut converged = false;
    for round in 0..ROUNDS {
        problem.cost(&x);
        let before = problem.squares;
        problem.precision = n_effective / (before + LEAST_SQUARES);
        let stop = Stop {
            max_iterations: iterations - spent.min(iterations),
            cost: tolerance,
            floor: 0.0,
            energy: n_effective,
        };
        let minimum = minimise(problem, &mut x, stop);
        spent += minimum.iterations;
        problem.cost(&x);
        converged = minimum.converged;
        let settled =
            (before / problem.squares.max(LEAST_SQUARES)).ln() < 0.01 || problem.squares <= LEAST_SQUARES;
        if !converged || (settled && round > 0) || iterations <= spent {
            break;
        }
    }
    Solution {
        shape: problem.shape.clone(),
        squares: problem.squares,
        objective: problem.objective(n_effective, LEAST_SQUARES),
        log_det: f64::NAN,
        iterations: spent,
        converged,
        x,
    }
}

/// The solution with the determinant of the Hessian at it.
#[must_use]
pub fn with_log_det(problem: &mut Problem, mut solution: Solution, n_effective: f64) -> Solution {
    problem.precision = n_effective / (solution.squares + LEAST_SQUARES);
    problem.cost(&solution.x);
    let mut equations = problem.equations();
    problem.linearise(&mut equations);
    let held = vec![false; solution.x.len()];
    solution.log_det = equations.factor(1e-12, &held).map_or(f64::NAN, |factor| factor.log_det());
    solution
}

impl Plan<'_> {
    fn shape(&self, n_lobes: usize, n_channels: usize) -> Shape {
        Shape { n_lobes, n_channels, sizes: self.sizes }
    }

    /// A problem of these lobes.
    pub fn problem<'a>(
        &self,
        observations: &'a Observations,
        shape: Shape,
        prior: Option<&'a Prior>,
    ) -> Problem<'a> {
        Problem::new(observations, shape, self.loss, self.offset, self.penalty, prior)
    }

    /// Fits with 1 to `max_lobes` lobes.
    #[must_use]
    pub fn grow(&self, observations: &Observations, max_lobes: usize) -> Vec<Solution> {
        let mut found: Vec<Solution> = Vec::new();
        for n_lobes in 1..=max_lobes {
            let mut starts = vec![self.ladder(observations, n_lobes)];
            if let Some(last) = found.last() {
                starts.extend(self.with_one_more(last));
            } else {
                starts.extend([1.0_f64, 30.0].map(|gamma| {
                    let (shape, mut x) = self.ladder(observations, 1);
                    let at = shape.shared(GAMMA, 0);
                    x[at..at + self.sizes.gamma].fill(gamma.ln());
                    (shape, x)
                }));
            }
            let mut looked: Vec<Solution> = starts
                .into_par_iter()
                .map(|(shape, x)| {
                    refine(&mut self.problem(observations, shape, None), x, self.n_effective, LOOK, 1e-3)
                })
                .collect();
            looked.sort_by(|a, b| a.objective.total_cmp(&b.objective));
            looked.truncate(KEPT);
            let best = looked
                .into_par_iter()
                .map(|s| {
                    refine(&mut self.problem(observations, s.shape, None), s.x, self.n_effective, GROW, 1e-3)
                })
                .min_by(|a, b| a.objective.total_cmp(&b.objective))
                .expect("a start");
            // One lobe more never makes it worse: it may be absent
            let best = match found.last() {
                Some(last) if last.objective < best.objective => self.padded(last),
                _ => best,
            };
            found.push(best);
        }
        found
    }

    /// A solution with one more lobe, which is not there.
    #[must_use]
    pub fn padded(&self, solution: &Solution) -> Solution {
        let (shape, x) = self.added(solution, 1.0, |_| ABSENT);
        Solution { shape, x, ..solution.clone() }
    }

    /// Heights between the 30 % and the 99.9 % quantiles, gammas between 0.3 and 900, both geometric.
    fn ladder(&self, observations: &Observations, n_lobes: usize) -> (Shape, Vec<f64>) {
        let channels = observations.n_channels;
        let shape = self.shape(n_lobes, channels);
        let mut x = vec![0.0; shape.n_unknowns()];
        let quantiles: Vec<[f64; 2]> = (0..channels).map(|c| self.quantiles(observations, c)).collect();
        for k in 0..n_lobes {
            let share = if n_lobes > 1 { k as f64 / (n_lobes - 1) as f64 } else { 0.3 };
            let height: Vec<f64> = quantiles
                .iter()
                .map(|&[low, high]| (low.powf(1.0 - share) * (high - low).max(low).powf(share)).ln_1p().ln())
                .collect();
            let mean = height.iter().sum::<f64>() / channels as f64;
            let curve = |curve| {
                let at = shape.shared(curve, k);
                at..at + shape.basis(curve).size
            };
            x[curve(SCALE)].fill(mean);
            x[curve(GAMMA)].fill((0.3_f64 * 3000.0_f64.powf(share)).ln());
            for (channel, height) in height.iter().enumerate() {
                let at = shape.colour(channel, k);
                x[at..at + shape.n_colour()].fill(height - mean);
            }
        }
        (shape, x)
    }

    /// The 30 % and 99.9 % quantiles of a channel's values, above its offset.
    fn quantiles(&self, observations: &Observations, channel: usize) -> [f64; 2] {
        let n = observations.len();
        let mut values: Vec<f64> = (0..observations.n_nodes)
            .map(|node| observations.row(node, channel))
            .flat_map(|row| (row..row + n).filter(|&i| observations.weight[i] > 0.0))
            .map(|i| observations.value[i].max(1e-3 * self.offset[channel]))
            .collect();
        if values.is_empty() {
            return [self.offset[channel]; 2];
        }
        values.sort_by(f64::total_cmp);
        [0.3, 0.999].map(|q| values[(q * (values.len() - 1) as f64) as usize])
    }

    /// Starts with a lobe between, below and above the widths there are.
    fn with_one_more(&self, last: &Solution) -> Vec<(Shape, Vec<f64>)> {
        let shape = &last.shape;
        let mean = |k: usize| {
            let at = shape.shared(GAMMA, k);
            last.x[at..at + self.sizes.gamma].iter().sum::<f64>() / self.sizes.gamma as f64
        };
        let mut widths: Vec<f64> = (0..shape.n_lobes).map(mean).collect();
        widths.sort_by(f64::total_cmp);
        let mut gammas: Vec<f64> = widths.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
        let (low, high) = (widths.first().copied().unwrap_or(1.0), widths.last().copied().unwrap_or(1.0));
        gammas.extend([low.min(2.0) - 1.5, high + 1.5, high + 3.0]);
        gammas
            .into_iter()
            .map(|g| g.clamp(LN_GAMMA.0 + 1.0, LN_GAMMA.1 - 1.0))
            .map(|g| {
                // Where the new lobe has fallen by half, it adds a third
                let ln_cos = -0.7 * (-g).exp();
                self.added(last, g, |x| self.brightness(last, x, ln_cos))
            })
            .collect()
    }

    /// `ln kappa` of a third of a solution's value, channels averaged.
    fn brightness(&self, solution: &Solution, x: f64, ln_cos: f64) -> f64 {
        let shape = &solution.shape;
        let curve = |curve, k| {
            let at = shape.shared(curve, k);
            shape.basis(curve).value(&solution.x[at..at + shape.basis(curve).size], x)
        };
        let value: f64 = (0..shape.n_lobes)
            .map(|k| (curve(SCALE, k) + curve(GAMMA, k).exp() * ln_cos).min(LN_KAPPA.1).exp().exp_m1())
            .sum();
        (value / 3.0).ln_1p().max(1e-300).ln().clamp(LN_KAPPA.0, LN_KAPPA.1)
    }

    /// A solution with a lobe more.
    fn added(&self, last: &Solution, ln_gamma: f64, height: impl Fn(f64) -> f64) -> (Shape, Vec<f64>) {
        let old = &last.shape;
        let shape = self.shape(old.n_lobes + 1, old.n_channels);
        let mut x = vec![0.0; shape.n_unknowns()];
        x[..old.n_shared()].copy_from_slice(&last.x[..old.n_shared()]);
        for channel in 0..old.n_channels {
            let (to, from) = (shape.colour(channel, 0), old.colour(channel, 0));
            x[to..to + old.n_block()].copy_from_slice(&last.x[from..from + old.n_block()]);
        }
        let k = old.n_lobes;
        let size = self.sizes.scale;
        for i in 0..size {
            let at = if size > 1 { i as f64 / (size - 1) as f64 } else { 0.5 };
            x[shape.shared(SCALE, k) + i] = height(at);
        }
        let at = shape.shared(GAMMA, k);
        x[at..at + self.sizes.gamma].fill(ln_gamma);
        // A colour between those of the others
        for channel in 0..old.n_channels {
            for i in 0..shape.n_colour() {
                let others = (0..k).map(|other| x[shape.colour(channel, other) + i]).sum::<f64>();
                x[shape.colour(channel, k) + i] = others / k as f64;
            }
        }
        (shape, x)
    }
}
