"""Random models of slices, and a readable twin of their kernel."""

import numpy as np

from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.paper import SliceProfile, Slices
from dsbrdf.paper.spike import SIN2_WIDTH

N_SLICES, N_CHANNELS, N_LOBES = 7, 3, 3


def random_slices(seed=1, n_slices=N_SLICES, n_channels=N_CHANNELS, n_lobes=N_LOBES):
    rng = np.random.default_rng(seed)
    shape = (n_slices, n_channels, n_lobes)
    return Slices(
        np.sort(rng.uniform(0.05, 1.5, n_slices)),
        10.0 ** rng.uniform(-2.0, 0.8, shape),
        10.0 ** rng.uniform(-1.0, 3.0, shape),
        rng.uniform(-0.95, 0.95, shape),
        rng.uniform(0.0, 50.0, shape[:2]),
    )


def smooth_slices(seed, basis, variables, n_lobes=3, n_channels=3, theta_d=None, **fields):
    """Slices whose variables are splines: diffuse, then sharper and sharper lobes."""
    rng = np.random.default_rng(seed)
    theta_d = np.linspace(0.0, np.pi / 2, 19) if theta_d is None else theta_d
    level = np.array([[-3.5, 1.8], [-2.5, 3.8], [-1.0, 5.5], [0.0, 7.0]])[:n_lobes, :, None]
    # Channels are alike
    common, own = rng.normal(size=(1, n_lobes, 2, 1)), rng.normal(size=(n_channels, n_lobes, 2, basis.size))
    values = np.einsum("tc,klfc->tklf", basis.design(theta_d), level + 0.3 * common + 0.2 * own)
    order = rng.permutation(n_lobes)
    kappa, gamma = (x[:, :, order] for x in variables.parameters(values))
    return Slices(theta_d, kappa, gamma, name=fields.pop("name", f"material-{seed}"), **fields)


def profile_of(theta_d, theta_h, phi_d, values, weights=None):
    """A slice of samples (sample, channel) at any angles (sample,), each of which counts its weight."""
    weights = np.ones(len(values)) if weights is None else np.asarray(weights)
    nodes, index = np.unique(np.asarray(theta_h, dtype=float), return_inverse=True)
    values, c = np.asarray(values, dtype=float), np.cos(2.0 * np.asarray(phi_d))[:, None]
    w = weights[:, None] * np.isfinite(values)
    f = np.where(np.isfinite(values), values, 0.0)
    moments = np.zeros((len(nodes), values.shape[1], 6))
    np.add.at(moments, index, np.stack([w, w * f, w * f * f, w * c, w * c * c, w * f * c], axis=-1))
    return SliceProfile(theta_d, nodes, np.ascontiguousarray(moments.swapaxes(0, 1)))


def upper(rng, *shape):
    w = rng.normal(size=(*shape, 3))
    w[..., 2] = np.abs(w[..., 2])
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def twin_eval(model, wi, wo):
    """Values (..., channel) by the formula of `Slices`, from differences that do not cancel."""
    s, d = wi + wo, wi - wo
    across, s2, d2 = (s[..., :2] ** 2).sum(-1), (s**2).sum(-1), (d**2).sum(-1)
    sin2 = np.divide(across, s2, out=np.ones_like(s2), where=s2 > 0.0)
    log_cos = 0.5 * np.log1p(-np.minimum(sin2, 1.0 - 2.0**-53))
    along2, turn2 = d[..., 2] ** 2 * s2, (d[..., 1] * s[..., 0] - d[..., 0] * s[..., 1]) ** 2
    both = along2 + turn2
    root = np.sqrt(both * (both + (AZIMUTHAL_WIDTH * s[..., 2]) ** 2 * s2))
    azimuth = np.divide(along2 - turn2, root, out=np.zeros_like(root), where=root > 0.0)
    theta_d = np.arctan2(np.sqrt(d2), np.sqrt(s2))

    low = np.clip(
        np.searchsorted(model.theta_d, theta_d, side="right") - 1, 0, max(len(model.theta_d) - 2, 0)
    )
    high = np.minimum(low + 1, len(model.theta_d) - 1)
    step = np.where(high > low, model.theta_d[high] - model.theta_d[low], 1.0)
    weight = np.clip((theta_d - model.theta_d[low]) / step, 0.0, 1.0)[..., None]

    def at(index):
        height = model.kappa[index] * np.exp(model.gamma[index] * log_cos[..., None, None])
        lobes = np.expm1(height) * (1.0 + model.beta[index] * azimuth[..., None, None])
        return lobes.sum(-1) + model.spike[index] * np.maximum(1.0 - sin2 / SIN2_WIDTH, 0.0)[..., None]

    above = (wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0)
    return np.where(above[..., None], (1.0 - weight) * at(low) + weight * at(high), 0.0)
