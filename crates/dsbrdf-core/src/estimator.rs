//! The one least-squares problem: lobes with curves over cos(theta_d), shapes shared by the channels, to observations.
//!
//! The cost is `n / (2 s^2)` times the weighted mean of squared residuals, plus half the penalty: the negative logarithm
//! of the posterior for `n` independent observations of standard deviation s.

use rayon::prelude::*;

use crate::arrow::Arrow;
use crate::basis::WIDTH;
use crate::exp::{exp, expm1, ln};
use crate::levenberg_marquardt::LeastSquares;
use crate::observations::Observations;
use crate::shape::{BETA, COLOUR, CURVES, FALLOFF, GAMMA, SCALE, SHARED, Shape};

/// A lobe is at most this many times as high as the brightest value: nothing else holds one that is narrower than the
/// distance of the samples.
const MAX_HEIGHT: f64 = 2.0;
/// Inverse square of how far the `ln kappa` of a channel, its colour added, may be above that.
const HEIGHT_WEIGHT: f64 = 400.0;
/// Least and greatest `ln kappa`: absent, and the most that `expm1` holds.
pub const LN_KAPPA: (f64, f64) = (-40.0, 6.5);
/// A lobe that has fallen below this, `ln`, falls no further: squares of less are denormal numbers, which take long.
const DARK: f64 = -100.0;
/// Least and greatest `ln gamma`: flat, and a mirror.
pub const LN_GAMMA: (f64, f64) = (-6.0, 14.0);
/// Greatest `ln kappa` of a colour, either way.
pub const MAX_COLOUR: f64 = 20.0;
/// Greatest beta, either way.
pub const MAX_BETA: f64 = 2.0;
/// Least and greatest falloff; a lobe's energy is finite above -1.
pub const FALLOFF_RANGE: (f64, f64) = (-0.9, 20.0);
/// The range of x is cut into so many bins, less where that leaves fewer positions a bin than pay for vector
/// instructions: in a bin the Hessian takes the mean of the curves' functions.
const BINS: (usize, usize) = (16, 96);
const POSITIONS_A_BIN: usize = 96;
/// Differences of logarithms above this count linearly in the gamma deviance.
const MAX_LOG_RATIO: f64 = 3.0;

/// What is compared of a value and its model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// `asinh(f / 2 o)`: a logarithm, linear below the offset o.
    Log,
    /// The deviance of the gamma distribution, of the same logarithm: its minimum has no bias from noise.
    Gamma,
    /// The value itself.
    L2,
}

impl Loss {
    /// The scale on which values are compared.
    #[inline(always)]
    fn transformed(self, value: f64, offset: f64) -> f64 {
        match self {
            Loss::L2 => value / offset,
            _ => (value / (2.0 * offset)).asinh(),
        }
    }

    /// Residual of a model value against a transformed observation, and its derivative.
    #[inline(always)]
    fn residual(self, model: f64, target: f64, offset: f64) -> (f64, f64) {
        if self == Loss::L2 {
            return (model / offset - target, 1.0 / offset);
        }
        // Model values are not negative: the logarithm is asinh without cancellation
        let half = 0.5 * model / offset;
        let root = half.mul_add(half, 1.0).sqrt();
        let u = ln(half + root) - target;
        let slope = 0.5 / (offset * root);
        match self {
            Loss::Gamma => {
                let (deviance, by_u) = gamma_deviance(-u);
                (-deviance, by_u * slope)
            }
            _ => (u, slope),
        }
    }
}

/// Signed root of `2 (exp(u) - 1 - u)`, and its derivative; a line beyond [`MAX_LOG_RATIO`].
fn gamma_deviance(u: f64) -> (f64, f64) {
    let v = u.min(MAX_LOG_RATIO);
    if v.abs() < 1e-3 {
        return (v * (1.0 + v * (1.0 / 6.0 + v / 36.0)), 1.0 + v / 3.0 + v * v / 12.0);
    }
    let root = (2.0 * (v.exp_m1() - v)).sqrt().copysign(v);
    let slope = v.exp_m1() / root;
    (root + (u - v) * slope, slope)
}

