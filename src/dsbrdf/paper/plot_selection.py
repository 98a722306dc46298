"""Figure of the choice of the number of lobes (Section 5). Needs the extra `[plot]`."""

from __future__ import annotations

from typing import Any

import numpy as np

# Says what is missing if matplotlib is
from dsbrdf.plot import CHANNEL_COLOURS, GREY, INK, PALE, STYLE, style  # isort: skip
import matplotlib
from matplotlib.figure import Figure

from dsbrdf.paper.selection import LobeSelection

__all__ = ["selection_figure"]

#: What the values of each criterion are.
AXIS = {
    "williams": "mean of ln(divergence + noise)",
    "bic": "BIC",
    "held-out": "relative RMS on held-out samples",
}


def selection_figure(selection: LobeSelection, name: str = "") -> Figure:
    """The criterion against the number of lobes and, if it was tested, Williams' statistic against its critical value.

    Parameters
    ----------
    selection : LobeSelection
    name : str, optional
        Of the material, for the title.
    """
    counts = np.arange(1, selection.max_lobes + 1)
    tested = bool(np.isfinite(selection.statistic).any())
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.6 if tested else 4.0, 3.1), layout="constrained")
        axes = figure.subplots(1, 1 + tested, squeeze=False)[0]
        _draw_values(axes[0], counts, selection)
        if tested:
            _draw_test(axes[1], counts, selection)
        for each in axes:
            each.set_xticks(counts)
            each.set_xlim(0.5, selection.max_lobes + 0.5)
            each.set_xlabel("lobes")
            each.axvspan(selection.n_lobes - 0.4, selection.n_lobes + 0.4, color=PALE, lw=0, zorder=0)
            each.grid(True, axis="y")
        lobes = f"{selection.n_lobes} lobe{'s' * (selection.n_lobes > 1)}"
        figure.suptitle(f"{style.plain(name)}: {lobes}, shaded" if name else f"{lobes}, shaded", fontsize=10)
    return figure


def _draw_values(axes: Any, counts: Any, selection: LobeSelection) -> None:
    axes.plot(counts, selection.values, "o-", color=INK, ms=5.0)
    axes.set_title(f"criterion ({selection.criterion}), lower is better")
    axes.set_ylabel(AXIS[selection.criterion])


def _draw_test(axes: Any, counts: Any, selection: LobeSelection) -> None:
    axes.plot(counts, selection.statistic, "o-", color=CHANNEL_COLOURS[2], ms=5.0, label="statistic")
    axes.plot(counts, selection.critical, "--", color=CHANNEL_COLOURS[0], label="critical value")
    axes.axhline(0.0, color=GREY, lw=0.7)
    axes.set_title(f"Williams' test against {selection.max_lobes} lobes")
    axes.set_ylabel("above the line: significant loss")
    axes.legend(loc="upper right")
