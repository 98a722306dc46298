"""Figs. 4, 5, 7 and 8: spheres, measured, fitted, by lobe and by the conventional model. Needs Mitsuba."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from dsbrdf.paper.tables import Tables, paper_fit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dsbrdf.measured.table import MeasuredBRDF
    from dsbrdf.paper.fit_report import SliceFit
    from dsbrdf.paper.slices import Slices
    from dsbrdf.render.comparison import Subject
    from dsbrdf.render.picture import Row

__all__ = ["FIGURES", "by_lobe_count", "delrin", "gallery", "lobes_alone", "n_renders"]

Step = Callable[[str], None]

#: Materials of Fig. 4, Fig. 7 (which the paper does not name) and Fig. 8.
FIG4 = ("nickel", "specular-blue-phenolic", "orange-paint")
FIG7 = ("nickel", "alum-bronze", "specular-blue-phenolic", "orange-paint")
FIG8 = ("delrin",)
#: Lobes in Fig. 4 at most, and in Figs. 7 and 8; materials in the gallery of Fig. 5.
MAX_LOBES, N_LOBES, N_GALLERY = 5, 3, 8
#: Least squares over all theta_d follow the few bright grazing samples, and Torrance-Sparrow lobes get white all over;
#: the paper limited them too (Section 6.B).
MAX_THETA_D = math.radians(60.0)
#: Pixels along a side, and samples a pixel.
SIZE, SPP = 160, 100


def n_renders(n: int) -> dict[str, int]:
    """How often each figure calls `step`, with `n` materials."""
    return {
        "fig4": min(n, len(FIG4)) * (1 + MAX_LOBES),
        "spheres": min(n, N_GALLERY) * 2,
        "fig7": min(n, len(FIG7)) * (4 + N_LOBES),
        "fig8": 2 + N_LOBES,
    }


def by_lobe_count(tables: Tables, step: Step) -> Figure:
    """Fig. 4: measured, and fitted with one to five lobes; the chosen number in brackets."""
    from dsbrdf.render import picture
    from dsbrdf.render.comparison import Subject

    rows = []
    for name in tables.pick(FIG4, len(FIG4)):
        measured = tables.load(name)
        chosen = paper_fit(measured).model.n_lobes
        subjects = [Subject("measured", measured)]
        for k in range(1, MAX_LOBES + 1):
            text = f"{k} lobe{'s' * (k > 1)}"
            subjects.append(Subject(f"[{text}]" if k == chosen else text, paper_fit(measured, k).model))
        rows.append(_row(name, subjects, step))
    return picture.sheet(rows, note="In brackets: the number of lobes that Williams' test chooses.")


def gallery(tables: Tables, step: Step) -> Figure:
    """Fig. 5: spheres of materials spread over the list, fitted with the chosen lobes, and measured."""
    from dsbrdf.render.comparison import Subject

    rows = []
    for name in tables.sample(N_GALLERY):
        measured = tables.load(name)
        model = paper_fit(measured).model
        rows.append(_row(name, [Subject("measured", measured), Subject("fitted", model)], step))
    return _upright(rows)


def lobes_alone(tables: Tables, step: Step) -> Figure:
    """Fig. 7: measured, Lambert with two Torrance-Sparrow lobes in two forms, three lobes, each lobe alone."""
    from dsbrdf.render import picture
    from dsbrdf.render.comparison import Subject

    rows = []
    for name in tables.pick(FIG7, len(FIG7)):
        measured = tables.load(name)
        model = paper_fit(measured, N_LOBES).model
        rows.append(
            _row(name, [Subject("measured", measured), *conventional(measured), *_subjects(model)], step)
        )
    note = "Lambert + Torrance-Sparrow is fitted up to theta_d = 60 degrees, as in the paper; Lambert + 2 GGX has "
    note += "Fresnel terms and is fitted to all, by logarithms."
    return picture.sheet(rows, note=note)


def delrin(tables: Tables, step: Step) -> Figure:
    """Fig. 8: a material whose second lobe is glossy and coloured, as spheres, profiles and lobes."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot
    from dsbrdf.render.comparison import Subject

    (name,) = tables.pick(FIG8, 1)
    measured = tables.load(name)
    fit = paper_fit(measured, N_LOBES)
    row = _row(name, [Subject("measured", measured), *_subjects(fit.model)], step)
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(10.2, 5.0))
        grid = figure.add_gridspec(
            2, 12, left=0.015, right=0.985, top=0.93, bottom=0.1, wspace=0.25, hspace=0.22
        )
        for i, tile in enumerate(row.tiles[:2]):
            _draw(figure.add_subplot(grid[i, :3]), tile, row)
        for i, tile in enumerate(row.tiles[2:]):
            _draw(figure.add_subplot(grid[1, 3 + 3 * i : 6 + 3 * i]), tile, row)
        _profiles(figure, grid, fit)
    return figure


