"""Values of slices, by the compiled kernel.

It interpolates the values of the two nearest slices linearly in theta_d, and holds the first and last slice beyond them
(decision record 0004).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check, _core
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.paper.spike import SIN2_WIDTH

__all__ = ["evaluate"]


def evaluate(
    wi: ArrayLike,
    wo: ArrayLike,
    theta_d: NDArray[np.float64],
    kappa: NDArray[np.float64],
    gamma: NDArray[np.float64],
    beta: NDArray[np.float64],
    spike: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Values (..., channel) in 1/sr at pairs of directions (..., 3); see `dsbrdf.paper.Slices`.

    Raises
    ------
    ValueError
        If directions are not unit vectors.
    """
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    flat = [np.ascontiguousarray(w.reshape(-1, 3)) for w in (wi, wo)]
    values = _core.eval_slices(
        flat[0], flat[1], theta_d, kappa, gamma, beta, spike, AZIMUTHAL_WIDTH, SIN2_WIDTH
    )
    return values.reshape(*wi.shape[:-1], kappa.shape[1])
