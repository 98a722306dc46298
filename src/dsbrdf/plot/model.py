"""Figures of fits: measured points against fitted curves, lobes, parameters, and spheres (Figs. 2, 3 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from dsbrdf.model import sphere
from dsbrdf.plot.style import CHANNEL_COLOURS, GREY, LOBE_COLOURS, LOBE_DASHES, LOBE_MARKERS, PALE, STYLE

if TYPE_CHECKING:
    from dsbrdf.measured.table import MeasuredBRDF
    from dsbrdf.model.dsbrdf import DSBRDF
    from dsbrdf.paper.fit_measured import Fit

__all__ = ["demo_figure", "fit_figure", "incident_plane", "parameter_figure"]

Array = NDArray[np.float64]

#: Ticks in degrees of an axis on a square-root scale.
ROOT_TICKS = (-90, -60, -30, -10, 0, 10, 30, 60, 90)
#: Slices that are shown, radians; the nearest fitted ones are taken.
SHOWN_THETA_D = tuple(np.deg2rad([0.0, 40.0, 70.0]))
#: Mean radiance of a measured sphere in its picture, before gamma.
EXPOSURE = 0.28
#: Lobes with a sphere each in `demo_figure`; others share one.
SHOWN_LOBES = 3
STRIP_THETA_D = float(np.deg2rad(40.0))
STRIP_TITLE = r"BRDF (1/sr) over $\theta_h$ at $\theta_d$ = 40°"
CAPTION = (
    "Spheres: a distant light at 45° above left, another of 0.15 times its strength on the right; one "
    "exposure a row, gamma 2.2.\n"
    "Curves: squares measured, lines fitted; left half $\\phi_d$ = 90°, right half $\\phi_d$ = 0°; degrees, "
    "square-root scale; shaded: not fitted.\n"
    "Floors: the least error of any function of ($\\theta_h$, $\\theta_d$), and of one that falls with $\\theta_h$."
)


def incident_plane(measured: MeasuredBRDF, row: int) -> tuple[Array, Array]:
    """Profile of a table's theta_d row across the plane of incidence, as in Fig. 2.

    Parameters
    ----------
    measured : MeasuredBRDF
    row : int
        Which theta_d of the table.

    Returns
    -------
    theta_h : (2 theta_h,) ndarray, radians in [-pi/2, pi/2]
        Positive in the plane phi_d = 0, negative in the plane phi_d = pi/2.
    values : (channel, 2 theta_h) ndarray, 1/sr
        Mean over the cells nearest to the plane; NaN where invalid.
    """
    rows = measured.rows([row])[:, :, 0]
    across, along = (_nearest_phi(rows, measured.phi_d, phi) for phi in (np.pi / 2, 0.0))
    theta_h = np.concatenate([-measured.theta_h[::-1], measured.theta_h])
    return theta_h, np.concatenate([across[:, ::-1], along], axis=1)


def _nearest_phi(values: Array, phi_d: Array, phi: float) -> Array:
    """Mean (channel, theta_h) over the phi_d nearest to `phi`, of which phi_d + pi is an image."""
    distance = np.abs((phi_d - phi + np.pi / 2) % np.pi - np.pi / 2)
    near = values[:, :, distance <= distance.min() + 1e-9]
    count = np.isfinite(near).sum(-1)
    total = np.nansum(near, axis=-1)
    mean: Array = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return mean


@dataclass(frozen=True, eq=False)
class _Plane:
    """A slice across the plane of incidence, `theta_h` in degrees, negative in the plane phi_d = 90."""

    theta_d: float
    theta_h: Array
    values: Array
    curve_at: Array
    curves: Array
    parts: dict[str, Array]


def _plane(fit: Fit, row: int, n: int = 301) -> _Plane:
    theta_d = float(fit.table.theta_d[row])
    theta_h, values = incident_plane(fit.table, row)
    curve_at = np.pi / 2 * np.linspace(0.0, 1.0, n) ** 2
    model, both = fit.model, np.rad2deg(np.concatenate([-curve_at[::-1], curve_at]))
    curves = _curve(model, curve_at, theta_d)
    parts = {f"lobe {k}": _curve(model.lobe(k), curve_at, theta_d) for k in range(model.n_lobes)}
    if np.asarray(model.spike).any():
        parts["delta"] = np.maximum(curves - sum(parts.values()), 0.0)
    return _Plane(theta_d, np.rad2deg(theta_h), values, both, curves, parts)


def _curve(model: DSBRDF, theta_h: Array, theta_d: float) -> Array:
    """Values (channel, 2 theta_h) of a model as in `incident_plane`; NaN below the horizon."""
    across, along = (np.asarray(model.eval_angles(theta_h, theta_d, phi)).T for phi in (np.pi / 2, 0.0))
    along = np.where(theta_h + theta_d < np.pi / 2, along, np.nan)
    return np.concatenate([across[:, ::-1], along], axis=1)


def _shown_rows(fit: Fit, theta_d: Sequence[float]) -> list[int]:
    """The table's rows of the fitted slices nearest to `theta_d`, each once."""
    angles = fit.model.theta_d
    nearest = [angles[np.abs(angles - angle).argmin()] for angle in theta_d]
    return list(dict.fromkeys(int(np.abs(fit.table.theta_d - angle).argmin()) for angle in nearest))


