//! Fits of many materials that were measured at the same directions, as the texels of a texture are.
//!
//! Each texel is the most probable material given a Gaussian prior, by the least squares of [`crate::estimator`]; the
//! noise is part of the cost. What does not depend on the values is done once for all: coordinates, the curves'
//! functions, and what the materials that a search may start from look like at these directions.

use rayon::prelude::*;

use crate::arrow::Arrow;
use crate::estimator::{FALLOFF_RANGE, LN_GAMMA, LN_KAPPA, MAX_BETA, MAX_COLOUR, Prior, dot, dot_lanes};
use crate::exp::{exp, expm1, ln};
use crate::levenberg_marquardt::{LeastSquares, Stop, minimise};
use crate::shape::{BETA, COLOUR, CURVES, FALLOFF, GAMMA, SCALE, SHARED, Shape};

/// Mean squares below this are rounding, or less than any instrument's noise.
const LEAST_SQUARES: f64 = 1e-8;
/// Least `ln kappa` that is told from nothing.
const DARK: f64 = -100.0;
/// Positions whose derivatives are in memory at a time.
const BLOCK: usize = 128;
/// Decrease of the cost that ends a search, see [`Stop`].
const TOLERANCE: f64 = 3e-3;

/// Coordinates of pairs of directions, (position,).
pub struct Coordinates<'a> {
    pub ln_cos: &'a [f64],
    pub x: &'a [f64],
    pub azimuth: &'a [f64],
}

/// Positions, and what the curves are made of there.
pub struct Positions {
    n: usize,
    ln_cos: Vec<f64>,
    azimuth: Vec<f64>,
    /// (function, position) of each curve.
    functions: [Vec<f64>; CURVES],
}

impl Positions {
    #[must_use]
    pub fn new(at: &Coordinates, shape: &Shape) -> Self {
        let n = at.x.len();
        let functions = std::array::from_fn(|curve| {
            let basis = shape.basis(curve);
            let mut values = vec![0.0; basis.size * n];
            for (i, &x) in at.x.iter().enumerate() {
                let (first, b) = basis.at(x);
                for (m, b) in b.into_iter().enumerate().take(basis.size) {
                    values[(first + m) * n + i] = b;
                }
            }
            values
        });
        Self { n, ln_cos: at.ln_cos.to_vec(), azimuth: at.azimuth.to_vec(), functions }
    }
}

/// How values become residuals and weights; see `dsbrdf.fitting.observations`.
pub struct Weighing {
    /// Of the logarithm, of the cube root, of the albedo and of the value.
    pub shares: [f64; 4],
    /// The offset of the logarithm in medians, and the quantile of noise below zero.
    pub offset: f64,
    pub quantile: f64,
    /// Most independent observations.
    pub n_effective: f64,
}

/// What is fitted, and how.
pub struct Plan {
    pub shape: Shape,
    pub positions: Positions,
    /// Position of each direction: values of the same one are averaged.
    pub cell: Vec<u32>,
    /// Product of the cosines of each position.
    pub cos_product: Vec<f64>,
    pub weighing: Weighing,
    pub prior: Prior,
    /// (start, unknown).
    starts: Vec<f64>,
    /// (start, channel, position): logarithm of the value.
    looks: Vec<f64>,
    /// Where the uncertainty is told.
    reference: Positions,
    pub iterations: usize,
}

/// A texel's fit.
#[derive(Clone, Copy, Debug)]
pub struct Quality {
    /// Weighted mean of squared residuals.
    pub squares: f64,
    /// RMS over the reference positions of the standard deviation of the logarithm, channels averaged.
    pub uncertainty: f64,
    pub iterations: u32,
}

