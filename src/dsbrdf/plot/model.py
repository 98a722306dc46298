"""Figures of fits: measured points against fitted curves, lobes, parameters, and spheres (Figs. 2, 3 and 7)."""

from __future__ import annotations

import base64
import io
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib.image
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model import sphere
from dsbrdf.plot.style import CHANNEL_COLOURS, GREY, INK, LOBE_COLOURS, LOBE_DASHES, STYLE, plain

if TYPE_CHECKING:
    from dsbrdf.fitting import Fit
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["demo_figure", "fit_figure", "incident_plane", "parameter_figure", "sphere_picture"]

Array = NDArray[np.float64]

#: Ticks in degrees of an axis on a square-root scale.
ROOT_TICKS = (-90, -60, -30, -10, 0, 10, 30, 60, 90)
#: theta_d that are shown, radians; the nearest measured ones are taken.
SHOWN_THETA_D = tuple(np.deg2rad([0.0, 40.0, 70.0]))
#: More channels are shown by so many of them.
MOST_CHANNELS = 5
WORDS = {"r": "red", "g": "green", "b": "blue"}
#: Mean radiance of a measured sphere in its picture, before gamma.
EXPOSURE = 0.28
#: Lobes with a sphere each in `demo_figure`; others share one.
SHOWN_LOBES = 3
STRIP_THETA_D = float(np.deg2rad(40.0))
STRIP_TITLE = r"BRDF (1/sr) over $\theta_h$ at $\theta_d$ = 40°"
CAPTION = (
    "Spheres in a room with lamps, one exposure a row, gamma 2.2. Errors over the whole hemisphere.\n"
    "Curves: squares measured, lines fitted; left half $\\phi_d$ = 90°, right half $\\phi_d$ = 0°; degrees, "
    "square-root scale."
)
#: Letters of a line of a note in `demo_figure`.
NOTE_WIDTH = 40


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

    Examples
    --------
    >>> import dsbrdf
    >>> theta_h, values = dsbrdf.plot.incident_plane(dsbrdf.material("matte"), 20)
    >>> values.shape
    (3, 180)
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
    """A theta_d across the plane of incidence, `theta_h` in degrees, negative in the plane phi_d = 90."""

    theta_d: float
    theta_h: Array
    values: Array
    curve_at: Array
    curves: Array
    parts: dict[str, Array]


def _table(fit: Fit) -> MeasuredBRDF:
    if not hasattr(fit, "measured"):
        from dsbrdf.fitting import Fit

        _check.instance(fit, Fit, "fit")
    if not isinstance(fit.measured, MeasuredBRDF):
        raise TypeError(
            f"{fit.model.name or 'the fit'}: figures of fits show tables, got scattered samples. "
            "plot.parameter_figure(model) shows the model."
        )
    return fit.measured


def _plane(fit: Fit, row: int, n: int = 301) -> _Plane:
    measured, model = _table(fit), fit.model
    theta_d = float(measured.theta_d[row])
    theta_h, values = incident_plane(measured, row)
    curve_at = np.pi / 2 * np.linspace(0.0, 1.0, n) ** 2
    both = np.rad2deg(np.concatenate([-curve_at[::-1], curve_at]))
    curves = _curve(model, curve_at, theta_d)
    parts = {f"lobe {k}": _curve(model.lobe(k), curve_at, theta_d) for k in range(model.n_lobes)}
    return _Plane(theta_d, np.rad2deg(theta_h), values, both, curves, parts)


def _curve(model: DSBRDF, theta_h: Array, theta_d: float) -> Array:
    """Values (channel, 2 theta_h) of a model as in `incident_plane`; NaN below the horizon."""
    across, along = (np.asarray(model.eval_angles(theta_h, theta_d, phi)).T for phi in (np.pi / 2, 0.0))
    along = np.where(theta_h + theta_d < np.pi / 2, along, np.nan)
    return np.concatenate([across[:, ::-1], along], axis=1)


def _shown_rows(measured: MeasuredBRDF, theta_d: Sequence[float]) -> list[int]:
    """The table's rows nearest to `theta_d`, each once."""
    return list(dict.fromkeys(int(np.abs(measured.theta_d - angle).argmin()) for angle in theta_d))