def _channels(n: int) -> list[tuple[str, Any]]:
    """Name and colour of each channel."""
    if n == 3:
        return list(zip(("red", "green", "blue"), CHANNEL_COLOURS, strict=True))
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, n))
    return [(f"channel {i}", colour) for i, colour in enumerate(colours)]


def _root_axis(axes: Any, ticks: Sequence[int] = ROOT_TICKS) -> None:
    """Degrees from -90 to 90 on a square-root scale: narrow peaks get room."""
    root, square = (lambda x: np.sign(x) * np.sqrt(np.abs(x))), (lambda x: np.sign(x) * x**2)
    axes.set_xscale("function", functions=(root, square))
    axes.set_xlim(-90.0, 90.0)
    axes.set_xticks(ticks, [f"{abs(tick)}" for tick in ticks])


def _decades(axes: Any, values: Array) -> None:
    """Logarithmic y axis that holds `values`, five decades below their largest at most."""
    positive = values[values > 0.0]
    if positive.size:
        top = float(positive.max())
        _log_axis(axes, max(0.6 * float(positive.min()), 1e-5 * top), 1.8 * top)


def _log_axis(axes: Any, bottom: float, top: float) -> None:
    axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    axes.minorticks_off()
    if top < 300.0 * bottom:
        subs = (1.0, 3.0) if top > 10.0 * bottom else (1.0, 2.0, 5.0)
        axes.yaxis.set_major_locator(LogLocator(subs=subs))
        axes.yaxis.set_major_formatter(lambda y, _: f"{y:g}")


def fit_figure(fit: Fit, theta_d: Sequence[float] = SHOWN_THETA_D, *, channel: int | None = None) -> Figure:
    """Measured points and fitted curves across the plane of incidence, and the lobes, as in Figs. 2 and 3.

    Parameters
    ----------
    fit : Fit
    theta_d : sequence of float, radians, optional
        One column each, of the fitted slice nearest to it.
    channel : int, optional
        The one whose lobes are shown; the brightest by default.

    Returns
    -------
    Figure
        Rows: all channels on a linear and on a logarithmic axis; the lobes of one channel.
    """
    rows = _shown_rows(fit, theta_d)
    chosen = int(fit.errors.energy.sum(0).argmax()) if channel is None else channel
    with matplotlib.rc_context(STYLE):
        figure, grid = _grid(3, len(rows), left=0.75, right=1.35, top=0.75, bottom=0.55)
        for column, row in zip(grid.T, rows, strict=True):
            plane = _plane(fit, row)
            _draw_channels(column[0], plane)
            _draw_channels(column[1], plane)
            _draw_lobes(column[2], plane, chosen)
            _finish_column(column, fit, plane)
        labels = ("linear", "logarithmic", f"lobes of {_channels(fit.model.n_channels)[chosen][0]}")
        for axes, label in zip(grid[:, 0], labels, strict=True):
            axes.set_ylabel(f"BRDF (1/sr), {label}")
        for axes in grid[(0, 2), -1]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        figure.align_ylabels(grid[:, 0])
        figure.supxlabel(
            r"$\theta_h$ (degrees, square-root scale); left half $\phi_d$ = 90°, right half $\phi_d$ = 0°; "
            "shaded: not fitted",
            fontsize=9,
        )
        figure.suptitle(_headline(fit), fontsize=10)
    return figure


def _grid(n_rows: int, n_columns: int, **margins: float) -> tuple[Figure, NDArray[Any]]:
    """A figure with a grid of axes, and margins in inches; quicker than matplotlib's automatic layouts."""
    left, right, top, bottom = (margins[side] for side in ("left", "right", "top", "bottom"))
    width, height = 3.15 * n_columns + left + right, 2.15 * n_rows + top + bottom
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left / width, bottom / height, 1.0 - right / width, 1.0 - top / height, wspace=0.2, hspace=0.1
    )
    return figure, figure.subplots(n_rows, n_columns, squeeze=False)


