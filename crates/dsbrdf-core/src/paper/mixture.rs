//! The sum of lobes of one slice as a least-squares problem in `ln kappa`, `ln gamma` and `asin beta`.

use crate::arrow::Arrow;
use crate::levenberg_marquardt::{LeastSquares, Minimum, Stop, minimise};
use crate::paper::lobe::{Lobe, values_and_slopes};
use crate::paper::slice::{LANES, Loss, Slice};

/// Least `ln kappa`: below, a lobe is as good as absent.
const LN_KAPPA_LOW: f64 = -40.0;
/// Where nothing is known of the pole, a lobe is at most this many times as high as the brightest point of the slice.
/// Samples near the pole are not fitted, and nothing else keeps a narrow lobe from growing there without bound.
pub const MAX_HEIGHT: f64 = 100.0;
/// Greatest `ln gamma`, either way: within it, changes of shape can be told apart in double precision.
pub const MAX_LN_GAMMA: f64 = 14.0;
/// Greatest `asin beta`, either way.
pub const MAX_ASIN_BETA: f64 = 1.57;

/// The least-squares problem of a slice.
pub struct Mixture<'a> {
    slice: &'a Slice,
    /// What the lobes are fitted to: the mean over phi_d, or a lobe's share of it.
    pub target: Vec<f64>,
    azimuthal: bool,
    ln_kappa_high: f64,
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
            ln_kappa_high: slice.max_height.ln_1p().ln(),
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

/// `sum += x y`.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add_product(x: &[f64], y: &[f64], sum: &mut [f64]) {
    for ((sum, x), y) in sum.iter_mut().zip(x).zip(y) {
        *sum += x * y;
    }
}

/// Amplitudes of cos(2 phi_d) to residuals.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn azimuthal_rows(w: &[f64], y: &[f64], row: &mut [f64]) {
    for ((row, w), y) in row.iter_mut().zip(w).zip(y) {
        *row = w * *row - y;
    }
}

/// Model means to residuals, and the derivative of each.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn l2_rows(w: &[f64], target: &[f64], row: &mut [f64], weight: &mut [f64]) {
    for (((row, weight), w), target) in row.iter_mut().zip(weight.iter_mut()).zip(w).zip(target) {
        *row = w * (*row - target);
        *weight = *w;
    }
}

