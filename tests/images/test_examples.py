"""What the examples of gradients through a renderer of one's own show runs as it stands."""

import importlib.util
import runpy
from pathlib import Path

import numpy as np
import pytest

from dsbrdf.space import builtin, from_scores

EXAMPLES = Path(__file__).parents[2] / "examples"
LIBRARIES = [name for name in ("jax", "torch") if importlib.util.find_spec(name)]


@pytest.mark.slow
@pytest.mark.parametrize("library", LIBRARIES)
def test_an_example_finds_a_like_material(library, capsys):
    if library == "jax":
        jax = pytest.importorskip("jax")
        before = jax.config.jax_enable_x64
    try:
        runpy.run_path(str(EXAMPLES / f"picture_{library}.py"), run_name="__main__")
    finally:
        if library == "jax":
            jax.config.update("jax_enable_x64", before)
    loss, nearest = capsys.readouterr().out.split("; nearest: ")
    assert float(loss.split()[1]) < 1.0
    assert "rubber" in nearest


def test_lobes_of_scores_are_those_of_the_space(rng):
    space = builtin()
    scores = space.fpca.scores[rng.integers(len(space.names))]
    smooth, model = from_scores(space, scores), space.model(scores, conserve=False)
    wi, wo = np.array([[0.6, 0.0, 0.8], [0.0, 0.3, 0.954]]), np.array([[-0.5, 0.0, 0.866], [0.0, 0.0, 1.0]])
    wi, wo = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wi, wo))
    np.testing.assert_allclose(model.replace(lobes=smooth).eval(wi, wo), model.eval(wi, wo), rtol=1e-6)


def test_too_many_scores():
    space = builtin()
    with pytest.raises(ValueError, match="'scores' has 500 components"):
        from_scores(space, np.zeros(500))


def test_gradients_of_scores(rng):
    """Of values by scores under JAX, against central differences in NumPy."""
    jax = pytest.importorskip("jax")
    space, n = builtin(), 6
    scores = 0.3 * space.fpca.scores[3, :n]
    model = space.model(space.fpca.scores[3], conserve=False)
    w = rng.normal(size=(2, 20, 3))
    w[..., 2] = np.abs(w[..., 2]) + 0.2
    wi, wo = w / np.linalg.norm(w, axis=-1, keepdims=True)

    def total(scores, xp=np):
        return xp.log(model.replace(lobes=from_scores(space, scores, xp)).eval(wi, wo)).sum()

    with jax.enable_x64(True):
        gradient = np.asarray(jax.grad(lambda scores: total(scores, jax.numpy))(jax.numpy.asarray(scores)))
    moves = 1e-5 * np.eye(n)
    differences = [(total(scores + move) - total(scores - move)) / 2e-5 for move in moves]
    np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())
