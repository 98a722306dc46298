"""Sampling and its density, chi-square; directional albedo."""

import chi2
import numpy as np
import pytest
from scipy import stats
from tables import built_in, lobes, quiet_fit

from dsbrdf import DSBRDF
from dsbrdf.measured import built_in as materials
from dsbrdf.model import sampling

# Kinds of material: kappa, gamma, beta of lobes, which rise with theta_d and differ between channels
KINDS = {
    "matte": lobes([0.12, 0.02], [0.05, 2.0], [0.0, 0.5]),
    "glossy-plastic": lobes([2.0, 0.15], [300.0, 0.3], [0.3, -0.2]),
    "metal": lobes([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3]),
    "near-mirror": lobes([5.0, 0.5], [2e4, 300.0], [0.0, 0.0]),
}
KINDS["spike"] = KINDS["glossy-plastic"].replace(spike=np.full((6, 3), 400.0) * [1.0, 2.0, 0.5])
THETA_O = np.deg2rad([0.0, 30.0, 60.0, 80.0])
CASES = [(name, theta_o) for name in KINDS for theta_o in THETA_O]
IDS = [f"{name}-{np.rad2deg(theta_o):.0f}" for name, theta_o in CASES]
N_SAMPLES = 100_000
SIGNIFICANCE = chi2.sidak(0.01, len(CASES))


def single(kappa, gamma):
    """One lobe, one channel, the same for all theta_d."""
    return DSBRDF(np.array([0.4, 1.0]), *(np.full((2, 1, 1), x) for x in (kappa, gamma, 0.0)))


def lambert(albedo):
    return single(np.log1p(albedo / np.pi), 0.0)


def toward(theta):
    return np.array([np.sin(theta), 0.0, np.cos(theta)])


def draw(model, wo, rng, n=N_SAMPLES):
    return model.sample(np.broadcast_to(wo, (n, 3)), rng)


def weights(model, wi, wo):
    """`f cos / pdf` (n, channel), zero below the horizon."""
    result = np.zeros((len(wi), model.n_channels))
    above = wi[:, 2] > 0.0
    cos_i = wi[above, 2, None]
    result[above] = model.eval(wi[above], wo) * cos_i / model.pdf(wi[above], wo)[:, None]
    return result


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_samples_follow_the_density(name, theta_o, rng):
    model, wo = KINDS[name], toward(theta_o)
    mass = chi2.cell_integrals(lambda wi: model.pdf(wi, wo), toward(-theta_o))
    samples = draw(model, wo, rng)
    assert chi2.p_value(samples, mass) > SIGNIFICANCE
    # What the density lacks is what falls below the horizon
    below = int((samples[:, 2] <= 0.0).sum())
    lost = 1.0 - mass.sum()
    assert -1e-3 < lost < 0.65
    assert stats.binomtest(below, len(samples), np.clip(lost, 1e-9, 1.0)).pvalue > SIGNIFICANCE


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_weights_are_bounded_and_their_mean_is_the_albedo(name, theta_o, rng):
    model, wo = KINDS[name], toward(theta_o)
    weight = weights(model, draw(model, wo, rng), wo)
    albedo = model.albedo(theta_o)
    error = (weight.mean(0) - albedo) / (weight.std(0) / np.sqrt(len(weight)))
    # The channels share their samples
    assert np.abs(error).max() < stats.norm.isf(0.5 * SIGNIFICANCE)
    assert (weight.max(0) < 12.0 * albedo).all()


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_albedo_equals_quadrature_over_directions(name, theta_o):
    model, wo = KINDS[name], toward(theta_o)
    channel = 1
    # A spike has a kink at one degree
    tolerance = 5e-5 if name == "spike" else 1e-6
    cells = chi2.cell_integrals(
        lambda wi: model.eval(wi, wo)[..., channel] * wi[..., 2], toward(-theta_o), tolerance
    )
    np.testing.assert_allclose(model.albedo(theta_o)[channel], cells.sum(), rtol=1e-3)


