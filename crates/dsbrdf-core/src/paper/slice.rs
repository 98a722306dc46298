//! One theta_d slice of one channel, ready for least squares.

use crate::paper::mixture::MAX_HEIGHT;
use crate::profile::{COUNT, MOMENTS, SUM_C, SUM_CC, SUM_F, SUM_FC, SUM_FF};

/// Rows are padded to a multiple of this with weight zero, so that inner loops have no remainder.
pub const LANES: usize = 8;

/// What is minimised over the samples of a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Sum of squared differences (the paper).
    L2,
    /// Squared difference of `ln(f + offset)` of the mean over phi_d; relative squares for the rest.
    Log { offset: f64 },
}

/// A slice as two residual rows a theta_h, which together are the exact sum of squares over phi_d less `floor`.
///
/// With `a` the sum of lobes and `b` its azimuthal amplitude, the model is `a + b g cos(2 phi_d)` and
/// `sum_phi (f - model)^2 = w_a^2 (a + skew b - mean)^2 + (w_b b - y_b)^2 + floor`.
pub struct Slice {
    pub loss: Loss,
    /// Number of theta_h before padding.
    pub len: usize,
    pub ln_cos: Vec<f64>,
    pub w_a: Vec<f64>,
    pub skew: Vec<f64>,
    pub mean: Vec<f64>,
    pub w_b: Vec<f64>,
    pub y_b: Vec<f64>,
    /// What no model of the form `a(theta_h) + b(theta_h) cos(2 phi_d)` can go below.
    pub floor: f64,
    /// Sum of squares of the samples (for relative errors and stopping).
    pub energy: f64,
    /// What no lobe may be higher than.
    pub max_height: f64,
}

impl Slice {
    /// From moments (theta_h, [`MOMENTS`]) at `ln_cos`, with `factor` the g of the azimuthal term.
    ///
    /// Rows without samples are left out.
    #[must_use]
    pub fn new(moments: &[f64], ln_cos: &[f64], factor: &[f64], loss: Loss) -> Self {
        let mut slice = Self {
            loss,
            len: 0,
            ln_cos: Vec::new(),
            w_a: Vec::new(),
            skew: Vec::new(),
            mean: Vec::new(),
            w_b: Vec::new(),
            y_b: Vec::new(),
            floor: 0.0,
            energy: 0.0,
            max_height: 0.0,
        };
        for ((m, &ln_cos), &g) in moments.chunks_exact(MOMENTS).zip(ln_cos).zip(factor) {
            if m[COUNT] > 0.0 {
                slice.push(m, ln_cos, g);
            }
        }
        slice.len = slice.ln_cos.len();
        slice.max_height = MAX_HEIGHT * slice.mean.iter().fold(0.0, |x: f64, &y| x.max(y));
        let padded = slice.len.next_multiple_of(LANES);
        for row in [
            &mut slice.ln_cos,
            &mut slice.w_a,
            &mut slice.skew,
            &mut slice.mean,
            &mut slice.w_b,
            &mut slice.y_b,
        ] {
            row.resize(padded, 0.0);
        }
        slice
    }

    fn push(&mut self, m: &[f64], ln_cos: f64, g: f64) {
        let n = m[COUNT];
        let (mean, mean_c) = (m[SUM_F] / n, m[SUM_C] / n);
        // Sums of squares about the mean; rounding can leave them slightly negative
        let var_f = (m[SUM_FF] - mean * m[SUM_F]).max(0.0);
        let var_c = (m[SUM_CC] - mean_c * m[SUM_C]).max(0.0);
        let cov = m[SUM_FC] - mean * m[SUM_C];
        let along = if var_c > 1e-12 * n { cov / var_c.sqrt() } else { 0.0 };
        // The logarithmic loss is relative: it divides what is not in the mean by the mean
        let unit = match self.loss {
            Loss::L2 => 1.0,
            Loss::Log { offset } => 1.0 / (mean + offset),
        };
        self.ln_cos.push(ln_cos);
        self.w_a.push(n.sqrt());
        self.skew.push(mean_c * g);
        self.mean.push(mean);
        self.w_b.push(if var_c > 1e-12 * n { g * var_c.sqrt() * unit } else { 0.0 });
        self.y_b.push(along * unit);
        self.floor += (var_f - along * along).max(0.0) * unit * unit;
        self.energy += m[SUM_FF] * unit * unit;
    }

