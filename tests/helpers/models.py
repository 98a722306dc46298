"""Models made by hand or at random, and pairs of directions, for the tests of models and fits."""

import numpy as np
from scipy.interpolate import BSpline

from dsbrdf import DSBRDF
from dsbrdf.geometry import half_diff
from dsbrdf.model.evaluation import evaluate_any
from dsbrdf.model.lobes import Lobes

N_CHANNELS, N_LOBES = 3, 3
#: Coefficients of scale, gamma, beta, falloff and colour.
SIZES = (5, 4, 3, 1, 2)


def random_model(seed=1, sizes=SIZES, n_channels=N_CHANNELS, n_lobes=N_LOBES):
    rng = np.random.default_rng(seed)
    scale, gamma, beta, falloff, colour = sizes
    return DSBRDF(
        Lobes(
            rng.uniform(-4.0, 1.5, (n_lobes, scale)),
            rng.uniform(-1.0, 6.0, (n_lobes, gamma)),
            rng.uniform(-0.8, 0.8, (n_lobes, beta)),
            rng.uniform(-0.5, 1.5, (n_lobes, falloff)),
            rng.uniform(-0.5, 0.5, (n_channels, n_lobes, colour)),
        )
    )


def constant_model(kappa, gamma, beta=0.0, falloff=0.0, tint=(1.0, 1.0, 1.0)):
    """Lobes of one height, width, stretch and falloff (lobe,) at all theta_d; kappa times `tint` (channel,)."""
    kappa, gamma, beta, falloff = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(part, dtype=float)) for part in (kappa, gamma, beta, falloff))
    )
    colour = np.log(np.asarray(tint))[:, None, None] * np.ones((len(kappa), 1))
    parts = (np.log(kappa), np.log(gamma), beta, falloff)
    return DSBRDF(Lobes(*(part[:, None].copy() for part in parts), colour))


def curve(coefficients, x):
    """Values (..., x) of curves (..., coefficient) at x: constants, lines, and clamped quadratic B-splines."""
    coefficients = np.asarray(coefficients)
    size = coefficients.shape[-1]
    if size == 1:
        return coefficients * np.ones_like(x)
    degree = min(size - 1, 2)
    knots = np.concatenate([np.zeros(degree), np.linspace(0.0, 1.0, size - degree + 1), np.ones(degree)])
    return np.moveaxis(BSpline(knots, np.moveaxis(coefficients, -1, 0), degree)(x), 0, -1)


def by_angles(lobes, theta_h, theta_d, phi_d):
    """The formula of the model, written out: values (n, channel) at angles (n,)."""
    x, cosine = np.cos(theta_d), np.cos(theta_h)
    scale, gamma, beta, falloff = (
        curve(part, x) for part in (lobes.scale, lobes.gamma, lobes.beta, lobes.falloff)
    )
    stretch = np.exp(beta * half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d))
    kappa = np.exp(scale + curve(lobes.colour, x))
    return (np.expm1(kappa * cosine ** np.exp(gamma)) * cosine**falloff * stretch).sum(1).T


def upper(rng, *shape):
    w = rng.normal(size=(*shape, 3))
    w[..., 2] = np.abs(w[..., 2])
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def twin_eval(model, wi, wo):
    return evaluate_any(model.lobes, wi, wo)


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


def known_model():
    """Two lobes of the standard sizes, a body and a highlight, with colours of their own."""
    scale = [[-1.2, -1.1, -1.0, -1.0, -1.05, -1.1], [0.9, 0.8, 0.7, 0.6, 0.6, 0.6]]
    gamma = np.log([[1.2, 1.1, 1.0, 1.0], [60.0, 80.0, 90.0, 100.0]])
    beta = [[0.1, 0.0, -0.1], [0.3, 0.2, 0.1]]
    colour = np.multiply.outer([1.0, 0.0, -1.0], [[0.2, 0.2], [0.05, 0.1]])
    return DSBRDF(Lobes(scale, gamma, beta, [[0.3], [0.0]], colour), name="known")
