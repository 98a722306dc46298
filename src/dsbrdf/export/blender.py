"""Blender: a Python script that makes the nearest material of shader nodes, and a sphere of it where nothing is.

Not the Principled BSDF: there the Fresnel factor rises to one whatever F0 is, which few measured materials do. A
diffuse and two glossy nodes have colours of their own; their Fresnel factors follow the angle to the normal.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dsbrdf import _files
from dsbrdf.baselines.engine import FREE_F0, Form
from dsbrdf.export import text
from dsbrdf.export.preview import fit_preview
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORM", "write_blender"]

FORM = Form("normal", "free", FREE_F0)

SCRIPT = """# {title}
#
# Written by dsbrdf. In Blender (3.6 or later): Scripting, Open, Run Script; or
#
#     blender --python FILE                  opens Blender with a sphere of the material
#     blender -b --python FILE -- OUT.blend  writes it to a file
#
# Makes the material, gives it to the active object, or to a new sphere, and prints its name.
import json
import sys

import bpy

DATA = json.loads({data})


def make(data):
    material = bpy.data.materials.new(data["name"])
    material.use_nodes = True
    material["dsbrdf"] = json.dumps(data["nearness"])
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()

    def node(kind, x, y, **values):
        made = nodes.new(kind)
        made.location = (200 * x, -180 * y)
        for name, value in values.items():
            setattr(made, name, value)
        return made

    def math(operation, x, y, first, second, third=0.0):
        made = node("ShaderNodeMath", x, y, operation=operation)
        for socket, value in zip(made.inputs, (first, second, third)):
            if isinstance(value, float):
                socket.default_value = value
            else:
                links.new(value, socket)
        return made.outputs[0]

    def mix(x, y, factor, first, second):
        made = node("ShaderNodeMix", x, y, data_type="RGBA")
        sockets = {{socket.identifier: socket for socket in made.inputs}}
        links.new(factor, sockets["Factor_Float"])
        sockets["A_Color"].default_value = (*first, 1.0)
        sockets["B_Color"].default_value = (*second, 1.0)
        return next(socket for socket in made.outputs if socket.identifier == "Result_Color")

    def glossy(x, y, roughness):
        made = node("ShaderNodeBsdfAnisotropic", x, y, distribution="GGX")
        made.inputs["Roughness"].default_value = roughness
        return made

    # Schlick's term of the angle to the normal
    facing = node("ShaderNodeLayerWeight", 0, 0)
    facing.inputs["Blend"].default_value = 0.5
    rising = math("POWER", 1, 0, facing.outputs["Facing"], 5.0)

    # The base: a glossy layer, and what it leaves to the diffuse one
    f0, f90 = data["f0"], data["f90"]
    gloss = glossy(4, 0, data["roughness"])
    links.new(mix(3, 0, rising, f0, f90), gloss.inputs["Color"])
    strongest = math("MULTIPLY_ADD", 2, 1, rising, max(f90) - max(f0), max(f0))
    diffuse = node("ShaderNodeBsdfDiffuse", 4, 1)
    links.new(mix(3, 1, strongest, data["base_color"], (0.0, 0.0, 0.0)), diffuse.inputs["Color"])
    base = node("ShaderNodeAddShader", 5, 0)
    links.new(gloss.outputs[0], base.inputs[0])
    links.new(diffuse.outputs[0], base.inputs[1])

    # The coat
    coat, coat_f0 = data["coat"], data["coat_f0"]
    share = math("MULTIPLY_ADD", 3, 2, rising, coat * (1.0 - coat_f0), coat * coat_f0)
    clear = glossy(5, 2, data["coat_roughness"])
    clear.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    coated = node("ShaderNodeMixShader", 6, 0)
    links.new(share, coated.inputs[0])
    links.new(base.outputs[0], coated.inputs[1])
    links.new(clear.outputs[0], coated.inputs[2])
    links.new(coated.outputs[0], node("ShaderNodeOutputMaterial", 7, 0).inputs["Surface"])
    return material


material = make(DATA)
target = bpy.context.view_layer.objects.active
if target is None or getattr(target.data, "materials", None) is None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    target = bpy.context.view_layer.objects.active
target.data.materials.clear()
target.data.materials.append(material)
print("material:", material.name)
if "--" in sys.argv and sys.argv[-1].endswith(".blend"):
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
"""


def write_blender(model: DSBRDF, path: str | Path) -> str:
    """Write the script.

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

    def rounded(values: Any) -> list[float]:
        return [round(float(value), 5) for value in values]

    data = {
        "name": text.comment(model.name)[:60] or "material",
        "base_color": rounded(material.base_color),
        "f0": rounded(material.f0),
        "f90": rounded(material.f90),
        "roughness": round(material.roughness, 5),
        "coat": round(material.coat, 5),
        "coat_f0": round(material.coat_f0, 5),
        "coat_roughness": round(material.coat_roughness, 5),
        "nearness": near.numbers(),
    }
    # Of ASCII, so that nothing in a name ends the literal
    script = SCRIPT.format(title=text.comment(model.name) or "material", data=repr(json.dumps(data)))
    with _files.aside(path) as part:
        part.write_text(script, encoding="utf-8")
    return near.sentence("the node material")