    /// Number of residual rows that hold anything: samples of one phi_d tell nothing of its cosine alone.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.len + self.w_b.iter().filter(|&&w| w > 0.0).count()
    }

    /// The sum of squares over phi_d that no model of theta_h alone can go below (same loss).
    #[must_use]
    pub fn bivariate_floor(&self) -> f64 {
        self.floor + self.y_b.iter().map(|y| y * y).sum::<f64>()
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Samples (theta_h, phi_d) of two azimuthal lobes with a ripple that no lobe can follow, some of them invalid.
    pub struct Samples {
        pub ln_cos: Vec<f64>,
        pub factor: Vec<f64>,
        pub cos_2phi: Vec<f64>,
        pub values: Vec<Vec<Option<f64>>>,
    }

    impl Samples {
        pub fn new(n_h: usize, n_phi: usize) -> Self {
            let theta = |i: usize| 1.5 * (i as f64 + 0.5) / n_h as f64;
            let cos_2phi: Vec<f64> =
                (0..n_phi).map(|j| (2.0 * (j as f64 + 0.3) / n_phi as f64 * 2.9).cos()).collect();
            let factor: Vec<f64> = (0..n_h).map(|i| (3.0 * theta(i)).min(1.0)).collect();
            let ln_cos: Vec<f64> = (0..n_h).map(|i| theta(i).cos().ln()).collect();
            let value = |i: usize, j: usize| {
                let c = factor[i] * cos_2phi[j];
                let narrow = (1.4 * (20.0 * ln_cos[i]).exp()).exp_m1() * (1.0 + 0.4 * c);
                let broad = (0.3 * ln_cos[i].exp()).exp_m1() * (1.0 - 0.2 * c);
                let ripple = 0.02 * (1.0 + (7 * i + 3 * j) as f64).sin();
                ((5 * i + j) % 7 > 1).then_some((narrow + broad + ripple).max(0.0))
            };
            let values = (0..n_h).map(|i| (0..n_phi).map(|j| value(i, j)).collect()).collect();
            Self { ln_cos, factor, cos_2phi, values }
        }

        /// Their moments (theta_h, moment).
        pub fn moments(&self) -> Vec<f64> {
            let row = |values: &Vec<Option<f64>>| {
                let mut sums = [0.0; MOMENTS];
                for (f, c) in values.iter().zip(&self.cos_2phi).filter_map(|(f, &c)| f.map(|f| (f, c))) {
                    for (sum, term) in sums.iter_mut().zip([1.0, f, f * f, c, c * c, f * c]) {
                        *sum += term;
                    }
                }
                sums
            };
            self.values.iter().flat_map(row).collect()
        }

        pub fn slice(&self, loss: Loss) -> Slice {
            Slice::new(&self.moments(), &self.ln_cos, &self.factor, loss)
        }
    }

    #[test]
    fn rows_hold_the_sum_of_squares_over_phi() {
        let samples = Samples::new(13, 11);
        let slice = samples.slice(Loss::L2);
        let a: Vec<f64> = (0..13).map(|i| 0.3 + (1.7 * i as f64).sin()).collect();
        let b: Vec<f64> = (0..13).map(|i| (2.3 * i as f64).cos()).collect();
        let (mut brute, mut energy, mut rows) = (0.0, 0.0, slice.floor);
        for i in 0..13 {
            for (f, c) in samples.values[i].iter().zip(&samples.cos_2phi) {
                let Some(f) = f else { continue };
                brute += (f - a[i] - b[i] * samples.factor[i] * c).powi(2);
                energy += f * f;
            }
            rows += (slice.w_a[i] * (a[i] + slice.skew[i] * b[i] - slice.mean[i])).powi(2);
            rows += (slice.w_b[i] * b[i] - slice.y_b[i]).powi(2);
        }
        assert!((rows / brute - 1.0).abs() < 1e-13, "{rows} {brute}");
        assert!((slice.energy / energy - 1.0).abs() < 1e-14);
    }

    #[test]
    fn rows_without_samples_are_left_out() {
        let mut samples = Samples::new(13, 11);
        let whole = samples.slice(Loss::L2);
        samples.values[4] = vec![None; 11];
        let slice = samples.slice(Loss::L2);
        assert_eq!((whole.len, slice.len), (13, 12));
        assert_eq!(slice.mean[4], whole.mean[5]);
        assert!(slice.ln_cos.len() % LANES == 0 && slice.w_a[slice.len..].iter().all(|&w| w == 0.0));
    }
}