impl Plan {
    /// `starts` are (start, unknown).
    #[must_use]
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        shape: Shape,
        positions: Positions,
        cell: Vec<u32>,
        cos_product: Vec<f64>,
        weighing: Weighing,
        prior: Prior,
        starts: Vec<f64>,
        reference: Positions,
        iterations: usize,
    ) -> Self {
        let mut looks =
            Vec::with_capacity(starts.len() / shape.n_unknowns() * shape.n_channels * positions.n);
        let mut lobes = Lobes::new(&shape, positions.n);
        let mut model = vec![0.0; positions.n];
        for start in starts.chunks_exact(shape.n_unknowns()) {
            lobes.evaluate(&shape, &positions, start);
            for channel in 0..shape.n_channels {
                lobes.sum(channel, &mut model);
                looks.extend(model.iter().map(|f| f.max(1e-30).ln()));
            }
        }
        Self { shape, positions, cell, cos_product, weighing, prior, starts, looks, reference, iterations }
    }

    /// Fits texels (texel, direction, channel): unknowns (texel, unknown), and how good they are. NaN is absent; a texel
    /// of nothing else is NaN.
    #[must_use]
    pub fn fit<T: Copy + Into<f64> + Sync>(&self, values: &[T]) -> (Vec<f64>, Vec<Quality>) {
        let (p, width) = (self.shape.n_unknowns(), self.cell.len() * self.shape.n_channels);
        let mut found = vec![f64::NAN; values.len() / width * p];
        let quality = found
            .par_chunks_exact_mut(p)
            .zip(values.par_chunks_exact(width))
            .map_init(|| Texel::new(self), |texel, (x, values)| texel.fit(values, x))
            .collect();
        (found, quality)
    }
}

/// Values (texel, position, channel) of unknowns (texel, unknown).
#[must_use]
pub fn evaluate(shape: &Shape, positions: &Positions, unknowns: &[f64]) -> Vec<f64> {
    let (n, channels) = (positions.n, shape.n_channels);
    let mut values = vec![0.0; unknowns.len() / shape.n_unknowns() * n * channels];
    values
        .par_chunks_exact_mut((n * channels).max(1))
        .zip(unknowns.par_chunks_exact(shape.n_unknowns()))
        .for_each_init(
            || (Lobes::new(shape, n), vec![0.0; n]),
            |(lobes, model), (values, x)| {
                lobes.evaluate(shape, positions, x);
                for channel in 0..channels {
                    lobes.sum(channel, model);
                    for (row, f) in values.chunks_exact_mut(channels).zip(model.iter()) {
                        row[channel] = *f;
                    }
                }
            },
        );
    values
}

/// Lobes at positions.
struct Lobes {
    n: usize,
    channels: usize,
    /// (lobe, position).
    exponent: Vec<f64>,
    factor: Vec<f64>,
    /// (lobe, channel, position): value, and derivative by `ln kappa`, without the factor.
    value: Vec<f64>,
    slope: Vec<f64>,
    /// (curve, position), for one lobe.
    curves: Vec<f64>,
}

impl Lobes {
    fn new(shape: &Shape, n: usize) -> Self {
        let (lobes, channels) = (shape.n_lobes, shape.n_channels);
        Self {
            n,
            channels,
            exponent: vec![0.0; lobes * n],
            factor: vec![0.0; lobes * n],
            value: vec![0.0; lobes * channels * n],
            slope: vec![0.0; lobes * channels * n],
            curves: vec![0.0; CURVES * n],
        }
    }

    fn evaluate(&mut self, shape: &Shape, positions: &Positions, x: &[f64]) {
        let n = self.n;
        for k in 0..shape.n_lobes {
            for curve in SHARED {
                let at = shape.shared(curve, k);
                let coefficients = &x[at..at + shape.basis(curve).size];
                combine(
                    coefficients,
                    &positions.functions[curve],
                    &mut self.curves[curve * n..(curve + 1) * n],
                );
            }
            let (curves, colour) = self.curves.split_at_mut(COLOUR * n);
            let row = k * n..(k + 1) * n;
            shapes(
                curves,
                &positions.ln_cos,
                &positions.azimuth,
                &mut self.exponent[row.clone()],
                &mut self.factor[row.clone()],
            );
            for channel in 0..self.channels {
                let at = shape.colour(channel, k);
                combine(&x[at..at + shape.n_colour()], &positions.functions[COLOUR], colour);
                let of = (k * self.channels + channel) * n;
                values(
                    [&curves[..n], &self.exponent[row.clone()], colour],
                    &mut self.value[of..of + n],
                    &mut self.slope[of..of + n],
                );
            }
        }
    }

