"""Values of a model: kernel and twin against the formula, reciprocity to the last bit, gradients."""

import importlib.util

import numpy as np
import pytest
from tables import formula

from dsbrdf import DSBRDF, half_diff
from dsbrdf.evaluation import evaluate_any

N_SLICES, N_CHANNELS, N_LOBES = 7, 3, 3


def random_model(seed=1, n_slices=N_SLICES, n_channels=N_CHANNELS, n_lobes=N_LOBES):
    rng = np.random.default_rng(seed)
    shape = (n_slices, n_channels, n_lobes)
    return DSBRDF(
        np.sort(rng.uniform(0.05, 1.5, n_slices)),
        10.0 ** rng.uniform(-2.0, 0.8, shape),
        10.0 ** rng.uniform(-1.0, 3.0, shape),
        rng.uniform(-0.95, 0.95, shape),
        rng.uniform(0.0, 50.0, shape[:2]),
    )


def upper(rng, *shape):
    w = rng.normal(size=(*shape, 3))
    w[..., 2] = np.abs(w[..., 2])
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def twin_eval(model, wi, wo):
    parameters = (model.kappa, model.gamma, model.beta, model.spike)
    return evaluate_any(wi, wo, model.theta_d, *parameters)


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
        ({"spike": np.full((7, 3), -1.0)}, r"'spike' must be >= 0 and finite, got -1"),
        ({"spike": np.ones((7, 2))}, r"'spike' must have shape \(theta_d, channel\) \(7, 3\), got \(7, 2\)"),
    ],
)
def test_says_what_is_wrong_with_a_parameter(change, text):
    with pytest.raises(ValueError, match=text):
        random_model().replace(**change)


def test_tells_what_it_is():
    model = random_model().replace(name="nickel")
    assert repr(model) == "DSBRDF('nickel', 3 lobes, 3 channels, 7 slices)"
    assert repr(model.replace(name="")) == "DSBRDF(3 lobes, 3 channels, 7 slices)"


# Other array libraries

# Equal directions, the pole, grazing, opposite directions, and a hair away from them: all pairs
DEGENERATE = np.array(
    [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.6, 0.0, 0.8],
        [-0.6, 0.0, 0.8],
        [0.6, 1e-9, 0.8],
        [1e-9, 0.0, 1.0],
    ]
)
N_PAIRS = len(DEGENERATE) ** 2


@pytest.fixture
def jax64():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


@pytest.fixture(scope="module")
def jax_gradients():
    """Gradients of a weighted sum by `wi`, `wo`, kappa, gamma, beta and spike, compiled for N_PAIRS pairs."""
    jax = pytest.importorskip("jax")
    model = random_model()

    def total(wi, wo, kappa, gamma, beta, spike, weight):
        traced = model.replace(kappa=kappa, gamma=gamma, beta=beta, spike=spike)
        return (traced.eval(wi, wo) * weight).sum()

    compiled = jax.jit(jax.grad(total, argnums=range(6)))

    def gradients(model, wi, wo, weight):
        with jax.enable_x64(True):
            arguments = (wi, wo, model.kappa, model.gamma, model.beta, model.spike, weight)
            return [np.asarray(g) for g in compiled(*map(jax.numpy.asarray, arguments))]

    return gradients


def test_jax_values_are_those_of_numpy(jax64, rng):
    model = random_model()
    pairs = zip((upper(rng, 100), upper(rng, 100)), awkward_pairs(rng), strict=True)
    wi, wo = (np.concatenate(side) for side in pairs)
    compiled = jax64.jit(model.eval)
    values = compiled(jax64.numpy.asarray(wi), jax64.numpy.asarray(wo))
    assert isinstance(values, jax64.Array)
    assert values.dtype == np.float64
    np.testing.assert_allclose(values, model.eval(wi, wo), rtol=1e-11, atol=1e-30)
    np.testing.assert_array_equal(values, compiled(jax64.numpy.asarray(wo), jax64.numpy.asarray(wi)))


def test_jax_single_precision(rng):
    jax = pytest.importorskip("jax")
    model = random_model()
    wi, wo = upper(rng, 50, 1), upper(rng, 10)
    values = jax.jit(model.eval)(jax.numpy.asarray(wi), jax.numpy.asarray(wo))
    assert values.dtype == np.float32
    np.testing.assert_allclose(values, model.eval(wi, wo), rtol=2e-3, atol=1e-6)


