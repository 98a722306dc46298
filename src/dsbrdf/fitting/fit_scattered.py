"""The fit of scattered samples: how many slices, how many lobes, and how far to trust it.

Samples go to the nearest of evenly spaced slices. With few samples, few and wide slices serve better; what is best
differs between materials and between scans, so both numbers are chosen by five-fold cross-validation.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.fitting import scattered
from dsbrdf.measured.samples import Samples
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile
from dsbrdf.paper.fit_report import Coverage, Fit, model_of
from dsbrdf.paper.fit_slices import fit_profiles
from dsbrdf.paper.selection import LobeSelection
from dsbrdf.paper.spike import spike_heights

__all__ = ["even_slices", "fit_samples"]

#: Numbers of slices, and of lobes up to which, that are tried.
SLICES = (1, 2, 3, 4, 6, 9, 12, 18)
MAX_TRIED_LOBES = 3
FOLDS = 5
#: Samples a number of the model that a fit is tried with at least.
SAMPLES_A_NUMBER = 2.0


def even_slices(n_slices: int) -> NDArray[np.float64]:
    """Middles (slice,) in radians of `n_slices` equal parts of 0 to pi/2.

    Raises
    ------
    ValueError
        If there is no slice.
    """
    if n_slices < 1:
        raise ValueError(f"'n_slices' must be at least 1, got {n_slices}.")
    return np.pi / 2 * (np.arange(n_slices) + 0.5) / n_slices


def fit_samples(
    samples: Samples,
    n_lobes: int | str,
    n_slices: int | None,
    how: dict[str, Any],
    masks: dict[str, Any],
    spike: bool,
    tolerance: float | None,
) -> Fit:
    """Fit scattered samples; `how` and `masks` are options of `dsbrdf.fit`."""
    start = time.perf_counter()
    scan = _Scan.of(samples, how, masks, tolerance)
    lobes = range(1, MAX_TRIED_LOBES + 1) if isinstance(n_lobes, str) else (int(n_lobes),)
    slices = SLICES if n_slices is None else (n_slices,)
    tried = {(n, k): scan.held_out(n, k) for n, k in scan.affordable(slices, lobes)}
    n_slices, n_lobes = min(tried, key=lambda key: (np.nan_to_num(tried[key][0], nan=np.inf), key))
    chosen = None
    if len(lobes) > 1:
        values = np.array([tried.get((n_slices, k), (np.inf,))[0] for k in lobes])
        nothing = np.full(len(values), np.nan)
        chosen = LobeSelection(n_lobes, "held-out", values, nothing, nothing)

    theta_d = even_slices(n_slices)
    index = scan.slices_of(theta_d, scan.kept)
    profiles = scattered.gather_by(samples, scan.at, theta_d, index)
    parameters, reports = fit_profiles(profiles, n_lobes, **how)
    heights = None
    if spike and masks["min_theta_h"] > 0.0:
        heights = spike_heights(scan.near_pole(theta_d), *parameters[:2])
    seconds = time.perf_counter() - start

    options = {**how, "n_slices": n_slices, "spike": spike, **masks, "tolerance": scan.tolerance_of(n_slices)}
    model, errors = model_of(profiles, parameters, heights, samples, options)
    # Hardly any two samples share their angles: there are no means to be floors
    unknown = np.full_like(errors.energy, np.nan)
    errors = dataclasses.replace(errors, bivariate=unknown, monotone=unknown, azimuthal=unknown)
    model = model.replace(errors=errors.summary())
    log_rms, _ = _errors(model, samples, index >= 0)
    coverage = Coverage(
        n_samples=len(samples),
        left_out=scan.left_out(index),
        per_slice=np.array([(index == i).sum() for i in range(n_slices)]),
        log_rms=log_rms,
        held_out_log_rms=tried[n_slices, n_lobes][0],
        held_out_rel_rms=tried[n_slices, n_lobes][1],
    )
    return Fit(model, errors, reports, profiles, seconds, chosen, samples, options, coverage)


@dataclass(frozen=True, eq=False)
class _Scan:
    """Samples, which of them the masks leave, and the fold of each."""

    samples: Samples
    at: scattered.Coordinates
    how: dict[str, Any]
    masks: dict[str, Any]
    tolerance: float | None
    kept: NDArray[np.bool_]
    fold: NDArray[np.int_]

    @classmethod
    def of(
        cls, samples: Samples, how: dict[str, Any], masks: dict[str, Any], tolerance: float | None
    ) -> _Scan:
        at = scattered.Coordinates.of(samples)
        kept = scattered.within(at, **masks) & np.isfinite(samples.values).any(-1)
        # Neighbours in theta_d and theta_h go to different folds; there is no chance in it
        order = np.lexsort((at.theta_h, at.theta_d))
        order = order[kept[order]]
        fold = np.full(len(samples), -1)
        fold[order] = np.arange(len(order)) % FOLDS
        return cls(samples, at, how, masks, tolerance, kept, fold)

    def affordable(self, slices: Any, lobes: Any) -> Iterator[tuple[int, int]]:
        """Numbers of slices and of lobes with enough samples for them; the least if there are never enough."""
        numbers = 3 if self.how["azimuthal"] else 2
        pairs = [(n, k) for n in slices for k in lobes]
        most = self.kept.sum() / (SAMPLES_A_NUMBER * numbers)
        yield from [pair for pair in pairs if pair[0] * pair[1] <= most] or pairs[:1]

    def tolerance_of(self, n_slices: int) -> float:
        return np.pi / 4 / n_slices if self.tolerance is None else self.tolerance

    def slices_of(self, theta_d: NDArray[np.float64], which: NDArray[np.bool_]) -> NDArray[np.int_]:
        """Slice of each sample, -1 for those that are not of `which` or beyond the tolerance."""
        index = scattered.nearest_slice(self.at.theta_d, theta_d, self.tolerance_of(len(theta_d)))
        return np.where(which, index, -1)

    def near_pole(self, theta_d: NDArray[np.float64]) -> list[SliceProfile]:
        which = scattered.within(self.at, 0.0, self.masks["perimeter_mask"])
        return scattered.gather_by(self.samples, self.at, theta_d, self.slices_of(theta_d, which))

    def held_out(self, n_slices: int, n_lobes: int) -> tuple[float, float]:
        """RMS of the logarithm and relative RMS on samples that were not fitted; NaN where none can be left out."""
        theta_d = even_slices(n_slices)
        predicted = np.full(self.samples.values.shape, np.nan)
        for fold in range(FOLDS):
            index = self.slices_of(theta_d, self.kept & (self.fold != fold))
            out = self.fold == fold
            if not out.any() or not (index >= 0).any():
                continue
            profiles = scattered.gather_by(self.samples, self.at, theta_d, index)
            (kappa, gamma, beta), _ = fit_profiles(profiles, n_lobes, **self.how)
            model = DSBRDF(theta_d, kappa, gamma, beta)
            predicted[out] = model.eval(self.samples.wi[out], self.samples.wo[out])
        return _misses(predicted, self.samples)

    def left_out(self, index: NDArray[np.int_]) -> dict[str, int]:
        """How many samples were not fitted, and why; the first reason counts."""
        invalid = ~np.isfinite(self.samples.values).any(-1)
        near_pole = ~invalid & (self.at.theta_h < self.masks["min_theta_h"])
        rest = ~invalid & ~near_pole
        far = rest & self.kept & (index < 0)
        reasons = {
            "invalid": invalid,
            "near the pole": near_pole,
            "perimeter": rest & ~self.kept,
            "far from every slice": far,
        }
        return {reason: int(which.sum()) for reason, which in reasons.items() if which.any()}


def _errors(model: DSBRDF, samples: Samples, which: NDArray[np.bool_]) -> tuple[float, float]:
    predicted = np.full(samples.values.shape, np.nan)
    predicted[which] = model.eval(samples.wi[which], samples.wo[which])
    return _misses(predicted, samples)


def _misses(predicted: NDArray[np.float64], samples: Samples) -> tuple[float, float]:
    """RMS of the logarithm, and relative RMS, of predictions (sample, channel), NaN where there is none."""
    some = np.isfinite(predicted) & np.isfinite(samples.values)
    weights = np.ones(len(samples)) if samples.weights is None else samples.weights
    w = np.broadcast_to(weights[:, None], some.shape)[some]
    if not w.sum() > 0.0:
        return np.nan, np.nan
    model, f = predicted[some], samples.values[some]
    log = np.log((model + metrics.LOG_OFFSET) / (f + metrics.LOG_OFFSET))
    energy = (w * f**2).sum()
    relative = np.sqrt((w * (model - f) ** 2).sum() / energy) if energy > 0.0 else np.nan
    return float(np.sqrt((w * log**2).sum() / w.sum())), float(relative)
