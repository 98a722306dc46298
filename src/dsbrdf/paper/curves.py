"""Curves of kappa, gamma and beta over theta_d: quadratic B-splines in place of slices (Section 6.C).

A model of curves is a `Slices` tabulated at the middles of 90 one-degree cells, so it evaluates like any other.
`Slices.to_curves` smooths a model of slices.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.grids import SHAPE, cell_angles

if TYPE_CHECKING:
    from dsbrdf.paper.slices import Slices

__all__ = ["CurveBasis", "Curves", "tabulated_theta_d"]

#: What curves can be splines in.
VARIABLES = ("theta_d", "cosine")
#: Points of Gauss-Legendre quadrature between knots, beyond the degree: exact for polynomials, cosines to rounding.
GRAM_NODES = 10
#: Beyond these a lobe is absent or overflows, flat or a mirror; what lies outside is clipped.
LN_KAPPA = (-40.0, float(np.log(700.0)))
LN_GAMMA = (-14.0, 14.0)
#: Least gamma that smoothing tells from others: below, a lobe is flat.
FLAT_GAMMA = 0.01
#: Weight of a slice in smoothing is at least this share of the greatest, so that no part of a curve is left open.
LEAST_WEIGHT = 1e-3
#: Pull of neighbouring coefficients toward each other, which decides where there is no slice at all.
PULL = 1e-6


def tabulated_theta_d() -> NDArray[np.float64]:
    """Angles (90,) in radians at which curves are tabulated: the middles of one-degree cells, as in a MERL table."""
    return cell_angles("centre", SHAPE)[1]


@dataclass(frozen=True)
class CurveBasis:
    """Clamped B-splines over theta_d with uniform knots; they are positive and add up to one.

    Parameters
    ----------
    n_knots : int, optional
        Distinct knots, both ends included. The paper: five, hence six quadratic functions.
    degree : int, optional
        Of the polynomials between knots; 2 is quadratic.
    domain : (float, float), radians, optional
        First and last knot; beyond them the values at the ends hold.
    variable : {"theta_d", "cosine"}, optional
        In what the splines are polynomials and their knots uniform: theta_d (the paper), or 1 - cos(theta_d), as
        Fresnel's reflectance is, which puts more of them near grazing.

    Raises
    ------
    ValueError
        If there are fewer than two knots, no range between the ends, or no such variable.

    Examples
    --------
    >>> from dsbrdf.paper import CurveBasis
    >>> CurveBasis().size
    6
    """

    n_knots: int = 5
    degree: int = 2
    domain: tuple[float, float] = (0.0, np.pi / 2)
    variable: str = "theta_d"

    def __post_init__(self) -> None:
        if self.n_knots < 2 or self.degree < 0:
            raise ValueError(
                f"a basis needs 'n_knots' >= 2 and 'degree' >= 0, got {self.n_knots} and {self.degree}."
            )
        if self.variable not in VARIABLES:
            raise ValueError(
                f"'variable' must be {' or '.join(map(repr, VARIABLES))}, got {self.variable!r}."
            )
        low, high = (float(x) for x in _check.angle(self.domain, "domain"))
        if not low < high:
            raise ValueError(f"'domain' must be an ascending pair of angles, got ({low:g}, {high:g}).")
        object.__setattr__(self, "domain", (low, high))

    @property
    def size(self) -> int:
        """Number of functions, and of coefficients of a curve."""
        return self.n_knots + self.degree - 1

    @cached_property
    def breaks(self) -> NDArray[np.float64]:
        """Angles (n_knots,) of the distinct knots, radians."""
        if self.variable == "theta_d":
            return np.linspace(*self.domain, self.n_knots)
        low, high = np.cos(self.domain)
        breaks: NDArray[np.float64] = np.arccos(np.linspace(low, high, self.n_knots))
        breaks[0], breaks[-1] = self.domain
        return breaks

    def design(self, theta_d: ArrayLike) -> NDArray[np.float64]:
        """Values (theta_d, function) of the functions at angles (theta_d,) in radians."""
        from scipy.interpolate import BSpline

        knots = np.pad(self._variable_of(self.breaks), self.degree, mode="edge")
        at = np.clip(self._variable_of(_check.angle(theta_d, "theta_d")), knots[0], knots[-1])
        design: NDArray[np.float64] = BSpline.design_matrix(at, knots, self.degree).toarray()
        return design

    @cached_property
    def gram(self) -> NDArray[np.float64]:
        """Inner products (function, function), integrals over theta_d in radians; to rounding."""
        nodes, weights = np.polynomial.legendre.leggauss(self.degree + GRAM_NODES)
        half = 0.5 * np.diff(self.breaks)[:, None]
        values = self.design((self.breaks[:-1, None] + half * (1.0 + nodes)).ravel())
        gram: NDArray[np.float64] = (values * (half * weights).reshape(-1, 1)).T @ values
        return gram

    def _variable_of(self, theta_d: NDArray[np.float64]) -> NDArray[np.float64]:
        return theta_d if self.variable == "theta_d" else 1.0 - np.cos(theta_d)


@dataclass(frozen=True, eq=False, repr=False)
class Curves(Brief):
    """Parameters of lobes as splines over theta_d.

    Parameters
    ----------
    basis : CurveBasis
    kappa, gamma, beta : (channel, lobe, coefficient) ndarray
        Coefficients, of ln(kappa) and ln(gamma) if `logarithmic`.
    logarithmic : bool, optional
        Positive by construction; otherwise (the paper) what is negative is clipped. beta is never a logarithm, and is
        clipped to [-1, 1], where it is by itself if its coefficients are.
    spike : (channel, coefficient) ndarray, optional
        Of the heights in 1/sr; negative ones are clipped.

    Raises
    ------
    ValueError
        If shapes disagree or a coefficient is not finite.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> smooth = paper.fit_slices(dsbrdf.material("matte"), 1).model.to_curves()
    >>> smooth.curves.at([0.1, 0.2])[0].shape  # kappa (theta_d, channel, lobe)
    (2, 3, 1)
    """

    basis: CurveBasis
    kappa: NDArray[np.float64]
    gamma: NDArray[np.float64]
    beta: NDArray[np.float64]
    logarithmic: bool = True
    spike: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for name in ("kappa", "gamma", "beta"):
            array = _check.finite(getattr(self, name), f"curves.{name}")
            if array.ndim != 3 or array.shape[-1] != self.basis.size or array.shape != np.shape(self.kappa):
                raise ValueError(
                    f"'curves.{name}' must have shape (channel, lobe, coefficient) like 'curves.kappa' with "
                    f"{self.basis.size} coefficients, got {array.shape}."
                )
            object.__setattr__(self, name, array)
        shape = (self.kappa.shape[0], self.basis.size)
        spike = np.zeros(shape) if self.spike is None else _check.finite(self.spike, "curves.spike")
        if spike.shape != shape:
            raise ValueError(
                f"'curves.spike' must have shape (channel, coefficient) {shape}, got {spike.shape}."
            )
        object.__setattr__(self, "spike", spike)

    def at(self, theta_d: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """kappa, gamma and beta at angles (theta_d,) in radians, (theta_d, channel, lobe) each."""
        design = self.basis.design(theta_d)
        kappa, gamma, beta = (
            np.einsum("tc,ijc->tij", design, values) for values in (self.kappa, self.gamma, self.beta)
        )
        return parameters(kappa, gamma, beta, self.logarithmic)

    def spike_at(self, theta_d: ArrayLike) -> NDArray[np.float64]:
        """Heights (theta_d, channel) of the spike in 1/sr."""
        assert self.spike is not None
        return np.maximum(self.basis.design(theta_d) @ self.spike.T, 0.0)

    @property
    def n_parameters(self) -> int:
        """Number of coefficients; those of beta and the spike count where there are any."""
        parts = (self.kappa, self.gamma, self.beta, self.spike)
        return sum(part.size for part in parts if part is not None and part.any())

    def lobe(self, k: int) -> Curves:
        """The curves of lobe `k` alone, without the spike."""
        parts = {name: getattr(self, name)[:, k : k + 1] for name in ("kappa", "gamma", "beta")}
        return dataclasses.replace(self, **parts, spike=None)

    def with_spike(self, theta_d: ArrayLike, heights: ArrayLike) -> Curves:
        """The same curves with a spike: least squares to heights (theta_d, channel) in 1/sr, nowhere negative."""
        from scipy.optimize import nnls

        rows = np.concatenate([self.basis.design(theta_d), _pull(self.basis.size)])
        target = np.pad(np.asarray(heights, dtype=float), ((0, self.basis.size - 1), (0, 0)))
        spike = np.array([nnls(rows, column)[0] for column in target.T])
        return dataclasses.replace(self, spike=spike)

    def model(self, **fields: Any) -> Slices:
        """The model of these curves, tabulated at `tabulated_theta_d`; `fields` are others of `Slices`."""
        from dsbrdf.paper.slices import Slices

        theta_d = tabulated_theta_d()
        return Slices(theta_d, *self.at(theta_d), self.spike_at(theta_d), curves=self, **fields)

    @classmethod
    def of(
        cls,
        model: Slices,
        basis: CurveBasis | None = None,
        *,
        logarithmic: bool = True,
        weights: ArrayLike | None = None,
    ) -> Curves:
        """Curves through the slices of a model, by weighted least squares.

        Parameters
        ----------
        model : Slices
            With lobes that correspond over theta_d.
        basis : CurveBasis, optional
            That of the paper by default.
        logarithmic : bool, optional
            Smooth ln(kappa) and ln(gamma).
        weights : (theta_d, channel, lobe) array_like, optional
            By default `sensitivity`: how much of the slice's light depends on the lobe.

        Returns
        -------
        Curves
        """
        basis = basis or CurveBasis()
        kappa, gamma, beta, spike = model.kappa, model.gamma, model.beta, model.spike
        weights = sensitivity(model) if weights is None else _check.finite(weights, "weights", low=0.0)
        if weights.shape != kappa.shape:
            raise ValueError(f"'weights' must have shape {kappa.shape} like kappa, got {weights.shape}.")
        kappa, gamma = variables(kappa, gamma, logarithmic)
        design = basis.design(model.theta_d)
        kappa, gamma, beta = (smooth(design, values, weights) for values in (kappa, gamma, beta))
        curves = cls(basis, kappa, gamma, beta, logarithmic)
        return curves.with_spike(model.theta_d, spike) if spike.any() else curves


def variables(
    kappa: NDArray[np.float64], gamma: NDArray[np.float64], logarithmic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What is smoothed in place of kappa and gamma."""
    if not logarithmic:
        return kappa, gamma
    return np.clip(np.log(kappa), *LN_KAPPA), np.log(np.maximum(gamma, FLAT_GAMMA))