/// How strongly curves are held; each weight is the inverse square of what is usual.
#[derive(Clone, Copy, Debug)]
pub struct Penalty {
    /// Of second differences of neighbouring coefficients.
    pub bend: f64,
    /// Of first differences.
    pub slope: f64,
    /// Of colours themselves, of beta and of the falloff.
    pub size: f64,
}

/// A Gaussian prior of all unknowns: mean, and the inverse of the covariance (unknown, unknown).
pub struct Prior {
    pub mean: Vec<f64>,
    pub precision: Vec<f64>,
}

/// Observations of about the same x, and what the model is at them.
struct Bin {
    start: usize,
    n: usize,
    /// First function of each curve that is alive here, its values (function, position), and their means.
    first: [usize; CURVES],
    functions: [Vec<f64>; CURVES],
    mean: [[f64; WIDTH]; CURVES],
    /// (lobe, position): gamma times the logarithm of the cosine.
    exponent: Vec<f64>,
    /// (lobe, node, position): `exp(beta azimuth) cos(theta_h)^falloff`.
    factor: Vec<f64>,
    /// (lobe, channel, position): value, and derivative by `ln kappa`.
    value: Vec<f64>,
    slope: Vec<f64>,
    /// (node, channel, position): residual, and derivative by the model's value, both with the root of the weight.
    residual: Vec<f64>,
    weight: Vec<f64>,
    /// (column, position) of one node and channel; a column for each lobe's ln kappa, ln gamma, beta and falloff.
    /// Zeros fill the last vector.
    columns: Vec<f64>,
    /// (channel, column, column), lower triangles, and gradients (channel, column, function), of two bases each.
    squares: Vec<f64>,
    gradient: Vec<f64>,
    colour_gradient: Vec<f64>,
}

/// The least-squares problem.
pub struct Problem<'a> {
    pub shape: Shape,
    observations: &'a Observations,
    loss: Loss,
    offset: Vec<f64>,
    /// (node, channel, position).
    target: Vec<f64>,
    root_weight: Vec<f64>,
    penalty: Penalty,
    prior: Option<&'a Prior>,
    /// Greatest `ln kappa` of a scale.
    max_scale: f64,
    /// `n / s^2` of the cost.
    pub precision: f64,
    bins: Vec<Bin>,
    x: Vec<f64>,
    /// Weighted mean of squared residuals, and the penalty, at `x`.
    pub squares: f64,
    pub penalties: f64,
}

impl<'a> Problem<'a> {
    #[must_use]
    pub fn new(
        observations: &'a Observations,
        shape: Shape,
        loss: Loss,
        offset: &[f64],
        penalty: Penalty,
        prior: Option<&'a Prior>,
    ) -> Self {
        let n = observations.len();
        let mut target = vec![0.0; observations.value.len()];
        for (row, target) in target.chunks_exact_mut(n.max(1)).enumerate() {
            let offset = offset[row % observations.n_channels];
            for (target, &value) in target.iter_mut().zip(&observations.value[row * n..]) {
                *target = loss.transformed(value, offset);
            }
        }
        let n_unknowns = shape.n_unknowns();
        Self {
            // A prior knows better what was not measured
            max_scale: match prior {
                None => {
                    (MAX_HEIGHT * observations.brightest).ln_1p().ln().clamp(LN_KAPPA.0 + 1.0, LN_KAPPA.1)
                }
                Some(_) => LN_KAPPA.1,
            },
            bins: bins(observations, &shape),
            shape,
            observations,
            loss,
            offset: offset.to_vec(),
            target,
            root_weight: observations.weight.iter().map(|w| w.sqrt()).collect(),
            penalty,
            prior,
            precision: 1.0,
            x: vec![0.0; n_unknowns],
            squares: f64::NAN,
            penalties: f64::NAN,
        }
    }

