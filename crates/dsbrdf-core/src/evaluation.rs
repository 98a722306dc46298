//! Values of lobes with curves over cos(theta_d) at many pairs of directions.
//!
//! `f_c = sum_k expm1(kappa_kc(x) cos(theta_h)^gamma_k(x)) cos(theta_h)^falloff_k exp(beta_k(x) g cos 2 phi_d)`.

use rayon::prelude::*;

use crate::basis::Basis;
use crate::directions::{BLOCK, CHUNK, Coordinates};
use crate::exp::{exp, expm1, ln};

/// Polynomials of curves in the place within a span, (curve, span).
struct Curves {
    spans: usize,
    parts: Vec<[f64; 3]>,
}

impl Curves {
    /// From coefficients (curve, coefficient).
    fn new(coefficients: &[f64], size: usize) -> Self {
        let basis = Basis { size };
        let parts = coefficients.chunks_exact(size.max(1)).flat_map(|c| basis.polynomials(c)).collect();
        Self { spans: basis.spans(), parts }
    }

    /// Span and place of each x.
    fn places(&self, x: &[f64; BLOCK]) -> Places {
        let mut places = Places { span: [0; BLOCK], u: *x };
        if self.spans > 1 {
            let n = self.spans as f64;
            for j in 0..BLOCK {
                let at = x[j] * n;
                let span = at.min(n - 1.0) as usize;
                places.span[j] = span;
                places.u[j] = at - span as f64;
            }
        }
        places
    }

    /// Adds a curve's values to `out`.
    #[inline(always)]
    fn add(&self, curve: usize, places: &Places, out: &mut [f64; BLOCK]) {
        let parts = &self.parts[curve * self.spans..(curve + 1) * self.spans];
        if let [[a, b, c]] = parts {
            for j in 0..BLOCK {
                let u = places.u[j];
                out[j] += c.mul_add(u, *b).mul_add(u, *a);
            }
            return;
        }
        for j in 0..BLOCK {
            let [a, b, c] = parts[places.span[j]];
            let u = places.u[j];
            out[j] += c.mul_add(u, b).mul_add(u, a);
        }
    }
}

struct Places {
    span: [usize; BLOCK],
    u: [f64; BLOCK],
}

/// Coefficients of curves: (lobe, coefficient) each, and (channel, lobe, coefficient) of the colour.
pub struct Given<'a> {
    pub n_lobes: usize,
    pub n_channels: usize,
    /// Coefficients of `ln kappa` common to the channels, of `ln gamma`, of beta, of the falloff.
    pub scale: &'a [f64],
    pub gamma: &'a [f64],
    pub beta: &'a [f64],
    pub falloff: &'a [f64],
    /// What a channel adds to `ln kappa`.
    pub colour: &'a [f64],
    /// The constant c of the azimuthal factor, see [`Coordinates`].
    pub azimuthal_width: f64,
}

/// Lobes, ready to be evaluated.
pub struct Lobes {
    n_lobes: usize,
    n_channels: usize,
    scale: Curves,
    gamma: Curves,
    beta: Curves,
    falloff: Curves,
    colour: Curves,
    azimuthal_width: f64,
}

/// Greatest exponent of `ln kappa` and of a lobe's factor: the result stays a number.
const MAX_LN_KAPPA: f64 = 6.5;
const MAX_FACTOR: f64 = 300.0;

impl Lobes {
    #[must_use]
    pub fn new(given: &Given) -> Self {
        let curves = |c: &[f64], n: usize| Curves::new(c, c.len() / n.max(1));
        let n = given.n_lobes;
        Self {
            n_lobes: n,
            n_channels: given.n_channels,
            scale: curves(given.scale, n),
            gamma: curves(given.gamma, n),
            beta: curves(given.beta, n),
            falloff: curves(given.falloff, n),
            colour: curves(given.colour, n * given.n_channels),
            azimuthal_width: given.azimuthal_width,
        }
    }

    /// Values (direction, channel) for `wi` and `wo` (direction, xyz); zero where either is below the horizon.
    pub fn eval(&self, wi: &[f64], wo: &[f64], values: &mut [f64]) {
        values
            .par_chunks_mut(CHUNK * self.n_channels)
            .zip(wi.par_chunks(CHUNK * 3))
            .zip(wo.par_chunks(CHUNK * 3))
            .for_each(|((values, wi), wo)| {
                let mut sums = vec![0.0; BLOCK * self.n_channels];
                let blocks = values
                    .chunks_mut(BLOCK * self.n_channels)
                    .zip(wi.chunks(BLOCK * 3))
                    .zip(wo.chunks(BLOCK * 3));
                for ((values, wi), wo) in blocks {
                    sums.fill(0.0);
                    sum_lobes(self, &Coordinates::of(self.azimuthal_width, wi, wo), &mut sums);
                    for (j, values) in values.chunks_exact_mut(self.n_channels).enumerate() {
                        let above = wi[3 * j + 2] >= 0.0 && wo[3 * j + 2] >= 0.0;
                        for (channel, value) in values.iter_mut().enumerate() {
                            *value = if above { sums[channel * BLOCK + j] } else { 0.0 };
                        }
                    }
                }
            });
    }
}

