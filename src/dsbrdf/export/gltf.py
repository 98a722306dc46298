"""glTF 2.0: a sphere of the nearest material, with a camera and lamps, as `.gltf` or `.glb`.

The material is metallic-roughness with KHR_materials_specular, _ior and _clearcoat; programs without these extensions
show its diffuse base, or its metal. Lamps are those of KHR_lights_punctual.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.baselines.engine import EngineMaterial, Form
from dsbrdf.export.preview import Nearness, fit_preview
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORM", "gltf_material", "write_glb", "write_gltf"]

FORM = Form("facet", "free")
#: Segments of the sphere along a meridian and around.
SEGMENTS = (32, 64)
#: Lamps: direction toward them (x to the right, y up, z to the camera) and illuminance in lux, for a camera that shows
#: radiance 1 as white.
LAMPS = (((-0.5, 0.6, 0.7), 2.5), ((0.8, 0.2, 0.5), 1.0), ((0.3, 0.7, -0.6), 1.5))
#: Greatest F0 of a refractive index, which is then 99.
MAX_F0 = 0.96
#: A coat below this share is none.
LEAST_COAT = 0.002
FLOAT, UNSIGNED_SHORT, ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 5126, 5123, 34962, 34963


def write_gltf(model: DSBRDF, path: str | Path) -> str:
    """Write a sphere of the nearest material as JSON with the mesh in it.

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
    content, binary, lost = _content(model)
    data = base64.b64encode(binary).decode()
    content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    with _files.aside(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return lost


def write_glb(model: DSBRDF, path: str | Path) -> str:
    """Write the same in binary form; see `write_gltf`."""
    content, binary, lost = _content(model)
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    with _files.aside(path) as part:
        part.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return lost


def gltf_material(material: EngineMaterial, near: Nearness) -> dict[str, Any]:
    """The entry of a material in a file."""
    factors: dict[str, Any] = {
        "baseColorFactor": [*_numbers(material.f0 if material.metal else material.base_color), 1.0],
        "metallicFactor": float(material.metal),
        "roughnessFactor": round(material.roughness, 5),
    }
    extensions: dict[str, Any] = {}
    if not material.metal:
        # F0 is the index's, times a colour, times the share that is F90
        specular = float(material.f90.max())
        color = material.f0 / max(specular, 1e-6)
        index = max(float(color.max()), 0.02)
        root = math.sqrt(min(index, MAX_F0))
        extensions["KHR_materials_ior"] = {"ior": round((1.0 + root) / (1.0 - root), 5)}
        extensions["KHR_materials_specular"] = {
            "specularFactor": round(specular, 5),
            "specularColorFactor": _numbers(np.minimum(color / root**2, 1.0)),
        }
    if material.coat > LEAST_COAT:
        extensions["KHR_materials_clearcoat"] = {
            "clearcoatFactor": round(material.coat, 5),
            "clearcoatRoughnessFactor": round(material.coat_roughness, 5),
        }
    entry: dict[str, Any] = {
        "name": material.name or "material",
        "pbrMetallicRoughness": factors,
        "extras": {"dsbrdf": near.numbers()},
    }
    return entry | ({"extensions": extensions} if extensions else {})


def _content(model: DSBRDF) -> tuple[dict[str, Any], bytes, str]:
    """JSON, buffer, and what is lost."""
    material, near = fit_preview(model, FORM)
    entry = gltf_material(material, near)
    points, faces = _sphere()
    vertices, indices = points.astype("<f4").tobytes(), faces.astype("<u2").tobytes()
    binary = vertices + vertices + indices + bytes(-len(indices) % 4)
    sizes = (len(vertices), len(vertices), len(indices))
    lamps = [_lamp(direction) for direction, _ in LAMPS]
    used = ["KHR_lights_punctual", *entry.get("extensions", {})]
    content = {
        "asset": {"version": "2.0", "generator": "dsbrdf"},
        "extensionsUsed": used,
        "extensions": {
            "KHR_lights_punctual": {
                "lights": [
                    {"type": "directional", "color": [1.0, 1.0, 1.0], "intensity": i} for _, i in LAMPS
                ]
            }
        },
        "scene": 0,
        "scenes": [{"nodes": list(range(2 + len(lamps)))}],
        "nodes": [
            {"name": "sphere", "mesh": 0},
            {"name": "camera", "camera": 0, "translation": [0.0, 0.0, 5.4]},
            *(
                {"name": f"lamp {i}", "rotation": lamp, "extensions": {"KHR_lights_punctual": {"light": i}}}
                for i, lamp in enumerate(lamps)
            ),
        ],
        "cameras": [
            {
                "type": "perspective",
                "perspective": {"yfov": math.radians(26.0), "aspectRatio": 1.0, "znear": 0.1, "zfar": 100.0},
            }
        ],
        "meshes": [
            {
                "name": "sphere",
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0, "mode": 4}
                ],
            }
        ],
        "materials": [entry],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": FLOAT,
                "count": len(points),
                "type": "VEC3",
                "min": points.min(0).tolist(),
                "max": points.max(0).tolist(),
            },
            {"bufferView": 1, "componentType": FLOAT, "count": len(points), "type": "VEC3"},
            {"bufferView": 2, "componentType": UNSIGNED_SHORT, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {
                "buffer": 0,
                "byteOffset": sum(sizes[:i]),
                "byteLength": size,
                "target": ELEMENT_ARRAY_BUFFER if i == 2 else ARRAY_BUFFER,
            }
            for i, size in enumerate(sizes)
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    return content, binary, near.sentence("the glTF material")


def _sphere() -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    """Points (n, 3) of a unit sphere, y up, which are also its normals, and triangles (m, 3)."""
    n_theta, n_phi = SEGMENTS
    theta = np.linspace(0.0, np.pi, n_theta + 1)[:, None]
    phi = np.linspace(0.0, 2.0 * np.pi, n_phi + 1)
    xyz = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi))
    points = np.stack(xyz, axis=-1).reshape(-1, 3).astype(np.float32).astype(float)
    corner = np.arange(n_theta)[:, None] * (n_phi + 1) + np.arange(n_phi)
    below = corner + n_phi + 1
    upper = np.stack([corner, below + 1, corner + 1], axis=-1)[1:]
    lower = np.stack([corner, below, below + 1], axis=-1)[:-1]
    return points, np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])


def _lamp(toward: tuple[float, float, float]) -> list[float]:
    """Quaternion (x, y, z, w) that turns a lamp, which shines along -z, so that its light comes from a direction."""
    x, y, z = np.array(toward) / np.linalg.norm(toward)
    # The half turn, halved: from +z to the direction
    quaternion = np.array([-y, x, 0.0, 1.0 + z])
    return [round(float(q), 6) for q in quaternion / np.linalg.norm(quaternion)]


def _numbers(values: NDArray[np.float64]) -> list[float]:
    return [round(float(value), 5) for value in values]