    /// Calls `row` with the weight, the value and the terms (unknown, factor) of each row of the penalty at `x`.
    fn penalty_rows(&self, mut row: impl FnMut(f64, f64, &[(usize, f64)])) {
        let x = &self.x;
        let value = |terms: &[(usize, f64)]| terms.iter().map(|&(i, f)| f * x[i]).sum::<f64>();
        self.linear_rows(|weight, terms| row(weight, value(terms), terms));
        if self.prior.is_some() || self.shape.n_colour() == 0 || !self.observations.is_scattered {
            return;
        }
        // Where a line of colour has the same places as the scale, so has their sum
        let (scale, colour) = (self.shape.basis(SCALE), self.shape.basis(COLOUR));
        let mut terms = [(0, 1.0); 1 + WIDTH];
        for k in 0..self.shape.n_lobes {
            for i in 0..scale.size {
                terms[0].0 = self.shape.shared(SCALE, k) + i;
                let (first, functions) = colour.at(scale.place(i));
                let n = 1 + colour.size.min(WIDTH);
                for channel in 0..self.shape.n_channels {
                    let at = self.shape.colour(channel, k) + first;
                    for (term, (j, &f)) in terms[1..n].iter_mut().zip(functions.iter().enumerate()) {
                        *term = (at + j, f);
                    }
                    let above = value(&terms[..n]) - self.max_scale;
                    if above > 0.0 {
                        row(HEIGHT_WEIGHT, above, &terms[..n]);
                    }
                }
            }
        }
    }

    /// Calls `row` with the weight and the terms of each row of the penalty that is a multiple of the unknowns.
    fn linear_rows(&self, mut row: impl FnMut(f64, &[(usize, f64)])) {
        let Penalty { bend, slope, size } = self.penalty;
        for (curve, at) in self.shape.curves() {
            let n = self.shape.basis(curve).size;
            // Differences as those of a curve of six coefficients, so that finer curves may bend as much
            let spacing = 5.0 / (n.max(2) - 1) as f64;
            // Channels go together over theta_d, unless the data say otherwise
            let stiffness = if curve == COLOUR { slope } else { slope / spacing };
            for i in 1..n {
                row(stiffness, &[(at + i - 1, -1.0), (at + i, 1.0)]);
                if i + 1 < n {
                    row(bend / spacing.powi(3), &[(at + i - 1, 1.0), (at + i, -2.0), (at + i + 1, 1.0)]);
                }
            }
            if matches!(curve, COLOUR | BETA | FALLOFF) {
                for i in 0..n {
                    row(size / n as f64, &[(at + i, 1.0)]);
                }
            }
        }
    }

    /// Twice the negative logarithm of the posterior, the noise integrated out, up to a constant.
    #[must_use]
    pub fn objective(&self, n_effective: f64, least: f64) -> f64 {
        n_effective * (self.squares + least).ln() + self.penalties
    }
}

impl LeastSquares for Problem<'_> {
    fn cost(&mut self, x: &[f64]) -> f64 {
        self.x.copy_from_slice(x);
        let mut bins = std::mem::take(&mut self.bins);
        let parts: Vec<f64> = bins.par_iter_mut().map(|bin| bin.evaluate(self)).collect();
        self.bins = bins;
        self.squares = parts.iter().sum();
        let mut penalties = 0.0;
        self.penalty_rows(|weight, value, _| penalties += weight * value * value);
        if let Some(prior) = self.prior {
            let away: Vec<f64> = x.iter().zip(&prior.mean).map(|(x, m)| x - m).collect();
            let rows = prior.precision.chunks_exact(x.len());
            penalties += rows.zip(&away).map(|(row, a)| a * dot(row, &away)).sum::<f64>();
        }
        self.penalties = penalties;
        0.5 * (self.precision * self.squares + penalties)
    }

    fn equations(&self) -> Arrow {
        let (shape, p) = (&self.shape, self.shape.n_unknowns());
        if self.prior.is_some() || shape.n_block() == 0 {
            return Arrow::new(p, 0, 0);
        }
        Arrow::new(shape.n_shared(), shape.n_block(), shape.n_channels)
    }

    fn linearise(&mut self, equations: &mut Arrow) {
        let mut bins = std::mem::take(&mut self.bins);
        bins.par_iter_mut().for_each(|bin| bin.linearise(self));
        for bin in &bins {
            bin.assemble(self, equations);
        }
        self.bins = bins;
        let x = &self.x;
        self.penalty_rows(|weight, value, terms| {
            for &(i, f) in terms {
                equations.gradient[i] += weight * f * value;
                for &(j, g) in terms.iter().filter(|&&(j, _)| j <= i) {
                    *equations.entry(i, j) += weight * f * g;
                }
            }
        });
        if let Some(prior) = self.prior {
            let away: Vec<f64> = x.iter().zip(&prior.mean).map(|(x, m)| x - m).collect();
            for (i, row) in prior.precision.chunks_exact(x.len()).enumerate() {
                equations.gradient[i] += dot(row, &away);
                for j in 0..=i {
                    *equations.entry(i, j) += row[j];
                }
            }
        }
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        let shared = self.shape.n_shared();
        if i >= shared {
            return (-MAX_COLOUR, MAX_COLOUR);
        }
        let k = self.shape.shared(SCALE, 1);
        match i % k {
            at if at < self.shape.shared(GAMMA, 0) => (LN_KAPPA.0, self.max_scale),
            at if at < self.shape.shared(BETA, 0) => LN_GAMMA,
            at if at < self.shape.shared(FALLOFF, 0) => (-MAX_BETA, MAX_BETA),
            _ => FALLOFF_RANGE,
        }
    }
}

