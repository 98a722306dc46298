"""Which angles a measurement covers, and which are left to the curves' penalty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.fitting.observations import Observations

__all__ = ["Coverage"]

#: Parts of 15 degrees in theta_d and theta_h.
STEP = np.deg2rad(15.0)
N_STEPS = 6
#: Variation of g cos(2 phi_d) below which nothing is said of the azimuth.
LEAST_AZIMUTH = 0.5


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which angles a measurement covers.

    Parameters
    ----------
    n_values : int
        Positions with a value.
    theta_d, theta_h : (float, float), radians
        Least and greatest angle with a value.
    cells : (6, 6) ndarray of bool
        Which parts of 15 degrees of (theta_d, theta_h) hold a value.
    azimuth : bool
        Whether values at one position differ enough in phi_d to tell how they vary with it.
    empty_channels : tuple of int
        Channels without any value.
    """

    n_values: int
    theta_d: tuple[float, float]
    theta_h: tuple[float, float]
    cells: NDArray[np.bool_]
    azimuth: bool
    empty_channels: tuple[int, ...]

    @classmethod
    def of(cls, observations: Observations) -> Coverage:
        """The coverage of observations."""
        some = (observations.weights > 0.0).any((1, 2))
        theta_d = np.arccos(np.clip(observations.x[some], 0.0, 1.0))
        theta_h = np.arccos(np.exp(observations.log_cos[some]))
        cells = np.zeros((N_STEPS, N_STEPS), dtype=bool)
        at = [np.clip((theta / STEP).astype(int), 0, N_STEPS - 1) for theta in (theta_d, theta_h)]
        cells[at[0], at[1]] = True
        azimuth = observations.azimuth[some]
        empty = np.flatnonzero(~(observations.weights > 0.0).any((0, 1)))
        return cls(
            int(some.sum()),
            (float(theta_d.min()), float(theta_d.max())),
            (float(theta_h.min()), float(theta_h.max())),
            cells,
            bool(np.ptp(azimuth) > LEAST_AZIMUTH),
            tuple(int(channel) for channel in empty),
        )

    def __repr__(self) -> str:
        return f"Coverage({self.n_values:,} positions, {self.sentence or 'all angles covered'})"

    @property
    def sentence(self) -> str:
        """What is not covered, in a line; empty if all is."""
        parts = []
        rows, columns = (np.asarray(self.cells.any(axis)) for axis in (1, 0))
        if not rows.all():
            parts.append(f"theta_d only {_range(self.theta_d)}")
        if not columns[:-1].all():
            parts.append(f"theta_h only {_range(self.theta_h)}")
        # Both directions are above the horizon where theta_h + theta_d < 90 degrees
        inside = np.add.outer(np.arange(N_STEPS), np.arange(N_STEPS)) < N_STEPS - 1
        share = self.cells[inside].mean()
        if share < 1.0 and not parts:
            parts.append(f"{share:.0%} of the pairs of angles")
        elif share < 1.0:
            parts.append(f"{share:.0%} of the pairs of angles in all")
        if not self.azimuth:
            parts.append("no variation with the azimuth")
        if self.empty_channels:
            parts.append(f"no value in channel {', '.join(map(str, self.empty_channels))}")
        if not parts:
            return ""
        return f"measured: {'; '.join(parts)}. Elsewhere the model follows its curves, not data"


def _range(limits: tuple[float, float]) -> str:
    low, high = np.rad2deg(limits)
    return f"{low:.0f} to {high:.0f} degrees"
