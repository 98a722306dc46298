"""Evaluation of a model: the compiled kernel for NumPy, and its readable twin for any array library.

The twin keeps gradients with respect to directions and parameters (PyTorch, JAX); it is what the kernel is tested
against. Both interpolate the values of the two nearest slices linearly in theta_d, and hold the first and last slice
beyond them (decision record 0004).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check, _core
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.paper.spike import SIN2_WIDTH

__all__ = ["evaluate", "evaluate_any", "evaluate_numpy"]


def evaluate(wi: Any, wo: Any, theta_d: Any, kappa: Any, gamma: Any, beta: Any, spike: Any) -> Any:
    """Values (..., channel) at pairs of directions, by the kernel where all arrays are NumPy's."""
    arrays = (wi, wo, kappa, gamma, beta, spike)
    if all(isinstance(array, np.ndarray | list | tuple) for array in arrays):
        return evaluate_numpy(wi, wo, theta_d, kappa, gamma, beta, spike)
    return evaluate_any(wi, wo, theta_d, kappa, gamma, beta, spike)


def evaluate_numpy(
    wi: Any,
    wo: Any,
    theta_d: NDArray[np.float64],
    kappa: NDArray[np.float64],
    gamma: NDArray[np.float64],
    beta: NDArray[np.float64],
    spike: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Values (..., channel) at pairs of directions (..., 3), by the compiled kernel."""
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    flat = [np.ascontiguousarray(w.reshape(-1, 3)) for w in (wi, wo)]
    values = _core.eval_slices(flat[0], flat[1], theta_d, kappa, gamma, beta, spike, AZIMUTHAL_WIDTH, SIN2_WIDTH)
    return values.reshape(*wi.shape[:-1], kappa.shape[1])


def evaluate_any(wi: Any, wo: Any, theta_d: Any, kappa: Any, gamma: Any, beta: Any, spike: Any = None) -> Any:
    """Values (..., channel) at pairs of directions (..., 3), in the library and precision of the arrays."""
    import array_api_compat

    spike = np.zeros(kappa.shape[:2]) if spike is None else spike
    arrays = [a for a in (wi, wo, kappa, gamma, beta, spike) if array_api_compat.is_array_api_obj(a)]
    foreign = [a for a in arrays if not isinstance(a, np.ndarray)] or arrays
    xp = array_api_compat.array_namespace(*foreign)
    dtype = xp.result_type(*foreign)
    device = array_api_compat.device(foreign[0])
    wi, wo, theta_d, kappa, gamma, beta, spike = (
        a if array_api_compat.is_array_api_obj(a) and not isinstance(a, np.ndarray)
        else xp.asarray(a, dtype=dtype, device=device)
        for a in (wi, wo, theta_d, kappa, gamma, beta, spike)
    )  # fmt: skip
    sin2, angle, azimuth = _coordinates(xp, wi, wo)
    log_cos = 0.5 * xp.log1p(-xp.clip(sin2, 0.0, 1.0 - 0.5 * float(xp.finfo(wi.dtype).eps)))
    cap = xp.reshape(xp.clip(1.0 - sin2 / SIN2_WIDTH, 0.0, 1.0), (-1,))[:, None]

    # Slice at or below theta_d, and the weight of the next
    n = theta_d.shape[0]
    if n > 1:
        low = xp.clip(xp.searchsorted(theta_d, angle, side="right") - 1, 0, n - 2)
        low_at, high_at = (xp.take(theta_d, xp.reshape(i, (-1,)), axis=0) for i in (low, low + 1))
        weight = xp.clip((xp.reshape(angle, (-1,)) - low_at) / (high_at - low_at), 0.0, 1.0)
        index = xp.reshape(low, (-1,))
    else:
        index = xp.zeros(xp.reshape(angle, (-1,)).shape, dtype=xp.int64, device=device)
        weight = xp.zeros(index.shape, dtype=dtype, device=device)
    upper = index + (1 if n > 1 else 0)

    log_cos, azimuth = (xp.reshape(x, (-1,))[:, None, None] for x in (log_cos, azimuth))

    def slice_value(at: Any) -> Any:
        k, g, b = (xp.take(values, at, axis=0) for values in (kappa, gamma, beta))
        lobes = xp.sum(xp.expm1(k * xp.exp(g * log_cos)) * (1.0 + b * azimuth), axis=-1)
        return lobes + xp.take(spike, at, axis=0) * cap

    total = (1.0 - weight[:, None]) * slice_value(index) + weight[:, None] * slice_value(upper)
    above = xp.reshape((wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0), (-1,))
    total = xp.where(above[:, None], total, xp.zeros_like(total))
    return xp.reshape(total, (*angle.shape, kappa.shape[1]))


def _coordinates(xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """`sin(theta_h)^2`, `theta_d`, and the azimuthal factor times `cos(2 phi_d)`; finite gradients throughout."""
    tiny = float(xp.finfo(wi.dtype).tiny) ** 0.5
    s, d = wi + wo, wi - wo
    rho2 = s[..., 0] ** 2 + s[..., 1] ** 2
    s2 = rho2 + s[..., 2] ** 2
    d2 = xp.sum(d * d, axis=-1)
    sin2 = xp.where(s2 > 0.0, rho2 / xp.where(s2 > 0.0, s2, xp.ones_like(s2)), xp.ones_like(s2))
    # A root has no gradient at zero: keep a little away from it
    angle = xp.atan2(xp.sqrt(d2 + tiny), xp.sqrt(s2 + tiny))

    along2 = d[..., 2] ** 2 * s2
    across2 = (d[..., 1] * s[..., 0] - d[..., 0] * s[..., 1]) ** 2
    both = along2 + across2
    product = both * (both + (AZIMUTHAL_WIDTH * s[..., 2]) ** 2 * s2)
    some = product > tiny * tiny
    root = xp.sqrt(xp.where(some, product, xp.ones_like(product)))
    azimuth = xp.where(some, (along2 - across2) / root, xp.zeros_like(product))
    return sin2, angle, azimuth