    /// The value of a channel.
    fn sum(&self, channel: usize, model: &mut [f64]) {
        model.fill(0.0);
        for (k, factor) in self.factor.chunks_exact(self.n).enumerate() {
            add_products(&self.value[(k * self.channels + channel) * self.n..][..self.n], factor, model);
        }
    }
}

/// A texel's problem, in memory that is used for one texel after another.
struct Texel<'a> {
    plan: &'a Plan,
    lobes: Lobes,
    /// (channel, position).
    mean: Vec<f64>,
    count: Vec<f64>,
    target: Vec<f64>,
    root: Vec<f64>,
    residual: Vec<f64>,
    weight: Vec<f64>,
    offset: Vec<f64>,
    n_effective: f64,
    x: Vec<f64>,
    squares: f64,
    model: Vec<f64>,
    /// (column, position of a block), and sums of products of columns, lower triangle, and with residuals.
    columns: Vec<f64>,
    sums: Vec<f64>,
    gradient: Vec<f64>,
    /// Unknown of each column of a channel.
    unknown: Vec<Vec<usize>>,
    sorted: Vec<f64>,
}

impl<'a> Texel<'a> {
    fn new(plan: &'a Plan) -> Self {
        let (shape, n) = (&plan.shape, plan.positions.n);
        let channels = shape.n_channels;
        let unknown: Vec<Vec<usize>> = (0..channels)
            .map(|c| {
                let at = shape.colour(c, 0);
                (0..shape.n_shared()).chain(at..at + shape.n_block()).collect()
            })
            .collect();
        let width = unknown[0].len();
        let many = || vec![0.0; channels * n];
        Self {
            plan,
            lobes: Lobes::new(shape, n),
            mean: many(),
            count: many(),
            target: many(),
            root: many(),
            residual: many(),
            weight: many(),
            offset: vec![0.0; channels],
            n_effective: 1.0,
            x: vec![0.0; shape.n_unknowns()],
            squares: f64::NAN,
            model: vec![0.0; n],
            columns: vec![0.0; width * BLOCK],
            sums: vec![0.0; width * width],
            gradient: vec![0.0; width],
            unknown,
            sorted: Vec::with_capacity(n),
        }
    }

    fn fit<T: Copy + Into<f64>>(&mut self, values: &[T], x: &mut [f64]) -> Quality {
        if !self.load(values) {
            return Quality { squares: f64::NAN, uncertainty: f64::NAN, iterations: 0 };
        }
        self.start(x);
        let stop = Stop { max_iterations: self.plan.iterations, cost: TOLERANCE, floor: 0.0, energy: 0.0 };
        let minimum = minimise(self, x, stop);
        self.cost(x);
        Quality {
            squares: self.squares,
            uncertainty: self.uncertainty(),
            iterations: u32::try_from(minimum.iterations).unwrap_or(u32::MAX),
        }
    }

    /// Means, targets and weights of values (direction, channel); false if there are none.
    fn load<T: Copy + Into<f64>>(&mut self, values: &[T]) -> bool {
        let (n, channels) = (self.plan.positions.n, self.plan.shape.n_channels);
        self.mean.fill(0.0);
        self.count.fill(0.0);
        let mut some = 0.0;
        for (row, &cell) in values.chunks_exact(channels).zip(&self.plan.cell) {
            let mut any = 0.0;
            for (channel, &value) in row.iter().enumerate() {
                let value: f64 = value.into();
                if value.is_finite() {
                    let at = channel * n + cell as usize;
                    self.mean[at] += value;
                    self.count[at] += 1.0;
                    any = 1.0;
                }
            }
            some += any;
        }
        for (mean, count) in self.mean.iter_mut().zip(&self.count) {
            *mean /= count.max(1.0);
        }
        self.n_effective = self.plan.weighing.n_effective.min(some);
        if some == 0.0 {
            return false;
        }
        self.set_offsets();
        self.set_weights();
        for channel in 0..channels {
            let half = 0.5 / self.offset[channel];
            for (target, mean) in self.target[channel * n..][..n].iter_mut().zip(&self.mean[channel * n..]) {
                *target = (half * mean).asinh();
            }
        }
        true
    }

