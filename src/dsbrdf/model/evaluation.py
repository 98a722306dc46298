"""Values of lobes: the compiled kernel for NumPy, and its readable twin for any array library.

The twin keeps gradients with respect to directions and parameters (PyTorch, JAX); it is what the kernel is tested
against.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check, _core
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes

__all__ = ["evaluate", "evaluate_any", "evaluate_numpy"]

#: Greatest exponent of a lobe's factor.
MAX_FACTOR = 300.0


def evaluate(lobes: Lobes, wi: Any, wo: Any) -> Any:
    """Values (..., channel) at pairs of directions, by the kernel unless an array is of another library."""
    if all(
        isinstance(array, np.ndarray | list | tuple | str | int | float) for array in (wi, wo, *lobes.parts)
    ):
        return evaluate_numpy(lobes, wi, wo)
    return evaluate_any(lobes, wi, wo)


def evaluate_numpy(lobes: Lobes, wi: Any, wo: Any) -> NDArray[np.float64]:
    """Values (..., channel) at pairs of directions (..., 3), by the compiled kernel."""
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    flat = [np.ascontiguousarray(w.reshape(-1, 3)) for w in (wi, wo)]
    values = _core.eval(
        flat[0],
        flat[1],
        lobes.scale,
        lobes.gamma,
        lobes.beta,
        lobes.falloff,
        lobes.colour,
        AZIMUTHAL_WIDTH,
    )
    return values.reshape(*wi.shape[:-1], lobes.n_channels)


def evaluate_any(lobes: Lobes, wi: Any, wo: Any) -> Any:
    """Values (..., channel) at pairs of directions (..., 3), in the library and precision of the arrays."""
    import array_api_compat

    arrays = [a for a in (wi, wo, *lobes.parts) if array_api_compat.is_array_api_obj(a)]
    foreign = [a for a in arrays if not isinstance(a, np.ndarray)] or arrays
    xp = array_api_compat.array_namespace(*foreign)
    dtype = xp.result_type(*foreign)
    device = array_api_compat.device(foreign[0])
    wi, wo, scale, gamma, beta, falloff, colour = (
        a if array_api_compat.is_array_api_obj(a) and not isinstance(a, np.ndarray)
        else xp.asarray(a, dtype=dtype, device=device)
        for a in (wi, wo, *lobes.parts)
    )  # fmt: skip
    for name, w in (("wi", wi), ("wo", wo)):
        _check.unit_vectors_any(xp, w, name)
    sin2, x, azimuth = _coordinates(xp, wi, wo)
    log_cos = 0.5 * xp.log1p(-xp.clip(sin2, 0.0, 1.0 - 0.5 * float(xp.finfo(wi.dtype).eps)))
    shape = x.shape
    x, log_cos, azimuth = (xp.reshape(part, (-1, 1)) for part in (x, log_cos, azimuth))

    ln_gamma, b, fall, ln_kappa = (_curve(xp, part, x) for part in (gamma, beta, falloff, scale))
    factor = xp.exp(xp.clip(b * azimuth + fall * log_cos, -MAX_FACTOR, MAX_FACTOR))
    power = ln_kappa + xp.exp(ln_gamma) * log_cos
    n_channels, n_lobes, size = colour.shape
    added = xp.reshape(_curve(xp, xp.reshape(colour, (-1, size)), x), (-1, n_channels, n_lobes))
    kappa_power = xp.exp(xp.clip(power[:, None, :] + added, -700.0, MAX_LN_KAPPA))
    total = xp.sum(xp.expm1(kappa_power) * factor[:, None, :], axis=-1)

    above = xp.reshape((wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0), (-1,))
    total = xp.where(above[:, None], total, xp.zeros_like(total))
    return xp.reshape(total, (*shape, n_channels))


def _curve(xp: Any, coefficients: Any, x: Any) -> Any:
    """Values (x, curve) of curves (curve, coefficient) at x (x, 1)."""
    size = coefficients.shape[1]
    if size == 1:
        return coefficients[:, 0][None, :] + 0.0 * x
    if size == 2:
        low, high = coefficients[:, 0][None, :], coefficients[:, 1][None, :]
        return low + (high - low) * x
    spans = size - 2
    at = x[:, 0] * spans
    # The spans of x, as knots passed: no library's rounding or casting of gradients
    # Of 32 bits, as JAX has no more by default
    span = xp.zeros(at.shape, dtype=xp.int32, device=_device(at))
    for knot in range(1, spans):
        span = span + xp.astype(at >= knot, xp.int32)
    u = (at - xp.astype(span, at.dtype))[:, None]
    one, half = xp.ones_like(u), 0.5 * xp.ones_like(u)
    low = (1.0 - u) ** 2 * xp.where((span == 0)[:, None], one, half)
    high = u**2 * xp.where((span == spans - 1)[:, None], one, half)
    columns = xp.permute_dims(coefficients, (1, 0))
    first, middle, last = (xp.take(columns, span + i, axis=0) for i in range(3))
    return low * first + (1.0 - low - high) * middle + high * last


def _device(array: Any) -> Any:
    import array_api_compat

    return array_api_compat.device(array)


def _coordinates(xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """`sin(theta_h)^2`, `cos(theta_d)`, and the azimuthal factor times `cos(2 phi_d)`; finite gradients throughout."""
    tiny = float(xp.finfo(wi.dtype).tiny) ** 0.5
    s, d = wi + wo, wi - wo
    rho2 = s[..., 0] ** 2 + s[..., 1] ** 2
    s2 = rho2 + s[..., 2] ** 2
    sin2 = xp.where(s2 > 0.0, rho2 / xp.where(s2 > 0.0, s2, xp.ones_like(s2)), xp.ones_like(s2))
    # A root has no gradient at zero: keep a little away from it
    x = xp.clip(0.5 * xp.sqrt(s2 + tiny), 0.0, 1.0)

    along2 = d[..., 2] ** 2 * s2
    across2 = (d[..., 1] * s[..., 0] - d[..., 0] * s[..., 1]) ** 2
    both = along2 + across2
    product = both * (both + (AZIMUTHAL_WIDTH * s[..., 2]) ** 2 * s2)
    some = product > tiny * tiny
    root = xp.sqrt(xp.where(some, product, xp.ones_like(product)))
    azimuth = xp.where(some, (along2 - across2) / root, xp.zeros_like(product))
    return sin2, x, azimuth
