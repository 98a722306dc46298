"""Sampling and its density, chi-square, noise against cosine sampling; directional albedo."""

import chi2
import numpy as np
import pytest
from by_hand import by_hand
from scipy import stats

from dsbrdf.measured import built_in as materials
from dsbrdf.model import sampling

# Kinds of material: kappa, gamma, beta of lobes, which rise with theta_d and differ between channels
KINDS = {
    "matte": by_hand([0.12, 0.02], [0.05, 2.0], [0.0, 0.5]),
    "glossy-plastic": by_hand([2.0, 0.15], [300.0, 0.3], [0.3, -0.2]),
    "metal": by_hand([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3]),
    "near-mirror": by_hand([5.0, 0.5], [2e4, 300.0], [0.0, 0.0]),
}
KINDS["falloff"] = KINDS["metal"].replace(lobes=KINDS["metal"].lobes.replace(falloff=[[3.0], [-0.5]]))
KINDS["narrowing"] = KINDS["metal"].replace(
    lobes=KINDS["metal"].lobes.replace(gamma=np.log([[6.0, 300.0, 40.0, 90.0], [2.0, 2.0, 8.0, 30.0]]))
)
THETA_O = np.deg2rad([0.0, 30.0, 60.0, 80.0])
CASES = [(name, theta_o) for name in KINDS for theta_o in THETA_O]
IDS = [f"{name}-{np.rad2deg(theta_o):.0f}" for name, theta_o in CASES]
N_SAMPLES = 100_000
SIGNIFICANCE = chi2.sidak(0.01, len(CASES))


def single(kappa, gamma):
    """One lobe, the same for all theta_d and channels."""
    return by_hand([kappa], [gamma], [0.0], rise=0.0, tint=(1.0, 1.0, 1.0))


def lambert(albedo):
    return single(np.log1p(albedo / np.pi), 1e-9)


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
    assert -1e-3 < lost < 0.05
    assert stats.binomtest(below, len(samples), np.clip(lost, 1e-9, 1.0)).pvalue > SIGNIFICANCE


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_mean_weight_is_the_albedo(name, theta_o, rng):
    model, wo = KINDS[name], toward(theta_o)
    weight = weights(model, draw(model, wo, rng), wo)
    albedo = model.albedo(theta_o)
    error = np.abs(weight.mean(0) - albedo) - 2e-4 * albedo
    # The channels share their samples
    assert (error < stats.norm.isf(0.5 * SIGNIFICANCE) * weight.std(0) / np.sqrt(len(weight))).all()
    assert (weight.max(0) < 12.0 * albedo).all()


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_samples_are_quiet(name, theta_o, rng):
    """Weights deviate far less than with cosine sampling, and on what is nearly Lambertian no more."""
    model, wo = KINDS[name], toward(theta_o)
    weight = weights(model, draw(model, wo, rng), wo).mean(-1)
    wi = chi2.direction(np.sqrt(rng.random(N_SAMPLES)), 2.0 * np.pi * rng.random(N_SAMPLES))
    of_cosine = np.pi * model.eval(wi, wo).mean(-1)
    ours, theirs = (x.std() / x.mean() for x in (weight, of_cosine))
    assert ours < (theirs + 0.02 if name == "matte" else 0.35 * theirs)


