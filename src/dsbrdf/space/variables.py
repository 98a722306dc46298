"""What the numbers of a space are: a row for each lobe, in which equal differences look about alike.

A row holds coefficients of curves over x = cos(theta_d), as `dsbrdf.model.lobes.Lobes` does, each through a function
that can be undone:

- height: `ln(expm1(kappa) + e)`, e = `DARK`, the mean over channels. Equal differences are equal ratios of
  reflectance, and it is nearly constant where a lobe cannot be seen, below 0.001/sr. The logarithm of kappa itself has
  neither: a highlight would change its colour on the way to another one of the same colour.
- gamma: `ln(1 + gamma)`, nearly constant about gamma = 0.
- beta and falloff as they are.
- colour: what each channel adds to the height.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.lobes import FALLOFF, MAX_BETA, MAX_LN_KAPPA, Lobes, curve_design

__all__ = ["DARK", "Rows", "Sizes", "Variables", "resized"]

Array = NDArray[np.float64]

#: Heights below are hardly seen, 1/sr.
DARK = 1e-3
#: Least and greatest height of a lobe, 1/sr.
HEIGHT = (1e-13, 1e13)
#: Least and greatest gamma: flat, and a mirror.
GAMMA = (1e-6, 1e6)
#: Where the unknowns of a prior end: the kappa of a lobe that adds next to nothing, and a gamma that is hardly seen.
LEAST_KAPPA, FLAT = 1e-5, 0.05
#: A lobe that is nowhere higher is left out of a model, 1/sr.
ABSENT = 1e-7
#: Angles theta_d of integrals over them.
N_ANGLES = 720
#: Dark parts of a lobe count so much, compared to bright ones, where a curve is made one of fewer coefficients; and its
#: logarithm is followed so far below that of `DARK`.
LEAST_WEIGHT, DARKER = 0.01, 2.0


class Sizes(NamedTuple):
    """Coefficients of each curve of a lobe in the estimator; a space has as many for colours as for heights."""

    scale: int = 6
    gamma: int = 4
    beta: int = 3
    falloff: int = 1
    colour: int = 2


class Rows(NamedTuple):
    """Parts of rows (..., number).

    Parameters
    ----------
    height, gamma, beta, falloff : (..., coefficient) ndarray
    colour : (..., channel, coefficient) ndarray
    """

    height: Array
    gamma: Array
    beta: Array
    falloff: Array
    colour: Array


@dataclass(frozen=True)
class Variables:
    """Rows of numbers of lobes.

    Parameters
    ----------
    sizes : Sizes
    n_channels : int

    Raises
    ------
    ValueError
        If a size is not positive.
    """

    sizes: Sizes
    n_channels: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", Sizes(*map(int, self.sizes)))
        if min(self.sizes) < 1 or self.n_channels < 1:
            raise ValueError(
                f"curves must have a coefficient at least, and models a channel, got sizes {tuple(self.sizes)} and "
                f"{self.n_channels} channels."
            )

    @property
    def n_numbers(self) -> int:
        """Numbers of a lobe."""
        return sum(self.sizes[:4]) + self.n_channels * self.sizes.scale

    @property
    def dark(self) -> float:
        """The height of a lobe that is not there."""
        return float(np.log(DARK))

    def parts(self, rows: Array) -> Rows:
        """Views of rows (..., number)."""
        ends = np.cumsum(self.sizes[:4])
        height, gamma, beta, falloff, colour = np.split(rows, ends, axis=-1)
        return Rows(height, gamma, beta, falloff, colour.reshape(*rows.shape[:-1], self.n_channels, -1))

    def joined(self, parts: Rows) -> Array:
        """Rows (..., number) of parts."""
        colour = parts.colour.reshape(*parts.height.shape[:-1], -1)
        return np.concatenate([*parts[:4], colour], axis=-1)

    def of(self, lobes: Lobes) -> Array:
        """Rows (lobe, number) of lobes; curves of more coefficients become the nearest of those of the space."""
        lobes, sizes = lobes.numpy, self.sizes
        ln_kappa = _ln_kappa(lobes, sizes.scale)
        # The curve of a bright lobe that ends in the dark has no say there
        height = np.log(np.expm1(np.exp(np.minimum(ln_kappa, MAX_LN_KAPPA))) + DARK)
        height = np.minimum(height, np.log(HEIGHT[1])).swapaxes(0, 1)
        mean = height.mean(1)
        gamma = np.logaddexp(0.0, np.minimum(resized(lobes.gamma, sizes.gamma), np.log(GAMMA[1])))
        beta, falloff = resized(lobes.beta, sizes.beta), resized(lobes.falloff, sizes.falloff)
        return self.joined(Rows(mean, gamma, beta, falloff, height - mean[:, None]))

    def lobes(self, rows: Array) -> Lobes:
        """Lobes of rows (lobe, number), within their ranges; without those that are dark, if there is another."""
        height, gamma, beta, falloff, colour = self.parts(rows)
        heights = np.exp(np.minimum(height[:, None] + colour, np.log(HEIGHT[1]))) - DARK
        seen = heights.max((1, 2)) > ABSENT
        seen |= ~seen.any()
        ln_kappa = np.log(np.log1p(np.clip(heights[seen], *HEIGHT)))
        scale = ln_kappa.mean(1)
        return Lobes(
            scale,
            np.log(np.expm1(np.clip(gamma[seen], GAMMA[0], np.log1p(GAMMA[1])))),
            np.clip(beta[seen], -MAX_BETA, MAX_BETA),
            np.clip(falloff[seen], *FALLOFF),
            np.ascontiguousarray((ln_kappa - scale[:, None]).swapaxes(0, 1)),
        )

    def unknowns(self, rows: Array) -> Array:
        """Unknowns (..., unknown) of the estimator for rows (..., lobe, number).

        For each lobe scale, gamma, beta and falloff, then for each channel, for each lobe, its colour; one channel has
        none. The logarithms of kappa and of gamma end at `LEAST_KAPPA` and `FLAT`, so that what cannot be seen varies
        little.
        """
        height, gamma, beta, falloff, colour = self.parts(rows)
        kappa = np.log1p(np.maximum(np.exp(height[..., None, :] + colour) - DARK, 0.0))
        ln_kappa = np.log(kappa + LEAST_KAPPA)
        scale = ln_kappa.mean(-2)
        ln_gamma = np.log(np.maximum(np.expm1(gamma), 0.0) + FLAT)
        shared = np.concatenate([scale, ln_gamma, beta, falloff], axis=-1)
        flat = shared.reshape(*rows.shape[:-2], -1)
        if self.n_channels == 1:
            return flat
        seen = _seen(kappa.mean(-2))
        lines = np.moveaxis(_weighted(ln_kappa - scale[..., None, :], seen, self.sizes.colour), -2, -3)
        return np.concatenate([flat, lines.reshape(*rows.shape[:-2], -1)], axis=-1)

    def metric(self, sharpness: float) -> Array:
        """Inner product (number, number) of rows of lobes of about this sharpness.

        The mean over theta_d, and of colours also that over channels. A falloff counts by what it does where the lobe
        is still seen: little where the lobe is sharp.
        """
        grams = [gram(size) for size in self.sizes[:4]]
        grams[3] = grams[3] * np.exp(-2.0 * sharpness)
        grams += [gram(self.sizes.scale) / self.n_channels] * self.n_channels
        metric = np.zeros((self.n_numbers, self.n_numbers))
        at = 0
        for block in grams:
            end = at + len(block)
            metric[at:end, at:end] = block
            at = end
        return metric

    def sharpness(self, rows: Array) -> Array:
        """The mean (...) over theta_d of `ln(1 + gamma)` of rows (..., number): linear, and so in order in blends."""
        sharpness: Array = self.parts(rows).gamma @ gram(self.sizes.gamma).sum(0)
        return sharpness


def gram(size: int) -> Array:
    """Means (coefficient, coefficient) over theta_d of products of a curve's functions."""
    design = curve_design(_angles(), size)
    product: Array = design.T @ design / len(design)
    return product


