//! From a table of one measured BRDF to the moments over phi_d of its theta_d slices.
//!
//! The model depends on theta_h, theta_d and cos(2 phi_d) alone, so these sums hold all that a least-squares
//! fit of a slice can see.

use rayon::prelude::*;

/// Sums over the valid phi_d at one (theta_h, theta_d, channel), in this order.
pub const MOMENTS: usize = 6;
pub const COUNT: usize = 0;
pub const SUM_F: usize = 1;
pub const SUM_FF: usize = 2;
pub const SUM_C: usize = 3;
pub const SUM_CC: usize = 4;
pub const SUM_FC: usize = 5;

const LANES: usize = 4;
const BYTES: usize = size_of::<f64>();

/// A table in the byte order of a MERL file: little-endian float64 (channel, theta_h, theta_d, phi_d).
pub struct Table<'a> {
    pub bytes: &'a [u8],
    pub shape: [usize; 4],
    /// Factor from stored numbers to 1/sr, per channel.
    pub scale: &'a [f64],
    /// cos(2 phi_d) of each phi_d.
    pub cos_2phi: &'a [f64],
}

impl Table<'_> {
    /// Moments (slice, channel, theta_h, moment) of the theta_d rows `theta_d`.
    ///
    /// # Panics
    /// If the lengths disagree with `shape` or an index is out of range.
    pub fn collapse(&self, theta_d: &[usize]) -> Vec<f64> {
        let [channels, n_h, n_d, n_phi] = self.shape;
        assert_eq!(self.bytes.len(), channels * n_h * n_d * n_phi * BYTES);
        assert_eq!(self.scale.len(), channels);
        assert_eq!(self.cos_2phi.len(), n_phi);
        assert!(theta_d.iter().all(|&d| d < n_d));

        let mut moments = vec![0.0; theta_d.len() * channels * n_h * MOMENTS];
        // One task a (slice, channel): its output is contiguous
        moments.par_chunks_mut((n_h * MOMENTS).max(1)).enumerate().for_each(|(task, out)| {
            let (slice, channel) = (task / channels, task % channels);
            for (h, out) in out.chunks_exact_mut(MOMENTS).enumerate() {
                let row = ((channel * n_h + h) * n_d + theta_d[slice]) * n_phi * BYTES;
                let bytes = &self.bytes[row..row + n_phi * BYTES];
                out.copy_from_slice(&row_moments(bytes, self.cos_2phi, self.scale[channel]));
            }
        });
        moments
    }
}

/// Moments of one row of phi_d; an entry is valid when it is finite and not negative.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn row_moments(bytes: &[u8], cos_2phi: &[f64], scale: f64) -> [f64; MOMENTS] {
    let mut sums = [[0.0_f64; LANES]; MOMENTS];
    let mut add = |lane: usize, raw: f64, c: f64| {
        let valid = (0.0..f64::INFINITY).contains(&raw);
        let (f, one) = if valid { (raw * scale, 1.0) } else { (0.0, 0.0) };
        let c = c * one;
        for (sum, term) in sums.iter_mut().zip([one, f, f * f, c, c * c, f * c]) {
            sum[lane] += term;
        }
    };
    let rows = bytes.chunks_exact(LANES * BYTES);
    let rest = rows.remainder();
    for (row, cos) in rows.zip(cos_2phi.chunks_exact(LANES)) {
        for lane in 0..LANES {
            add(lane, number(&row[lane * BYTES..]), cos[lane]);
        }
    }
    let done = bytes.len() / BYTES - rest.len() / BYTES;
    for (lane, raw) in rest.chunks_exact(BYTES).enumerate() {
        add(lane, number(raw), cos_2phi[done + lane]);
    }
    sums.map(|lanes| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]))
}

#[inline(always)]
fn number(bytes: &[u8]) -> f64 {
    f64::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3], bytes[4], bytes[5], bytes[6], bytes[7]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_entries_leave_no_trace() {
        let values = [1.0, -1.0, f64::NAN, 3.0, f64::INFINITY, 0.0, 2.0];
        let cos: Vec<f64> = (0..7).map(|i| f64::from(i).cos()).collect();
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let table = Table { bytes: &bytes, shape: [1, 1, 1, 7], scale: &[2.0], cos_2phi: &cos };
        let got = table.collapse(&[0]);
        let kept = [0, 3, 5, 6];
        let sum = |term: &dyn Fn(f64, f64) -> f64| -> f64 {
            kept.iter().map(|&i| term(2.0 * values[i], cos[i])).sum()
        };
        let want =
            [4.0, sum(&|f, _| f), sum(&|f, _| f * f), sum(&|_, c| c), sum(&|_, c| c * c), sum(&|f, c| f * c)];
        for (got, want) in got.iter().zip(want) {
            assert!((got - want).abs() < 1e-14, "{got} {want}");
        }
    }
}
