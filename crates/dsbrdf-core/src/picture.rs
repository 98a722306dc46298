//! A picture as a linear function of the reflectance: how much each node of (theta_h, theta_d, azimuth) counts in a pixel.
//!
//! A pixel is the mean over points with a normal and a direction toward the camera; a point sees lights
//! `sum_l flux_l f(l, v) cos_l`. Values between nodes are cubic in `(1 - cos(theta_h))^(1/4)`, about the root of theta_h, and in
//! `(1 - cos(theta_d))^(1/2)`, about theta_d, and quadratic in the azimuthal factor times cos(2 phi_d), so that f stands in the sum
//! as its values at the nodes.

use std::ops::Range;

use rayon::prelude::*;

/// Azimuths of a node: the zeros of a Chebyshev polynomial.
pub const AZIMUTHS: [f64; 3] = [-0.866_025_403_784_438_6, 0.0, 0.866_025_403_784_438_6];
/// A light is taken apart where half its width, radians, exceeds `SPREAD u + LEAST`, with u the coordinate of theta_h.
const SPREAD: f64 = 0.095;
const LEAST: f64 = 0.003;
/// The same where it crosses the horizon.
const AT_HORIZON: f64 = 0.05;
/// Nodes that one value is made of, along theta_h and along theta_d.
const CUBIC: usize = 4;

/// Lights as trees: what a light holds is what its parts hold together.
pub struct Lights<'a> {
    pub n_channels: usize,
    /// (light, xyz), toward the light.
    pub direction: &'a [f64],
    /// (light, channel): irradiance on a surface that faces it.
    pub flux: &'a [f64],
    /// (light,): half its width in radians.
    pub radius: &'a [f64],
    /// (light, 4): indices of its parts; negative for none.
    pub parts: &'a [i32],
    /// The first so many lights are no part of another.
    pub n_roots: usize,
}

/// Points of pixels.
pub struct Points<'a> {
    /// (point, xyz).
    pub normal: &'a [f64],
    pub view: &'a [f64],
    /// (pixel + 1,): first point of each pixel, and the end.
    pub start: &'a [usize],
}

/// Nodes along theta_h and theta_d, even in their coordinates, both from 0 to 90 degrees.
#[derive(Clone, Copy)]
pub struct Nodes {
    pub n_h: usize,
    pub n_d: usize,
    pub azimuthal_width: f64,
}

impl Nodes {
    #[must_use]
    pub fn len(&self) -> usize {
        self.n_h * self.n_d * AZIMUTHS.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Weights (pixel, node, channel), nodes in the order (theta_h, theta_d, azimuth).
pub fn weights(points: &Points, lights: &Lights, nodes: Nodes, weights: &mut [f64]) {
    let width = lights.n_channels * nodes.len();
    weights
        .par_chunks_mut(width.max(1))
        .zip(points.start.par_windows(2))
        .for_each(|(row, ends)| of_pixel(points, ends[0]..ends[1], lights, nodes, row));
}

/// Weights (node, channel) of a pixel with some of the points.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn of_pixel(points: &Points, of: Range<usize>, lights: &Lights, nodes: Nodes, row: &mut [f64]) {
    row.fill(0.0);
    let share = 1.0 / of.len().max(1) as f64;
    let mut stack = Vec::new();
    let mut line = vec![0.0; CUBIC * AZIMUTHS.len() * lights.n_channels];
    for point in of {
        let vector = |from: &[f64]| [from[3 * point], from[3 * point + 1], from[3 * point + 2]];
        let frame = Frame { normal: vector(points.normal), view: vector(points.view) };
        stack.extend(0..lights.n_roots);
        while let Some(light) = stack.pop() {
            frame.add(light, share, lights, nodes, &mut stack, &mut line, row);
        }
    }
}

struct Frame {
    normal: [f64; 3],
    view: [f64; 3],
}

impl Frame {
    /// Adds a light, or puts its parts on the stack; `line` is room for its weights.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn add(
        &self,
        light: usize,
        share: f64,
        lights: &Lights,
        nodes: Nodes,
        stack: &mut Vec<usize>,
        line: &mut [f64],
        row: &mut [f64],
    ) {
        let toward = &lights.direction[3 * light..3 * light + 3];
        let (n, v) = (&self.normal, &self.view);
        let cos_i = dot(n, toward);
        let radius = lights.radius[light];
        if cos_i < -radius {
            return;
        }
        let s = [v[0] + toward[0], v[1] + toward[1], v[2] + toward[2]];
        let d = [toward[0] - v[0], toward[1] - v[1], toward[2] - v[2]];
        let s2 = dot(&s, &s);
        let d2 = dot(&d, &d);
        let (s_n, d_n) = (dot(&s, n), dot(&d, n));
        let length = s2.sqrt();
        // 1 - cos(theta_h), precise near the pole
        let from_pole = if length > 0.0 { rho2(&s, n) / (length * (length + s_n.max(0.0))) } else { 1.0 };
        let u = from_pole.min(1.0).sqrt().sqrt();
        let mut most = SPREAD * u + LEAST;
        if cos_i < radius {
            most = most.min(AT_HORIZON);
        }
        if radius > most {
            let before = stack.len();
            let parts = &lights.parts[4 * light..4 * light + 4];
            stack.extend(parts.iter().filter_map(|&part| usize::try_from(part).ok()));
            if stack.len() > before {
                return;
            }
        }
        if cos_i <= 0.0 {
            return;
        }
        // 1 - cos(theta_d) of |s| = 2 cos(theta_d), |d| = 2 sin(theta_d)
        let from_view = (0.25 * d2 / (1.0 + 0.5 * length)).min(1.0);
        // As `directions::Coordinates`: cos(phi_d) : sin(phi_d) = d_n |s| : (d cross s)_n
        let along2 = d_n * d_n * s2;
        let cross = [d[1] * s[2] - d[2] * s[1], d[2] * s[0] - d[0] * s[2], d[0] * s[1] - d[1] * s[0]];
        let across = dot(&cross, n);
        let across2 = across * across;
        let both = along2 + across2;
        let c_q = nodes.azimuthal_width * s_n;
        let product = both * (both + c_q * c_q * s2);
        let azimuth = if product > 0.0 { (along2 - across2) / product.sqrt() } else { 0.0 };

        let (h, of_h) = cubic(u, nodes.n_h);
        let (first_d, of_d) = cubic(from_view.sqrt(), nodes.n_d);
        let of_a = quadratic(azimuth);
        let (n_a, n_channels) = (AZIMUTHS.len(), lights.n_channels);
        let flux = &lights.flux[light * n_channels..(light + 1) * n_channels];
        let width = CUBIC * n_a * n_channels;
        let line = &mut line[..width];
        let mut k = 0;
        for of_d in of_d {
            for of_a in of_a {
                for flux in flux {
                    line[k] = share * cos_i * of_d * of_a * flux;
                    k += 1;
                }
            }
        }
        for (i, of_h) in of_h.iter().enumerate() {
            let at = ((h + i) * nodes.n_d + first_d) * n_a * n_channels;
            for (sum, value) in row[at..at + width].iter_mut().zip(line.iter()) {
                *sum += value * of_h;
            }
        }
    }
}