/// Positions of about the same x, between the same knots of all curves.
fn bins(observations: &Observations, shape: &Shape) -> Vec<Bin> {
    let spans = |x: f64| std::array::from_fn::<usize, CURVES, _>(|curve| shape.basis(curve).span(x));
    let x = &observations.x;
    let width = 1.0 / (x.len() / POSITIONS_A_BIN).clamp(BINS.0, BINS.1) as f64;
    let mut bins = Vec::new();
    let mut start = 0;
    while start < x.len() {
        let here = spans(x[start]);
        let mut end = start + 1;
        while end < x.len() && x[end] - x[start] < width && spans(x[end]) == here {
            end += 1;
        }
        bins.push(Bin::new(observations, shape, start, end - start));
        start = end;
    }
    bins
}

impl Bin {
    fn new(observations: &Observations, shape: &Shape, start: usize, n: usize) -> Self {
        let (lobes, channels, nodes) = (shape.n_lobes, shape.n_channels, observations.n_nodes);
        let mut bin = Self {
            start,
            n,
            first: [0; CURVES],
            functions: std::array::from_fn(|_| vec![0.0; WIDTH * n]),
            mean: [[0.0; WIDTH]; CURVES],
            exponent: vec![0.0; lobes * n],
            factor: vec![0.0; lobes * nodes * n],
            value: vec![0.0; lobes * channels * n],
            slope: vec![0.0; lobes * channels * n],
            residual: vec![0.0; nodes * channels * n],
            weight: vec![0.0; nodes * channels * n],
            columns: vec![0.0; SHARED.len() * lobes * n.next_multiple_of(LANES)],
            squares: vec![0.0; channels * (SHARED.len() * lobes).pow(2)],
            gradient: vec![0.0; SHARED.len() * lobes * WIDTH],
            colour_gradient: vec![0.0; channels * lobes * WIDTH],
        };
        for curve in 0..CURVES {
            for i in 0..n {
                let (first, b) = shape.basis(curve).at(observations.x[start + i]);
                bin.first[curve] = first;
                for (m, b) in b.into_iter().enumerate() {
                    bin.functions[curve][m * n + i] = b;
                    bin.mean[curve][m] += b / n as f64;
                }
            }
        }
        bin
    }

    /// The curve with these coefficients at each position.
    fn curve(&self, curve: usize, size: usize, coefficients: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for m in 0..size.min(WIDTH) {
            add_scaled(
                coefficients[self.first[curve] + m],
                &self.functions[curve][m * self.n..(m + 1) * self.n],
                out,
            );
        }
    }

