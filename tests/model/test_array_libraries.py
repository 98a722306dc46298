"""Models in other array libraries: values are those of NumPy, gradients those of differences, models are arguments."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from models import N_CHANNELS, awkward_pairs, by_angles, near, random_model, twin_eval, upper

from dsbrdf import half_diff
from dsbrdf.model.lobes import Lobes

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
NAMES = ("scale", "gamma", "beta", "falloff", "colour")
NEEDS_VALUES = (
    r"^this needs the values of the parameters, which carry gradients here\. Call it outside of jax\.jit and "
    r"jax\.grad, or on a model of detached tensors\."
)


def as_jax(jax, model):
    return model.replace(lobes=Lobes(*(jax.numpy.asarray(part) for part in model.lobes.parts)))


@pytest.fixture
def jax64():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


@pytest.fixture(scope="module")
def jax_gradients():
    """Gradients of a weighted sum by `wi`, `wo` and the model, compiled for N_PAIRS pairs."""
    jax = pytest.importorskip("jax")
    compiled = jax.jit(
        jax.grad(lambda wi, wo, model, weight: (model.eval(wi, wo) * weight).sum(), argnums=(0, 1, 2))
    )

    def gradients(model, wi, wo, weight):
        with jax.enable_x64(True):
            by_wi, by_wo, by_model = compiled(
                *map(jax.numpy.asarray, (wi, wo)), as_jax(jax, model), jax.numpy.asarray(weight)
            )
            return np.asarray(by_wi), np.asarray(by_wo), [np.asarray(part) for part in by_model.lobes.parts]

    return gradients


# Values


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
    np.testing.assert_allclose(values, model.eval(wi, wo), rtol=5e-3, atol=1e-6)


def test_jax_parameters_beside_numpy_directions(jax64, rng):
    model = random_model()
    wi, wo = upper(rng, 20), upper(rng, 20)

    def value(scale):
        return model.replace(lobes=model.lobes.replace(scale=scale)).lobe(1).eval(wi.tolist(), wo)

    values = jax64.jit(value)(jax64.numpy.asarray(model.lobes.scale))
    np.testing.assert_allclose(values, model.lobe(1).eval(wi, wo), rtol=1e-11, atol=1e-300)


@pytest.mark.parametrize("compiled", [False, True])
def test_jax_directions_are_checked_where_they_have_values(jax64, compiled):
    model = random_model()
    wi = jax64.numpy.asarray([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    wo = jax64.numpy.asarray([0.0, 0.0, 1.0])
    if compiled:
        assert jax64.jit(model.eval)(wi, wo).shape == (2, N_CHANNELS)
        return
    with pytest.raises(ValueError, match=r"'wi' must be unit vectors .*, got norm 2 at index 1\. Divide by"):
        model.eval(wi, wo)
    with pytest.raises(ValueError, match=r"'wo' must be unit vectors .*, got norm 2 at index 1\. Divide by"):
        model.eval(wo, wi)
    with pytest.raises(ValueError, match=r"'wi' must have x, y, z on its last axis, got shape \(2, 2\)\."):
        model.eval(wi[:, :2], wo)


# Models as arguments


def test_a_model_is_an_argument_of_jit(jax64, rng):
    traced = []

    def value(model, wi, wo):
        traced.append(model.name)
        return model.eval(wi, wo)

    compiled = jax64.jit(value)
    wi, wo = (jax64.numpy.asarray(upper(rng, 30)) for _ in range(2))
    model = random_model().replace(name="a")
    for shift in (0.0, 0.5):
        moved = model.replace(lobes=model.lobes.replace(scale=model.lobes.scale + shift))
        values = compiled(moved, wi, wo)
        np.testing.assert_allclose(values, moved.eval(np.asarray(wi), np.asarray(wo)), rtol=1e-11)
    # Compiled once for copies of a model
    assert traced == ["a"]


def test_a_model_comes_out_of_jit_and_grad(jax64, rng):
    model = random_model().replace(name="a", channels=("x", "y", "z"))
    wi, wo = upper(rng, 30), upper(rng, 30)
    doubled = jax64.jit(lambda m: jax64.tree_util.tree_map(lambda part: 2.0 * part, m))(model)
    assert (doubled.name, doubled.channels, doubled.n_lobes) == ("a", ("x", "y", "z"), 3)
    np.testing.assert_allclose(doubled.lobes.gamma, 2.0 * model.lobes.gamma)
    gradient = jax64.jit(jax64.grad(lambda m: m.eval(wi, wo).sum()))(as_jax(jax64, model))
    assert gradient.lobes.colour.shape == model.lobes.colour.shape
    assert all(np.abs(part).max() > 0.0 for part in gradient.lobes.parts)


def test_models_can_be_stacked_and_mapped_over(jax64, rng):
    models = [random_model(seed) for seed in range(4)]
    rest = models[0]
    models = [rest.replace(lobes=model.lobes) for model in models]
    stacked = jax64.tree_util.tree_map(lambda *parts: jax64.numpy.stack(parts), *models)
    wi, wo = upper(rng, 20), upper(rng, 20)
    over_models = jax64.vmap(lambda model: model.eval(jax64.numpy.asarray(wi), jax64.numpy.asarray(wo)))(
        stacked
    )
    np.testing.assert_allclose(over_models, [model.eval(wi, wo) for model in models], rtol=1e-11)
    over_directions = jax64.jit(jax64.vmap(models[1].eval))(jax64.numpy.asarray(wi), jax64.numpy.asarray(wo))
    np.testing.assert_allclose(over_directions, models[1].eval(wi, wo), rtol=1e-11)


def test_lobes_are_an_argument_whenever_jax_was_imported():
    """In a process of its own: the package first, then JAX, then a model."""
    pytest.importorskip("jax")
    code = (
        "import numpy as np, dsbrdf\n"
        "from dsbrdf.model.lobes import Lobes\n"
        "import jax\n"
        "one = np.zeros((1, 1))\n"
        "model = dsbrdf.DSBRDF(Lobes(one, one, one, one, one[None]))\n"
        "print(jax.jit(lambda m: m.eval([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]))(model)[0])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(np.expm1(1.0), rel=1e-5)


@pytest.mark.parametrize("transformed", ["jit", "grad"])
def test_what_needs_values_says_so_inside_of_jit_and_grad(jax64, tmp_path, rng, transformed):
    model = as_jax(jax64, random_model())
    pole = np.array([0.0, 0.0, 1.0])
    calls = {
        "save": lambda m: m.save(tmp_path / "m.json"),
        "sample": lambda m: m.sample(pole, rng),
        "pdf": lambda m: m.pdf(pole, pole),
        "at": lambda m: m.lobes.at([0.1]),
    }
    for call in calls.values():

        def inside(m, call=call):
            call(m)
            return m.lobes.scale.sum()

        with pytest.raises(TypeError, match=NEEDS_VALUES):
            getattr(jax64, transformed)(inside)(model)
    assert not list(tmp_path.iterdir())


def test_what_needs_values_works_with_arrays_that_have_them(jax64, tmp_path, rng):
    plain = random_model()
    model = as_jax(jax64, plain)
    wi, wo = upper(rng, 50), upper(rng, 50)
    np.testing.assert_array_equal(model.pdf(wi, wo), plain.pdf(wi, wo))
    model.save(tmp_path / "m.json")
    assert (tmp_path / "m.json").stat().st_size > 500


# Gradients


def test_gradients_by_parameters(jax_gradients, rng):
    """Against complex steps through the formula."""
    model = random_model()
    wi, wo, weight = upper(rng, N_PAIRS), upper(rng, N_PAIRS), rng.normal(size=(N_PAIRS, N_CHANNELS))
    wo[:20] = near(wi[:20] * [-1.0, -1.0, 1.0], rng, 0.01)
    wo[:, 2] = np.abs(wo[:, 2])
    *_, by_model = jax_gradients(model, wi, wo, weight)
    angles = half_diff.from_directions(wi, wo)
    for name, gradient in zip(NAMES, by_model, strict=True):
        for at in np.ndindex(gradient.shape):
            lobes = {key: getattr(model.lobes, key) for key in NAMES}
            lobes[name] = lobes[name].astype(complex)
            lobes[name][at] += 1e-30j
            terms = by_angles(_Plain(**lobes), *angles).imag / 1e-30 * weight
            np.testing.assert_allclose(gradient[at], terms.sum(), rtol=1e-7, atol=1e-9 * np.abs(terms).sum())


class _Plain:
    """Arrays of lobes that may be complex."""

    def __init__(self, **parts):
        self.__dict__.update(parts)


def test_gradients_by_directions(jax_gradients, rng):
    """Against central differences of the NumPy twin, off the sphere too."""
    model = random_model()
    model = model.replace(lobes=model.lobes.replace(gamma=rng.uniform(-2.0, 2.0, model.lobes.gamma.shape)))
    wi, wo = upper(rng, 9 * N_PAIRS), upper(rng, 9 * N_PAIRS)
    # Off the horizon, and where differences of the azimuthal factor are precise
    clear = (np.minimum(wi, wo)[:, 2] > 0.01) & (np.abs(wi - wo).max(1) > 0.1)
    clear &= np.hypot(*(wi + wo)[:, :2].T) > 0.1
    wi, wo = wi[clear][:N_PAIRS], wo[clear][:N_PAIRS]
    weight = rng.normal(size=(N_PAIRS, N_CHANNELS))
    for side, gradient in enumerate(jax_gradients(model, wi, wo, weight)[:2]):
        for axis in range(3):
            moves = [sign * 1e-5 * np.eye(3)[axis] for sign in (1.0, -1.0)]
            pairs = [(wi + move, wo) if side == 0 else (wi, wo + move) for move in moves]
            plus, minus = ((twin_eval(model, *pair) * weight).sum(-1) for pair in pairs)
            error = np.abs(gradient[:, axis] - (plus - minus) / 2e-5) / np.abs(gradient).max(1)
            assert error.max() < 1e-5


@pytest.mark.parametrize("ln_gamma", [-700.0, None])
def test_gradients_are_finite_everywhere(jax_gradients, ln_gamma):
    model = random_model()
    if ln_gamma is not None:
        model = model.replace(lobes=model.lobes.replace(gamma=np.full_like(model.lobes.gamma, ln_gamma)))
    pairs = np.broadcast_arrays(DEGENERATE[:, None], DEGENERATE)
    wi, wo = (w.reshape(-1, 3) for w in pairs)
    *by_directions, by_model = jax_gradients(model, wi, wo, np.ones((N_PAIRS, N_CHANNELS)))
    for gradient in (*by_directions, *by_model):
        assert np.isfinite(gradient).all()


if importlib.util.find_spec("torch"):

    def test_torch_values_and_gradients(rng):
        torch = pytest.importorskip("torch")
        model = random_model()
        wi, wo = upper(rng, 6, 50), upper(rng, 50)
        scale = torch.tensor(model.lobes.scale, requires_grad=True)
        traced = model.replace(lobes=model.lobes.replace(scale=scale))
        values = traced.eval(torch.tensor(wi), torch.tensor(wo))
        np.testing.assert_allclose(values.detach().numpy(), model.eval(wi, wo), rtol=1e-11)
        values.sum().backward()
        up, down = (
            model.replace(lobes=model.lobes.replace(scale=model.lobes.scale + h)).eval(wi, wo).sum()
            for h in (1e-6, -1e-6)
        )
        np.testing.assert_allclose(scale.grad.numpy().sum(), (up - down) / 2e-6, rtol=1e-7)

    def test_torch_tensors_with_gradients_have_no_values_to_save(tmp_path):
        torch = pytest.importorskip("torch")
        model = random_model()
        scale = torch.tensor(model.lobes.scale, requires_grad=True)
        with pytest.raises(TypeError, match=NEEDS_VALUES):
            model.replace(lobes=model.lobes.replace(scale=scale)).save(tmp_path / "m.json")
