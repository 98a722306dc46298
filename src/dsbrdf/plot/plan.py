"""A figure of a plan: the directions of each pair, seen from above, and what is left uncertain."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from dsbrdf.fitting.plan import Plan
from dsbrdf.plot import style

__all__ = ["plan_figure"]

RINGS = (30.0, 60.0, 90.0)


def plan_figure(plan: Plan) -> Figure:
    """Pairs of light (circle) and viewer (square), joined and numbered, and the deviation after each."""
    with matplotlib.rc_context(style.STYLE):
        figure = Figure(figsize=(8.0, 4.0), layout="constrained")
        above, after = figure.subplots(1, 2, width_ratios=(1.0, 1.0))
        around = np.linspace(0.0, 2.0 * np.pi, 181)
        for ring in RINGS:
            above.plot(ring * np.cos(around), ring * np.sin(around), color=style.PALE, lw=0.8, zorder=0)
            above.annotate(f"{ring:g}°", (0.0, -ring), color=style.GREY, fontsize=7, ha="center", va="top")
        phi = np.deg2rad(plan.phi_o)
        x, y = plan.theta_o * np.cos(phi), plan.theta_o * np.sin(phi)
        for i, (light, viewer_x, viewer_y) in enumerate(zip(plan.theta_i, x, y, strict=True)):
            colour = style.LOBE_COLOURS[i % len(style.LOBE_COLOURS)]
            above.plot([light, viewer_x], [0.0, viewer_y], color=colour, lw=0.9, alpha=0.6)
            above.plot(light, 0.0, "o", color=colour, ms=5)
            above.plot(viewer_x, viewer_y, "s", color=colour, ms=5)
            above.annotate(
                str(i + 1), (viewer_x, viewer_y), xytext=(4, 3), textcoords="offset points", fontsize=8
            )
        above.set_aspect("equal")
        above.set_axis_off()
        above.set_title("light: circles, viewer: squares; angles from the normal", fontsize=9)
        after.plot(np.arange(len(plan.deviation)), plan.deviation, "o-", color=style.INK, ms=4)
        after.set_ylim(0.0, None)
        after.set_xlabel("pairs measured")
        after.set_ylabel("standard deviation of ln f, all directions")
    return figure
