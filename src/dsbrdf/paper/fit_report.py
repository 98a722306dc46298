"""What a fit of slices gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from dsbrdf._brief import Brief
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile, slice_rows, stack_profiles
from dsbrdf.paper.selection import LobeSelection
from dsbrdf.paper.slice_fit import SliceReport
from dsbrdf.paper.slices import Slices

__all__ = ["SliceFit"]


@dataclass(frozen=True, eq=False, repr=False)
class SliceFit(Brief):
    """A model of slices, how good it is and how it came about.

    Parameters
    ----------
    model : Slices
    errors : FitErrors
        Over the samples of the slices, inside the masks.
    slices : sequence of SliceReport
        One a slice and channel, channel fastest.
    profiles : sequence of SliceProfile
        What was fitted.
    seconds : float
        Time of the collapse, the choice of lobes and the fit.
    selection : LobeSelection or None
        Why there are so many lobes, if that was chosen.
    measured : MeasuredBRDF
    options : dict

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> found = paper.fit_slices(dsbrdf.material("matte"), 1)
    >>> len(found.slices)  # 18 of each of three channels
    54
    """

    model: Slices
    errors: metrics.FitErrors
    slices: Sequence[SliceReport]
    profiles: Sequence[SliceProfile]
    seconds: float
    selection: LobeSelection | None
    measured: MeasuredBRDF = field(repr=False)
    options: dict[str, Any] = field(repr=False)

    @cached_property
    def log_rms(self) -> float:
        """RMS of the logarithm over all samples of the slices, see `dsbrdf.paper.metrics.log_rms`."""
        theta_d, theta_h, _ = stack_profiles(self.profiles)
        model = self.model
        a, b = metrics.profile_model(theta_h, theta_d, model.kappa, model.gamma, model.beta)
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
