"""Models in other array libraries: values are those of NumPy, gradients those of differences."""

import importlib.util

import numpy as np
import pytest
from models import N_CHANNELS, N_SLICES, awkward_pairs, near, random_model, twin_eval, upper
from tables import formula

from dsbrdf import half_diff

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
