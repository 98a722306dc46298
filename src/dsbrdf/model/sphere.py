"""Pictures of spheres under two distant lights, from a table or from a model; NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["LIGHTS", "picture", "shade"]

Array = NDArray[np.float64]

#: Direction toward each light (x right, y up, z toward the viewer) and its irradiance: the main one at 45
#: degrees, above on the left, and a weak one on the right.
LIGHTS = (((-0.5, 0.5, 0.70711), 1.0), ((0.8, -0.2, 0.56569), 0.15))


def shade(reflectance: DSBRDF | MeasuredBRDF, n_pixels: int = 128) -> Array:
    """Radiance of a sphere seen from afar under `LIGHTS`, without cast light.

    Parameters
    ----------
    reflectance : MeasuredBRDF, DSBRDF, or another model with `eval` and `n_channels`
        Of a table, the cell that holds the angles is taken.
    n_pixels : int, optional
        Width and height.

    Returns
    -------
    (n_pixels, n_pixels, channel) ndarray
        Zero outside the sphere; first row on top.
    """
    x, y = _grid(n_pixels)
    inside = x * x + y * y < 1.0
    normal = np.stack([x[inside], y[inside], np.sqrt(1.0 - x[inside] ** 2 - y[inside] ** 2)], axis=-1)
    wo = _local(normal, np.array([0.0, 0.0, 1.0]))
    image = np.zeros((n_pixels, n_pixels, reflectance.n_channels))
    for toward, irradiance in LIGHTS:
        light = np.array(toward) / np.linalg.norm(toward)
        wi = _local(normal, light)
        is_table = isinstance(reflectance, MeasuredBRDF)
        value = _look_up(reflectance, wi, wo) if is_table else reflectance.eval(wi, wo)  # type: ignore[arg-type]
        image[inside] += irradiance * np.maximum(wi[:, 2:], 0.0) * value
    return image


def picture(radiance: Array, exposure: float) -> Array:
    """RGBA (n, n, 4) in [0, 1] of `exposure` times what `shade` gives, gamma 2.2; clear off the sphere."""
    if radiance.shape[-1] != 3:
        radiance = np.repeat(radiance.mean(-1, keepdims=True), 3, axis=-1)
    n = len(radiance)
    cover = np.clip((1.0 - np.hypot(*_grid(n))) * n / 2, 0.0, 1.0)
    return np.concatenate([np.clip(exposure * radiance, 0.0, 1.0) ** (1 / 2.2), cover[..., None]], axis=-1)


def _grid(n: int) -> tuple[Array, Array]:
    """Coordinates x and y (n, n) in (-1, 1) of the middles of pixels, y upward."""
    at = (np.arange(n) + 0.5) * 2.0 / n - 1.0
    x, y = np.meshgrid(at, -at)
    return x, y


def _local(normal: Array, direction: Array) -> Array:
    """A direction in frames (..., 3) whose z is `normal`."""
    tangent = np.stack([normal[:, 2], np.zeros(len(normal)), -normal[:, 0]], axis=-1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    bitangent = np.cross(normal, tangent)
    return np.stack([tangent @ direction, bitangent @ direction, normal @ direction], axis=-1)


def _look_up(measured: MeasuredBRDF, wi: Array, wo: Array) -> Array:
    """Values (..., channel) of the cells that hold pairs of directions; zero where invalid."""
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    n_h, n_d, n_phi = measured.planes.shape[1:]
    i = np.minimum(np.sqrt(theta_h / (np.pi / 2)) * n_h, n_h - 1).astype(int)
    j = np.minimum(theta_d / (np.pi / 2) * n_d, n_d - 1).astype(int)
    k = np.minimum(phi_d % np.pi / np.pi * n_phi, n_phi - 1).astype(int)
    values = np.moveaxis(measured.planes[:, i, j, k], 0, -1)
    return np.where((values >= 0.0) & (values < np.inf), values, 0.0) * measured.scale
