"""`Observations`: what is fitted, the same for tables and for scattered samples.

A position is a pair (theta_h, theta_d) with a few azimuths. A sample is a position with one. A cell of a table is one
with three: values at three azimuths have the same count, means, variance and covariance over phi_d as all of its
entries, and so the same least squares.

How much a residual of the logarithm counts makes the fit good in several figures of merit at once. In ln f the
squares of the logarithm itself, of the cube root of `f cos_i cos_o`, of the albedo and of f are weighted by solid angle
times 1, `(f cos_i cos_o)^(2/3)`, `f cos_i cos_o` (alike for all theta_d) and f^2; the weight is a sum of these, each
made to add up to one (decision record 0015).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf._brief import Brief
from dsbrdf.fitting import energy
from dsbrdf.geometry import half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.evaluation import evaluate_numpy
from dsbrdf.model.lobes import Lobes

__all__ = ["Observations", "cell_area"]

Array = NDArray[np.float64]

#: Shares of the logarithm, of the cube root, of the albedo and of the value itself in the weight of a residual.
SHARES = (0.7, 3.0, 4.0, 0.7)
#: The offset of the logarithm is this times the median value, or as much as the most negative values if that is more.
OFFSET = 0.01
NEGATIVE_QUANTILE = 0.05
#: Angle, radians, below which theta_d no longer adds to the weight of a value in the albedo.
LEAST_ANGLE = float(np.deg2rad(2.0))
#: Variation of cos(2 phi_d) of samples below which it tells nothing.
LEAST_VARIATION = 0.1
#: Differences of directions below this are rounding.
SAME = 1e-3
#: Smaller cosine of a cell below which it counts less, in proportion: little light goes there, and few instruments
#: measure it well.
GRAZING = 0.5
#: Least and greatest of the brightest value that is fitted, 1/sr: a fit is as good throughout.
BRIGHTEST = (1e-15, 1e30)
#: Azimuths of a cell, in standard deviations of cos(2 phi_d): of mean 0 and variance 1.
NODES = np.sqrt(1.5) * np.array([-1.0, 0.0, 1.0])
#: Values that stand for a row over phi_d stay within this of its mean.
MAX_SWING = 0.9
#: Squares of misfit of a table are worth so many independent ones: those of neighbouring cells are alike (record 0016).
EFFECTIVE = 2000.0


@dataclass(frozen=True, eq=False, repr=False)
class Observations(Brief):
    """Values at positions, a few azimuths each.

    Parameters
    ----------
    log_cos : (position,) ndarray
        `ln cos(theta_h)`.
    x : (position,) ndarray
        `cos(theta_d)`.
    azimuth : (position, node) ndarray
        Azimuthal factor times `cos(2 phi_d)`.
    values : (position, node, channel) ndarray, 1/sr
    weights : (position, node, channel) ndarray
        Zero where there is no value.
    n_effective : float
        Independent observations that all this is worth.
    light : (angle, position, node) ndarray, optional
        How much values of a table count for the light from near each of `energy.ANGLES`.
    directions : ((position, 3), (position, 3)) ndarray, optional
        Those of the light and of the viewer, of samples.
    area : (position, channel) ndarray, optional
        How much of all pairs of directions each sample stands for.
    is_one_scan : bool, optional
        Whether these are samples in one plane of incidence with light or viewer at rest: theta_h and theta_d vary
        together, and what each does cannot be told apart.

    Attributes
    ----------
    offset : (channel,) ndarray, 1/sr
        Offset of the logarithm.
    kernel : _core.Observations
        The same in the kernel.
    """

    log_cos: Array
    x: Array
    azimuth: Array
    values: Array
    weights: Array
    n_effective: float
    light: Array | None = None
    directions: tuple[Array, Array] | None = None
    area: Array | None = None
    is_one_scan: bool = False
    offset: Array = field(init=False)
    kernel: _core.Observations = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", _offset(self.values, self.weights))
        arrays = (self.log_cos, self.x, self.azimuth, self.values, self.weights)
        kernel = _core.Observations(*(np.ascontiguousarray(array, dtype=np.float64) for array in arrays))
        object.__setattr__(self, "kernel", kernel)

    def __reduce__(self) -> tuple[Any, ...]:
        # What the kernel holds is made again
        arrays = (self.log_cos, self.x, self.azimuth, self.values, self.weights)
        rest = (self.n_effective, self.light, self.directions, self.area, self.is_one_scan)
        return Observations, (*arrays, *rest)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.values.shape[2])

    @property
    def is_table(self) -> bool:
        """Whether these are cells of a table, with several azimuths each."""
        return int(self.azimuth.shape[1]) > 1

    def weighed_by(self, lobes: Lobes) -> Observations:
        """Samples, weighed by the values of lobes at them.

        Weights that are those of measured values follow the noise, and draw a fit to what is too bright.

        Raises
        ------
        ValueError
            If these are cells of a table.
        """
        if self.directions is None or self.area is None:
            raise ValueError("only scattered samples are weighed by a model.")
        values = evaluate_numpy(lobes, *self.directions)
        weights = _weights(self.area, self.area, values, _cosines(*self.directions), axes=(0,))
        return replace(self, weights=weights[:, None])

    @classmethod
    def of(cls, measured: MeasuredBRDF | Samples) -> Observations:
        """Those of a table or of samples.

        Raises
        ------
        ValueError
            If no value is valid, or the brightest is out of all proportion, so that its square is no number.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            found = _of_samples(measured) if isinstance(measured, Samples) else _of_table(measured)
        brightest = float(np.abs(found.values).max())
        if not (brightest == 0.0 or BRIGHTEST[0] <= brightest <= BRIGHTEST[1]):
            raise ValueError(
                f"{measured.name or 'the measurement'}: the brightest value is {brightest:.3g}/sr, expected "
                f"{BRIGHTEST[0]:g} to {BRIGHTEST[1]:g}. Bring it to 1/sr with the option 'scale' (--scale)."
            )
        if not (found.weights > 0.0).any():
            raise ValueError(
                f"{measured.name or 'the measurement'}: no value is valid. Check that it holds positive values in 1/sr."
            )
        return found


