"""What materials are like, as a Gaussian process over the logarithm of reflectance, and what it says, given values.

The materials of a space are functions of a pair of directions and a channel. On the scale `t = asinh(f / 2 OFFSET)`, a
logarithm, they have a mean m and a covariance, and a new material is::

    t = m + sum_j c_j (t_j - m) / sqrt(n - 1) + e,    c_j ~ N(0, scale^2),  e ~ N(0, noise^2) at each pair and channel

so that given values decide the coefficients c by linear regression (Rasmussen and Williams 2006, chapter 2; Nielsen et
al. 2015 have such a regression on principal components). What no combination of materials describes, and the noise of
the measurement, is e. `scale` and `noise` are those that make the values most probable: materials of another kind make
both large, and the deviations of what is expected with them. They never make them smaller than those of the materials
of the space: a few values can be met more closely than all others. As e is in truth alike at pairs near each other,
many values count as `WORTH` independent ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf._brief import Brief
from dsbrdf.geometry import half_diff
from dsbrdf.model.lobes import MAX_LN_KAPPA, curve_design

if TYPE_CHECKING:
    from dsbrdf.model.lobes import Lobes
    from dsbrdf.space.material_space import MaterialSpace
    from dsbrdf.space.variables import Sizes

__all__ = ["OFFSET", "Expectation", "Positions", "Process", "scaled", "support", "unscaled"]

Array = NDArray[np.float64]

#: Reflectances well below twice this are hardly told apart, 1/sr.
OFFSET = 5e-4
#: Usual deviation of a material from a combination of others: the median error of the models of a library. And how much
#: it, and the scale of the coefficients, vary: standard deviations of their logarithms.
NOISE, SPREAD_OF_NOISE, SPREAD_OF_SCALE = 0.06, 0.7, 0.5
SCALES = np.geomspace(1.0, 4.0, 9)
NOISES = np.geomspace(NOISE, 1.0, 16)
#: Values count as so many at most: what no combination of materials describes is alike at pairs near each other.
WORTH = 240
#: Pairs handled together.
CHUNK = 500
#: Most rows of a regression.
MAX_ROWS = 3000
#: Angles of the directions that stand for all: theta_h, whose roots are even, theta_d and phi_d, up to so far from the
#: normal.
N_THETA_H, N_THETA_D, N_PHI_D = 12, 8, 3
SUPPORT_LIMIT = np.deg2rad(85.0)


class Positions(NamedTuple):
    """Pairs of directions as the model takes them, (n,) each.

    Parameters
    ----------
    log_cos : ndarray
        `ln cos(theta_h)`.
    x : ndarray
        `cos(theta_d)`.
    azimuth : ndarray
        Azimuthal factor times `cos(2 phi_d)`.
    """

    log_cos: Array
    x: Array
    azimuth: Array

    @classmethod
    def of_angles(cls, theta_h: Array, theta_d: Array, phi_d: Array) -> Positions:
        """Positions at angles (n,) in radians."""
        azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
        return cls(half_diff.log_cos(theta_h), np.cos(theta_d), azimuth)

    @classmethod
    def of_directions(cls, wi: ArrayLike, wo: ArrayLike) -> Positions:
        """Positions of pairs of unit vectors (n, 3)."""
        return cls.of_angles(*half_diff.from_directions(wi, wo))

    def take(self, which: slice) -> Positions:
        """Some of them."""
        return Positions(*(part[which] for part in self))


def scaled(values: Array) -> Array:
    """Values in 1/sr on the scale of the process."""
    return np.arcsinh(values / (2.0 * OFFSET))


def unscaled(scaled: Array) -> Array:
    """Values in 1/sr, not negative, of those on the scale of the process."""
    return np.maximum(2.0 * OFFSET * np.sinh(scaled), 0.0)


@cache
def support() -> tuple[Positions, Array]:
    """Pairs of directions that stand for all, and their weights (n,), which add up to one.

    Half of the weight is even over pairs of directions, half over the angles, so that peaks count.
    """
    theta_h = (np.pi / 2) * ((np.arange(N_THETA_H) + 0.3) / N_THETA_H) ** 2
    theta_d = (np.pi / 2) * (np.arange(N_THETA_D) + 0.5) / N_THETA_D
    phi_d = (np.pi / 2) * (np.arange(N_PHI_D) + 0.5) / N_PHI_D
    h, d, p = (grid.ravel() for grid in np.meshgrid(theta_h, theta_d, phi_d, indexing="ij"))
    wi, wo = half_diff.to_directions(h, d, p)
    seen = (wi[:, 2] > np.cos(SUPPORT_LIMIT)) & (wo[:, 2] > np.cos(SUPPORT_LIMIT))
    h, d, p = h[seen], d[seen], p[seen]
    # d wi d wo = 4 cos(theta_d) d omega_h d omega_d, and roots of theta_h are even
    area = np.sin(h) * np.sqrt(h) * np.sin(d) * np.cos(d)
    return Positions.of_angles(h, d, p), 0.5 * area / area.sum() + 0.5 / len(h)


@dataclass(frozen=True, eq=False, repr=False)
class Process(Brief):
    """The materials of a space as a Gaussian process.

    Parameters
    ----------
    lobes : Lobes
        All lobes of all materials.
    starts : (material,) ndarray of int
        First lobe of each material.
    unknowns : (material, unknown) ndarray
        Of the estimator, for each material.
    sizes : Sizes
        Coefficients of the curves of a lobe, among the unknowns.
    n_lobes : int
        Of the unknowns.
    """

    lobes: Lobes
    starts: NDArray[np.int_]
    unknowns: Array
    sizes: Sizes
    n_lobes: int

    @classmethod
    def of_space(cls, space: MaterialSpace) -> Process:
        """The process of the materials of a space."""
        variables = space.variables
        each = [variables.lobes(rows) for rows in space.curves]
        parts = (
            np.concatenate(parts, axis=-2) for parts in zip(*(lobes.parts for lobes in each), strict=True)
        )
        starts = np.cumsum([0, *(lobes.n_lobes for lobes in each[:-1])])
        unknowns = variables.unknowns(space.curves)
        return cls(type(each[0])(*parts), starts, unknowns, variables.sizes, space.n_slots)

    @property
    def n_materials(self) -> int:
        """Number of materials."""
        return len(self.starts)

    @cached_property
    def at_support(self) -> tuple[Array, Array]:
        """`at` of the directions that stand for all."""
        return self.at(support()[0])

    def values(self, positions: Positions) -> Array:
        """Values (material, n, channel) in 1/sr at positions (n,)."""
        lobes = self.lobes
        value = np.empty((self.n_materials, len(positions.x), lobes.n_channels))
        for start in range(0, len(positions.x), CHUNK):
            part = slice(start, start + CHUNK)
            log_cos, x, azimuth = positions.take(part)
            scale, gamma, beta, falloff = (
                curve @ curve_design(x, curve.shape[1]).T for curve in lobes.parts[:4]
            )
            colour = lobes.colour @ curve_design(x, lobes.colour.shape[2]).T
            exponent = np.exp(gamma) * log_cos
            factor = np.exp(beta * azimuth + falloff * log_cos)
            power = np.exp(np.minimum(scale + colour, MAX_LN_KAPPA) + exponent)
            of_lobes = np.expm1(power) * factor
            value[:, part] = np.moveaxis(np.add.reduceat(of_lobes, self.starts, axis=1), 0, -1)
        return value

    def at(self, positions: Positions) -> tuple[Array, Array]:
        """The mean (n, channel), and what each material adds to it (material, n, channel)."""
        values = scaled(self.values(positions))
        mean = values.mean(0)
        return mean, (values - mean) / np.sqrt(self.n_materials - 1)

    def given(self, positions: Positions, values: Array, weights: Array) -> Expectation:
        """What is expected of a material with these values.

        Parameters
        ----------
        positions : Positions
        values : (n, channel) ndarray, 1/sr
        weights : (n, channel) ndarray
            Zero where there is no value; otherwise in proportion to the inverse variance of relative errors.
        """
        step = -(-values.size // MAX_ROWS)
        some = slice(step // 2, None, step)
        mean, added = self.at(positions.take(some))
        weights = weights[some]
        valid = weights > 0.0
        counted = min(1.0, WORTH / max(int(valid.sum()), 1))
        root = np.sqrt(counted * weights[valid] / weights[valid].mean())
        target = root * (scaled(values[some]) - mean)[valid]
        left, singular, right = np.linalg.svd(root * added[:, valid], full_matrices=False)
        along = right @ target
        # The values along the materials, and what they leave
        rest = max(float(target @ target - along @ along), 0.0)
        n_rest = max(counted * target.size - along.size, 0.0)
        scales, noises = SCALES[:, None, None], NOISES[:, None]
        variance = (scales * singular) ** 2 + noises**2
        evidence = -0.5 * (along**2 / variance + np.log(variance)).sum(-1)
        evidence -= 0.5 * (rest / NOISES**2 + n_rest * np.log(NOISES**2))
        evidence -= 0.5 * (np.log(SCALES)[:, None] / SPREAD_OF_SCALE) ** 2
        evidence -= 0.5 * (np.log(NOISES / NOISE) / SPREAD_OF_NOISE) ** 2
        i, j = np.unravel_index(evidence.argmax(), evidence.shape)
        scale, noise = float(SCALES[i]), float(NOISES[j])
        share = (scale * singular) ** 2 / variance[i, j]
        coefficients = left @ (share * along / np.maximum(singular, 1e-300))
        return Expectation(self, coefficients, left, share, scale, noise)

    @property
    def unmeasured(self) -> Expectation:
        """What is expected of a material of which nothing is known."""
        nothing = np.empty((self.n_materials, 0))
        return Expectation(self, np.zeros(self.n_materials), nothing, np.empty(0), 1.0, NOISE)


@dataclass(frozen=True, eq=False, repr=False)
class Expectation(Brief):
    """What a space expects of a material, given values of it.

    Parameters
    ----------
    process : Process
    coefficients : (material,) ndarray
        What each material adds.
    decided : (material, direction) ndarray
        Orthonormal combinations of the materials that the values speak of.
    share : (direction,) ndarray
        How far the values decide each of them, 0 to 1.
    scale, noise : float
        Of the coefficients before the values, and of what the materials do not describe.
    """

    process: Process
    coefficients: Array
    decided: Array
    share: Array
    scale: float
    noise: float

    @property
    def n_decided(self) -> float:
        """How many numbers the values decided."""
        return float(self.share.sum())

    @property
    def unknowns(self) -> Array:
        """Unknowns (unknown,) of the estimator: the same combination of those of the materials."""
        unknowns, n = self.process.unknowns, self.process.n_materials
        mean = unknowns.mean(0)
        start: Array = mean + self.coefficients @ (unknowns - mean) / np.sqrt(n - 1)
        return start

    def mean(self, at: tuple[Array, Array]) -> Array:
        """What is expected (n, channel), on the scale of the process, where the process has `at`."""
        mean, added = at
        return np.asarray(mean + np.tensordot(self.coefficients, added, 1))

    def factor(self, added: Array) -> Array:
        """`F` (material, n, channel) such that `F^T F` is the covariance of what is expected, without `noise`."""
        along = np.tensordot(self.decided.T, added, 1)
        kept = (1.0 - np.sqrt(np.maximum(1.0 - self.share, 0.0)))[:, None, None]
        return np.asarray(self.scale * (added - np.tensordot(self.decided, kept * along, 1)))

    @property
    def covariance(self) -> Array:
        """Covariance (material, material) of the coefficients."""
        known = self.decided * self.share
        covariance: Array = self.scale**2 * (np.eye(len(self.coefficients)) - known @ self.decided.T)
        return covariance

    def deviation(self, at: tuple[Array, Array]) -> Array:
        """Standard deviation (n, channel) of a value, on the scale of the process, what no material does included."""
        variance: Array = (self.factor(at[1]) ** 2).sum(0) + self.noise**2
        return np.sqrt(variance)
