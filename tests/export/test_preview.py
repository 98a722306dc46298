"""The nearest materials of programs: the files hold what was fitted, and are read by what can be installed."""

import json
import struct
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from by_hand import by_hand
from mitsuba_tools import VARIANT, interaction, vectors

from dsbrdf.baselines import engine
from dsbrdf.export import gltf, openpbr, preview, principled
from dsbrdf.export.principled import NAMES

PARAMETERS = [
    np.array([0.2, 0.5, 0.7, 0.3, 0.35, 0.6, 0.8, 0.3]),
    np.array([0.9, 0.6, 0.1, 1.0, 0.1, 0.01, 0.0, 1.0]),
    np.array([0.1, 0.1, 0.1, 0.0, 0.8, 1.0, 1.0, 0.0]),
]
#: Dark blue under a bright narrow highlight: what a preview with F0 = 0.04 makes a dark metal of.
PHENOLIC = by_hand([2.5, 0.03], [300.0, 0.1], [0.0, 0.0], tint=(1.0, 1.0, 1.0), name="phenolic")
PHENOLIC = PHENOLIC.replace(
    lobes=PHENOLIC.lobes.replace(
        colour=np.stack([np.zeros((3, 1)), np.log([0.1, 0.4, 1.0])[:, None]], axis=1)
    )
)


@pytest.mark.parametrize("x", PARAMETERS, ids=["mixed", "metal", "rough dielectric"])
def test_principled_is_mitsubas(x):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant(VARIANT)
    parameters = dict(zip(NAMES, x[3:].tolist(), strict=True))
    bsdf = mi.load_dict(
        {"type": "principled", "base_color": {"type": "rgb", "value": x[:3].tolist()}, **parameters}
    )
    at, _ = engine.pairs()
    stock = np.array(bsdf.eval(mi.BSDFContext(), interaction(at.wi), vectors(at.wo))).T / at.wo[:, 2:]
    np.testing.assert_allclose(principled.principled(x, at), stock, rtol=2e-3, atol=1e-6)


def test_principled_files(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    lost = principled.write_principled(PHENOLIC, tmp_path / "x.json")
    assert lost.startswith("the principled material is the nearest of its kind: error of the cube root")
    content = json.loads((tmp_path / "x.json").read_text())
    mi.load_dict(content)
    red, green, blue = content["base_color"]["value"]
    assert blue > green > red
    principled.write_principled(PHENOLIC, tmp_path / "x.xml")
    mi.load_file(str(tmp_path / "x.xml"))
    values = {
        child.attrib["name"]: child.attrib["value"]
        for child in ET.parse(tmp_path / "x.xml").iter()
        if "name" in child.attrib
    }
    assert values["base_color"] == ", ".join(map(str, content["base_color"]["value"]))
    assert all(float(values[name]) == content[name] for name in NAMES)


@pytest.fixture(scope="module")
def blue():
    """`PHENOLIC` as the glTF material."""
    return preview.fit_preview(PHENOLIC, gltf.FORM)


def test_blue_plastic_stays_blue(blue):
    material, near = blue
    w = np.array([-0.6, 0.0, 0.8])
    np.testing.assert_allclose(material.eval(w, w), PHENOLIC.eval(w, w), rtol=0.25)
    assert material.base_color[2] > 2.0 * material.base_color[1] > 4.0 * material.base_color[0]
    assert near.ciede2000 < 6.0
    assert near.error_cbrt < 0.2


def as_the_viewer_has_it(entry):
    """The material that a program makes of a glTF entry, by the extensions' specifications."""
    factors, extensions = entry["pbrMetallicRoughness"], entry.get("extensions", {})
    base, metal = np.array(factors["baseColorFactor"][:3]), factors["metallicFactor"] == 1.0
    specular = extensions.get("KHR_materials_specular", {})
    index = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
    strength = specular.get("specularFactor", 1.0)
    f0 = np.minimum(
        ((index - 1.0) / (index + 1.0)) ** 2 * np.array(specular.get("specularColorFactor", [1.0] * 3)), 1.0
    )
    coat = extensions.get("KHR_materials_clearcoat", {})
    return engine.EngineMaterial(
        0.0 * base if metal else base,
        base if metal else f0 * strength,
        np.full(3, 1.0 if metal else strength),
        factors["roughnessFactor"],
        coat.get("clearcoatFactor", 0.0),
        engine.COAT_F0,
        coat.get("clearcoatRoughnessFactor", 0.0),
        metal,
        gltf.FORM,
    )


METAL = engine.EngineMaterial(
    np.zeros(3),
    np.array([0.9, 0.6, 0.2]),
    np.ones(3),
    0.4,
    0.001,
    engine.COAT_F0,
    0.3,
    True,
    gltf.FORM,
    "metal",
)


def test_a_gltf_entry_means_what_was_fitted(blue):
    material, near = blue
    at, _ = engine.pairs()
    for fitted in (material, METAL):
        found = as_the_viewer_has_it(gltf.gltf_material(fitted, near))
        np.testing.assert_allclose(found.eval(at.wi, at.wo), fitted.eval(at.wi, at.wo), rtol=0.05, atol=1e-4)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gltf")
    gltf.write_gltf(PHENOLIC, folder / "x.gltf")
    gltf.write_glb(PHENOLIC, folder / "x.glb")
    return folder


def test_glb_is_gltf(files):
    text = json.loads((files / "x.gltf").read_text())
    data = (files / "x.glb").read_bytes()
    magic, version, length, n_json, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    content = json.loads(data[20 : 20 + n_json])
    n_binary, kind = struct.unpack_from("<I4s", data, 20 + n_json)
    assert (n_binary, kind) == (content["buffers"][0]["byteLength"], b"BIN\0")
    assert 28 + n_json + n_binary == len(data)
    del text["buffers"][0]["uri"]
    assert content == text


def test_the_sphere_is_one(files):
    """Closed, of outward triangles, all of one size of radius."""
    data = (files / "x.glb").read_bytes()
    n_json = struct.unpack_from("<I", data, 12)[0]
    content, binary = json.loads(data[20 : 20 + n_json]), data[28 + n_json :]
    views = content["bufferViews"]
    points = np.frombuffer(binary, "<f4", views[0]["byteLength"] // 4).reshape(-1, 3)
    faces = np.frombuffer(binary, "<u2", views[2]["byteLength"] // 2, views[2]["byteOffset"]).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-6)
    a, b, c = (points[faces[:, i]].astype(float) for i in range(3))
    normal = np.cross(b - a, c - a)
    assert ((normal * (a + b + c)).sum(1) > 0.0).all()
    assert 0.5 * np.linalg.norm(normal, axis=1).sum() == pytest.approx(4.0 * np.pi, rel=0.01)


def test_refractive_indices():
    np.testing.assert_allclose([openpbr.ior(x) for x in (0.0, 0.04, 0.25)], [1.0, 1.5, 3.0], atol=1e-4)
