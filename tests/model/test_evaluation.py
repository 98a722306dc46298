"""Values of a model: kernel and twin against the formula, reciprocity to the last bit, arguments."""

import numpy as np
import pytest
from models import N_CHANNELS, N_LOBES, awkward_pairs, near, random_model, twin_eval, upper
from tables import formula

from dsbrdf import DSBRDF, half_diff


def by_angles(model, theta_h, theta_d, phi_d):
    """The model written out: slices by the formula, and linear between them."""
    slices = np.stack(
        [
            formula(theta_h, theta_d, phi_d, *parameters)
            for parameters in zip(model.kappa, model.gamma, model.beta, strict=True)
        ]
    )
    cap = np.maximum(1.0 - (np.sin(theta_h) / np.sin(np.deg2rad(1.0))) ** 2, 0.0)
    slices += model.spike[:, :, None] * cap
    result = np.empty((*theta_d.shape, model.n_channels))
    for at in np.ndindex(theta_d.shape):
        for channel in range(model.n_channels):
            result[at][channel] = np.interp(theta_d[at], model.theta_d, slices[:, channel, *at])
    return result


# The formula


def test_kernel_and_twin_equal_the_formula(rng):
    model = random_model()
    wi, wo = upper(rng, 4000), upper(rng, 4000)
    # A quarter of them within the spike
    wo[:1000] = near(wi[:1000] * [-1.0, -1.0, 1.0], rng, 0.01)
    expected = by_angles(model, *half_diff.from_directions(wi, wo))
    np.testing.assert_allclose(model.eval(wi, wo), expected, rtol=1e-9)
    np.testing.assert_allclose(twin_eval(model, wi, wo), expected, rtol=1e-9)


def test_kernel_equals_twin(rng):
    model = random_model()
    for wi, wo in ((upper(rng, 20_000), upper(rng, 20_000)), awkward_pairs(rng)):
        np.testing.assert_allclose(model.eval(wi, wo), twin_eval(model, wi, wo), rtol=1e-12, atol=1e-30)
    w = upper(rng, 20_000)
    narrow = model.replace(gamma=1e3 * model.gamma)
    mirror = near(w * [-1.0, -1.0, 1.0], rng, 1e-2)
    np.testing.assert_allclose(narrow.eval(w, mirror), twin_eval(narrow, w, mirror), rtol=1e-10, atol=1e-300)


def test_angles_are_those_of_the_directions(rng):
    model = random_model()
    theta_h, theta_d = rng.uniform(0.0, 0.7, 500), rng.uniform(0.0, 0.7, 500)
    phi_d = rng.uniform(0.0, 2.0 * np.pi, 500)
    expected = by_angles(model, theta_h, theta_d, phi_d)
    np.testing.assert_allclose(model.eval_angles(theta_h, theta_d, phi_d), expected, rtol=1e-9)
    assert model.eval_angles(0.1, [0.2, 0.3], 0.4).shape == (2, N_CHANNELS)
    np.testing.assert_array_equal(model.eval_angles(1.2, 1.2, 0.0), 0.0)
    with pytest.raises(ValueError, match=r"'theta_d' must lie in \[0, pi/2\] radians, got 20.*deg2rad"):
        model.eval_angles(0.1, 20.0, 0.0)


@pytest.mark.parametrize("gamma", [0.0, 1e-300, 1e-3, 1.0])
def test_half_vector_on_the_horizon(gamma):
    """cos(theta_h)^gamma at 90 degrees: finite and the same in kernel and twin, even where it jumps."""
    model = random_model()
    model = model.replace(gamma=np.full_like(model.gamma, gamma))
    wi = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    wo = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    got = model.eval(wi, wo)
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, twin_eval(model, wi, wo), rtol=1e-12, atol=1e-300)


def test_flat_lobe_is_lambert(rng):
    model = random_model(n_lobes=1)
    model = model.replace(gamma=0.0 * model.gamma, beta=0.0 * model.beta, spike=None)
    theta_d = half_diff.from_directions(wi := upper(rng, 500), wo := upper(rng, 500))[1]
    height = [np.interp(theta_d, model.theta_d, np.expm1(model.kappa[:, c, 0])) for c in range(N_CHANNELS)]
    np.testing.assert_allclose(model.eval(wi, wo), np.transpose(height), rtol=1e-12)


# Invariants


@pytest.mark.parametrize("evaluate", [DSBRDF.eval, twin_eval])
def test_reciprocal_to_the_last_bit(evaluate, rng):
    for seed in range(4):
        model = random_model(seed)
        for wi, wo in ((upper(rng, 5000), upper(rng, 5000)), awkward_pairs(rng)):
            np.testing.assert_array_equal(evaluate(model, wi, wo), evaluate(model, wo, wi))


