"""Values of slices: kernel and twin against the formula, reciprocity to the last bit, arguments; tables of them."""

import numpy as np
import pytest
from slices import N_CHANNELS, N_LOBES, random_slices, twin_eval, upper
from tables import formula

from dsbrdf import half_diff
from dsbrdf.measured.source import Source
from dsbrdf.paper import Slices
from dsbrdf.paper.slices import roughness


def near(wi, rng, size):
    """Unit vectors around `wi` at about `size` radians."""
    w = wi + size * rng.normal(size=wi.shape)
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def awkward_pairs(rng):
    """Near the same direction, near the pole, near grazing, near opposite; and exactly so."""
    w = upper(rng, 200)
    pole = np.broadcast_to([0.0, 0.0, 1.0], w.shape)
    flat = w * [1.0, 1.0, 0.0]
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    mirror = w * [-1.0, -1.0, 1.0]
    pairs = [(w, w), (pole, w), (pole, pole), (w, mirror), (flat, w), (flat, -flat), (flat, flat)]
    for size in (1e-15, 1e-12, 1e-8, 1e-4):
        pairs += [(w, near(w, rng, size)), (w, near(mirror, rng, size)), (flat, near(-flat, rng, size))]
        pairs += [(pole, near(pole, rng, size))]
    return tuple(np.concatenate(side) for side in zip(*pairs, strict=True))


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
    model = random_slices()
    wi, wo = upper(rng, 4000), upper(rng, 4000)
    # A quarter of them within the spike
    wo[:1000] = near(wi[:1000] * [-1.0, -1.0, 1.0], rng, 0.01)
    expected = by_angles(model, *half_diff.from_directions(wi, wo))
    np.testing.assert_allclose(model.eval(wi, wo), expected, rtol=1e-9)
    np.testing.assert_allclose(twin_eval(model, wi, wo), expected, rtol=1e-9)


def test_kernel_equals_twin(rng):
    model = random_slices()
    for wi, wo in ((upper(rng, 20_000), upper(rng, 20_000)), awkward_pairs(rng)):
        np.testing.assert_allclose(model.eval(wi, wo), twin_eval(model, wi, wo), rtol=1e-12, atol=1e-30)
    w = upper(rng, 20_000)
    narrow = model.replace(gamma=1e3 * model.gamma)
    mirror = near(w * [-1.0, -1.0, 1.0], rng, 1e-2)
    np.testing.assert_allclose(narrow.eval(w, mirror), twin_eval(narrow, w, mirror), rtol=1e-10, atol=1e-300)


def test_angles_are_those_of_the_directions(rng):
    model = random_slices()
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
    model = random_slices()
    model = model.replace(gamma=np.full_like(model.gamma, gamma))
    wi = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    wo = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    got = model.eval(wi, wo)
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, twin_eval(model, wi, wo), rtol=1e-12, atol=1e-300)


# Invariants


def test_reciprocal_to_the_last_bit_and_never_negative(rng):
    for beta in (None, -1.0, 1.0):
        model = random_slices()
        model = model if beta is None else model.replace(beta=np.full_like(model.beta, beta))
        for wi, wo in ((upper(rng, 5000), upper(rng, 5000)), awkward_pairs(rng)):
            values = model.eval(wi, wo)
            np.testing.assert_array_equal(values, model.eval(wo, wi))
            assert np.isfinite(values).all()
            assert (values >= 0.0).all()


def test_black_below_the_horizon(rng):
    w = near(np.zeros((3000, 3)), rng, 1.0)
    wi, wo = w[:1500], w[1500:]
    values = random_slices().eval(wi, wo)
    above = (wi[:, 2] >= 0.0) & (wo[:, 2] >= 0.0)
    assert 200 < above.sum() < 600
    assert (values[~above] == 0.0).all()
    assert (values[above] > 0.0).all()


def test_lobes_and_spike_add_up(rng):
    model = random_slices()
    wi = upper(rng, 1000)
    wo = near(wi * [-1.0, -1.0, 1.0], rng, 0.02)
    parts = [model.lobe(k) for k in range(N_LOBES)]
    spike = model.replace(kappa=np.full_like(model.kappa, 1e-300))
    total = sum(part.eval(wi, wo) for part in [*parts, spike])
    np.testing.assert_allclose(total, model.eval(wi, wo), rtol=1e-13)
    assert (spike.eval(wi, wo) > 1.0).sum() > 100
    assert not any(part.spike.any() for part in parts)
    np.testing.assert_array_equal(model.lobe(-1).kappa, model.kappa[..., -1:])
    for k in (3, -4):
        with pytest.raises(IndexError, match=rf"lobe {k}: the model has 3 lobes, numbered from 0\."):
            model.lobe(k)


# Interpolation over theta_d


def test_exact_at_slices_and_linear_between():
    model = random_slices()
    theta_h, phi_d = 0.2, 0.7
    # Angles come back from directions with a rounding error
    nodes = model.eval_angles(theta_h, model.theta_d[:-1], phi_d)
    for i, values in enumerate(nodes):
        parameters = (model.kappa, model.gamma, model.beta, model.spike)
        single = Slices(np.array([0.3]), *(values[i : i + 1] for values in parameters))
        np.testing.assert_allclose(values, single.eval_angles(theta_h, model.theta_d[i], phi_d), rtol=1e-12)
    # The azimuthal factor varies with theta_d on its own
    plain = model.replace(beta=None)
    low, high = model.theta_d[2:4]
    ends = plain.eval_angles(theta_h, [low, high], phi_d)
    for share in (0.25, 0.5, 0.9):
        got = plain.eval_angles(theta_h, low + share * (high - low), phi_d)
        np.testing.assert_allclose(got, (1.0 - share) * ends[0] + share * ends[1], rtol=1e-12)


