"""The bivariate table: a measured BRDF averaged over phi_d (Romeiro et al. 2008).

Romeiro, Vasilyev and Zickler, "Passive reflectometry", ECCV 2008, LNCS 5305, pp. 859-872: reference 20 of the
paper, which compares with it in Section 6.A.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief
from dsbrdf.baselines._base import AbstractBaseline, Array
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["Bivariate", "bilinear", "blend", "fill_gaps", "fit_bivariate"]


@dataclass(frozen=True, eq=False, repr=False)
class Bivariate(Brief, AbstractBaseline):
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

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import baselines
    >>> found = baselines.fit_bivariate(dsbrdf.material("matte"))
    >>> found.eval([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]).round(2)
    array([0.18, 0.1 , 0.07])
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
        Its error over the table's samples is the bivariate floor.

    Raises
    ------
    ValueError
        If no sample is valid.


    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import baselines
    >>> baselines.fit_bivariate(dsbrdf.material("matte")).n_parameters
    24069
    """
    _check.instance(measured, MeasuredBRDF, "measured")
    count, total = np.moveaxis(measured.moments(range(len(measured.theta_d)))[..., :2], -1, 0)
    if not count.any():
        raise ValueError(
            f"{measured.name or 'the table'}: no value is valid. Check that it holds positive values."
        )
    mean = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0.0)
    return Bivariate(measured.theta_d, measured.theta_h, mean, measured.name)


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