def test_never_negative(rng):
    for beta in (-1.0, 1.0):
        model = random_model()
        model = model.replace(beta=np.full_like(model.beta, beta))
        for wi, wo in ((upper(rng, 20_000), upper(rng, 20_000)), awkward_pairs(rng)):
            values = model.eval(wi, wo)
            assert np.isfinite(values).all()
            assert (values >= 0.0).all()


@pytest.mark.parametrize("evaluate", [DSBRDF.eval, twin_eval])
def test_black_below_the_horizon(evaluate, rng):
    model = random_model()
    w = near(np.zeros((3000, 3)), rng, 1.0)
    wi, wo = w[:1500], w[1500:]
    values = evaluate(model, wi, wo)
    above = (wi[:, 2] >= 0.0) & (wo[:, 2] >= 0.0)
    assert 200 < above.sum() < 600
    assert (values[~above] == 0.0).all()
    assert (values[above] > 0.0).all()


def test_lobes_and_spike_add_up(rng):
    model = random_model()
    wi = upper(rng, 1000)
    wo = near(wi * [-1.0, -1.0, 1.0], rng, 0.02)
    parts = [model.lobe(k) for k in range(N_LOBES)]
    spike = model.replace(kappa=np.full_like(model.kappa, 1e-300))
    total = sum(part.eval(wi, wo) for part in [*parts, spike])
    np.testing.assert_allclose(total, model.eval(wi, wo), rtol=1e-13)
    assert (spike.eval(wi, wo) > 1.0).sum() > 100
    assert not any(part.spike.any() for part in parts)
    np.testing.assert_array_equal(model.lobe(-1).kappa, model.kappa[..., -1:])
    assert parts[1].n_lobes == 1
    for k in (3, -4):
        with pytest.raises(IndexError, match=rf"lobe {k}: the model has 3 lobes, numbered from 0\."):
            model.lobe(k)


# Interpolation over theta_d


def test_exact_at_slices_and_linear_between():
    model = random_model()
    theta_h, phi_d = 0.2, 0.7
    # Angles come back from directions with a rounding error
    nodes = model.eval_angles(theta_h, model.theta_d[:-1], phi_d)
    for i, values in enumerate(nodes):
        parameters = (model.kappa, model.gamma, model.beta, model.spike)
        single = DSBRDF(np.array([0.3]), *(values[i : i + 1] for values in parameters))
        np.testing.assert_allclose(values, single.eval_angles(theta_h, model.theta_d[i], phi_d), rtol=1e-12)
    # The azimuthal factor varies with theta_d on its own
    plain = model.replace(beta=0.0 * model.beta)
    low, high = model.theta_d[2:4]
    ends = plain.eval_angles(theta_h, [low, high], phi_d)
    for share in (0.25, 0.5, 0.9):
        got = plain.eval_angles(theta_h, low + share * (high - low), phi_d)
        np.testing.assert_allclose(got, (1.0 - share) * ends[0] + share * ends[1], rtol=1e-12)


@pytest.mark.parametrize("n_slices", [1, 2, 7])
def test_first_and_last_slice_hold_beyond(n_slices):
    model = random_model(n_slices=n_slices)
    model = model.replace(beta=0.0 * model.beta)
    first, last = (model.eval_angles(0.02, model.theta_d[i], 0.3) for i in (0, -1))
    np.testing.assert_allclose(model.eval_angles(0.02, 0.0, 0.3), first, rtol=1e-12)
    np.testing.assert_allclose(model.eval_angles(0.02, 1.55, 0.3), last, rtol=1e-12)


# Arguments


def test_shapes_and_kinds_of_arguments(rng):
    model = random_model()
    wi, wo = upper(rng, 4, 1), upper(rng, 5)
    values = model.eval(wi, wo)
    assert values.shape == (4, 5, N_CHANNELS)
    np.testing.assert_array_equal(values[2, 3], model.eval(wi[2, 0], wo[3]))
    np.testing.assert_array_equal(values[2, 3], model.eval(wi[2, 0].tolist(), tuple(wo[3])))
    np.testing.assert_array_equal(values, model.eval(np.asfortranarray(wi), wo[::-1][::-1]))
    assert model.eval(np.zeros((0, 3)), wo[0]).shape == (0, N_CHANNELS)
    single = model.eval(wi.astype(np.float32), wo.astype(np.float32))
    assert single.dtype == np.float64
    np.testing.assert_allclose(single, values, rtol=1e-3)