    /// Evaluates the model; the part of the weighted squares.
    fn evaluate(&mut self, problem: &Problem) -> f64 {
        let (shape, observations, c) = (&problem.shape, problem.observations, &problem.x);
        let (n, channels, lobes) = (self.n, shape.n_channels, shape.n_lobes);
        let positions = self.start..self.start + n;
        let mut power = vec![0.0; n];
        let mut colour = vec![0.0; n];
        let mut beta = vec![0.0; n];
        for k in 0..lobes {
            let part = |curve| {
                let at = shape.shared(curve, k);
                (shape.basis(curve).size, &c[at..at + shape.basis(curve).size])
            };
            let (size, coefficients) = part(GAMMA);
            self.curve(GAMMA, size, coefficients, &mut power);
            times_exp(
                &observations.ln_cos[positions.clone()],
                &power,
                &mut self.exponent[k * n..(k + 1) * n],
            );
            let (size, coefficients) = part(BETA);
            self.curve(BETA, size, coefficients, &mut beta);
            let (size, coefficients) = part(FALLOFF);
            self.curve(FALLOFF, size, coefficients, &mut power);
            for node in 0..observations.n_nodes {
                let row = node * observations.len() + self.start;
                let at = (k * observations.n_nodes + node) * n;
                factors(
                    &beta,
                    &observations.azimuth[row..row + n],
                    &power,
                    &observations.ln_cos[positions.clone()],
                    &mut self.factor[at..at + n],
                );
            }
            let (size, coefficients) = part(SCALE);
            self.curve(SCALE, size, coefficients, &mut power);
            add_scaled(1.0, &self.exponent[k * n..(k + 1) * n], &mut power);
            for channel in 0..channels {
                let at = shape.colour(channel, k);
                let size = shape.n_colour();
                self.curve(COLOUR, size, &c[at..at + size], &mut colour);
                add_scaled(1.0, &power, &mut colour);
                let row = (k * channels + channel) * n..(k * channels + channel + 1) * n;
                values_and_slopes(&colour, &mut self.value[row.clone()], &mut self.slope[row]);
            }
        }
        let mut squares = 0.0;
        let mut model = colour;
        for node in 0..observations.n_nodes {
            for channel in 0..channels {
                let row = observations.row(node, channel) + self.start;
                let row = row..row + n;
                model.fill(0.0);
                for k in 0..lobes {
                    let of = (k * channels + channel) * n;
                    add_lobe(
                        &self.value[of..of + n],
                        &self.factor[(k * observations.n_nodes + node) * n..][..n],
                        &mut model,
                    );
                }
                let at = (node * channels + channel) * n;
                let (target, root) = (&problem.target[row.clone()], &problem.root_weight[row]);
                squares += residuals(
                    (problem.loss, problem.offset[channel]),
                    [&model, target, root],
                    &mut self.residual[at..at + n],
                    &mut self.weight[at..at + n],
                );
            }
        }
        squares
    }

    /// Sums over positions of products of columns, and with the residuals.
    fn linearise(&mut self, problem: &Problem) {
        let (shape, observations) = (&problem.shape, problem.observations);
        let (n, channels, lobes) = (self.n, shape.n_channels, shape.n_lobes);
        let width = SHARED.len() * lobes;
        self.squares.fill(0.0);
        let stride = n.next_multiple_of(LANES);
        // (column, position): columns times residuals, of all nodes and channels, and of one channel
        let mut pulls = vec![0.0; width * n];
        let mut of_channel = vec![0.0; width * n];
        for channel in 0..channels {
            of_channel.fill(0.0);
            for node in 0..observations.n_nodes {
                let row = node * observations.len() + self.start;
                let azimuth = &observations.azimuth[row..row + n];
                let ln_cos = &observations.ln_cos[self.start..self.start + n];
                let at = (node * channels + channel) * n;
                let (residual, weight) = (&self.residual[at..at + n], &self.weight[at..at + n]);
                for k in 0..lobes {
                    let of = (k * channels + channel) * n;
                    columns(
                        weight,
                        [azimuth, ln_cos],
                        &self.factor[(k * observations.n_nodes + node) * n..][..n],
                        &self.value[of..of + n],
                        &self.slope[of..of + n],
                        &self.exponent[k * n..(k + 1) * n],
                        &mut self.columns[SHARED.len() * k * stride..SHARED.len() * (k + 1) * stride],
                    );
                }
                products(
                    &self.columns,
                    stride,
                    &mut self.squares[channel * width * width..(channel + 1) * width * width],
                );
                add_times(&self.columns, stride, residual, &mut of_channel);
            }
            add_scaled(1.0, &of_channel, &mut pulls);
            for k in 0..lobes {
                let pull = &of_channel[SHARED.len() * k * n..][..n];
                for m in 0..shape.n_colour().min(WIDTH) {
                    self.colour_gradient[(channel * lobes + k) * WIDTH + m] =
                        dot(pull, &self.functions[COLOUR][m * n..(m + 1) * n]);
                }
            }
        }
        for column in 0..width {
            let (pull, curve) = (&pulls[column * n..(column + 1) * n], SHARED[column % SHARED.len()]);
            for m in 0..shape.basis(curve).size.min(WIDTH) {
                self.gradient[column * WIDTH + m] = dot(pull, &self.functions[curve][m * n..(m + 1) * n]);
            }
        }
    }

