"""Exact importance sampling of a model, and its directional albedo.

A renderer knows one direction only, so theta_d is not known before sampling: half vectors are drawn from the lobes
of the slice nearest to the angle of that direction, channels averaged, and `pdf` describes just that sampler. The
azimuthal term is left to the weight. A spike is one more lobe. A share of cosine-weighted directions covers what
lobes leave out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.directions import albedo_nodes, polar
from dsbrdf.model import hemi_epd
from dsbrdf.paper import spike

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["albedo", "pdf", "sample"]

#: Share of samples that are cosine-weighted.
COSINE_SHARE = 0.1
#: Lobes dimmer than this are sampled as if they were as bright.
MIN_KAPPA = 1e-9


def _slice_lobes(
    model: DSBRDF,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return kappa and gamma (theta_d, lobe) of the lobes, and the probability of each and of the spike."""
    kappa = np.maximum(np.asarray(model.kappa).mean(1), MIN_KAPPA)
    gamma = np.asarray(model.gamma).mean(1)
    of_lobes = np.exp(-hemi_epd.log_normaliser(kappa, gamma))
    of_spike = np.asarray(model.spike).mean(1, keepdims=True) / spike.solid_angle_density(0.0)
    weight = np.concatenate([of_lobes, of_spike], axis=1)
    return kappa, gamma, weight / weight.sum(1, keepdims=True)


def _nearest_slice(model: DSBRDF, theta: NDArray[np.float64]) -> NDArray[np.int_]:
    between = 0.5 * (model.theta_d[1:] + model.theta_d[:-1])
    return np.searchsorted(between, theta)


def sample(model: DSBRDF, wo: ArrayLike, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw directions toward the light; see `DSBRDF.sample`."""
    wo = _check.unit_vectors(wo, "wo")
    flat = wo.reshape(-1, 3)
    n = len(flat)
    kappa, gamma, weight = _slice_lobes(model)
    index = _nearest_slice(model, np.arccos(np.clip(flat[:, 2], -1.0, 1.0)))
    lobe = (rng.random(n)[:, None] > np.cumsum(weight, axis=1)[index]).sum(1)
    of_spike = lobe >= model.n_lobes
    lobe = np.minimum(lobe, model.n_lobes - 1)
    sin_h = np.sin(hemi_epd.sample(kappa[index, lobe], gamma[index, lobe], rng))
    sin_h = np.where(of_spike, np.sqrt(spike.sample_sin2(rng, n)), sin_h)
    phi = 2.0 * np.pi * rng.random(n)
    half = polar(sin_h, np.sqrt((1.0 - sin_h) * (1.0 + sin_h)), phi)
    mirrored = 2.0 * (half * flat).sum(1, keepdims=True) * half - flat

    radius2 = rng.random(n)
    cosine = polar(np.sqrt(radius2), np.sqrt(1.0 - radius2), phi)
    take_cosine = rng.random(n) < COSINE_SHARE
    return np.where(take_cosine[:, None], cosine, mirrored).reshape(wo.shape)


def pdf(model: DSBRDF, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
    """Density of `sample`; see `DSBRDF.pdf`."""
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    above = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
    theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
    kappa, gamma, weight = _slice_lobes(model)
    index = _nearest_slice(model, np.arccos(np.clip(wo[..., 2], -1.0, 1.0)))
    safe_theta_h = np.where(above, theta_h, 0.0)[..., None]
    # hemi_epd.pdf with the few normalisers there are
    log_c = hemi_epd.log_normaliser(kappa, gamma)[index]
    of_half = np.exp(log_c) * hemi_epd.lobe(safe_theta_h, kappa[index], gamma[index])
    density = (weight[index][..., :-1] * of_half).sum(-1)
    density += weight[index][..., -1] * spike.solid_angle_density(np.sin(safe_theta_h[..., 0]) ** 2)
    jacobian = 1.0 / (4.0 * np.maximum(np.cos(theta_d), 1e-12))
    total = COSINE_SHARE * np.maximum(wi[..., 2], 0.0) / np.pi + (1.0 - COSINE_SHARE) * density * jacobian
    return np.where(above, total, 0.0)


def albedo(model: DSBRDF, theta_i: ArrayLike) -> NDArray[np.float64]:
    """Directional albedo by quadrature over the half vector; see `DSBRDF.albedo`.

    The half vector's theta_h has Gauss-Legendre panels that shrink toward the pole, so that lobes of any width are
    met, and `d omega_o = 4 (wi . h) d omega_h`.
    """
    theta_i = _check.angle(theta_i, "theta_i")
    result = np.zeros((*theta_i.shape, model.n_channels))
    for position, theta in np.ndenumerate(theta_i):
        wi, wo, weight = albedo_nodes(theta)
        result[position] = (model.eval(wi, wo) * weight[:, None]).sum(0)
    return result
