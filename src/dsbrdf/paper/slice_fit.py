"""The fit of lobes to profiles of slices, and how it went."""

from __future__ import annotations

import enum
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.geometry import half_diff
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile, stack_profiles

__all__ = ["ConvergenceWarning", "FitStatus", "Parameters", "SliceReport", "fit_profiles", "report_trouble"]


class ConvergenceWarning(UserWarning):
    """Some slices ran out of iterations."""


class FitStatus(enum.IntEnum):
    """How the fit of a slice ended."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    NO_DATA = 2

    @property
    def ok(self) -> bool:
        """Whether the parameters are a minimum."""
        return self is FitStatus.CONVERGED

    @property
    def message(self) -> str:
        """What happened, and what to do about it."""
        return {
            FitStatus.CONVERGED: "converged",
            FitStatus.MAX_ITERATIONS: "out of iterations; the best so far is kept. Fewer lobes converge sooner.",
            FitStatus.NO_DATA: "no valid sample, or all are zero: empty slices take the nearest slice's lobes.",
        }[self]


@dataclass(frozen=True)
class SliceReport:
    """How the fit of one slice and channel went.

    Parameters
    ----------
    theta_d : float, radians
    channel : int
    status : FitStatus
    iterations : int
        Of the EM and of the joint fit together.
    objective : float
        Sum of squares over all samples; under the logarithmic loss its counterpart.
    em_history : list of float
        Sum of squares before the EM and after each of its rounds.
    """

    theta_d: float
    channel: int
    status: FitStatus
    iterations: int
    objective: float
    em_history: list[float] = field(repr=False)


Parameters = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def fit_profiles(
    profiles: Sequence[SliceProfile],
    n_lobes: int,
    *,
    method: str = "joint",
    loss: str = "l2",
    azimuthal: bool = False,
    order: str = "follow",
    near_pole: Sequence[SliceProfile] | None = None,
) -> tuple[Parameters, list[SliceReport]]:
    """Fit slices; the work of `fit_slices` without a table.

    Parameters
    ----------
    profiles : sequence of SliceProfile
        Ascending in theta_d.
    n_lobes, method, loss, azimuthal, order
        See `dsbrdf.paper.fit_slices`.
    near_pole : sequence of SliceProfile, optional
        The slices with no lower cut of theta_h. No lobe goes above the brightest mean over phi_d there; without them
        a narrow lobe can grow to 100 times what was fitted, where nothing is.

    Returns
    -------
    parameters : (kappa, gamma, beta), each (theta_d, channel, lobe) ndarray
    reports : list of SliceReport

    Raises
    ------
    ValueError
        If no slice has a valid sample.
    """
    theta_d, theta_h, moments = stack_profiles(profiles)
    count = moments[..., 0].sum(-1)
    if not count.any():
        raise ValueError(
            "no slice has a valid sample after masking. Lower 'min_theta_h', switch off 'perimeter_mask', or "
            "check that the measurement holds positive values."
        )
    result = _core.fit(
        moments,
        half_diff.log_cos(theta_h),
        half_diff.azimuthal_factor(theta_h, theta_d[:, None]),
        n_lobes=n_lobes,
        method=method,
        azimuthal=azimuthal,
        follow=order == "follow",
        log_offset=metrics.LOG_OFFSET if loss == "log" else None,
        max_height=None if near_pole is None else brightest(near_pole, profiles),
    )
    n_channels = count.shape[1]
    reports = [
        SliceReport(
            theta_d=float(theta_d[i // n_channels]),
            channel=i % n_channels,
            status=FitStatus(status),
            iterations=result["iterations"][i],
            objective=result["objective"][i],
            em_history=result["em_history"][i],
        )
        for i, status in enumerate(result["status"])
    ]
    parameters = (result["kappa"], result["gamma"], result["beta"])
    fill_empty(parameters, count > 0.0)
    return parameters, reports


def brightest(near_pole: Sequence[SliceProfile], profiles: Sequence[SliceProfile]) -> NDArray[np.float64]:
    """Largest mean over phi_d of slices (theta_d, channel); NaN where there is no more than in `profiles`."""
    count, fitted = (np.array([profile.count for profile in slices]) for slices in (near_pole, profiles))
    mean = np.array([np.nan_to_num(profile.mean) for profile in near_pole])
    return np.where((count > fitted).any(-1), mean.max(-1), np.nan)


def fill_empty(parameters: Parameters, has_data: NDArray[np.bool_]) -> None:
    """Give slices (theta_d, channel) without a sample the parameters of the nearest that has some, in place."""
    for channel in range(has_data.shape[1]):
        known, empty = (np.flatnonzero(has_data[:, channel] == some) for some in (True, False))
        if known.size and empty.size:
            nearest = known[np.abs(empty[:, None] - known).argmin(1)]
            for values in parameters:
                values[empty, channel] = values[nearest, channel]


def report_trouble(reports: Sequence[SliceReport], strict: bool) -> None:
    """Warn (or raise, if `strict`) where slices ran out of iterations, on behalf of who called `fit_slices`."""
    trouble = [report for report in reports if report.status is FitStatus.MAX_ITERATIONS]
    if not trouble:
        return
    where = ", ".join(
        f"theta_d {np.rad2deg(report.theta_d):.1f} degrees channel {report.channel}" for report in trouble[:5]
    ) + (", ..." if len(trouble) > 5 else "")
    text = f"{len(trouble)} of {len(reports)} slices ({where}): {FitStatus.MAX_ITERATIONS.message}"
    if strict:
        raise RuntimeError(text)
    warnings.warn(text, ConvergenceWarning, stacklevel=3)