@pytest.mark.parametrize("n_directions", [1, 63, 64, 65, 4097])
@pytest.mark.parametrize("n_channels", [1, 5])
def test_any_number_of_directions_and_channels(n_directions, n_channels, rng):
    """Blocks of the kernel must not show."""
    model = random_model(n_channels=n_channels)
    wi, wo = upper(rng, n_directions), upper(rng, n_directions)
    np.testing.assert_allclose(model.eval(wi, wo), twin_eval(model, wi, wo), rtol=1e-12)


@pytest.mark.parametrize(
    ("wi", "text"),
    [
        ([0.0, 0.0, 2.0], r"'wi' must be unit vectors on the last axis, got norm 2"),
        ([[0.0, 0.0, 1.0], [0.3, 0.0, 0.3]], r"'wi' must be unit vectors.* at index 1\. Divide by"),
        ([0.0, 1.0], r"'wi' must have x, y, z on its last axis, got shape \(2,\)"),
        ([0.0, 0.0, np.nan], r"'wi' must be unit vectors"),
    ],
)
def test_says_what_is_wrong_with_a_direction(wi, text):
    with pytest.raises(ValueError, match=text):
        random_model().eval(wi, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"theta_d": [0.3, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8]}, r"'theta_d' must be a non-empty ascending list"),
        ({"theta_d": []}, r"'theta_d' must be a non-empty ascending list"),
        ({"theta_d": [0.1, 0.2]}, r"'kappa' must have shape \(theta_d, channel, lobe\).*with 2 theta_d"),
        ({"theta_d": np.arange(7) * 10.0}, r"'theta_d' must lie in \[0, pi/2\] radians.*deg2rad"),
        ({"kappa": np.zeros((7, 3, 3))}, r"'kappa' must be > 0 and finite, got 0 at index \(0, 0, 0\)"),
        ({"gamma": np.full((7, 3, 3), -1.0)}, r"'gamma' must be >= 0 and finite, got -1"),
        ({"gamma": np.ones((7, 3, 2))}, r"'gamma' must have shape .* got \(7, 3, 2\)"),
        ({"beta": np.full((7, 3, 3), 1.5)}, r"'beta' must be >= -1 and <= 1 and finite, got 1\.5"),
        ({"beta": np.full((7, 3, 3), np.nan)}, r"'beta' must be .*finite, got nan"),
        ({"kappa": 1.0}, r"'kappa' must have shape \(theta_d, channel, lobe\).*with 7 theta_d, got \(\)\.$"),
        ({"gamma": None}, r"'gamma' must have shape .* got \(\)\.$"),
        ({"beta": 0}, r"'beta' must have shape .* like 'kappa' with 7 theta_d, got \(\)\.$"),
        ({"beta": "none"}, r"'beta' must have shape .* got \(\)\.$"),
        ({"beta": np.float64(0.0)}, r"'beta' must have shape .* got \(\)\.$"),
        ({"spike": 0.0}, r"'spike' must have shape \(theta_d, channel\) \(7, 3\), got \(\)\.$"),
        ({"spike": np.full((7, 3), -1.0)}, r"'spike' must be >= 0 and finite, got -1"),
        ({"spike": np.ones((7, 2))}, r"'spike' must have shape \(theta_d, channel\) \(7, 3\), got \(7, 2\)"),
    ],
)
def test_says_what_is_wrong_with_a_parameter(change, text):
    with pytest.raises(ValueError, match=text):
        random_model().replace(**change)


def test_beta_is_zero_by_default(rng):
    model = random_model()
    model = model.replace(beta=np.zeros_like(model.beta))
    wi, wo = upper(rng, 100), upper(rng, 100)
    without = DSBRDF(model.theta_d, model.kappa.tolist(), model.gamma, spike=model.spike)
    np.testing.assert_array_equal(without.eval(wi, wo), model.eval(wi, wo))
    np.testing.assert_array_equal(model.replace(beta=None).beta, model.beta)


def test_beta_is_zero_by_default_with_arrays_of_another_library(rng):
    jnp = pytest.importorskip("jax.numpy")
    model = random_model()
    foreign = DSBRDF(model.theta_d, jnp.asarray(model.kappa), jnp.asarray(model.gamma), spike=model.spike)
    wi, wo = upper(rng, 100), upper(rng, 100)
    assert isinstance(foreign.kappa, jnp.ndarray)
    expected = model.replace(beta=None).eval(wi, wo)
    np.testing.assert_allclose(foreign.eval(wi, wo), expected, rtol=1e-4, atol=1e-4)


def test_tells_what_it_is():
    model = random_model().replace(name="nickel")
    assert repr(model) == "DSBRDF('nickel', 3 lobes, 3 channels, 7 slices)"
    assert repr(model.replace(name="")) == "DSBRDF(3 lobes, 3 channels, 7 slices)"
