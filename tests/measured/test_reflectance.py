"""Reflectances: reference values, limits, invariants, energy by quadrature, and the switches."""

from functools import lru_cache, partial

import numpy as np
import pytest

from dsbrdf.measured.reflectance import (
    coated,
    fresnel_conductor,
    fresnel_dielectric,
    ggx,
    lambert,
    oren_nayar,
)

GOLD_GREEN = 0.428 + 2.46j
UP = np.array([0.0, 0.0, 1.0])
TWO_LOBES = partial(coated, UP, UP, 0.5, eta=1.5, alpha=(0.1, 0.2))
REFLECTANCES = {
    "lambert": partial(lambert, albedo=(0.2, 0.5, 0.9)),
    "oren_nayar": partial(oren_nayar, albedo=(0.2, 0.5, 0.9), sigma=0.6),
    "ggx": partial(ggx, alpha=0.3),
    "ggx, wider than 1": partial(ggx, alpha=3.0),
    "ggx, conductor": partial(ggx, alpha=0.05, fresnel=(GOLD_GREEN, 3.0 + 3.3j)),
    "ggx, dielectric": partial(ggx, alpha=0.2, fresnel=1.5),
    "ggx, no masking": partial(ggx, alpha=0.2, masking=False),
    "ggx, no foreshortening": partial(ggx, alpha=0.2, foreshortening=False),
    "ggx, neither": partial(ggx, alpha=0.2, masking=False, foreshortening=False),
    "coated": partial(coated, albedo=(0.1, 0.9), eta=1.5, alpha=(0.05, 0.4), weights=(0.3, 0.7), sigma=0.3),
    "coated, no fresnel": partial(coated, albedo=0.5, eta=1.5, alpha=0.1, fresnel=False),
    "coated, no coupling": partial(coated, albedo=0.5, eta=1.5, alpha=0.1, coupling=False),
}


@pytest.fixture(params=REFLECTANCES.values(), ids=REFLECTANCES.keys())
def reflectance(request):
    return request.param


def direction(theta, phi=0.0):
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def random_directions(n, seed):
    rng = np.random.default_rng(seed)
    return direction(np.arccos(rng.uniform(0.0, 1.0, n)), rng.uniform(0.0, 2.0 * np.pi, n))


@lru_cache
def hemisphere(n_theta=200, n_phi=64, power=3):
    """Directions of half the hemisphere (y > 0), denser near the pole, with twice their solid angles."""
    node, weight = np.polynomial.legendre.leggauss(n_theta)
    u = 0.5 * (node + 1.0)
    theta = 0.5 * np.pi * u**power
    d_theta = 0.25 * np.pi * weight * power * u ** (power - 1)
    phi = (np.arange(n_phi) + 0.5) * np.pi / n_phi
    solid_angle = np.sin(theta) * d_theta * 2.0 * np.pi / n_phi
    return direction(theta[:, None], phi), solid_angle[:, None]


def albedo_of(f, theta_i):
    """Directional albedo by quadrature over the half vector, with d(wo) = 4 (wi . h) dh."""
    wi = direction(theta_i)
    h, solid_angle = hemisphere()
    cos_d = h @ wi
    wo = 2.0 * cos_d[..., None] * h - wi
    weight = 4.0 * np.maximum(cos_d, 0.0) * np.maximum(wo[..., 2], 0.0) * solid_angle
    return np.einsum("tpc,tp->c", f(wi, wo), weight)


# Fresnel


@pytest.mark.parametrize("index", [GOLD_GREEN, 1.32 + 7.307j, 3.18 + 3.33j, 0.05 + 4.0j])
def test_conductor_at_normal_incidence_and_by_the_complex_equations(index):
    n, k = index.real, index.imag
    at_normal = ((n - 1.0) ** 2 + k**2) / ((n + 1.0) ** 2 + k**2)
    assert fresnel_conductor(1.0, index) == pytest.approx(at_normal, rel=1e-13)
    cos = np.linspace(0.0, 1.0, 101)
    inside = np.sqrt(index**2 - (1.0 - cos**2))
    across = np.abs((cos - inside) / (cos + inside)) ** 2
    along = np.abs((index**2 * cos - inside) / (index**2 * cos + inside)) ** 2
    np.testing.assert_allclose(fresnel_conductor(cos, index), 0.5 * (across + along), rtol=1e-12)


