"""Samples of the slices for the paper's competitors, and the measure of error for all."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import MIN_THETA_H, slice_mask, slice_profiles, slice_rows

__all__ = ["Array", "SliceOptions", "errors", "ratio", "slice_table"]

Array = NDArray[np.float64]


class SliceOptions(TypedDict, total=False):
    """Which samples are fitted or looked at; defaults and meaning as in `dsbrdf.paper.collapse.slice_profiles`."""

    n_slices: int
    min_theta_h: float
    perimeter_mask: bool
    theta_h_step: int


class _Reflectance(Protocol):
    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> Any: ...


def errors(
    baseline: _Reflectance, measured: MeasuredBRDF, **options: Unpack[SliceOptions]
) -> metrics.FitErrors:
    """Errors of a baseline, or of any model with `eval_angles`, over all samples of the slices.

    Parameters
    ----------
    baseline : AbstractBaseline, Slices or DSBRDF
    measured : MeasuredBRDF
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    FitErrors
        `rel_rms` is comparable with that of `dsbrdf.paper.fit_slices` with the same options; the floors are the
        data's. A sample below the horizon, which the perimeter mask leaves out, is held against a value of zero.

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
    """Means over phi_d of the slices that `dsbrdf.paper.fit_slices` takes with the same options.

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


def ratio(x: Array, y: Array) -> Array:
    """`x / y`, zero where y is not positive."""
    return np.divide(x, y, out=np.zeros_like(x), where=y > 0.0)
