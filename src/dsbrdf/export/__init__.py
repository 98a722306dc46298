"""Models as files for other programs: `export` writes one of `FORMATS`.

A format is one entry here and a function `(model, path)` in a module of its own, imported when it is used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORMATS", "Format", "export"]


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    suffix : str
        Ending of a file's name.
    description : str
        What takes the file.
    writer : str
        ``module:function`` in this package.
    options : dict
        Keywords the function gets.
    """

    suffix: str
    description: str
    writer: str
    options: dict[str, Any] = field(default_factory=dict)

    def load(self) -> Callable[..., str | None]:
        """Import the function that writes."""
        module, function = self.writer.split(":")
        writer: Callable[..., str | None] = getattr(importlib.import_module(f"{__name__}.{module}"), function)
        return writer


FORMATS = {
    "rgl": Format("bsdf", "Mitsuba 3, RGB variants: plugin 'measured'", "rgl:write_rgl"),
    "rgl-spectral": Format(
        "bsdf", "pbrt-v4, and Mitsuba 3, spectral variants", "rgl:write_rgl", {"form": "spectral"}
    ),
    "merl": Format("binary", "MERL table, 35 MB: BRDF viewers and research code", "merl:write"),
    "glsl": Format("glsl", "GLSL functions with the numbers baked in", "glsl:write_glsl"),
    "brdf": Format("brdf", "Disney BRDF Explorer", "brdf_explorer:write_brdf_explorer"),
    "principled": Format("json", "Mitsuba 3 'principled', a preview", "preview:write_principled"),
    "gltf": Format("gltf", "glTF 2.0 metallic-roughness material, a preview", "preview:write_gltf"),
}


def export(model: DSBRDF, path: str | Path, format: str) -> str | None:
    """Write a model as a file for another program.

    Parameters
    ----------
    model : DSBRDF
    path : str or Path
        Replaced if it exists.
    format : str
        One of `FORMATS`.

    Returns
    -------
    str or None
        A sentence on what the file lost, of a format that cannot hold the model.

    Raises
    ------
    ValueError
        If there is no such format, or it cannot hold such a model; says what to do.
    OSError
        If the file cannot be written.
    """
    if format not in FORMATS:
        raise ValueError(f"'format' must be one of {', '.join(FORMATS)}, got {format!r}.")
    entry = FORMATS[format]
    return entry.load()(model, path, **entry.options)
