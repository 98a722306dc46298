"""Fig. 6: error against the subsampling of theta_h, the model against linear interpolation."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import baselines, metrics
from dsbrdf.paper.baselines.interpolation import Interpolation
from dsbrdf.paper.collapse import SliceProfile, slice_profiles
from dsbrdf.paper.selection import select_lobes
from dsbrdf.paper.slice_fit import fit_profiles
from dsbrdf.paper.tables import Tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FACTORS", "PREFERRED", "Curve", "draw", "subsample"]

#: Integer factors by which theta_h is subsampled.
FACTORS = tuple(range(1, 17))
PREFERRED = ("nickel", "specular-blue-phenolic", "orange-paint")
#: Relative noise of a sample, and the seed of its generator.
NOISE, SEED = 0.02, 20110101
#: First samples that a subsampled theta_h may start at; the errors are averaged over them.
MAX_OFFSETS = 4


@dataclass(frozen=True)
class Curve:
    """Relative RMS of one material over all samples, without noise, against the factor.

    Parameters
    ----------
    name : str
    noise : float
        Of the samples that were fitted.
    factors : sequence of int
    model, interpolation : list of float
        Mean over the first samples that the subsampling starts at.
    """

    name: str
    noise: float
    factors: Sequence[int]
    model: list[float]
    interpolation: list[float]

    @property
    def better_from(self) -> int | None:
        """Factor from which on the model is better at all larger ones too."""
        better = [a < b for a, b in zip(self.model, self.interpolation, strict=True)]
        tail = [factor for i, factor in enumerate(self.factors) if all(better[i:])]
        return tail[0] if tail else None

    @property
    def first_better(self) -> int | None:
        """Smallest factor at which the model is better."""
        pairs = zip(self.factors, self.model, self.interpolation, strict=True)
        return next((factor for factor, a, b in pairs if a < b), None)

    @property
    def better_at(self) -> list[int]:
        """All factors at which the model is better."""
        pairs = zip(self.factors, self.model, self.interpolation, strict=True)
        return [factor for factor, a, b in pairs if a < b]


def subsample(
    tables: Tables, progress: Callable[[str], None], *, factors: Sequence[int] = FACTORS
) -> list[Curve]:
    """Curves of three materials, without noise and with it."""
    curves = []
    for name in tables.pick(PREFERRED, len(PREFERRED)):
        progress(f"{name}, subsampling")
        measured = tables.load(name)
        for noise in (0.0, NOISE):
            curves.append(_curve(name, measured, noise, factors))
    return curves


def _curve(name: str, measured: MeasuredBRDF, noise: float, factors: Sequence[int]) -> Curve:
    noisy = measured
    if noise:
        factor = np.random.default_rng(SEED).standard_normal(measured.planes.shape)
        noisy = dataclasses.replace(measured, planes=measured.planes * np.exp(noise * factor))
    truth, profiles = slice_profiles(measured), slice_profiles(noisy)
    model, interpolation = [], []
    for step in factors:
        offsets = np.unique(np.linspace(0, step, MAX_OFFSETS, endpoint=False).astype(int))
        thinned = [_thin(profiles, step, int(offset)) for offset in offsets]
        model.append(float(np.mean([_model_error(each, truth) for each in thinned])))
        errors = [baselines.errors(_interpolate(each), measured).rel_rms for each in thinned]
        interpolation.append(float(np.mean(errors)))
    return Curve(name, noise, factors, model, interpolation)


def _thin(profiles: Sequence[SliceProfile], step: int, offset: int) -> list[SliceProfile]:
    """Slices of which only every `step`-th theta_h from `offset` on has samples."""
    kept = (np.arange(len(profiles[0].theta_h)) - offset) % step == 0
    return [
        dataclasses.replace(profile, moments=np.where(kept[:, None], profile.moments, 0.0))
        for profile in profiles
    ]


def _model_error(thinned: Sequence[SliceProfile], truth: Sequence[SliceProfile]) -> float:
    n_lobes = select_lobes(thinned).n_lobes
    parameters, _ = fit_profiles(thinned, n_lobes, order="kappa")
    return metrics.fit_errors(truth, *parameters).rel_rms


def _interpolate(thinned: Sequence[SliceProfile]) -> Interpolation:
    mean = np.stack([profile.mean for profile in thinned])
    kept = np.isfinite(mean).any((0, 1))
    theta_d = np.array([profile.theta_d for profile in thinned])
    return Interpolation(theta_d, thinned[0].theta_h[kept], mean[..., kept])


def draw(curves: Sequence[Curve]) -> Figure:
    """Solid the model, dashed interpolation; a panel without noise and one with it."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    noises = sorted({curve.noise for curve in curves})
    names = list(dict.fromkeys(curve.name for curve in curves))
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(4.1 * len(noises) + 0.6, 3.9))
        figure.subplots_adjust(left=0.09, right=0.985, top=0.91, bottom=0.27, wspace=0.08)
        grid = figure.subplots(1, len(noises), squeeze=False, sharey=True)[0]
        for axes, noise in zip(grid, noises, strict=True):
            for curve in (curve for curve in curves if curve.noise == noise):
                colour = plot.LOBE_COLOURS[(5, 4, 2)[names.index(curve.name) % 3]]
                axes.plot(curve.factors, curve.model, "-o", ms=3.2, color=colour, label=curve.name)
                axes.plot(curve.factors, curve.interpolation, "--", lw=1.4, color=colour)
                if curve.better_from is not None:
                    at = curve.better_from
                    value = curve.model[list(curve.factors).index(at)]
                    axes.plot(at, value, "o", ms=9, mfc="none", mec=colour, mew=1.4)
            axes.set_yscale("log")
            axes.set_xlabel(r"subsampling factor of $\theta_h$")
            axes.set_title("without noise" if noise == 0.0 else f"with {100 * noise:g} % noise")
            axes.grid(True)
            axes.set_xticks(
                [factor for factor in curves[0].factors if factor in (1, 2, 4, 6, 8, 10, 12, 14, 16)]
            )
        grid[0].set_ylabel("relative RMS error")
        handles, labels = grid[0].get_legend_handles_labels()
        for text, style in (("the model", "-"), ("linear interpolation", "--")):
            (line,) = grid[0].plot([], [], style, color=plot.INK)
            handles.append(line)
            labels.append(text)
        (ring,) = grid[0].plot([], [], "o", ms=9, mfc="none", mec=plot.INK)
        handles.append(ring)
        labels.append("the model is better from here on")
        figure.legend(handles, labels, loc="lower center", ncols=3, fontsize=8.5)
    return figure