def _channels(model: DSBRDF) -> list[tuple[int, str, Any]]:
    """Number, name and colour of each channel that is shown: all, or a few of many."""
    n = model.n_channels
    if tuple(model.channels) == tuple(WORDS):
        return list(zip(range(n), WORDS.values(), CHANNEL_COLOURS, strict=True))
    shown = np.unique(np.linspace(0, n - 1, min(n, MOST_CHANNELS)).round().astype(int)).tolist()
    if n == 1:
        return [(0, model.channels[0], INK)]
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(shown)))
    return [(c, _channel_name(model, c), colour) for c, colour in zip(shown, colours, strict=True)]


def _channel_name(model: DSBRDF, channel: int) -> str:
    name = model.channels[channel]
    return WORDS.get(name, name) if tuple(model.channels) == tuple(WORDS) else name


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
        Of a table.
    theta_d : sequence of float, radians, optional
        One column each, of the measured theta_d nearest to it.
    channel : int, optional
        The one whose lobes are shown; the brightest by default.

    Returns
    -------
    Figure
        Rows: all channels (a few, of many) on a linear and on a logarithmic axis; the lobes of one channel.

    Raises
    ------
    TypeError
        If scattered samples were fitted.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
    >>> figure = dsbrdf.plot.fit_figure(found, theta_d=[0.5])
    >>> len(figure.axes)
    3
    """
    rows = _shown_rows(_table(fit), theta_d)
    chosen = int(fit.model.albedo(STRIP_THETA_D).argmax()) if channel is None else channel
    with matplotlib.rc_context(STYLE):
        # A single column has no room for long lines
        join, room = ("; ", 0.0) if len(rows) > 1 else ("\n", 0.2)
        longest = max(len(plain(name)) for _, name, _ in _channels(fit.model))
        right = max(1.35, 1.1 + 0.06 * longest)
        figure, grid = _grid(3, len(rows), left=0.85, right=right, top=0.75 + room, bottom=0.55 + room)
        for column, row in zip(grid.T, rows, strict=True):
            plane = _plane(fit, row)
            for axes in column[:2]:
                _draw_channels(axes, plane, _channels(fit.model))
            _draw_lobes(column[2], plane, chosen)
            _finish_column(column, plane)
        labels = ("linear", "logarithmic", f"lobes of {plain(_channel_name(fit.model, chosen), 16)}")
        for axes, label in zip(grid[:, 0], labels, strict=True):
            axes.set_ylabel(f"BRDF (1/sr), {label}")
        for axes in grid[(0, 2), -1]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        figure.align_ylabels(grid[:, 0])
        figure.supxlabel(
            rf"$\theta_h$ (degrees, square-root scale){join}left half $\phi_d$ = 90°, right half $\phi_d$ = 0°",
            fontsize=9,
        )
        figure.suptitle(_headline(fit, join), fontsize=10)
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


def _headline(fit: Fit, join: str) -> str:
    errors = fit.errors
    told = ", ".join(_told(errors.summary(), ("rel", "cbrt", "log", "albedo")))
    floors = ", ".join(_told(errors.summary(), ("bivariate_floor", "azimuthal_floor")))
    title = f"{plain(fit.model.name)}: {_count(fit.model.n_lobes, 'lobe')}, {fit.model.n_parameters} numbers"
    return f"{title}\n{told}{join}{floors}" if floors else f"{title}\n{told}"


def _told(errors: dict[str, float], keys: Sequence[str]) -> list[str]:
    finite = {key: errors[key] for key in keys if np.isfinite(errors[key])}
    return [f"{key.replace('_', ' ')} {value:.3f}" for key, value in finite.items()]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'s' * (n != 1)}"


def _draw_channels(
    axes: Any, plane: _Plane, channels: Sequence[tuple[int, str, Any]], size: float = 3.2
) -> None:
    for c, name, colour in channels:
        axes.plot(plane.curve_at, plane.curves[c], color=colour, label=f"{plain(name)}, fitted", zorder=3)
        axes.plot(
            plane.theta_h[::3], plane.values[c, ::3], "s", ms=size, mfc="white", mec=colour, mew=0.8, zorder=2
        )
    axes.plot([], "s", ms=size, mfc="white", mec=GREY, mew=0.8, label="measured")


def _draw_lobes(axes: Any, plane: _Plane, channel: int) -> None:
    axes.plot(plane.theta_h[::3], plane.values[channel, ::3], "o", ms=2.8, color=GREY, label="measured")
    axes.plot(plane.curve_at, plane.curves[channel], color="black", label="fitted", zorder=3)
    for k, (name, part) in enumerate(plane.parts.items()):
        axes.plot(plane.curve_at, part[channel], lw=2.0, label=name, zorder=4, **_lobe_style(k))


def _lobe_style(k: int) -> dict[str, Any]:
    return {"color": LOBE_COLOURS[k % len(LOBE_COLOURS)], "ls": LOBE_DASHES[k % len(LOBE_DASHES)]}


def _finish_column(column: Any, plane: _Plane) -> None:
    top = np.nanmax(plane.values) if np.isfinite(plane.values).any() else 1.0
    column[0].set_title(rf"$\theta_d$ = {np.rad2deg(plane.theta_d):.1f}°")
    column[0].set_ylim(0.0, 1.08 * top)
    _decades(column[1], plane.values)
    _decades(column[2], plane.values)
    for axes in column:
        _root_axis(axes)
        axes.grid(True)
    for axes in column[:2]:
        axes.tick_params(labelbottom=False)


def parameter_figure(model: DSBRDF, n: int = 181) -> Figure:
    """Kappa of each channel (a few, of many) and gamma, beta and falloff of each lobe over theta_d.

    Examples
    --------
    >>> import dsbrdf
    >>> figure = dsbrdf.plot.parameter_figure(dsbrdf.library.load("nickel"))
    >>> len(figure.axes)
    6
    """
    from dsbrdf.model.dsbrdf import DSBRDF

    _check.instance(model, DSBRDF, "model")
    theta_d = np.linspace(0.0, np.pi / 2, n)
    at = model.lobes.at(theta_d)
    shown = _channels(model)
    drawn: list[tuple[str, Array, Callable[[Any, Array], None]]] = [
        *((rf"$\kappa$, {plain(name)}", at.kappa[:, c], _kappa_axis) for c, name, _ in shown),
        (r"$\gamma$, all channels", at.gamma, _gamma_axis),
        (r"$\beta$, all channels", at.beta, _linear_axis),
        ("falloff, all channels", at.falloff, _linear_axis),
    ]
    n_columns = min(len(drawn), 3)
    with matplotlib.rc_context(STYLE):
        figure, grid = _grid(
            -(-len(drawn) // n_columns), n_columns, left=0.55, right=0.95, top=0.75, bottom=0.55
        )
        figure.subplots_adjust(wspace=0.28, hspace=0.4)
        all_kappa = at.kappa[:, [c for c, _, _ in shown]]
        for axes, (title, values, finish) in zip(grid.ravel(), drawn, strict=False):
            for k, curve in enumerate(values.T):
                axes.plot(np.rad2deg(theta_d), curve, label=f"lobe {k}", **_lobe_style(k))
            finish(axes, all_kappa if finish is _kappa_axis else values)
            axes.set_xlim(0.0, 90.0)
            axes.set_xticks(range(0, 91, 15))
            axes.set_title(title)
            axes.grid(True)
        for axes in grid.ravel()[len(drawn) :]:
            axes.remove()
        for axes in grid.ravel()[max(len(drawn) - n_columns, 0) : len(drawn)]:
            axes.set_xlabel(r"$\theta_d$ (degrees)")
        grid[0, -1].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        figure.suptitle(
            f"{plain(model.name)}: {_count(model.n_lobes, 'lobe')}, {model.n_parameters} numbers", fontsize=10
        )
    return figure


def _kappa_axis(axes: Any, values: Array) -> None:
    top = float(values.max())
    _log_axis(axes, max(0.7 * float(values.min()), 1e-6 * top), 1.7 * top)


def _gamma_axis(axes: Any, values: Array) -> None:
    _log_axis(axes, max(0.7 * float(values.min()), 1e-2), 1.7 * max(float(values.max()), 1.0))


def _linear_axis(axes: Any, values: Array) -> None:
    axes.set_ylim(1.08 * min(-1.0, float(values.min())), 1.08 * max(1.0, float(values.max())))


def demo_figure(fits: Sequence[Fit], notes: Sequence[str] = (), *, n_pixels: int = 180) -> Figure:
    """Materials at a glance: spheres measured, fitted and by lobe, as in Fig. 7, and one theta_d of each.

    Parameters
    ----------
    fits : sequence of Fit
        One row each, of a table.
    notes : sequence of str, optional
        What to say of each.
    n_pixels : int, optional
        Width of a sphere.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
    >>> figure = dsbrdf.plot.demo_figure([found], n_pixels=16)
    >>> len(figure.axes)
    6
    """
    for fit in fits:
        _table(fit)
    n_lobes = max(fit.model.n_lobes for fit in fits)
    lobes = [f"lobe {k}" for k in range(min(n_lobes, SHOWN_LOBES))] + ["others"] * (n_lobes > SHOWN_LOBES)
    widths = [1.9, *[1.0] * (2 + len(lobes)), 0.35, 1.8]
    width, height = 1.24 * sum(widths), 1.27 * len(fits) + 1.0
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height))
        margins = {"left": 0.012, "right": 0.988, "top": 1.0 - 0.3 / height, "bottom": 0.7 / height}
        margins |= {"wspace": 0.04, "hspace": 0.07}
        grid = figure.add_gridspec(len(fits), len(widths), width_ratios=widths, **margins)
        for row, fit in enumerate(fits):
            _label(figure.add_subplot(grid[row, 0]), fit, notes[row] if notes else "")
            spheres = [figure.add_subplot(grid[row, 1 + i]) for i in range(2 + len(lobes))]
            _draw_spheres(spheres, fit, n_pixels)
            _draw_strip(figure.add_subplot(grid[row, -1]), fit, last=row == len(fits) - 1)
        for i, header in enumerate(["measured", "fitted", *lobes, "", STRIP_TITLE], start=1):
            box = grid[0, i].get_position(figure)
            figure.text((box.x0 + box.x1) / 2, 1.0 - 0.22 / height, header, ha="center", fontsize=9)
        figure.text(0.012, 0.1 / height, CAPTION, fontsize=7.5, linespacing=1.4)
    return figure


def _label(axes: Any, fit: Fit, note: str) -> None:
    errors = fit.errors
    axes.axis("off")
    axes.text(0.0, 0.82 if note else 0.62, plain(fit.model.name), weight="bold", fontsize=8.5)
    text = f"{_count(fit.model.n_lobes, 'lobe')}, {fit.model.n_parameters} numbers"
    text += f"\nrel {errors.rel:.3f}, log {errors.log:.3f}, cbrt {errors.cbrt:.3f}"
    if note:
        text += f"\n{textwrap.fill(note, NOTE_WIDTH)}"
    axes.text(0.0, 0.75 if note else 0.54, text, fontsize=7.5, va="top", linespacing=1.35)


def _draw_spheres(row: Sequence[Any], fit: Fit, n_pixels: int) -> None:
    for axes in row:
        axes.axis("off")
    measured, fitted = (sphere.shade_in_room(shown, n_pixels) for shown in (_table(fit), fit.model))
    n_lobes = fit.model.n_lobes
    shown = [sphere.shade_in_room(fit.model.lobe(k), n_pixels) for k in range(min(n_lobes, SHOWN_LOBES))]
    if n_lobes > SHOWN_LOBES:
        shown.append(np.maximum(fitted - np.sum(shown, axis=0), 0.0))
    exposure = _exposure(measured)
    for axes, radiance in zip(row, [measured, fitted, *shown], strict=False):
        axes.imshow(sphere.picture(radiance, exposure), interpolation="antialiased")


def sphere_picture(fit: Fit, n_pixels: int = 120) -> str:
    """A PNG of the measured (of a table) and the fitted sphere, as an address that holds the data.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
    >>> dsbrdf.plot.sphere_picture(found)[:22]
    'data:image/png;base64,'
    """
    radiance = [sphere.shade_in_room(fit.model, n_pixels)]
    if isinstance(fit.measured, MeasuredBRDF):
        radiance.insert(0, sphere.shade_in_room(fit.measured, n_pixels))
    exposure = _exposure(radiance[0])
    buffer = io.BytesIO()
    matplotlib.image.imsave(
        buffer, np.hstack([sphere.picture(one, exposure) for one in radiance]), format="png"
    )
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _exposure(radiance: Array) -> float:
    """What makes the mean radiance of a sphere's brightest channel `EXPOSURE`."""
    brightest = radiance.max(-1)
    return EXPOSURE / max(float(brightest[brightest > 0.0].mean()), 1e-12)


def _draw_strip(axes: Any, fit: Fit, *, last: bool) -> None:
    (row,) = _shown_rows(_table(fit), [STRIP_THETA_D])
    plane = _plane(fit, row)
    _draw_channels(axes, plane, _channels(fit.model), size=2.8)
    _decades(axes, plane.values)
    _root_axis(axes, (-90, -30, -10, 0, 10, 30, 90))
    axes.grid(True)
    axes.tick_params(labelsize=7.5, labelbottom=last)
