"""Directions to half and difference angles and back (Rusinkiewicz 1998; Eq. 2 of the paper).

The model sees a pair of directions through `theta_h`, `theta_d` and `phi_d` alone. All expressions here are
symmetric in the two directions, so that reciprocity holds to the last bit, and finite everywhere: at equal
directions (`theta_d = 0`), at the pole (`theta_h = 0`) and at opposite grazing directions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check

__all__ = ["AZIMUTHAL_WIDTH", "azimuthal_factor", "from_directions", "log_cos", "to_directions"]

#: Where the azimuthal term sets in: it has `1 / sqrt(2)` of its size at `tan(theta_h) tan(theta_d)` of this.
AZIMUTHAL_WIDTH = 0.01


def from_directions(
    wi: ArrayLike, wo: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Half and difference angles of pairs of directions.

    Parameters
    ----------
    wi, wo : (..., 3) array_like
        Unit vectors toward the light and the viewer, normal +z; broadcast against each other.

    Returns
    -------
    theta_h, theta_d : (...) ndarray, radians in [0, pi/2]
        Angle between half vector and normal; half the angle between the directions. `theta_h` can exceed pi/2
        only where a direction lies below the horizon.
    phi_d : (...) ndarray, radians in [0, 2 pi)
        Azimuth of `wi` about the half vector, 0 in the plane of half vector and normal on the side away from
        the normal. Exchanging `wi` and `wo` adds pi. Zero where it means nothing: at `theta_d = 0`, and, as
        the azimuth of the half vector is then arbitrary, taken against +x at `theta_h = 0`.

    Raises
    ------
    ValueError
        If a vector is not of unit length or the last axis is not of length 3.

    Notes
    -----
    Eq. (2): `wd = R_y(-theta_h) R_z(-phi_h) wi`. Opposite directions (`wi = -wo`) have no half vector; the
    normal stands in for it.

    Examples
    --------
    >>> from dsbrdf import half_diff
    >>> theta_h, theta_d, phi_d = half_diff.from_directions([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8])
    >>> float(theta_h), round(float(theta_d), 4)  # the mirror direction; asin(0.6)
    (0.0, 0.6435)
    """
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    s, d = wi + wo, wi - wo
    rho = np.hypot(s[..., 0], s[..., 1])
    length_s = np.sqrt((s * s).sum(-1))
    length_d = np.sqrt((d * d).sum(-1))
    opposite = length_s == 0.0
    theta_h = np.where(opposite, 0.0, np.arctan2(rho, s[..., 2]))
    theta_d = np.arctan2(length_d, length_s)

    # The frame about the half vector: x in the plane of half vector and normal, y = z cross half vector
    at_pole = rho == 0.0
    safe_rho = np.where(at_pole, 1.0, rho)
    cos_h = np.where(at_pole, 1.0, s[..., 0] / safe_rho)
    sin_h = np.where(at_pole, 0.0, s[..., 1] / safe_rho)
    x = np.cos(theta_h) * (cos_h * d[..., 0] + sin_h * d[..., 1]) - np.sin(theta_h) * d[..., 2]
    y = cos_h * d[..., 1] - sin_h * d[..., 0]
    phi_d = np.where(length_d == 0.0, 0.0, np.arctan2(y, x)) % (2.0 * np.pi)
    return theta_h, theta_d, np.where(phi_d >= 2.0 * np.pi, 0.0, phi_d)


def to_directions(
    theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions with the given half and difference angles, half vector in the x-z plane.

    Parameters
    ----------
    theta_h, theta_d : (...) array_like, radians in [0, pi/2]
    phi_d : (...) array_like, radians
        All three broadcast against each other.

    Returns
    -------
    wi, wo : (..., 3) ndarray
        Unit vectors toward the light and the viewer; either may lie below the horizon.

    Raises
    ------
    ValueError
        If an angle is out of range.

    Examples
    --------
    >>> from dsbrdf import half_diff
    >>> wi, wo = half_diff.to_directions(0.0, 0.5, 0.0)
    >>> wi.round(3), wo.round(3)
    (array([0.479, 0.   , 0.878]), array([-0.479,  0.   ,  0.878]))
    """
    theta_h = _check.angle(theta_h, "theta_h")
    theta_d = _check.angle(theta_d, "theta_d")
    phi_d = _check.finite(phi_d, "phi_d")
    sin_h, cos_h = np.sin(theta_h), np.cos(theta_h)
    sin_d, cos_d = np.sin(theta_d), np.cos(theta_d)
    x, y = sin_d * np.cos(phi_d), sin_d * np.sin(phi_d)
    across = np.broadcast_to(y, np.broadcast(sin_h, x).shape)
    half = (sin_h * cos_d, np.zeros_like(across), cos_h * cos_d)
    difference = (cos_h * x, across, -sin_h * x)
    wi = np.stack([h + d for h, d in zip(half, difference, strict=True)], axis=-1)
    wo = np.stack([h - d for h, d in zip(half, difference, strict=True)], axis=-1)
    return wi, wo


def azimuthal_factor(theta_h: ArrayLike, theta_d: ArrayLike) -> NDArray[np.float64]:
    """Factor g of the azimuthal term `1 + beta g cos(2 phi_d)` of a lobe.

    Parameters
    ----------
    theta_h, theta_d : (...) array_like, radians in [0, pi/2]

    Returns
    -------
    (...) ndarray in [0, 1]
        `p / sqrt(p^2 + (c q)^2)` with `p = sin(theta_h) sin(theta_d)`, `q = cos(theta_h) cos(theta_d)` and
        c = `AZIMUTHAL_WIDTH`.

    Notes
    -----
    It vanishes where `phi_d` means nothing, at `theta_h = 0` and at `theta_d = 0`, and saturates beyond. Not
    in the paper; see decision record 0006.

    Examples
    --------
    >>> from dsbrdf import half_diff
    >>> round(float(half_diff.azimuthal_factor(0.0, 0.5)), 3), round(float(half_diff.azimuthal_factor(0.5, 0.5)), 3)
    (0.0, 0.999)
    """
    theta_h, theta_d = np.asarray(theta_h, float), np.asarray(theta_d, float)
    p = np.sin(theta_h) * np.sin(theta_d)
    q = AZIMUTHAL_WIDTH * np.cos(theta_h) * np.cos(theta_d)
    length = np.hypot(p, q)
    factor: NDArray[np.float64] = np.divide(p, length, out=np.zeros_like(length), where=length > 0.0)
    return factor


def log_cos(theta_h: ArrayLike) -> NDArray[np.float64]:
    """`ln cos(theta_h)` of angles (...) in radians: relatively precise near the pole, finite on the horizon.

    Examples
    --------
    >>> from dsbrdf import half_diff
    >>> round(float(half_diff.log_cos(1e-9)), 20)  # where log(cos(x)) is zero
    -5e-19
    """
    sin2 = np.minimum(np.sin(theta_h) ** 2, 1.0 - 2.0**-53)
    return np.asarray(0.5 * np.log1p(-sin2))
