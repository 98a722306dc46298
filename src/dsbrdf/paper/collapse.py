"""Slices of fixed theta_d, their masks, and the exact collapse over phi_d (Section 6).

A lobe depends on `theta_h` and, through its azimuthal term, on `cos(2 phi_d)`. All that a least-squares fit
can see of a slice are therefore six sums over `phi_d` at each `theta_h`: a `SliceProfile`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief
from dsbrdf.measured.profile import amplitude, ratio
from dsbrdf.measured.table import MeasuredBRDF

__all__ = [
    "MIN_THETA_H",
    "N_SLICES",
    "SliceProfile",
    "slice_profiles",
    "slice_rows",
]

#: Slices of the paper: theta_d at every 5 degrees of a MERL table.
N_SLICES = 18
#: Samples nearer to the pole are not fitted: one degree (Section 6).
MIN_THETA_H = float(np.deg2rad(1.0))
#: Order of the moments on the last axis.
MOMENTS = ("count", "sum f", "sum f^2", "sum c", "sum c^2", "sum f c")


@dataclass(frozen=True, eq=False, repr=False)
class SliceProfile(Brief):
    """Moments over phi_d of a slice, with `c = cos(2 phi_d)`.

    Parameters
    ----------
    theta_d : float, radians
    theta_h : (theta_h,) ndarray, radians
    moments : (channel, theta_h, 6) ndarray
        Count, sum f, sum f^2, sum c, sum c^2, sum f c; all zero where nothing is valid.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> profile = paper.slice_profiles(dsbrdf.material("matte"), n_slices=3)[0]
    >>> profile.mean.shape == (3, len(profile.theta_h))
    True
    """

    theta_d: float
    theta_h: NDArray[np.float64]
    moments: NDArray[np.float64]

    @property
    def count(self) -> NDArray[np.float64]:
        """Number of samples, (channel, theta_h)."""
        return self.moments[..., 0]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean over phi_d in 1/sr, (channel, theta_h); NaN where there is no sample."""
        return ratio(self.moments[..., 1], self.count)

    @property
    def energy(self) -> NDArray[np.float64]:
        """Sum of squares of all samples in 1/sr^2, (channel,)."""
        total: NDArray[np.float64] = self.moments[..., 2].sum(-1)
        return total

    @property
    def azimuthal_amplitude(self) -> NDArray[np.float64]:
        """Best amplitude of `cos(2 phi_d)` in 1/sr, (channel, theta_h); NaN where it cannot be told."""
        return amplitude(self.moments)

    def cut(self, min_theta_h: float) -> SliceProfile:
        """The slice without its samples of theta_h below `min_theta_h` (radians)."""
        kept = self.theta_h >= min_theta_h
        return SliceProfile(self.theta_d, self.theta_h, np.where(kept[:, None], self.moments, 0.0))


def slice_rows(n_rows: int, n_slices: int = N_SLICES) -> NDArray[np.int_]:
    """Rows of a table with `n_rows` in theta_d that make `n_slices` evenly spaced slices, from the first on.

    Raises
    ------
    ValueError
        If there are fewer rows than slices, or no slice.
    """
    if not 1 <= n_slices <= n_rows:
        raise ValueError(f"'n_slices' must be between 1 and the table's {n_rows} rows, got {n_slices}.")
    return np.arange(n_slices) * n_rows // n_slices


def slice_profiles(
    measured: MeasuredBRDF,
    *,
    n_slices: int = N_SLICES,
    min_theta_h: float = MIN_THETA_H,
    perimeter_mask: bool = True,
    theta_h_step: int = 1,
) -> list[SliceProfile]:
    """Slices of a table, collapsed over phi_d.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_slices : int, optional
        Evenly spaced in theta_d: 18 is every 5 degrees of a MERL table (the paper), 90 is every row.
    min_theta_h : float, radians, optional
        Samples below are left out, one degree by default (the paper).
    perimeter_mask : bool, optional
        Leave out `theta_h >= pi/2 - theta_d`, where directions of some phi_d are below the horizon (the
        paper's mask against lobes at the perimeter, Section 6.A).
    theta_h_step : int, optional
        Keep every such theta_h only (Fig. 6).

    Returns
    -------
    list of SliceProfile
        Ascending in theta_d.

    Raises
    ------
    ValueError
        If an option is out of range.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> profiles = paper.slice_profiles(dsbrdf.material("matte"), n_slices=3)
    >>> len(profiles), profiles[0].moments.shape[1]
    (3, 90)
    """
    if theta_h_step < 1:
        raise ValueError(f"'theta_h_step' must be at least 1, got {theta_h_step}.")
    min_theta_h = float(_check.angle(min_theta_h, "min_theta_h"))
    rows = slice_rows(len(measured.theta_d), n_slices)
    moments = measured.moments(rows)
    kept = slice_mask(measured, rows, min_theta_h, perimeter_mask, theta_h_step)
    moments.swapaxes(1, 2)[~kept] = 0.0
    return [
        SliceProfile(float(measured.theta_d[row]), measured.theta_h, of_row)
        for row, of_row in zip(rows, moments, strict=True)
    ]


def slice_mask(
    measured: MeasuredBRDF,
    rows: NDArray[np.int_],
    min_theta_h: float,
    perimeter_mask: bool,
    theta_h_step: int,
) -> NDArray[np.bool_]:
    """Which theta_h of which row (row, theta_h) are fitted; see `slice_profiles`."""
    theta_h = measured.theta_h
    kept = (theta_h >= min_theta_h) & (np.arange(len(theta_h)) % theta_h_step == 0)
    limit = np.pi / 2 - measured.theta_d[rows] if perimeter_mask else np.full(len(rows), np.inf)
    mask: NDArray[np.bool_] = kept & (theta_h < limit[:, None])
    return mask


def stack_profiles(
    profiles: Sequence[SliceProfile],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """`theta_d` (slice,), `theta_h` (slice, theta_h) and moments (slice, channel, theta_h, 6) of slices.

    Slices with fewer theta_h than others are filled with empty ones.
    """
    theta_d = np.array([profile.theta_d for profile in profiles])
    n_h = max(len(profile.theta_h) for profile in profiles)
    theta_h = np.zeros((len(profiles), n_h))
    moments = np.zeros((len(profiles), profiles[0].moments.shape[0], n_h, len(MOMENTS)))
    for i, profile in enumerate(profiles):
        theta_h[i, : len(profile.theta_h)] = profile.theta_h
        moments[i, :, : len(profile.theta_h)] = profile.moments
    return theta_d, theta_h, moments