def _offset(values: Array, weights: Array) -> Array:
    """Offset (channel,) of the logarithm."""
    offset = np.empty(values.shape[2])
    for channel in range(len(offset)):
        some = values[..., channel][weights[..., channel] > 0.0]
        noise = -np.quantile(some, NEGATIVE_QUANTILE) if some.size else 0.0
        offset[channel] = max(OFFSET * np.median(np.abs(some)), noise) if some.size else 0.0
    least = offset[offset > 0.0].min(initial=np.inf)
    return np.where(offset > 0.0, offset, least if np.isfinite(least) else 1.0)


def cell_area(theta_h: Array, theta_d: Array) -> Array:
    """Solid angles (theta_d, theta_h) of pairs of directions in a cell of a table, up to a constant.

    `d wi d wo = 4 cos(theta_d) d omega_h d omega_d`; cells end half-way between their angles.
    """
    edges = [np.concatenate([[0.0], 0.5 * (t[1:] + t[:-1]), [np.pi / 2]]) for t in (theta_h, theta_d)]
    of_half = -np.diff(np.cos(edges[0]))
    # The integral of cos sin
    of_difference = 0.5 * np.diff(np.sin(edges[1]) ** 2)
    area: Array = of_difference[:, None] * of_half
    return area


def _of_table(measured: MeasuredBRDF) -> Observations:
    theta_h, theta_d = measured.theta_h, measured.theta_d
    moments = measured.moments(range(len(theta_d)))  # (theta_d, channel, theta_h, moment)
    n, f, _, c, cc, fc = np.moveaxis(moments, -1, 0)
    some = n > 0.0
    count = np.maximum(n, 1.0)
    mean, mean_c = f / count, c / count
    var_c = np.maximum(cc / count - mean_c**2, 0.0)
    slope = np.divide(fc / count - mean * mean_c, var_c, out=np.zeros_like(var_c), where=var_c > 1e-12)

    # The same three azimuths for all channels
    total = np.maximum(n.sum(1), 1.0)
    middle = c.sum(1) / total
    spread = np.sqrt(np.maximum(cc.sum(1) / total - middle**2, 0.0))
    nodes = middle[..., None] + spread[..., None] * NODES
    swing = slope[..., None] * (nodes[:, None] - mean_c[..., None])
    most = MAX_SWING * np.abs(mean)[..., None]
    values = mean[..., None] + np.clip(swing, -most, most)

    cos_product = _cos_product(theta_h, theta_d[:, None], middle)
    half_sum = np.cos(theta_h) * np.cos(theta_d[:, None])
    half_gap = np.sqrt(np.maximum(half_sum**2 - cos_product, 0.0))
    least_cosine = half_sum - half_gap
    cos_product = cos_product[:, None]
    area = cell_area(theta_h, theta_d)[:, None] * n * np.clip(least_cosine / GRAZING, 0.0, 1.0)[:, None]
    by_angle = area / np.sin(np.maximum(theta_d, LEAST_ANGLE))[:, None, None]
    weights = np.where(some, _weights(area, by_angle, mean, cos_product, axes=(0, 2)), 0.0)
    h, d = (grid.ravel() for grid in np.broadcast_arrays(theta_h, theta_d[:, None]))
    factor = half_diff.azimuthal_factor(theta_h, theta_d[:, None])
    of_node = np.sqrt(
        np.maximum(
            half_sum[..., None] ** 2 - _cos_product(theta_h[:, None], theta_d[:, None, None], nodes), 0.0
        )
    )
    light = energy.shares((half_sum[..., None] - of_node, half_sum[..., None] + of_node))
    light *= (cell_area(theta_h, theta_d) * n.mean(1))[..., None]
    by_position = (0, 2, 3, 1)
    shape = (h.size, len(NODES), n.shape[1])
    return Observations(
        half_diff.log_cos(h),
        np.cos(d),
        (factor[..., None] * nodes).reshape(h.size, len(NODES)),
        values.transpose(by_position).reshape(shape),
        np.repeat(weights[..., None], len(NODES), axis=-1).transpose(by_position).reshape(shape),
        min(EFFECTIVE, float((some.any(1)).sum())),
        light.reshape(len(light), h.size, len(NODES)),
    )


