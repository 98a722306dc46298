"""The bivariate table: a measured BRDF averaged over phi_d (Romeiro et al. 2008).

Romeiro, Vasilyev and Zickler, "Passive reflectometry", ECCV 2008, LNCS 5305, pp. 859-872: reference 20 of the
paper, which compares with it in Section 6.A.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dsbrdf.baselines._base import AbstractBaseline, Array, bilinear, fill_gaps, slice_table
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["Bivariate", "fit_bivariate"]


@dataclass(frozen=True, eq=False)
class Bivariate(AbstractBaseline):
    """A table over theta_h and theta_d, interpolated bilinearly in the root of theta_h and in theta_d.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
        Ascending.
    theta_h : (theta_h,) ndarray, radians
        Ascending.
    values : (theta_d, channel, theta_h) ndarray, 1/sr
        NaN where nothing was measured: linear between the neighbours in theta_h, constant beyond them.
    name : str, optional
    """

    label: ClassVar[str] = "bivariate table"

    theta_d: Array
    theta_h: Array
    values: Array
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Entries of the table that were measured."""
        return int(np.isfinite(self.values).sum())

    @cached_property
    def _filled(self) -> Array:
        return fill_gaps(np.sqrt(self.theta_h), self.values)

    def _values(self, wi: Array, wo: Array) -> Array:
        theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
        return bilinear(self.theta_d, np.sqrt(self.theta_h), self._filled, theta_d, np.sqrt(theta_h))


def fit_bivariate(measured: MeasuredBRDF) -> Bivariate:
    """Average a measured BRDF over phi_d, at each theta_h and theta_d of its table.

    Parameters
    ----------
    measured : MeasuredBRDF

    Returns
    -------
    Bivariate
        Its error over samples of the table is the bivariate floor of `dsbrdf.paper.metrics`.

    Raises
    ------
    ValueError
        If no sample is valid.

    Notes
    -----
    All rows and all valid samples take part: masks would leave holes and change no entry outside them.
    """
    theta_d, mean, _ = slice_table(
        measured, n_slices=len(measured.theta_d), min_theta_h=0.0, perimeter_mask=False
    )
    return Bivariate(theta_d, measured.theta_h, mean, measured.name)