    fn set_offsets(&mut self) {
        let (n, Weighing { offset: share, quantile, .. }) = (self.plan.positions.n, &self.plan.weighing);
        for channel in 0..self.offset.len() {
            let row = channel * n..(channel + 1) * n;
            self.sorted.clear();
            let some = self.mean[row.clone()].iter().zip(&self.count[row]).filter(|(_, c)| **c > 0.0);
            self.sorted.extend(some.map(|(f, _)| *f));
            if self.sorted.is_empty() {
                self.offset[channel] = 0.0;
                continue;
            }
            self.sorted.sort_unstable_by(f64::total_cmp);
            let noise = -at_quantile(&self.sorted, *quantile);
            if self.sorted[0] < 0.0 {
                self.sorted.iter_mut().for_each(|f| *f = f.abs());
                self.sorted.sort_unstable_by(f64::total_cmp);
            }
            self.offset[channel] = noise.max(share * at_quantile(&self.sorted, 0.5));
        }
        let least = self.offset.iter().copied().filter(|o| *o > 0.0).fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 1.0 };
        self.offset.iter_mut().filter(|o| **o <= 0.0).for_each(|o| *o = least);
    }

    fn set_weights(&mut self) {
        let (n, shares) = (self.plan.positions.n, &self.plan.weighing.shares);
        let mut total = 0.0;
        for channel in 0..self.offset.len() {
            let row = channel * n..(channel + 1) * n;
            let (mean, count, root) =
                (&self.mean[row.clone()], &self.count[row.clone()], &mut self.root[row.clone()]);
            let measures = |i: usize| {
                let (bright, cos, area) = (mean[i].max(0.0), self.plan.cos_product[i], count[i]);
                let light = (bright * cos).cbrt();
                [area, area * light * light, area * bright * cos, area * bright * bright]
            };
            let mut sums = [1e-300; 4];
            for i in 0..n {
                for (sum, measure) in sums.iter_mut().zip(measures(i)) {
                    *sum += measure;
                }
            }
            for i in 0..n {
                let parts = measures(i).into_iter().zip(shares).zip(sums);
                let weight: f64 = parts.map(|((measure, share), sum)| share * measure / sum).sum();
                root[i] = weight;
                total += weight;
            }
        }
        self.root.iter_mut().for_each(|w| *w = (*w / total).sqrt());
    }

    /// The material that looks most like this one but for its brightness in each channel, made as bright.
    fn start(&mut self, x: &mut [f64]) {
        let (plan, n) = (self.plan, self.plan.positions.n);
        let channels = plan.shape.n_channels;
        x.copy_from_slice(&plan.prior.mean);
        // Logarithms, in place of residuals
        for channel in 0..channels {
            for i in channel * n..(channel + 1) * n {
                self.residual[i] = ln(self.mean[i].max(self.offset[channel]));
                self.weight[i] = self.root[i] * self.root[i];
            }
        }
        let mut best = f64::INFINITY;
        let mut shifts = vec![0.0; channels];
        let mut brighter = shifts.clone();
        for (start, look) in plan.starts.chunks_exact(x.len()).zip(plan.looks.chunks_exact(channels * n)) {
            let mut miss = 0.0;
            for (channel, shift) in shifts.iter_mut().enumerate() {
                let row = channel * n..(channel + 1) * n;
                let [w, d, dd] =
                    differences(&self.weight[row.clone()], &self.residual[row.clone()], &look[row]);
                *shift = if w > 0.0 { d / w } else { 0.0 };
                miss += dd - d * *shift;
            }
            if miss < best {
                best = miss;
                x.copy_from_slice(start);
                brighter.copy_from_slice(&shifts);
            }
        }
        brighten(&plan.shape, &brighter, x);
    }

    /// Derivatives of the residuals of a channel at positions from `first` on, a column for each unknown.
    fn fill_columns(&mut self, channel: usize, first: usize, n: usize) {
        let (plan, all) = (self.plan, self.plan.positions.n);
        let shape = &plan.shape;
        let of = |at: usize| at * all + first..at * all + first + n;
        let mut column = 0;
        let mut colour = shape.n_shared();
        let weight = &self.weight[of(channel)];
        for k in 0..shape.n_lobes {
            let lobe = k * self.lobes.channels + channel;
            let (value, slope) = (&self.lobes.value[of(lobe)], &self.lobes.slope[of(lobe)]);
            let (factor, exponent) = (&self.lobes.factor[of(k)], &self.lobes.exponent[of(k)]);
            let ln_cos = &plan.positions.ln_cos[of(0)];
            let azimuth = &plan.positions.azimuth[of(0)];
            for curve in SHARED {
                let base: [&[f64]; 2] = match curve {
                    SCALE => [slope, &[]],
                    GAMMA => [slope, exponent],
                    BETA => [value, azimuth],
                    _ => [value, ln_cos],
                };
                for m in 0..shape.basis(curve).size {
                    let out = &mut self.columns[column * BLOCK..column * BLOCK + n];
                    product([weight, factor, base[0], &plan.positions.functions[curve][of(m)]], base[1], out);
                    column += 1;
                }
            }
            for m in 0..shape.n_colour() {
                let out = &mut self.columns[colour * BLOCK..colour * BLOCK + n];
                product([weight, factor, slope, &plan.positions.functions[COLOUR][of(m)]], &[], out);
                colour += 1;
            }
        }
    }

    /// RMS over reference positions of the standard deviation of the logarithm.
    fn uncertainty(&mut self) -> f64 {
        let mut equations = self.equations();
        self.linearise(&mut equations);
        let held = vec![false; self.x.len()];
        let Some(factor) = equations.factor(0.0, &held) else { return f64::NAN };
        let (plan, n) = (self.plan, self.plan.reference.n);
        let shape = &plan.shape;
        let mut lobes = Lobes::new(shape, n);
        lobes.evaluate(shape, &plan.reference, &self.x);
        let mut model = vec![0.0; n];
        // (position, unknown): derivatives of the logarithm, channels averaged
        let mut rows = vec![0.0; n * self.x.len()];
        for channel in 0..shape.n_channels {
            lobes.sum(channel, &mut model);
            for i in 0..n {
                let row = &mut rows[i * self.x.len()..(i + 1) * self.x.len()];
                let share = 1.0 / (shape.n_channels as f64 * model[i].max(1e-300));
                for k in 0..shape.n_lobes {
                    let at = (k * shape.n_channels + channel) * n + i;
                    let factor = share * lobes.factor[k * n + i];
                    let (by_value, by_kappa) = (factor * lobes.value[at], factor * lobes.slope[at]);
                    for (curve, by) in [
                        (SCALE, by_kappa),
                        (GAMMA, by_kappa * lobes.exponent[k * n + i]),
                        (BETA, by_value * plan.reference.azimuth[i]),
                        (FALLOFF, by_value * plan.reference.ln_cos[i]),
                        (COLOUR, by_kappa),
                    ] {
                        let (first, size) = match curve {
                            COLOUR => (shape.colour(channel, k), shape.n_colour()),
                            _ => (shape.shared(curve, k), shape.basis(curve).size),
                        };
                        for m in 0..size {
                            row[first + m] += by * plan.reference.functions[curve][m * n + i];
                        }
                    }
                }
            }
        }
        let mut solved = vec![0.0; self.x.len()];
        let variance: f64 = rows
            .chunks_exact(self.x.len())
            .map(|row| {
                solved.copy_from_slice(row);
                factor.solve(&mut solved);
                row.iter().zip(&solved).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum();
        (variance / n as f64).sqrt()
    }

    fn away(&self) -> Vec<f64> {
        self.x.iter().zip(&self.plan.prior.mean).map(|(x, m)| x - m).collect()
    }
}

impl LeastSquares for Texel<'_> {
    fn cost(&mut self, x: &[f64]) -> f64 {
        self.x.copy_from_slice(x);
        let n = self.plan.positions.n;
        self.lobes.evaluate(&self.plan.shape, &self.plan.positions, x);
        self.squares = 0.0;
        for channel in 0..self.offset.len() {
            self.lobes.sum(channel, &mut self.model);
            let row = channel * n..(channel + 1) * n;
            self.squares += residuals(
                self.offset[channel],
                [&self.model, &self.target[row.clone()], &self.root[row.clone()]],
                &mut self.residual[row.clone()],
                &mut self.weight[row],
            );
        }
        let away = self.away();
        let rows = self.plan.prior.precision.chunks_exact(x.len());
        let penalty: f64 = rows.zip(&away).map(|(row, a)| a * dot(row, &away)).sum();
        0.5 * (self.n_effective * (self.squares / LEAST_SQUARES).ln_1p() + penalty)
    }

    fn equations(&self) -> Arrow {
        Arrow::new(self.x.len(), 0, 0)
    }

    fn linearise(&mut self, equations: &mut Arrow) {
        let n = self.plan.positions.n;
        let precision = self.n_effective / (self.squares + LEAST_SQUARES);
        let width = self.gradient.len();
        for channel in 0..self.offset.len() {
            self.sums.fill(0.0);
            self.gradient.fill(0.0);
            for first in (0..n).step_by(BLOCK) {
                let size = BLOCK.min(n - first);
                self.fill_columns(channel, first, size);
                let residual = &self.residual[channel * n + first..][..size];
                products(&self.columns, residual, &mut self.sums, &mut self.gradient);
            }
            let unknown = &self.unknown[channel];
            for (a, &i) in unknown.iter().enumerate() {
                equations.gradient[i] += precision * self.gradient[a];
                for (b, &j) in unknown[..=a].iter().enumerate() {
                    *equations.entry(i, j) += precision * self.sums[a * width + b];
                }
            }
        }
        let away = self.away();
        for (i, row) in self.plan.prior.precision.chunks_exact(away.len()).enumerate() {
            equations.gradient[i] += dot(row, &away);
            for j in 0..=i {
                *equations.entry(i, j) += row[j];
            }
        }
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        let shape = &self.plan.shape;
        if i >= shape.n_shared() {
            return (-MAX_COLOUR, MAX_COLOUR);
        }
        match i % (shape.n_shared() / shape.n_lobes) {
            at if at < shape.shared(GAMMA, 0) => LN_KAPPA,
            at if at < shape.shared(BETA, 0) => LN_GAMMA,
            at if at < shape.shared(FALLOFF, 0) => (-MAX_BETA, MAX_BETA),
            _ => FALLOFF_RANGE,
        }
    }
}

