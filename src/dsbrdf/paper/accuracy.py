"""Fig. 5: relative RMS of every material, sorted, with floors and competitors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dsbrdf.paper.survey import Row, median

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw"]


def draw(rows: Sequence[Row]) -> Figure:
    """One material a column, by the error of the paper's model."""
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    rows = sorted(rows, key=lambda row: row.rel_rms)
    x = range(len(rows))
    colours = plot.LOBE_COLOURS
    with matplotlib.rc_context(plot.STYLE):
        width = max(0.112 * len(rows) + 1.0, 6.0)
        figure = Figure(figsize=(width, 4.9))
        figure.subplots_adjust(left=0.62 / width, right=1.0 - 0.1 / width, top=0.86, bottom=0.31)
        axes = figure.subplots()
        ours = [row.rel_rms for row in rows]
        floor = [row.bivariate_floor for row in rows]
        axes.vlines(x, floor, ours, color="#c9c9c9", lw=1.6, zorder=1)
        for key, marker, colour, size, label in (
            ("bivariate_floor", "_", "#222222", 7.5, "bivariate floor"),
            ("monotone_floor", "_", "#56b4e9", 5.0, "monotone floor"),
            ("torrance_sparrow", "x", colours[4], 3.6, "Lambert + 2 Torrance-Sparrow"),
            ("ggx_pair", "+", colours[0], 4.2, "Lambert + 2 GGX"),
            ("fit", "s", colours[3], 2.8, "dsbrdf.fit, whole hemisphere"),
            ("with_term", "^", colours[2], 3.2, "the model with azimuthal term"),
            ("rel_rms", "o", colours[5], 4.0, "the paper's model, lobes chosen"),
        ):
            values = [getattr(row, key) for row in rows]
            text = f"{label} (median {median(rows, key):.4f})"
            fill = "none" if marker == "^" else colour
            axes.plot(x, values, marker, ms=size, mec=colour, mfc=fill, mew=1.1, label=text)
        axes.set_yscale("log")
        axes.set_xlim(-0.8, len(rows) - 0.2)
        axes.set_xticks(x, [row.name for row in rows], rotation=90, fontsize=6.0 if len(rows) > 20 else 8.5)
        axes.tick_params(axis="x", length=2.0, pad=1.5)
        axes.set_ylabel("relative RMS error")
        axes.grid(True, axis="y")
        handles, labels = axes.get_legend_handles_labels()
        columns, size = (3, 8.0) if width > 9.0 else (2, 7.0)
        figure.legend(handles[::-1], labels[::-1], loc="upper center", ncols=columns, fontsize=size)
    return figure