@pytest.mark.parametrize("eta", [1.1, 1.5, 2.4])
def test_dielectric_at_normal_incidence_and_at_brewsters_angle(eta):
    assert fresnel_dielectric(1.0, eta) == pytest.approx(((eta - 1.0) / (eta + 1.0)) ** 2, rel=1e-13)
    # Nothing of the parallel part, so half of the perpendicular part alone
    expected = 0.5 * ((eta**2 - 1.0) / (eta**2 + 1.0)) ** 2
    assert fresnel_dielectric(np.cos(np.arctan(eta)), eta) == pytest.approx(expected, rel=1e-13)


def test_fresnel_is_one_at_grazing():
    assert fresnel_dielectric(0.0, 1.5) == 1.0
    assert fresnel_conductor(0.0, GOLD_GREEN) == pytest.approx(1.0, abs=1e-15)


# GGX


def test_ggx_agrees_with_the_textbook_form_in_angles():
    alpha, wi, wo = 0.25, random_directions(500, 1), random_directions(500, 2)
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
    tan_sq = 1.0 / h[:, 2] ** 2 - 1.0
    distribution = alpha**2 / (np.pi * h[:, 2] ** 4 * (alpha**2 + tan_sq) ** 2)
    big_lambda = [0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 / w[:, 2] ** 2 - 1.0)) - 1.0) for w in (wi, wo)]
    masking = 1.0 / (1.0 + big_lambda[0] + big_lambda[1])
    fresnel = fresnel_conductor(np.minimum(np.sum(wi * h, axis=-1), 1.0), GOLD_GREEN)
    expected = fresnel * distribution * masking / (4.0 * wi[:, 2] * wo[:, 2])
    np.testing.assert_allclose(ggx(wi, wo, alpha, fresnel=GOLD_GREEN)[:, 0], expected, rtol=1e-10)


@pytest.mark.parametrize("alpha", [0.01, 0.1, 0.5, 1.0])
def test_facet_areas_project_to_the_surface(alpha):
    # wi = wo leaves D / 4, whose projected area over the hemisphere is that of the mean surface
    h, solid_angle = hemisphere(n_phi=1)
    value = 4.0 * ggx(h, h, alpha, masking=False, foreshortening=False)[..., 0]
    assert np.sum(value * h[..., 2] * solid_angle) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("alpha", [0.1, 0.4])
@pytest.mark.parametrize("theta", np.deg2rad([20.0, 60.0, 80.0]))
def test_masking_leaves_the_projected_area_that_is_seen(alpha, theta):
    # Smith: G1(w) times the integral of D max(0, w . m) is cos(theta); toward the normal nothing is shadowed
    m, solid_angle = hemisphere(n_phi=200)
    distribution = 4.0 * ggx(m, m, alpha, masking=False, foreshortening=False)[..., 0]
    w = direction(theta)
    projected = np.sum(distribution * np.maximum(m @ w, 0.0) * solid_angle)
    masked = ggx(w, UP, alpha) / ggx(w, UP, alpha, masking=False)
    assert masked[0] == pytest.approx(np.cos(theta) / projected, rel=1e-5)


@pytest.mark.parametrize(("alpha", "least"), [(0.02, 0.998), (0.1, 0.96), (0.4, 0.75), (1.0, 0.3)])
@pytest.mark.parametrize("theta", np.deg2rad([0.0, 30.0, 60.0]))
def test_white_furnace_of_a_lossless_surface(alpha, least, theta):
    assert least < albedo_of(partial(ggx, alpha=alpha), theta)[0] < 1.0


def test_without_masking_and_foreshortening_nothing_varies_with_phi_d():
    theta_h, theta_d, phi_d = 0.4, 0.5, np.linspace(0.0, np.pi, 50)
    d = direction(theta_d, phi_d)
    cos, sin = np.cos(theta_h), np.sin(theta_h)
    tilt = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    wi, wo = d @ tilt, (d * [-1.0, -1.0, 1.0]) @ tilt
    f = partial(ggx, wi, wo, 0.3, fresnel=GOLD_GREEN)
    bare = f(masking=False, foreshortening=False)
    assert np.ptp(bare) < 1e-13 * bare.max()
    for switches in ({}, {"masking": False}, {"foreshortening": False}):
        assert np.ptp(f(**switches)) > 0.01 * bare.max()