/// Multiplies a small kappa of all lobes in each channel by these, given as logarithms.
fn brighten(shape: &Shape, by: &[f64], x: &mut [f64]) {
    let common = by.iter().sum::<f64>() / by.len() as f64;
    for k in 0..shape.n_lobes {
        let at = shape.shared(SCALE, k);
        x[at..at + shape.basis(SCALE).size].iter_mut().for_each(|x| *x += common);
        for (channel, by) in by.iter().enumerate() {
            let at = shape.colour(channel, k);
            x[at..at + shape.n_colour()].iter_mut().for_each(|x| *x += by - common);
        }
    }
}

/// A quantile of what is sorted, between neighbours.
fn at_quantile(sorted: &[f64], quantile: f64) -> f64 {
    let at = quantile * (sorted.len() - 1) as f64;
    let low = sorted[at as usize];
    let high = sorted[(at as usize + 1).min(sorted.len() - 1)];
    low + at.fract() * (high - low)
}

/// Sum of coefficients times functions (coefficient, position).
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn combine(coefficients: &[f64], functions: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (c, functions) in coefficients.iter().zip(functions.chunks_exact(out.len())) {
        for (out, f) in out.iter_mut().zip(functions) {
            *out = c.mul_add(*f, *out);
        }
    }
}

/// `gamma ln cos(theta_h)` and `exp(beta azimuth) cos(theta_h)^falloff` of curves (curve, position).
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn shapes(curves: &[f64], ln_cos: &[f64], azimuth: &[f64], exponent: &mut [f64], factor: &mut [f64]) {
    let n = ln_cos.len();
    let (gamma, beta) = (&curves[GAMMA * n..][..n], &curves[BETA * n..][..n]);
    let (falloff, azimuth) = (&curves[FALLOFF * n..][..n], &azimuth[..n]);
    let (exponent, factor) = (&mut exponent[..n], &mut factor[..n]);
    for i in 0..n {
        exponent[i] = ln_cos[i] * exp(gamma[i]);
        factor[i] = exp(beta[i].mul_add(azimuth[i], falloff[i] * ln_cos[i]));
    }
}

