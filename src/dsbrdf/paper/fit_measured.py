"""The fit of a measured BRDF: slices to lobes (Sections 4 and 6)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dsbrdf import _check
from dsbrdf.fitting.fit_scattered import fit_samples
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.collapse import MIN_THETA_H, N_SLICES, SliceProfile, slice_profiles
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.paper.fit_report import Coverage, Fit, model_of
from dsbrdf.paper.fit_slices import ConvergenceWarning, FitStatus, SliceReport, fit_profiles, report_trouble
from dsbrdf.paper.selection import LobeSelection, select_lobes
from dsbrdf.paper.spike import spike_heights

if TYPE_CHECKING:
    from dsbrdf.space import MaterialSpace

__all__ = ["ConvergenceWarning", "Coverage", "Fit", "FitStatus", "SliceReport", "fit", "fit_profiles"]

#: More lobes than this are never needed, and cost without bound.
MAX_LOBES = 10


def fit(
    measured: MeasuredBRDF | Samples,
    n_lobes: int | str = "auto",
    *,
    method: str = "joint",
    loss: str = "l2",
    azimuthal: bool | None = None,
    order: str = "follow",
    n_slices: int | None = None,
    min_theta_h: float | None = None,
    perimeter_mask: bool = True,
    theta_h_step: int = 1,
    spike: bool = True,
    criterion: str | None = None,
    tolerance: float | None = None,
    fill: str = "nearest",
    curves: bool | CurveBasis = False,
    prior: MaterialSpace | None = None,
    strict: bool = False,
) -> Fit:
    """Fit a sum of hemi-EPD lobes to every slice and channel of a measured BRDF.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples
        A table, or scattered samples, which are gathered to slices (`dsbrdf.fitting.fit_scattered`).
    n_lobes : int or "auto", optional
        Lobes in each slice and channel; by default the fewest that Williams' test accepts (Section 5, see
        `dsbrdf.paper.selection.select_lobes`), or that predict held-out samples best.
    method : {"joint", "em"}, optional
        "em" is the expectation-maximisation of Section 4. "joint" starts from its result, and from others, and
        fits all lobes of a slice together; it never ends above "em" on any slice.
    loss : {"l2", "log"}, optional
        Least squares (the paper), or squared logarithms of the mean over phi_d, which weigh the dim tail of a
        lobe as much as its peak; better for rendering.
    azimuthal : bool, optional
        Give each lobe the factor `1 + beta g cos(2 phi_d)` where that pays (by BIC, one decision for the material;
        otherwise beta is 0). On by default for tables, off with `method="em"` and for samples, whose phi_d rarely
        vary enough; False is the paper's model to the letter.
    order : {"follow", "kappa"}, optional
        Lobes of neighbouring slices correspond by likeness, or by the rank of their kappa (the paper).
    n_slices : int, optional
        Slices in theta_d: 18 by default for tables; for samples as many as predict held-out ones best.
    min_theta_h : float, radians, optional
        Samples below are left to the spike: one degree by default for tables (the paper), none for samples.
    perimeter_mask, theta_h_step
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`.
    spike : bool, optional
        Add the delta term where the data call for it (Section 6, `dsbrdf.paper.spike`).
    criterion : {"williams", "bic", "held-out"}, optional
        What chooses the number of lobes, if that is "auto": "williams" by default for tables, where "held-out" fits
        every other phi_d and judges by the rest; always "held-out" for samples.
    tolerance : float, radians, optional
        Samples whose theta_d is farther from that of every slice are left out; half the distance of slices by
        default. For scattered samples only.
    fill : {"nearest", "linear"}, optional
        What slices without a sample get: the lobes of the nearest, or lobes interpolated in theta_d.
    curves : bool or CurveBasis, optional
        Go on from the slices to splines of the parameters over theta_d, six coefficients a curve or as the basis
        says (`CurveBasis()` is that of the paper), fitted to all rows of the table at once (Section 6.C,
        `dsbrdf.fit_curves`). Errors are then over all rows; of scattered samples, over their slices.
    prior : MaterialSpace, optional
        Take the most probable material of a space, given the data: for few, noisy or partial samples
        (`dsbrdf.space.prior_fit`). The space decides on lobes; of the other options, only `min_theta_h` and
        `perimeter_mask` count.
    strict : bool, optional
        Raise instead of warning when a slice did not converge.

    Returns
    -------
    Fit

    Raises
    ------
    TypeError
        If `measured` is neither a table nor samples, e.g. the name of a file.
    ValueError
        If an option is out of range, or no slice has a valid sample.
    RuntimeError
        With `strict`, if a slice did not converge.

    Warns
    -----
    ConvergenceWarning
        If slices ran out of iterations.
    UserWarning
        If no material of `prior` is like the data: they are about the model with a standard deviation of the logarithm
        of more than 0.5, a factor of 1.6.
    """
    if not isinstance(measured, MeasuredBRDF | Samples):
        raise TypeError(
            f"'measured' must be a MeasuredBRDF or Samples, got {type(measured).__name__}. Read a file with "
            "dsbrdf.read(path)."
        )
    is_table = isinstance(measured, MeasuredBRDF)
    azimuthal = is_table and method != "em" if azimuthal is None else azimuthal
    _check_options(n_lobes, method, loss, azimuthal, order, fill)
    _check_kind(is_table, tolerance, theta_h_step, criterion)
    if min_theta_h is None:
        min_theta_h = MIN_THETA_H if is_table else 0.0
    if prior is not None:
        from dsbrdf.space.prior_fit import fit_with_prior

        _check_prior(n_lobes, curves)
        return fit_with_prior(measured, prior, min_theta_h=min_theta_h, perimeter_mask=perimeter_mask)
    how = {"method": method, "loss": loss, "azimuthal": azimuthal, "order": order, "fill": fill}
    masks = {
        "min_theta_h": float(_check.angle(min_theta_h, "min_theta_h")),
        "perimeter_mask": perimeter_mask,
    }
    if isinstance(measured, MeasuredBRDF):
        masks["theta_h_step"] = theta_h_step
        result = _fit_table(
            measured,
            n_lobes,
            N_SLICES if n_slices is None else n_slices,
            how,
            masks,
            spike,
            criterion or "williams",
        )
    else:
        result = fit_samples(measured, n_lobes, n_slices, how, masks, spike, tolerance)
    report_trouble(result.slices, strict)
    if curves is False:
        return result
    from dsbrdf.fitting.fit_splines import refit

    return refit(result, None if curves is True else curves, strict=strict)


def _fit_table(
    measured: MeasuredBRDF,
    n_lobes: int | str,
    n_slices: int,
    how: dict[str, Any],
    masks: dict[str, Any],
    spike: bool,
    criterion: str,
) -> Fit:
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
    model, errors = model_of(profiles, parameters, heights, measured, options)
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


def _check_kind(is_table: bool, tolerance: float | None, theta_h_step: int, criterion: str | None) -> None:
    """Refuse options of tables for samples, and the other way round."""
    if is_table and tolerance is not None:
        raise ValueError("'tolerance' is for scattered samples: the slices of a table are rows of it.")
    if not is_table and theta_h_step != 1:
        raise ValueError(f"'theta_h_step' is for tables, got {theta_h_step} for scattered samples.")
    if not is_table and criterion not in (None, "held-out"):
        raise ValueError(
            f"'criterion' must be 'held-out' for scattered samples, got {criterion!r}: the other two compare means "
            "over phi_d, and here hardly any sample shares its theta_h with another."
        )


def _check_prior(n_lobes: int | str, curves: bool | CurveBasis) -> None:
    if n_lobes != "auto" or curves is not False:
        raise ValueError(
            "with 'prior', the space decides on lobes and curves: leave out 'n_lobes' and 'curves'."
        )


def _check_options(
    n_lobes: int | str, method: str, loss: str, azimuthal: bool, order: str, fill: str
) -> None:
    choices = {"method": (method, ("joint", "em")), "loss": (loss, ("l2", "log"))}
    choices |= {"order": (order, ("follow", "kappa")), "fill": (fill, ("nearest", "linear"))}
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
