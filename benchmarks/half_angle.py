"""Draw docs/images/half-angle.png: the half and the difference angle, and the lobes of a material. Takes 5 s."""

from __future__ import annotations

import warnings
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import dsbrdf
from dsbrdf import plot
from dsbrdf.plot.style import GREY, INK, LOBE_COLOURS, STYLE

OUT = Path(__file__).parents[1] / "docs" / "images" / "half-angle.png"
MATERIAL, N_LOBES, THETA_D = "rough-gold", 3, 25


def arrow(axes, angle, text, colour, length=1.0, side="center", **style):
    """An arrow from the origin, at an angle in degrees from the right."""
    at = length * np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    axes.annotate(
        "", at, (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, **style}
    )
    axes.text(*(1.06 * at), text, color=colour, ha=side, va="bottom", fontsize=9.5)


def arc(axes, start, end, radius, text, colour):
    """An arc between two angles in degrees, with its name."""
    angles = np.deg2rad(np.linspace(start, end, 60))
    axes.plot(radius * np.cos(angles), radius * np.sin(angles), color=colour, lw=1.3)
    middle = np.deg2rad(0.5 * (start + end))
    out = radius + 0.09
    axes.text(
        out * np.cos(middle), out * np.sin(middle), text, color=colour, ha="center", va="center", fontsize=11
    )


def draw_angles(axes):
    """The surface, light, viewer, normal and half vector."""
    light, view = 28.0, 122.0
    half = 0.5 * (light + view)
    axes.fill_between([-1.15, 1.15], -0.1, 0.0, color="#d9d9d9", lw=0)
    arrow(axes, 90.0, "normal", GREY, side="right")
    arrow(axes, light, "  to the light", LOBE_COLOURS[0])
    arrow(axes, view, "to the viewer", LOBE_COLOURS[5])
    arrow(axes, half, "half vector", INK, side="left", linestyle="--")
    arc(axes, half, 90.0, 0.62, r"$\theta_h$", INK)
    arc(axes, light, half, 0.38, r"$\theta_d$", LOBE_COLOURS[0])
    arc(axes, half, view, 0.31, r"$\theta_d$", LOBE_COLOURS[5])
    axes.set(xlim=(-1.2, 1.3), ylim=(-0.12, 1.2), aspect="equal")
    axes.axis("off")
    axes.set_title("The half vector lies half way between light and viewer")


def draw_lobes(axes):
    """A measured material, its fit, and the lobes that add up to it."""
    measured = dsbrdf.material(MATERIAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
        model = dsbrdf.fit(measured, N_LOBES).model
    theta_h, values = plot.incident_plane(measured, THETA_D)
    at = np.linspace(0.0, 0.87, 300)
    theta_d = measured.theta_d[THETA_D]
    bottom = np.zeros(len(at))
    for k in range(model.n_lobes):
        lobe = model.lobe(k).eval_angles(at, theta_d, 0.0)[:, 0]
        axes.fill_between(
            np.rad2deg(at), bottom, bottom + lobe, color=LOBE_COLOURS[k], alpha=0.55, lw=0, label=f"lobe {k}"
        )
        bottom = bottom + lobe
    axes.plot(np.rad2deg(at), bottom, color=INK, lw=1.4, label="their sum, the model")
    shown = (theta_h > 0.0) & (theta_h < 0.87)
    axes.plot(
        np.rad2deg(theta_h[shown]),
        values[0, shown],
        "o",
        ms=3.4,
        mfc="white",
        mec=INK,
        mew=0.8,
        label="measured",
    )
    axes.set(xlim=(0, 50), ylim=(0, None))
    axes.set_xlabel(r"half angle $\theta_h$ (degrees)")
    axes.set_ylabel("reflectance (1/sr), red")
    axes.set_title(rf"A lobe is a bump over $\theta_h$; a few add up to a material ($\theta_d$ = {THETA_D}°)")
    axes.legend()


with matplotlib.rc_context(STYLE):
    figure = Figure(figsize=(9.6, 3.3))
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    figure.subplots_adjust(0.01, 0.15, 0.985, 0.9, wspace=0.16)
    draw_angles(left)
    draw_lobes(right)
    plot.write_figure(figure, OUT, dpi=130)
print(OUT)