def _headline(fit: Fit) -> str:
    errors = fit.errors
    names = ("bivariate", "monotone", "azimuthal")
    floors = ", ".join(f"{name} {100 * getattr(errors, f'{name}_floor'):.2f} %" for name in names)
    title = f"{fit.model.name}: {fit.model.n_lobes} lobes, relative RMS error {100 * errors.rel_rms:.2f} %"
    return f"{title}\nfloors: {floors}"


def _draw_channels(axes: Any, plane: _Plane, size: float = 3.2) -> None:
    channels = _channels(len(plane.values))
    for (name, colour), value, curve in zip(channels, plane.values, plane.curves, strict=True):
        axes.plot(plane.curve_at, curve, color=colour, label=f"{name}, fitted", zorder=3)
        axes.plot(plane.theta_h[::3], value[::3], "s", ms=size, mfc="white", mec=colour, mew=0.8, zorder=2)
    axes.plot([], "s", ms=size, mfc="white", mec=GREY, mew=0.8, label="measured")


def _draw_lobes(axes: Any, plane: _Plane, channel: int) -> None:
    axes.plot(plane.theta_h[::3], plane.values[channel, ::3], "o", ms=2.8, color=GREY, label="measured")
    axes.plot(plane.curve_at, plane.curves[channel], color="black", label="fitted", zorder=3)
    for k, (name, part) in enumerate(plane.parts.items()):
        colour, dash = LOBE_COLOURS[k % len(LOBE_COLOURS)], LOBE_DASHES[k % len(LOBE_DASHES)]
        axes.plot(plane.curve_at, part[channel], color=colour, ls=dash, lw=2.0, label=name, zorder=4)


def _finish_column(column: Any, fit: Fit, plane: _Plane) -> None:
    top = np.nanmax(plane.values) if np.isfinite(plane.values).any() else 1.0
    column[0].set_title(rf"$\theta_d$ = {np.rad2deg(plane.theta_d):.1f}°")
    column[0].set_ylim(0.0, 1.08 * top)
    _decades(column[1], plane.values)
    _decades(column[2], plane.values)
    for axes in column:
        _root_axis(axes)
        _shade_unfitted(axes, fit, plane.theta_d)
        axes.grid(True)
    for axes in column[:2]:
        axes.tick_params(labelbottom=False)


def _shade_unfitted(axes: Any, fit: Fit, theta_d: float) -> None:
    low = float(np.rad2deg(fit.options["min_theta_h"]))
    axes.axvspan(-low, low, color=PALE, lw=0, zorder=0)
    if fit.options["perimeter_mask"]:
        limit = 90.0 - float(np.rad2deg(theta_d))
        for side in (-1, 1):
            axes.axvspan(side * limit, side * 90.0, color=PALE, lw=0, zorder=0)


def parameter_figure(model: DSBRDF) -> Figure:
    """Kappa, gamma and beta of each lobe over theta_d, one column a channel."""
    n = model.n_channels
    with matplotlib.rc_context(STYLE):
        figure, grid = _grid(3, n, left=0.75, right=0.95, top=0.65, bottom=0.55)
        for row, symbol in zip(grid, ("kappa", "gamma", "beta"), strict=True):
            values = np.asarray(getattr(model, symbol))
            for c, axes in enumerate(row):
                _draw_parameters(axes, np.rad2deg(model.theta_d), values[:, c])
                _parameter_axis(axes, symbol, values)
                axes.tick_params(labelleft=c == 0, labelbottom=symbol == "beta")
            row[0].set_ylabel(rf"$\{symbol}$")
        figure.align_ylabels(grid[:, 0])
        for axes, (name, colour) in zip(grid[0], _channels(n), strict=True):
            axes.set_title(name, color=colour)
        for axes in grid[-1]:
            axes.set_xlabel(r"$\theta_d$ (degrees)")
        grid[0, -1].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        figure.suptitle(f"{model.name}: parameters of the lobes", fontsize=10)
    return figure


def _draw_parameters(axes: Any, theta_d: Array, values: Array) -> None:
    for k, curve in enumerate(values.T):
        colour, marker = LOBE_COLOURS[k % len(LOBE_COLOURS)], LOBE_MARKERS[k % len(LOBE_MARKERS)]
        axes.plot(theta_d, curve, marker=marker, ms=4.0, color=colour, label=f"lobe {k}")
    axes.set_xlim(0.0, 90.0)
    axes.set_xticks(range(0, 91, 15))
    axes.grid(True)