def _angles() -> Array:
    """cos(theta_d) at even theta_d."""
    return np.cos(np.pi / 2 * (np.arange(N_ANGLES) + 0.5) / N_ANGLES)


def resized(coefficients: Array, size: int) -> Array:
    """Curves (..., coefficient) as the nearest ones of `size` coefficients; exactly, where these can."""
    if coefficients.shape[-1] == size:
        return coefficients
    x = _angles()
    values = coefficients @ curve_design(x, coefficients.shape[-1]).T
    nearest = np.asarray(
        np.linalg.lstsq(curve_design(x, size), values.reshape(-1, len(x)).T)[0].T, np.float64
    )
    return nearest.reshape(*coefficients.shape[:-1], size)


def _ln_kappa(lobes: Lobes, size: int) -> Array:
    """Curves (channel, lobe, coefficient) of `ln(kappa)`."""
    given = lobes.scale.shape[1], lobes.colour.shape[2]
    if all(n == size or n <= min(size, 3) for n in given):
        return resized(lobes.scale, size) + resized(lobes.colour, size)
    x = _angles()
    scale, colour = (
        coefficients @ curve_design(x, n).T
        for coefficients, n in zip((lobes.scale, lobes.colour), given, strict=True)
    )
    ln_kappa = scale + colour
    # Where a lobe is dark, its kappa must not bend the rest of the curve
    weight = np.sqrt(_seen(np.exp(np.minimum(ln_kappa, MAX_LN_KAPPA)).mean(0)))
    design = curve_design(x, size)
    curves = np.empty((*ln_kappa.shape[:2], size))
    for k, w in enumerate(weight):
        target = w * np.maximum(ln_kappa[:, k], np.log(DARK) - DARKER)
        curves[:, k] = np.linalg.lstsq(w[:, None] * design, target.T)[0].T
    return curves


def _seen(kappa: Array) -> Array:
    """Weights of parts of a lobe: next to nothing where it is dark."""
    weight: Array = np.maximum(kappa / (kappa + DARK), LEAST_WEIGHT)
    return weight


def _weighted(curves: Array, weights: Array, size: int) -> Array:
    """Curves (..., channel, coefficient) as the nearest of `size`; weights (..., coefficient) are a curve too."""
    x = _angles()[:: N_ANGLES // 90]
    wide, narrow = curve_design(x, curves.shape[-1]), curve_design(x, size)
    weight = weights @ wide.T
    normal = np.einsum("...t,ti,tj->...ij", weight, narrow, narrow)
    right = np.einsum("...t,ti,tj,...cj->...ic", weight, narrow, wide, curves)
    nearest: Array = np.linalg.solve(normal, right)
    return nearest.swapaxes(-1, -2)
