"""Spheres of measured materials, of the model and of its peers, in one light, with errors and sizes.

    python benchmarks/spheres.py OUT.jpg FILE... [--envmap HDR] [--size 200] [--spp 256]

A row a file: the measurement, `dsbrdf.fit`, the paper's slices, Lambert with two GGX lobes and with one, rendered in
Mitsuba 3 under one exposure a row. Below each the numbers of the model and its error: cbrt of `benchmarks/accuracy.py`
in percent, over pairs of directions below 80 degrees. A file takes about 40 s of one core.
"""

from __future__ import annotations

import argparse
import io
import warnings
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from accuracy import FITS, N_PAIRS, PEERS, errors, pairs, truth
from matplotlib.figure import Figure

import dsbrdf
from dsbrdf import _files, plot
from dsbrdf.render import picture
from dsbrdf.render.scene import View, render

COLUMNS = {
    "dsbrdf": FITS["dsbrdf.fit"],
    "the paper's slices": FITS["the paper's slices"],
    "Lambert + two GGX": PEERS["Lambert + two GGX"],
    "Lambert + GGX": PEERS["Lambert + GGX"],
}
DPI, QUALITY = 110, 88


def row(path: Path, view: View) -> list[tuple[np.ndarray, str]]:
    """Pictures of a file and of what was fitted to it, and what is said of each."""
    measured = dsbrdf.read(path)
    wi, wo = pairs(N_PAIRS)
    values = truth(path, measured, wi, wo)
    found = [(render(measured, view), "")]
    for label, fit in COLUMNS.items():
        model = fit(measured)
        _, cbrt, _ = errors(np.asarray(model.eval(wi, wo)), values, wi[:, 2] * wo[:, 2])
        found.append((render(model, view), f"{model.n_parameters} numbers, error {100 * cbrt:.1f} %"))
        print(path.stem, label, found[-1][1], flush=True)
    return found


def sheet(rows: dict[str, list[tuple[np.ndarray, str]]]) -> Figure:
    """The rows below each other."""
    width, height = 1.8 * (1 + len(COLUMNS)), 2.02 * len(rows) + 0.3
    with matplotlib.rc_context(plot.STYLE):
        figure = Figure(figsize=(width, height))
        grid = figure.subplots(len(rows), 1 + len(COLUMNS), squeeze=False)
        figure.subplots_adjust(0.005, 0.24 / height, 0.995, 1.0 - 0.28 / height, wspace=0.05, hspace=0.13)
        for i, (name, tiles) in enumerate(rows.items()):
            exposure = picture.exposure_of(tiles[0][0])
            for axes, (image, text) in zip(grid[i], tiles, strict=True):
                axes.imshow(picture.tone_map(image, exposure), interpolation="antialiased")
                axes.axis("off")
                axes.text(
                    0.5, -0.01, text or name, transform=axes.transAxes, ha="center", va="top", fontsize=8
                )
        for axes, title in zip(grid[0], ("measured", *COLUMNS), strict=True):
            axes.set_title(title, fontsize=10, pad=4, weight="bold" if title == "dsbrdf" else "normal")
    return figure


def write(figure: Figure, path: Path) -> None:
    """Write a figure as JPEG."""
    from PIL import Image

    memory = io.BytesIO()
    with matplotlib.rc_context(plot.STYLE):
        figure.savefig(memory, format="png", dpi=DPI)
    with _files.aside(path) as part:
        Image.open(memory).convert("RGB").save(part, "jpeg", quality=QUALITY, optimize=True, subsampling=0)


def main(arguments: Any = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--envmap", type=Path)
    parser.add_argument("--size", type=int, default=200)
    parser.add_argument("--spp", type=int, default=256)
    args = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    view = View(envmap=args.envmap, size=args.size, spp=args.spp)
    write(sheet({path.stem.removesuffix("_rgb"): row(path, view) for path in args.files}), args.out)


if __name__ == "__main__":
    main()
