"""OpenPBR in a MaterialX document: Arnold, Karma, RenderMan, Unreal, Maya, 3ds Max, and what else reads `.mtlx`.

OpenPBR Surface 1.1 specification, Academy Software Foundation; MaterialX 1.39.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from dsbrdf import _files
from dsbrdf.baselines.engine import FREE_F0, EngineMaterial, Form
from dsbrdf.export import text
from dsbrdf.export.preview import fit_preview
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORM", "inputs", "ior", "write_openpbr"]

FORM = Form("albedo", "tint", FREE_F0)


def write_openpbr(model: DSBRDF, path: str | Path) -> str:
    """Write the nearest OpenPBR material as a MaterialX document of one material.

    Returns
    -------
    str
        What is lost.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.
    """
    material, near = fit_preview(model, FORM)
    name = text.identifier(model.name)
    lines = [
        '<?xml version="1.0"?>',
        '<materialx version="1.39" colorspace="lin_rec709">',
        f'  <open_pbr_surface name="{name}_surface" type="surfaceshader">',
        *(
            f'    <input name="{key}" type="{kind}" value="{value}" />'
            for key, kind, value in _typed(material)
        ),
        "  </open_pbr_surface>",
        f'  <surfacematerial name="{name}" type="material" doc={text.attribute(f"{model.name}, by dsbrdf")}',
        *(f'    dsbrdf_{key}="{value}"' for key, value in near.numbers().items()),
        "  >",
        f'    <input name="surfaceshader" type="surfaceshader" nodename="{name}_surface" />',
        "  </surfacematerial>",
        "</materialx>",
    ]
    with _files.aside(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return near.sentence("the OpenPBR material")


def inputs(material: EngineMaterial) -> Mapping[str, float | tuple[float, ...]]:
    """Inputs of `open_pbr_surface` that are not at their defaults; colours are linear, of Rec. 709 primaries."""
    metal = material.metal
    tint = tuple(round(float(x), 5) for x in material.f90)
    index = ior(float((material.f0 / material.f90.clip(1e-6)).max())) if not metal else 1.5
    return {
        "base_weight": 1.0,
        "base_color": tuple(round(float(x), 5) for x in (material.f0 if metal else material.base_color)),
        "base_metalness": float(metal),
        "specular_color": tint,
        "specular_roughness": round(material.roughness, 5),
        "specular_ior": index,
        "coat_weight": round(material.coat, 5),
        "coat_roughness": round(material.coat_roughness, 5),
        "coat_ior": ior(material.coat_f0),
        # The coat of the fit leaves the base's colour and highlight as they are
        "coat_darkening": 0.0,
    }


def ior(f0: float) -> float:
    """Refractive index of a reflectance at normal incidence."""
    root = math.sqrt(min(max(f0, 0.0), 0.96))
    return round((1.0 + root) / (1.0 - root), 5)


def _typed(material: EngineMaterial) -> list[tuple[str, str, str]]:
    """Name, type and value of each input, as MaterialX has them."""
    found = []
    for key, value in inputs(material).items():
        colour = isinstance(value, tuple)
        shown = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
        found.append((key, "color3" if colour else "float", shown))
    return found
