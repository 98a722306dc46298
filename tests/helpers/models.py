"""Random models and pairs of directions, for the tests of evaluation."""

import numpy as np

from dsbrdf import DSBRDF
from dsbrdf.model.evaluation import evaluate_any

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
