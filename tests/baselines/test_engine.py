"""Materials of engines: their formulas, the energy they keep, and that the fit finds them."""

import dataclasses

import numpy as np
import pytest
from pairs import hemisphere

from dsbrdf.baselines import engine
from dsbrdf.baselines.engine import EngineMaterial, Form
from dsbrdf.measured import reflectance

FORMS = {
    "glTF": Form("facet", "free"),
    "OpenPBR": Form("albedo", "tint", engine.FREE_F0),
    "nodes": Form("normal", "free", engine.FREE_F0),
    "USD": Form("facet", "one", engine.FREE_F0),
}
BLUE = EngineMaterial(
    np.array([0.05, 0.1, 0.4]),
    np.array([0.03, 0.04, 0.05]),
    np.full(3, 0.5),
    0.3,
    0.2,
    engine.COAT_F0,
    0.6,
    False,
    FORMS["glTF"],
)


def material(form, **changes):
    f90 = {"free": np.full(3, 0.5), "tint": np.array([0.6, 0.5, 0.8]), "one": np.ones(3)}[form.grazing]
    f0 = 0.1 * f90 if form.grazing == "tint" else BLUE.f0
    return dataclasses.replace(BLUE, form=form, f0=f0, f90=f90, **changes)


def test_gltf_is_the_specification():
    """A pair worked out by hand from glTF 2.0, KHR_materials_specular and _clearcoat: mirror at 60 degrees.

    Masking is correlated, as all viewers have it; Appendix B names the product of two.
    """
    cos, rise, alpha2 = 0.5, 0.5**5, 0.3**4
    wi, wo = np.array([0.75**0.5, 0.0, cos]), np.array([-(0.75**0.5), 0.0, cos])

    def lobe(alpha2):
        return 1.0 / (np.pi * alpha2) / (4.0 * cos * np.sqrt(alpha2 + (1.0 - alpha2) * cos**2))

    fresnel = BLUE.f0 + (0.5 - BLUE.f0) * rise
    base = (1.0 - fresnel.max()) * BLUE.base_color / np.pi + fresnel * lobe(alpha2)
    coat = 0.2 * (0.04 + 0.96 * rise)
    expected = (1.0 - coat) * base + coat * lobe(0.6**4)
    np.testing.assert_allclose(BLUE.eval(wi, wo), expected, rtol=1e-12)


def test_lobes_are_those_of_the_reflectances(rng):
    wi, wo = hemisphere(rng, 200), hemisphere(rng, 200)
    expected = reflectance.ggx(wi, wo, 0.2)[:, 0]
    np.testing.assert_allclose(engine.ggx(engine.Pairs.of(wi, wo), 0.2), expected, rtol=1e-9)


@pytest.mark.parametrize("alpha", [0.01, 0.2, 0.7])
@pytest.mark.parametrize("cosine", [0.1, 0.5, 1.0])
def test_directional_albedo(alpha, cosine):
    """Against sums over half vectors."""
    nodes = (np.arange(400) + 0.5) / 400
    theta, phi = 0.5 * np.pi * nodes[:, None] ** 3, 2.0 * np.pi * nodes[::4]
    half = np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    solid = (np.sin(theta) * 1.5 * np.pi * nodes[:, None] ** 2 / 400 * 2.0 * np.pi / 100) * np.ones_like(phi)
    wo = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    cos_d = half @ wo
    wi = 2.0 * cos_d[..., None] * half - wo
    lit = (cos_d > 0.0) & (wi[..., 2] > 0.0)
    value = engine.ggx(engine.Pairs.of(wi[lit], np.broadcast_to(wo, wi.shape)[lit]), alpha)
    weight = value * wi[lit][:, 2] * 4.0 * cos_d[lit] * solid[lit]
    rising = (1.0 - cos_d[lit]) ** 5
    found = [float(x[0, 0]) for x in engine.directional_albedo(np.array([cosine]), alpha)]
    np.testing.assert_allclose(found, [(weight * (1.0 - rising)).sum(), (weight * rising).sum()], atol=0.01)


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("cosine", [0.2, 0.6, 1.0])
def test_energy_is_kept(rng, name, cosine):
    """A white base under everything that can be: no more than comes in, seen from any side."""
    ones = np.ones(3)
    white = material(FORMS[name], base_color=ones, coat=1.0, roughness=0.5)
    wo = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    wi = hemisphere(rng, 40_000)
    albedo = 2.0 * np.pi * (white.eval(wi, wo) * wi[:, 2:]).mean(0)
    assert albedo.max() < 1.02


@pytest.mark.parametrize("name", FORMS)
def test_the_fit_finds_a_material_of_its_form(name):
    form = FORMS[name]
    truth = material(form)
    found = engine.fit_engine(truth, form, "it")
    assert engine.cbrt_error(found, truth) < 0.005
    np.testing.assert_allclose(found.base_color, truth.base_color, atol=0.01)
    np.testing.assert_allclose(found.roughness, truth.roughness, atol=0.03)
    assert found.name == "it"
    assert not found.metal


def test_a_metal_is_found():
    gold = dataclasses.replace(
        BLUE, base_color=np.zeros(3), f0=np.array([0.9, 0.6, 0.2]), f90=np.ones(3), coat=0.0, metal=True
    )
    found = engine.fit_engine(gold, FORMS["glTF"])
    assert found.metal
    np.testing.assert_allclose(found.f0, gold.f0, atol=0.01)
    assert found.n_parameters == 6


def test_nothing_comes_of_nothing():
    class Black:
        def eval(self, wi, wo):
            return np.zeros(np.broadcast_shapes(np.shape(wi), np.shape(wo)))

    found = engine.fit_engine(Black(), FORMS["glTF"])
    up = np.array([0.0, 0.0, 1.0])
    assert np.isfinite(found.eval(up, up)).all()
    assert engine.cbrt_error(found, Black()) == 0.0
