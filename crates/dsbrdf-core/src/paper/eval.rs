//! Values of a model at many pairs of directions: those of the two nearest slices, interpolated in theta_d.

use rayon::prelude::*;

use crate::directions::{BLOCK, CHUNK, Coordinates};
use crate::exp::{exp, expm1};

/// The numbers of a model, (theta_d, channel, lobe) flattened; theta_d ascending.
pub struct Model<'a> {
    pub theta_d: &'a [f64],
    pub n_channels: usize,
    pub n_lobes: usize,
    pub kappa: &'a [f64],
    pub gamma: &'a [f64],
    pub beta: &'a [f64],
    /// Heights (theta_d, channel) of the spikes.
    pub spike: &'a [f64],
    /// `sin(theta_h)^2` at which a spike ends.
    pub spike_sin2: f64,
    /// The constant c of the azimuthal factor, see [`Coordinates`].
    pub azimuthal_width: f64,
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

/// What the model depends on, for up to [`BLOCK`] pairs of directions.
struct Block {
    ln_cos: [f64; BLOCK],
    /// Shape of a spike at theta_h.
    cap: [f64; BLOCK],
    /// Azimuthal factor times cos(2 phi_d).
    azimuth: [f64; BLOCK],
    /// Slice at or below theta_d.
    slice: [usize; BLOCK],
    /// Weights of it and of the next; both zero below the horizon.
    weight: [[f64; BLOCK]; 2],
}

impl Default for Block {
    fn default() -> Self {
        Self {
            ln_cos: [0.0; BLOCK],
            cap: [0.0; BLOCK],
            azimuth: [0.0; BLOCK],
            slice: [0; BLOCK],
            weight: [[0.0; BLOCK]; 2],
        }
    }
}

impl Block {
    fn set(&mut self, model: &Model, wi: &[f64], wo: &[f64]) {
        let at = Coordinates::of(model.azimuthal_width, wi, wo);
        self.azimuth = at.azimuth;
        for (j, (wi, wo)) in wi.chunks_exact(3).zip(wo.chunks_exact(3)).enumerate() {
            // With the half vector on the horizon, the logarithm stays finite
            self.ln_cos[j] = 0.5 * (-at.sin2[j].min(1.0 - 0.5 * f64::EPSILON)).ln_1p();
            self.cap[j] = (1.0 - at.sin2[j] / model.spike_sin2).max(0.0);
            let above = if wi[2] >= 0.0 && wo[2] >= 0.0 { 1.0 } else { 0.0 };
            let (slice, next) = between(model.theta_d, (at.d2[j] / at.s2[j]).sqrt().atan());
            self.slice[j] = slice;
            self.weight[0][j] = above * (1.0 - next);
            self.weight[1][j] = above * next;
        }
    }

    fn add_spike(&self, model: &Model, channel: usize, sum: &mut [f64; BLOCK]) {
        let last = model.theta_d.len() - 1;
        for j in (0..BLOCK).filter(|&j| self.cap[j] > 0.0) {
            for step in 0..2 {
                let at = (self.slice[j] + step).min(last) * model.n_channels + channel;
                sum[j] += self.weight[step][j] * model.spike[at] * self.cap[j];
            }
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
            self.add_spike(model, channel, &mut sum);
            for (values, sum) in values.chunks_exact_mut(model.n_channels).zip(&sum) {
                values[channel] = *sum;
            }
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_lobe(block: &Block, model: &Model, lobe: usize, stride: usize, sum: &mut [f64; BLOCK]) {
    let last = model.theta_d.len() - 1;
    let mut kappa = [0.0; BLOCK];
    let mut gamma = [0.0; BLOCK];
    let mut beta = [0.0; BLOCK];
    for step in 0..2 {
        for j in 0..BLOCK {
            let at = (block.slice[j] + step).min(last) * stride + lobe;
            kappa[j] = model.kappa[at];
            gamma[j] = model.gamma[at];
            beta[j] = model.beta[at];
        }
        for j in 0..BLOCK {
            let value = expm1(kappa[j] * exp(gamma[j] * block.ln_cos[j]));
            sum[j] += block.weight[step][j] * value * (1.0 + beta[j] * block.azimuth[j]);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f64 = 0.02;
    /// (theta_d, channel, lobe) = (2, 1, 2).
    const KAPPA: [f64; 4] = [1.5, 0.2, 0.7, 0.4];
    const GAMMA: [f64; 4] = [30.0, 0.5, 12.0, 2.0];
    const BETA: [f64; 4] = [0.4, -0.3, 0.1, 0.6];
    const THETA_D: [f64; 2] = [0.3, 0.9];
    const SPIKE: [f64; 2] = [2.0, 5.0];
    const SPIKE_SIN2: f64 = 0.01;

    fn evaluate(wi: [f64; 3], wo: [f64; 3]) -> f64 {
        let model = Model {
            theta_d: &THETA_D,
            n_channels: 1,
            n_lobes: 2,
            kappa: &KAPPA,
            gamma: &GAMMA,
            beta: &BETA,
            spike: &SPIKE,
            spike_sin2: SPIKE_SIN2,
            azimuthal_width: WIDTH,
        };
        let mut value = [f64::NAN];
        model.eval(&wi, &wo, &mut value);
        value[0]
    }

    /// Directions with these angles, half vector in the x-z plane.
    fn directions(h: f64, d: f64, phi: f64) -> ([f64; 3], [f64; 3]) {
        let (x, y) = (d.sin() * phi.cos(), d.sin() * phi.sin());
        let half = [h.sin() * d.cos(), 0.0, h.cos() * d.cos()];
        let across = [h.cos() * x, y, -h.sin() * x];
        let add = |sign: f64| [0, 1, 2].map(|axis: usize| half[axis] + sign * across[axis]);
        (add(1.0), add(-1.0))
    }

    fn formula(h: f64, d: f64, phi: f64) -> f64 {
        let (p, q) = (h.sin() * d.sin(), WIDTH * h.cos() * d.cos());
        let azimuth = p / p.hypot(q) * (2.0 * phi).cos();
        let slice = |s: usize| -> f64 {
            let lobe = |k: usize| (KAPPA[k] * h.cos().powf(GAMMA[k])).exp_m1() * (1.0 + BETA[k] * azimuth);
            lobe(2 * s) + lobe(2 * s + 1) + SPIKE[s] * (1.0 - h.sin().powi(2) / SPIKE_SIN2).max(0.0)
        };
        let weight = ((d - THETA_D[0]) / (THETA_D[1] - THETA_D[0])).clamp(0.0, 1.0);
        (1.0 - weight) * slice(0) + weight * slice(1)
    }

    #[test]
    fn equals_the_formula_and_is_reciprocal() {
        for i in 0..800 {
            let unit = |k: u32| (f64::from(i * k + 7) * 0.618_033_988_749_894_9).fract();
            let (h, d, phi) = (0.01 + 0.7 * unit(1).powi(2), 0.01 + 0.7 * unit(3), 6.2 * unit(5));
            let (wi, wo) = directions(h, d, phi);
            let value = evaluate(wi, wo);
            assert!((value / formula(h, d, phi) - 1.0).abs() < 1e-12, "{h} {d} {phi}");
            assert_eq!(value.to_bits(), evaluate(wo, wi).to_bits());
        }
    }

    #[test]
    fn black_below_the_horizon() {
        let (wi, wo) = directions(1.0, 0.8, 0.0);
        assert!(wi[2] < 0.0 && wo[2] > 0.0);
        assert_eq!((evaluate(wi, wo), evaluate(wo, wi)), (0.0, 0.0));
    }
}
