"""What `dsbrdf photo` shows: a picture, that of the model, how they differ, the material, the light."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import lighting
from dsbrdf.images import ImageFit, Light, relight
from dsbrdf.render import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["sheet"]

Array = NDArray[np.float64]

#: Logarithms at the ends of the map of residuals.
END = 0.3
#: Pixels of the material's sphere; rows of the light's map.
SPHERE, LIGHT_ROWS = 100, 256
#: Letters of a line below.
LINE = 155


def sheet(found: ImageFit) -> Figure:
    """Figure of the first picture of a fit.

    Needs the extra `[plot]`.
    """
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    shown, made = found.pictures[0].pixels, found.rendered[0]
    residual = found.residual[0]
    seen = np.asarray(np.isfinite(residual).all(-1))
    rows, columns = (np.flatnonzero(seen.any(axis)) for axis in (1, 0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    studio = Light.from_map(lighting.studio(LIGHT_ROWS))
    tiles = [_with_cover(image, seen)[box] for image in (shown, made)]
    exposure = picture.exposure_of(tiles[0])
    sphere = relight(found.model, "sphere", studio, size=SPHERE)
    sphere = _with_cover(sphere, np.asarray(sphere.any(-1)))
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(8.2, 2.25))
        axes = figure.subplots(1, 5, gridspec_kw={"width_ratios": [1, 1, 1, 1, 1.6]})
        figure.subplots_adjust(0.01, 0.2, 0.99, 0.86, wspace=0.06)
        for one, image, title in zip(axes, tiles, ("picture", "model"), strict=False):
            one.imshow(picture.tone_map(image, exposure))
            one.set_title(title, fontsize=8, pad=3)
        mean = np.where(seen, np.nan_to_num(residual).mean(-1), np.nan)[box]
        drawn = axes[2].imshow(mean, vmin=-END, vmax=END, cmap="RdBu_r", interpolation="nearest")
        axes[2].set_title("ln(model / picture)", fontsize=8, pad=3)
        bar = figure.colorbar(drawn, ax=axes[2], orientation="horizontal", fraction=0.06, pad=0.04)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=6, length=2, pad=1)
        axes[3].imshow(picture.tone_map(sphere, picture.exposure_of(sphere)))
        axes[3].set_title("material in a studio", fontsize=8, pad=3)
        _draw_light(axes[4], found.light[0])
        for one in axes:
            one.axis("off")
        figure.text(0.01, 0.03, textwrap.fill(found.summary, LINE), fontsize=6.5)
    return figure


def _with_cover(image: Array, seen: NDArray[np.bool_]) -> Array:
    """Three channels of an image (height, width, channel), and coverage."""
    colour = image if image.shape[-1] == 3 else np.repeat(image[..., :1], 3, axis=-1)
    return np.concatenate([colour, seen[..., None].astype(np.float64)], axis=-1)


def _draw_light(axes: Any, light: Light) -> None:
    from matplotlib.patches import Circle

    if light.map is None:
        inside = light.direction[:, 2] >= 0.0
        axes.plot(*light.direction[inside, :2].T, "o", *light.direction[~inside, :2].T, "x", ms=3)
        axes.add_patch(Circle((0, 0), 1, fill=False, lw=0.5))
        axes.set_aspect("equal")
        axes.set_title("lights, from the camera", fontsize=8, pad=3)
        return
    image = _with_cover(light.map, np.ones(light.map.shape[:2], dtype=bool))
    axes.imshow(picture.tone_map(image, picture.exposure_of(image)))
    axes.set_title("light", fontsize=8, pad=3)
