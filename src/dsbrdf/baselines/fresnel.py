"""Lambert and a GGX lobe whose facets are mirrors of some material: a microfacet model with Fresnel's equations."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dsbrdf.baselines._base import AbstractBaseline, Array
from dsbrdf.baselines.microfacet import ALPHA, STEP, STRENGTH, Problem, cos_theta_d, least, strengths
from dsbrdf.measured import reflectance
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["FresnelGGX", "fit_fresnel_ggx", "fresnel"]

#: Ranges of the two parts of the refractive index.
INDEX, EXTINCTION = (0.05, 20.0), (1e-3, 20.0)
#: What searches start from: plastic or glass, and metal; the widths with each.
STARTS, WIDTHS = ((1.5, 0.05), (0.8, 3.0)), (0.03, 0.12, 0.4)


def fresnel(cos_d: Array, index: Array, extinction: Array) -> Array:
    """Share of unpolarised light that a smooth surface in air reflects, by Fresnel's equations.

    Parameters
    ----------
    cos_d : ndarray
        Cosine of the angle to the normal of the surface.
    index, extinction : ndarray
        Real and imaginary part of the refractive index; all three broadcast.

    Notes
    -----
    M. Born and E. Wolf, *Principles of Optics*, 7th edition, Section 14.2.
    """
    refractive = (index + 1j * extinction) ** 2
    inside = np.sqrt(refractive - (1.0 - cos_d * cos_d))
    across = np.abs((cos_d - inside) / (cos_d + inside)) ** 2
    along = np.abs((refractive * cos_d - inside) / (refractive * cos_d + inside)) ** 2
    share: Array = 0.5 * (across + along)
    return share


@dataclass(frozen=True, eq=False)
class FresnelGGX(AbstractBaseline):
    """A Lambertian reflectance and a GGX lobe, `albedo / pi + F D G / (4 cos_i cos_o)`, F by Fresnel's equations.

    Parameters
    ----------
    albedo : (channel,) ndarray
        Of the Lambertian part.
    index, extinction : (channel,) ndarray
        Real and imaginary part of the refractive index of the facets.
    alpha : float
        Width of the lobe.
    name : str, optional

    Notes
    -----
    D and G as in `dsbrdf.measured.reflectance.ggx`. That of Cook and Torrance, "A reflectance model for computer
    graphics", ACM Trans. Graph. 1(1), 1982, with the facets of renderers of today. Facets reflect no more than they
    get.

    Examples
    --------
    >>> import numpy as np
    >>> from dsbrdf.baselines import FresnelGGX
    >>> glass = FresnelGGX(np.zeros(1), np.array([1.5]), np.zeros(1), 0.1)
    >>> glass.eval([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]).round(3)  # 0.04 / (4 pi 0.1^2)
    array([0.318])
    """

    label: ClassVar[str] = "Lambert + GGX, Fresnel"

    albedo: Array
    index: Array
    extinction: Array
    alpha: float
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Albedo and both parts of the index of each channel, and the width: 10 for three channels."""
        return 3 * self.albedo.size + 1

    def _values(self, wi: Array, wo: Array) -> Array:
        share = fresnel(np.maximum(cos_theta_d(wi, wo)[..., None], 1e-12), self.index, self.extinction)
        values: Array = self.albedo / np.pi + share * reflectance.ggx(wi, wo, self.alpha)
        return values


def fit_fresnel_ggx(measured: MeasuredBRDF | Samples) -> FresnelGGX:
    """Fit Lambert and a GGX lobe with Fresnel's equations to all that was measured.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples

    Returns
    -------
    FresnelGGX

    Raises
    ------
    ValueError
        If no value is valid.

    Notes
    -----
    The squares of `fit_ggx_pair`, from three widths, each of facets of plastic and of metal.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import baselines
    >>> baselines.fit_fresnel_ggx(dsbrdf.material("rough-gold")).n_parameters
    10
    """
    problem = Problem.of(measured)
    n, few = problem.values.shape[1], problem.thinned()
    bounds = np.log(np.repeat([STRENGTH, INDEX, EXTINCTION, ALPHA], [n, n, n, 1], axis=0).T)
    starts = []
    for (index, extinction), width in itertools.product(STARTS, WIDTHS):
        log_alpha = np.log([width])
        albedo = strengths(few, log_alpha)[:, 0]
        starts.append(np.log(np.concatenate([albedo, np.full(n, index), np.full(n, extinction), [width]])))
    x = np.exp(least(Search, problem, starts, bounds))
    return FresnelGGX(
        np.where(problem.is_dark, 0.0, x[:n]), x[n : 2 * n], x[2 * n : 3 * n], float(x[-1]), measured.name
    )


class Search:
    """Residuals and their derivatives by the logarithms of albedo, index, extinction and alpha, in this order."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.n = problem, problem.values.shape[1]
        self.cos_d = cos_theta_d(problem.wi, problem.wo)[:, None]

    def _share(self, log_index: Array, log_extinction: Array) -> Array:
        return fresnel(self.cos_d, np.exp(log_index), np.exp(log_extinction))

    def _parts(self, x: Array) -> tuple[Array, Array, Array, float]:
        n = self.n
        return np.exp(x[:n]) / np.pi, x[n : 2 * n], x[2 * n : 3 * n], float(x[-1])

    def residual(self, x: Array) -> Array:
        """Weighted differences, (row channel,)."""
        diffuse, index, extinction, log_alpha = self._parts(x)
        values = diffuse + self._share(index, extinction) * self.problem.lobe(log_alpha)[:, None]
        return self.problem.differences(values)

    def jacobian(self, x: Array) -> Array:
        """Derivatives (row channel, unknown)."""
        problem, n = self.problem, self.n
        diffuse, index, extinction, log_alpha = self._parts(x)
        lobe, share = problem.lobe(log_alpha)[:, None], self._share(index, extinction)
        outer = problem.root_weight * problem.link(diffuse + share * lobe)[1]
        by_index = (self._share(index + STEP, extinction) - self._share(index - STEP, extinction)) * lobe
        by_extinction = (self._share(index, extinction + STEP) - self._share(index, extinction - STEP)) * lobe
        jacobian = np.zeros((len(lobe), n, x.size))
        for channel in range(n):
            jacobian[:, channel, channel] = diffuse[channel]
            jacobian[:, channel, n + channel] = by_index[:, channel] / (2.0 * STEP)
            jacobian[:, channel, 2 * n + channel] = by_extinction[:, channel] / (2.0 * STEP)
        jacobian[:, :, -1] = share * problem.lobe_slope(log_alpha)[:, None]
        jacobian *= outer[..., None]
        return jacobian.reshape(-1, x.size)
