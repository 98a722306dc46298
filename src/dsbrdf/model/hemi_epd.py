"""The hemispherical exponential power distribution (hemi-EPD), the lobe of the reflectance model.

Section 3 of Nishino & Lombardi (2011). A hemi-EPD is a density on the hemisphere around the surface normal
that depends on the polar angle `theta_h` alone. `kappa` > 0 (scale) sets its height, `gamma` >= 0 (shape) how
peaked it is: `gamma` = 0 is Lambert, a large `gamma` comes near a mirror. `lobe` is the unnormalised function
which the model adds up; `pdf`, `cdf`, `quantile`, `sample`, `mean` and `entropy` belong to the distribution.
The von Mises-Fisher distribution, which the paper compares with, stands beside it.

Densities are over solid angle; `cdf` and `quantile` are those of the polar angle. Arguments broadcast to the
shape of the result, which is float64. An argument outside its range raises ValueError.

Notes
-----
With u = cos(theta_h) and tau = -(gamma + 1) ln(u), a number in [0, inf), all integrals become one:

    int_0^1 expm1(kappa u^gamma) f(u) du = kappa exp(kappa) / (gamma + 1) int_0^inf w(tau) f(u) dtau,
    w(tau) = [expm1(x) / x] exp(-kappa - tau),   x = kappa exp(-beta tau),   beta = gamma / (gamma + 1).

w is positive, at most 1 and a sum of decaying exponentials. Double-exponential quadrature in tau, scaled by
the rate 1 + kappa beta at which w sets out to fall, therefore takes the same nodes for every kappa and gamma.
The angle enters through -ln cos(theta_h), which keeps full relative precision however close to the normal.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check

__all__ = [
    "cdf",
    "entropy",
    "lobe",
    "log_normaliser",
    "log_pdf",
    "mean",
    "pdf",
    "quantile",
    "sample",
    "von_mises_fisher_log_pdf",
    "von_mises_fisher_pdf",
]

Array = NDArray[np.float64]

# Rows handled at once, so that the working arrays (rows x nodes) stay in a processor's cache.
_ROWS = 512
# Double-exponential rule on [0, inf), t = exp(s - exp(-s)), with a step that leaves only rounding errors.
_S, _STEP = np.linspace(-3.6, 6.2, 50, retstep=True)
_T = np.exp(_S - np.exp(-_S))
_T_WEIGHT = _STEP * _T * (1.0 + np.exp(-_S))
# Gauss-Legendre rule on [-1, 1], for the half of the distribution next to the normal.
_GAUSS, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(12)


def lobe(theta_h: ArrayLike, kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Value of one unnormalised hemi-EPD lobe, ``expm1(kappa cos(theta_h)**gamma)``.

    Parameters
    ----------
    theta_h : (...) array_like, radians in [0, pi/2]
        Angle between the half vector and the normal.
    kappa, gamma : (...) array_like; kappa > 0, gamma >= 0
        Scale (height) and shape (peakedness; 0 is Lambert); broadcast against `theta_h`.

    Returns
    -------
    (...) ndarray
        In the unit of the reflectance it models. Infinite, with NumPy's overflow warning, where the exponent
        passes 709.78.

    Notes
    -----
    Eq. (6), one term. Written with `expm1`, so small `kappa` keeps full precision.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> hemi_epd.lobe([0.0, 0.5], kappa=2.0, gamma=10.0).round(3)
    array([6.389, 0.719])
    """
    kappa, gamma = _parameters(kappa, gamma)
    return np.expm1(kappa * np.exp(-gamma * _depth(_check.angle(theta_h, "theta_h"))))


