//! The sum of lobes of one slice as a least-squares problem in `ln kappa`, `ln gamma` and `atanh beta`.

use crate::levenberg_marquardt::{LeastSquares, Minimum, Stop, minimise};
use crate::lobe::{Lobe, values_and_slopes};
use crate::slice::{LANES, Loss, Slice};

/// Range of `ln kappa`: below, a lobe is as good as absent; above, its height overflows.
const LN_KAPPA: (f64, f64) = (-40.0, 6.5);
/// Range of `ln gamma`: within it, changes of shape can be told apart in double precision.
const LN_GAMMA: (f64, f64) = (-14.0, 14.0);
/// Range of `atanh beta`: |beta| < 1 - 4e-9.
const ATANH_BETA: (f64, f64) = (-1.57, 1.57);

/// The least-squares problem of a slice.
pub struct Mixture<'a> {
    slice: &'a Slice,
    /// What the lobes are fitted to: the mean over phi_d, or a lobe's share of it.
    pub target: Vec<f64>,
    azimuthal: bool,
    lobes: Vec<Lobe>,
    /// (lobe, theta_h): value, derivative by `ln kappa`.
    value: Vec<f64>,
    slope: Vec<f64>,
    /// Residual rows: those of the mean, then (azimuthal only) those of cos(2 phi_d).
    residual: Vec<f64>,
    /// d(mean row) / d(model mean), without and with the skew.
    weight: Vec<f64>,
    jacobian: Vec<f64>,
}

impl<'a> Mixture<'a> {
    #[must_use]
    pub fn new(slice: &'a Slice, n_lobes: usize, azimuthal: bool) -> Self {
        let n = slice.ln_cos.len();
        let rows = if azimuthal { 2 * n } else { n };
        Self {
            slice,
            target: slice.mean.clone(),
            azimuthal,
            lobes: vec![Lobe { kappa: 0.0, gamma: 0.0, beta: 0.0 }; n_lobes],
            value: vec![0.0; n_lobes * n],
            slope: vec![0.0; n_lobes * n],
            residual: vec![0.0; rows],
            weight: vec![0.0; n],
            jacobian: vec![0.0; n_lobes * parameters(azimuthal) * rows],
        }
    }

    fn set(&mut self, x: &[f64]) {
        for (lobe, x) in self.lobes.iter_mut().zip(x.chunks_exact(parameters(self.azimuthal))) {
            *lobe = lobe_at(x);
        }
    }

    /// Sums of the lobes, `a` and (azimuthal) `b`, left in the two halves of `residual`.
    fn sum_lobes(&mut self) {
        let n = self.slice.ln_cos.len();
        self.residual.fill(0.0);
        let (a, b) = self.residual.split_at_mut(n);
        for (k, lobe) in self.lobes.iter().enumerate() {
            let value = &mut self.value[k * n..(k + 1) * n];
            values_and_slopes(
                &self.slice.ln_cos,
                lobe.kappa,
                lobe.gamma,
                value,
                &mut self.slope[k * n..(k + 1) * n],
            );
            add(1.0, value, a);
            add(lobe.beta, value, b);
        }
    }
}

/// `sum += factor * value`; nothing where `sum` is empty.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add(factor: f64, value: &[f64], sum: &mut [f64]) {
    for (sum, value) in sum.iter_mut().zip(value) {
        *sum += factor * value;
    }
}

/// Numbers a lobe has in the problem.
fn parameters(azimuthal: bool) -> usize {
    if azimuthal { 3 } else { 2 }
}

fn lobe_at(x: &[f64]) -> Lobe {
    Lobe { kappa: x[0].exp(), gamma: x[1].exp(), beta: x.get(2).map_or(0.0, |s| s.sin()) }
}

