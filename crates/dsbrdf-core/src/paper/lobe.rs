//! One unnormalised hemi-EPD lobe, `expm1(kappa cos(theta_h)^gamma)` (Eq. 6), over many angles.

use crate::exp::{exp, expm1};

/// Parameters of a lobe in one slice of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Scale: the lobe's height is `expm1(kappa)`.
    pub kappa: f64,
    /// Shape: 0 is Lambertian, large is a spike.
    pub gamma: f64,
    /// Azimuthal term: the lobe is multiplied by `1 + beta g cos(2 phi_d)`.
    pub beta: f64,
}

/// What stands for a lobe where there is nothing to fit.
pub const ABSENT: Lobe = Lobe { kappa: 1e-12, gamma: 1.0, beta: 0.0 };

impl Lobe {
    /// Value at one angle, given `ln cos(theta_h)`, without the azimuthal term.
    #[must_use]
    pub fn value(&self, ln_cos: f64) -> f64 {
        expm1(self.kappa * exp(self.gamma * ln_cos))
    }
}

/// Values of a lobe at all `ln_cos`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub fn values(ln_cos: &[f64], kappa: f64, gamma: f64, value: &mut [f64]) {
    for (value, &ln_cos) in value.iter_mut().zip(ln_cos) {
        *value = expm1(kappa * exp(gamma * ln_cos));
    }
}

/// Values of a lobe and their derivatives with respect to `ln kappa`.
///
/// The derivative with respect to `ln gamma` is `slope * gamma * ln_cos`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub fn values_and_slopes(ln_cos: &[f64], kappa: f64, gamma: f64, value: &mut [f64], slope: &mut [f64]) {
    for ((value, slope), &ln_cos) in value.iter_mut().zip(slope.iter_mut()).zip(ln_cos) {
        let x = kappa * exp(gamma * ln_cos);
        *value = expm1(x);
        *slope = x * (*value + 1.0);
    }
}
