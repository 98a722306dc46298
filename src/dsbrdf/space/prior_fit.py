"""`dsbrdf.fit(..., prior=space)`: tables and scattered samples to the most probable material of a space."""

from __future__ import annotations

import dataclasses
import time
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.fitting import scattered
from dsbrdf.fitting.fit_scattered import even_slices
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.collapse import N_SLICES, SliceProfile, slice_profiles
from dsbrdf.paper.fit_report import Coverage, Fit, model_of
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.prior import fit_scores

__all__ = ["fit_with_prior"]

Array = NDArray[np.float64]

#: Of a table, phi_d this far apart are taken: neighbours say the same.
TABLE_PHI_D = 12
#: A standard deviation of the logarithm that noise rarely reaches: a factor of 1.6. With 26 materials, NBRDF-decoded
#: MERL tables that are none of them stay below; with 6 most are above.
POOR_SIGMA = 0.5


def fit_with_prior(
    measured: MeasuredBRDF | Samples, space: MaterialSpace, *, min_theta_h: float, perimeter_mask: bool
) -> Fit:
    """The most probable material of a space, given a table or samples; see `dsbrdf.fit`.

    Raises
    ------
    ValueError
        If the data have other channels or another convention of table cells than the space, or no sample is valid.

    Warns
    -----
    UserWarning
        If sigma, the estimated standard deviation of `ln(f + e)` about the model, is above `POOR_SIGMA`: noise that
        strong is rare, so nothing in the space is like the material.
    """
    start = time.perf_counter()
    min_theta_h = float(_check.angle(min_theta_h, "min_theta_h"))
    if isinstance(measured, MeasuredBRDF):
        _check_convention(measured, space)
        profiles = slice_profiles(
            measured, n_slices=N_SLICES, min_theta_h=min_theta_h, perimeter_mask=perimeter_mask
        )
        at, values = _cells(measured, profiles)
        found = fit_scores(space, at.theta_h, at.theta_d, at.phi_d, values)
    else:
        at = scattered.Coordinates.of(measured)
        kept = scattered.within(at, min_theta_h, perimeter_mask)
        index = np.where(kept, scattered.nearest_slice(at.theta_d, even_slices(N_SLICES)), -1)
        profiles = scattered.gather_by(measured, at, even_slices(N_SLICES), index)
        values = np.where(kept[:, None], measured.values, np.nan)
        found = fit_scores(space, at.theta_h, at.theta_d, at.phi_d, values, weights=measured.weights)
    if found.sigma > POOR_SIGMA:
        warnings.warn(
            f"{measured.name}: no material of the space is like it: its samples are missed by a factor of "
            f"{np.exp(found.sigma):.1f} (sigma {found.sigma:.2f}). Build the space of more materials, some of them "
            f"like this one (now {len(space.names)}), or leave out 'prior'.",
            UserWarning,
            stacklevel=3,
        )
    theta_d = np.array([profile.theta_d for profile in profiles])
    best = space.model(found.scores, measured.name, theta_d)
    options: dict[str, Any] = {
        "prior": {"materials": len(space.names), "sigma": found.sigma, "scores_decided": found.n_effective},
        "min_theta_h": min_theta_h,
        "perimeter_mask": perimeter_mask,
        "theta_h_step": 1,
        "convention": space.settings.convention,
    }
    parameters = (np.asarray(best.kappa), np.asarray(best.gamma), np.asarray(best.beta))
    model, errors = model_of(profiles, parameters, None, measured, options)
    fit = Fit(model, errors, [], profiles, time.perf_counter() - start, None, measured, options)
    return fit if isinstance(measured, MeasuredBRDF) else _covered(fit, measured, values, index)


def _check_convention(measured: MeasuredBRDF, space: MaterialSpace) -> None:
    expected = space.settings.convention
    if expected and measured.convention != expected:
        raise ValueError(
            f"{measured.name}: read with the {measured.convention!r} convention of table cells, where the space has "
            f"{expected!r}: read the table with convention={expected!r}."
        )


def _cells(measured: MeasuredBRDF, profiles: list[SliceProfile]) -> tuple[scattered.Coordinates, Array]:
    """Angles and values (sample, channel) of the cells of the slices at some of their phi_d."""
    rows = np.array([np.abs(measured.theta_d - profile.theta_d).argmin() for profile in profiles])
    every = max(len(measured.phi_d) // TABLE_PHI_D, 1)
    phi_d = measured.phi_d[every // 2 :: every]
    values = np.moveaxis(measured.rows(rows)[..., every // 2 :: every], 0, -1)
    fitted = np.stack([profile.count.any(0) for profile in profiles], axis=1)
    values = np.where(fitted[..., None, None], values, np.nan)
    angles = np.broadcast_arrays(measured.theta_h[:, None, None], measured.theta_d[rows, None], phi_d)
    some = np.isfinite(values).any(-1)
    return scattered.Coordinates(*(angle[some] for angle in angles)), values[some]


def _covered(fit: Fit, samples: Samples, values: Array, index: NDArray[np.int_]) -> Fit:
    """The fit of samples with its coverage; nothing is held out, the prior stands in for that."""
    some = np.isfinite(values)
    log = np.log(
        (fit.model.eval(samples.wi, samples.wo) + LOG_OFFSET) / (np.where(some, values, 0.0) + LOG_OFFSET)
    )
    used = some.any(-1)
    invalid = int((~np.isfinite(samples.values).any(-1)).sum())
    masked = len(samples) - int(used.sum()) - invalid
    reasons = {"invalid": invalid, "near the pole or perimeter": masked}
    coverage = Coverage(
        n_samples=len(samples),
        left_out={reason: n for reason, n in reasons.items() if n},
        per_slice=np.bincount(index[used], minlength=len(fit.profiles)),
        log_rms=float(np.sqrt((log[some] ** 2).mean())),
        held_out_log_rms=float("nan"),
        held_out_rel_rms=float("nan"),
    )
    return dataclasses.replace(fit, coverage=coverage)
