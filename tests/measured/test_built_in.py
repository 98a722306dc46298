"""The catalogue of built-in materials."""

import dataclasses
import pickle
from functools import lru_cache

import numpy as np
import pytest

from dsbrdf.measured import built_in

# Rows (wavelength in nm, n, k) on either side of 611, 549 and 464 nm, as published.
TABLES = {
    "GOLD": [
        (450.9, 1.38, 1.914),
        (471.4, 1.31, 1.849),
        (548.6, 0.43, 2.455),
        (582.1, 0.29, 2.863),
        (616.8, 0.21, 3.272),
    ],
    "COPPER": [
        (450.9, 1.24, 2.397),
        (471.4, 1.25, 2.483),
        (548.6, 1.02, 2.577),
        (582.1, 0.70, 2.704),
        (616.8, 0.30, 3.205),
    ],
    "ALUMINIUM": [
        (442.80, 0.60790, 5.3676),
        (476.87, 0.72780, 5.7781),
        (516.60, 0.87340, 6.2418),
        (563.57, 1.0728, 6.7839),
        (619.93, 1.3660, 7.4052),
    ],
    "CHROMIUM": [
        (451.0, 2.33, 3.14),
        (471.0, 2.51, 3.24),
        (549.0, 3.18, 3.33),
        (582.0, 3.22, 3.30),
        (617.0, 3.17, 3.30),
    ],
}


@pytest.fixture(params=built_in.names())
def material(request):
    return built_in.get(request.param)


def direction(theta, phi=0.0):
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def random_directions(n, seed):
    rng = np.random.default_rng(seed)
    return direction(np.arccos(rng.uniform(0.0, 1.0, n)), rng.uniform(0.0, 2.0 * np.pi, n))


@lru_cache
def half_vectors(n_theta=200, n_phi=64):
    """Directions of half the hemisphere (y > 0), denser near the pole, with twice their solid angles."""
    node, weight = np.polynomial.legendre.leggauss(n_theta)
    u = 0.5 * (node + 1.0)
    theta = 0.5 * np.pi * u**3
    solid_angle = np.sin(theta) * 0.75 * np.pi * u**2 * weight * 2.0 * np.pi / n_phi
    return direction(theta[:, None], (np.arange(n_phi) + 0.5) * np.pi / n_phi), solid_angle


def albedo_of(f, theta_i):
    """Directional albedo by quadrature over the half vector, with d(wo) = 4 (wi . h) dh."""
    h, solid_angle = half_vectors()
    wi = direction(theta_i)
    cos_d = h @ wi
    wo = 2.0 * cos_d[..., None] * h - wi
    cosines = 4.0 * np.maximum(cos_d, 0.0) * np.maximum(wo[..., 2], 0.0)
    return np.einsum("tpc,tp,t->c", f(wi, wo), cosines, solid_angle)


def test_names_are_the_catalogue():
    assert built_in.names() == (
        "rough-gold",
        "rough-copper",
        "satin-aluminium",
        "polished-chrome",
        "glossy-plastic",
        "satin-plastic",
        "matte",
        "paint-two-lobe",
        "grey-primer",
    )


def test_a_material_describes_itself_and_cannot_be_changed(material):
    assert material.name in built_in.names()
    assert material.description.endswith(".")
    assert material.source
    with pytest.raises(dataclasses.FrozenInstanceError):
        material.name = "other"


def test_a_material_survives_pickling(material):
    wi, wo = random_directions(2, 0)
    copy = pickle.loads(pickle.dumps(material))
    np.testing.assert_array_equal(copy.reflectance(wi, wo), material.reflectance(wi, wo))


@pytest.mark.parametrize(
    ("name", "closest"),
    [
        ("gold", "rough-gold"),
        ("chrome", "polished-chrome"),
        ("mate", "matte"),
        ("Satin Plastic", "satin-plastic"),
    ],
)
def test_an_unknown_name_suggests_the_closest(name, closest):
    expected = f"unknown built-in material '{name}': the built-in materials are rough-gold, .*grey-primer"
    with pytest.raises(ValueError, match=rf"{expected}\. Did you mean '{closest}'\?$"):
        built_in.get(name)


def test_an_unknown_name_unlike_any_lists_them_all():
    with pytest.raises(ValueError, match=r"'xyz': the built-in materials are rough-gold, .*, grey-primer\.$"):
        built_in.get("xyz")


def test_linear_rgb_reciprocal_non_negative_and_finite(material):
    grazing = direction(np.pi / 2, np.arange(4.0))
    w = np.concatenate([direction(np.array([0.0, 1.5, 1.57])), grazing, random_directions(100, 1)])
    value = material.reflectance(w[:, None], w)
    assert value.shape == (107, 107, 3)
    assert np.all(np.isfinite(value))
    assert np.all(value >= 0.0)
    np.testing.assert_array_equal(value, np.swapaxes(value, 0, 1))


def test_isotropic_and_mirror_symmetric(material):
    wi, wo = random_directions(100, 2), random_directions(100, 3)
    value = material.reflectance(wi, wo)
    turn = np.array([[np.cos(2.0), -np.sin(2.0), 0.0], [np.sin(2.0), np.cos(2.0), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(material.reflectance(wi @ turn.T, wo @ turn.T), value, rtol=1e-9)
    mirror = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_array_equal(material.reflectance(wi * mirror, wo * mirror), value)


@pytest.mark.parametrize("degrees", [0.0, 40.0, 60.0, 80.0, 88.0])
def test_no_energy_is_gained(material, degrees):
    albedo = albedo_of(material.reflectance, np.deg2rad(degrees))
    assert np.all(albedo < 1.0)
    assert np.all(albedo > 0.03)


@pytest.mark.parametrize("name", TABLES)
def test_refractive_indices_are_those_published(name):
    wavelength, n, k = np.array(TABLES[name]).T
    at = (611.0, 549.0, 464.0)
    expected = np.interp(at, wavelength, n) + 1j * np.interp(at, wavelength, k)
    np.testing.assert_allclose(getattr(built_in, name), expected, atol=1e-3)


def test_colours_are_plausible():
    red, green, blue = 0, 1, 2
    at_normal = {name: albedo_of(built_in.get(name).reflectance, 0.0) for name in built_in.names()}
    for metal in ("rough-gold", "rough-copper"):
        assert at_normal[metal][red] > 1.05 * at_normal[metal][green] > 1.1 * at_normal[metal][blue]
    assert at_normal["rough-gold"][green] > at_normal["rough-copper"][green]
    for grey, spread in (("satin-aluminium", 0.03), ("polished-chrome", 0.03), ("grey-primer", 0.06)):
        assert np.ptp(at_normal[grey]) < spread * at_normal[grey].max()
    for name, hue in (
        ("glossy-plastic", red),
        ("satin-plastic", blue),
        ("paint-two-lobe", green),
        ("matte", red),
    ):
        assert np.argmax(at_normal[name]) == hue
    assert at_normal["satin-aluminium"].min() > 0.85


def test_the_metals_go_from_rough_to_nearly_a_mirror():
    up = direction(0.0)
    peak = [built_in.get(name).reflectance(up, up).max() for name in built_in.names()[:4]]
    assert sorted(peak) == peak
    assert peak[0] < 1.0
    assert peak[3] > 40.0
