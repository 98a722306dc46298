"""Von Mises-Fisher lobes in each slice: what the paper sets out to improve on (Section 3, Eq. 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Unpack

import numpy as np

from dsbrdf import _check
from dsbrdf.baselines import AbstractBaseline
from dsbrdf.baselines.bivariate import blend
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.baselines._base import Array, SliceOptions, slice_table
from dsbrdf.paper.baselines._samples import refine

__all__ = ["VonMisesFisher", "fit_von_mises_fisher"]

#: Range of the concentration; narrower lobes fall between the samples.
KAPPA = (1e-2, 1e5)
#: Concentrations that lobes are chosen from before they are refined, and rounds of exchange.
N_GRID, N_ROUNDS = 32, 4


@dataclass(frozen=True, eq=False)
class VonMisesFisher(AbstractBaseline):
    """Lobes `amplitude exp(kappa (cos(theta_h) - 1))` whose parameters are given at some theta_d.

    Between slices the values of the two nearest are interpolated linearly in theta_d, as those of `Slices`.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
        Ascending.
    amplitude, kappa : (theta_d, channel, lobe) ndarray
        Height in 1/sr, and concentration; both not negative.
    name : str, optional

    Notes
    -----
    Eq. (3) without the normaliser, which least squares do not need.
    """

    label: ClassVar[str] = "von Mises-Fisher"

    theta_d: Array
    amplitude: Array
    kappa: Array
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Amplitudes and concentrations of all slices, channels and lobes."""
        return self.amplitude.size + self.kappa.size

    def _values(self, wi: Array, wo: Array) -> Array:
        theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
        low, high, weight = blend(self.theta_d, theta_d)
        # cos(theta_h) - 1 without cancellation; not past the horizon
        depth = -2.0 * np.sin(0.5 * np.minimum(theta_h, np.pi / 2))[..., None] ** 2
        values = np.zeros((*theta_h.shape, self.kappa.shape[1]))
        for k in range(self.kappa.shape[2]):
            amplitude, kappa = self.amplitude[..., k], self.kappa[..., k]
            for at, share in ((low, 1.0 - weight), (high, weight)):
                values += share[..., None] * amplitude[at] * np.exp(kappa[at] * depth)
        return values


def fit_von_mises_fisher(
    measured: MeasuredBRDF, n_lobes: int = 3, **options: Unpack[SliceOptions]
) -> VonMisesFisher:
    """Fit von Mises-Fisher lobes to every slice and channel by least squares.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_lobes : int, optional
        Lobes in each slice and channel.
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    VonMisesFisher
        Lobes sorted by kappa, falling. A slice without a sample has the lobes of the nearest that has some.

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.

    Notes
    -----
    The lobes do not depend on phi_d, so the squares over all samples are those over the means, weighted by
    their number, plus a constant. Lobes are chosen from a list of concentrations, one exchanged at a time
    while that lowers the squares; then all concentrations are refined together. Amplitudes are always those
    of non-negative least squares.
    """
    if n_lobes < 1:
        raise ValueError(f"'n_lobes' must be at least 1, got {n_lobes}.")
    theta_d, mean, count = slice_table(measured, **options)
    depth = -2.0 * np.sin(0.5 * _check.angle(measured.theta_h, "theta_h")) ** 2
    amplitude = np.zeros((*mean.shape[:2], n_lobes))
    kappa = np.zeros_like(amplitude)
    log_grid = np.log(np.geomspace(*KAPPA, N_GRID))
    for index in np.argwhere(count.any(-1)):
        some = count[*index] > 0.0
        root = np.sqrt(count[*index][some])
        target = root * mean[*index][some]

        def basis(log_kappa: Array, root: Array = root, depth: Array = depth[some]) -> Array:
            return root[:, None] * np.exp(np.exp(log_kappa) * depth[:, None])

        start = log_grid[_exchange(basis(log_grid), target, n_lobes)]
        x, c, _ = refine(basis, target, [start], log_grid[0], log_grid[-1])
        order = np.argsort(-x)
        amplitude[*index], kappa[*index] = c[order], np.exp(x[order])

    # Empty slices
    rows = np.arange(len(theta_d))
    for channel in range(measured.n_channels):
        full = rows[count[:, channel].any(-1)]
        if full.size:
            nearest = full[np.abs(rows[:, None] - full).argmin(1)]
            amplitude[:, channel], kappa[:, channel] = amplitude[nearest, channel], kappa[nearest, channel]
    return VonMisesFisher(theta_d, amplitude, kappa, measured.name)


def _exchange(columns: Array, target: Array, n_lobes: int) -> list[int]:
    """Columns that fit well together, found by exchanging one at a time."""
    from scipy import optimize

    chosen: list[int] = []
    best, idle = np.inf, 0
    for step in range(n_lobes * N_ROUNDS):
        # The oldest is up for exchange; if nothing is better it becomes the youngest
        oldest, others = (chosen[:1], chosen[1:]) if step >= n_lobes else ([], chosen)
        costs = [optimize.nnls(columns[:, [*others, i]], target)[1] for i in range(columns.shape[1])]
        candidate = int(np.argmin(costs))
        if oldest and costs[candidate] >= best * (1.0 - 1e-9):
            chosen, idle = [*others, *oldest], idle + 1
        else:
            chosen, best, idle = [*others, candidate], costs[candidate], 0
        if idle == n_lobes:
            break
    return chosen
