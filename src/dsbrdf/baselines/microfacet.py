"""Lambert and GGX lobes: what renderers of today have, one lobe or two."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.baselines._base import AbstractBaseline, Array
from dsbrdf.fitting.observations import cell_area
from dsbrdf.geometry import half_diff
from dsbrdf.measured import reflectance
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = [
    "GGXPair",
    "LambertGGX",
    "Problem",
    "cos_theta_d",
    "fit_ggx_pair",
    "fit_lambert_ggx",
    "least",
    "solve",
    "strengths",
]

#: Range of alpha.
ALPHA = (0.001, 1.5)
#: Range of albedos and reflectances of facets. Measured values may need more than 1; nothing is cut off there.
STRENGTH = (1e-6, 30.0)
#: Alphas that the searches start from; the best end is kept.
STARTS_ONE = ((0.03,), (0.12,), (0.4,))
STARTS_TWO = ((0.02, 0.15), (0.1, 0.4), (0.03, 0.5))
#: Relative step of the derivative by alpha.
STEP = 1e-5
MAX_EVALUATIONS, TOLERANCE = 60, 1e-4
#: Of searches that only find out which start is best.
ROUGHLY = 1e-3
#: Steps between the theta_d and number of the azimuths that are looked at: a model of 13 numbers needs no more.
D_STEP, N_PHI = 4, 6
#: Offset of the logarithm, as a share of the median.
OFFSET = 0.01
#: Searches from all starts look at every so many rows, the greatest step that leaves enough of them; none has a factor
#: in common with the number of azimuths.
STEPS, ENOUGH = (13, 11, 7, 5, 1), 600


@dataclass(frozen=True, eq=False)
class _Microfacet(AbstractBaseline):
    """A Lambertian reflectance and GGX lobes, `albedo / pi + sum F D G / (4 cos_i cos_o)`.

    Parameters
    ----------
    albedo : (channel,) ndarray
        Of the Lambertian part.
    f0 : (channel, lobe) ndarray
        Reflectance of the facets of each lobe at normal incidence.
    f90 : (lobe,) ndarray
        The same at grazing, of all channels.
    alpha : (lobe,) ndarray
        Width of the lobes.
    name : str, optional

    Notes
    -----
    D and G as in `dsbrdf.measured.reflectance.ggx`. F is `f0 + (f90 - f0) (1 - cos(theta_d))^5`: Schlick, "An
    inexpensive BRDF model for physically-based rendering", Computer Graphics Forum 13(3), 1994.
    """

    albedo: Array
    f0: Array
    f90: Array
    alpha: Array
    name: str = ""

    def _values(self, wi: Array, wo: Array) -> Array:
        grazing = _schlick(wi, wo)[..., None]
        values = np.zeros((*grazing.shape[:-1], self.albedo.size)) + self.albedo / np.pi
        for f0, f90, alpha in zip(self.f0.T, self.f90, self.alpha, strict=True):
            values += (f0 + (f90 - f0) * grazing) * reflectance.ggx(wi, wo, float(alpha))
        return values


class LambertGGX(_Microfacet):
    """A Lambertian reflectance and a GGX lobe whose facets reflect everything at grazing."""

    label: ClassVar[str] = "Lambert + GGX"

    @property
    def n_parameters(self) -> int:
        """Albedo and F0 of each channel, and the width: 7 for three channels."""
        return self.albedo.size + self.f0.size + self.alpha.size


class GGXPair(_Microfacet):
    """A Lambertian reflectance and two GGX lobes, each with a colour, a width and a reflectance at grazing.

    A Torrance-Sparrow model in the form that renderers have today: GGX facets, height-correlated masking, Schlick's
    Fresnel factor.
    """

    label: ClassVar[str] = "Lambert + 2 GGX"

    @property
    def n_parameters(self) -> int:
        """Albedo and F0 of each channel, and a width and a reflectance at grazing a lobe: 13 for three channels."""
        return self.albedo.size + self.f0.size + self.f90.size + self.alpha.size


def cos_theta_d(wi: Array, wo: Array) -> Array:
    """`cos(theta_d)`, not above 1."""
    s = wi + wo
    cosine: Array = np.minimum(0.5 * np.sqrt((s * s).sum(-1)), 1.0)
    return cosine


def _schlick(wi: Array, wo: Array) -> Array:
    """`(1 - cos(theta_d))^5`."""
    power: Array = (1.0 - cos_theta_d(wi, wo)) ** 5
    return power


def fit_lambert_ggx(measured: MeasuredBRDF | Samples) -> LambertGGX:
    """Fit Lambert and a GGX lobe to all that was measured.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples

    Returns
    -------
    LambertGGX

    Raises
    ------
    ValueError
        If no value is valid.

    Notes
    -----
    As `fit_ggx_pair`, from three widths.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import baselines
    >>> found = baselines.fit_lambert_ggx(dsbrdf.material("rough-gold"))
    >>> found.alpha.round(1), found.n_parameters
    (array([0.3]), 7)
    """
    return LambertGGX(*solve(Problem.of(measured), STARTS_ONE, free_f90=False), name=measured.name)


def fit_ggx_pair(measured: MeasuredBRDF | Samples) -> GGXPair:
    """Fit Lambert and two GGX lobes to all that was measured.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples

    Returns
    -------
    GGXPair
        The narrower lobe first.

    Raises
    ------
    ValueError
        If no value is valid.

    Notes
    -----
    Squares of differences of `ln(f + offset)` by `scipy.optimize.least_squares` over the logarithms of all numbers,
    from three pairs of widths. Half of the weight is solid angle, the other half as in squares of the cube root of
    `f cos_i cos_o`; the offset is a hundredth of the median. With weight on the squares of f as well, as `dsbrdf.fit`
    has it, peaks that no GGX lobe fits cost the rest: the cube root's error rises by half.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import baselines
    >>> baselines.fit_ggx_pair(dsbrdf.material("rough-gold")).n_parameters
    13
    """
    return GGXPair(*solve(Problem.of(measured), STARTS_TWO), name=measured.name)


@dataclass(frozen=True, eq=False)
class Problem:
    """Values at pairs of directions, and which squares are to be least.

    Parameters
    ----------
    wi, wo : (row, 3) ndarray
    values, root_weight : (row, channel) ndarray
        Values in 1/sr, and square roots of the weights of squares.
    offset : (channel,) ndarray or None
        Squares are of differences of `ln(f + offset)`; None: of f itself.
    """

    wi: Array
    wo: Array
    values: Array
    root_weight: Array
    offset: Array | None

    @classmethod
    def of(cls, measured: MeasuredBRDF | Samples) -> Problem:
        """Valid samples; of a table, entries at every `D_STEP`-th theta_d and `N_PHI` azimuths.

        Raises
        ------
        ValueError
            If there is none.
        """
        if isinstance(measured, Samples):
            wi, wo, values = measured.wi, measured.wo, np.maximum(measured.values, 0.0)
            area = np.ones(len(values))
        else:
            wi, wo, values, area = _entries(measured)
        valid = np.isfinite(values)
        some = valid.any(-1) & (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
        if not some.any():
            raise ValueError(
                f"{measured.name or 'the measurement'}: no value is valid. Check that it holds positive values in 1/sr."
            )
        area = area[some][:, None] * valid[some]
        wi, wo, values = wi[some], wo[some], np.where(valid, values, 0.0)[some]
        # In ln f, squares of the cube root are weighted by its square
        weight = np.zeros_like(values)
        for of in (1.0, np.cbrt(values * (wi * wo)[:, 2:]) ** 2):
            weight += area * of / np.maximum((area * of).sum(0), 1e-300)
        offset = OFFSET * np.array(
            [_median(column[ok]) for column, ok in zip(values.T, valid[some].T, strict=True)]
        )
        return cls(wi, wo, values, np.sqrt(weight), offset)

    def thinned(self) -> Problem:
        """The same at fewer rows, or itself if it has few."""
        step = next((step for step in STEPS if len(self.wi) // step >= ENOUGH), 1)
        parts = ("wi", "wo", "values", "root_weight")
        return dataclasses.replace(self, **{name: getattr(self, name)[::step] for name in parts})

    @cached_property
    def grazing(self) -> Array:
        """Schlick's term (row,)."""
        return _schlick(self.wi, self.wo)

    def link(self, values: Array) -> tuple[Array, Array]:
        """What is compared of values (row, channel), and its derivative by them."""
        if self.offset is None:
            return values, np.ones_like(values)
        return np.log(values + self.offset), 1.0 / (values + self.offset)

    @cached_property
    def target(self) -> Array:
        """What values (row, channel) are compared as."""
        return self.link(self.values)[0]

    @cached_property
    def is_dark(self) -> NDArray[np.bool_]:
        """Which channels (channel,) are without light."""
        return np.logical_not((self.values * self.root_weight).any(0))

    def differences(self, values: Array) -> Array:
        """Weighted differences (row channel,) of values of a model (row, channel)."""
        flat: Array = (self.root_weight * (self.link(values)[0] - self.target)).ravel()
        return flat

    @cached_property
    def _geometry(self) -> tuple[Array, Array, Array, Array]:
        """`sin(theta_h)^2`, `cos(theta_h)^2`, and the cosines of the two directions."""
        s = self.wi + self.wo
        across, along = s[:, 0] ** 2 + s[:, 1] ** 2, s[:, 2] ** 2
        return across / (across + along), along / (across + along), self.wi[:, 2], self.wo[:, 2]

    def lobe(self, log_alpha: float) -> Array:
        """A GGX lobe of F = 1 at each row: `dsbrdf.measured.reflectance.ggx` without its checks, which cost as much."""
        sin2, cos2, cos_i, cos_o = self._geometry
        alpha2 = float(np.exp(2.0 * log_alpha))
        facets = alpha2 / (np.pi * (alpha2 * cos2 + sin2) ** 2)
        s_i, s_o = (np.sqrt(alpha2 + (1.0 - alpha2) * cos * cos) for cos in (cos_i, cos_o))
        values: Array = 0.5 * facets / (cos_i * s_o + cos_o * s_i)
        return values

    def lobe_slope(self, log_alpha: float) -> Array:
        """Its derivative by the logarithm of alpha."""
        slope: Array = (self.lobe(log_alpha + STEP) - self.lobe(log_alpha - STEP)) / (2.0 * STEP)
        return slope