/// Model means to residuals of their logarithm, and the derivative of each.
fn log_rows(w: &[f64], target: &[f64], offset: f64, row: &mut [f64], weight: &mut [f64]) {
    for (((row, weight), w), target) in row.iter_mut().zip(weight.iter_mut()).zip(w).zip(target) {
        let model = *row + offset;
        *row = w * (model / (target + offset)).ln();
        *weight = w / model;
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
        let (mean_rows, cos_rows) = self.residual.split_at_mut(slice.ln_cos.len());
        if self.azimuthal {
            add_product(&slice.skew, cos_rows, mean_rows);
            azimuthal_rows(&slice.w_b, &slice.y_b, cos_rows);
        }
        match slice.loss {
            Loss::L2 => l2_rows(&slice.w_a, &self.target, mean_rows, &mut self.weight),
            Loss::Log { offset } => log_rows(&slice.w_a, &self.target, offset, mean_rows, &mut self.weight),
        }
        0.5 * dot(&self.residual, &self.residual)
    }

    fn equations(&self) -> Arrow {
        Arrow::new(self.lobes.len() * parameters(self.azimuthal), 0, 0)
    }

    fn linearise(&mut self, equations: &mut Arrow) {
        let n = self.slice.ln_cos.len();
        let rows = self.residual.len();
        let width = parameters(self.azimuthal) * rows;
        for (k, lobe) in self.lobes.iter().enumerate() {
            let value = &self.value[k * n..(k + 1) * n];
            let slope = &self.slope[k * n..(k + 1) * n];
            columns(
                self.slice,
                lobe,
                &self.weight,
                value,
                slope,
                &mut self.jacobian[k * width..(k + 1) * width],
            );
        }
        normal_equations(&self.jacobian, &self.residual, equations);
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        // Dim slices have low peaks
        let low = LN_KAPPA_LOW.min(self.ln_kappa_high - 10.0);
        let about_zero = |most: f64| (-most, most);
        [(low, self.ln_kappa_high), about_zero(MAX_LN_GAMMA), about_zero(MAX_ASIN_BETA)]
            [i % parameters(self.azimuthal)]
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

/// A lobe's columns of the Jacobian: by `ln kappa`, by `ln gamma` and, with the azimuthal term, by `asin beta`.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns(slice: &Slice, lobe: &Lobe, weight: &[f64], value: &[f64], slope: &[f64], jacobian: &mut [f64]) {
    let n = value.len();
    let azimuthal = jacobian.len() > 2 * n;
    let rows = if azimuthal { 2 * n } else { n };
    let (by_kappa, rest) = jacobian.split_at_mut(rows);
    let (by_gamma, by_beta) = rest.split_at_mut(rows);
    for i in 0..n {
        let d = weight[i] * (1.0 + slice.skew[i] * lobe.beta) * slope[i];
        by_kappa[i] = d;
        by_gamma[i] = d * lobe.gamma * slice.ln_cos[i];
    }
    if azimuthal {
        let by_s = (1.0 - lobe.beta * lobe.beta).sqrt();
        for i in 0..n {
            let d = slice.w_b[i] * lobe.beta * slope[i];
            by_kappa[n + i] = d;
            by_gamma[n + i] = d * lobe.gamma * slice.ln_cos[i];
            by_beta[i] = weight[i] * slice.skew[i] * value[i] * by_s;
            by_beta[n + i] = slice.w_b[i] * value[i] * by_s;
        }
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
fn normal_equations(jacobian: &[f64], residual: &[f64], equations: &mut Arrow) {
    let p = equations.size();
    let column = |i: usize| &jacobian[i * residual.len()..(i + 1) * residual.len()];
    for i in 0..p {
        equations.gradient[i] = dot(column(i), residual);
        for j in 0..=i {
            *equations.entry(i, j) = dot(column(i), column(j));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::slice::tests::Samples;

    /// Central differences to fourth order of the residual rows.
    fn difference(problem: &mut Mixture, x: &[f64], i: usize) -> Vec<f64> {
        let step = 1e-3;
        let mut rows = |shift: f64| {
            let mut x = x.to_vec();
            x[i] += shift * step;
            problem.cost(&x);
            problem.residual.clone()
        };
        let (far, near) = ([rows(-2.0), rows(2.0)], [rows(-1.0), rows(1.0)]);
        (0..far[0].len())
            .map(|r| (8.0 * (near[1][r] - near[0][r]) - (far[1][r] - far[0][r])) / (12.0 * step))
            .collect()
    }

    #[test]
    fn jacobian_equals_differences() {
        let samples = Samples::new(13, 11);
        for loss in [Loss::L2, Loss::Log { offset: 1e-3 }] {
            let slice = samples.slice(loss);
            for (azimuthal, x) in
                [(false, vec![0.3, 2.5, -1.2, -0.5]), (true, vec![0.3, 2.5, 0.7, -1.2, -0.5, -0.4])]
            {
                let mut problem = Mixture::new(&slice, 2, azimuthal);
                let p = x.len();
                let columns: Vec<Vec<f64>> = (0..p).map(|i| difference(&mut problem, &x, i)).collect();
                let cost = problem.cost(&x);
                let residual = problem.residual.clone();
                assert!((2.0 * cost / dot(&residual, &residual) - 1.0).abs() < 1e-14);

                let mut equations = problem.equations();
                problem.linearise(&mut equations);
                let (hessian, gradient) = (equations.dense(), &equations.gradient);
                let size = |x: &[f64]| dot(x, x).sqrt();
                for i in 0..p {
                    let got = &problem.jacobian[i * residual.len()..(i + 1) * residual.len()];
                    let off: Vec<f64> = got.iter().zip(&columns[i]).map(|(x, y)| x - y).collect();
                    assert!(size(&off) < 1e-9 * size(got), "{loss:?} {azimuthal} {i}: {:e}", size(&off));
                    let scale = size(&columns[i]) * size(&residual);
                    assert!((gradient[i] - dot(&columns[i], &residual)).abs() < 1e-9 * scale);
                    for j in 0..p {
                        let scale = size(&columns[i]) * size(&columns[j]);
                        assert!((hessian[i * p + j] - dot(&columns[i], &columns[j])).abs() < 1e-9 * scale);
                    }
                }
            }
        }
    }

    #[test]
    fn cost_is_half_the_squares_over_phi() {
        let samples = Samples::new(13, 11);
        let slice = samples.slice(Loss::L2);
        let lobes = [Lobe { kappa: 1.2, gamma: 9.0, beta: 0.5 }, Lobe { kappa: 0.2, gamma: 0.4, beta: -0.3 }];
        let brute = |azimuthal: bool| -> f64 {
            let part = |i: usize, c: f64| -> f64 {
                let beta = |lobe: &Lobe| if azimuthal { lobe.beta } else { 0.0 };
                let value = |l: &Lobe| l.value(samples.ln_cos[i]) * (1.0 + beta(l) * samples.factor[i] * c);
                lobes.iter().map(value).sum()
            };
            let row = |i: usize| -> f64 {
                let pairs = samples.values[i].iter().zip(&samples.cos_2phi);
                pairs.filter_map(|(f, &c)| f.map(|f| (f - part(i, c)).powi(2))).sum()
            };
            (0..13).map(row).sum()
        };
        let nothing = Stop { max_iterations: 0, cost: 0.0, floor: 0.0, energy: 0.0 };
        for (azimuthal, floor) in [(false, slice.bivariate_floor()), (true, slice.floor)] {
            let (kept, minimum) = Mixture::new(&slice, 2, azimuthal).fit(&lobes, nothing);
            let squares = brute(azimuthal);
            assert!(((2.0 * minimum.cost + floor) / squares - 1.0).abs() < 1e-12);
            assert!((kept[0].kappa / 1.2 - 1.0).abs() < 1e-14);
        }
    }
}
