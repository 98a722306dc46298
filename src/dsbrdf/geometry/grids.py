"""The cells of a table over half and difference angles, and the angles that their values belong to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CONVENTIONS", "SHAPE", "cell_angles"]

#: Cells of a table in theta_h, theta_d and phi_d (those of the MERL database).
SHAPE = (90, 90, 180)
#: Which point of a cell its value belongs to.
CONVENTIONS = ("centre", "edge")


def cell_angles(
    convention: str = "centre", shape: tuple[int, int, int] = SHAPE
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Angles `theta_h`, `theta_d`, `phi_d` of the cells of a table, in radians.

    A cell i of n covers [i^2, (i + 1)^2) / n^2 of 90 degrees in theta_h and [i, i + 1) / n of 90 and of 180
    degrees in theta_d and phi_d. Its value belongs to its middle (half a step, in the square-root
    coordinate), or with `convention="edge"` to its lower edge.

    Raises
    ------
    ValueError
        If `convention` is neither "centre" nor "edge".
    """
    if convention not in CONVENTIONS:
        raise ValueError(f"'convention' must be 'centre' or 'edge', got {convention!r}.")
    offset = 0.5 if convention == "centre" else 0.0
    h, d, phi = ((np.arange(n) + offset) / n for n in shape)
    return np.pi / 2 * h**2, np.pi / 2 * d, np.pi * phi
