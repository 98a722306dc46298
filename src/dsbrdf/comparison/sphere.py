"""How a sphere looks in a fixed light, by quadrature: no renderer, no noise.

The light comes from all around and is grey, `L(d) = 0.15 + 0.1 d_y + sum_j s_j exp(kappa_j (d . m_j - 1))`: a sky, and
soft lamps (x right, y up, z toward the viewer, who is far away). A sphere has the same reflectance all over, so that
what a point reflects needs the reflectance at one angle of view only, at nodes about the mirror direction that are
dense where lobes are narrow; a circle about the middle of the sphere shares them. Light and view count within 80
degrees of the normal: beyond, few instruments measure well.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import directions
from dsbrdf.geometry.colour import LUMINANCE
from dsbrdf.geometry.colour_difference import ciede2000, lab

__all__ = ["LAMPS", "SIZE", "SKY", "difference", "exposure", "light", "picture", "radiance"]

Array = NDArray[np.float64]

#: Radiance of the sky, and its growth with y.
SKY = (0.15, 0.10)
#: Direction, kappa and radiance of each lamp: above on the left, on the right, and behind the sphere.
LAMPS = (((-0.6, 0.6, 0.53), 40.0, 12.0), ((0.85, 0.1, 0.5), 12.0, 1.5), ((0.3, 0.6, -0.74), 40.0, 6.0))
#: Circles of equal area about the middle, and points of each.
SIZE = (16, 32)
#: Of the light that is integrated over.
N_PHI = 24
LEAST_COSINE = float(np.cos(np.deg2rad(80.0)))
#: Mean luminance that the sphere of the measurement is brought to.
MEAN_LUMINANCE = 0.22


def light(d: Array) -> Array:
    """Radiance (...) from directions (..., 3)."""
    total = SKY[0] + SKY[1] * d[..., 1]
    for toward, kappa, strength in LAMPS:
        total = total + strength * np.exp(kappa * (d @ (np.array(toward) / np.linalg.norm(toward)) - 1.0))
    return np.asarray(total)


@lru_cache(maxsize=2)
def _nodes(size: tuple[int, int]) -> tuple[Array, Array, list[Array]]:
    """Directions of light and view (node, 3) of all circles, and of each circle the weights (azimuth, node)."""
    n_radii, n_azimuths = size
    sin = np.sqrt((np.arange(n_radii) + 0.5) / n_radii * (1.0 - LEAST_COSINE**2))
    azimuth = 2.0 * np.pi * (np.arange(n_azimuths) + 0.5) / n_azimuths
    lights, views, weights = [], [], []
    for s in sin:
        view, wo, weight = directions.albedo_nodes(float(np.arcsin(s)), N_PHI)
        kept = wo[:, 2] > LEAST_COSINE
        wo, weight = wo[kept], weight[kept]
        normal = directions.polar(s, view[2], azimuth)
        along = (np.array([0.0, 0.0, 1.0]) - view[2] * normal) / s
        frame = np.stack([along, np.cross(normal, along), normal], axis=1)
        # What is at one side of the plane of view and normal has the reflectance of what is at the other
        arriving = 0.5 * (light(wo @ frame) + light((wo * [1.0, -1.0, 1.0]) @ frame))
        lights.append(wo)
        views.append(np.broadcast_to(view, wo.shape))
        weights.append(arriving * weight)
    return np.concatenate(lights), np.concatenate(views), weights


def radiance(reflectance: Any, size: tuple[int, int] = SIZE) -> Array:
    """Radiance (radius, azimuth, channel) of a sphere of anything with `eval`."""
    wi, wo, weights = _nodes(size)
    parts = np.split(np.asarray(reflectance.eval(wi, wo)), np.cumsum([w.shape[1] for w in weights])[:-1])
    return np.stack([w @ values for w, values in zip(weights, parts, strict=True)])


def exposure(reference: Array) -> float:
    """Factor that brings the mean luminance of a sphere to `MEAN_LUMINANCE`."""
    mean = float((reference @ LUMINANCE).mean())
    return MEAN_LUMINANCE / mean if mean > 0.0 else 1.0


def difference(sphere: Array, reference: Array) -> float:
    """Mean CIEDE2000 of two spheres (radius, azimuth, rgb), both under the exposure of the reference, clipped at 1."""
    factor = exposure(reference)
    shown, wanted = (lab(np.clip(factor * x, 0.0, 1.0)) for x in (sphere, reference))
    return float(ciede2000(shown, wanted).mean())


def picture(sphere: Array, factor: float, n: int = 128) -> Array:
    """Picture (n, n, rgba) in [0, 1] of a sphere (radius, azimuth, rgb) under an exposure, gamma 2.2."""
    from scipy.ndimage import map_coordinates

    at = (np.arange(n) + 0.5) * 2.0 / n - 1.0
    x, y = np.meshgrid(at, -at)
    radius, azimuth = np.hypot(x, y), np.arctan2(y, x) % (2.0 * np.pi)
    n_radii, n_azimuths = sphere.shape[:2]
    place = radius**2 / (1.0 - LEAST_COSINE**2) * n_radii
    # The middle is the mean of the first circle, half a step inside of it
    row = np.clip(np.where(place < 0.5, 2.0 * place, place + 0.5), 0.0, n_radii)
    column = azimuth / (2.0 * np.pi) * n_azimuths + 0.5
    middle = np.broadcast_to(sphere[:1].mean(1, keepdims=True), sphere[:1].shape)
    whole = np.concatenate([middle, sphere])
    around = np.concatenate([whole[:, -1:], whole, whole[:, :1]], axis=1)
    channels = [map_coordinates(around[..., c], [row, column], order=1, mode="nearest") for c in range(3)]
    cover = np.clip((1.0 - radius) * n / 2, 0.0, 1.0)
    rgb = np.clip(factor * np.stack(channels, axis=-1), 0.0, 1.0) ** (1 / 2.2)
    return np.concatenate([rgb, cover[..., None]], axis=-1)
