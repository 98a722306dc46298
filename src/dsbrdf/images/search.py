"""The search for a material whose picture is the given one: Gauss-Newton steps on the unknowns of the estimator.

What is minimised is that of `dsbrdf.fitting.estimator`, `n ln(S) + (x - m)' P (x - m)`: twice the negative logarithm of
the posterior, with the size of the noise integrated out. S is the mean of squared residuals of the logarithm with an
offset, n the independent observations that the picture is worth, m and P the mean and the precision of the prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf.images.linear import NODES, Nodes
from dsbrdf.model.lobes import Lobes
from dsbrdf.space import Gaussian

__all__ = ["Problem", "Solution", "raw_lobes"]

Array = NDArray[np.float64]

#: Offset of the logarithm, as a share of the mean of a channel.
OFFSET = 0.02
#: Least mean of squared residuals; less would be rounding and interpolation, not noise.
LEAST_SQUARES = 1e-6
#: Standard deviation of the logarithm of an unknown exposure.
EXPOSURE = 3.0
MAX_STEPS = 60
#: Decrease of the objective that ends the search, and that ends one that another will follow.
TOLERANCE, LOOSE = 0.2, 1.0
#: Range of the curves' unknowns: exponentials stay numbers.
FALLOFF_END = 20.0


def raw_lobes(x: Array, gaussian: Gaussian) -> Lobes:
    """Lobes of the unknowns of a prior, in its order."""
    *shared_sizes, n_colour = gaussian.sizes
    n_lobes, n_channels = gaussian.n_lobes, len(gaussian.channels)
    n_shared = n_lobes * sum(shared_sizes)
    shared = np.split(x[:n_shared].reshape(n_lobes, -1), np.cumsum(shared_sizes)[:-1], axis=1)
    scale, gamma, beta, falloff = shared
    colour = np.zeros((n_channels, n_lobes, n_colour))
    if n_channels > 1:
        colour = x[n_shared:].reshape(n_channels, n_lobes, n_colour)
    return Lobes(scale, gamma, beta, np.clip(falloff, -0.9, FALLOFF_END), colour)


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a search ended.

    Parameters
    ----------
    x : (unknown,) ndarray
        Those of the prior, then the logarithms of unknown exposures.
    objective, squares : float
        What was minimised; mean of squared residuals.
    residual : (row, channel) ndarray
        Differences of logarithms.
    hessian : (unknown, unknown) ndarray
        Of the data: `J' J` divided by the number of residuals and S; times n it is part of the posterior's precision.
    converged : bool
    """

    x: Array
    objective: float
    squares: float
    residual: Array
    hessian: Array
    converged: bool