    /// Adds this bin's part of the normal equations.
    fn assemble(&self, problem: &Problem, equations: &mut Arrow) {
        let shape = &problem.shape;
        let (lobes, channels, precision) = (shape.n_lobes, shape.n_channels, problem.precision);
        let width = SHARED.len() * lobes;
        // Unknowns that are alive here: (unknown, column, function)
        let mut shared: Vec<(usize, usize, f64)> = Vec::with_capacity(width * WIDTH);
        for k in 0..lobes {
            for curve in SHARED {
                let at = shape.shared(curve, k) + self.first[curve];
                for m in 0..shape.basis(curve).size.min(WIDTH) {
                    shared.push((at + m, SHARED.len() * k + curve, self.mean[curve][m]));
                    let gradient = self.gradient[(SHARED.len() * k + curve) * WIDTH + m];
                    equations.gradient[at + m] += precision * gradient;
                }
            }
        }
        let mut total = vec![0.0; width * width];
        for squares in self.squares.chunks_exact(width * width) {
            add_scaled(precision, squares, &mut total);
        }
        add_block(equations, &shared, &total, width);
        if shape.n_colour() == 0 {
            return;
        }
        let mut colours: Vec<(usize, usize, f64)> = Vec::with_capacity(lobes * WIDTH);
        for channel in 0..channels {
            total.fill(0.0);
            add_scaled(
                precision,
                &self.squares[channel * width * width..(channel + 1) * width * width],
                &mut total,
            );
            colours.clear();
            for k in 0..lobes {
                let at = shape.colour(channel, k) + self.first[COLOUR];
                for m in 0..shape.n_colour().min(WIDTH) {
                    colours.push((at + m, SHARED.len() * k, self.mean[COLOUR][m]));
                    let gradient = self.colour_gradient[(channel * lobes + k) * WIDTH + m];
                    equations.gradient[at + m] += precision * gradient;
                }
            }
            add_block(equations, &colours, &total, width);
            for &(i, a, f) in &colours {
                for &(j, b, g) in &shared {
                    *equations.entry(i, j) += f * g * total[a.max(b) * width + a.min(b)];
                }
            }
        }
    }
}

/// Adds products of unknowns among themselves.
fn add_block(equations: &mut Arrow, alive: &[(usize, usize, f64)], squares: &[f64], width: usize) {
    for &(i, a, f) in alive {
        for &(j, b, g) in alive.iter().filter(|&&(j, ..)| j <= i) {
            *equations.entry(i, j) += f * g * squares[a.max(b) * width + a.min(b)];
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_scaled(factor: f64, x: &[f64], sum: &mut [f64]) {
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum = factor.mul_add(*x, *sum);
    }
}

/// `out = base exp(ln_gamma)`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn times_exp(base: &[f64], ln_gamma: &[f64], out: &mut [f64]) {
    for ((out, base), g) in out.iter_mut().zip(base).zip(ln_gamma) {
        *out = base * exp(*g);
    }
}

/// `expm1(exp(p))` and its derivative by p.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn values_and_slopes(p: &[f64], value: &mut [f64], slope: &mut [f64]) {
    for ((p, value), slope) in p.iter().zip(value).zip(slope) {
        let t = exp(p.clamp(DARK, LN_KAPPA.1));
        *value = expm1(t);
        *slope = t * (*value + 1.0);
    }
}