/// Adds the values (channel, direction) of all lobes.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn sum_lobes(lobes: &Lobes, at: &Coordinates, sums: &mut [f64]) {
    let mut x = [0.0; BLOCK];
    let mut ln_cos = [0.0; BLOCK];
    for j in 0..BLOCK {
        x[j] = (0.5 * at.s2[j].sqrt()).min(1.0);
        // With the half vector on the horizon, the logarithm stays finite
        let y = at.sin2[j].min(1.0 - 0.5 * f64::EPSILON);
        // ln(1 - y), precise for small y
        let u = 1.0 - y;
        let gap = 1.0 - u;
        ln_cos[j] = 0.5 * if gap > 0.0 { ln(u) * (y / gap) } else { -y };
    }
    let [scale_at, gamma_at, beta_at, falloff_at, colour_at] =
        [&lobes.scale, &lobes.gamma, &lobes.beta, &lobes.falloff, &lobes.colour].map(|c| c.places(&x));
    for k in 0..lobes.n_lobes {
        let mut gamma = [0.0; BLOCK];
        let mut power = [0.0; BLOCK];
        let mut beta = [0.0; BLOCK];
        let mut factor = [0.0; BLOCK];
        lobes.gamma.add(k, &gamma_at, &mut gamma);
        lobes.scale.add(k, &scale_at, &mut power);
        lobes.beta.add(k, &beta_at, &mut beta);
        lobes.falloff.add(k, &falloff_at, &mut factor);
        for j in 0..BLOCK {
            power[j] = exp(gamma[j]).mul_add(ln_cos[j], power[j]);
            factor[j] = exp(beta[j].mul_add(at.azimuth[j], factor[j] * ln_cos[j]).min(MAX_FACTOR));
        }
        for channel in 0..lobes.n_channels {
            let mut ln_kappa = power;
            lobes.colour.add(channel * lobes.n_lobes + k, &colour_at, &mut ln_kappa);
            let sum = &mut sums[channel * BLOCK..(channel + 1) * BLOCK];
            for j in 0..BLOCK {
                sum[j] += expm1(exp(ln_kappa[j].min(MAX_LN_KAPPA))) * factor[j];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f64 = 0.02;
    /// Two lobes, two channels.
    const SCALE: [f64; 8] = [0.4, -0.2, 0.3, 0.1, -1.6, -1.0, -2.0, -1.5];
    const GAMMA: [f64; 4] = [3.4, 3.0, -0.7, 0.2];
    const BETA: [f64; 6] = [0.4, -0.3, 0.1, 0.6, 0.0, -0.2];
    const FALLOFF: [f64; 2] = [0.5, -0.3];
    const COLOUR: [f64; 8] = [0.1, -0.2, 0.0, 0.3, -0.1, 0.2, 0.05, -0.3];

    fn evaluate(wi: [f64; 3], wo: [f64; 3]) -> [f64; 2] {
        let lobes = Lobes::new(&Given {
            n_lobes: 2,
            n_channels: 2,
            scale: &SCALE,
            gamma: &GAMMA,
            beta: &BETA,
            falloff: &FALLOFF,
            colour: &COLOUR,
            azimuthal_width: WIDTH,
        });
        let mut values = [f64::NAN; 2];
        lobes.eval(&wi, &wo, &mut values);
        values
    }

    /// Directions with these angles, half vector in the x-z plane.
    fn directions(h: f64, d: f64, phi: f64) -> ([f64; 3], [f64; 3]) {
        let (x, y) = (d.sin() * phi.cos(), d.sin() * phi.sin());
        let half = [h.sin() * d.cos(), 0.0, h.cos() * d.cos()];
        let across = [h.cos() * x, y, -h.sin() * x];
        let add = |sign: f64| [0, 1, 2].map(|axis: usize| half[axis] + sign * across[axis]);
        (add(1.0), add(-1.0))
    }

    fn formula(h: f64, d: f64, phi: f64, channel: usize) -> f64 {
        let (p, q) = (h.sin() * d.sin(), WIDTH * h.cos() * d.cos());
        let azimuth = p / p.hypot(q) * (2.0 * phi).cos();
        let curve =
            |all: &[f64], size: usize, at: usize| Basis { size }.value(&all[at * size..][..size], d.cos());
        (0..2)
            .map(|k| {
                let ln_kappa = curve(&SCALE, 4, k) + curve(&COLOUR, 2, channel * 2 + k);
                let power = h.cos().powf(curve(&GAMMA, 2, k).exp());
                (ln_kappa.exp() * power).exp_m1()
                    * h.cos().powf(FALLOFF[k])
                    * (curve(&BETA, 3, k) * azimuth).exp()
            })
            .sum()
    }

    #[test]
    fn equals_the_formula_and_is_reciprocal() {
        for i in 0..800 {
            let unit = |k: u32| (f64::from(i * k + 7) * 0.618_033_988_749_894_9).fract();
            let (h, d, phi) = (0.01 + 0.7 * unit(1).powi(2), 0.01 + 0.7 * unit(3), 6.2 * unit(5));
            let (wi, wo) = directions(h, d, phi);
            let value = evaluate(wi, wo);
            for channel in 0..2 {
                assert!((value[channel] / formula(h, d, phi, channel) - 1.0).abs() < 1e-12, "{h} {d} {phi}");
                assert_eq!(value[channel].to_bits(), evaluate(wo, wi)[channel].to_bits());
            }
        }
    }

    #[test]
    fn black_below_the_horizon() {
        let (wi, wo) = directions(1.0, 0.8, 0.0);
        assert!(wi[2] < 0.0 && wo[2] > 0.0);
        assert_eq!((evaluate(wi, wo), evaluate(wo, wi)), ([0.0; 2], [0.0; 2]));
    }

    #[test]
    fn finite_at_the_ends() {
        for (wi, wo) in [
            ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
            ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ] {
            assert!(evaluate(wi, wo).iter().all(|v| v.is_finite() && *v >= 0.0));
        }
    }
}