@pytest.mark.parametrize(("name", "theta_o"), CASES, ids=IDS)
def test_albedo_equals_quadrature_over_directions(name, theta_o):
    model, wo = KINDS[name], toward(theta_o)
    channel = 1
    cells = chi2.cell_integrals(
        lambda wi: model.eval(wi, wo)[..., channel] * wi[..., 2], toward(-theta_o), 1e-6
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
        assert abs(weight.mean() - 1.0) < 4.5 * weight.std() / np.sqrt(len(weight)) + 1e-6
        assert weight.std() < 0.03


@pytest.mark.parametrize(("kappa", "gamma"), [(3.0, 1e4), (6.0, 1e6), (1e-6, 1e5)])
def test_albedo_of_a_narrow_lobe(kappa, gamma):
    """Far narrower than anything around it: the integral over the half vector leaves the cosines behind."""
    theta_i = np.deg2rad([0.0, 30.0, 60.0])
    t = np.linspace(0.0, 1.0, 200_001)[1:]  # u^gamma; du = t^(1 / gamma - 1) dt / gamma
    integral = np.trapezoid(np.expm1(kappa * t) / t * t ** (1.0 / gamma), t) / gamma
    expected = 2.0 * np.pi * integral * 4.0 * np.cos(theta_i) ** 2
    np.testing.assert_allclose(single(kappa, gamma).albedo(theta_i)[:, 0], expected, rtol=2e-3)


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
    assert model.pdf(samples[0, 0], wo[0, 0]).shape == ()
    with pytest.raises(ValueError, match=r"'wo' must be unit vectors"):
        model.sample([0.0, 0.0, 2.0], rng)


def test_same_generator_same_samples():
    model, wo = KINDS["metal"], np.broadcast_to(toward(0.5), (50, 3))
    one, two, other = (model.sample(wo, np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, two)
    assert (one != other).all()


def test_share_of_cosine_keeps_the_density_from_zero(rng):
    """Where no power of the sampler reaches, light still counts."""
    model, wo = single(6.0, 1e6), toward(1.0)
    wi = chi2.direction(rng.random(1000), 2.0 * np.pi * rng.random(1000))
    least = sampling.MIN_COSINE_SHARE * wi[:, 2] / np.pi
    assert (model.pdf(wi, wo) >= least * (1.0 - 1e-12)).all()


def test_tables_are_shares():
    made = sampling.tables(KINDS["narrowing"].lobes)
    assert made.shares.shape == (sampling.N_ROWS, len(sampling.POWERS))
    assert (made.shares >= 0.0).all()
    assert (made.cosine >= sampling.MIN_COSINE_SHARE * (1.0 - 1e-9)).all()
    # Alias tables hold the same shares
    for row in range(sampling.N_ROWS):
        found = {}
        for stay, here, there in made.alias[row]:
            found[here] = found.get(here, 0.0) + stay / len(made.alias[row])
            found[there] = found.get(there, 0.0) + (1.0 - stay) / len(made.alias[row])
        expected = np.append(made.shares[row], made.cosine[row])
        got = [found[exponent] for exponent in (*(sampling.POWERS + 2.0), sampling.COSINE)]
        np.testing.assert_allclose(got, expected, atol=1e-12)


def test_tables_are_made_once(monkeypatch):
    model = single(1.0, 20.0)
    made = sampling.tables(model.lobes)
    monkeypatch.setattr(sampling, "tables_for", None)
    assert sampling.tables(model.lobes) is made


@pytest.mark.parametrize("name", materials.names())
def test_tables_of_any_reflectance(name):
    """What no lobes describe is sampled as well, e.g. tables: the shares fit it, not lobes of it."""
    reflectance = materials.get(name).reflectance
    made = sampling.tables_for(reflectance)
    assert made.shares.shape == (sampling.N_ROWS, len(sampling.POWERS))
    np.testing.assert_allclose(made.shares.sum(1) + made.cosine, 1.0)
    if name == "matte":
        assert made.cosine[0] > 0.5
    if name == "polished-chrome":
        assert made.cosine[0] < 0.06


def test_parameters_of_other_libraries():
    """Arrays of JAX are sampled where they have values; where they have none, what to do is said."""
    jax = pytest.importorskip("jax")
    model, wi, wo = KINDS["metal"], toward(0.3), toward(0.5)
    traced = model.replace(lobes=model.lobes.replace(scale=jax.numpy.asarray(model.lobes.scale)))
    np.testing.assert_allclose(traced.pdf(wi, wo), model.pdf(wi, wo), rtol=1e-4)
    samples = draw(traced, wo, np.random.default_rng(0), 100)
    assert (traced.pdf(samples, wo) > 0.0).all()

    def at(scale, call):
        return call(model.replace(lobes=model.lobes.replace(scale=scale)))

    for call in (lambda m: m.pdf(wi, wo), lambda m: m.sample(wo, np.random.default_rng(0)).sum()):
        with pytest.raises(TypeError, match=r"needs the values of the parameters, .* detached tensors"):
            jax.grad(at)(traced.lobes.scale, call)


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