@pytest.mark.parametrize("rho", [1.0, 0.5, 1e-3])
def test_albedo_of_lambert(rho):
    """A white surface in a white furnace cannot be seen."""
    theta_i = np.deg2rad([0.0, 10.0, 45.0, 60.0, 75.0, 89.0, 90.0])
    np.testing.assert_allclose(lambert(rho).albedo(theta_i)[:, 0], rho, rtol=1e-3)


def test_white_furnace_by_samples(rng):
    model = lambert(1.0)
    for theta_o in THETA_O:
        weight = weights(model, draw(model, toward(theta_o), rng), toward(theta_o))[:, 0]
        assert abs(weight.mean() - 1.0) < 4.5 * weight.std() / np.sqrt(len(weight))


@pytest.mark.parametrize(("kappa", "gamma"), [(3.0, 1e4), (8.0, 1e6), (1e-6, 1e5)])
def test_albedo_of_a_spike(kappa, gamma):
    """Far narrower than anything around it: the integral over the half vector leaves the cosines behind."""
    theta_i = np.deg2rad([0.0, 30.0, 60.0])
    t = np.linspace(0.0, 1.0, 200_001)[1:]  # u^gamma; du = t^(1 / gamma - 1) dt / gamma
    integral = np.trapezoid(np.expm1(kappa * t) / t * t ** (1.0 / gamma), t) / gamma
    expected = 2.0 * np.pi * integral * 4.0 * np.cos(theta_i) ** 2
    np.testing.assert_allclose(single(kappa, gamma).albedo(theta_i)[:, 0], expected, rtol=2e-3)


@pytest.mark.parametrize("name", ["matte", "glossy-plastic", "rough-gold"])
def test_albedo_of_a_fit_is_that_of_the_material(name):
    """What energy the material conserves, the model of it does too, to the error of the fit."""
    model = quiet_fit(built_in(name), 3).model
    reflectance = materials.get(name).reflectance
    for theta_o in THETA_O[:3]:
        wo = toward(theta_o)
        cells = chi2.cell_integrals(
            lambda wi, wo=wo: reflectance(wi, wo)[..., 0] * wi[..., 2], toward(-theta_o)
        )
        albedo = model.albedo(theta_o)[0]
        assert albedo == pytest.approx(cells.sum(), rel=0.1)
        assert albedo < 1.02


def test_albedo_shapes():
    model = KINDS["metal"]
    assert model.albedo(0.3).shape == (3,)
    assert model.albedo([[0.1, 0.2]]).shape == (1, 2, 3)
    np.testing.assert_array_equal(model.albedo([0.2, 0.4])[1], model.albedo(0.4))
    with pytest.raises(ValueError, match=r"'theta_i' must lie in \[0, pi/2\] radians, got 30.*deg2rad"):
        model.albedo(30.0)


def test_density_is_zero_below_the_horizon(rng):
    model = KINDS["metal"]
    up, down = np.array([0.6, 0.0, 0.8]), np.array([0.6, 0.0, -0.8])
    assert model.pdf(down, up) == 0.0
    assert model.pdf(up, down) == 0.0
    assert model.pdf([1.0, 0.0, 0.0], up) == 0.0
    samples = draw(model, toward(1.4), rng, 1000)
    assert ((model.pdf(samples, toward(1.4)) > 0.0) == (samples[:, 2] > 0.0)).all()


def test_shapes_of_samples(rng):
    model = KINDS["glossy-plastic"]
    wo = np.broadcast_to(toward(0.5), (4, 5, 3))
    samples = model.sample(wo, rng)
    assert samples.shape == (4, 5, 3)
    np.testing.assert_allclose(np.linalg.norm(samples, axis=-1), 1.0, rtol=1e-12)
    assert model.pdf(samples, wo[0]).shape == (4, 5)
    assert model.sample([0.0, 0.0, 1.0], rng).shape == (3,)
    with pytest.raises(ValueError, match=r"'wo' must be unit vectors"):
        model.sample([0.0, 0.0, 2.0], rng)


