"""A scene around one object, and pictures of it with any reflectance."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import lighting
from dsbrdf.geometry.grids import SHAPE
from dsbrdf.measured.formats import image_file
from dsbrdf.measured.table import MeasuredBRDF, tabulate
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.render import variants

__all__ = ["Reflectance", "View", "check_channels", "render", "world"]

Array = NDArray[np.float64]
#: Paths end here: light that meets the object a third time is not followed.
MAX_DEPTH = 4
#: Cells of the table of what is neither model nor table.
TABLE = SHAPE
MESHES = {".ply": "ply", ".obj": "obj", ".serialized": "serialized"}


class Reflectance(Protocol):
    """What can be rendered: a model, a table, a baseline, anything with `eval`."""

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., channel) in 1/sr without the cosine, of unit vectors (..., 3)."""
        ...


@dataclass(frozen=True)
class View:
    """What is looked at, in what light.

    Parameters
    ----------
    shape : str
        "sphere", or a mesh: a .ply, .obj or .serialized file; it is brought to the sphere's size.
    envmap : str or Path, optional
        A latitude-longitude HDR or EXR map; the lighting of `dsbrdf.geometry.lighting` by default.
    size : int
        Width and height in pixels.
    spp : int
        Samples a pixel at least. Under 256, noise makes a CIEDE2000 of 0.3 to 0.5 in the mean.
    """

    shape: str = "sphere"
    envmap: str | Path | None = None
    size: int = 256
    spp: int = 256

    def __post_init__(self) -> None:
        if min(self.size, self.spp) < 1:
            raise ValueError(f"'size' and 'spp' must be at least 1, got {self.size} and {self.spp}.")
        if self.shape != "sphere" and Path(self.shape).suffix.lower() not in MESHES:
            raise ValueError(f"{self.shape}: not a shape: expected 'sphere' or a file {', '.join(MESHES)}.")
        for path in (self.envmap, None if self.shape == "sphere" else self.shape):
            if path is not None and not Path(path).is_file():
                raise FileNotFoundError(2, "No such file", str(path))
        try:
            self.shape.encode()
        except UnicodeEncodeError:
            raise ValueError(
                f"{self.shape}: Mitsuba opens no file whose name has no letters. Rename it."
            ) from None


def check_channels(reflectance: Reflectance, name: str = "") -> None:
    """Refuse a model or a table that no renderer shows as a colour.

    Raises
    ------
    ValueError
        If it has another number of channels than one or three.
    """
    if not isinstance(reflectance, DSBRDF | MeasuredBRDF) or reflectance.n_channels in (1, 3):
        return
    kind, remedy = (
        ("model", "of lobes.colour") if isinstance(reflectance, DSBRDF) else ("table", "of planes and scale")
    )
    raise ValueError(
        f"{reflectance.name or name or kind}: rendering needs one or three channels, the {kind} has "
        f"{reflectance.n_channels}. Keep one of them, or three as red, green and blue: the same index {remedy}."
    )


def render(reflectance: Reflectance, view: View | None = None, *, seed: int = 0) -> Array:
    """Picture of an object with a reflectance.

    The plugins render it where they can run. Elsewhere it is written as a file of the RGL database, which Mitsuba
    renders by itself, in `scalar_rgb` without LLVM too.

    Parameters
    ----------
    reflectance : DSBRDF, MeasuredBRDF, or anything with `eval(wi, wo)`
        With one or three channels, linear sRGB. What is neither model nor table is tabulated first.
    view : View, optional
    seed : int, optional
        Of the samples.

    Returns
    -------
    (size, size, 4) ndarray
        Radiance in linear sRGB, and coverage; where there is no object both are 0.

    Raises
    ------
    ModuleNotFoundError
        If Mitsuba is not installed.
    FileNotFoundError, ValueError
        If the view names no file, or the reflectance has other channels.
    """
    view = view or View()
    check_channels(reflectance)
    variants.choose()
    if not variants.missing_plugin():
        import dsbrdf.render

        dsbrdf.render.register()
        if not isinstance(reflectance, DSBRDF | MeasuredBRDF):
            reflectance = tabulate(reflectance.eval, getattr(reflectance, "name", ""), shape=TABLE)
        return _picture(world(dsbrdf.render.to_dict(reflectance), view), view.spp, seed)
    from dsbrdf.export.rgl import write_rgl

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "reflectance.bsdf"
        write_rgl(reflectance, path)
        return _picture(world({"type": "measured", "filename": str(path)}, view), view.spp, seed)


def world(bsdf: dict[str, Any], view: View) -> Any:
    """Mitsuba's scene of an object with a bsdf, in the variant that is set."""
    mi = variants.import_mitsuba()
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": MAX_DEPTH, "hide_emitters": True},
            "sensor": _camera(mi, view.size),
            "light": _light(mi, view.envmap),
            "object": _object(mi, view.shape) | {"bsdf": {"type": "twosided", "bsdf": bsdf}},
        }
    )


def _picture(world: Any, spp: int, seed: int) -> Array:
    mi = variants.import_mitsuba()
    # The sampler has a grid of cells in a pixel, and would say that it rounds up
    columns = math.isqrt(spp)
    spp = columns * -(-spp // columns)
    image = np.array(mi.render(world, spp=spp, seed=seed), dtype=np.float64)
    return np.asarray(np.where(np.isfinite(image), image, 0.0))


def _camera(mi: Any, size: int) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": 22.0,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 5.4], target=[0, 0, 0], up=[0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": size,
            "height": size,
            "pixel_format": "rgba",
            "component_format": "float32",
            "rfilter": {"type": "gaussian"},
        },
        "sampler": {"type": "multijitter"},
    }


def _light(mi: Any, envmap: str | Path | None) -> dict[str, Any]:
    pixels = lighting.studio() if envmap is None else image_file.read_pixels(envmap)
    return {"type": "envmap", "bitmap": mi.Bitmap(pixels.astype(np.float32))}


def _object(mi: Any, shape: str) -> dict[str, Any]:
    if shape == "sphere":
        return {"type": "sphere"}
    mesh = {"type": MESHES[Path(shape).suffix.lower()], "filename": shape}
    box = mi.load_dict(mesh).bbox()
    low, high = (np.array(corner, dtype=float).ravel() for corner in (box.min, box.max))
    scale = 2.0 / float(np.linalg.norm(high - low))
    middle = [float(-x) for x in 0.5 * (low + high)]
    return mesh | {"to_world": mi.ScalarTransform4f().scale(scale).translate(middle)}