def test_jax_parameters_beside_numpy_directions(jax64, rng):
    model = random_model(n_slices=2)
    wi, wo = upper(rng, 20), upper(rng, 20)
    compiled = jax64.jit(lambda kappa: model.replace(kappa=kappa).lobe(1).eval(wi.tolist(), wo))
    values = compiled(jax64.numpy.asarray(model.kappa))
    np.testing.assert_allclose(values, model.lobe(1).eval(wi, wo), rtol=1e-11, atol=1e-300)


def test_jax_gradients_by_parameters(jax_gradients, rng):
    """Against complex steps through the formula, at the slices and at weights between them."""
    model = random_model()
    wi, wo, weight = upper(rng, N_PAIRS), upper(rng, N_PAIRS), rng.normal(size=(N_PAIRS, N_CHANNELS))
    wo[:20] = near(wi[:20] * [-1.0, -1.0, 1.0], rng, 0.01)
    *by_parameters, by_spike = jax_gradients(model, wi, wo, weight)[2:]
    angles = half_diff.from_directions(wi, wo)
    share = np.stack([np.interp(angles[1], model.theta_d, row) for row in np.eye(N_SLICES)])
    names = ("kappa", "gamma", "beta")
    for name, gradient in zip(names, by_parameters, strict=True):
        for at in np.ndindex(gradient.shape):
            parameters = {key: getattr(model, key)[at[0]].astype(complex) for key in names}
            parameters[name][at[1:]] += 1e-30j
            slope = formula(*angles, *parameters.values()).imag / 1e-30
            terms = slope.T * weight * share[at[0], :, None]
            np.testing.assert_allclose(gradient[at], terms.sum(), rtol=1e-8, atol=1e-10 * np.abs(terms).sum())
    # Linear in the spike
    change = model.eval(wi, wo) - model.replace(spike=None).eval(wi, wo)
    np.testing.assert_allclose((by_spike * model.spike).sum(), (change * weight).sum(), rtol=1e-8)
    assert (change > 0.0).any(axis=-1).sum() > 5


def test_jax_gradients_by_directions(jax_gradients, rng):
    """Against central differences of the NumPy twin, off the sphere too."""
    model = random_model()
    model = model.replace(gamma=10.0 ** rng.uniform(-1.0, 1.0, model.gamma.shape))
    # Slices make kinks: keep away from them
    wi, wo = upper(rng, 9 * N_PAIRS), upper(rng, 9 * N_PAIRS)
    theta_d = half_diff.from_directions(wi, wo)[1]
    clear = (np.abs(theta_d[:, None] - model.theta_d).min(1) > 1e-3) & (np.minimum(wi, wo)[:, 2] > 0.01)
    wi, wo = wi[clear][:N_PAIRS], wo[clear][:N_PAIRS]
    weight = rng.normal(size=(N_PAIRS, N_CHANNELS))
    for side, gradient in enumerate(jax_gradients(model, wi, wo, weight)[:2]):
        for axis in range(3):
            moves = [sign * 1e-5 * np.eye(3)[axis] for sign in (1.0, -1.0)]
            pairs = [(wi + move, wo) if side == 0 else (wi, wo + move) for move in moves]
            plus, minus = ((twin_eval(model, *pair) * weight).sum(-1) for pair in pairs)
            error = np.abs(gradient[:, axis] - (plus - minus) / 2e-5) / np.abs(gradient).max(1)
            assert error.max() < 1e-5


@pytest.mark.parametrize("gamma", [0.0, None])
def test_jax_gradients_are_finite_everywhere(jax_gradients, gamma):
    model = random_model()
    if gamma is not None:
        model = model.replace(gamma=np.full_like(model.gamma, gamma))
    pairs = np.broadcast_arrays(DEGENERATE[:, None], DEGENERATE)
    wi, wo = (w.reshape(-1, 3) for w in pairs)
    for gradient in jax_gradients(model, wi, wo, np.ones((N_PAIRS, N_CHANNELS))):
        assert np.isfinite(gradient).all()


if importlib.util.find_spec("torch"):

    def test_torch_values_and_gradients(rng):
        torch = pytest.importorskip("torch")
        model = random_model()
        wi, wo = upper(rng, 6, 50), upper(rng, 50)
        kappa = torch.tensor(model.kappa, requires_grad=True)
        values = model.replace(kappa=kappa).eval(torch.tensor(wi), torch.tensor(wo))
        np.testing.assert_allclose(values.detach().numpy(), model.eval(wi, wo), rtol=1e-12)
        values.sum().backward()
        up, down = (model.replace(kappa=model.kappa * (1.0 + h)).eval(wi, wo).sum() for h in (1e-6, -1e-6))
        np.testing.assert_allclose((kappa.grad.numpy() * model.kappa).sum(), (up - down) / 2e-6, rtol=1e-7)
