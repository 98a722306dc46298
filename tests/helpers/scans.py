"""Scattered samples of a model: at given angles, and anywhere."""

import numpy as np

from dsbrdf import Samples, half_diff


def samples_at(theta_h, theta_d, phi_d, model, noise=0.0, rng=None, weights=None):
    """Of a model at given angles, without those below the horizon."""
    theta_h, theta_d, phi_d = np.broadcast_arrays(theta_h, theta_d, phi_d)
    wi, wo = half_diff.to_directions(theta_h.ravel(), theta_d.ravel(), phi_d.ravel())
    above = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    values = model(wi[above], wo[above])
    if noise:
        values = np.maximum(values * (1.0 + noise * rng.standard_normal(values.shape)), 0.0)
    return Samples("scan", wi[above], wo[above], values, weights)


def random_scan(n, rng, model, noise=0.0):
    theta_h, theta_d = np.pi / 2 * rng.random(n) ** 2, np.pi / 2 * rng.random(n)
    return samples_at(theta_h, theta_d, 2.0 * np.pi * rng.random(n), model, noise, rng)
