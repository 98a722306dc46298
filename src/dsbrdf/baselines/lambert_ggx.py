"""Lambert and one GGX lobe: what renderers of today have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Unpack

import numpy as np
from numpy.typing import NDArray

from dsbrdf.baselines._base import AbstractBaseline, Array, SliceOptions, ratio
from dsbrdf.baselines._samples import Samples, gather_samples
from dsbrdf.measured import reflectance
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["LambertGGX", "fit_lambert_ggx"]

#: Range of alpha, and values in it that are tried before the best is refined.
ALPHA = (0.001, 1.5)
N_GRID = 24


@dataclass(frozen=True, eq=False)
class LambertGGX(AbstractBaseline):
    """A Lambertian reflectance and a GGX lobe, `albedo / pi + F D G / (4 cos_i cos_o)`.

    Parameters
    ----------
    albedo : (channel,) ndarray
        Of the Lambertian part.
    f0 : (channel,) ndarray in [0, 1]
        Reflectance of the facets at normal incidence.
    alpha : (1,) or (channel,) ndarray
        Width of the lobe, of all channels or of each.
    name : str, optional

    Notes
    -----
    D and G as in `dsbrdf.measured.reflectance.ggx`. F: Schlick, "An inexpensive BRDF model for physically-based
    rendering", Computer Graphics Forum 13(3), 1994.
    """

    label: ClassVar[str] = "Lambert + GGX"

    albedo: Array
    f0: Array
    alpha: Array
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Albedo and F0 of each channel and the widths: 7 for three channels with one width."""
        return self.albedo.size + self.f0.size + self.alpha.size

    def _values(self, wi: Array, wo: Array) -> Array:
        lobes = np.concatenate([reflectance.ggx(wi, wo, float(alpha)) for alpha in self.alpha], axis=-1)
        grazing = _schlick(wi, wo)[..., None]
        values: Array = self.albedo / np.pi + (self.f0 + (1.0 - self.f0) * grazing) * lobes
        return values


def _schlick(wi: Array, wo: Array) -> Array:
    """`(1 - cos(theta_d))^5`."""
    s = wi + wo
    power: Array = (1.0 - np.minimum(0.5 * np.sqrt((s * s).sum(-1)), 1.0)) ** 5
    return power


def fit_lambert_ggx(
    measured: MeasuredBRDF, *, common_alpha: bool = True, **options: Unpack[SliceOptions]
) -> LambertGGX:
    """Fit Lambert and a GGX lobe by least squares over all samples.

    Parameters
    ----------
    measured : MeasuredBRDF
    common_alpha : bool, optional
        One width for all channels, as renderers have it, or one for each.
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    LambertGGX

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.

    Notes
    -----
    Albedo and F0 follow from alpha by least squares within their bounds; alpha is searched on a grid and then
    by Brent's method about the best value.
    """
    from scipy import optimize

    samples = gather_samples(measured, **options)
    channels = np.arange(measured.n_channels)
    above = (samples.wi[..., 2] >= 0.0) & (samples.wo[..., 2] >= 0.0)
    grazing = _schlick(samples.wi, samples.wo)

    def solve(log_alpha: float, subset: NDArray[np.intp]) -> tuple[Array, Array]:
        lobe = reflectance.ggx(samples.wi, samples.wo, float(np.exp(log_alpha)))[..., 0]
        return _solve(samples, subset, above / np.pi, (1.0 - grazing) * lobe, grazing * lobe)

    log_grid = np.log(np.geomspace(*ALPHA, N_GRID))
    costs = np.array([solve(log_alpha, channels)[1] for log_alpha in log_grid])
    subsets = [channels] if common_alpha else list(channels[:, None])
    log_alpha = np.empty(len(subsets))
    linear = np.empty((measured.n_channels, 2))
    for i, subset in enumerate(subsets):
        best = int(costs[:, subset].sum(1).argmin())
        low, high = log_grid[max(best - 1, 0)], log_grid[min(best + 1, N_GRID - 1)]

        def cost(x: float, subset: NDArray[np.intp] = subset) -> float:
            return float(solve(x, subset)[1].sum())

        found = optimize.minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
        log_alpha[i] = found.x
        linear[subset] = solve(log_alpha[i], subset)[0]
    return LambertGGX(linear[:, 0], linear[:, 1], np.exp(log_alpha), measured.name)


def _solve(
    samples: Samples, channels: NDArray[np.intp], lambert: Array, lobe: Array, offset: Array
) -> tuple[Array, Array]:
    """Least squares of `x lambert + y lobe + offset` with x >= 0 and y in [0, 1].

    Returns
    -------
    solution : (channel, 2) ndarray
        x and y.
    cost : (channel,) ndarray
        Sum of squares about the mean of each sample's equals.
    """
    lambert, lobe, offset = (basis.ravel() for basis in (lambert, lobe, offset))
    n = samples.count[..., channels].reshape(lambert.size, -1)
    total = samples.total[..., channels].reshape(lambert.size, -1)
    left = total - n * offset[:, None]
    xx, xy, yy = (basis @ n for basis in (lambert * lambert, lambert * lobe, lobe * lobe))
    x0, y0 = lambert @ left, lobe @ left

    def x_of(y: Array) -> Array:
        return np.maximum(ratio(x0 - xy * y, xx), 0.0)

    # Minimum inside, or the best of those on the three edges
    y_inside = np.clip(ratio(xx * y0 - xy * x0, xx * yy - xy * xy), 0.0, 1.0)
    y_edge = np.clip(ratio(y0, yy), 0.0, 1.0)
    candidates = [(x_of(y), y) for y in (y_inside, np.zeros_like(y0), np.ones_like(y0))]
    candidates.append((np.zeros_like(x0), y_edge))
    x, y = np.array(candidates).swapaxes(0, 1)
    squares = x * (x * xx + 2.0 * y * xy - 2.0 * x0) + y * (y * yy - 2.0 * y0)
    best = squares.argmin(0), np.arange(squares.shape[1])
    x, y = x[best], y[best]
    residual = np.outer(lambert, x) + np.outer(lobe, y) + offset[:, None] - ratio(total, n)
    return np.stack([x, y], axis=-1), np.einsum("nc,nc,nc->c", n, residual, residual)
