"""A summary of what was measured, small enough to stay with a model, for plots beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf._brief import Brief

__all__ = ["MeasuredProfile", "amplitude", "ratio"]


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredProfile(Brief):
    """What was fitted, for plots beside a model; the samples themselves are not kept.

    Parameters
    ----------
    theta_d : (slice,) ndarray, radians
    theta_h : (slice, theta_h) ndarray, radians
    mean : (slice, channel, theta_h) ndarray, 1/sr
        Over phi_d; NaN where there is no sample.
    amplitude : (slice, channel, theta_h) ndarray, 1/sr
        Of `cos(2 phi_d)`, so that `mean + amplitude` is at phi_d = 0; NaN where it cannot be told.

    Raises
    ------
    ValueError
        If shapes disagree.
    """

    theta_d: NDArray[np.float64]
    theta_h: NDArray[np.float64]
    mean: NDArray[np.float64]
    amplitude: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, n_axes in (("theta_d", 1), ("theta_h", 2), ("mean", 3), ("amplitude", 3)):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.ndim != n_axes or len(array) != len(self.theta_d):
                raise ValueError(
                    f"'{name}' of a profile must have {n_axes} axes, the first of {len(self.theta_d)} slices, "
                    f"got shape {array.shape}."
                )
            object.__setattr__(self, name, array)
        if self.mean.shape != self.amplitude.shape or self.mean.shape[::2] != self.theta_h.shape:
            raise ValueError(
                f"a profile's 'mean' and 'amplitude' must have shape (slice, channel, theta_h) with 'theta_h' "
                f"{self.theta_h.shape}, got {self.mean.shape} and {self.amplitude.shape}."
            )

    @classmethod
    def of(
        cls, theta_d: NDArray[np.float64], theta_h: NDArray[np.float64], moments: NDArray[np.float64]
    ) -> MeasuredProfile:
        """Return the summary of moments (slice, channel, theta_h, 6) at angles (slice,) and (slice, theta_h)."""
        return cls(theta_d, theta_h, ratio(moments[..., 1], moments[..., 0]), amplitude(moments))


def amplitude(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Best amplitude of `cos(2 phi_d)` in 1/sr of moments (..., 6) over phi_d; NaN where it cannot be told."""
    n, f, _, c, cc, fc = np.moveaxis(moments, -1, 0)
    spread = cc - c * ratio(c, n)
    best = ratio(fc - f * ratio(c, n), spread)
    return np.where(spread > 1e-12 * n, best, np.nan)


def ratio(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """`x / y`, NaN where y is zero."""
    ratio: NDArray[np.float64] = np.divide(
        x, y, out=np.full(np.broadcast(x, y).shape, np.nan), where=y != 0.0
    )
    return ratio
