"""Closed-form isotropic reflectances f(wi, wo), of which the built-in materials are made.

`lambert` and `oren_nayar` are diffuse, `ggx` is a microfacet lobe under any Fresnel reflectance, and `coated`
is a diffuse base under a dielectric coat with one or more lobes. Each ingredient can be switched off, so that
its share of a reflectance can be measured, for example of the variation with phi_d.

Conventions: local frame with the normal along +z, `wi` toward the light and `wo` toward the viewer, unit, of
shape (..., 3) with leading axes that broadcast. Values are in 1/sr without the cosine, of shape
(..., channel); a pair with a direction below the horizon gives 0. Every expression is symmetric in `wi` and
`wo`, so reciprocity holds to the last bit. A direction that is not unit and a parameter out of range raise
ValueError.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check

__all__ = ["coated", "fresnel_conductor", "fresnel_dielectric", "ggx", "lambert", "oren_nayar"]

Array = NDArray[np.float64]

# Cosines to the normal count as no less than this, which keeps 1 / cosine finite. With one direction alone at
# the horizon, the value is the limit to a relative 1e-12 / alpha.
_MIN_COSINE = 1e-12
_MIN_ALPHA, _MAX_ALPHA = 1e-4, 10.0


class _Pair(NamedTuple):
    """What the reflectances need of a pair of directions, each (...)."""

    cos_i: Array
    cos_o: Array
    above: NDArray[np.bool_]  # the horizon, both
    flat_dot: Array  # wi . wo without z
    across_sq: Array  # squared length of wi + wo across the normal
    along_sq: Array  # and along it
    cos_d: Array  # cos(theta_d)


def lambert(wi: ArrayLike, wo: ArrayLike, albedo: ArrayLike) -> Array:
    """Reflectance of a Lambertian surface, ``albedo / pi``, in 1/sr.

    Parameters
    ----------
    wi, wo : (..., 3) array_like
        Unit vectors toward the light and the viewer.
    albedo : (channel,) array_like or float in [0, 1]
        Reflected share of the light.
    """
    pair = _pair(wi, wo)
    return (pair.above / np.pi)[..., np.newaxis] * _albedo(albedo)


def oren_nayar(wi: ArrayLike, wo: ArrayLike, albedo: ArrayLike, sigma: float) -> Array:
    """Reflectance of a rough diffuse surface, in 1/sr: Lambertian facets with a spread of slopes.

    Parameters
    ----------
    wi, wo : (..., 3) array_like
        Unit vectors toward the light and the viewer.
    albedo : (channel,) array_like or float in [0, 1]
        Reflected share of the light at one facet.
    sigma : float, radians in [0, pi/2]
        Standard deviation of the facets' angle to the mean surface; 0 is `lambert`.

    Notes
    -----
    The qualitative model of Oren and Nayar, "Generalization of Lambert's reflectance model", SIGGRAPH 1994:
    ``albedo / pi (A + B max(0, cos(phi_i - phi_o)) sin(a) tan(b))`` with `a` the larger and `b` the smaller
    polar angle; the trigonometric part is ``max(0, x_i x_o + y_i y_o) / max(cos_i, cos_o)``. Light that meets
    more than one facet is left out, so the surface reflects less than `albedo`.
    """
    return _rough_diffuse(_pair(wi, wo), sigma)[..., np.newaxis] * _albedo(albedo)


def ggx(
    wi: ArrayLike,
    wo: ArrayLike,
    alpha: float,
    *,
    fresnel: ArrayLike | None = None,
    masking: bool = True,
    foreshortening: bool = True,
) -> Array:
    """Reflectance of a microfacet surface, ``F(theta_d) D(theta_h) G / (4 cos_i cos_o)``, in 1/sr.

    Parameters
    ----------
    wi, wo : (..., 3) array_like
        Unit vectors toward the light and the viewer.
    alpha : float in [1e-4, 10]
        Width of the GGX distribution D of facet normals, in slope.
    fresnel : (channel,) array_like or scalar, optional
        Refractive index: complex ``n + ik`` for a conductor, real > 1 for a dielectric. Without it the facets
        reflect everything, F = 1, in one channel.
    masking : bool
        False leaves out masking and shadowing: G = 1.
    foreshortening : bool
        False leaves out the division by ``cos_i cos_o``. With both off, ``F D / 4`` remains, which does not
        vary with phi_d.

    Notes
    -----
    D: Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007, Eq. (33). G:
    Smith's function, height-correlated; Heitz, "Understanding the masking-shadowing function in
    microfacet-based BRDFs", JCGT 3(2), 2014. Light that meets more than one facet is left out. Without
    masking the value grows toward the horizon as 1 / cosine and gains energy.
    """
    pair = _pair(wi, wo)
    alpha = float(_check.finite(alpha, "alpha", low=_MIN_ALPHA, high=_MAX_ALPHA))
    value = _lobe(pair, alpha, masking, foreshortening)
    if fresnel is None:
        return value[..., np.newaxis]
    index = np.atleast_1d(np.asarray(fresnel))
    reflectance = fresnel_conductor if np.iscomplexobj(index) else fresnel_dielectric
    out = np.empty((*value.shape, index.size))
    for channel, number in enumerate(index):
        np.multiply(value, reflectance(pair.cos_d, number), out=out[..., channel])
    return out


def coated(
    wi: ArrayLike,
    wo: ArrayLike,
    albedo: ArrayLike,
    *,
    eta: float,
    alpha: ArrayLike,
    weights: ArrayLike = 1.0,
    sigma: float = 0.0,
    fresnel: bool = True,
    masking: bool = True,
    foreshortening: bool = True,
    coupling: bool = True,
) -> Array:
    """Reflectance of a diffuse base under a clear dielectric coat, as of plastic or paint, in 1/sr.

    Parameters
    ----------
    wi, wo : (..., 3) array_like
        Unit vectors toward the light and the viewer.
    albedo : (channel,) array_like or float in [0, 1]
        Of the base without the coat.
    eta : float > 1
        Refractive index of the coat.
    alpha : (lobe,) array_like or float in [1e-4, 10]
        Widths of the GGX lobes of the coat's surface.
    weights : (lobe,) array_like or float in [0, 1]
        Shares of the lobes, one for each `alpha`, with a sum of 1 at most.
    sigma : float, radians in [0, pi/2]
        Roughness of the base, see `oren_nayar`.
    fresnel : bool
        False gives each Fresnel reflectance its value at normal incidence.
    masking, foreshortening : bool
        Of the lobes, see `ggx`.
    coupling : bool
        False adds the base as it is without a coat, which can gain energy.

    Notes
    -----
    The base adds ``f_base T(wi) T(wo) / (eta**2 - albedo (eta**2 - 1 + F_mean))``. Light enters and leaves
    through a smooth interface, ``T = 1 - F(theta)``, and is reflected repeatedly between it and the base;
    F_mean is F from outside, averaged over Lambertian light. A white Lambertian base gives back all it gets.
    Saunderson, "Calculation of the color of pigmented plastics", J. Opt. Soc. Am. 32, 727 (1942).
    """
    pair = _pair(wi, wo)
    widths = np.atleast_1d(_check.finite(alpha, "alpha", low=_MIN_ALPHA, high=_MAX_ALPHA))
    shares = np.atleast_1d(_check.finite(weights, "weights", low=0.0, high=1.0))
    if shares.shape != widths.shape or shares.sum() > 1.0 + 1e-9:
        need = f"one share for each of {widths.size} lobes, with a sum of 1 at most"
        raise ValueError(f"'weights' must be {need}, got {shares.tolist()}.")
    normal = float(fresnel_dielectric(1.0, eta))

    # Specular: one Fresnel reflectance for all lobes.
    specular = np.zeros_like(pair.cos_d)
    for width, share in zip(widths, shares, strict=True):
        specular += share * _lobe(pair, width, masking, foreshortening)
    specular *= fresnel_dielectric(pair.cos_d, eta) if fresnel else normal

    # Base: what the coat lets in and out again.
    base = _rough_diffuse(pair, sigma)
    colour = _albedo(albedo)
    if coupling:
        f_mean = _mean_fresnel(eta) if fresnel else normal
        colour = colour / (eta**2 - colour * (eta**2 - 1.0 + f_mean))
        f_in, f_out = (fresnel_dielectric(c, eta) if fresnel else normal for c in (pair.cos_i, pair.cos_o))
        base *= (1.0 - f_in) * (1.0 - f_out)
    return specular[..., np.newaxis] + base[..., np.newaxis] * colour


def fresnel_dielectric(cos_theta: ArrayLike, eta: float) -> Array:
    """Reflectance (...) of a smooth dielectric for unpolarised light from outside.

    Parameters
    ----------
    cos_theta : (...) array_like in [0, 1]
        Cosine of the angle of incidence.
    eta : float > 1
        Refractive index. Born and Wolf, "Principles of Optics", 7th ed., Sec. 1.5.2.
    """
    eta_sq = float(_check.finite(eta, "eta", low=1.0, open_low=True)) ** 2
    outside = _check.finite(cos_theta, "cos_theta", low=0.0, high=1.0)
    inside = np.sqrt(eta_sq - 1.0 + outside * outside)
    across = (outside - inside) / (outside + inside)
    along = (eta_sq * outside - inside) / (eta_sq * outside + inside)
    return np.asarray(0.5 * (across * across + along * along))


def fresnel_conductor(cos_theta: ArrayLike, index: complex) -> Array:
    """Reflectance (...) of a smooth conductor for unpolarised light.

    Parameters
    ----------
    cos_theta : (...) array_like in [0, 1]
        Cosine of the angle of incidence.
    index : complex
        Refractive index ``n + ik``, n > 0 and k > 0. Born and Wolf, as above, Sec. 14.2.
    """
    n = float(_check.finite(np.real(index), "n of n + ik", low=0.0, open_low=True))
    k = float(_check.finite(np.imag(index), "k of n + ik", low=0.0, open_low=True))
    cos = _check.finite(cos_theta, "cos_theta", low=0.0, high=1.0)
    cos_sq = cos * cos
    sin_sq = 1.0 - cos_sq
    real = n * n - k * k - sin_sq  # of index^2 - sin^2
    modulus = np.sqrt(real * real + (2.0 * n * k) ** 2)
    twice = cos * np.sqrt(2.0 * (modulus + real))
    across = modulus + cos_sq
    along = cos_sq * modulus + sin_sq * sin_sq
    return np.asarray((across - twice) * along / ((across + twice) * (along + twice * sin_sq)))


def _pair(wi: ArrayLike, wo: ArrayLike) -> _Pair:
    wi, wo = _check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo")
    (x_i, y_i, z_i), (x_o, y_o, z_o) = (np.moveaxis(w, -1, 0) for w in (wi, wo))
    x, y, z = x_i + x_o, y_i + y_o, z_i + z_o
    across_sq, along_sq = x * x + y * y, z * z
    return _Pair(
        cos_i=np.clip(z_i, _MIN_COSINE, 1.0),
        cos_o=np.clip(z_o, _MIN_COSINE, 1.0),
        above=(z_i >= 0.0) & (z_o >= 0.0),
        flat_dot=x_i * x_o + y_i * y_o,
        across_sq=across_sq,
        along_sq=along_sq,
        cos_d=np.minimum(0.5 * np.sqrt(across_sq + along_sq), 1.0),
    )


def _lobe(pair: _Pair, alpha: float, masking: bool, foreshortening: bool) -> Array:
    """D G / (4 cos_i cos_o) of GGX (...), of which the switches leave parts out."""
    alpha_sq = alpha * alpha
    cos_i, cos_o = pair.cos_i, pair.cos_o

    # D = alpha^2 / (pi (alpha^2 cos^2 + sin^2)^2); sin^2 comes without cancellation near theta_h = 0
    ratio = pair.across_sq + pair.along_sq
    ratio /= np.maximum(alpha_sq * pair.along_sq + pair.across_sq, 1e-300)  # wi = -wo gives 0
    value = ratio * ratio * (alpha_sq / (4.0 * np.pi)) * pair.above

    # G / (cos_i cos_o) = 2 / (cos_i s_o + cos_o s_i), s = sqrt(alpha^2 + (1 - alpha^2) cos^2)
    if masking:
        s_i, s_o = (np.sqrt(alpha_sq + (1.0 - alpha_sq) * (c * c)) for c in (cos_i, cos_o))
        value *= 2.0 / (cos_i * s_o + cos_o * s_i)
    if masking != foreshortening:
        value *= cos_i * cos_o if masking else 1.0 / (cos_i * cos_o)
    return value


def _rough_diffuse(pair: _Pair, sigma: float) -> Array:
    """Oren-Nayar reflectance of albedo 1 (...)."""
    sigma_sq = float(_check.finite(sigma, "sigma", low=0.0, high=np.pi / 2)) ** 2
    value = pair.above / np.pi
    if sigma_sq > 0.0:
        a = 1.0 - 0.5 * sigma_sq / (sigma_sq + 0.33)
        b = 0.45 * sigma_sq / (sigma_sq + 0.09)
        value *= a + b * np.maximum(pair.flat_dot, 0.0) / np.maximum(pair.cos_i, pair.cos_o)
    return value


@lru_cache(maxsize=64)
def _mean_fresnel(eta: float) -> float:
    """F of a dielectric from outside, averaged over Lambertian light: integral of 2 F(c) c over [0, 1]."""
    node, weight = np.polynomial.legendre.leggauss(64)
    cos_theta = 0.5 * (node + 1.0)
    return float(weight @ (cos_theta * fresnel_dielectric(cos_theta, eta)))


def _albedo(albedo: ArrayLike) -> Array:
    return np.atleast_1d(_check.finite(albedo, "albedo", low=0.0, high=1.0))