/// `expm1(kappa cos^gamma)` and its derivative by `ln kappa`; the logarithm of the argument is the sum of three parts.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn values([scale, exponent, colour]: [&[f64]; 3], value: &mut [f64], slope: &mut [f64]) {
    let n = value.len();
    let (scale, exponent, colour, slope) = (&scale[..n], &exponent[..n], &colour[..n], &mut slope[..n]);
    for i in 0..n {
        let t = exp((scale[i] + exponent[i] + colour[i]).clamp(DARK, LN_KAPPA.1));
        value[i] = expm1(t);
        slope[i] = t * (value[i] + 1.0);
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_products(x: &[f64], y: &[f64], sum: &mut [f64]) {
    for ((sum, x), y) in sum.iter_mut().zip(x).zip(y) {
        *sum = x.mul_add(*y, *sum);
    }
}

/// Sums of weights, and of weights times differences and their squares.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn differences(weight: &[f64], a: &[f64], b: &[f64]) -> [f64; 3] {
    let mut sums = [[0.0; 8]; 3];
    let whole = weight.len() / 8 * 8;
    let mut add = |i: usize, lane: usize| {
        let d = a[i] - b[i];
        let wd = weight[i] * d;
        sums[0][lane] += weight[i];
        sums[1][lane] += wd;
        sums[2][lane] = wd.mul_add(d, sums[2][lane]);
    };
    for i in (0..whole).step_by(8) {
        for lane in 0..8 {
            add(i + lane, lane);
        }
    }
    for i in whole..weight.len() {
        add(i, 0);
    }
    sums.map(|lanes| lanes.iter().sum())
}