def test_masking_and_foreshortening_are_separate_factors():
    wi, wo = random_directions(200, 3), random_directions(200, 4)
    whole, none = ggx(wi, wo, 0.3), ggx(wi, wo, 0.3, masking=False, foreshortening=False)
    one, other = ggx(wi, wo, 0.3, masking=False), ggx(wi, wo, 0.3, foreshortening=False)
    np.testing.assert_allclose(whole * none, one * other, rtol=1e-12)
    np.testing.assert_allclose((none / one)[:, 0], wi[:, 2] * wo[:, 2], rtol=1e-12)
    assert np.all(other <= none)


def test_grazing_is_the_limit_from_above():
    wo = direction(0.7, 2.0)
    at, near = (ggx(wi, wo, 0.2)[0] for wi in ([1.0, 0.0, 0.0], direction(np.pi / 2 - 1e-8)))
    assert at == pytest.approx(near, rel=1e-6)
    assert at > 0.0


# Diffuse and coated


def test_oren_nayar_without_roughness_is_lambert():
    wi, wo = random_directions(200, 5), random_directions(200, 6)
    np.testing.assert_array_equal(oren_nayar(wi, wo, (0.3, 0.6), 0.0), lambert(wi, wo, (0.3, 0.6)))
    np.testing.assert_allclose(lambert(wi, wo, 0.3), 0.3 / np.pi, rtol=1e-15)


def test_oren_nayar_agrees_with_the_published_form_in_angles():
    rng = np.random.default_rng(7)
    theta_i, theta_o = rng.uniform(0.0, 1.5, (2, 300))
    phi = rng.uniform(0.0, 2.0 * np.pi, 300)
    sigma_sq = 0.5**2
    a, b = 1.0 - 0.5 * sigma_sq / (sigma_sq + 0.33), 0.45 * sigma_sq / (sigma_sq + 0.09)
    larger, smaller = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
    expected = (a + b * np.maximum(np.cos(phi), 0.0) * np.sin(larger) * np.tan(smaller)) / np.pi
    got = oren_nayar(direction(theta_i), direction(theta_o, phi), 1.0, 0.5)[:, 0]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


@pytest.mark.parametrize("eta", [1.3, 1.5, 2.0])
def test_mean_fresnel_agrees_with_the_closed_form(eta):
    # Walsh's integral, as in Duntley, J. Opt. Soc. Am. 32, 61 (1942); only the mean is unknown in the base
    n, m = eta, eta**2 + 1.0
    expected = (
        0.5
        + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) ** 2)
        + n**2 * (n**2 - 1.0) ** 2 / m**3 * np.log((n - 1.0) / (n + 1.0))
        - 2.0 * n**3 * (n**2 + 2.0 * n - 1.0) / (m * (n**4 - 1.0))
        + 8.0 * n**4 * (n**4 + 1.0) / (m * (n**4 - 1.0) ** 2) * np.log(n)
    )
    base = coated(UP, UP, 1.0, eta=eta, alpha=0.1, weights=0.0)[0]
    through = (1.0 - fresnel_dielectric(1.0, eta)) ** 2
    assert 1.0 - through / (np.pi * base) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("theta", np.deg2rad([0.0, 50.0, 80.0]))
def test_a_white_base_gives_back_what_the_coat_lets_in(theta):
    base = partial(coated, albedo=1.0, eta=1.5, alpha=0.1, weights=0.0)
    let_in = 1.0 - fresnel_dielectric(np.cos(theta), 1.5)
    assert albedo_of(base, theta)[0] == pytest.approx(let_in, rel=1e-3)
    assert albedo_of(partial(base, fresnel=False), theta)[0] == pytest.approx(0.96, rel=1e-3)


@pytest.mark.parametrize("alpha", [0.06, 0.2, 0.6])
@pytest.mark.parametrize("theta", np.deg2rad([0.0, 45.0, 70.0, 85.0]))
def test_a_coated_white_base_gains_no_energy(alpha, theta):
    # A rough coat reflects a little more than a smooth one near 45 degrees
    assert albedo_of(partial(coated, albedo=1.0, eta=1.5, alpha=alpha), theta)[0] < 1.0 + 1e-3


