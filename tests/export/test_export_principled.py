"""Previews: the formulas are those of the programs, the fit finds them, and the error is told."""

import json

import numpy as np
import pytest
from by_hand import by_hand
from mitsuba_tools import VARIANT, interaction, vectors

import dsbrdf
from dsbrdf.export import preview
from dsbrdf.export.preview import write_gltf, write_principled

PARAMETERS = [
    np.array([0.2, 0.5, 0.7, 0.3, 0.35, 0.6]),
    np.array([0.9, 0.6, 0.1, 1.0, 0.1, 0.01]),
    np.array([0.1, 0.1, 0.1, 0.0, 0.8, 1.0]),
]


def plugin(x):
    return {
        "type": "principled",
        "base_color": {"type": "rgb", "value": x[:3].tolist()},
        "metallic": float(x[3]),
        "roughness": float(x[4]),
        "specular": float(x[5]),
    }


@pytest.mark.parametrize("x", PARAMETERS, ids=["mixed", "metal", "rough dielectric"])
def test_principled_is_mitsubas(x):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant(VARIANT)
    bsdf = mi.load_dict(plugin(x))
    wi, wo = preview._pairs()
    stock = np.array(bsdf.eval(mi.BSDFContext(), interaction(wi), vectors(wo))).T / wo[:, 2:]
    np.testing.assert_allclose(preview.principled(x, wi, wo), stock, rtol=1e-3, atol=1e-6)


def test_gltf_is_the_specification():
    """A pair worked out by hand from Appendix B: normal incidence and mirror at 60 degrees."""
    x = np.array([0.8, 0.4, 0.2, 0.25, 0.5])
    alpha2 = 0.5**4
    up = np.array([[0.0, 0.0, 1.0]])
    lobe = 1.0 / (np.pi * alpha2) / 4.0
    expected = 0.75 * (0.96 * x[:3] / np.pi + 0.04 * lobe) + 0.25 * x[:3] * lobe
    np.testing.assert_allclose(preview.gltf(x, up, up)[0], expected)

    sin, cos = np.sin(np.deg2rad(60.0)), 0.5
    wi, wo = np.array([[sin, 0.0, cos]]), np.array([[-sin, 0.0, cos]])
    visibility = 1.0 / (cos + np.sqrt(alpha2 + (1.0 - alpha2) * cos**2)) ** 2
    lobe = visibility / (np.pi * alpha2)
    rise = 0.5**5
    dielectric = 0.04 + 0.96 * rise
    metal = x[:3] + (1.0 - x[:3]) * rise
    expected = 0.75 * ((1.0 - dielectric) * x[:3] / np.pi + dielectric * lobe) + 0.25 * metal * lobe
    np.testing.assert_allclose(preview.gltf(x, wi, wo)[0], expected)


@pytest.mark.parametrize(("material", "size"), [(preview.principled, 6), (preview.gltf, 5)])
def test_the_fit_finds_a_material_of_its_kind(material, size):
    x = np.array([0.2, 0.5, 0.7, 0.2, 0.4, 0.6])[:size]

    class Model:
        n_channels = 3

        def eval(self, wi, wo):
            return material(x, wi, wo)

        def albedo(self, _):
            return np.full(3, 0.4)

    found, loss = preview._fit(Model(), material, size, "it")
    np.testing.assert_allclose(found, x, atol=0.02)
    assert loss == "it is a preview: relative RMS of f cos cos 0 %, of its cube root 0 %."


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_files(tmp_path):
    model = dsbrdf.fit(dsbrdf.material("rough-gold"), 2).model
    loss = write_principled(model, tmp_path / "x.json")
    content = json.loads((tmp_path / "x.json").read_text())
    assert content["type"] == "principled"
    assert content["metallic"] > 0.5
    assert content["roughness"] == pytest.approx(np.sqrt(0.3), abs=0.05)
    red, green, blue = content["base_color"]["value"]
    assert red > green > blue
    assert loss.startswith("a principled material is a preview: relative RMS of f cos cos ")
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    mi.load_dict(content)

    write_gltf(model, tmp_path / "x.gltf")
    content = json.loads((tmp_path / "x.gltf").read_text())
    assert content["asset"]["version"] == "2.0"
    (material,) = content["materials"]
    factors = material["pbrMetallicRoughness"]
    assert len(factors["baseColorFactor"]) == 4
    assert 0.0 <= factors["roughnessFactor"] <= 1.0


def test_a_material_of_another_kind_loses_more(tmp_path):
    """Two lobes of very different width in one."""
    model = by_hand([3.0, 0.6], [3000.0, 15.0], [0.0, 0.0])
    loss = write_gltf(model, tmp_path / "x.gltf")
    assert int(loss.split("cos cos ")[1].split(" %")[0]) > 20
