"""Values of a model: kernel and twin against the formula, reciprocity to the last bit, arguments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import (
    N_CHANNELS,
    N_LOBES,
    SIZES,
    awkward_pairs,
    by_angles,
    constant_model,
    near,
    random_model,
    twin_eval,
    upper,
)

from dsbrdf import DSBRDF, half_diff

all_sizes = st.tuples(*[st.integers(1, 7)] * 5)
channels = st.sampled_from([1, 3, 5])


# The formula


def test_kernel_and_twin_equal_the_formula(rng):
    for seed, sizes in enumerate([SIZES, (1, 1, 1, 1, 1), (2, 2, 2, 2, 2), (3, 3, 3, 3, 3), (7, 6, 5, 4, 3)]):
        model = random_model(seed, sizes)
        wi, wo = upper(rng, 2000), upper(rng, 2000)
        # A quarter of them near the mirror direction
        wo[:500] = near(wi[:500] * [-1.0, -1.0, 1.0], rng, 0.01)
        wo[:, 2] = np.abs(wo[:, 2])
        expected = by_angles(model.lobes, *half_diff.from_directions(wi, wo))
        np.testing.assert_allclose(model.eval(wi, wo), expected, rtol=1e-9)
        np.testing.assert_allclose(twin_eval(model, wi, wo), expected, rtol=1e-9)


@settings(max_examples=60)
@given(sizes=all_sizes, n_channels=channels, n_lobes=st.integers(1, 4), seed=st.integers(0, 2**31))
def test_kernel_equals_twin_whatever_the_sizes(sizes, n_channels, n_lobes, seed):
    rng = np.random.default_rng(seed)
    model = random_model(seed, sizes, n_channels, n_lobes)
    for wi, wo in ((upper(rng, 200), upper(rng, 200)), awkward_pairs(rng)):
        values = model.eval(wi, wo)
        np.testing.assert_allclose(values, twin_eval(model, wi, wo), rtol=1e-11, atol=1e-30)
        np.testing.assert_array_equal(values, model.eval(wo, wi))


def test_kernel_equals_twin_of_narrow_lobes(rng):
    model = random_model()
    narrow = model.replace(lobes=model.lobes.replace(gamma=model.lobes.gamma + 7.0))
    w = upper(rng, 20_000)
    mirror = near(w * [-1.0, -1.0, 1.0], rng, 1e-2)
    np.testing.assert_allclose(narrow.eval(w, mirror), twin_eval(narrow, w, mirror), rtol=1e-9, atol=1e-300)


def test_angles_are_those_of_the_directions(rng):
    model = random_model()
    theta_h, theta_d = rng.uniform(0.0, 0.7, 500), rng.uniform(0.0, 0.7, 500)
    phi_d = rng.uniform(0.0, 2.0 * np.pi, 500)
    expected = by_angles(model.lobes, theta_h, theta_d, phi_d)
    np.testing.assert_allclose(model.eval_angles(theta_h, theta_d, phi_d), expected, rtol=1e-9)
    assert model.eval_angles(0.1, [0.2, 0.3], 0.4).shape == (2, N_CHANNELS)
    np.testing.assert_array_equal(model.eval_angles(1.2, 1.2, 0.0), 0.0)
    with pytest.raises(ValueError, match=r"'theta_d' must lie in \[0, pi/2\] radians, got 20.*deg2rad"):
        model.eval_angles(0.1, 20.0, 0.0)


@pytest.mark.parametrize("ln_gamma", [-700.0, -7.0, 0.0])
def test_half_vector_on_the_horizon(ln_gamma):
    """cos(theta_h)^gamma at 90 degrees: finite and the same in kernel and twin, even where it jumps."""
    model = random_model()
    model = model.replace(lobes=model.lobes.replace(gamma=np.full_like(model.lobes.gamma, ln_gamma)))
    wi = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    wo = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    got = model.eval(wi, wo)
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, twin_eval(model, wi, wo), rtol=1e-11, atol=1e-300)


def test_a_lobe_without_width_is_lambert(rng):
    model = constant_model(0.7, 1e-300, tint=(1.0, 0.5, 0.25))
    values = model.eval(upper(rng, 500), upper(rng, 500))
    np.testing.assert_allclose(
        values, np.expm1(0.7 * np.array([[1.0, 0.5, 0.25]])).repeat(500, 0), rtol=1e-12
    )


def test_too_high_a_lobe_stays_finite():
    model = constant_model(1e6, 10.0)
    pole = [0.0, 0.0, 1.0]
    values = model.eval(pole, pole)
    np.testing.assert_allclose(values, np.expm1(np.exp(6.5)), rtol=1e-12)
    np.testing.assert_allclose(twin_eval(model, np.array(pole), np.array(pole)), values, rtol=1e-12)


# Invariants


@pytest.mark.parametrize("evaluate", [DSBRDF.eval, twin_eval])
def test_reciprocal_to_the_last_bit(evaluate, rng):
    for seed in range(4):
        model = random_model(seed)
        for wi, wo in ((upper(rng, 5000), upper(rng, 5000)), awkward_pairs(rng)):
            np.testing.assert_array_equal(evaluate(model, wi, wo), evaluate(model, wo, wi))


def test_never_negative(rng):
    for beta in (-2.0, 2.0):
        model = random_model()
        model = model.replace(lobes=model.lobes.replace(beta=np.full_like(model.lobes.beta, beta)))
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


def test_lobes_add_up(rng):
    model = random_model().replace(name="nickel", errors={"rel": 0.1})
    wi = upper(rng, 1000)
    wo = near(wi * [-1.0, -1.0, 1.0], rng, 0.2)
    wo[..., 2] = np.abs(wo[..., 2])
    parts = [model.lobe(k) for k in range(N_LOBES)]
    total = sum(part.eval(wi, wo) for part in parts)
    np.testing.assert_allclose(total, model.eval(wi, wo), rtol=1e-13)
    np.testing.assert_array_equal(model.lobe(-1).lobes.scale, model.lobes.scale[-1:])
    assert parts[1].n_lobes == 1
    assert parts[1].name == "nickel lobe 1"
    assert parts[1].errors == {}
    for k in (3, -4):
        with pytest.raises(IndexError, match=rf"lobe {k}: the model has 3 lobes, numbered from 0\."):
            model.lobe(k)


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
    np.testing.assert_allclose(model.eval(wi, wo), twin_eval(model, wi, wo), rtol=1e-11)


@pytest.mark.parametrize(
    "evaluate", [DSBRDF.eval, lambda model, wi, wo: twin_eval(model, *map(np.array, (wi, wo)))]
)
@pytest.mark.parametrize(
    ("wi", "text"),
    [
        ([0.0, 0.0, 2.0], r"'wi' must be unit vectors on the last axis, got norm 2"),
        ([[0.0, 0.0, 1.0], [0.3, 0.0, 0.3]], r"'wi' must be unit vectors.* at index 1\. Divide by"),
        ([0.0, 1.0], r"'wi' must have x, y, z on its last axis, got shape \(2,\)"),
        ([0.0, 0.0, np.nan], r"'wi' must be unit vectors"),
    ],
)
def test_says_what_is_wrong_with_a_direction(evaluate, wi, text):
    with pytest.raises(ValueError, match=text):
        evaluate(random_model(), wi, [0.0, 0.0, 1.0])


def test_tells_what_it_is():
    model = random_model().replace(name="nickel")
    assert repr(model) == "DSBRDF('nickel', 3 lobes, 3 channels (r, g, b), 51 numbers)"
    assert repr(model.replace(name="")) == "DSBRDF(3 lobes, 3 channels (r, g, b), 51 numbers)"
    assert repr(random_model(n_channels=5)).startswith("DSBRDF(3 lobes, 5 channels (0, 1, 2, ...), ")
