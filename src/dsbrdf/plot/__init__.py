"""Figures of models and fits. Needs the extra `[plot]`.

Every function returns a `matplotlib.figure.Figure`; `write_figure` writes one. Read `style` first, which holds the
colours and the style that all figures share, then `model`: measured points against fitted curves, lobes, parameters,
and spheres; `samples` shows scattered samples and fits of them.
"""

try:
    import matplotlib  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        'dsbrdf.plot needs matplotlib: pip install "dsbrdf[plot]"', name="matplotlib"
    ) from error

from dsbrdf.plot import model
from dsbrdf.plot.model import (
    EXPOSURE,
    demo_figure,
    fit_figure,
    incident_plane,
    parameter_figure,
    sphere_picture,
)
from dsbrdf.plot.samples import sample_fit_figure, samples_figure
from dsbrdf.plot.style import (
    CHANNEL_COLOURS,
    DPI,
    GREY,
    INK,
    LOBE_COLOURS,
    LOBE_DASHES,
    LOBE_MARKERS,
    PALE,
    STYLE,
    write_figure,
)

__all__ = [
    "CHANNEL_COLOURS",
    "DPI",
    "EXPOSURE",
    "GREY",
    "INK",
    "LOBE_COLOURS",
    "LOBE_DASHES",
    "LOBE_MARKERS",
    "PALE",
    "STYLE",
    "demo_figure",
    "fit_figure",
    "incident_plane",
    "model",
    "parameter_figure",
    "sample_fit_figure",
    "samples_figure",
    "sphere_picture",
    "write_figure",
]