def log_normaliser(kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Logarithm of the factor C, in ln(1/sr), which makes `lobe` a density over the hemisphere.

    Parameters
    ----------
    kappa, gamma : (...) array_like; kappa > 0, gamma >= 0
        Scale and shape; broadcast together.

    Notes
    -----
    Eq. (4): 1/C = 2 pi sum_{n>=1} kappa^n / (n! (n gamma + 1)). The paper prints the same number through
    incomplete gamma functions of complex argument.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> normalised = np.log(hemi_epd.lobe(0.1, 2.0, 10.0)) + hemi_epd.log_normaliser(2.0, 10.0)
    >>> bool(np.isclose(hemi_epd.log_pdf(0.1, 2.0, 10.0), normalised))
    True
    """
    kappa, gamma = _parameters(kappa, gamma)
    return _log_peak_factor(kappa, gamma) - np.log(kappa) - kappa


def log_pdf(theta_h: ArrayLike, kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Logarithm of `pdf`, in ln(1/sr); finite also where the density is too small for float64.

    Parameters
    ----------
    theta_h, kappa, gamma : as in `lobe`

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> bool(np.isclose(np.exp(hemi_epd.log_pdf(0.1, 2.0, 10.0)), hemi_epd.pdf(0.1, 2.0, 10.0)))
    True
    """
    kappa, gamma = _parameters(kappa, gamma)
    fall = gamma * _depth(_check.angle(theta_h, "theta_h"))
    shape = kappa * np.expm1(-fall) - fall + np.log(_expm1_ratio(kappa * np.exp(-fall)))
    return shape + _log_peak_factor(kappa, gamma)


def pdf(theta_h: ArrayLike, kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Density of the hemi-EPD over solid angle, Eq. (4).

    Parameters
    ----------
    theta_h, kappa, gamma : as in `lobe`

    Returns
    -------
    (...) ndarray, 1/sr
        Integrates to 1 over the hemisphere, with the measure 2 pi sin(theta_h) dtheta_h.

    Examples
    --------
    >>> round(float(2 * np.pi * pdf(0.3, kappa=2.0, gamma=0.0)), 12)  # Lambert: 1 / (2 pi) everywhere
    1.0
    """
    return np.exp(log_pdf(theta_h, kappa, gamma))


def cdf(theta_h: ArrayLike, kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Probability that the polar angle is at most `theta_h`, the integral of `pdf` over a cone.

    Parameters
    ----------
    theta_h, kappa, gamma : as in `lobe`

    Returns
    -------
    (...) ndarray in [0, 1]
        Precise in the relative sense near 0, in the absolute sense near 1.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> float(hemi_epd.cdf(np.pi / 2, kappa=2.0, gamma=10.0).round(6))
    1.0
    """
    kappa, gamma = _parameters(kappa, gamma)
    depth = _depth(_check.angle(theta_h, "theta_h"))
    return _lower_tail((gamma + 1.0) * depth, kappa, gamma / (gamma + 1.0))


def quantile(q: ArrayLike, kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Polar angle, in radians, within which the fraction `q` of the distribution lies, the inverse of `cdf`.

    Parameters
    ----------
    q : (...) array_like in [0, 1]
        Probability.
    kappa, gamma : (...) array_like; kappa > 0, gamma >= 0
        Scale and shape; broadcast against `q`.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> median = hemi_epd.quantile(0.5, kappa=2.0, gamma=10.0)
    >>> float(hemi_epd.cdf(median, 2.0, 10.0).round(6))
    0.5
    """
    q = _check.finite(q, "q", low=0.0, high=1.0)
    kappa, gamma = _parameters(kappa, gamma)
    tau = _quantile(np.where(q < 1.0, q, 0.5), kappa, gamma / (gamma + 1.0))
    return np.where(q < 1.0, _angle_at(tau / (gamma + 1.0)), np.pi / 2)[()]


def sample(
    kappa: ArrayLike, gamma: ArrayLike, rng: np.random.Generator, size: int | tuple[int, ...] | None = None
) -> Array:
    """Draw polar angles, in radians; the azimuth is uniform and left to the caller.

    Parameters
    ----------
    kappa, gamma : (...) array_like; kappa > 0, gamma >= 0
        Scale and shape; broadcast together.
    rng : numpy.random.Generator
        Source of randomness.
    size : int or tuple of int, optional
        Shape of the result, to which the parameters must broadcast; their common shape by default.

    Raises
    ------
    TypeError
        If `rng` is not a Generator.

    Notes
    -----
    Exact. The series of exp makes Eq. (4) a mixture of cosine powers: n >= 1 has a weight proportional to
    kappa^n / (n! (n gamma + 1)), and given n, cos(theta_h)^(n gamma + 1) is uniform on [0, 1].

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> hemi_epd.sample(2.0, 10.0, np.random.default_rng(0), size=100).shape
    (100,)
    """
    if not isinstance(rng, np.random.Generator):
        got = type(rng).__name__
        raise TypeError(f"'rng' must be a numpy.random.Generator, got {got}. Use numpy.random.default_rng.")
    kappa, gamma = np.broadcast_arrays(*_parameters(kappa, gamma))
    if size is not None:
        kappa, gamma = np.broadcast_to(kappa, size), np.broadcast_to(gamma, size)
    n = _draw_component(kappa.ravel(), gamma.ravel(), rng).reshape(kappa.shape)
    return _angle_at(rng.standard_exponential(kappa.shape) / (n * gamma + 1.0))


def mean(kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Mean of cos(theta_h): the length of the mean direction, which points along the normal.

    Parameters
    ----------
    kappa, gamma : as in `log_normaliser`

    Returns
    -------
    (...) ndarray in [1/2, 1]
        1/2 for Lambert, 1 for a mirror.

    Notes
    -----
    C(kappa, gamma) / [2 C(kappa, gamma / 2)], by the substitution v = cos(theta_h)^2.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> hemi_epd.mean(2.0, [1.0, 1000.0]).round(3)
    array([0.728, 0.999])
    """
    kappa, gamma = _parameters(kappa, gamma)
    return 0.5 * np.exp(_log_peak_factor(kappa, gamma) - _log_peak_factor(kappa, 0.5 * gamma))


def entropy(kappa: ArrayLike, gamma: ArrayLike) -> Array:
    """Differential entropy over solid angle, the mean of ``-log_pdf``.

    Parameters
    ----------
    kappa, gamma : as in `log_normaliser`

    Returns
    -------
    (...) ndarray, nats
        At most ln(2 pi), the entropy of Lambert; negative for narrow lobes.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> bool(hemi_epd.entropy(2.0, 100.0) < hemi_epd.entropy(2.0, 1.0))
    True
    """
    return _entropy(*_parameters(kappa, gamma))


def von_mises_fisher_log_pdf(theta_h: ArrayLike, kappa: ArrayLike) -> Array:
    """Logarithm of `von_mises_fisher_pdf`, in ln(1/sr); no `kappa` is too large for it.

    Parameters
    ----------
    theta_h, kappa : as in `von_mises_fisher_pdf`

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> bool(np.isclose(np.exp(hemi_epd.von_mises_fisher_log_pdf(0.5, 5.0)), hemi_epd.von_mises_fisher_pdf(0.5, 5.0)))
    True
    """
    kappa = _check.finite(kappa, "kappa", low=0.0)
    sine = np.sin(0.5 * _check.angle(theta_h, "theta_h", high=np.pi))
    return -2.0 * kappa * sine * sine - np.log(4.0 * np.pi * _expm1_ratio(2.0 * kappa))


def von_mises_fisher_pdf(theta_h: ArrayLike, kappa: ArrayLike) -> Array:
    """Density of the von Mises-Fisher distribution, a Gaussian on the whole sphere, Eq. (3).

    Parameters
    ----------
    theta_h : (...) array_like, radians in [0, pi]
        Angle to the mean direction.
    kappa : (...) array_like, kappa >= 0
        Concentration; 0 is uniform on the sphere.

    Returns
    -------
    (...) ndarray, 1/sr
        Integrates to 1 over the sphere, hence to less over the hemisphere.

    Examples
    --------
    >>> from dsbrdf import hemi_epd
    >>> bool(hemi_epd.von_mises_fisher_pdf(0.0, 5.0) > hemi_epd.von_mises_fisher_pdf(0.5, 5.0))
    True
    """
    return np.exp(von_mises_fisher_log_pdf(theta_h, kappa))


def _parameters(kappa: ArrayLike, gamma: ArrayLike) -> tuple[Array, Array]:
    return _check.finite(kappa, "kappa", low=0.0, open_low=True), _check.finite(gamma, "gamma", low=0.0)


def _depth(theta: Array) -> Array:
    """-ln cos(theta), with full relative precision at both ends."""
    depth: Array = 0.5 * np.log1p(np.tan(theta) ** 2)
    return depth


def _angle_at(depth: Array) -> Array:
    """Angle with the given `_depth`."""
    return np.arctan(np.sqrt(np.expm1(2.0 * depth)))


def _expm1_ratio(x: Array) -> Array:
    """expm1(x) / x scaled by exp(-x), that is (1 - exp(-x)) / x, for x >= 0."""
    x = np.maximum(x, np.finfo(np.float64).tiny)
    ratio: Array = -np.expm1(-x) / x
    return ratio


def _by_rows(function: Callable[..., Array]) -> Callable[..., Array]:
    """Broadcast the arguments of `function`, which takes columns (n, 1) and puts nodes on the last axis."""

    @wraps(function)
    def broadcast(*arguments: Array) -> Any:
        arrays = np.broadcast_arrays(*arguments)
        columns = [array.reshape(-1, 1) for array in arrays]
        result = np.empty_like(columns[0])
        for start in range(0, result.size, _ROWS):
            rows = slice(start, start + _ROWS)
            result[rows] = function(*(column[rows] for column in columns))
        return result.reshape(arrays[0].shape)[()]

    return broadcast


def _sum(values: Array) -> Array:
    total: Array = values.sum(axis=-1, keepdims=True)
    return total


def _w(tau: Array, kappa: Array, beta: Array) -> Array:
    """The weight w(tau) of the module's notes."""
    drop = -kappa * np.expm1(-beta * tau)
    return _expm1_ratio(kappa - drop) * np.exp(-drop - tau)


def _nodes(kappa: Array, beta: Array) -> tuple[Array, Array]:
    """Nodes tau and their mass: the integral of w f over [0, inf) is the sum of mass f(tau)."""
    scale = 1.0 / (1.0 + kappa * beta)
    tau = scale * _T
    return tau, scale * _T_WEIGHT * _w(tau, kappa, beta)


def _total(kappa: Array, beta: Array) -> Array:
    """Integral of w over [0, inf)."""
    return _sum(_nodes(kappa, beta)[1])


@_by_rows
def _log_peak_factor(kappa: Array, gamma: Array) -> Array:
    """ln(C kappa exp(kappa))."""
    return np.log((gamma + 1.0) / (2.0 * np.pi)) - np.log(_total(kappa, gamma / (gamma + 1.0)))


@_by_rows
def _entropy(kappa: Array, gamma: Array) -> Array:
    tau, mass = _nodes(kappa, gamma / (gamma + 1.0))
    total = _sum(mass)
    fall = gamma / (gamma + 1.0) * tau
    below_peak = fall - kappa * np.expm1(-fall) - np.log(_expm1_ratio(kappa * np.exp(-fall)))
    return np.log(2.0 * np.pi * total / (gamma + 1.0)) + _sum(mass * below_peak) / total


def _tails(tau: Array, kappa: Array, beta: Array, total: Array) -> tuple[Array, Array, Array]:
    """Shares of w below and above tau, each precise in the relative sense, and w(tau) / integral above."""
    far = kappa * np.exp(-beta * tau)
    far_total = _total(far, beta)
    upper = np.exp(kappa * np.expm1(-beta * tau) - tau) * far_total / total
    half = 0.5 * tau
    lower = half * (_sum(_GAUSS_WEIGHT * _w(half * (1.0 + _GAUSS), kappa, beta)) / total)
    lower, upper = np.where(upper < 0.5, (1.0 - upper, upper), (lower, 1.0 - lower))
    return lower, upper, _expm1_ratio(far) / far_total


@_by_rows
def _lower_tail(tau: Array, kappa: Array, beta: Array) -> Array:
    return _tails(tau, kappa, beta, _total(kappa, beta))[0]


@_by_rows
def _quantile(q: Array, kappa: Array, beta: Array) -> Array:
    """Newton's method on the logarithm of the upper tail: convex in tau, so steps from 0 never overshoot."""
    total, tau, step = _total(kappa, beta), np.zeros_like(q), np.ones_like(q)
    while np.any(step > 1e-9 * tau + 1e-290):
        lower, upper, hazard = _tails(tau, kappa, beta, total)
        excess = np.where(q < 0.5, q - lower, upper - (1.0 - q))
        step = np.log1p(excess / (1.0 - q)) / hazard
        tau = np.maximum(tau + step, 0.0)
    return tau


def _draw_component(kappa: Array, gamma: Array, rng: np.random.Generator) -> Array:
    """Draw n >= 1 with probability proportional to kappa^n / (n! (n gamma + 1)), by rejection.

    Proposals are Poisson counts m given m >= 1, that is kappa^m / m!: n = m, or, where kappa and kappa gamma
    are large, n = m - 1. At worst about half of them are accepted.
    """
    n = np.empty_like(kappa)
    todo = np.arange(kappa.size)
    while todo.size:
        k, g = kappa[todo], gamma[todo]
        less = (k > 2.0) & (k * g > 1.0)
        first_arrival = -np.log1p(rng.random(k.size) * np.expm1(-k))
        trial = 1.0 + rng.poisson(np.maximum(k - first_arrival, 0.0)) - less
        bound = np.where(less, (trial + 1.0) * np.minimum(g, 0.5 * (g + 1.0)), g + 1.0)
        accepted = (trial > 0) & (rng.random(k.size) * (trial * g + 1.0) < bound)
        n[todo[accepted]] = trial[accepted]
        todo = todo[~accepted]
    return n