/// `exp(beta azimuth) cos(theta_h)^falloff`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn factors(beta: &[f64], azimuth: &[f64], falloff: &[f64], ln_cos: &[f64], out: &mut [f64]) {
    for i in 0..out.len() {
        out[i] = exp(beta[i].mul_add(azimuth[i], falloff[i] * ln_cos[i]));
    }
}

/// Residuals of model values against targets, and their derivatives, times the roots of weights; the sum of squares.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn residuals(
    (loss, offset): (Loss, f64),
    [model, target, root]: [&[f64]; 3],
    residual: &mut [f64],
    weight: &mut [f64],
) -> f64 {
    for i in 0..residual.len() {
        let (r, d) = loss.residual(model[i], target[i], offset);
        // Nothing is said of what is not measured
        let root = root[i];
        residual[i] = if root > 0.0 { r * root } else { 0.0 };
        weight[i] = if root > 0.0 { d * root } else { 0.0 };
    }
    dot_lanes(residual, residual)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_lobe(value: &[f64], factor: &[f64], sum: &mut [f64]) {
    for ((sum, value), factor) in sum.iter_mut().zip(value).zip(factor) {
        *sum = value.mul_add(*factor, *sum);
    }
}

/// Derivatives of a residual by `ln kappa`, `ln gamma`, beta and falloff of a lobe, one after another.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn columns(
    weight: &[f64],
    [azimuth, ln_cos]: [&[f64]; 2],
    factor: &[f64],
    value: &[f64],
    slope: &[f64],
    exponent: &[f64],
    columns: &mut [f64],
) {
    let n = value.len();
    let stride = columns.len() / SHARED.len();
    let (by_kappa, rest) = columns.split_at_mut(stride);
    let (by_gamma, rest) = rest.split_at_mut(stride);
    let (by_beta, by_falloff) = rest.split_at_mut(stride);
    let (by_kappa, by_gamma) = (&mut by_kappa[..n], &mut by_gamma[..n]);
    let (by_beta, by_falloff) = (&mut by_beta[..n], &mut by_falloff[..n]);
    for i in 0..n {
        let w = weight[i] * factor[i];
        let d = w * slope[i];
        by_kappa[i] = d;
        by_gamma[i] = d * exponent[i];
        by_beta[i] = w * value[i] * azimuth[i];
        by_falloff[i] = w * value[i] * ln_cos[i];
    }
}

/// Adds each of the columns (column, stride) times the residuals to `sums` (column, position).
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_times(columns: &[f64], stride: usize, residual: &[f64], sums: &mut [f64]) {
    for (column, sums) in columns.chunks_exact(stride).zip(sums.chunks_exact_mut(residual.len())) {
        for ((sum, c), r) in sums.iter_mut().zip(column).zip(residual) {
            *sum = c.mul_add(*r, *sum);
        }
    }
}

/// Two vectors of eight, so that sums wait less for each other.
const LANES: usize = 16;

/// The sum of products, to be inlined where vectors are as wide as the machine's.
#[inline(always)]
pub fn dot_lanes(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (xs, ys) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest = xs.remainder().iter().zip(ys.remainder());
    for (x, y) in xs.clone().zip(ys.clone()) {
        for lane in 0..LANES {
            sums[lane] = x[lane].mul_add(y[lane], sums[lane]);
        }
    }
    for (sum, (x, y)) in sums.iter_mut().zip(rest) {
        *sum = x.mul_add(*y, *sum);
    }
    let eight: [f64; 8] = std::array::from_fn(|i| sums[i] + sums[i + 8]);
    let four: [f64; 4] = std::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    dot_lanes(x, y)
}

