"""What the baselines share: their interface, tables over slices, and the measure of error."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import MIN_THETA_H, slice_mask, slice_profiles, slice_rows

__all__ = [
    "AbstractBaseline",
    "Array",
    "SliceOptions",
    "bilinear",
    "blend",
    "errors",
    "fill_gaps",
    "ratio",
    "slice_table",
]

Array = NDArray[np.float64]


class SliceOptions(TypedDict, total=False):
    """Which samples are fitted or looked at; defaults and meaning as in `dsbrdf.paper.collapse.slice_profiles`."""

    n_slices: int
    min_theta_h: float
    perimeter_mask: bool
    theta_h_step: int


class AbstractBaseline(ABC):
    """A reflectance with the interface of `dsbrdf.DSBRDF`.

    Parameters
    ----------
    name : str
        Of the material.
    label : str
        Of the model, for tables and figures.
    """

    name: str
    label: ClassVar[str]

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """How many numbers were fitted."""

    @abstractmethod
    def _values(self, wi: Array, wo: Array) -> Array:
        """Values (..., channel) of unit vectors (..., 3), finite below the horizon too."""

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Values for pairs of directions.

        Parameters
        ----------
        wi, wo : (..., 3) array_like
            Unit vectors toward the light and the viewer, normal +z; broadcast against each other.

        Returns
        -------
        (..., channel) ndarray, 1/sr, without the cosine
            Zero where a direction is below the horizon. The same to the last bit with `wi` and `wo`
            exchanged.

        Raises
        ------
        ValueError
            If a direction is not a unit vector.
        """
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        above = (wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0)
        return np.where(above[..., None], self._values(wi, wo), 0.0)

    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> Array:
        """Values (..., channel) in 1/sr at half and difference angles in radians, which broadcast.

        Zero where one of the two directions would be below the horizon.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        return self.eval(*half_diff.to_directions(theta_h, theta_d, phi_d))


class _Reflectance(Protocol):
    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> Any: ...


def errors(
    baseline: _Reflectance, measured: MeasuredBRDF, **options: Unpack[SliceOptions]
) -> metrics.FitErrors:
    """Errors of a baseline, or of any model with `eval_angles`, over all samples of the slices.

    Parameters
    ----------
    baseline : AbstractBaseline or DSBRDF
    measured : MeasuredBRDF
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    FitErrors
        `rel_rms` is comparable with that of `dsbrdf.fit` with the same options; the floors are the data's. A
        sample below the horizon, which the perimeter mask leaves out, is held against a value of zero.

    Raises
    ------
    ValueError
        If an option is out of range.
    """
    profiles = slice_profiles(measured, **options)
    # The floors do not depend on the lobes: any will do
    nothing = np.zeros((len(profiles), measured.n_channels, 1))
    floors = metrics.fit_errors(profiles, nothing, nothing, nothing)
    rows = slice_rows(len(measured.theta_d), len(profiles))
    mask = slice_mask(
        measured,
        rows,
        options.get("min_theta_h", MIN_THETA_H),
        options.get("perimeter_mask", True),
        options.get("theta_h_step", 1),
    )
    squares = np.empty_like(floors.energy)
    for i, row in enumerate(rows):
        samples = measured.rows([int(row)])[:, mask[i], 0]
        values = baseline.eval_angles(measured.theta_h[mask[i], None], measured.theta_d[row], measured.phi_d)
        squares[i] = np.nansum((np.moveaxis(values, -1, 0) - samples) ** 2, axis=(1, 2))
    return dataclasses.replace(floors, squares=squares)


def slice_table(measured: MeasuredBRDF, **options: Unpack[SliceOptions]) -> tuple[Array, Array, Array]:
    """Means over phi_d of the slices that `dsbrdf.fit` takes with the same options.

    Returns
    -------
    theta_d : (theta_d,) ndarray, radians
    mean : (theta_d, channel, theta_h) ndarray, 1/sr
        NaN where there is no sample.
    count : (theta_d, channel, theta_h) ndarray

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.
    """
    profiles = slice_profiles(measured, **options)
    count = np.stack([profile.count for profile in profiles])
    if not count.any():
        raise ValueError(
            "no slice has a valid sample after masking. Lower 'min_theta_h', switch off 'perimeter_mask', or "
            "check that the measurement holds positive values."
        )
    mean = np.stack([profile.mean for profile in profiles])
    return np.array([profile.theta_d for profile in profiles]), mean, count


def fill_gaps(x: Array, values: Array) -> Array:
    """Values (theta_d, channel, x) with NaN replaced: linear in x inside a row, constant beyond its ends.

    A row without any number is that of the nearest theta_d which has some; a channel without any is zero.
    """
    filled = values.copy()
    known = np.isfinite(values)
    for index in np.argwhere(known.any(-1)):
        row, some = filled[*index], known[*index]
        row[~some] = np.interp(x[~some], x[some], row[some])
    rows = np.arange(len(values))
    for channel in range(values.shape[1]):
        full = rows[known[:, channel].any(-1)]
        if full.size:
            filled[:, channel] = filled[full[np.abs(rows[:, None] - full).argmin(1)], channel]
        else:
            filled[:, channel] = 0.0
    return filled


def blend(nodes: Array, x: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Nodes at or below and above `x`, and the weight of the upper; the end nodes hold beyond the ends."""
    low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, max(nodes.size - 2, 0))
    high = np.minimum(low + 1, nodes.size - 1)
    step = np.where(high > low, nodes[high] - nodes[low], 1.0)
    return low, high, np.clip((x - nodes[low]) / step, 0.0, 1.0)


def bilinear(theta_d: Array, x: Array, table: Array, at_theta_d: Array, at_x: Array) -> Array:
    """Values (..., channel) of a table (theta_d, channel, x) without gaps, between its nodes."""
    d_low, d_high, d_weight = blend(theta_d, at_theta_d)
    x_low, x_high, x_weight = blend(x, at_x)
    d_weight, x_weight = d_weight[..., None], x_weight[..., None]
    lower, upper = (
        (1.0 - x_weight) * table[d, :, x_low] + x_weight * table[d, :, x_high] for d in (d_low, d_high)
    )
    result: Array = (1.0 - d_weight) * lower + d_weight * upper
    return result


def ratio(x: Array, y: Array) -> Array:
    """`x / y`, zero where y is not positive."""
    return np.divide(x, y, out=np.zeros_like(x), where=y > 0.0)
