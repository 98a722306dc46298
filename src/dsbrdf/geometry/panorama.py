"""Environment maps: the latitude-longitude frame of Mitsuba's `envmap`, x to the right, y up, z toward the camera.

The direction of column u and row v, both in [0, 1] and row 0 at the top, is
`(sin(2 pi u) sin(pi v), cos(pi v), -cos(2 pi u) sin(pi v))`: the middle column is on the camera's side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["directions", "solid_angles"]


def directions(height: int, width: int) -> NDArray[np.float64]:
    """Unit vectors (height, width, 3) toward the middles of the pixels of a map."""
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2.0 * np.pi * (np.arange(width) + 0.5) / width
    parts = (np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Solid angles (height, 1) of the pixels of a map; all together are the sphere."""
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return (2.0 * np.pi / width) * (edges[:-1] - edges[1:])[:, None]
