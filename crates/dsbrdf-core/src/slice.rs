//! One theta_d slice of one channel, ready for least squares.

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
        };
        for ((m, &ln_cos), &g) in moments.chunks_exact(MOMENTS).zip(ln_cos).zip(factor) {
            if m[COUNT] > 0.0 {
                slice.push(m, ln_cos, g);
            }
        }
        slice.len = slice.ln_cos.len();
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

    /// The sum of squares over phi_d that no model of theta_h alone can go below (same loss).
    #[must_use]
    pub fn bivariate_floor(&self) -> f64 {
        self.floor + self.y_b.iter().map(|y| y * y).sum::<f64>()
    }
}
