"""Reflectances in closed form."""

import numpy as np


def closed_form(n_channels):
    """A cheap reflectance of all three angles: a base that rises, a lobe stretched over phi_d, a rim."""
    channel = np.arange(n_channels)

    def reflectance(wi, wo):
        half = wi + wo
        squared = np.maximum((half**2).sum(-1), 1e-30)
        tan2 = (half[..., 0] ** 2 + half[..., 1] ** 2) / np.maximum(half[..., 2] ** 2, 1e-30)
        away = (wi - wo)[..., 2] ** 2
        lobe = np.exp(-tan2[..., None] / (0.05 + 0.1 * channel)) * (1.0 + away[..., None])
        rise = 0.1 + 0.4 * tan2 / (1.0 + tan2)
        rim = (1.0 - np.sqrt(squared) / 2.0) ** 5
        return rise[..., None] * (1.0 + channel) + 2.0 * lobe + rim[..., None]

    return reflectance