def _of_samples(samples: Samples) -> Observations:
    theta_h, theta_d, phi_d = half_diff.from_directions(samples.wi, samples.wo)
    valid = np.isfinite(samples.values)
    values = np.where(valid, samples.values, 0.0)
    area = np.ones(len(samples)) if samples.weights is None else samples.weights
    area = area[:, None] * valid
    weights = _weights(area, area, values, _cosines(samples.wi, samples.wo), axes=(0,))
    n = float((area > 0.0).any(1).sum())
    factor, cos_2phi = half_diff.azimuthal_factor(theta_h, theta_d), np.cos(2.0 * phi_d)
    # What does not vary with the azimuth, as in one plane of incidence, is not put down to it
    told = factor > 0.5
    varies = bool(told.any() and np.ptp(cos_2phi[told]) > LEAST_VARIATION)
    azimuth = factor * cos_2phi if varies else np.zeros(len(samples))
    return Observations(
        half_diff.log_cos(theta_h),
        np.cos(theta_d),
        azimuth[:, None],
        values[:, None],
        weights[:, None],
        max(min(EFFECTIVE, n), 1.0),
        directions=(samples.wi, samples.wo),
        area=area,
        is_one_scan=_is_one_scan(samples.wi, samples.wo),
    )


def _is_one_scan(wi: Array, wo: Array) -> bool:
    at_rest = any(np.abs(w - w[:1]).max() < SAME for w in (wi, wo))
    # In one plane with the normal: no triple product
    out_of_plane = wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0]
    return bool(at_rest and np.abs(out_of_plane).max() < SAME)


def _cosines(wi: Array, wo: Array) -> Array:
    """`cos(theta_i) cos(theta_o)` (n, 1), not below 0."""
    return np.asarray(np.maximum(wi[:, 2] * wo[:, 2], 0.0))[:, None]


def _cos_product(theta_h: Array, theta_d: Array, cos_2phi: Array) -> Array:
    """`cos(theta_i) cos(theta_o)`, not below 0."""
    upright = np.cos(theta_h) * np.cos(theta_d)
    tilt = np.sin(theta_h) * np.sin(theta_d)
    product: Array = np.maximum(upright**2 - tilt**2 * 0.5 * (1.0 + cos_2phi), 0.0)
    return product


def _weights(area: Array, by_angle: Array, values: Array, cos_product: Any, axes: tuple[int, ...]) -> Array:
    """Weights of residuals of the logarithm; each channel counts alike, as far as it has values."""
    bright = np.maximum(values, 0.0)
    total = np.zeros(values.shape)
    measures = (
        area,
        area * np.cbrt(bright * cos_product) ** 2,
        by_angle * bright * cos_product,
        area * bright**2,
    )
    for share, part in zip(SHARES, measures, strict=True):
        total += share * part / np.maximum(part.sum(axes, keepdims=True), 1e-300)
    return total
