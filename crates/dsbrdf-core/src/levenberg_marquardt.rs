//! Levenberg-Marquardt with Nielsen's damping, on normal equations.

use crate::arrow::Arrow;

/// A sum of squares.
pub trait LeastSquares {
    /// Half the sum of squares at `x`.
    fn cost(&mut self, x: &[f64]) -> f64;
    /// The unknowns as blocks, zero in all entries.
    fn equations(&self) -> Arrow;
    /// Gradient and Gauss-Newton Hessian at the last `x` that `cost` was asked for; `equations` come in with zeros.
    fn linearise(&mut self, equations: &mut Arrow);
    /// Least and greatest value of unknown `i`.
    fn limits(&self, i: usize) -> (f64, f64);
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    pub max_iterations: usize,
    /// Decrease of the cost over [`WINDOW`] iterations, relative to cost and floor together. A thousandth of it
    /// is enough in a single step, predicted and actual.
    pub cost: f64,
    /// What is left at best, and not part of the cost.
    pub floor: f64,
    /// Sum of squares of the data: costs of [`ZERO`] times it are met to rounding, and a slow descent of less than
    /// [`NEGLIGIBLE`] times it over [`WINDOW`] iterations is not worth the time.
    pub energy: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minimum {
    pub cost: f64,
    pub iterations: usize,
    pub converged: bool,
}

/// Iterations over which a slow descent is judged.
const WINDOW: usize = 8;
const ZERO: f64 = 1e-28;
const NEGLIGIBLE: f64 = 1e-9;
/// A descent is slow if less than this share of the cost goes in [`WINDOW`] iterations.
const SLOW: f64 = 0.5;
/// Unknowns are logarithms and angles: what asks for more than this has next to no effect, and must not hold up
/// the others.
const MAX_STEP: f64 = 8.0;
/// Steps rejected in a row before the damping is taken to mean that no descent is left.
const MAX_REJECTED: usize = 40;

/// Minimises `problem` from `x`, which becomes the minimum; the cost never rises.
pub fn minimise(problem: &mut impl LeastSquares, x: &mut [f64], stop: Stop) -> Minimum {
    let p = x.len();
    let mut equations = problem.equations();
    let mut step = vec![0.0; p];
    let mut trial = vec![0.0; p];

    let limits: Vec<(f64, f64)> = (0..p).map(|i| problem.limits(i)).collect();
    let mut held = vec![false; p];
    for (x, &(low, high)) in x.iter_mut().zip(&limits) {
        *x = x.clamp(low, high);
    }
    let mut cost = problem.cost(x);
    problem.linearise(&mut equations);
    let (mut damping, mut growth) = (1e-3, 2.0);
    let mut rejected = 0;
    let mut milestone = cost;
    for iteration in 0..stop.max_iterations {
        if cost <= ZERO * stop.energy {
            return Minimum { cost, iterations: iteration, converged: true };
        }
        // Unknowns that would leave the allowed range stay where they are, so that the others move freely
        let gradient = &equations.gradient;
        for (i, &(low, high)) in limits.iter().enumerate() {
            held[i] = (x[i] <= low && gradient[i] > 0.0) || (x[i] >= high && gradient[i] < 0.0);
        }
        if !solve_damped(&equations, &held, damping, &mut step) {
            damping *= growth;
            growth *= 2.0;
            rejected += 1;
            if rejected > MAX_REJECTED {
                return Minimum { cost, iterations: iteration, converged: false };
            }
            continue;
        }
        for (i, &(low, high)) in limits.iter().enumerate() {
            step[i] = step[i].clamp(-MAX_STEP, MAX_STEP);
            trial[i] = (x[i] - step[i]).clamp(low, high);
        }

        // Decrease of the quadratic model: (step . gradient + damping |step|_D^2) / 2
        let predicted: f64 = (0..p)
            .map(|i| 0.5 * step[i] * (gradient[i] + damping * scale(equations.diagonal_entry(i)) * step[i]))
            .sum();
        let new_cost = problem.cost(&trial);
        let actual = cost - new_cost;
        if actual > 0.0 && new_cost.is_finite() {
            x.copy_from_slice(&trial);
            // A step that is small because it was damped says nothing
            let tiny = damping < 1.0 && actual.max(predicted) <= 1e-3 * stop.cost * (cost + stop.floor);
            cost = new_cost;
            let judge = (iteration + 1) % WINDOW == 0;
            let least = (stop.cost * (cost + stop.floor)).max((SLOW * cost).min(NEGLIGIBLE * stop.energy));
            let slow = judge && milestone - cost <= least;
            if judge {
                milestone = cost;
            }
            if tiny || slow {
                return Minimum { cost, iterations: iteration + 1, converged: true };
            }
            equations.clear();
            problem.linearise(&mut equations);
            let ratio = actual / predicted;
            damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(0.1, 2.0);
            growth = 2.0;
            rejected = 0;
        } else {
            let tiny = damping < 1.0 && predicted <= 1e-3 * stop.cost * (cost + stop.floor);
            if tiny || rejected > MAX_REJECTED {
                return Minimum { cost, iterations: iteration + 1, converged: true };
            }
            damping *= growth;
            growth *= 2.0;
            rejected += 1;
        }
    }
    Minimum { cost, iterations: stop.max_iterations, converged: false }
}

/// Marquardt's scaling of an unknown; an unknown without effect keeps a little damping.
fn scale(diagonal: f64) -> f64 {
    diagonal.max(1e-30)
}

/// Solves `(H + damping D) step = gradient`, with no step of `held` unknowns; false if not positive definite.
fn solve_damped(equations: &Arrow, held: &[bool], damping: f64, step: &mut [f64]) -> bool {
    let Some(factor) = equations.factor(damping, held) else { return false };
    for ((step, gradient), held) in step.iter_mut().zip(&equations.gradient).zip(held) {
        *step = if *held { 0.0 } else { *gradient };
    }
    factor.solve(step);
    step.iter().all(|s| s.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rosenbrock {
        at: [f64; 2],
        high: f64,
    }

    impl Rosenbrock {
        fn residual(&self) -> [f64; 2] {
            let [x, y] = self.at;
            [10.0 * (y - x * x), 1.0 - x]
        }
    }

    impl LeastSquares for Rosenbrock {
        fn cost(&mut self, x: &[f64]) -> f64 {
            self.at = [x[0], x[1]];
            self.residual().iter().map(|r| 0.5 * r * r).sum()
        }
        fn equations(&self) -> Arrow {
            Arrow::new(2, 0, 0)
        }
        fn linearise(&mut self, equations: &mut Arrow) {
            let r = self.residual();
            let j = [[-20.0 * self.at[0], 10.0], [-1.0, 0.0]];
            for a in 0..2 {
                equations.gradient[a] = j[0][a] * r[0] + j[1][a] * r[1];
                for b in 0..=a {
                    *equations.entry(a, b) = j[0][a] * j[0][b] + j[1][a] * j[1][b];
                }
            }
        }
        fn limits(&self, _: usize) -> (f64, f64) {
            (-10.0, self.high)
        }
    }

    #[test]
    fn finds_the_minimum_of_rosenbrock() {
        let mut x = [-1.2, 1.0];
        let stop = Stop { max_iterations: 200, cost: 1e-15, floor: 0.0, energy: 1e-2 };
        let minimum = minimise(&mut Rosenbrock { at: [0.0; 2], high: 10.0 }, &mut x, stop);
        assert!(minimum.converged);
        assert!((x[0] - 1.0).abs() < 1e-10 && (x[1] - 1.0).abs() < 1e-10, "{x:?}");
    }

    #[test]
    fn says_when_it_ran_out_of_steps() {
        let stop = Stop { max_iterations: 2, cost: 1e-15, floor: 0.0, energy: 0.0 };
        assert!(!minimise(&mut Rosenbrock { at: [0.0; 2], high: 10.0 }, &mut [-1.2, 1.0], stop).converged);
    }

    #[test]
    fn slides_along_a_limit() {
        // With x, y <= 0.5 the least is at x = 0.5, y = x^2
        let mut x = [-1.2, 0.4];
        let stop = Stop { max_iterations: 200, cost: 1e-15, floor: 0.0, energy: 1e-2 };
        assert!(minimise(&mut Rosenbrock { at: [0.0; 2], high: 0.5 }, &mut x, stop).converged);
        assert!((x[0] - 0.5).abs() < 1e-12 && (x[1] - 0.25).abs() < 1e-9, "{x:?}");
    }
}
