"""Pictures of spheres under two distant lights or in a lit room, from a table or from a model, without a renderer."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import half_diff, lighting
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["LIGHTS", "picture", "shade", "shade_in_room"]

Array = NDArray[np.float64]

#: Direction toward each light (x right, y up, z toward the viewer) and its irradiance: the main one at 45
#: degrees, above on the left, and a weak one on the right.
LIGHTS = (((-0.5, 0.5, 0.70711), 1.0), ((0.8, -0.2, 0.56569), 0.15))
#: Of `shade_in_room`: angles of normals and of lights from the viewer, azimuths of lights around it.
N_NORMALS, N_ALPHA, N_AZIMUTH = 40, 128, 256


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


def shade_in_room(reflectance: DSBRDF | MeasuredBRDF, n_pixels: int = 128) -> Array:
    """Radiance of a sphere seen from afar in the room of `dsbrdf.geometry.lighting`, without cast light or noise.

    All that a normal sees is turned about the viewer's axis where the normal is turned. So reflectance is evaluated
    for one normal an angle, and a circular convolution over the azimuth gives all others.

    Parameters
    ----------
    reflectance : MeasuredBRDF, DSBRDF, or another model with `eval` and `n_channels`
        Three channels are lit as red, green and blue; others by the mean of these.
    n_pixels : int, optional
        Width and height.

    Returns
    -------
    (n_pixels, n_pixels, channel) ndarray
        Zero outside the sphere; first row on top.
    """
    from scipy.ndimage import map_coordinates

    n_channels = reflectance.n_channels
    light = _room()
    if n_channels != 3:
        light = light.mean(-1, keepdims=True)
    # The last normals are beyond the rim, for pixels on it
    theta = np.linspace(0.0, np.pi / 2, N_NORMALS)
    kernel = np.stack([_arriving(reflectance, angle) for angle in theta])
    # The kernel is even in the azimuth, its transform real
    turned = np.einsum("nakc,akc->nkc", np.fft.rfft(kernel, axis=2).real, light)
    seen = np.fft.irfft(turned, n=N_AZIMUTH, axis=1)

    x, y = _grid(n_pixels)
    r = np.hypot(x, y)
    inside = r < 1.0
    row = np.arcsin(r[inside]) / (np.pi / 2) * (N_NORMALS - 1)
    column = np.arctan2(y, x)[inside] / (2.0 * np.pi) * N_AZIMUTH
    # Turns are periodic, angles are not: pad the former
    wide = np.concatenate([seen, seen, seen], axis=1)
    image = np.zeros((n_pixels, n_pixels, n_channels))
    for channel in range(n_channels):
        at = (row, column + N_AZIMUTH)
        image[inside, channel] = map_coordinates(wide[..., channel], at, order=1, mode="nearest")
    return np.maximum(image, 0.0)


def _polar(n: int = 1) -> tuple[Array, Array]:
    """Angles (alpha, 1) from the viewer and azimuths (azimuth,) around it, each cell divided into n x n."""
    alpha = (np.arange(n * N_ALPHA) + 0.5) * np.pi / (n * N_ALPHA)
    # One cell begins at azimuth 0, so that both sides of the plane of normal and viewer are alike
    phi = (np.arange(n * N_AZIMUTH) + 0.5 - 0.5 * n) * 2.0 * np.pi / (n * N_AZIMUTH)
    return alpha[:, None], phi


@functools.cache
def _room() -> NDArray[np.complex128]:
    """Radiance of the room, means over cells, transformed over the azimuth: (alpha, frequency, 3)."""
    n = 2
    alpha, phi = _polar(n)
    parts = (np.sin(alpha) * np.cos(phi), np.sin(alpha) * np.sin(phi), np.cos(alpha))
    light = lighting.radiance(np.stack(np.broadcast_arrays(*parts), axis=-1))
    return np.asarray(np.fft.rfft(light.reshape(N_ALPHA, n, N_AZIMUTH, n, 3).mean((1, 3)), axis=1))


def _arriving(reflectance: DSBRDF | MeasuredBRDF, theta: float) -> Array:
    """What a normal at an angle from the viewer, at azimuth 0, sends there of each cell's light (alpha, azimuth, c)."""
    alpha, phi = _polar()
    half = N_AZIMUTH // 2 + 1
    x, y, z = np.broadcast_arrays(np.sin(alpha) * np.cos(phi), np.sin(alpha) * np.sin(phi), np.cos(alpha))
    cosine = np.sin(theta) * x + np.cos(theta) * z
    lit = cosine > 0.0
    # The other half is the mirror image
    lit[:, half:] = False
    wi = np.stack([np.cos(theta) * x - np.sin(theta) * z, y, cosine], axis=-1)[lit]
    wi /= np.linalg.norm(wi, axis=-1, keepdims=True)
    wo = np.broadcast_to([-np.sin(theta), 0.0, np.cos(theta)], wi.shape)
    is_table = isinstance(reflectance, MeasuredBRDF)
    value = _look_up(reflectance, wi, wo) if is_table else reflectance.eval(wi, wo)  # type: ignore[arg-type]
    cell = np.sin(alpha) * (np.pi / N_ALPHA) * (2.0 * np.pi / N_AZIMUTH)
    kernel = np.zeros((N_ALPHA, N_AZIMUTH, reflectance.n_channels))
    kernel[lit] = (np.broadcast_to(cell, lit.shape) * cosine)[lit][:, None] * value
    kernel[:, half:] = kernel[:, half - 2 : 0 : -1]
    return kernel


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
