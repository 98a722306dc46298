"""What all figures share: colours, marks, the style, and how a figure is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from dsbrdf import _check, _files, _text

__all__ = [
    "CHANNEL_COLOURS",
    "DPI",
    "GREY",
    "INK",
    "LOBE_COLOURS",
    "LOBE_DASHES",
    "LOBE_MARKERS",
    "PALE",
    "STYLE",
    "plain",
    "write_figure",
]

#: Of red, green and blue: apart in lightness too, for readers who see few colours.
CHANNEL_COLOURS = ("#d7263d", "#2a9d4a", "#1d3f9c")
#: Of lobes, from the set of Okabe and Ito (2008).
LOBE_COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2")
LOBE_MARKERS = ("o", "s", "^", "D", "v", "*")
LOBE_DASHES = ("--", "-.", (0, (1, 1.2)), (0, (5, 1, 1, 1, 1, 1)))
INK, GREY, PALE = "#222222", "#8a8a8a", "#efefef"
STYLE: dict[Any, Any] = {
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "font.size": 9,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.color": INK,
    "ytick.labelsize": 8.5,
}
DPI = 150
#: Characters of a name that a figure has room for.
MAX_NAME = 32


def plain(name: str, most: int = MAX_NAME) -> str:
    """A name in a figure, where it is no formula and has no line breaks, in so many characters at most."""
    shown = _text.shown(name)
    short = shown if len(shown) <= most else f"{shown[: most - 4]} ..."
    return short.replace("$", r"\$")


def write_figure(figure: Figure, path: str | Path, *, dpi: int = DPI) -> None:
    """Write a figure, in the format of the ending of `path`; it is written aside and renamed.

    Raises
    ------
    OSError
        If the file cannot be written; then nothing is left of it.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> figure = dsbrdf.plot.parameter_figure(dsbrdf.library.load("nickel"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "nickel.svg")
    ...     dsbrdf.plot.write_figure(figure, path)
    ...     path.exists()
    True
    """
    _check.instance(figure, Figure, "figure")
    path = Path(path)
    with _files.aside(path) as part, matplotlib.rc_context(STYLE):
        # By which a later run knows that it may be replaced
        maker = {"png": "Software", "pdf": "Creator", "svg": "Creator"}.get(path.suffix[1:].lower())
        metadata = {maker: "dsbrdf"} if maker else None
        figure.savefig(part, format=path.suffix[1:], dpi=dpi, metadata=metadata)