def _parameter_axis(axes: Any, symbol: str, values: Array) -> None:
    top = float(values.max())
    if symbol == "kappa":
        _log_axis(axes, max(0.7 * float(values.min()), 1e-6 * top), 1.7 * top)
    elif symbol == "gamma":
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_yticks([0, *(10**i for i in range(10) if 10**i <= max(top, 1.0))])
        axes.set_ylim(-0.1, 1.7 * max(top, 1.0))
    else:
        axes.set_ylim(-1.08, 1.08)


def demo_figure(fits: Sequence[Fit], *, n_pixels: int = 160) -> Figure:
    """Materials at a glance: spheres measured, fitted and by lobe, as in Fig. 7, and one slice of each.

    Parameters
    ----------
    fits : sequence of Fit
        One row each.
    n_pixels : int, optional
        Width of a sphere.
    """
    n_lobes = max(fit.model.n_lobes for fit in fits)
    lobes = [f"lobe {k}" for k in range(min(n_lobes, SHOWN_LOBES))] + ["others"] * (n_lobes > SHOWN_LOBES)
    widths = [1.32, *[1.0] * (2 + len(lobes)), 0.4, 2.2]
    width, height = 1.03 * sum(widths), 1.06 * len(fits) + 1.0
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height))
        margins = {"left": 0.012, "right": 0.988, "top": 1.0 - 0.3 / height, "bottom": 0.7 / height}
        margins |= {"wspace": 0.04, "hspace": 0.07}
        grid = figure.add_gridspec(len(fits), len(widths), width_ratios=widths, **margins)
        for row, fit in enumerate(fits):
            _label(figure.add_subplot(grid[row, 0]), fit)
            spheres = [figure.add_subplot(grid[row, 1 + i]) for i in range(2 + len(lobes))]
            _draw_spheres(spheres, fit, n_pixels)
            _draw_strip(figure.add_subplot(grid[row, -1]), fit, last=row == len(fits) - 1)
        for i, header in enumerate(["measured", "fitted", *lobes, "", STRIP_TITLE], start=1):
            box = grid[0, i].get_position(figure)
            figure.text((box.x0 + box.x1) / 2, 1.0 - 0.22 / height, header, ha="center", fontsize=9)
        figure.text(0.012, 0.1 / height, CAPTION, fontsize=7.5, linespacing=1.4)
    return figure


def _label(axes: Any, fit: Fit) -> None:
    errors = fit.errors
    axes.axis("off")
    axes.text(0.0, 0.6, fit.model.name, weight="bold", fontsize=8.5)
    error, *floors = (100 * x for x in (errors.rel_rms, errors.bivariate_floor, errors.monotone_floor))
    lobes = f"{fit.model.n_lobes} lobe{'s' * (fit.model.n_lobes > 1)}"
    text = f"{lobes}, error {error:.2f} %\nfloors {floors[0]:.2f}, {floors[1]:.2f} %"
    axes.text(0.0, 0.5, text, fontsize=7.5, va="top", linespacing=1.4)


def _draw_spheres(row: Sequence[Any], fit: Fit, n_pixels: int) -> None:
    for axes in row:
        axes.axis("off")
    measured, fitted = (sphere.shade(shown, n_pixels) for shown in (fit.table, fit.model))
    lobes = [sphere.shade(fit.model.lobe(k), n_pixels) for k in range(fit.model.n_lobes)]
    brightest = measured.max(-1)
    exposure = EXPOSURE / max(float(brightest[brightest > 0.0].mean()), 1e-12)
    shown = lobes[:SHOWN_LOBES] + ([np.sum(lobes[SHOWN_LOBES:], axis=0)] if lobes[SHOWN_LOBES:] else [])
    for axes, radiance in zip(row, [measured, fitted, *shown], strict=False):
        axes.imshow(sphere.picture(radiance, exposure), interpolation="antialiased")


def _draw_strip(axes: Any, fit: Fit, *, last: bool) -> None:
    (row,) = _shown_rows(fit, [STRIP_THETA_D])
    plane = _plane(fit, row)
    _draw_channels(axes, plane, size=2.8)
    _decades(axes, plane.values)
    _root_axis(axes, (-90, -30, -10, 0, 10, 30, 90))
    _shade_unfitted(axes, fit, plane.theta_d)
    axes.grid(True)
    axes.tick_params(labelsize=7.5, labelbottom=last)
