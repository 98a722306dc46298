"""The functions of `half_diff` and of a lobe in Dr.Jit's single precision, for the plugins.

Exponentials are taken to the base 2. `expm1` and the logarithm of the cosine keep full relative precision near zero:
without that, densities vanish far from a peak and near-mirrors are wrong by a percent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.render.variants import import_mitsuba

__all__ = ["LOG2_E", "MAX_EXPONENT", "Pair", "exp2", "exp2m1", "log2_cos", "packets", "pair"]

LOG2_E = 1.0 / math.log(2.0)
#: Largest power of two below the end of single precision.
MAX_EXPONENT = 126.0
# (2^f - 1) / f on [-1/2, 1/2], to a relative 2e-8
_EXP2M1 = (
    np.polynomial.Chebyshev.interpolate(
        lambda f: np.where(f == 0.0, math.log(2.0), np.expm1(f * math.log(2.0)) / np.where(f == 0.0, 1.0, f)),
        5,
        domain=[-0.5, 0.5],
    )
    .convert(kind=np.polynomial.Polynomial)
    .coef.tolist()
)
#: Added to a number it rounds it, and the last bits of the sum hold the integer. And the bits of 1.
_INTEGERS, _ONE = 1.5 * 2.0**23, 127 << 23
#: Squares of lengths below this are zero.
_TINY = 1e-20


def _split(x: Any) -> tuple[Any, Any]:
    """`2^n` and `2^f - 1` with n the integer nearest to x = n + f."""
    import drjit as dr

    mi = import_mitsuba()
    shifted = dr.detach(x) + _INTEGERS
    f = x - (shifted - _INTEGERS)
    total = _EXP2M1[-1]
    for coefficient in _EXP2M1[-2::-1]:
        total = dr.fma(total, f, coefficient)
    exponent: Any = dr.reinterpret_array(mi.Int, shifted)
    return dr.reinterpret_array(mi.Float, (exponent << 23) + _ONE), f * total


def exp2(x: Any) -> Any:
    """`2^x` for x of at most `MAX_EXPONENT`; what is below -126 counts as -126."""
    import drjit as dr

    power, rest = _split(dr.maximum(x, -MAX_EXPONENT))
    return dr.fma(power, rest, power)


def exp2m1(x: Any) -> Any:
    """`2^x - 1` for x in [0, `MAX_EXPONENT`], relatively precise at 0."""
    import drjit as dr

    power, rest = _split(x)
    return dr.fma(power, rest, power - 1.0)


def log2_cos(sin2: Any, cos2: Any) -> Any:
    """Logarithm to the base 2 of a cosine from the squares of sine and cosine; relatively precise at 0."""
    import drjit as dr

    # ln(cos^2) = -2 atanh(q), q = sin^2 / (1 + cos^2)
    q = sin2 / (1.0 + cos2)
    q2 = q * q
    series = -q * (1.0 + q2 * (1.0 / 3.0 + q2 * (1.0 / 5.0 + q2 * (1.0 / 7.0))))
    return LOG2_E * dr.select(sin2 < 0.2, series, 0.5 * dr.log(dr.maximum(cos2, 2.0**-52)))


@dataclass(frozen=True)
class Pair:
    """What a reflectance needs of two directions; `half_z` and `cos_d` are the cosines of theta_h and theta_d."""

    log2_u: Any  # of cos(theta_h)
    half_z: Any
    cos_d: Any
    sum: Any
    difference: Any
    length2: Any  # of the sum

    def azimuth(self) -> Any:
        """Azimuthal factor times `cos(2 phi_d)`; see `half_diff.azimuthal_factor`."""
        import drjit as dr

        s, d = self.sum, self.difference
        along2 = dr.square(d.z) * self.length2
        across2 = dr.square(d.y * s.x - d.x * s.y)
        both = along2 + across2
        product = both * (both + dr.square(AZIMUTHAL_WIDTH * s.z) * self.length2)
        return dr.select(
            product > _TINY**1.5, (along2 - across2) * dr.rsqrt(dr.maximum(product, _TINY**1.5)), 0.0
        )

    def theta_d(self) -> Any:
        """Half the angle between the directions."""
        import drjit as dr

        return dr.atan2(dr.sqrt(dr.maximum(dr.squared_norm(self.difference), _TINY)), dr.sqrt(self.length2))

    def theta_h(self) -> Any:
        """Angle between half vector and normal."""
        import drjit as dr

        return dr.atan2(dr.sqrt(dr.square(self.sum.x) + dr.square(self.sum.y)), self.sum.z)

    def phi_d(self) -> Any:
        """Azimuth of the first direction about the half vector, in [0, pi): the second's is the same."""
        import drjit as dr

        s, d = self.sum, self.difference
        angle = dr.atan2(s.x * d.y - s.y * d.x, -d.z * dr.sqrt(self.length2))
        return dr.select(angle < 0.0, angle + dr.pi, angle)


def pair(wi: Any, wo: Any) -> Pair:
    """Half and difference angles of two unit vectors."""
    import drjit as dr

    s, d = wi + wo, wi - wo
    rho2 = dr.fma(s.x, s.x, s.y * s.y)
    length2 = dr.maximum(dr.fma(s.z, s.z, rho2), _TINY)
    inverse = dr.rcp(length2)
    sin2, cos2 = rho2 * inverse, s.z * s.z * inverse
    length = dr.sqrt(length2)
    half_z, cos_d = s.z * length * inverse, dr.minimum(0.5 * length, 1.0)
    return Pair(log2_cos(sin2, cos2), half_z, cos_d, s, d, length2)


def packets(array: Any) -> Any:
    """A buffer with the last axis of `array`, four or fewer long, padded to four: one look-up fetches it."""
    mi = import_mitsuba()
    array = np.asarray(array, dtype=np.float32)
    padded = np.zeros((*array.shape[:-1], 4), dtype=np.float32)
    padded[..., : array.shape[-1]] = array
    # Memory of NumPy's has no alignment that Dr.Jit knows of, and inside of a scene each number would be fetched alone
    return mi.Float(padded.ravel().tolist())
