"""Figures of scattered samples, and of fits of them: scans in the plane of incidence, and all views from above."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.plot.style import CHANNEL_COLOURS, GREY, INK, STYLE, plain

if TYPE_CHECKING:
    from dsbrdf.fitting import Fit
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["sample_fit_figure", "samples_figure"]

Array = NDArray[np.float64]

#: Scans that are shown, samples that make one, and channels of many.
MOST_SCANS, LEAST_POINTS, MOST_CHANNELS = 3, 4, 5
#: Sine of the azimuth within which a sample lies in the plane of incidence.
IN_PLANE = 0.02
#: Range of values beyond which their axis is logarithmic.
WIDE = 30.0
#: Factor that the colours of residuals end at.
FACTOR = 2.0


def samples_figure(samples: Samples) -> Figure:
    """Figure of scattered samples.

    Parameters
    ----------
    samples : Samples

    Returns
    -------
    matplotlib.figure.Figure
        Scans in the plane of incidence, and the views of all samples seen from above, the light at the right.
    """
    _check.instance(samples, Samples, "samples")
    return _figure(samples, None)


def sample_fit_figure(fit: Fit) -> Figure:
    """Figure of a fit of scattered samples.

    Parameters
    ----------
    fit : Fit
        Of samples.

    Returns
    -------
    matplotlib.figure.Figure
        Scans in the plane of incidence with the model, and the ratio of model to measurement seen from above.

    Raises
    ------
    TypeError
        If the fit is of a table.
    """
    if not isinstance(fit.measured, Samples):
        raise TypeError(
            f"{fit.model.name or 'the fit'}: expected a fit of samples, got one of a table. Use plot.fit_figure."
        )
    return _figure(fit.measured, fit.model)


def _figure(samples: Samples, model: DSBRDF | None) -> Figure:
    angles = _Angles(samples)
    scans = angles.scans()
    with matplotlib.rc_context(STYLE):
        n = max(len(scans), 1)
        figure = Figure(figsize=(3.3 * (n + 1) + 0.4, 3.6), layout="constrained")
        grid = figure.add_gridspec(1, n + 1)
        values = samples.values[np.isfinite(samples.values) & (samples.values > 0.0)]
        logarithmic = bool(values.size) and values.max() > WIDE * values.min()
        for i, scan in enumerate(scans):
            axes = figure.add_subplot(grid[0, i])
            _draw_scan(axes, samples, model, angles, scan)
            axes.set_yscale("log" if logarithmic else "linear")
            if i == 0:
                axes.set_ylabel("BRDF (1/sr)")
                axes.legend(fontsize=8)
        if not scans:
            axes = figure.add_subplot(grid[0, 0])
            _draw_half(axes, samples, model, angles)
            axes.set_yscale("log" if logarithmic else "linear")
        _draw_above(figure, figure.add_subplot(grid[0, n], projection="polar"), samples, model, angles)
        what = f"{len(samples)} samples" + ("" if model is None else f", {model.n_lobes} lobes")
        figure.suptitle(f"{plain(samples.name or 'samples')}: {what}", fontsize=10)
    return figure


class _Angles:
    """Angles of samples in degrees."""

    def __init__(self, samples: Samples) -> None:
        self.theta_i, self.theta_o = (
            np.rad2deg(np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])) for w in (samples.wi, samples.wo)
        )
        turn = np.arctan2(samples.wo[:, 1], samples.wo[:, 0]) - np.arctan2(samples.wi[:, 1], samples.wi[:, 0])
        # Light along the normal has no azimuth of its own
        self.phi = np.where(self.theta_i < 1e-6, np.arctan2(samples.wo[:, 1], samples.wo[:, 0]), turn)
        self.theta_h = np.rad2deg(half_diff.from_directions(samples.wi, samples.wo)[0])

    def scans(self) -> list[tuple[float, NDArray[np.bool_]]]:
        """Angles of the light with enough samples in the plane of incidence, and which these are."""
        inside = (np.abs(np.sin(self.phi)) < IN_PLANE) | (self.theta_o < 1e-6)
        found = [
            (float(angle), rows)
            for angle in np.unique(np.round(self.theta_i, 1))
            if (rows := inside & (np.abs(self.theta_i - angle) < 0.06)).sum() >= LEAST_POINTS
            and len(np.unique(np.round(self.signed[rows], 2))) >= LEAST_POINTS
        ]
        shown = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_SCANS)).round().astype(int))
        return [found[i] for i in shown]

    @property
    def signed(self) -> Array:
        """theta_o, negative on the side of the mirror direction."""
        return np.where(np.cos(self.phi) < 0.0, -self.theta_o, self.theta_o)


def _channels(samples: Samples) -> list[tuple[int, str, Any]]:
    """Number, name and colour of each channel that is shown: all, or a few of many."""
    n = samples.n_channels
    names = list(samples.channels) or [str(i) for i in range(n)]
    if names == ["r", "g", "b"]:
        return list(zip(range(3), ("red", "green", "blue"), CHANNEL_COLOURS, strict=True))
    shown = np.unique(np.linspace(0, n - 1, min(n, MOST_CHANNELS)).round().astype(int)).tolist()
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(shown)))
    return [(i, names[i], INK if n == 1 else colour) for i, colour in zip(shown, colours, strict=True)]


def _draw_scan(
    axes: Any, samples: Samples, model: DSBRDF | None, angles: _Angles, scan: tuple[float, NDArray[np.bool_]]
) -> None:
    """Values over the view in the plane of incidence, at one angle of the light."""
    theta_i, rows = scan
    at = np.linspace(-89.0, 89.0, 357)
    light = np.deg2rad(theta_i)
    wi = np.array([np.sin(light), 0.0, np.cos(light)])
    wo = np.stack([np.sin(np.deg2rad(at)), np.zeros(len(at)), np.cos(np.deg2rad(at))], axis=-1)
    curves = None if model is None else np.asarray(model.eval(wi, wo))
    for channel, name, colour in _channels(samples):
        axes.plot(
            angles.signed[rows], samples.values[rows, channel], "o", ms=3, color=colour, label=name, alpha=0.7
        )
        if curves is not None:
            axes.plot(at, curves[:, channel], color=colour, lw=1.2)
    axes.axvline(-theta_i, color=GREY, lw=0.7, ls=":")
    axes.set_xlim(-90, 90)
    axes.set_xticks((-90, -45, 0, 45, 90))
    axes.set_title(rf"light at {theta_i:.4g}°")
    axes.set_xlabel(r"$\theta_o$ (degrees; mirror side negative)")


def _draw_half(axes: Any, samples: Samples, model: DSBRDF | None, angles: _Angles) -> None:
    """Values over theta_h, where there is no scan."""
    fitted = None if model is None else np.asarray(model.eval(samples.wi, samples.wo))
    for channel, name, colour in _channels(samples):
        axes.plot(angles.theta_h, samples.values[:, channel], "o", ms=3, color=colour, label=name, alpha=0.6)
        if fitted is not None:
            axes.plot(angles.theta_h, fitted[:, channel], "x", ms=4, color=colour, alpha=0.6)
    axes.set_xlabel(r"$\theta_h$ (degrees)" + ("" if model is None else "; crosses: fitted"))
    axes.set_ylabel("BRDF (1/sr)")
    axes.legend(fontsize=8)


def _draw_above(figure: Figure, axes: Any, samples: Samples, model: DSBRDF | None, angles: _Angles) -> None:
    """All views from above, the light toward the right, coloured by value or by the ratio of model to measurement."""
    seen = np.isfinite(samples.values) & (samples.values > 0.0)
    count = np.maximum(seen.sum(1), 1)
    if model is None:
        grey = np.where(seen, samples.values, 0.0).sum(1) / count
        some = grey > 0.0
        options: dict[str, Any] = {"c": grey[some], "cmap": "viridis"}
        if some.any() and grey[some].max() > WIDE * grey[some].min():
            options["norm"] = LogNorm()
        label = "mean value (1/sr)"
    else:
        fitted = np.maximum(np.asarray(model.eval(samples.wi, samples.wo)), 1e-300)
        logs = np.log2(np.where(seen, fitted, 1.0) / np.where(seen, samples.values, 1.0)).sum(1) / count
        some = seen.any(1)
        limit = np.log2(FACTOR)
        options = {"c": logs[some], "cmap": "RdBu_r", "vmin": -limit, "vmax": limit}
        label = "model / measurement"
    order = np.argsort(angles.theta_i[some])
    options["c"] = options["c"][order]
    # An edge, since a good fit is white
    edge = {"lw": 0.0} if model is None else {"lw": 0.3, "edgecolors": GREY}
    dots = axes.scatter(angles.phi[some][order], angles.theta_o[some][order], s=9, **edge, **options)
    axes.set_rmax(90)
    axes.set_rticks((30, 60, 90))
    axes.set_rlabel_position(100)
    axes.set_thetagrids((0, 90, 180, 270), labels=("light", "", "mirror", ""))
    axes.grid(color="#d8d8d8", lw=0.6)
    bar = figure.colorbar(dots, ax=axes, location="bottom", shrink=0.8, aspect=30, pad=0.03)
    bar.outline.set_linewidth(0.5)
    if model is not None:
        ticks = (1.0 / FACTOR, 1.0 / np.sqrt(FACTOR), 1.0, np.sqrt(FACTOR), FACTOR)
        bar.set_ticks(np.log2(ticks).tolist(), labels=[f"{tick:.2g}" for tick in ticks])
    bar.set_label(label, fontsize=8.5)