def conventional(measured: MeasuredBRDF) -> list[Subject]:
    """Lambert with two lobes: Torrance and Sparrow's, fitted as in the paper, and those of today's renderers."""
    from dsbrdf.baselines import fit_ggx_pair
    from dsbrdf.paper.baselines import fit_lambert_torrance_sparrow
    from dsbrdf.paper.collapse import N_SLICES
    from dsbrdf.render.comparison import Subject

    kept = measured.theta_d <= MAX_THETA_D
    planes, theta_d = measured.planes[:, :, kept], measured.theta_d[kept]
    below = dataclasses.replace(measured, planes=planes, theta_d=theta_d)
    old = fit_lambert_torrance_sparrow(below, n_slices=min(N_SLICES, theta_d.size))
    return [Subject(model.label, model) for model in (old, fit_ggx_pair(measured))]


def _subjects(model: Slices) -> list[Subject]:
    """A model, and each of its lobes."""
    from dsbrdf.render.comparison import Subject

    whole = Subject(f"{model.n_lobes} lobes", model)
    return [whole, *(Subject(f"lobe {k} alone", model.lobe(k), whole=False) for k in range(model.n_lobes))]


def _profiles(figure: Figure, grid: Any, fit: SliceFit) -> None:
    """The slice theta_d = 0: all channels, and the lobes of the brightest."""
    from dsbrdf import plot
    from dsbrdf.paper.planes import channels, plane_of

    plane = plane_of(fit, 0)
    left, right = figure.add_subplot(grid[0, 4:7]), figure.add_subplot(grid[0, 8:11])
    plot.model._draw_channels(left, plane, channels(fit), size=2.6)
    plot.model._draw_lobes(right, plane, int(fit.errors.energy[0].argmax()))
    for axes, title in ((left, r"$\theta_d$ = 0°, BRDF (1/sr)"), (right, "lobes")):
        axes.set_ylim(0.0, 1.1 * max(np.nanmax(plane.values), np.nanmax(plane.curves)))
        plot.model._root_axis(axes, (-90, -30, -10, 0, 10, 30, 90))
        axes.set_title(title, fontsize=8)
        axes.grid(True)
        axes.tick_params(labelsize=7)
    right.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=6.5, borderaxespad=0.0)


def _row(name: str, subjects: list[Subject], step: Step) -> Row:
    from dsbrdf.render.comparison import render_row
    from dsbrdf.render.scene import View

    return render_row(name, subjects, View(size=SIZE, spp=SPP), step)


def _upright(rows: list[Row]) -> Figure:
    """A column for each row, the fit on top as in the paper."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(1.45 * len(rows) + 0.2, 3.5))
        figure.subplots_adjust(0.01, 0.02, 0.99, 0.88, wspace=0.04, hspace=0.12)
        for column, row in zip(figure.subplots(2, len(rows), squeeze=False).T, rows, strict=True):
            measured, fitted = row.tiles
            _draw(column[0], fitted, row)
            _draw(column[1], measured, row)
            if fitted.difference is not None:
                column[0].set_title(f"{row.title}\nfitted, {fitted.difference.mean:.2f}", fontsize=7, pad=3)
    return figure


def _draw(axes: Any, tile: Any, row: Row) -> None:
    from dsbrdf.render import picture

    axes.axis("off")
    axes.imshow(picture.tone_map(tile.image, row.exposure), interpolation="antialiased")
    axes.set_title(tile.title, fontsize=8, pad=3)


#: By name, in the order of the paper.
FIGURES: dict[str, Callable[[Tables, Step], Any]] = {
    "fig4": by_lobe_count,
    "spheres": gallery,
    "fig7": lobes_alone,
    "fig8": delrin,
}