@pytest.mark.parametrize("n_slices", [1, 2, 7])
def test_first_and_last_slice_hold_beyond(n_slices):
    model = random_slices(n_slices=n_slices).replace(beta=None)
    first, last = (model.eval_angles(0.02, model.theta_d[i], 0.3) for i in (0, -1))
    np.testing.assert_allclose(model.eval_angles(0.02, 0.0, 0.3), first, rtol=1e-12)
    np.testing.assert_allclose(model.eval_angles(0.02, 1.55, 0.3), last, rtol=1e-12)


# Arguments


def test_shapes_and_kinds_of_arguments(rng):
    model = random_slices()
    wi, wo = upper(rng, 4, 1), upper(rng, 5)
    values = model.eval(wi, wo)
    assert values.shape == (4, 5, N_CHANNELS)
    np.testing.assert_array_equal(values[2, 3], model.eval(wi[2, 0].tolist(), tuple(wo[3])))
    np.testing.assert_array_equal(values, model.eval(np.asfortranarray(wi), wo[::-1][::-1]))
    assert model.eval(np.zeros((0, 3)), wo[0]).shape == (0, N_CHANNELS)
    with pytest.raises(ValueError, match=r"'wi' must be unit vectors on the last axis, got norm 2"):
        model.eval([0.0, 0.0, 2.0], wo)


@pytest.mark.parametrize("n_directions", [1, 63, 64, 65, 4097])
@pytest.mark.parametrize("n_channels", [1, 5])
def test_any_number_of_directions_and_channels(n_directions, n_channels, rng):
    """Blocks of the kernel must not show."""
    model = random_slices(n_channels=n_channels)
    wi, wo = upper(rng, n_directions), upper(rng, n_directions)
    np.testing.assert_allclose(model.eval(wi, wo), twin_eval(model, wi, wo), rtol=1e-12)


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
        ({"beta": 0}, r"'beta' must have shape .* like 'kappa' with 7 theta_d, got \(\)\.$"),
        ({"spike": 0.0}, r"'spike' must have shape \(theta_d, channel\) \(7, 3\), got \(\)\.$"),
        ({"spike": np.full((7, 3), -1.0)}, r"'spike' must be >= 0 and finite, got -1"),
        ({"spike": np.ones((7, 2))}, r"'spike' must have shape \(theta_d, channel\) \(7, 3\), got \(7, 2\)"),
        ({"channels": ("r", "g")}, r"'channels' must be 3 different names"),
    ],
)
def test_says_what_is_wrong_with_a_parameter(change, text):
    with pytest.raises(ValueError, match=text):
        random_slices().replace(**change)


def test_what_is_not_given(rng):
    model = random_slices()
    wi, wo = upper(rng, 100), upper(rng, 100)
    plain = model.replace(beta=None, spike=None)
    assert not plain.beta.any()
    assert not plain.spike.any()
    assert (model.n_parameters, plain.n_parameters) == (7 * 3 * (3 * 3 + 1), 7 * 3 * 2 * 3)
    zero = Slices(model.theta_d, model.kappa.tolist(), model.gamma, np.zeros_like(model.beta))
    np.testing.assert_array_equal(plain.eval(wi, wo), zero.eval(wi, wo))
    assert model.channels == ("r", "g", "b")


def test_tells_what_it_is():
    model = random_slices().replace(name="nickel")
    assert repr(model) == "Slices('nickel', 3 lobes, 3 channels, 7 slices)"
    assert repr(model.replace(name="")) == "Slices(3 lobes, 3 channels, 7 slices)"


# Tables, and how rough slices are


def test_a_table_holds_the_values():
    model = random_slices().replace(name="made up", source=Source(description="a test"))
    table = model.tabulate(shape=(12, 9, 10), convention="edge")
    assert (table.name, table.convention, table.source.description) == ("made up", "edge", "a test")
    values = model.eval_angles(table.theta_h[3], table.theta_d[2], table.phi_d)
    np.testing.assert_allclose(table.values[3, 2], values, rtol=1e-12)


def test_order_of_lobes_makes_curves_rough():
    theta_d = np.linspace(0.0, 1.5, 12)
    smooth = Slices(
        theta_d,
        np.array([2.0, 0.3]) * np.exp(0.5 * theta_d)[:, None, None] * np.ones((3, 1)),
        np.array([200.0, 2.0]) * np.ones((12, 3, 1)),
    )
    swapped = smooth.kappa.copy(), smooth.gamma.copy()
    for values in swapped:
        values[3] = values[3][:, ::-1]
    assert roughness(smooth).kappa == pytest.approx(0.0, abs=1e-20)
    rough = roughness(smooth.replace(kappa=swapped[0], gamma=swapped[1]))
    assert rough.kappa > 0.1
    assert rough.gamma > 1.0
    absent = smooth.kappa.copy()
    absent[..., 0] = 10.0 ** np.random.default_rng(3).uniform(-18.0, -12.0, absent.shape[:2])
    assert roughness(smooth.replace(kappa=absent)).kappa < 1e-6


def test_roughness_by_hand():
    kappa = np.full((4, 1, 1), 2.0)
    kappa[2] *= np.e
    model = Slices(np.linspace(0.0, 1.5, 4), kappa, np.ones_like(kappa))
    # ln(kappa) steps by 0, 1, -1: second differences 1 and -2
    assert roughness(model).kappa == pytest.approx((1.0 + 4.0) / 2.0)
    assert roughness(model).gamma == 0.0
    assert np.isnan(roughness(Slices(model.theta_d[:2], kappa[:2], kappa[:2])).kappa)