def test_same_generator_same_samples():
    model, wo = KINDS["metal"], np.broadcast_to(toward(0.5), (50, 3))
    one, two, other = (model.sample(wo, np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, two)
    assert (one != other).all()


def test_share_of_cosine_keeps_the_density_from_zero(rng):
    """Where no lobe of the sampler reaches, light still counts."""
    model, wo = single(9.0, 1e6), toward(1.0)
    wi = chi2.direction(rng.random(1000), 2.0 * np.pi * rng.random(1000))
    least = sampling.COSINE_SHARE * wi[:, 2] / np.pi
    assert (least > 0.01 * wi[:, 2]).all()
    assert (model.pdf(wi, wo) >= least * (1.0 - 1e-12)).all()


def test_samples_come_from_the_nearest_slice(rng):
    """Narrow at the first slice, flat at the second."""
    shape = (2, 1, 1)
    gamma = np.array([1e4, 0.0]).reshape(shape)
    model = DSBRDF(np.array([0.2, 1.2]), np.full(shape, 3.0), gamma, np.zeros(shape))
    for theta_o, share in ((0.1, 0.9), (0.65, 0.9), (0.75, 0.0), (1.3, 0.0)):
        samples = draw(model, toward(theta_o), rng, 2000)
        near_mirror = samples @ toward(-theta_o) > np.cos(0.05)
        assert abs(near_mirror.mean() - share) < 0.04


def test_samples_of_a_spike_fall_in_proportion_to_its_cap(rng):
    model = single(1e-9, 0.0).replace(spike=np.full((2, 1), 10.0))
    wo = toward(0.3)
    half = draw(model, wo, rng, 50_000) + wo
    share = (half[:, :2] ** 2).sum(-1) / (half**2).sum(-1) / np.sin(np.deg2rad(1.0)) ** 2
    inside = share[share < 1.0]
    assert abs(len(inside) / len(share) - (1.0 - sampling.COSINE_SHARE)) < 0.01
    assert stats.kstest(inside, lambda t: 1.0 - (1.0 - t) ** 2).pvalue > SIGNIFICANCE


# The harness


def test_chi_square_tells_right_from_wrong(rng):
    def cosine(wi):
        return wi[..., 2] / np.pi

    radius = np.sqrt(rng.random(50_000))
    right = chi2.direction(np.sqrt(1.0 - radius**2), 2.0 * np.pi * rng.random(50_000))
    wrong = chi2.direction(rng.random(50_000), 2.0 * np.pi * rng.random(50_000))
    mass = chi2.cell_integrals(cosine, toward(0.0))
    np.testing.assert_allclose(mass.sum(), 1.0, rtol=1e-6)
    assert chi2.p_value(right, mass) > 1e-3
    assert chi2.p_value(wrong, mass) < 1e-12
    for factor in (0.97, 1.03):
        assert chi2.p_value(right, factor * mass) < 1e-6
    turned = right @ [[1.0, 0.0, 0.0], [0.0, np.cos(0.1), np.sin(0.1)], [0.0, -np.sin(0.1), np.cos(0.1)]]
    assert chi2.p_value(turned, mass) < 1e-6


def test_chi_square_is_uniform_under_the_null():
    mass = chi2.cell_integrals(lambda wi: 0.8 * wi[..., 2] / np.pi, toward(0.0), cells=(5, 6))
    rng = np.random.default_rng(11)
    p_values = []
    for _ in range(300):
        z = np.sqrt(rng.random(2000)) * np.where(rng.random(2000) < 0.8, 1.0, -1.0)
        samples = np.stack([np.sqrt(1.0 - z**2), z, z], axis=-1)
        phi = 2.0 * np.pi * rng.random(2000)
        samples[:, 0], samples[:, 1] = samples[:, 0] * np.cos(phi), samples[:, 0] * np.sin(phi)
        p_values.append(chi2.p_value(samples, mass))
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
