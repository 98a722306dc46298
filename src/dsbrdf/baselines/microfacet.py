"""Lambert and GGX lobes: what renderers of today have, one lobe or two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dsbrdf.baselines._base import AbstractBaseline, Array
from dsbrdf.fitting.observations import cell_area
from dsbrdf.geometry import half_diff
from dsbrdf.measured import reflectance
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["GGXPair", "LambertGGX", "Problem", "fit_ggx_pair", "fit_lambert_ggx", "solve"]

#: Range of alpha.
ALPHA = (0.001, 1.5)
#: Range of albedos and reflectances of facets. Measured values may need more than 1; nothing is cut off there.
STRENGTH = (1e-6, 30.0)
#: Alphas that the searches start from; the best end is kept.
STARTS_ONE = ((0.03,), (0.12,), (0.4,))
STARTS_TWO = ((0.02, 0.15), (0.1, 0.4))
#: Relative step of the derivative by alpha.
STEP = 1e-5
MAX_EVALUATIONS, TOLERANCE = 60, 1e-5
#: Steps between the theta_d and number of the azimuths that are looked at: a model of 13 numbers needs no more.
D_STEP, N_PHI = 4, 6
#: Offset of the logarithm, as a share of the median.
OFFSET = 0.01


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


def _schlick(wi: Array, wo: Array) -> Array:
    """`(1 - cos(theta_d))^5`."""
    s = wi + wo
    power: Array = (1.0 - np.minimum(0.5 * np.sqrt((s * s).sum(-1)), 1.0)) ** 5
    return power


def fit_lambert_ggx(measured: MeasuredBRDF) -> LambertGGX:
    """Fit Lambert and a GGX lobe to all that was measured.

    Parameters
    ----------
    measured : MeasuredBRDF

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


def fit_ggx_pair(measured: MeasuredBRDF) -> GGXPair:
    """Fit Lambert and two GGX lobes to all that was measured.

    Parameters
    ----------
    measured : MeasuredBRDF

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
    from two pairs of widths. Half of the weight is solid angle, the other half as in squares of the cube root of
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
    def of(cls, measured: MeasuredBRDF) -> Problem:
        """Valid entries at every `D_STEP`-th theta_d and `N_PHI` azimuths.

        Raises
        ------
        ValueError
            If there is none.
        """
        n_d, n_phi = measured.planes.shape[2:]
        rows = np.arange(n_d)[min(D_STEP // 2, n_d - 1) :: D_STEP]
        columns = np.unique((np.arange(N_PHI) + 0.5) * n_phi // N_PHI).astype(int)
        values = np.moveaxis(measured.rows(rows)[..., columns], 0, -1)
        wi, wo = half_diff.to_directions(
            measured.theta_h[:, None, None], measured.theta_d[rows][:, None], measured.phi_d[columns]
        )
        valid = np.isfinite(values)
        some = valid.any(-1) & (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
        if not some.any():
            raise ValueError(
                f"{measured.name or 'the table'}: no value is valid. Check that it holds positive values in 1/sr."
            )
        area = cell_area(measured.theta_h, measured.theta_d)[rows].T[..., None]
        area = np.broadcast_to(area, some.shape)[some][:, None] * valid[some]
        wi, wo, values = wi[some], wo[some], np.where(valid, values, 0.0)[some]
        # In ln f, squares of the cube root are weighted by its square
        weight = np.zeros_like(values)
        for of in (1.0, np.cbrt(values * (wi * wo)[:, 2:]) ** 2):
            weight += area * of / np.maximum((area * of).sum(0), 1e-300)
        offset = OFFSET * np.array(
            [_median(column[ok]) for column, ok in zip(values.T, valid[some].T, strict=True)]
        )
        return cls(wi, wo, values, np.sqrt(weight), offset)

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
    from scipy import optimize

    n_lobes = len(starts[0])
    search = Search(problem, n_lobes, free_f90)
    low, high = np.log(STRENGTH)
    bounds = np.full((2, search.size), [[low], [high]])
    bounds[:, -n_lobes:] = np.log(ALPHA)[:, None]
    results: list[Any] = []
    for alphas in starts:
        start = np.clip(search.start(alphas), bounds[0] + 1e-3, bounds[1] - 1e-3)
        results.append(
            optimize.least_squares(
                search.residual,
                start,
                search.jacobian,
                bounds=bounds,
                method="dogbox",
                x_scale="jac",
                ftol=TOLERANCE,
                xtol=TOLERANCE,
                max_nfev=MAX_EVALUATIONS,
            )
        )
    best = min(results, key=lambda result: float(result.cost))
    albedo, f0, f90, log_alpha = search.split(best.x)
    order = np.argsort(log_alpha)
    # A channel without light has none
    dark: NDArray[np.bool_] = np.logical_not((problem.values * problem.root_weight).any(0))
    albedo, f0 = np.where(dark, 0.0, albedo), np.where(dark[:, None], 0.0, f0)
    return albedo, f0[:, order], np.where(dark.all(), 0.0, f90[order]), np.exp(log_alpha[order])


class Search:
    """Residuals and their derivatives by the logarithms of albedo, F0, F90 and alpha, in this order."""

    def __init__(self, problem: Problem, n_lobes: int, free_f90: bool) -> None:
        self.problem, self.n_lobes, self.free_f90 = problem, n_lobes, free_f90
        self.n_channels = problem.values.shape[1]
        self.size = self.n_channels * (1 + n_lobes) + n_lobes * (1 + free_f90)
        self.target = problem.link(problem.values)[0]

    def split(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Albedo (channel,), F0 (channel, lobe), F90 (lobe,) and ln alpha (lobe,)."""
        c, k = self.n_channels, self.n_lobes
        f90 = np.exp(x[c * (1 + k) : -k]) if self.free_f90 else np.ones(k)
        return np.exp(x[:c]), np.exp(x[c : c * (1 + k)]).reshape(c, k), f90, x[-k:]

    def start(self, alphas: tuple[float, ...]) -> Array:
        """Unknowns at widths: strengths by non-negative least squares, of relative differences for a logarithm."""
        from scipy.optimize import nnls

        problem = self.problem
        log_alpha = np.log(alphas)
        columns = np.stack([np.full(len(problem.wi), 1.0 / np.pi), *map(problem.lobe, log_alpha)], axis=-1)
        strength = np.zeros((self.n_channels, 1 + self.n_lobes))
        scales = problem.root_weight * problem.link(problem.values)[1]
        for channel, scale in enumerate(scales.T):
            strength[channel] = nnls(scale[:, None] * columns, scale * problem.values[:, channel])[0]
        # None is left at nothing: from there no step leads back
        least = 1e-3 * np.maximum(strength.max(), 1e-3)
        strength = np.log(np.maximum(strength, least))
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
        flat: Array = (self.problem.root_weight * (self.problem.link(values)[0] - self.target)).ravel()
        return flat

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
            up, down = (problem.lobe(log_alpha[lobe] + step) for step in (STEP, -STEP))
            slope = (up - down) / (2.0 * STEP)
            fresnel = f0[:, lobe] + (f90[lobe] - f0[:, lobe]) * problem.grazing[:, None]
            jacobian[:, :, self.size - k + lobe] = fresnel * slope[:, None]
        jacobian *= outer[..., None]
        return jacobian.reshape(-1, self.size)
