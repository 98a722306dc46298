"""Figs. 1, 2 and 3: shapes of the distributions, and profiles of slices in the plane of incidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dsbrdf.model import hemi_epd
from dsbrdf.paper.fit_report import SliceFit
from dsbrdf.paper.tables import Tables, paper_fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["distributions", "lobe_profiles", "slice_profiles"]

KAPPAS = (1.0, 3.0, 6.0)
GAMMAS = (0.2, 1.0, 4.0)
#: Materials of Fig. 2, which the paper does not name, and of Fig. 3.
FIG2 = ("nickel", "specular-blue-phenolic", "color-changing-paint3", "orange-paint")
FIG3 = ("color-changing-paint3", "teflon")
#: Lobes in Figs. 2 and 3, and slices of Fig. 3 in degrees.
N_LOBES = 3
THETA_D = (10.0, 40.0, 70.0)


def distributions() -> Figure:
    """Fig. 1: von Mises-Fisher profiles beside hemi-EPD profiles."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    theta = np.linspace(0.0, np.pi, 361)
    half = theta[theta <= np.pi / 2]
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(8.8, 3.6))
        figure.subplots_adjust(left=0.08, right=0.985, top=0.9, bottom=0.15, wspace=0.16)
        left, right = figure.subplots(1, 2)
        dashes = ("-", "--", ":")
        for kappa, colour in zip(KAPPAS, plot.CHANNEL_COLOURS, strict=True):
            both = hemi_epd.von_mises_fisher_pdf(theta, kappa)
            _mirrored(left, theta, both, color=colour, label=rf"$\kappa$ = {kappa:g}")
            for gamma, dash in zip(GAMMAS, dashes, strict=True):
                _mirrored(right, half, hemi_epd.pdf(half, kappa, gamma), color=colour, ls=dash)
        for gamma, dash in zip(GAMMAS, dashes, strict=True):
            right.plot([], [], dash, color=plot.INK, label=rf"$\gamma$ = {gamma:g}")
        left.set_title("(a) von Mises-Fisher, on the whole sphere")
        right.set_title("(b) hemi-EPD, on the hemisphere; colours as in (a)")
        for axes, limit, step in ((left, 180, 60), (right, 90, 30)):
            axes.set_xlim(-limit, limit)
            axes.set_xticks(range(-limit, limit + 1, step))
            axes.set_ylim(bottom=0.0)
            axes.set_xlabel(r"$\theta_h$ (degrees)")
            axes.grid(True)
            axes.legend(loc="upper left", fontsize=7.5, handlelength=2.4, borderaxespad=0.2)
        left.axvspan(-180, -90, color=plot.PALE, lw=0, zorder=0)
        left.axvspan(90, 180, color=plot.PALE, lw=0, zorder=0)
        left.set_ylabel("density (1/sr)")
    return figure


def _mirrored(axes: Any, theta: Any, values: Any, **style: Any) -> None:
    degrees = np.rad2deg(theta)
    axes.plot(
        np.concatenate([-degrees[::-1], degrees]), np.concatenate([values[::-1], values]), lw=1.5, **style
    )


def lobe_profiles(tables: Tables) -> Figure:
    """Fig. 2: three lobes fitted to the slice theta_d = 0 of some materials (a), and the lobes (b)."""
    import matplotlib

    from dsbrdf import plot
    from dsbrdf.paper.planes import channels, plane_of

    fits = [paper_fit(tables.load(name), N_LOBES) for name in tables.pick(FIG2, len(FIG2))]
    with matplotlib.rc_context(plot.STYLE):
        figure, grid = plot.model._grid(2, len(fits), left=0.75, right=1.35, top=0.45, bottom=0.55)
        for column, fit in zip(grid.T, fits, strict=True):
            channel = int(fit.errors.energy[0].argmax())
            plane = plane_of(fit, 0)
            plot.model._draw_channels(column[0], plane, channels(fit))
            plot.model._draw_lobes(column[1], plane, channel)
            column[0].set_title(f"{plot.style.plain(fit.model.name)}, error {_slice_error(fit, 0)}")
            for axes in column:
                _finish(axes, fit, plane)
            column[0].set_yscale("linear")
            # The spike may be far above all that was fitted
            fitted = plane.values[:, np.abs(plane.theta_h) >= np.rad2deg(fit.options["min_theta_h"])]
            column[0].set_ylim(0.0, 1.1 * max(np.nanmax(fitted), np.nanmax(plane.curves)))
            column[0].tick_params(labelbottom=False)
        _label(figure, grid, ("(a) BRDF (1/sr)", "(b) lobes of the brightest channel"))
    return figure


def slice_profiles(tables: Tables) -> Figure:
    """Fig. 3: three lobes fitted to three slices of two materials."""
    import matplotlib

    from dsbrdf import plot
    from dsbrdf.paper.planes import channels, plane_of, shown_rows

    fits = [paper_fit(tables.load(name), N_LOBES) for name in tables.pick(FIG3, len(FIG3))]
    with matplotlib.rc_context(plot.STYLE):
        figure, grid = plot.model._grid(len(fits), len(THETA_D), left=0.75, right=1.35, top=0.45, bottom=0.55)
        figure.subplots_adjust(hspace=0.28)
        for row, fit in zip(grid, fits, strict=True):
            shown = shown_rows(fit, np.deg2rad(THETA_D))
            for axes, index in zip(row, shown, strict=False):
                plane = plane_of(fit, index)
                plot.model._draw_channels(axes, plane, channels(fit))
                _finish(axes, fit, plane)
                nearest = int(np.abs(fit.model.theta_d - plane.theta_d).argmin())
                axes.set_title(
                    rf"$\theta_d$ = {np.rad2deg(plane.theta_d):.1f}°, error {_slice_error(fit, nearest)}"
                )
        _label(figure, grid, [f"{fit.model.name}, BRDF (1/sr)" for fit in fits])
    return figure


def _slice_error(fit: SliceFit, index: int) -> str:
    errors = fit.errors
    energy = float(errors.energy[index].sum())
    return f"{100 * np.sqrt(errors.squares[index].sum() / energy):.1f} %" if energy > 0.0 else "unknown"


def _finish(axes: Any, fit: SliceFit, plane: Any) -> None:
    from dsbrdf import plot
    from dsbrdf.paper.planes import shade_unfitted

    plot.model._decades(axes, plane.values[np.isfinite(plane.values)])
    plot.model._root_axis(axes)
    shade_unfitted(axes, fit, plane.theta_d)
    axes.grid(True)


def _label(figure: Any, grid: Any, labels: Sequence[str]) -> None:
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
        row[-1].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    figure.supxlabel(
        r"$\theta_h$ (degrees, square-root scale); left half $\phi_d$ = 90°, right half $\phi_d$ = 0°; "
        "shaded: not fitted",
        fontsize=9,
    )
