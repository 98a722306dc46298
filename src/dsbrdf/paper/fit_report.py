"""What a fit gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper import metrics
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.paper.collapse import SliceProfile, slice_rows, stack_profiles
from dsbrdf.paper.selection import LobeSelection

if TYPE_CHECKING:
    from dsbrdf.fitting.uncertainty import StandardErrors
    from dsbrdf.paper.fit_slices import Parameters, SliceReport

__all__ = ["Coverage", "Fit", "model_of"]


@dataclass(frozen=True, eq=False)
class Coverage:
    """What became of scattered samples, and how far the fit can be trusted.

    Parameters
    ----------
    n_samples : int
    left_out : dict
        Number of samples that were not fitted, by the reason.
    per_slice : (theta_d,) ndarray of int
        Number of samples that were.
    log_rms : float
        RMS of `ln((model + e) / (f + e))` over the fitted samples, as in `dsbrdf.paper.metrics.log_rms`.
    held_out_log_rms, held_out_rel_rms : float
        RMS of that logarithm, and relative RMS, on samples that the model was not fitted to (five folds); NaN where
        there are too few. They speak for directions like those measured, and not for a peak that none of them saw.
    """

    n_samples: int
    left_out: dict[str, int]
    per_slice: NDArray[np.int_]
    log_rms: float
    held_out_log_rms: float
    held_out_rel_rms: float

    @property
    def n_used(self) -> int:
        """Number of fitted samples."""
        return int(self.per_slice.sum())

    def summary(self) -> dict[str, Any]:
        """Numbers for JSON."""
        return {
            "samples": self.n_samples,
            "samples_used": self.n_used,
            "left_out": self.left_out,
            "slices": len(self.per_slice),
            "slices_without_data": int((self.per_slice == 0).sum()),
            "held_out_log_rms": self.held_out_log_rms,
            "held_out_rel_rms": self.held_out_rel_rms,
        }


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
    measured : MeasuredBRDF or Samples
    options : dict
    coverage : Coverage or None
        Which of the scattered samples were used, and how well others are told from them; None for a table.
    """

    model: DSBRDF
    errors: metrics.FitErrors
    slices: list[SliceReport]
    profiles: list[SliceProfile]
    seconds: float
    selection: LobeSelection | None
    measured: MeasuredBRDF | Samples = field(repr=False)
    options: dict[str, Any] = field(repr=False)
    coverage: Coverage | None = None

    @property
    def table(self) -> MeasuredBRDF:
        """The table that was fitted.

        Raises
        ------
        ValueError
            If scattered samples were.
        """
        if isinstance(self.measured, MeasuredBRDF):
            return self.measured
        raise ValueError(
            f"{self.model.name}: this needs a measured table, and these are {len(self.measured)} scattered samples. "
            "See the model with 'dsbrdf view', or make a table with 'dsbrdf convert'."
        )

    @cached_property
    def log_rms(self) -> float:
        """RMS of the logarithm over all samples, see `dsbrdf.paper.metrics.log_rms`."""
        if self.coverage is not None:
            return self.coverage.log_rms
        theta_d, theta_h, _ = stack_profiles(self.profiles)
        model = self.model
        parameters = model.curves.at(theta_d) if model.curves else (model.kappa, model.gamma, model.beta)
        a, b = metrics.profile_model(theta_h, theta_d, *parameters)
        rows = slice_rows(len(self.table.theta_d), len(self.profiles))
        masks = {key: self.options[key] for key in ("min_theta_h", "perimeter_mask", "theta_h_step")}
        return metrics.log_rms(self.table, rows, a, b, **masks)

    def summary(self) -> dict[str, Any]:
        """Numbers that tell how good the fit is, ready for JSON."""
        return {
            "name": self.model.name,
            "n_lobes": self.model.n_lobes,
            **self.errors.summary(),
            "log_rms": self.log_rms,
            "seconds": self.seconds,
            **({} if self.coverage is None else self.coverage.summary()),
        }

    def standard_errors(self) -> StandardErrors:
        """How uncertain the parameters are, from the Jacobian; see `dsbrdf.fitting.uncertainty.standard_errors`.

        Raises
        ------
        ValueError
            If the fit is not one of least squares to slices.
        """
        from dsbrdf.fitting import uncertainty

        return uncertainty.standard_errors(self)


def model_of(
    profiles: Sequence[SliceProfile],
    parameters: Parameters,
    spike: NDArray[np.float64] | None,
    measured: MeasuredBRDF | Samples,
    options: dict[str, Any],
) -> tuple[DSBRDF, metrics.FitErrors]:
    """The model of fitted slices, and its errors on them."""
    errors = metrics.fit_errors(profiles, *parameters)
    kappa, gamma, beta = parameters
    model = DSBRDF(
        theta_d=np.array([profile.theta_d for profile in profiles]),
        kappa=kappa,
        gamma=gamma,
        beta=beta,
        spike=spike,
        name=measured.name,
        source=measured.source,
        fit_options=options,
        errors=errors.summary(),
        profile=MeasuredProfile.of(*stack_profiles(profiles)),
    )
    return model, errors