/// Residuals of `asinh(f / 2 o)`, and their derivatives by f, times the roots of weights; the sum of squares.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn residuals(
    offset: f64,
    [model, target, root]: [&[f64]; 3],
    residual: &mut [f64],
    weight: &mut [f64],
) -> f64 {
    let n = model.len();
    let (target, root) = (&target[..n], &root[..n]);
    let (residual, weight) = (&mut residual[..n], &mut weight[..n]);
    let scale = 0.5 / offset;
    for i in 0..n {
        // Model values are not negative: the logarithm is asinh without cancellation
        let half = scale * model[i];
        let length = half.mul_add(half, 1.0).sqrt();
        residual[i] = root[i] * (ln(half + length) - target[i]);
        weight[i] = root[i] * scale / length;
    }
    dot_lanes(residual, residual)
}

/// Product of four vectors, and of a fifth if there is one.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn product([a, b, c, d]: [&[f64]; 4], e: &[f64], out: &mut [f64]) {
    let n = out.len();
    let (a, b, c, d) = (&a[..n], &b[..n], &c[..n], &d[..n]);
    if e.is_empty() {
        for i in 0..n {
            out[i] = a[i] * b[i] * (c[i] * d[i]);
        }
    } else {
        let e = &e[..n];
        for i in 0..n {
            out[i] = a[i] * b[i] * (c[i] * d[i]) * e[i];
        }
    }
}