def test_coated_is_the_sum_of_its_parts():
    wi, wo = random_directions(100, 8), random_directions(100, 9)
    albedo = (0.2, 0.4, 0.6)
    got = coated(wi, wo, albedo, eta=1.5, alpha=(0.1, 0.4), weights=(0.25, 0.75), sigma=0.3, coupling=False)
    lobes = 0.25 * ggx(wi, wo, 0.1, fresnel=1.5) + 0.75 * ggx(wi, wo, 0.4, fresnel=1.5)
    np.testing.assert_allclose(got, lobes + oren_nayar(wi, wo, albedo, 0.3), rtol=1e-13)


def test_without_fresnel_a_coat_reflects_as_at_normal_incidence():
    wi, wo = random_directions(100, 10), random_directions(100, 11)
    got = coated(wi, wo, 0.0, eta=1.5, alpha=0.2, fresnel=False)
    np.testing.assert_allclose(got, 0.04 * ggx(wi, wo, 0.2), rtol=1e-13)


# Invariants of all of them


def test_reciprocal_to_the_last_bit(reflectance):
    wi, wo = random_directions(2000, 12), random_directions(2000, 13)
    np.testing.assert_array_equal(reflectance(wi, wo), reflectance(wo, wi))


def test_finite_and_non_negative_everywhere(reflectance):
    horizon = direction(np.pi / 2, np.linspace(0.0, 2.0 * np.pi, 9))
    exact = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    near = direction(np.pi / 2 - np.logspace(-14, -2, 5), 0.3)
    w = np.concatenate([UP[None], exact, horizon, near, random_directions(100, 14)])
    value = reflectance(w[:, None], w[None, :])
    assert np.all(np.isfinite(value))
    assert np.all(value >= 0.0)
    assert np.all(np.diagonal(value)[:, 20:] > 0.0)


def test_zero_below_the_horizon(reflectance):
    above, below = direction(0.5), direction(np.pi / 2 + 0.01, 1.0)
    value = reflectance([above, below, below], [below, above, below])
    np.testing.assert_array_equal(value, 0.0)


def test_isotropic_and_mirror_symmetric(reflectance):
    wi, wo = random_directions(200, 15), random_directions(200, 16)
    value = reflectance(wi, wo)
    for turn in np.random.default_rng(17).uniform(0.0, 2.0 * np.pi, 5):
        cos, sin = np.cos(turn), np.sin(turn)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(reflectance(wi @ rotation, wo @ rotation), value, rtol=1e-10)
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(reflectance(wi * mirror, wo * mirror), value)


def test_leading_axes_broadcast_and_the_channel_is_last(reflectance):
    wi, wo = random_directions(4, 18), random_directions(5, 19)
    value = reflectance(wi[:, None], wo)
    assert value.shape == (4, 5, value.shape[-1])
    np.testing.assert_array_equal(value[2, 3], reflectance(wi[2], wo[3]))
    assert value.dtype == np.float64


# Errors


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lambert(2.0 * UP, UP, 0.5), r"'wi' must be unit vectors on the last axis, got norm 2"),
        (lambda: lambert(UP, [0.0, 1.0], 0.5), r"'wo' must have x, y, z on its last axis"),
        (
            lambda: lambert(UP, UP, (0.5, 1.2)),
            r"'albedo' must be >= 0 and <= 1 and finite, got 1.2 at index 1",
        ),
        (lambda: oren_nayar(UP, UP, 0.5, -0.1), r"'sigma' must be >= 0 .* got -0.1"),
        (lambda: ggx(UP, UP, 0.0), r"'alpha' must be >= 0.0001 .* got 0"),
        (lambda: ggx(UP, UP, 0.1, fresnel=0.9), r"'eta' must be > 1 and finite, got 0.9"),
        (lambda: ggx(UP, UP, 0.1, fresnel=1.5 + 0j), r"'k of n \+ ik' must be > 0 and finite, got 0"),
        (lambda: fresnel_conductor(1.5, GOLD_GREEN), r"'cos_theta' must be >= 0 and <= 1"),
        (TWO_LOBES, r"'weights' must be one share for each of 2 lobes, .* got \[1.0\]"),
        (
            partial(TWO_LOBES, weights=(0.6, 0.6)),
            r"'weights' must be .* a sum of 1 at most, got \[0.6, 0.6\]",
        ),
    ],
)
def test_an_argument_out_of_range_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
