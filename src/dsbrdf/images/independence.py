"""How many independent pixels a picture is worth, from the residuals of a fit (decision record 0024).

Residuals of neighbouring pixels are alike where the model, and not the noise, is wrong. With rho the correlation of the
residuals of two pixels at some angle between their normals, n pixels are worth `n^2 / sum_ij rho_ij` (Bartlett's
formula for the variance of a mean).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["independent"]

Array = NDArray[np.float64]

#: Angles between normals, degrees, that share a correlation.
EDGES = np.array([0.0, 3.0, 6.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 180.0])
#: A picture is worth this at least.
LEAST = 20.0


def independent(residual: Array, normals: Array, groups: NDArray[np.int_]) -> float:
    """What residuals (pixel, channel) with normals (pixel, 3) are worth; pictures (pixel,) do not mix."""
    total = 0.0
    for group in np.unique(groups):
        some = groups == group
        total += _of_picture(residual[some], normals[some])
    return max(total, LEAST)


def _of_picture(residual: Array, normals: Array) -> float:
    n = len(residual)
    angle = np.rad2deg(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)))
    apart = np.digitize(angle, EDGES) - 1
    apart[np.diag_indices(n)] = -1
    products = residual @ residual.T
    variance = float(np.diag(products).mean())
    if variance <= 0.0:
        return float(n)
    total = float(n)
    for k in range(len(EDGES) - 1):
        pairs = apart == k
        count = int(pairs.sum())
        if not count:
            continue
        rho = float(products[pairs].sum()) / (count * variance)
        if rho <= 0.0:
            break
        total += rho * count
    return n * n / total