/// Adds products of columns (column, [`BLOCK`]) among themselves, lower triangle, and with residuals.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn products(columns: &[f64], residual: &[f64], sums: &mut [f64], gradient: &mut [f64]) {
    let (n, width) = (residual.len(), gradient.len());
    for a in 0..width {
        let x = &columns[a * BLOCK..a * BLOCK + n];
        for b in 0..=a {
            sums[a * width + b] += dot_lanes(x, &columns[b * BLOCK..b * BLOCK + n]);
        }
        gradient[a] += dot_lanes(x, residual);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Sizes;

    fn number(i: usize, k: usize) -> f64 {
        ((i * 7919 + k * 104_729) as f64 * 0.618_033_988_749_894_9).fract()
    }

    fn plan(n: usize, n_cells: usize) -> Plan {
        let shape = Shape {
            n_lobes: 2,
            n_channels: 3,
            sizes: Sizes { scale: 3, gamma: 2, beta: 2, falloff: 1, colour: 2 },
        };
        let ln_cos: Vec<f64> = (0..n_cells).map(|i| (1.3 * number(i, 1)).cos().ln()).collect();
        let x: Vec<f64> = (0..n_cells).map(|i| number(i, 2)).collect();
        let azimuth: Vec<f64> = (0..n_cells).map(|i| 2.0 * number(i, 3) - 1.0).collect();
        let at = Coordinates { ln_cos: &ln_cos, x: &x, azimuth: &azimuth };
        let p = shape.n_unknowns();
        let precision = (0..p * p).map(|at| if at % (p + 1) == 0 { 2.0 } else { 0.01 }).collect();
        let prior = Prior { mean: (0..p).map(|i| number(i, 5) - 0.5).collect(), precision };
        let starts = (0..3 * p).map(|i| number(i, 6) - 0.5).collect();
        Plan::new(
            shape.clone(),
            Positions::new(&at, &shape),
            (0..n).map(|i| (i % n_cells) as u32).collect(),
            x.clone(),
            Weighing { shares: [0.7, 3.0, 4.0, 0.7], offset: 0.01, quantile: 0.05, n_effective: 2000.0 },
            prior,
            starts,
            Positions::new(&at, &shape),
            40,
        )
    }

    #[test]
    fn gradient_equals_differences() {
        // More positions than a block, and three directions at each
        let plan = plan(600, 200);
        let values: Vec<f64> =
            (0..1800).map(|i| if i % 7 == 0 { f64::NAN } else { number(i, 9) - 0.02 }).collect();
        let mut texel = Texel::new(&plan);
        assert!(texel.load(&values));
        let p = plan.shape.n_unknowns();
        let x: Vec<f64> = (0..p).map(|i| number(i, 4) - 0.3).collect();
        texel.cost(&x);
        let mut equations = texel.equations();
        texel.linearise(&mut equations);
        for i in 0..p {
            let mut shifted = |by: f64| {
                let mut x = x.clone();
                x[i] += by;
                texel.cost(&x)
            };
            let h = 1e-4;
            let want =
                (8.0 * (shifted(h) - shifted(-h)) - (shifted(2.0 * h) - shifted(-2.0 * h))) / (12.0 * h);
            let got = equations.gradient[i];
            assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{i}: {got} {want}");
        }
    }

    #[test]
    fn texels_do_not_disturb_each_other() {
        let plan = plan(96, 96);
        let one: Vec<f32> = (0..288).map(|i| number(i, 11) as f32).collect();
        let other: Vec<f32> =
            (0..288).map(|i| if i < 200 { f32::NAN } else { 3.0 * number(i, 12) as f32 }).collect();
        let nothing = vec![f32::NAN; 288];
        let (alone, _) = plan.fit(&one);
        let (all, quality) = plan.fit(&[other, nothing, one].concat());
        let p = plan.shape.n_unknowns();
        assert_eq!(alone, all[2 * p..]);
        assert!(all[p..2 * p].iter().all(|x| x.is_nan()) && quality[1].squares.is_nan());
        // Fewer values, less certainty
        assert!(quality[0].uncertainty > quality[2].uncertainty && quality[2].uncertainty > 0.0);
    }

    #[test]
    fn quantiles_lie_between_neighbours() {
        assert_eq!(at_quantile(&[1.0, 2.0, 4.0], 0.75), 3.0);
        assert_eq!(at_quantile(&[1.0, 2.0, 4.0], 1.0), 4.0);
        assert_eq!(at_quantile(&[5.0], 0.3), 5.0);
    }
}