/// Adds the products of all pairs of columns (column, stride) to the lower triangle of `squares`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn products(columns: &[f64], stride: usize, squares: &mut [f64]) {
    let width = columns.len() / stride;
    for i in 0..width {
        let x = &columns[i * stride..(i + 1) * stride];
        for (square, y) in squares[i * width..=i * width + i].iter_mut().zip(columns.chunks_exact(stride)) {
            *square += dot_lanes(x, y);
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::observations::Given;
    use crate::shape::Sizes;

    pub const SIZES: Sizes = Sizes { scale: 5, gamma: 3, beta: 2, falloff: 1, colour: 2 };

    pub fn shape(n_lobes: usize, n_channels: usize) -> Shape {
        Shape { n_lobes, n_channels, sizes: SIZES }
    }

    /// Positions over the hemisphere with two nodes, and made-up values.
    pub fn observations(n: usize, n_channels: usize) -> Observations {
        let unit = |i: usize, k: usize| ((i * 7919 + k * 104_729) as f64 * 0.618_033_988_749_894_9).fract();
        let theta: Vec<f64> = (0..n).map(|i| 1.4 * unit(i, 1).powi(2) + 0.01).collect();
        let x: Vec<f64> = (0..n).map(|i| unit(i, 2)).collect();
        let wide = |k: usize| -> Vec<f64> { (0..n * 2 * n_channels).map(|i| unit(i, k)).collect() };
        let node = |k: usize| -> Vec<f64> { (0..n * 2).map(|i| unit(i, k)).collect() };
        let given = Given {
            ln_cos: &theta.iter().map(|t| t.cos().ln()).collect::<Vec<_>>(),
            x: &x,
            azimuth: &node(3).iter().map(|a| 2.0 * a - 1.0).collect::<Vec<_>>(),
            value: &wide(4),
            weight: &wide(5),
        };
        Observations::new(&given, 2, n_channels)
    }

    const PENALTY: Penalty = Penalty { bend: 0.3, slope: 0.2, size: 0.1 };

    #[test]
    fn gradient_equals_differences() {
        let mut observations = observations(400, 3);
        // Some colours are above the height that samples allow
        (observations.is_scattered, observations.brightest) = (true, 0.4);
        let shape = shape(2, 3);
        let p = shape.n_unknowns();
        let x: Vec<f64> = (0..p).map(|i| ((i * 31 + 7) as f64 * 0.618_033_988).fract() - 0.3).collect();
        for loss in [Loss::Log, Loss::Gamma, Loss::L2] {
            let mut problem = Problem::new(&observations, shape.clone(), loss, &[0.01; 3], PENALTY, None);
            problem.precision = 50.0;
            problem.cost(&x);
            let mut equations = problem.equations();
            problem.linearise(&mut equations);
            for i in 0..p {
                let mut shifted = |by: f64| {
                    let mut x = x.clone();
                    x[i] += by;
                    problem.cost(&x)
                };
                let h = 1e-4;
                let want =
                    (8.0 * (shifted(h) - shifted(-h)) - (shifted(2.0 * h) - shifted(-2.0 * h))) / (12.0 * h);
                let got = equations.gradient[i];
                assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{loss:?} {i}: {got} {want}");
            }
        }
    }

    #[test]
    fn hessian_is_that_of_differences_of_residuals() {
        let observations = observations(6000, 2);
        let shape = shape(2, 2);
        let p = shape.n_unknowns();
        let x: Vec<f64> = (0..p).map(|i| ((i * 17 + 3) as f64 * 0.618_033_988).fract() - 0.3).collect();
        let none = Penalty { bend: 0.0, slope: 0.0, size: 0.0 };
        let mut problem = Problem::new(&observations, shape, Loss::Log, &[0.01; 2], none, None);
        problem.cost(&x);
        let mut equations = problem.equations();
        problem.linearise(&mut equations);
        let full = equations.dense();
        let mut rows = |i: usize, by: f64| -> Vec<f64> {
            let mut x = x.clone();
            x[i] += by;
            problem.cost(&x);
            problem.bins.iter().flat_map(|bin| bin.residual.clone()).collect()
        };
        let columns: Vec<Vec<f64>> = (0..p)
            .map(|i| rows(i, 1e-5).iter().zip(rows(i, -1e-5)).map(|(a, b)| (a - b) / 2e-5).collect())
            .collect();
        for i in 0..p {
            for j in 0..p {
                let want: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
                let scale = (full[i * p + i] * full[j * p + j]).sqrt();
                // Within a bin the curves' functions are those of its middle
                assert!((full[i * p + j] - want).abs() < 0.02 * scale, "{i} {j}: {} {want}", full[i * p + j]);
            }
        }
    }
}
