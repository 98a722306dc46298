"""The fit of slices of a table: masks, the number of lobes, lobes, spike (Sections 4 to 6)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import MIN_THETA_H, N_SLICES, SliceProfile, slice_profiles, stack_profiles
from dsbrdf.paper.fit_report import SliceFit
from dsbrdf.paper.selection import LobeSelection, select_lobes
from dsbrdf.paper.slice_fit import Parameters, fit_profiles, report_trouble
from dsbrdf.paper.slices import Slices
from dsbrdf.paper.spike import spike_heights

__all__ = ["MAX_LOBES", "fit_slices"]

#: More lobes than this are never needed, and cost without bound.
MAX_LOBES = 10


def fit_slices(
    measured: MeasuredBRDF,
    n_lobes: int | str = "auto",
    *,
    method: str = "joint",
    azimuthal: bool = False,
    loss: str = "l2",
    order: str = "follow",
    n_slices: int = N_SLICES,
    min_theta_h: float = MIN_THETA_H,
    perimeter_mask: bool = True,
    theta_h_step: int = 1,
    spike: bool = True,
    criterion: str = "williams",
    strict: bool = False,
) -> SliceFit:
    """Fit a sum of hemi-EPD lobes to every slice and channel of a table: the paper's method.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_lobes : int or "auto", optional
        Lobes in each slice and channel; by default the fewest that the criterion accepts (Section 5, see
        `dsbrdf.paper.selection.select_lobes`).
    method : {"joint", "em"}, optional
        "em" is the expectation-maximisation of Section 4. "joint" starts from its result, and from others, and
        fits all lobes of a slice together; it never ends above "em" on any slice.
    azimuthal : bool, optional
        Give each lobe the factor `1 + beta g cos(2 phi_d)` where that pays (by BIC, one decision for the material;
        otherwise beta is 0). False is the paper's model to the letter.
    loss : {"l2", "log"}, optional
        Least squares (the paper), or squared logarithms of the mean over phi_d, which weigh the dim tail of a
        lobe as much as its peak.
    order : {"follow", "kappa"}, optional
        Lobes of neighbouring slices correspond by likeness, or by the rank of their kappa (the paper).
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`. Those below `min_theta_h` are left to
        the spike.
    spike : bool, optional
        Add the delta term where the data call for it (Section 6, `dsbrdf.paper.spike`).
    criterion : {"williams", "bic", "held-out"}, optional
        What chooses the number of lobes, if that is "auto"; "held-out" fits every other phi_d and judges by the rest.
    strict : bool, optional
        Raise instead of warning when a slice did not converge.

    Returns
    -------
    SliceFit

    Raises
    ------
    TypeError
        If `measured` is no table.
    ValueError
        If an option is out of range, or no slice has a valid sample.
    RuntimeError
        With `strict`, if a slice did not converge.

    Warns
    -----
    ConvergenceWarning
        If slices ran out of iterations.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> fit = paper.fit_slices(dsbrdf.material("rough-gold"), 2)
    >>> fit.model
    Slices('rough-gold', 2 lobes, 3 channels, 18 slices)
    """
    if not isinstance(measured, MeasuredBRDF):
        raise TypeError(
            f"'measured' must be a MeasuredBRDF, got {type(measured).__name__}. Read a file with dsbrdf.read(path); "
            "scattered samples have no slices: fit them with dsbrdf.fit."
        )
    _check_options(n_lobes, method, loss, azimuthal, order)
    how: dict[str, Any] = {"method": method, "loss": loss, "azimuthal": azimuthal, "order": order}
    masks: dict[str, Any] = {
        "min_theta_h": float(_check.angle(min_theta_h, "min_theta_h")),
        "perimeter_mask": perimeter_mask,
        "theta_h_step": theta_h_step,
    }
    start = time.perf_counter()
    # Samples near the pole are for the spike, and bound the height of lobes
    near_pole = slice_profiles(measured, n_slices=n_slices, **{**masks, "min_theta_h": 0.0})
    profiles = [profile.cut(masks["min_theta_h"]) for profile in near_pole]
    chosen = None
    if isinstance(n_lobes, str):
        chosen = _select(measured, profiles, n_slices, masks, criterion)
        n_lobes = chosen.n_lobes
    parameters, reports = fit_profiles(profiles, n_lobes, near_pole=near_pole, **how)
    heights = spike_heights(near_pole, *parameters[:2]) if spike else None
    seconds = time.perf_counter() - start
    options = {**how, "n_slices": n_slices, "spike": spike, **masks, "convention": measured.convention}
    if chosen is not None:
        options["selection"] = {"criterion": chosen.criterion, "values": chosen.values.tolist()}
    model, errors = _model_of(profiles, parameters, heights, measured, options)
    report_trouble(reports, strict)
    return SliceFit(model, errors, reports, profiles, seconds, chosen, measured, options)


def _model_of(
    profiles: Sequence[SliceProfile],
    parameters: Parameters,
    spike: NDArray[np.float64] | None,
    measured: MeasuredBRDF,
    options: dict[str, Any],
) -> tuple[Slices, metrics.FitErrors]:
    """The model of fitted slices, and its errors on them."""
    errors = metrics.fit_errors(profiles, *parameters)
    kappa, gamma, beta = parameters
    model = Slices(
        theta_d=np.array([profile.theta_d for profile in profiles]),
        kappa=kappa,
        gamma=gamma,
        beta=beta,
        spike=spike,  # type: ignore[arg-type]
        name=measured.name,
        source=measured.source,
        fit_options=options,
        errors=errors.summary(),
        profile=MeasuredProfile.of(*stack_profiles(profiles)),
        channels=measured.channels,
    )
    return model, errors


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
    choices = {
        "method": (method, ("joint", "em")),
        "loss": (loss, ("l2", "log")),
        "order": (order, ("follow", "kappa")),
    }
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