def parameters(
    kappa: NDArray[np.float64], gamma: NDArray[np.float64], beta: NDArray[np.float64], logarithmic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """kappa, gamma and beta from values of curves; what is out of range is clipped."""
    beta = np.clip(beta, -1.0, 1.0)
    if logarithmic:
        return np.exp(np.clip(kappa, *LN_KAPPA)), np.exp(np.clip(gamma, *LN_GAMMA)), beta
    return np.clip(kappa, *np.exp(LN_KAPPA)), np.clip(gamma, 0.0, np.exp(LN_GAMMA[1])), beta


def sensitivity(model: Slices) -> NDArray[np.float64]:
    """Weights (theta_d, channel, lobe) of slices in smoothing: squares that a relative change of kappa moves.

    Summed over the theta_h of a MERL table at which all directions are above the horizon, as a fit's samples are:
    bright lobes count more, and slices near grazing, which hold few samples, less.
    """
    theta_h = cell_angles("centre", SHAPE)[0]
    kappa, gamma = model.kappa[:, :, None], model.gamma[:, :, None]
    seen = theta_h < np.pi / 2 - model.theta_d[:, None]
    height = kappa * np.exp(gamma * half_diff.log_cos(theta_h)[:, None])
    slope = height * np.exp(np.minimum(height, LN_KAPPA[1]))
    weights: NDArray[np.float64] = (slope**2 * seen[:, None, :, None]).sum(2)
    return weights


def _pull(size: int) -> NDArray[np.float64]:
    """Rows of least squares for `PULL`, the target of which is zero."""
    rows: NDArray[np.float64] = PULL * np.diff(np.eye(size), axis=0)
    return rows


def smooth(
    design: NDArray[np.float64], values: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coefficients (..., coefficient) of values (theta_d, ...) by weighted least squares."""
    peak = weights.max(0)
    relative = np.divide(weights, peak, out=np.ones_like(weights), where=peak > 0.0)
    root = np.sqrt(np.maximum(relative, LEAST_WEIGHT))
    pull = _pull(design.shape[1])
    coefficients = np.empty((*values.shape[1:], design.shape[1]))
    for index in np.ndindex(*values.shape[1:]):
        at = (slice(None), *index)
        rows = np.concatenate([root[at][:, None] * design, pull])
        target = np.concatenate([root[at] * values[at], np.zeros(len(pull))])
        coefficients[index] = np.linalg.lstsq(rows, target)[0]
    return coefficients
