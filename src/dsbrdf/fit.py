"""The fit of a measured BRDF: slices to lobes (Sections 4 and 6)."""

from __future__ import annotations

import enum
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check, _core, half_diff, metrics
from dsbrdf.measured.brdf import MeasuredBRDF
from dsbrdf.model import DSBRDF
from dsbrdf.selection import LobeSelection, select_lobes
from dsbrdf.slices import (
    MIN_THETA_H,
    N_SLICES,
    MeasuredProfile,
    SliceProfile,
    slice_profiles,
    slice_rows,
    stack_profiles,
)
from dsbrdf.spike import spike_heights

__all__ = ["ConvergenceWarning", "Fit", "FitStatus", "SliceReport", "fit"]

#: More lobes than this are never needed, and cost without bound.
MAX_LOBES = 10


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


@dataclass(frozen=True, eq=False)
class Fit:
    """A model, how good it is and how it came about.

    Parameters
    ----------
    model : DSBRDF
    errors : FitErrors
    slices : list of SliceReport
        One a slice and channel, channel fastest.
    profiles : list of SliceProfile
        What was fitted.
    seconds : float
        Time of the collapse, the choice of lobes and the fit.
    selection : LobeSelection or None
        Why there are so many lobes, if that was chosen.
    """

    model: DSBRDF
    errors: metrics.FitErrors
    slices: list[SliceReport]
    profiles: list[SliceProfile]
    seconds: float
    selection: LobeSelection | None
    measured: MeasuredBRDF = field(repr=False)
    options: dict[str, Any] = field(repr=False)

    @cached_property
    def log_rms(self) -> float:
        """RMS of the logarithm over all samples, see `dsbrdf.metrics.log_rms`."""
        _, theta_h, _ = stack_profiles(self.profiles)
        model = self.model
        a, b = metrics.profile_model(theta_h, model.theta_d, model.kappa, model.gamma, model.beta)
        rows = slice_rows(len(self.measured.theta_d), len(self.profiles))
        masks = {key: self.options[key] for key in ("min_theta_h", "perimeter_mask", "theta_h_step")}
        return metrics.log_rms(self.measured, rows, a, b, **masks)

    def summary(self) -> dict[str, Any]:
        """Numbers that tell how good the fit is, ready for JSON."""
        return {
            "name": self.model.name,
            "n_lobes": self.model.n_lobes,
            **self.errors.summary(),
            "log_rms": self.log_rms,
            "seconds": self.seconds,
        }


def fit(
    measured: MeasuredBRDF,
    n_lobes: int | str = "auto",
    *,
    method: str = "joint",
    loss: str = "l2",
    azimuthal: bool | None = None,
    order: str = "follow",
    n_slices: int = N_SLICES,
    min_theta_h: float = MIN_THETA_H,
    perimeter_mask: bool = True,
    theta_h_step: int = 1,
    spike: bool = True,
    criterion: str = "williams",
    strict: bool = False,
) -> Fit:
    """Fit a sum of hemi-EPD lobes to every slice and channel of a measured BRDF.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_lobes : int or "auto", optional
        Lobes in each slice and channel; by default the fewest that Williams' test accepts (Section 5, see
        `dsbrdf.selection.select_lobes`).
    method : {"joint", "em"}, optional
        "em" is the expectation-maximisation of Section 4. "joint" starts from its result, and from others, and
        fits all lobes of a slice together; it never ends above "em" on any slice.
    loss : {"l2", "log"}, optional
        Least squares (the paper), or squared logarithms of the mean over phi_d, which weigh the dim tail of a
        lobe as much as its peak; better for rendering.
    azimuthal : bool, optional
        Give each lobe the factor `1 + beta g cos(2 phi_d)` where that pays (by BIC, one decision for the material;
        otherwise beta is 0). On by default, off with `method="em"`; False is the paper's model to the letter.
    order : {"follow", "kappa"}, optional
        Lobes of neighbouring slices correspond by likeness, or by the rank of their kappa (the paper).
    n_slices, min_theta_h, perimeter_mask, theta_h_step
        Which samples are fitted; see `dsbrdf.slices.slice_profiles`.
    spike : bool, optional
        Add the delta term where the data call for it (Section 6, `dsbrdf.spike`).
    criterion : {"williams", "bic", "held-out"}, optional
        What chooses the number of lobes, if that is "auto"; "held-out" fits every other phi_d and judges by the
        rest.
    strict : bool, optional
        Raise instead of warning when a slice did not converge.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.
    RuntimeError
        With `strict`, if a slice did not converge.

    Warns
    -----
    ConvergenceWarning
        If slices ran out of iterations.
    """
    azimuthal = method != "em" if azimuthal is None else azimuthal
    _check_options(n_lobes, method, loss, azimuthal, order)
    min_theta_h = float(_check.angle(min_theta_h, "min_theta_h"))
    masks: dict[str, Any] = {
        "min_theta_h": min_theta_h,
        "perimeter_mask": perimeter_mask,
        "theta_h_step": theta_h_step,
    }
    options: dict[str, Any] = {
        "method": method,
        "loss": loss,
        "azimuthal": azimuthal,
        "order": order,
        "n_slices": n_slices,
        "spike": spike,
        **masks,
        "convention": measured.convention,
    }
    start = time.perf_counter()
    # Samples near the pole are for the spike alone
    near_pole = slice_profiles(measured, n_slices=n_slices, **{**masks, "min_theta_h": 0.0})
    profiles = [profile.cut(min_theta_h) for profile in near_pole]
    chosen = None
    if isinstance(n_lobes, str):
        chosen = _select(measured, profiles, n_slices, masks, criterion)
        n_lobes = chosen.n_lobes
    parameters, reports = fit_profiles(
        profiles, n_lobes, method=method, loss=loss, azimuthal=azimuthal, order=order
    )
    heights = spike_heights(near_pole, *parameters[:2]) if spike else None
    seconds = time.perf_counter() - start
    _report_trouble(reports, strict)

    errors = metrics.fit_errors(profiles, *parameters)
    model = DSBRDF(
        theta_d=np.array([profile.theta_d for profile in profiles]),
        kappa=parameters[0],
        gamma=parameters[1],
        beta=parameters[2],
        spike=heights,
        name=measured.name,
        source=measured.source,
        fit_options=options,
        errors=errors.summary(),
        profile=MeasuredProfile.of(profiles),
    )
    return Fit(model, errors, reports, profiles, seconds, chosen, measured, options)