def _entries(measured: MeasuredBRDF) -> tuple[Array, Array, Array, Array]:
    """Directions, values (theta_h, theta_d, phi_d, channel), NaN where invalid, and solid angles of some entries."""
    _check.instance(measured, MeasuredBRDF, "measured")
    n_d, n_phi = measured.planes.shape[2:]
    rows = np.arange(n_d)[min(D_STEP // 2, n_d - 1) :: D_STEP]
    columns = np.unique((np.arange(N_PHI) + 0.5) * n_phi // N_PHI).astype(int)
    values = np.moveaxis(measured.rows(rows)[..., columns], 0, -1)
    wi, wo = half_diff.to_directions(
        measured.theta_h[:, None, None], measured.theta_d[rows][:, None], measured.phi_d[columns]
    )
    area = cell_area(measured.theta_h, measured.theta_d)[rows].T[..., None]
    return wi, wo, values, np.broadcast_to(area, values.shape[:-1])


def _median(values: Array) -> float:
    """Median of what is positive; 1 if nothing is."""
    lit = values[values > 0.0]
    return float(np.median(lit)) if lit.size else 1.0


def solve(
    problem: Problem, starts: Sequence[tuple[float, ...]], *, free_f90: bool = True
) -> tuple[Array, Array, Array, Array]:
    """Albedo (channel,), F0 (channel, lobe), F90 (lobe,) and alpha (lobe,), ascending, from the best of several alphas.

    F90 is 1 unless it is free.
    """
    n_lobes = len(starts[0])

    def search(of: Problem) -> Search:
        return Search(of, n_lobes, free_f90)

    bounds = np.full((2, search(problem).size), np.log(STRENGTH)[:, None])
    bounds[:, -n_lobes:] = np.log(ALPHA)[:, None]
    few = search(problem.thinned())
    best = least(search, problem, [few.start(alphas) for alphas in starts], bounds)
    albedo, f0, f90, log_alpha = few.split(best)
    order = np.argsort(log_alpha)
    # A channel without light has none
    dark = problem.is_dark
    albedo, f0 = np.where(dark, 0.0, albedo), np.where(dark[:, None], 0.0, f0)
    return albedo, f0[:, order], np.where(dark.all(), 0.0, f90[order]), np.exp(log_alpha[order])


class Squares(Protocol):
    """Differences, whose squares are to be least, and their derivatives."""

    def residual(self, x: Array) -> Array:
        """Weighted differences, (row channel,)."""

    def jacobian(self, x: Array) -> Array:
        """Derivatives (row channel, unknown)."""


def least(
    squares: Callable[[Problem], Squares], problem: Problem, starts: Sequence[Array], bounds: Array
) -> Array:
    """Unknowns within bounds (2, unknown) of least squares: the best of several starts on few rows, then on all."""
    from scipy import optimize

    def end(of: Squares, start: Array, tolerance: float) -> Any:
        return optimize.least_squares(
            of.residual,
            np.clip(start, bounds[0] + 1e-3, bounds[1] - 1e-3),
            of.jacobian,
            bounds=bounds,
            method="dogbox",
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            max_nfev=MAX_EVALUATIONS,
        )

    few = squares(problem.thinned())
    best = min((end(few, start, ROUGHLY) for start in starts), key=lambda result: float(result.cost))
    return np.asarray(end(squares(problem), best.x, TOLERANCE).x)


def strengths(problem: Problem, log_alpha: Array) -> Array:
    """Albedo and strengths of lobes (channel, 1 + lobe) at widths, by non-negative least squares of what is compared.

    Of a logarithm these are relative differences. None is left at nothing: from there no step leads back.
    """
    from scipy.optimize import nnls

    columns = np.stack([np.full(len(problem.wi), 1.0 / np.pi), *map(problem.lobe, log_alpha)], axis=-1)
    scales = problem.root_weight * problem.link(problem.values)[1]
    found = np.stack(
        [
            nnls(scale[:, None] * columns, scale * values)[0]
            for scale, values in zip(scales.T, problem.values.T, strict=True)
        ]
    )
    least_of_all = 1e-3 * max(float(found.max()), 1e-3)
    strength: Array = np.maximum(found, least_of_all)
    return strength


class Search:
    """Residuals and their derivatives by the logarithms of albedo, F0, F90 and alpha, in this order."""

    def __init__(self, problem: Problem, n_lobes: int, free_f90: bool) -> None:
        self.problem, self.n_lobes, self.free_f90 = problem, n_lobes, free_f90
        self.n_channels = problem.values.shape[1]
        self.size = self.n_channels * (1 + n_lobes) + n_lobes * (1 + free_f90)

    def split(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Albedo (channel,), F0 (channel, lobe), F90 (lobe,) and ln alpha (lobe,)."""
        c, k = self.n_channels, self.n_lobes
        f90 = np.exp(x[c * (1 + k) : -k]) if self.free_f90 else np.ones(k)
        return np.exp(x[:c]), np.exp(x[c : c * (1 + k)]).reshape(c, k), f90, x[-k:]

    def start(self, alphas: tuple[float, ...]) -> Array:
        """Unknowns at widths."""
        log_alpha = np.log(alphas)
        strength = np.log(strengths(self.problem, log_alpha))
        f90 = np.zeros(self.n_lobes * self.free_f90)
        return np.concatenate([strength[:, 0], strength[:, 1:].ravel(), f90, log_alpha])

    def _model(self, x: Array) -> tuple[Array, Array]:
        """Values (row, channel) and lobes (lobe, row)."""
        albedo, f0, f90, log_alpha = self.split(x)
        lobes = np.stack([self.problem.lobe(a) for a in log_alpha])
        grazing = self.problem.grazing
        shaped = np.einsum("kr,ck->rc", lobes * (1.0 - grazing), f0)
        return albedo / np.pi + shaped + ((f90 @ lobes) * grazing)[:, None], lobes

    def residual(self, x: Array) -> Array:
        """Weighted differences, (row channel,)."""
        values, _ = self._model(x)
        return self.problem.differences(values)

    def jacobian(self, x: Array) -> Array:
        """Derivatives (row channel, unknown)."""
        problem, c, k = self.problem, self.n_channels, self.n_lobes
        albedo, f0, f90, log_alpha = self.split(x)
        values, lobes = self._model(x)
        outer = problem.root_weight * problem.link(values)[1]
        jacobian = np.zeros((len(values), c, self.size))
        for channel in range(c):
            jacobian[:, channel, channel] = albedo[channel] / np.pi
            for lobe in range(k):
                by = f0[channel, lobe] * (1.0 - problem.grazing) * lobes[lobe]
                jacobian[:, channel, c + channel * k + lobe] = by
        for lobe in range(k):
            if self.free_f90:
                at = c * (1 + k) + lobe
                jacobian[:, :, at] = (f90[lobe] * problem.grazing * lobes[lobe])[:, None]
            slope = problem.lobe_slope(log_alpha[lobe])
            fresnel = f0[:, lobe] + (f90[lobe] - f0[:, lobe]) * problem.grazing[:, None]
            jacobian[:, :, self.size - k + lobe] = fresnel * slope[:, None]
        jacobian *= outer[..., None]
        return jacobian.reshape(-1, self.size)
