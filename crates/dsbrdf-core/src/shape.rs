//! The layout of the unknowns: how many lobes, and how many coefficients each of their curves has.

use crate::basis::Basis;

/// Coefficients of each curve of a lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Of `ln kappa`, common to the channels.
    pub scale: usize,
    /// Of `ln gamma`.
    pub gamma: usize,
    /// Of beta.
    pub beta: usize,
    /// Of the falloff.
    pub falloff: usize,
    /// Of what each channel adds to `ln kappa`; one channel has none.
    pub colour: usize,
}

/// Unknowns in this order: for each lobe scale, gamma, beta and falloff; then for each channel, for each lobe, its colour.
#[derive(Clone, Debug)]
pub struct Shape {
    pub n_lobes: usize,
    pub n_channels: usize,
    pub sizes: Sizes,
}

/// Curves of a lobe, as they are numbered here.
pub const SCALE: usize = 0;
pub const GAMMA: usize = 1;
pub const BETA: usize = 2;
pub const FALLOFF: usize = 3;
pub const COLOUR: usize = 4;
pub const CURVES: usize = 5;
/// Those that all channels share.
pub const SHARED: [usize; 4] = [SCALE, GAMMA, BETA, FALLOFF];

impl Shape {
    #[must_use]
    pub fn basis(&self, curve: usize) -> Basis {
        let Sizes { scale, gamma, beta, falloff, colour } = self.sizes;
        Basis { size: [scale, gamma, beta, falloff, colour][curve] }
    }

    /// Coefficients of the colour of a lobe in a channel.
    #[must_use]
    pub fn n_colour(&self) -> usize {
        if self.n_channels > 1 { self.sizes.colour } else { 0 }
    }

    fn a_lobe(&self) -> usize {
        SHARED.iter().map(|&curve| self.basis(curve).size).sum()
    }

    /// Unknowns that all channels share.
    #[must_use]
    pub fn n_shared(&self) -> usize {
        self.n_lobes * self.a_lobe()
    }

    #[must_use]
    pub fn n_block(&self) -> usize {
        self.n_lobes * self.n_colour()
    }

    #[must_use]
    pub fn n_unknowns(&self) -> usize {
        self.n_shared() + self.n_channels * self.n_block()
    }

    /// First unknown of a shared curve of lobe `k`.
    #[must_use]
    pub fn shared(&self, curve: usize, k: usize) -> usize {
        k * self.a_lobe() + SHARED[..curve].iter().map(|&before| self.basis(before).size).sum::<usize>()
    }

    /// First unknown of the colour of lobe `k` in a channel.
    #[must_use]
    pub fn colour(&self, channel: usize, k: usize) -> usize {
        self.n_shared() + channel * self.n_block() + k * self.n_colour()
    }

    /// Every curve: which it is, and its first unknown.
    pub fn curves(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let shared = (0..self.n_lobes).flat_map(move |k| SHARED.map(|curve| (curve, self.shared(curve, k))));
        let colours = (0..self.n_channels)
            .flat_map(move |c| (0..self.n_lobes).map(move |k| (COLOUR, self.colour(c, k))));
        shared.chain(colours.filter(|_| self.n_colour() > 0))
    }
}
