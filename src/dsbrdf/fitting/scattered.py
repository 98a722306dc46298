"""Scattered samples to slices: which slice takes which sample, and what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.paper.collapse import MIN_THETA_H, SliceProfile, gather_profile

__all__ = ["Coordinates", "gather", "nearest_slice"]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Half and difference angles of samples, (sample,) ndarrays in radians."""

    theta_h: NDArray[np.float64]
    theta_d: NDArray[np.float64]
    phi_d: NDArray[np.float64]

    @classmethod
    def of(cls, samples: Samples) -> Coordinates:
        """Return those of the directions of `samples`."""
        return cls(*half_diff.from_directions(samples.wi, samples.wo))


def nearest_slice(
    theta_d: ArrayLike, slices: NDArray[np.float64], tolerance: float | None = None
) -> NDArray[np.int_]:
    """Index (sample,) of the slice nearest to each `theta_d` (sample,); -1 where none is within `tolerance`.

    Parameters
    ----------
    theta_d : (sample,) array_like, radians
    slices : (slice,) ndarray, radians
        Ascending.
    tolerance : float, radians, optional
        None takes every sample, however far.
    """
    distance = np.abs(np.asarray(theta_d, dtype=float)[:, None] - slices)
    nearest: NDArray[np.int_] = distance.argmin(-1)
    limit = np.inf if tolerance is None else tolerance * (1.0 + 1e-12)
    return np.where(distance.min(-1) <= limit, nearest, -1)


def gather(
    samples: Samples,
    theta_d: ArrayLike,
    tolerance: float | None = None,
    *,
    min_theta_h: float = MIN_THETA_H,
    perimeter_mask: bool = True,
) -> list[SliceProfile]:
    """Slices at `theta_d` from scattered samples, each of which goes to the nearest.

    Parameters
    ----------
    samples : Samples
    theta_d : (slice,) array_like, radians
        Ascending.
    tolerance : float, radians, optional
        Samples farther than this from every slice are left out; by default none is.
    min_theta_h, perimeter_mask
        As in `dsbrdf.paper.collapse.slice_profiles`; the mask is that of a sample's own theta_d.

    Returns
    -------
    list of SliceProfile
        One a `theta_d`; those that no sample is near to are empty.

    Raises
    ------
    ValueError
        If an angle is out of range, or `theta_d` is not ascending.
    """
    slices = _check.angle(theta_d, "theta_d")
    if slices.ndim != 1 or slices.size == 0 or (np.diff(slices) <= 0.0).any():
        raise ValueError(f"'theta_d' must be a non-empty ascending list of angles, got {slices}.")
    at = Coordinates.of(samples)
    index = nearest_slice(at.theta_d, slices, tolerance)
    index[~within(at, min_theta_h, perimeter_mask)] = -1
    return gather_by(samples, at, slices, index)


def within(at: Coordinates, min_theta_h: float, perimeter_mask: bool) -> NDArray[np.bool_]:
    """Which samples (sample,) the masks of `dsbrdf.paper.collapse.slice_profiles` leave."""
    kept: NDArray[np.bool_] = at.theta_h >= float(_check.angle(min_theta_h, "min_theta_h"))
    if perimeter_mask:
        kept &= at.theta_h < np.pi / 2 - at.theta_d
    return kept


def gather_by(
    samples: Samples, at: Coordinates, slices: Sequence[float] | NDArray[np.float64], index: NDArray[np.int_]
) -> list[SliceProfile]:
    """Slices of the samples that `index` (sample,) gives to each."""
    weights = np.ones(len(samples)) if samples.weights is None else samples.weights
    profiles = []
    for i, theta_d in enumerate(slices):
        of = np.flatnonzero(index == i)
        profiles.append(
            gather_profile(float(theta_d), at.theta_h[of], at.phi_d[of], samples.values[of], weights[of])
        )
    return profiles
