//! What is fitted: values at positions (theta_h, theta_d), a few azimuths at each.
//!
//! A scattered sample is a position with one azimuth. A cell of a table is one with three: three values at three azimuths have
//! the same count, means, variance and covariance over phi_d as all of its entries, and so the same least squares.

/// Observations at `n` positions, `n_nodes` azimuths each, ascending in x.
pub struct Observations {
    pub n_nodes: usize,
    pub n_channels: usize,
    /// `ln cos(theta_h)` and `cos(theta_d)` of each position.
    pub ln_cos: Vec<f64>,
    pub x: Vec<f64>,
    /// (node, position): azimuthal factor times cos(2 phi_d).
    pub azimuth: Vec<f64>,
    /// (node, channel, position): value, and weight; weights add up to one.
    pub value: Vec<f64>,
    pub weight: Vec<f64>,
    /// The greatest value, also of positions that were thinned away.
    pub brightest: f64,
    /// Whether these are scattered samples, between which a lobe may hide.
    pub is_scattered: bool,
}

/// The arrays of [`Observations::new`], (position,), (position, node) and (position, node, channel).
pub struct Given<'a> {
    pub ln_cos: &'a [f64],
    pub x: &'a [f64],
    pub azimuth: &'a [f64],
    pub value: &'a [f64],
    pub weight: &'a [f64],
}

impl Observations {
    /// Sorts what is given; positions without weight are left out.
    #[must_use]
    pub fn new(given: &Given, n_nodes: usize, n_channels: usize) -> Self {
        let width = n_nodes * n_channels;
        let mut order: Vec<usize> = (0..given.x.len())
            .filter(|&i| given.weight[i * width..(i + 1) * width].iter().any(|&w| w > 0.0))
            .collect();
        order.sort_by(|&i, &j| {
            (given.x[i], given.ln_cos[i]).partial_cmp(&(given.x[j], given.ln_cos[j])).expect("finite angles")
        });
        let one = |from: &[f64]| order.iter().map(|&i| from[i]).collect();
        let all = |from: &[f64], width: usize| -> Vec<f64> {
            (0..width).flat_map(|at| order.iter().map(move |&i| from[i * width + at])).collect()
        };
        let mut weight = all(given.weight, n_nodes * n_channels);
        let total: f64 = weight.iter().sum();
        weight.iter_mut().for_each(|w| *w /= total);
        let value = all(given.value, n_nodes * n_channels);
        let brightest =
            value.iter().zip(&weight).filter(|(_, w)| **w > 0.0).map(|(&f, _)| f).fold(0.0, f64::max);
        Self {
            n_nodes,
            n_channels,
            ln_cos: one(given.ln_cos),
            x: one(given.x),
            azimuth: all(given.azimuth, n_nodes),
            value,
            weight,
            brightest,
            is_scattered: n_nodes == 1,
        }
    }

    #[must_use]
    pub fn len(&self) -> usize {
        self.x.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Where the (node, channel) rows of all positions begin.
    #[must_use]
    pub fn row(&self, node: usize, channel: usize) -> usize {
        (node * self.n_channels + channel) * self.len()
    }

    /// About `n` of the positions, spread over x and theta_h as all are, with one azimuth each: by turns the first, the
    /// second and so on.
    #[must_use]
    pub fn thinned(&self, n: usize) -> Self {
        let step = self.len().div_ceil(n.max(1)).max(1);
        // Even steps through strips of x, within which positions go by theta_h
        let strip = (64 * step).min(self.len().max(1));
        let mut order: Vec<usize> = (0..self.len()).collect();
        for strip in order.chunks_mut(strip) {
            strip.sort_by(|&i, &j| self.ln_cos[i].total_cmp(&self.ln_cos[j]).then(i.cmp(&j)));
        }
        // (position, its azimuth)
        let mut kept: Vec<(usize, usize)> = order
            .into_iter()
            .skip(step / 2)
            .step_by(step)
            .enumerate()
            .map(|(turn, i)| (i, turn % self.n_nodes))
            .collect();
        kept.sort_unstable();
        let one = |from: &[f64]| kept.iter().map(|&(i, _)| from[i]).collect();
        let all = |from: &[f64]| -> Vec<f64> {
            (0..self.n_channels)
                .flat_map(|c| kept.iter().map(move |&(i, node)| from[self.row(node, c) + i]))
                .collect()
        };
        let mut weight = all(&self.weight);
        let total: f64 = weight.iter().sum();
        weight.iter_mut().for_each(|w| *w /= total);
        Self {
            n_nodes: 1,
            n_channels: self.n_channels,
            ln_cos: one(&self.ln_cos),
            x: one(&self.x),
            azimuth: kept.iter().map(|&(i, node)| self.azimuth[node * self.len() + i]).collect(),
            value: all(&self.value),
            weight,
            brightest: self.brightest,
            is_scattered: self.is_scattered,
        }
    }
}
