"""Which angles make up a picture."""

from __future__ import annotations

import numpy as np

from dsbrdf.fitting.coverage import LEAST_AZIMUTH, N_STEPS, STEP, Coverage
from dsbrdf.images.search import Problem
from dsbrdf.model.lobes import Lobes

__all__ = ["of"]

#: Angles count as seen where they make up this share of some pixel.
SEEN = 0.02


def of(problem: Problem, lobes: Lobes) -> Coverage:
    """The coverage of pictures of what has these lobes."""
    log_cos, x = problem.nodes.positions
    values = problem.nodes.values(lobes)
    n = len(x)
    theta_h, theta_d = np.arccos(np.exp(log_cos)), np.arccos(np.clip(x, 0.0, 1.0))
    at = [np.clip((theta / STEP).astype(int), 0, N_STEPS - 1) for theta in (theta_d, theta_h)]
    place = at[0] * N_STEPS + at[1]
    shares = np.zeros(N_STEPS**2)
    for c, weights in enumerate(problem.weights):
        of_node = weights * values[:, c]
        made = np.maximum(of_node.sum(1), 1e-300)
        of_position = of_node.reshape(len(weights), n, -1).sum(-1)
        by_cell = np.stack([of_position[:, place == cell].sum(1) for cell in range(N_STEPS**2)], axis=1)
        shares = np.maximum(shares, (by_cell / made[:, None]).max(0))
    cells = (shares > SEEN).reshape(N_STEPS, N_STEPS)
    limits = []
    for axis in (1, 0):
        seen = np.flatnonzero(cells.any(axis))
        low, high = (int(seen.min()), int(seen.max()) + 1) if len(seen) else (0, N_STEPS)
        limits.append((low * STEP, high * STEP))
    azimuth = np.abs(problem.weights).reshape(-1, n, 3).sum((0, 1))
    spread = 2.0 * min(azimuth[0], azimuth[2]) / max(azimuth.sum(), 1e-300)
    return Coverage(len(problem.pixels), limits[0], limits[1], cells, bool(spread > 0.1 * LEAST_AZIMUTH), ())
