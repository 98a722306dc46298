"""Linear interpolation of subsampled data: the nonparametric competitor of Fig. 6."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Unpack

import numpy as np

from dsbrdf.baselines import AbstractBaseline
from dsbrdf.baselines.bivariate import bilinear, fill_gaps
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.baselines._base import Array, SliceOptions, slice_table

__all__ = ["Interpolation", "fit_interpolation"]


@dataclass(frozen=True, eq=False)
class Interpolation(AbstractBaseline):
    """Profiles at some theta_h of each slice, interpolated linearly in theta_h and between slices in theta_d.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
        Ascending.
    theta_h : (theta_h,) ndarray, radians
        Ascending.
    values : (theta_d, channel, theta_h) ndarray, 1/sr
        NaN where a slice has no sample: linear between its neighbours, constant beyond the ends.
    name : str, optional
    """

    label: ClassVar[str] = "linear interpolation"

    theta_d: Array
    theta_h: Array
    values: Array
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Values that are kept."""
        return int(np.isfinite(self.values).sum())

    @cached_property
    def _filled(self) -> Array:
        return fill_gaps(self.theta_h, self.values)

    def _values(self, wi: Array, wo: Array) -> Array:
        theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
        return bilinear(self.theta_d, self.theta_h, self._filled, theta_d, theta_h)


def fit_interpolation(measured: MeasuredBRDF, **options: Unpack[SliceOptions]) -> Interpolation:
    """Keep the profiles of the slices, at every `theta_h_step`-th theta_h only.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are kept; see `dsbrdf.paper.collapse.slice_profiles`. `theta_h_step` is the factor of Fig. 6.

    Returns
    -------
    Interpolation

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.
    """
    theta_d, mean, count = slice_table(measured, **options)
    kept = count.any((0, 1))
    return Interpolation(theta_d, measured.theta_h[kept], mean[..., kept], measured.name)