impl LeastSquares for Mixture<'_> {
    fn cost(&mut self, x: &[f64]) -> f64 {
        self.set(x);
        self.sum_lobes();
        let slice = self.slice;
        let n = slice.ln_cos.len();
        let (mean_rows, cos_rows) = self.residual.split_at_mut(n);
        for i in 0..n {
            let b = if self.azimuthal { cos_rows[i] } else { 0.0 };
            let model = mean_rows[i] + slice.skew[i] * b;
            (mean_rows[i], self.weight[i]) = match slice.loss {
                Loss::L2 => (slice.w_a[i] * (model - self.target[i]), slice.w_a[i]),
                Loss::Log { offset } => {
                    let ratio = (model + offset) / (self.target[i] + offset);
                    (slice.w_a[i] * ratio.ln(), slice.w_a[i] / (model + offset))
                }
            };
        }
        if self.azimuthal {
            for (i, row) in cos_rows.iter_mut().enumerate() {
                *row = slice.w_b[i] * *row - slice.y_b[i];
            }
        }
        0.5 * dot(&self.residual, &self.residual)
    }

    fn linearise(&mut self, hessian: &mut [f64], gradient: &mut [f64]) {
        let slice = self.slice;
        let n = slice.ln_cos.len();
        let rows = self.residual.len();
        for (k, lobe) in self.lobes.iter().enumerate() {
            let value = &self.value[k * n..(k + 1) * n];
            let slope = &self.slope[k * n..(k + 1) * n];
            let width = parameters(self.azimuthal) * rows;
            let columns = &mut self.jacobian[k * width..(k + 1) * width];
            let (by_kappa, rest) = columns.split_at_mut(rows);
            let (by_gamma, by_beta) = rest.split_at_mut(rows);
            for i in 0..n {
                let d = self.weight[i] * (1.0 + slice.skew[i] * lobe.beta) * slope[i];
                by_kappa[i] = d;
                by_gamma[i] = d * lobe.gamma * slice.ln_cos[i];
            }
            if self.azimuthal {
                let by_s = (1.0 - lobe.beta * lobe.beta).sqrt();
                for i in 0..n {
                    let d = slice.w_b[i] * lobe.beta * slope[i];
                    by_kappa[n + i] = d;
                    by_gamma[n + i] = d * lobe.gamma * slice.ln_cos[i];
                    by_beta[i] = self.weight[i] * slice.skew[i] * value[i] * by_s;
                    by_beta[n + i] = slice.w_b[i] * value[i] * by_s;
                }
            }
        }
        normal_equations(&self.jacobian, &self.residual, hessian, gradient);
    }

    fn project(&self, x: &mut [f64]) {
        let limits = [LN_KAPPA, LN_GAMMA, ATANH_BETA];
        for x in x.chunks_exact_mut(parameters(self.azimuthal)) {
            for (x, (low, high)) in x.iter_mut().zip(limits) {
                *x = x.clamp(low, high);
            }
        }
    }
}

impl Mixture<'_> {
    /// Best lobes found from `start`, and how the search ended; its cost is half of the sum of squares less
    /// the slice's floor and, without the azimuthal term, less its rows of cos(2 phi_d).
    pub fn fit(&mut self, start: &[Lobe], stop: Stop) -> (Vec<Lobe>, Minimum) {
        let size = parameters(self.azimuthal);
        let mut x: Vec<f64> = start
            .iter()
            .flat_map(|lobe| [lobe.kappa.ln(), lobe.gamma.ln(), lobe.beta.asin()].into_iter().take(size))
            .collect();
        let minimum = minimise(self, &mut x, stop);
        (x.chunks_exact(size).map(lobe_at).collect(), minimum)
    }
}

#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    for (x, y) in x.chunks_exact(LANES).zip(y.chunks_exact(LANES)) {
        for lane in 0..LANES {
            sums[lane] = x[lane].mul_add(y[lane], sums[lane]);
        }
    }
    sums.iter().sum()
}

/// `J^T J` and `J^T r` of a Jacobian stored column after column.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn normal_equations(jacobian: &[f64], residual: &[f64], hessian: &mut [f64], gradient: &mut [f64]) {
    let p = gradient.len();
    let column = |i: usize| &jacobian[i * residual.len()..(i + 1) * residual.len()];
    for i in 0..p {
        gradient[i] = dot(column(i), residual);
        for j in 0..=i {
            let entry = dot(column(i), column(j));
            hessian[i * p + j] = entry;
            hessian[j * p + i] = entry;
        }
    }
}
