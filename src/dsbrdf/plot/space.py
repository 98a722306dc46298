"""Figures of a space of materials: maps of spheres, variance, principal functions, blends and draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnnotationBbox, OffsetImage
from numpy.typing import NDArray

from dsbrdf.model import sphere
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import MAX_LN_KAPPA
from dsbrdf.plot import style
from dsbrdf.plot.model import EXPOSURE
from dsbrdf.space.build import lobe_fpca
from dsbrdf.space.material_space import MaterialSpace

__all__ = [
    "blend_figure",
    "draws_figure",
    "lobe_map",
    "material_map",
    "principal_figure",
    "scree_figure",
    "write_all",
]

Array = NDArray[np.float64]

N_PIXELS = 72
#: Principal functions that are shown, and how far along them, in standard deviations.
SHOWN, STEPS = 4, (-2.0, -1.0, 0.0, 1.0, 2.0)
BLEND_STEPS = 7
#: Materials up to which a map has their names.
MOST_NAMES = 25
N_DRAWS = 20
#: Shares of the variance whose number of components the paper tells.
SHARES = (0.9, 0.95, 0.99)
#: Least height, 1/sr, and gamma that are drawn.
LEAST = {"height": 1e-3, "gamma": 0.05}
#: Lobes and materials beyond these quantiles of a coordinate are drawn at the rim, so that a few do not set the scale.
RIM = (0.01, 0.99)
CAPTION = (
    "Spheres: a distant light at 45° above left, a weak one on the right; each exposed to the same mean."
)


def write_all(
    space: MaterialSpace, out: str | Path, progress: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Write all figures as .png.

    Parameters
    ----------
    space : MaterialSpace
    out : path
        A folder; made if it does not exist.
    progress : callable, optional
        Called with the name of each figure before it is drawn.

    Returns
    -------
    list of Path

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    written = []
    for name, make in FIGURES.items():
        progress(name)
        written.append(Path(out) / f"space-{name}.png")
        style.write_figure(make(space), written[-1])
    return written


def material_map(space: MaterialSpace) -> Figure:
    """Each material as a sphere at its first two scores (Fig. 10)."""
    models = [space.decode(curves, conserve=False) for curves in space.curves]
    title = f"{len(models)} materials on the first two principal functions"
    return _map(
        [_picture(model) for model in models], space.fpca.scores, space.fpca.explained, title, space.names
    )


def lobe_map(space: MaterialSpace) -> Figure:
    """Each lobe as a sphere at its first two scores among lobes (Fig. 9)."""
    fpca, lobes = lobe_fpca(space)
    pictures = [
        _picture(space.decode(space.curves[material, slot][None], conserve=False)) for material, slot in lobes
    ]
    title = f"{len(lobes)} lobes on the first two principal functions of lobes"
    return _map(pictures, fpca.scores, fpca.explained, title)


def _map(
    pictures: Sequence[Array], scores: Array, explained: Array, title: str, names: Sequence[str] = ()
) -> Figure:
    size = 0.42 if len(pictures) <= 120 else 0.3
    at = scores[:, :2] if scores.shape[1] > 1 else np.pad(scores, ((0, 0), (0, 1)))
    at = np.clip(at, *np.quantile(at, RIM, axis=0))
    with matplotlib.rc_context(style.STYLE):
        figure = Figure(figsize=(9.0, 6.4))
        axes = figure.subplots()
        figure.subplots_adjust(left=0.085, right=0.985, top=0.94, bottom=0.13)
        axes.scatter(at[:, 0], at[:, 1], s=0.0)
        # Names below the outermost spheres have room, too
        shown = [style.plain(name) for name in names] if len(names) <= MOST_NAMES else []
        axes.margins(max([0.06, *(0.0035 * len(name) for name in shown)]), 0.06)
        # What lies far from the middle of the crowd is drawn last
        order = np.argsort(((at - np.median(at, axis=0)) ** 2).sum(1), kind="stable")
        for i in order:
            image = OffsetImage(pictures[i], zoom=size * 72.0 / N_PIXELS, resample=True)
            axes.add_artist(AnnotationBbox(image, at[i], frameon=False, pad=0.0))
        for name, place in zip(shown, at, strict=False):
            # Below the sphere, which is `size` inches high
            axes.annotate(name, place, (0.0, -36.0 * size - 2.0), textcoords="offset points", ha="center",
                          va="top", fontsize=6.5, zorder=5)  # fmt: skip
        axes.grid(True)
        axes.set_axisbelow(True)
        axes.set_title(title)
        labels = [f"score {k + 1}, {share:.1%} of the variance" for k, share in enumerate(explained[:2])]
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1] if len(labels) > 1 else "")
        _caption(figure, CAPTION + " Scores beyond the 1st and 99th\npercentile are drawn there.")
    return figure


def scree_figure(space: MaterialSpace) -> Figure:
    """Share of the variance of each component, and of the first ones together."""
    explained = space.fpca.explained
    count = np.arange(1, len(explained) + 1)
    with matplotlib.rc_context(style.STYLE):
        figure = Figure(figsize=(7.0, 3.6))
        axes = figure.subplots()
        figure.subplots_adjust(left=0.1, right=0.97, top=0.9, bottom=0.16)
        axes.bar(count, explained, color=style.PALE, edgecolor=style.GREY, lw=0.6, label="of each")
        axes.plot(
            count, np.cumsum(explained), "o-", ms=3.0, color=style.CHANNEL_COLOURS[2], label="of the first"
        )
        for share in SHARES:
            n = space.fpca.n_components(share)
            axes.plot([0, n, n], [share, share, 0], color=style.CHANNEL_COLOURS[0], lw=0.8, ls="--")
            axes.annotate(f"{share:.0%}: {n}", (n, share), (6, -11), textcoords="offset points", fontsize=8.5)
        axes.set_xlim(0.3, min(len(explained), space.fpca.n_components(0.995) + 3) + 0.7)
        axes.set_ylim(0.0, 1.04)
        axes.set_xlabel("principal components")
        axes.set_ylabel("share of the variance")
        axes.legend(loc="center right")
        axes.grid(True, axis="y")
        axes.set_axisbelow(True)
        axes.set_title(repr(space))
    return figure


def principal_figure(space: MaterialSpace) -> Figure:
    """What the first principal functions do: spheres, and the curves of one channel, at steps along each."""
    n = min(SHOWN, len(space.fpca.variances))
    theta_d = np.linspace(0.0, np.pi / 2, 91)
    with matplotlib.rc_context(style.STYLE):
        figure = Figure(figsize=(11.0, 1.75 * n + 1.05))
        height = figure.get_figheight()
        widths = [1.0] * len(STEPS) + [0.25, 1.5, 0.25, 1.5]
        grid = figure.subplots(n, len(widths), squeeze=False, width_ratios=widths)
        figure.subplots_adjust(0.045, 0.85 / height, 0.985, 1.0 - 0.4 / height, wspace=0.05, hspace=0.14)
        for axes in grid[:, [-4, -2]].flat:
            axes.axis("off")
        for k, row in enumerate(grid):
            moved = [_along(space, k, step) for step in STEPS]
            for axes, step, curves in zip(row, STEPS, moved, strict=False):
                _show(axes, space.decode(curves, conserve=False))
                if k == 0:
                    axes.set_title("mean" if step == 0.0 else f"{step:+g} s.d.")
            row[0].text(-0.1, 0.5, f"{k + 1}: {space.fpca.explained[k]:.0%}", transform=row[0].transAxes,
                        rotation=90, ha="right", va="center")  # fmt: skip
            for what, axes in zip(LEAST, row[[-3, -1]], strict=True):
                _draw_functions(axes, space, moved, theta_d, what)
                if k == 0:
                    axes.set_title(
                        {"height": "height of each lobe, 1/sr", "gamma": r"$\gamma$ of each lobe"}[what]
                    )
                if k == n - 1:
                    axes.set_xlabel(r"$\theta_d$ (degrees)")
                axes.tick_params(labelbottom=k == n - 1)
        _caption(figure, CAPTION + " Curves: mean (solid), +1 s.d. (dashed), -1 s.d. (dotted).")
    return figure


def _along(space: MaterialSpace, k: int, step: float) -> Array:
    scores = np.zeros(k + 1)
    scores[k] = step * np.sqrt(space.fpca.variances[k])
    return space.fpca.inverse_transform(scores).reshape(space.curves.shape[1:])


def _draw_functions(
    axes: Any, space: MaterialSpace, moved: Sequence[Array], theta_d: Array, what: str
) -> None:
    for step, dash in ((0.0, "-"), (1.0, "--"), (-1.0, ":")):
        at = space.variables.lobes(moved[STEPS.index(step)]).at(theta_d)
        height = np.expm1(np.minimum(at.kappa, np.exp(MAX_LN_KAPPA))).mean(1)
        for slot, curve in enumerate({"height": height, "gamma": at.gamma}[what].T):
            colour = style.LOBE_COLOURS[slot % len(style.LOBE_COLOURS)]
            axes.plot(np.rad2deg(theta_d), np.maximum(curve, LEAST[what]), dash, color=colour, lw=1.2)
    axes.set_yscale("log")
    axes.set_xlim(0.0, 90.0)
    axes.set_xticks(range(0, 91, 30))
    axes.grid(True)


def blend_figure(space: MaterialSpace, pairs: Sequence[tuple[str, str]] = ()) -> Figure:
    """Strips from one material to another; by default between the ends of the first three axes."""
    chosen = list(pairs) or _ends(space)
    shares = np.linspace(0.0, 1.0, BLEND_STEPS)
    rows = []
    for a, b in chosen:
        first, last = (space.curves[space.names.index(name)] for name in (a, b))
        rows.append(
            (
                f"{style.plain(a)} to {style.plain(b)}",
                [space.decode((1.0 - t) * first + t * last) for t in shares],
            )
        )
    return _strips(rows, [f"{t:.0%}" for t in shares], CAPTION)


def _ends(space: MaterialSpace) -> list[tuple[str, str]]:
    """Names of the materials at the ends of the first three axes."""
    scores = space.fpca.scores[:, :3]
    return [(space.names[i], space.names[j]) for i, j in zip(scores.argmin(0), scores.argmax(0), strict=True)]


def draws_figure(space: MaterialSpace, seed: int = 1) -> Figure:
    """Materials drawn from the space."""
    n = N_DRAWS
    models = space.draw(n, np.random.default_rng(seed))
    width = 10
    rows = [("", models[i : i + width]) for i in range(0, n, width)]
    return _strips(rows, [""] * width, f"{n} materials drawn from a space of {len(space.names)}. {CAPTION}")


def _strips(rows: Sequence[tuple[str, Sequence[DSBRDF]]], titles: Sequence[str], caption: str) -> Figure:
    labelled = any(label for label, _ in rows)
    with matplotlib.rc_context(style.STYLE):
        figure = Figure(figsize=(1.12 * len(titles), (1.36 if labelled else 1.1) * len(rows) + 0.55))
        grid = figure.subplots(len(rows), len(titles), squeeze=False)
        height = figure.get_figheight()
        figure.subplots_adjust(
            0.005, 0.32 / height, 0.995, 1.0 - 0.3 / height, wspace=0.03, hspace=0.24 * labelled
        )
        for (label, models), row in zip(rows, grid, strict=True):
            for axes in row[len(models) :]:
                axes.axis("off")
            for axes, model in zip(row, models, strict=False):
                _show(axes, model)
            row[0].set_title(label, loc="left", fontsize=9)
        _caption(figure, caption)
    return figure


def _show(axes: Any, model: DSBRDF) -> None:
    axes.imshow(_picture(model, 2))
    axes.axis("off")


def _picture(model: DSBRDF, scale: int = 1) -> Array:
    radiance = sphere.shade(model, scale * N_PIXELS)
    # All spheres cover the same pixels
    mean = float(radiance.mean()) / (np.pi / 4)
    return sphere.picture(radiance, EXPOSURE / max(mean, 1e-9))


def _caption(figure: Figure, text: str) -> None:
    figure.text(
        0.5, 0.09 / figure.get_figheight(), text, ha="center", va="bottom", fontsize=8.0, color=style.GREY
    )


#: What `write_all` writes, by name.
FIGURES: dict[str, Callable[[MaterialSpace], Figure]] = {
    "materials": material_map,
    "lobes": lobe_map,
    "variance": scree_figure,
    "functions": principal_figure,
    "blends": blend_figure,
    "draws": draws_figure,
}