@dataclass(frozen=True, eq=False)
class Problem:
    """Pixels, what they hold, and what makes them of a reflectance.

    Parameters
    ----------
    weights : (channel, row, node) ndarray of float32
        See `dsbrdf.images.linear`; in single precision, as most of the time is spent in their products.
    pixels : (row, channel) ndarray
    offset : (channel,) ndarray
        Of the logarithm.
    gaussian : Gaussian
        The prior.
    n_effective : float
    exposure : bool
        Whether a factor a channel is unknown.
    places : (row, 3) ndarray
        Normals of the pixels.
    groups : (row,) ndarray of int
        Which picture each belongs to.
    """

    weights: Array
    pixels: Array
    offset: Array
    gaussian: Gaussian
    n_effective: float
    exposure: bool
    places: Array
    groups: NDArray[np.int_]
    nodes: Nodes = NODES

    @property
    def n_exposures(self) -> int:
        """Unknown factors."""
        return self.pixels.shape[1] if self.exposure else 0

    @property
    def start(self) -> Array:
        """The prior's mean."""
        return np.concatenate([self.gaussian.mean, np.zeros(self.n_exposures)])

    @property
    def precision(self) -> Array:
        """Of the prior, with that of unknown exposures."""
        n, m = len(self.gaussian.mean), self.n_exposures
        precision = np.zeros((n + m, n + m))
        precision[:n, :n] = self.gaussian.precision
        precision[range(n, n + m), range(n, n + m)] = EXPOSURE**-2
        return precision

    def residual(self, x: Array) -> Array:
        """Residuals (row, channel)."""
        value = self.nodes.values(self._lobes(x))
        value = value.astype(np.float32)
        made = np.stack([w @ value[:, c] for c, w in enumerate(self.weights)], axis=1) * self._factors(x)
        return np.asarray(np.arcsinh(0.5 * made / self.offset) - self._target)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Residuals (row, channel) and their derivatives (channel, row, unknown)."""
        n = len(self.gaussian.mean)
        value, by_unknown = self.nodes.linearise(self._lobes(x))
        rows, channels = self.pixels.shape
        residual = np.empty((rows, channels))
        jacobian = np.zeros((channels, rows, len(x)))
        for c, (w, factor, offset) in enumerate(
            zip(self.weights, self._factors(x), self.offset, strict=True)
        ):
            some = self._columns[c]
            stacked = np.concatenate(
                [value[:, c, None], by_unknown[:, c, some]], axis=1, dtype=np.float32, casting="same_kind"
            )
            made = factor * (w @ stacked).astype(np.float64)
            residual[:, c] = np.arcsinh(0.5 * made[:, 0] / offset)
            slope = 1.0 / np.hypot(made[:, 0], 2.0 * offset)
            jacobian[c][:, some] = slope[:, None] * made[:, 1:]
            if self.exposure:
                jacobian[c, :, n + c] = slope * made[:, 0]
        return residual - self._target, jacobian

    def _lobes(self, x: Array) -> Lobes:
        return raw_lobes(x[: len(self.gaussian.mean)], self.gaussian)

    def _factors(self, x: Array) -> Array:
        return np.exp(x[len(self.gaussian.mean) :]) if self.exposure else np.ones(self.pixels.shape[1])

    @cached_property
    def _columns(self) -> list[NDArray[np.int_]]:
        """Unknowns of the prior that each channel depends on: not the colours of others."""
        n_channels, n = self.pixels.shape[1], len(self.gaussian.mean)
        n_colours = self.gaussian.n_lobes * self.gaussian.sizes.colour if n_channels > 1 else 0
        shared = np.arange(n - n_channels * n_colours)
        return [np.r_[shared, len(shared) + c * n_colours + np.arange(n_colours)] for c in range(n_channels)]

    @cached_property
    def _target(self) -> Array:
        return np.asarray(np.arcsinh(0.5 * self.pixels / self.offset))

    def objective(self, residual: Array, x: Array) -> tuple[float, float]:
        """What is minimised, and the mean of squared residuals."""
        squares = float((residual**2).mean()) + LEAST_SQUARES
        off = x - self.start
        return self.n_effective * np.log(squares) + float(off @ self.precision @ off), squares

    def solve(self, x: Array, tolerance: float = TOLERANCE) -> Solution:
        """Search from some unknowns (unknown,)."""
        precision, start = self.precision, self.start
        damping = 1e-3
        residual, jacobian = self.linearise(x)
        value, squares = self.objective(residual, x)
        converged = False
        for _ in range(MAX_STEPS):
            hessian = np.einsum("crp,crq->pq", jacobian, jacobian, optimize=True) / (residual.size * squares)
            slope = np.einsum("crp,rc->p", jacobian, residual, optimize=True) / (residual.size * squares)
            curvature = self.n_effective * hessian + precision
            down = -(self.n_effective * slope + precision @ (x - start))
            for _ in range(12):
                step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), down)
                tried = x + step
                found = self.residual(tried)
                new, new_squares = self.objective(found, tried)
                if new < value:
                    break
                damping *= 6.0
            else:
                converged = True
                break
            converged = value - new < tolerance
            x, value, squares = tried, new, new_squares
            residual, jacobian = self.linearise(x)
            damping = max(damping / 6.0, 1e-6)
            if converged:
                break
        return self.at(x, converged)

    def at(self, x: Array, converged: bool = True) -> Solution:
        """Unknowns as a solution."""
        residual, jacobian = self.linearise(x)
        value, squares = self.objective(residual, x)
        hessian = np.einsum("crp,crq->pq", jacobian, jacobian, optimize=True) / (residual.size * squares)
        return Solution(x, value, squares, residual, hessian, converged)
