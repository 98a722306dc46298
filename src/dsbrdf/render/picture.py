"""Pictures: exposure and tone mapping, sheets of tiles with their differences, files."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry.colour import LUMINANCE
from dsbrdf.measured.formats.image_file import write_pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dsbrdf.render.quality import Difference

__all__ = ["TONE_MAPPING", "Row", "Tile", "encode", "exposure_of", "sheet", "tone_map", "write_exr"]

Array = NDArray[np.float64]

#: Mean luminance that the reference of a row is brought to.
MEAN_LUMINANCE = 0.22
TONE_MAPPING = (
    "one exposure a row, which brings the first picture's mean luminance to "
    f"{MEAN_LUMINANCE}; clipped at 1; sRGB curve"
)
#: CIEDE2000 at the bright end of the maps.
TOP_DIFFERENCE = 10.0
BACKGROUND = 1.0


@dataclass(frozen=True, eq=False)
class Tile:
    """A picture of a sheet.

    Parameters
    ----------
    title : str
    image : (height, width, 4) ndarray
        Linear RGB, and coverage.
    difference : Difference, optional
        From the first tile of its row.
    """

    title: str
    image: Array
    difference: Difference | None = None


@dataclass(frozen=True, eq=False)
class Row:
    """Pictures of one material under one exposure."""

    title: str
    tiles: Sequence[Tile]

    @property
    def exposure(self) -> float:
        """Of all tiles; from the first."""
        return exposure_of(self.tiles[0].image)


def exposure_of(image: Array) -> float:
    """Factor that brings the mean luminance of what a picture (height, width, 4) shows to `MEAN_LUMINANCE`."""
    luminance = (image[..., :3] @ LUMINANCE)[image[..., 3] > 0.5]
    mean = float(luminance.mean()) if luminance.size else 0.0
    return MEAN_LUMINANCE / mean if mean > 0.0 else 1.0


def encode(linear: Array) -> Array:
    """The sRGB curve (IEC 61966-2-1) of values in [0, 1]."""
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055
    )


def tone_map(image: Array, exposure: float) -> Array:
    """Pixels in sRGB (height, width, 3) in [0, 1] of linear RGB and coverage (height, width, 4), on white."""
    colour = encode(np.clip(exposure * image[..., :3], 0.0, 1.0))
    cover = np.clip(image[..., 3:], 0.0, 1.0)
    return np.asarray(cover * colour + (1.0 - cover) * BACKGROUND)


def sheet(rows: Sequence[Row], *, note: str = "") -> Figure:
    """Rows of pictures; below each that was compared with the first of its row, a map of CIEDE2000.

    Needs the extra `[plot]`.
    """
    import matplotlib
    from matplotlib.figure import Figure

    from dsbrdf import plot

    columns = max(len(row.tiles) for row in rows)
    with_maps = any(tile.difference for row in rows for tile in row.tiles)
    lines = len(rows) * (2 if with_maps else 1)
    width = max(1.7 * columns + 0.3, 3.7)
    text = f"Tone mapping: {TONE_MAPPING}.{' ' if note else ''}{note}"
    text = textwrap.fill(text, int(19.0 * width))
    bottom = 0.12 * (text.count("\n") + 1) + 0.42
    height = 1.95 * lines + 0.35 + bottom
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(width, height))
        grid = figure.subplots(lines, columns, squeeze=False)
        figure.subplots_adjust(
            0.15 / width, bottom / height, 1.0 - 0.15 / width, 1.0 - 0.35 / height, wspace=0.04, hspace=0.16
        )
        for axes in grid.flat:
            axes.axis("off")
        last = None
        for i, row in enumerate(rows):
            lines_of_row = grid[2 * i : 2 * i + 2] if with_maps else grid[i : i + 1]
            last = _draw_row(lines_of_row, row) or last
        if last is not None:
            _draw_bar(figure, last, (bottom - 0.16) / height)
        figure.text(0.15 / width, 0.06 / height, text, fontsize=6.5, va="bottom")
    return figure


def _draw_bar(figure: Figure, shown: Any, level: float) -> None:
    _, height = figure.get_size_inches()
    axes = figure.add_axes((0.6, level, 0.35, 0.07 / height))
    bar = figure.colorbar(shown, cax=axes, orientation="horizontal")
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=7, length=2, pad=1)
    figure.text(0.59, level, "CIEDE2000", fontsize=7, ha="right")


def _draw_row(lines: Any, row: Row) -> Any:
    """Draw tiles and maps; the last map, if there is one."""
    from dsbrdf.plot.style import plain

    shown = None
    for i, (axes, tile) in enumerate(zip(lines[0], row.tiles, strict=False)):
        axes.imshow(tone_map(tile.image, row.exposure), interpolation="antialiased")
        title = f"{plain(row.title)}\n{plain(tile.title)}" if i == 0 and row.title else plain(tile.title)
        axes.set_title(title, fontsize=8, pad=3)
        if tile.difference is None:
            continue
        below = lines[1][i]
        shown = below.imshow(
            tile.difference.map, vmin=0.0, vmax=TOP_DIFFERENCE, cmap="magma", interpolation="nearest"
        )
        below.set_title(
            f"mean {tile.difference.mean:.2f}, SSIM {tile.difference.ssim:.3f}", fontsize=7, pad=2
        )
    return shown


def write_exr(rows: Sequence[Row], path: str | Path) -> None:
    """Write the tiles beside and below each other, linear, with coverage as alpha, as OpenEXR in single precision.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    columns = max(len(row.tiles) for row in rows)
    blank = np.zeros_like(rows[0].tiles[0].image)
    lines = [
        np.concatenate([*(tile.image for tile in row.tiles), *[blank] * (columns - len(row.tiles))], axis=1)
        for row in rows
    ]
    write_pixels(np.concatenate(lines), path)