/// Squared length of the part of s across n, not from a difference of squares.
#[inline(always)]
fn rho2(s: &[f64], n: &[f64]) -> f64 {
    let along = dot(s, n);
    let across = [s[0] - along * n[0], s[1] - along * n[1], s[2] - along * n[2]];
    dot(&across, &across)
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// First of four even nodes from 0 to 1 around `at`, and their weights.
#[inline(always)]
fn cubic(at: f64, n: usize) -> (usize, [f64; CUBIC]) {
    let at = at.clamp(0.0, 1.0) * (n - 1) as f64;
    let first = (at as usize).saturating_sub(1).min(n - CUBIC);
    let u = at - first as f64;
    let [a, b, c, d] = [u, u - 1.0, u - 2.0, u - 3.0];
    (first, [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0])
}

/// Weights of `AZIMUTHS`.
#[inline(always)]
fn quadratic(a: f64) -> [f64; 3] {
    let e = AZIMUTHS[2];
    let square = a * a / (e * e);
    let line = a / e;
    [0.5 * (square - line), 1.0 - square, 0.5 * (square + line)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODES: Nodes = Nodes { n_h: 12, n_d: 7, azimuthal_width: 0.01 };

    #[test]
    fn weights_interpolate() {
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            let (first, w) = cubic(x, 9);
            let value = |power: i32| -> f64 {
                (0..CUBIC).map(|j| w[j] * ((first + j) as f64 / 8.0).powi(power)).sum()
            };
            for power in 0..=3 {
                assert!((value(power) - x.powi(power)).abs() < 1e-13);
            }
            let w = quadratic(2.0 * x - 1.0);
            let value: f64 = AZIMUTHS.iter().zip(w).map(|(a, w)| w * (1.0 + a + a * a)).sum();
            let a = 2.0 * x - 1.0;
            assert!((value - (1.0 + a + a * a)).abs() < 1e-13);
        }
    }

    #[test]
    fn one_light_counts_by_its_cosine() {
        let lights = Lights {
            n_channels: 2,
            direction: &[0.6, 0.0, 0.8],
            flux: &[2.0, 3.0],
            radius: &[0.0],
            parts: &[-1; 4],
            n_roots: 1,
        };
        let points = Points { normal: &[0.0, 0.0, 1.0], view: &[0.0, 0.0, 1.0], start: &[0, 1] };
        let mut row = vec![f64::NAN; 2 * NODES.len()];
        weights(&points, &lights, NODES, &mut row);
        let sums: Vec<f64> = (0..2).map(|c| row.iter().skip(c).step_by(2).sum()).collect();
        assert!((sums[0] - 1.6).abs() < 1e-12 && (sums[1] - 2.4).abs() < 1e-12, "{sums:?}");
    }

    #[test]
    fn parts_stand_for_a_light_near_its_highlight_only() {
        // The light is turned away from its parts, which tells which was taken
        let lights = Lights {
            n_channels: 1,
            direction: &[0.0, 0.0, 1.0, 0.6, 0.0, 0.8, 0.6, 0.0, 0.8],
            flux: &[2.0, 1.0, 1.0],
            radius: &[0.04, 0.0, 0.0],
            parts: &[1, 2, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1],
            n_roots: 1,
        };
        let sum = |view: [f64; 3]| -> f64 {
            let points = Points { normal: &[0.0, 0.0, 1.0], view: &view, start: &[0, 1] };
            let mut row = vec![0.0; NODES.len()];
            weights(&points, &lights, NODES, &mut row);
            row.iter().sum()
        };
        assert!((sum([0.0, 0.0, 1.0]) - 1.6).abs() < 1e-12);
        assert!((sum([0.8, 0.0, 0.6]) - 2.0).abs() < 1e-12);
    }
}
