//! Values of a model at many pairs of directions.

use rayon::prelude::*;

use crate::exp::{exp, expm1};

/// Directions handled together, so that the loops over lobes run in vector instructions.
const BLOCK: usize = 64;
/// Directions given to a thread at a time.
const CHUNK: usize = 64 * BLOCK;

/// The numbers of a model, (theta_d, channel, lobe) flattened; theta_d ascending.
pub struct Model<'a> {
    pub theta_d: &'a [f64],
    pub n_channels: usize,
    pub n_lobes: usize,
    pub kappa: &'a [f64],
    pub gamma: &'a [f64],
    pub beta: &'a [f64],
    /// The constant c of the azimuthal factor, see [`half_diff`].
    pub azimuthal_width: f64,
}

/// What the model depends on: ln cos(theta_h), theta_d, and the azimuthal factor times cos(2 phi_d).
///
/// With `p = sin(theta_h) sin(theta_d)` and `q = cos(theta_h) cos(theta_d)`, the factor is
/// `p / sqrt(p^2 + (c q)^2)`. Each expression is symmetric in the two directions to the last bit.
#[inline(always)]
#[must_use]
pub fn half_diff(wi: [f64; 3], wo: [f64; 3], azimuthal_width: f64) -> (f64, f64, f64) {
    let s = [wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]];
    let d = [wi[0] - wo[0], wi[1] - wo[1], wi[2] - wo[2]];
    let rho2 = s[0] * s[0] + s[1] * s[1];
    let s2 = rho2 + s[2] * s[2];
    let d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let theta_d = d2.sqrt().atan2(s2.sqrt());
    let sin2 = if s2 > 0.0 { rho2 / s2 } else { 1.0 };
    let ln_cos = 0.5 * (-sin2).ln_1p();

    // d along the meridian and across it, both times rho |s|
    let along2 = d[2] * d[2] * s2;
    let cross = d[1] * s[0] - d[0] * s[1];
    let across2 = cross * cross;
    let both = along2 + across2;
    // p^2 : q^2 = rho^2 |d|^2 : (s_z |s|)^2, and both = rho^2 |d|^2 / ... up to rounding
    let c_q = azimuthal_width * s[2];
    let c_q2 = c_q * c_q * s2;
    let azimuth = if both > 0.0 { (along2 - across2) / (both * (both + c_q2)).sqrt() } else { 0.0 };
    (ln_cos, theta_d, azimuth)
}

impl Model<'_> {
    /// Values (direction, channel) for `wi` and `wo` (direction, xyz); zero where either is below the horizon.
    pub fn eval(&self, wi: &[f64], wo: &[f64], values: &mut [f64]) {
        values
            .par_chunks_mut(CHUNK * self.n_channels)
            .zip(wi.par_chunks(CHUNK * 3))
            .zip(wo.par_chunks(CHUNK * 3))
            .for_each(|((values, wi), wo)| {
                let mut block = Block::default();
                let blocks = values
                    .chunks_mut(BLOCK * self.n_channels)
                    .zip(wi.chunks(BLOCK * 3))
                    .zip(wo.chunks(BLOCK * 3));
                for ((values, wi), wo) in blocks {
                    block.set(self, wi, wo);
                    block.sum_lobes(self, values);
                }
            });
    }
}

/// Coordinates of up to [`BLOCK`] directions.
struct Block {
    ln_cos: [f64; BLOCK],
    azimuth: [f64; BLOCK],
    above: [f64; BLOCK],
    /// Slice below theta_d, and the weight of the one above it.
    slice: [usize; BLOCK],
    weight: [f64; BLOCK],
}

impl Default for Block {
    fn default() -> Self {
        Self {
            ln_cos: [0.0; BLOCK],
            azimuth: [0.0; BLOCK],
            above: [0.0; BLOCK],
            slice: [0; BLOCK],
            weight: [0.0; BLOCK],
        }
    }
}

impl Block {
    fn set(&mut self, model: &Model, wi: &[f64], wo: &[f64]) {
        for (j, (wi, wo)) in wi.chunks_exact(3).zip(wo.chunks_exact(3)).enumerate() {
            let (ln_cos, theta_d, azimuth) =
                half_diff([wi[0], wi[1], wi[2]], [wo[0], wo[1], wo[2]], model.azimuthal_width);
            self.ln_cos[j] = ln_cos;
            self.azimuth[j] = azimuth;
            self.above[j] = if wi[2] >= 0.0 && wo[2] >= 0.0 { 1.0 } else { 0.0 };
            (self.slice[j], self.weight[j]) = between(model.theta_d, theta_d);
        }
    }

    fn sum_lobes(&self, model: &Model, values: &mut [f64]) {
        let mut sum = [0.0; BLOCK];
        let stride = model.n_channels * model.n_lobes;
        for channel in 0..model.n_channels {
            sum.fill(0.0);
            for k in 0..model.n_lobes {
                add_lobe(self, model, channel * model.n_lobes + k, stride, &mut sum);
            }
            for (values, sum) in values.chunks_exact_mut(model.n_channels).zip(&sum) {
                values[channel] = *sum;
            }
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_lobe(block: &Block, model: &Model, lobe: usize, stride: usize, sum: &mut [f64; BLOCK]) {
    let mut kappa = [0.0; BLOCK];
    let mut gamma = [0.0; BLOCK];
    let mut beta = [0.0; BLOCK];
    let last = model.theta_d.len() - 1;
    for j in 0..BLOCK {
        let low = block.slice[j] * stride + lobe;
        let high = (block.slice[j] + 1).min(last) * stride + lobe;
        let w = block.weight[j];
        let lerp = |x: &[f64]| x[low] + w * (x[high] - x[low]);
        kappa[j] = lerp(model.kappa);
        gamma[j] = lerp(model.gamma);
        beta[j] = lerp(model.beta);
    }
    for j in 0..BLOCK {
        let value = expm1(kappa[j] * exp(gamma[j] * block.ln_cos[j]));
        sum[j] += block.above[j] * value * (1.0 + beta[j] * block.azimuth[j]);
    }
}

/// Index of the node at or below `x` and the weight of the next; held constant outside the nodes.
fn between(nodes: &[f64], x: f64) -> (usize, f64) {
    let above = nodes.partition_point(|&node| node <= x);
    if above == 0 || nodes.len() < 2 {
        return (0, 0.0);
    }
    let low = (above - 1).min(nodes.len() - 2);
    let weight = (x - nodes[low]) / (nodes[low + 1] - nodes[low]);
    (low, weight.min(1.0))
}
