"""Material and light of a picture when neither is known: the material first, with the light integrated out.

The best material and light together explain a picture by too sharp a material in too flat a light, the known failure of
joint estimates in blind deconvolution. So the logarithm of the light is a Gaussian process on the sphere, its channels
alike but for a part of each, and materials are compared by the probability of the picture under all such lights.
Those compared are the materials of a space; their mean, by these probabilities, is the material, and the light follows.

With g the logarithm of the light's cells, A the radiance of each pixel per radiance of each cell, and t the logarithm
with an offset, pixels are `t(A exp(g))` and noise. Around a g this is linear; some steps lead to the most probable
light, and Laplace's approximation there gives the probability. Each channel has a free mean: nothing depends on a
factor a channel of the material.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.fitting.estimator import nearest_lobes
from dsbrdf.fitting.observations import Observations
from dsbrdf.fitting.uncertainty import value_jacobian
from dsbrdf.geometry import half_diff, panorama
from dsbrdf.images.linear import AZIMUTHS, NODES
from dsbrdf.images.search import OFFSET, raw_lobes
from dsbrdf.images.view import Points
from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes
from dsbrdf.space import Gaussian, MaterialSpace
from dsbrdf.space.prior import KEPT_SHARE, LEAST_DEVIATION
from dsbrdf.space.process import Positions, scaled, support, unscaled

__all__ = ["Grid", "Guess", "Material", "Scene", "material"]

Array = NDArray[np.float64]

#: Angle, radians, over which the light's correlation falls to 1 / e; standard deviation of its logarithm.
REACH, CONTRAST = 0.35, 1.3
#: Rows of the grid that what cells share is told by.
COARSE = 10
#: Share of the light's variance that its channels have in common; standard deviation of a channel's mean.
COMMON, LEVEL = 0.9, 3.0
#: Noise of the logarithm of a pixel; it stands for what cells are too coarse for too.
NOISE = 0.05
#: Directions along a side of a cell, and up to which angle in degrees between it and where a mirror would look.
PARTS = ((16, 6.0), (8, 14.0), (4, 25.0), (2, 60.0), (1, 180.0))
#: Rows of the light's map; pixels that materials are compared by, and those that tell the light.
ROWS, N_PIXELS, N_LIGHT = 24, 70, 300
#: Power of the probability of a picture that weighs materials: cells and materials are not quite those of the picture,
#: which the noise does not know.
SHARPNESS = 0.1
#: Share of the covariance of all materials that is left in any case.
LEFT = 0.02
#: What the nodes of a mean count as, in observations, and the least cosine of their directions.
N_MEAN, LEAST_COSINE = 300.0, float(np.cos(np.deg2rad(85.0)))
#: Steps to the most probable light, and the longest.
STEPS, LONGEST = 5, 2.0


@dataclass(frozen=True)
class Grid:
    """Cells of an unknown light.

    Parameters
    ----------
    rows : int
        Twice as many columns.
    """

    rows: int

    @cached_property
    def directions(self) -> Array:
        """Toward the middles (cell, 3)."""
        return panorama.directions(self.rows, 2 * self.rows).reshape(-1, 3)

    def parts(self, n: int) -> tuple[Array, Array]:
        """Directions (cell, part, 3) and solid angles (cell, part) of n x n parts of the cells."""
        rows = n * self.rows
        shape = (self.rows, n, 2 * self.rows, n)
        fine = panorama.directions(rows, 2 * rows).reshape(*shape, 3)
        angles = np.broadcast_to(panorama.solid_angles(rows, 2 * rows), (rows, 2 * rows)).reshape(shape)
        cells = 2 * self.rows**2
        return fine.swapaxes(1, 2).reshape(cells, -1, 3), angles.swapaxes(1, 2).reshape(cells, -1)

    @cached_property
    def root(self) -> Array:
        """Root (cell, rank) of the part of the kernel that cells share, by way of a coarse grid (Nystrom)."""
        coarse = panorama.directions(COARSE, 2 * COARSE).reshape(-1, 3)
        lower = np.linalg.cholesky(_kernel(coarse, coarse) + 1e-6 * np.eye(len(coarse)))
        return np.ascontiguousarray(np.linalg.solve(lower, _kernel(coarse, self.directions)).T)

    @cached_property
    def own(self) -> Array:
        """What is left of the variance (cell,) of each cell."""
        return np.asarray(np.maximum(1.0 - (self.root**2).sum(1), 0.0))

    def smoothed(self, values: Array) -> Array:
        """The kernel times values (..., cell)."""
        return np.asarray((values @ self.root) @ self.root.T + values * self.own)


def _kernel(a: Array, b: Array) -> Array:
    """Correlation (n, m) of the light in directions (n, 3) and (m, 3)."""
    return np.asarray(np.exp(-np.arccos(np.clip(a @ b.T, -1.0, 1.0)) / REACH))


@dataclass(frozen=True, eq=False)
class Guess:
    """The most probable light under a material.

    Parameters
    ----------
    evidence : float
        Logarithm of the probability of the pixels under the material, up to a constant.
    residual : (channel, pixel) ndarray
        Differences of logarithms.
    light : (cell, channel) ndarray
        Radiance.
    """

    evidence: float
    residual: Array
    light: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """Some pixels of a picture, and the cells of its light.

    Parameters
    ----------
    points : Points
        One a pixel.
    pixels : (pixel, channel) ndarray
    grid : Grid
    """

    points: Points
    pixels: Array
    grid: Grid

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.int_], Array, Array, Array]:
        """What is above the surface, in frames with the normal as +z: indices (n,) of pixels and cells, directions
        toward the light and the camera (n, 3), and solid angles times cosines (n, 1).

        A cell is taken apart the finer, the nearer it is to where a mirror would look: few directions miss sharp lobes.
        """
        rotation = self.points.frames
        view = np.einsum("pij,pj->pi", rotation, self.points.view)
        mirror = np.einsum("pij,pi->pj", rotation, view * [-1.0, -1.0, 1.0])
        away = np.rad2deg(np.arccos(np.clip(mirror @ self.grid.directions.T, -1.0, 1.0)))
        found, least = [], -1.0
        for n, most in PARTS:
            pixel, cell = np.nonzero((away > least) & (away <= most))
            directions, angles = self.grid.parts(n)
            wi = directions[cell] @ rotation[pixel].swapaxes(1, 2)
            up = wi[..., 2] > 0.0
            part = np.nonzero(up)[0]
            toward = wi[up]
            weight = toward[:, 2] * angles[cell][up]
            found.append(
                (pixel[part] * len(directions) + cell[part], toward, view[pixel[part]], weight[:, None])
            )
            least = most
        index, toward, back, weight = (np.concatenate(each) for each in zip(*found, strict=True))
        return index, toward, back, weight

    def transfer(self, lobes: Lobes) -> Array:
        """Radiance (channel, pixel, cell) of pixels per radiance of cells."""
        index, toward, back, weight = self._pairs
        parts = [np.ascontiguousarray(part) for part in lobes.parts]
        values = _core.eval(
            toward, back, parts[0], parts[1], parts[2], parts[3], parts[4], half_diff.AZIMUTHAL_WIDTH
        )
        shape = (len(self.pixels), 2 * self.grid.rows**2)
        summed = [np.bincount(index, column, shape[0] * shape[1]) for column in (values * weight).T]
        return np.reshape(summed, (-1, *shape))

    def guess(self, transfer: Array) -> Guess:
        """The most probable light under a material that makes this transfer."""
        y = self.pixels.T
        n_channels, n = y.shape
        offset = OFFSET * y.mean(1, keepdims=True)
        target = np.arcsinh(0.5 * y / offset)
        level = np.log(y.sum(1) / np.maximum(transfer.sum((1, 2)), 1e-300))[:, None]
        common = CONTRAST**2 * (COMMON + (1.0 - COMMON) * np.eye(n_channels))
        off = np.zeros((n_channels, transfer.shape[2]))
        for step in range(STEPS + 1):
            of_cell = transfer * np.exp(level + off)[:, None]
            made = of_cell.sum(-1)
            residual = target - np.arcsinh(0.5 * made / offset)
            jacobian = (of_cell / np.hypot(made, 2.0 * offset)[..., None]).reshape(n_channels * n, -1)
            # The covariance of the pixels under the prior of the light
            rough = jacobian @ self.grid.root
            matrix = (rough @ rough.T + (jacobian * self.grid.own) @ jacobian.T).reshape(
                n_channels, n, n_channels, n
            )
            matrix *= common[:, None, :, None]
            sums = jacobian.sum(-1).reshape(n_channels, n)
            for c in range(n_channels):
                matrix[c, :, c] += LEVEL**2 * np.outer(sums[c], sums[c])
            square = matrix.reshape(n_channels * n, -1)
            square[np.diag_indices(n_channels * n)] += NOISE**2
            if step == STEPS:
                break
            by_channel = jacobian.reshape(n_channels, n, -1)
            pulled = residual + (by_channel @ off[..., None])[..., 0]
            alpha = np.linalg.solve(square, pulled.ravel()).reshape(n_channels, n)
            pull = (alpha[:, None] @ by_channel)[:, 0]
            wanted = LEVEL**2 * pull.sum(1)[:, None] + self.grid.smoothed(common @ pull)
            change = wanted - off
            off = off + change * min(1.0, LONGEST / max(float(np.abs(change).max()), 1e-12))
        squares = float((pull * wanted).sum())
        log_det = 2.0 * float(np.log(np.diag(np.linalg.cholesky(square))).sum())
        evidence = -0.5 * (float((residual**2).sum()) / NOISE**2 + squares + log_det)
        return Guess(evidence, residual, np.exp(level + off).T)

    def light(self, lobes: Lobes) -> Array:
        """The most probable light (row, column, channel) under a material."""
        found = self.guess(self.transfer(lobes)).light
        return found.reshape(self.grid.rows, 2 * self.grid.rows, -1)


@dataclass(frozen=True, eq=False)
class Material:
    """The material of a picture, up to a scale a channel.

    Parameters
    ----------
    x : (unknown,) ndarray
    covariance : (unknown, unknown) ndarray
        Of what a scale does not change.
    n_decided : float
        How many of the main components of the materials compared the picture decided.
    """

    x: Array
    covariance: Array
    n_decided: float


def material(scene: Scene, space: MaterialSpace, gaussian: Gaussian) -> Material:
    """The mean of the materials of a space, by how probable they make the pixels."""
    candidates = np.vstack([gaussian.mean, space.variables.unknowns(space.curves)])
    evidence = np.array([scene.guess(scene.transfer(raw_lobes(x, gaussian))).evidence for x in candidates])
    weights = _weights(evidence, SHARPNESS)
    x = _mean(space, weights[1:] + weights[0] / len(space.names), candidates[evidence.argmax()])
    off = (candidates - weights @ candidates) @ _unscaled(x, gaussian).T
    # No combination of so few materials is that of the picture: a part of what they all vary by is left
    covariance = (1.0 - LEFT) * off.T @ (weights[:, None] * off) + LEFT / len(off) * off.T @ off
    return Material(x, covariance, _n_decided(candidates, weights))


def _mean(space: MaterialSpace, weights: Array, start: Array) -> Array:
    """Unknowns (unknown,) of the mean of the materials as functions: as unknowns, their lobes do not correspond."""
    process = space.process
    (log_cos, x), n = NODES.positions, len(AZIMUTHS)
    azimuth = np.tile(AZIMUTHS, (len(x), 1))
    positions = Positions(np.repeat(log_cos, n), np.repeat(x, n), azimuth.ravel())
    mean = unscaled(np.tensordot(weights, scaled(process.values(positions)), 1)).reshape(len(x), n, -1)
    # Nodes whose directions are both well above the horizon: cos_i cos_o of the azimuth, where it is one
    theta_h, theta_d = np.arccos(np.exp(log_cos))[:, None], np.arccos(x)[:, None]
    factor = np.maximum(half_diff.azimuthal_factor(theta_h, theta_d), 1e-9)
    across = np.sin(theta_h) * np.sin(theta_d) * np.sqrt(np.clip(0.5 * (1.0 + azimuth / factor), 0.0, 1.0))
    seen = np.cos(theta_h) * np.cos(theta_d) - across > LEAST_COSINE
    usable = np.broadcast_to(seen[..., None], mean.shape).astype(np.float64)
    observations = Observations(log_cos, x, azimuth, mean, usable, N_MEAN)
    return nearest_lobes(observations, tuple(process.sizes), process.n_lobes, start)


def _unscaled(x: Array, gaussian: Gaussian) -> Array:
    """The projection (unknown, unknown) of changes of a material onto those that leave its mean logarithm alone.

    What it takes away are changes of the heights of the lobes that are a factor a channel.
    """
    lobes = raw_lobes(x, gaussian)
    positions, weights = support()
    value, jacobian = value_jacobian(lobes, positions.log_cos, positions.x, positions.azimuth[:, None])
    mean = np.einsum("n,ncu->cu", weights, jacobian[:, 0] / np.maximum(value[:, 0], 1e-300)[..., None])
    # d ln kappa of each lobe where its height, expm1(kappa), has d ln height = 1
    kappa = np.exp(np.minimum(lobes.scale.mean(1) + lobes.colour.mean(2), MAX_LN_KAPPA))
    by_height = -np.expm1(-kappa) / kappa
    n_channels, sizes = lobes.n_channels, gaussian.sizes
    change = np.zeros((len(x), n_channels))
    if n_channels == 1:
        rows = sum(sizes[:4]) * np.arange(lobes.n_lobes)[:, None] + np.arange(sizes.scale)
        change[rows, 0] = by_height.T
    else:
        rows = len(x) + np.arange(-lobes.colour.size, 0).reshape(lobes.colour.shape)
        for c in range(n_channels):
            change[rows[c], c] = by_height[c, :, None]
    return np.asarray(np.eye(len(x)) - change @ np.linalg.solve(mean @ change, mean))


def _n_decided(candidates: Array, weights: Array) -> float:
    """The sum of the shares of their variance that the main components of the materials compared have lost."""
    off = (candidates - candidates.mean(0)) / np.maximum(candidates.std(0), LEAST_DEVIATION)
    scores, singular, _ = np.linalg.svd(off, full_matrices=False)
    kept = np.cumsum(singular**2) < KEPT_SHARE * (singular**2).sum()
    scores = scores[:, np.r_[True, kept[:-1]]]
    left = weights @ (scores - weights @ scores) ** 2 / scores.var(0)
    return float(np.maximum(1.0 - left, 0.0).sum())


def _weights(evidence: Array, power: float) -> Array:
    weights = np.exp(power * (evidence - evidence.max()))
    return np.asarray(weights / weights.sum())
