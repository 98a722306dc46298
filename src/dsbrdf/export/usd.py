"""USD: a sphere with a `UsdPreviewSurface`, as text (`.usda`): usdview, Omniverse, Houdini, Apple's previews."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.baselines.engine import FREE_F0, Form
from dsbrdf.export import text
from dsbrdf.export.openpbr import ior
from dsbrdf.export.preview import fit_preview
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORM", "write_usd"]

FORM = Form("facet", "one", FREE_F0)

SCENE = """#usda 1.0
(
    defaultPrim = "World"
    doc = {doc}
    metersPerUnit = 1
    upAxis = "Y"
    customLayerData = {{
        dictionary dsbrdf = {{
            double error_cbrt = {error_cbrt}
            double ciede2000 = {ciede2000}
        }}
    }}
)

def Xform "World"
{{
    def Sphere "Sphere" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        double radius = 1
        float3[] extent = [(-1, -1, -1), (1, 1, 1)]
        rel material:binding = </World/{name}>
    }}

    def DistantLight "Lamp"
    {{
        float inputs:angle = 1
        float inputs:intensity = 2.5
        float3 xformOp:rotateXYZ = (-40, -35, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }}

    def Camera "Camera"
    {{
        float focalLength = 50
        float horizontalAperture = 24
        float verticalAperture = 24
        double3 xformOp:translate = (0, 0, 5.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def Material "{name}"
    {{
        token outputs:surface.connect = </World/{name}/Preview.outputs:surface>

        def Shader "Preview"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = {diffuse}
            int inputs:useSpecularWorkflow = 1
            color3f inputs:specularColor = {specular}
            float inputs:roughness = {roughness}
            float inputs:clearcoat = {coat}
            float inputs:clearcoatRoughness = {coat_roughness}
            float inputs:ior = {ior}
            token outputs:surface
        }}
    }}
}}
"""


def write_usd(model: DSBRDF, path: str | Path) -> str:
    """Write a sphere of the nearest preview surface, with a lamp and a camera.

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
    content = SCENE.format(
        doc=text.quoted(f"{model.name}, written by dsbrdf"),
        name=text.identifier(model.name),
        diffuse=_colour(material.base_color),
        specular=_colour(material.f0),
        roughness=round(material.roughness, 5),
        coat=round(material.coat, 5),
        coat_roughness=round(material.coat_roughness, 5),
        ior=ior(material.coat_f0),
        **near.numbers(),
    )
    with _files.aside(path) as part:
        part.write_text(content, encoding="utf-8")
    return near.sentence("the preview surface")


def _colour(values: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in values) + ")"
