"""Models as files for other programs: `export` writes one of `FORMATS`.

A format is one entry here and a function `(model, path)` in a module of its own, imported when it is used. Some hold
the model itself: a table (`rgl`, `merl`) or code. The others hold the nearest material of a program, fitted within what
the program can show (`preview`, and `dsbrdf.baselines.engine`). `colour` turns channels into red, green and blue;
`text` is how a material's name gets into a file.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dsbrdf import _files

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORMATS", "Format", "export"]


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    suffix : str
        What a file's name ends in by default, no two alike.
    description : str
        Which program takes the file, and how.
    writer : str
        ``module:function`` in this package.
    options : dict
        Keywords the function gets.
    exact : bool
        The file holds the model, not the nearest material of a program.

    Examples
    --------
    >>> from dsbrdf.export import FORMATS
    >>> sorted(FORMATS)[:3]
    ['blender', 'brdf', 'glb']
    """

    suffix: str
    description: str
    writer: str
    options: dict[str, Any] = field(default_factory=dict)
    exact: bool = True

    def load(self) -> Callable[..., str | None]:
        """Import the function that writes."""
        module, function = self.writer.split(":")
        writer: Callable[..., str | None] = getattr(importlib.import_module(f"{__name__}.{module}"), function)
        return writer


FORMATS = {
    "rgl": Format(
        "bsdf", "Mitsuba 3, RGB variants: <bsdf type='measured'>. The model, tabulated", "rgl:write_rgl"
    ),
    "rgl-spectral": Format(
        "spectral.bsdf",
        "pbrt-v4, Material 'measured'; Mitsuba 3, spectral variants. The model, tabulated",
        "rgl:write_rgl",
        {"form": "spectral"},
    ),
    "merl": Format(
        "merl.binary", "BRDF viewers and research code: a MERL table, 35 MB", "merl:write_merl_table"
    ),
    "glsl": Format(
        "glsl", "OpenGL, WebGL, Vulkan, Shadertoy: the model as code", "code:write_code", {"language": "glsl"}
    ),
    "wgsl": Format("wgsl", "WebGPU: the model as code", "code:write_code", {"language": "wgsl"}),
    "hlsl": Format(
        "hlsl", "Direct3D, Unity, Unreal: the model as code", "code:write_code", {"language": "hlsl"}
    ),
    "slang": Format(
        "slang",
        "Slang, Falcor, with derivatives: the model as code",
        "code:write_code",
        {"language": "slang"},
    ),
    "brdf": Format("brdf", "Disney BRDF Explorer: the model as code", "brdf_explorer:write_brdf_explorer"),
    "gltf": Format(
        "gltf",
        "three.js, Babylon.js, viewers of Windows and macOS, Unreal, Godot: a sphere of the nearest material",
        "gltf:write_gltf",
        exact=False,
    ),
    "glb": Format("glb", "the same in one binary file", "gltf:write_glb", exact=False),
    "openpbr": Format(
        "mtlx",
        "Arnold, Karma, RenderMan, Maya, 3ds Max: the nearest OpenPBR material, in MaterialX",
        "openpbr:write_openpbr",
        exact=False,
    ),
    "usd": Format(
        "usda",
        "usdview, Omniverse, Houdini: a sphere of the nearest UsdPreviewSurface",
        "usd:write_usd",
        exact=False,
    ),
    "blender": Format(
        "blender.py",
        "Blender, 'blender --python FILE': the nearest material of shader nodes, on a sphere",
        "blender:write_blender",
        exact=False,
    ),
    "principled": Format(
        "principled.json",
        "Mitsuba 3, mitsuba.load_dict (or a scene, if the name ends in .xml): the nearest 'principled'",
        "principled:write_principled",
        exact=False,
    ),
}


def export(
    model: DSBRDF,
    path: str | Path,
    format: str,
    *,
    channels: Sequence[str] | None = None,
    force: bool = False,
) -> str | None:
    """Write a model as a file for another program.

    Parameters
    ----------
    model : DSBRDF
        Of any channels. One becomes grey, and wavelengths become colours (CIE 1931, D65) where the program has no
        more than red, green and blue.
    path : str or Path
    format : str
        One of `FORMATS`.
    channels : sequence of str, optional
        Those to take, in this order; all by default.
    force : bool, optional
        Replace a file that `dsbrdf` did not write, or that cannot say so, as MERL files.

    Returns
    -------
    str or None
        A sentence on what the file lost, of a format that cannot hold the model.

    Raises
    ------
    ValueError
        If there is no such format, or it cannot hold such a model; says what to do.
    FileExistsError
        If the file may not be replaced: it is the measurement that the model was fitted to, or see `force`.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> from dsbrdf.export import export
    >>> model = dsbrdf.library.load("delrin")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lost = export(model, pathlib.Path(folder, "matte.gltf"), "gltf")
    """
    if format not in FORMATS:
        raise ValueError(f"'format' must be one of {', '.join(FORMATS)}, got {format!r}.")
    from dsbrdf import _check
    from dsbrdf.model.dsbrdf import DSBRDF

    _check.instance(model, DSBRDF, "model")
    entry = FORMATS[format]
    _files.check_replaceable(path, force=force, source_sha256=model.source.to_json().get("sha256"))
    if channels is not None:
        from dsbrdf.export.colour import take_channels

        model = take_channels(model, channels)
    return entry.load()(model, path, **entry.options)
