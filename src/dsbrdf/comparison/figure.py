"""Figures of a comparison: error against numbers, and how spheres look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.comparison import sphere
from dsbrdf.comparison.result import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw", "draw_spheres"]

#: Figures of merit that are drawn, and their axes.
AXES = {"cbrt": "cbrt", "log": "log", "ciede2000": "CIEDE2000 of the sphere"}
#: Errors below this are no news: the model is the measurement.
LEAST = 1e-4
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")


def draw(found: Comparison) -> Figure:
    """Error against number of parameters: medians of methods, and lines over the middle 80 % of the materials."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    numbers = found.values("n_parameters")
    # In the order of the methods, so that two figures agree
    methods = list(dict.fromkeys(row.method for row in found.rows if row.ok))
    colours = (*plot.LOBE_COLOURS, plot.INK, plot.GREY)
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(10.0, 4.1), layout="constrained")
        for axes, (name, label) in zip(figure.subplots(1, len(AXES)), AXES.items(), strict=True):
            of_method = found.values(name)
            for i, method in enumerate(methods):
                x, values = np.median(numbers[method]), of_method[method]
                values = values[np.isfinite(values)]
                if not values.size or not np.isfinite(x) or np.median(values) < LEAST:
                    continue
                low, middle, high = np.maximum(np.quantile(values, (0.1, 0.5, 0.9)), LEAST)
                spread = [[middle - low], [high - middle]]
                colour = colours[i % len(colours)]
                marker = MARKERS[i % len(MARKERS)]
                look = {"fmt": marker, "ms": 6, "lw": 1.2, "capsize": 3, "color": colour}
                axes.errorbar(x, middle, spread, label=plot.style.plain(method), **look)
            axes.set(xscale="log", yscale="log", xlabel="numbers of a material", ylabel=label)
            axes.grid(True, which="major")
            axes.xaxis.set_major_formatter("{x:,.0f}")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8.5)
    return figure


def draw_spheres(
    rows: Sequence[tuple[str, Sequence[tuple[str, NDArray[np.float64]]]]],
) -> Figure:
    """Rows of spheres (radius, azimuth, rgb): a material, and its measurement and models by label.

    Under each model is the CIEDE2000 to the measurement.
    """
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    n_columns = max(len(tiles) for _, tiles in rows)
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(1.35 * n_columns + 0.3, 1.62 * len(rows) + 0.3), layout="constrained")
        grid = figure.subplots(len(rows), n_columns, squeeze=False)
        for axes in grid.flat:
            axes.axis("off")
        for row, (name, tiles) in enumerate(rows):
            reference = tiles[0][1]
            for i, (axes, (label, seen)) in enumerate(zip(grid[row], tiles, strict=False)):
                axes.imshow(sphere.picture(seen, sphere.exposure(reference), 160))
                text = plot.style.plain(name) if i == 0 else f"{sphere.difference(seen, reference):.2f}"
                axes.text(0.5, -0.02, text, transform=axes.transAxes, ha="center", va="top", fontsize=7)
                if row == 0:
                    axes.set_title(plot.style.plain(label), fontsize=7.5)
    return figure