def _select(
    measured: MeasuredBRDF,
    profiles: Sequence[SliceProfile],
    n_slices: int,
    masks: dict[str, Any],
    criterion: str,
) -> LobeSelection:
    """Choose the number of lobes; for held-out error, from two halves of phi_d."""
    if criterion != "held-out":
        return select_lobes(profiles, criterion=criterion)
    fitted, held_out = (
        slice_profiles(half, n_slices=n_slices, **masks) for half in measured.every_other_phi_d()
    )
    return select_lobes(fitted, criterion=criterion, held_out=held_out)


def _check_options(n_lobes: int | str, method: str, loss: str, azimuthal: bool, order: str) -> None:
    choices = {"method": (method, ("joint", "em")), "loss": (loss, ("l2", "log"))}
    choices["order"] = (order, ("follow", "kappa"))
    for name, (value, allowed) in choices.items():
        if value not in allowed:
            raise ValueError(f"'{name}' must be {' or '.join(map(repr, allowed))}, got {value!r}.")
    known = n_lobes == "auto" if isinstance(n_lobes, str) else 1 <= n_lobes <= MAX_LOBES
    if not known:
        raise ValueError(f"'n_lobes' must be between 1 and {MAX_LOBES}, or 'auto', got {n_lobes!r}.")
    if method == "em" and loss != "l2":
        raise ValueError("method='em' minimises squares: it takes loss='l2' only. Use method='joint'.")
    if method == "em" and azimuthal:
        raise ValueError(
            "method='em' has no azimuthal term: shares of lobes that differ over phi_d do not collapse to sums. "
            "Use azimuthal=False or method='joint'."
        )


Parameters = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def fit_profiles(
    profiles: Sequence[SliceProfile],
    n_lobes: int,
    *,
    method: str = "joint",
    loss: str = "l2",
    azimuthal: bool = True,
    order: str = "follow",
) -> tuple[Parameters, list[SliceReport]]:
    """Fit slices; the work of `fit` without a table.

    Parameters
    ----------
    profiles : sequence of SliceProfile
        Ascending in theta_d.
    n_lobes, method, loss, azimuthal, order
        See `fit`.

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
    for values in parameters:
        _fill_empty(values, count > 0.0)
    return parameters, reports


def _fill_empty(values: NDArray[np.float64], has_data: NDArray[np.bool_]) -> None:
    """Give slices (theta_d, channel) without a sample the parameters of the nearest that has some."""
    index = np.arange(len(values))
    for channel in range(values.shape[1]):
        known = index[has_data[:, channel]]
        if known.size:
            nearest = known[np.abs(index[:, None] - known).argmin(1)]
            values[:, channel] = values[nearest, channel]


def _report_trouble(reports: Sequence[SliceReport], strict: bool) -> None:
    trouble = [report for report in reports if report.status is FitStatus.MAX_ITERATIONS]
    if not trouble:
        return
    where = ", ".join(f"theta_d={report.theta_d:.4f} channel {report.channel}" for report in trouble[:5]) + (
        ", ..." if len(trouble) > 5 else ""
    )
    text = f"{len(trouble)} of {len(reports)} slices ({where}): {FitStatus.MAX_ITERATIONS.message}"
    if strict:
        raise RuntimeError(text)
    warnings.warn(text, ConvergenceWarning, stacklevel=3)
