"""A lighting of our own, which shows highlights and grazing angles where no environment map is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import panorama

__all__ = ["LIGHTS", "Softbox", "radiance", "studio"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Softbox:
    """A rectangle of light that faces the scene.

    Parameters
    ----------
    toward : (float, float, float)
        Direction of its middle; x is to the right, y up, z toward the camera.
    half_size : (float, float)
        Half its width and height, as tangents of the angles they are seen under.
    radiance : (float, float, float)
        Linear RGB.
    edge : float
        Width of its soft edge, a tangent.
    """

    toward: tuple[float, float, float]
    half_size: tuple[float, float]
    radiance: tuple[float, float, float]
    edge: float = 0.03


#: A wide key light above on the left, a strip on the right, a lamp for sharp highlights, two rims behind for what
#: is seen at grazing angles.
LIGHTS = (
    Softbox((-0.75, 0.8, 0.75), (0.42, 0.42), (9.0, 8.6, 8.0)),
    Softbox((1.0, 0.1, 0.45), (0.12, 0.75), (5.0, 5.6, 6.4)),
    Softbox((0.45, 0.85, 0.8), (0.05, 0.05), (160.0, 150.0, 135.0), 0.01),
    Softbox((-0.75, 0.15, -0.75), (0.22, 0.6), (9.0, 9.4, 10.0)),
    Softbox((0.5, 0.75, -0.9), (0.5, 0.16), (8.0, 7.6, 7.0)),
)
#: Radiance of the room: above, at the horizon, below.
ROOM = ((0.30, 0.32, 0.36), (0.14, 0.14, 0.15), (0.05, 0.045, 0.04))


def studio(height: int = 256) -> Array:
    """An environment map of `LIGHTS` in a dim room.

    Parameters
    ----------
    height : int, optional
        Rows; twice as many columns.

    Returns
    -------
    (height, 2 height, 3) ndarray
        Radiance, linear RGB, in the frame of `dsbrdf.geometry.panorama`.
    """
    return radiance(panorama.directions(height, 2 * height))


def radiance(direction: Array) -> Array:
    """Radiance (..., 3) of the studio from unit vectors (..., 3); x is to the right, y up, z toward the camera."""
    above, level, below = (np.array(colour) for colour in ROOM)
    up = direction[..., 1:2]
    light = level + np.maximum(up, 0.0) * (above - level) + np.maximum(-up, 0.0) * (below - level)
    for box in LIGHTS:
        light = light + _cover(direction, box)[..., None] * np.array(box.radiance)
    return np.asarray(light)


def _cover(direction: Array, light: Softbox) -> Array:
    """How much of a light is seen in each direction, 0 to 1."""
    axis = np.array(light.toward) / np.linalg.norm(light.toward)
    across = np.cross([0.0, 1.0, 0.0], axis)
    across /= np.linalg.norm(across)
    depth = direction @ axis
    cover = np.where(depth > 0.0, 1.0, 0.0)
    for tangent, half in ((across, light.half_size[0]), (np.cross(axis, across), light.half_size[1])):
        at = np.abs(direction @ tangent) / np.maximum(depth, 1e-6)
        cover *= np.clip((half - at) / light.edge + 0.5, 0.0, 1.0)
    return cover
