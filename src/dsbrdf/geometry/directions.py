"""Directions of polar angles, and the pairs of directions over which an albedo is integrated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["albedo_nodes", "polar"]


def polar(
    sin_theta: NDArray[np.float64], cos_theta: NDArray[np.float64], phi: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Directions (..., 3) of sine and cosine of the polar angle and of an azimuth, which broadcast."""
    x, y, z = np.broadcast_arrays(sin_theta * np.cos(phi), sin_theta * np.sin(phi), cos_theta)
    return np.stack([x, y, z], axis=-1)


def albedo_nodes(
    theta_i: float, n_phi: int = 128
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Direction (3,) toward the light, those (n, 3) toward the viewer, and the weights (n,) of values in the albedo."""
    edges = np.concatenate([[0.0], np.geomspace(1e-4, np.pi / 2, 28)])
    node, node_weight = np.polynomial.legendre.leggauss(8)
    low, width = edges[:-1, None], np.diff(edges)[:, None]
    theta_h = (low + 0.5 * width * (node + 1.0)).ravel()
    weight_h = (0.5 * width * node_weight).ravel() * np.sin(theta_h)
    phi = np.pi * (np.arange(n_phi) + 0.5) / n_phi
    half = polar(np.sin(theta_h)[:, None], np.cos(theta_h)[:, None], phi)
    wi = np.array([np.sin(theta_i), 0.0, np.cos(theta_i)])
    cos_d = half @ wi
    wo = 2.0 * cos_d[..., None] * half - wi
    some = (cos_d > 0.0) & (wo[..., 2] > 0.0)
    jacobian = 4.0 * cos_d * wo[..., 2] * weight_h[:, None] * (2.0 * np.pi / n_phi)
    return wi, wo[some], jacobian[some]
