//! Half and difference angles of many pairs of directions.

use rayon::prelude::*;

/// Directions handled together, so that loops over them run in vector instructions.
pub const BLOCK: usize = 64;
/// Directions given to a thread at a time.
pub const CHUNK: usize = 64 * BLOCK;

/// What an isotropic reflectance depends on, for up to [`BLOCK`] pairs of directions.
///
/// With `p = sin(theta_h) sin(theta_d)` and `q = cos(theta_h) cos(theta_d)`, the azimuthal factor is
/// `p / sqrt(p^2 + (c q)^2)`. Each expression is symmetric in the two directions to the last bit.
pub struct Coordinates {
    /// `sin(theta_h)^2`.
    pub sin2: [f64; BLOCK],
    /// Squared lengths of the sum and the difference: `4 cos(theta_d)^2` and `4 sin(theta_d)^2`.
    pub s2: [f64; BLOCK],
    pub d2: [f64; BLOCK],
    /// Azimuthal factor times cos(2 phi_d).
    pub azimuth: [f64; BLOCK],
}

impl Coordinates {
    /// Of `wi` and `wo` (direction, xyz), [`BLOCK`] at most.
    #[must_use]
    pub fn of(azimuthal_width: f64, wi: &[f64], wo: &[f64]) -> Self {
        let mut s = [[0.0; BLOCK]; 3];
        let mut d = [[0.0; BLOCK]; 3];
        for (j, (wi, wo)) in wi.chunks_exact(3).zip(wo.chunks_exact(3)).enumerate() {
            for axis in 0..3 {
                s[axis][j] = wi[axis] + wo[axis];
                d[axis][j] = wi[axis] - wo[axis];
            }
        }
        let zero = [0.0; BLOCK];
        let mut at = Self { sin2: zero, s2: zero, d2: zero, azimuth: zero };
        at.set(azimuthal_width, &s, &d);
        at
    }

    fn set(&mut self, azimuthal_width: f64, s: &[[f64; BLOCK]; 3], d: &[[f64; BLOCK]; 3]) {
        angles(azimuthal_width, s, d, &mut self.sin2, [&mut self.s2, &mut self.d2], &mut self.azimuth);
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl", "x86_64+avx2"))]
fn angles(
    azimuthal_width: f64,
    s: &[[f64; BLOCK]; 3],
    d: &[[f64; BLOCK]; 3],
    sin2: &mut [f64; BLOCK],
    [squared_sum, squared_difference]: [&mut [f64; BLOCK]; 2],
    azimuth: &mut [f64; BLOCK],
) {
    for j in 0..BLOCK {
        let rho2 = s[0][j] * s[0][j] + s[1][j] * s[1][j];
        let s2 = rho2 + s[2][j] * s[2][j];
        sin2[j] = if s2 > 0.0 { rho2 / s2 } else { 1.0 };
        squared_sum[j] = s2;
        squared_difference[j] = d[0][j] * d[0][j] + d[1][j] * d[1][j] + d[2][j] * d[2][j];

        // cos(phi_d) : sin(phi_d) = d_z |s| : (d cross s)_z, and the sum of their squares is (2 p |s|)^2
        let along2 = d[2][j] * d[2][j] * s2;
        let cross = d[1][j] * s[0][j] - d[0][j] * s[1][j];
        let across2 = cross * cross;
        let both = along2 + across2;
        let c_q = azimuthal_width * s[2][j];
        let product = both * (both + c_q * c_q * s2);
        azimuth[j] = if product > 0.0 { (along2 - across2) / product.sqrt() } else { 0.0 };
    }
}

/// Index of the first direction whose length differs from 1 by more than `tolerance`.
#[must_use]
pub fn first_not_unit(directions: &[f64], tolerance: f64) -> Option<usize> {
    let off = |w: &[f64]| {
        let length = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
        (length - 1.0).abs() > tolerance || length.is_nan()
    };
    directions.par_chunks_exact(3).with_min_len(CHUNK).position_first(off)
}
