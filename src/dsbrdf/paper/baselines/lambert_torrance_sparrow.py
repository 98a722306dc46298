"""Lambert and two Torrance-Sparrow lobes per channel: the competitor of Fig. 7 (Section 6.B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Unpack

import numpy as np

from dsbrdf.baselines import AbstractBaseline
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.baselines._base import Array, SliceOptions, ratio
from dsbrdf.paper.baselines._samples import Samples, gather_samples, refine

__all__ = ["LambertTorranceSparrow", "fit_lambert_torrance_sparrow"]

#: Range of the roughness, in slope; narrower lobes fall between the samples.
ROUGHNESS = (0.005, 2.0)
#: Values of the roughness whose pairs are tried, and starts of the search that are taken from them.
N_GRID, N_STARTS = 40, 4
_MIN_COSINE = 1e-12


@dataclass(frozen=True, eq=False)
class LambertTorranceSparrow(AbstractBaseline):
    """A Lambertian reflectance and microfacet lobes, `albedo / pi + sum a D G / (4 cos_i cos_o)`.

    Parameters
    ----------
    albedo : (channel,) ndarray
        Of the Lambertian part.
    lobe_albedo : (channel, lobe) ndarray
        Reflectance of the facets of each lobe; their Fresnel factor is taken as constant.
    roughness : (channel, lobe) ndarray
        RMS slope of the facets of each lobe.
    name : str, optional

    Notes
    -----
    G: V-cavities, `min(1, 2 (n.h) (n.wi) / (wi.h), 2 (n.h) (n.wo) / (wo.h))`; Torrance and Sparrow, "Theory
    for off-specular reflection from roughened surfaces", J. Opt. Soc. Am. 57, 1105 (1967). D: Beckmann's
    distribution `exp(-tan(theta_h)^2 / m^2) / (pi m^2 cos(theta_h)^4)`; Cook and Torrance, "A reflectance
    model for computer graphics", ACM Trans. Graph. 1, 7 (1982). References 7 and 6 of the paper.
    """

    label: ClassVar[str] = "Lambert + Torrance-Sparrow"

    albedo: Array
    lobe_albedo: Array
    roughness: Array
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Albedos and roughnesses of all channels: 15 with two lobes and three channels."""
        return self.albedo.size + self.lobe_albedo.size + self.roughness.size

    def _values(self, wi: Array, wo: Array) -> Array:
        tan_sq, shadowing = _half_slope(wi, wo), _shadowing(wi, wo)
        values = np.empty((*tan_sq.shape, self.albedo.size))
        for channel, (albedo, lobe_albedo, roughness) in enumerate(
            zip(self.albedo, self.lobe_albedo, self.roughness, strict=True)
        ):
            lobes = sum(a * _facets(tan_sq, m) for a, m in zip(lobe_albedo, roughness, strict=True))
            values[..., channel] = albedo / np.pi + lobes * shadowing
        return values


def _half_slope(wi: Array, wo: Array) -> Array:
    """`tan(theta_h)^2`, bounded."""
    s = wi + wo
    across = s[..., 0] ** 2 + s[..., 1] ** 2
    slope: Array = across / np.maximum(s[..., 2] ** 2, 1e-20 * np.maximum(across, 1e-200))
    return slope


def _facets(tan_sq: Array, roughness: float | Array) -> Array:
    """Beckmann's distribution of facet normals, in 1/sr."""
    m_sq = np.square(roughness)
    density: Array = np.exp(-tan_sq / m_sq) * (1.0 + tan_sq) ** 2 / (np.pi * m_sq)
    return density


def _shadowing(wi: Array, wo: Array) -> Array:
    """`G / (4 cos_i cos_o)` of V-cavities; the smaller cosine cancels where G < 1."""
    cos_i, cos_o = (np.maximum(w[..., 2], _MIN_COSINE) for w in (wi, wo))
    s = wi + wo
    # (n.h) / (wi.h) = 2 s_z / |s|^2
    ratio = 2.0 * np.maximum(s[..., 2], 0.0) / np.maximum((s * s).sum(-1), _MIN_COSINE)
    unshadowed = 1.0 / (cos_i * cos_o)
    value: Array = 0.25 * np.minimum(unshadowed, 2.0 * ratio / np.maximum(cos_i, cos_o))
    return value


def fit_lambert_torrance_sparrow(
    measured: MeasuredBRDF, **options: Unpack[SliceOptions]
) -> LambertTorranceSparrow:
    """Fit Lambert and two Torrance-Sparrow lobes to each channel by least squares over all samples.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    LambertTorranceSparrow
        The wider lobe last. A channel of zeros has albedos of zero.

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.

    Notes
    -----
    A lobe is a function of theta_h times one of the geometry without parameters. The squares over all samples
    are therefore those over two rows for each theta_h, plus a constant. Albedos are solved for by
    non-negative least squares, and all pairs of a grid of roughnesses are tried before the best are refined:
    no start is set by hand.
    """
    tan_sq, rows, targets = _collapse(gather_samples(measured, **options))
    log_grid = np.log(np.geomspace(*ROUGHNESS, N_GRID))
    albedo = np.zeros(measured.n_channels)
    lobe_albedo, roughness = np.zeros((measured.n_channels, 2)), np.ones((measured.n_channels, 2))
    for channel, (row, target) in enumerate(zip(rows, targets, strict=True)):
        if not target.any():
            continue

        def basis(log_roughness: Array, row: Array = row) -> Array:
            lobes = _facets(tan_sq[:, None, None], np.exp(log_roughness))
            columns = row[:, 1, :, None] * lobes
            lambert = row[:, 0, :, None] / np.pi
            return np.concatenate([lambert, columns], axis=-1).reshape(-1, 1 + log_roughness.size)

        starts = log_grid[_best_pairs(basis(log_grid), target.ravel())]
        x, c, _ = refine(basis, target.ravel(), starts, log_grid[0], log_grid[-1])
        order = np.argsort(x)
        albedo[channel], lobe_albedo[channel] = c[0], c[1:][order]
        roughness[channel] = np.exp(x[order])
    return LambertTorranceSparrow(albedo, lobe_albedo, roughness, measured.name)


def _collapse(samples: Samples) -> tuple[Array, Array, Array]:
    """The squares of `u + v g`, g = G / (4 cos_i cos_o), over the samples of a theta_h, as two rows each.

    Returns
    -------
    tan_sq : (theta_h,) ndarray
    rows : (channel, theta_h, term, 2) ndarray
        Factors of u and of v in the two rows.
    targets : (channel, theta_h, 2) ndarray
    """
    nodes, index = np.unique(samples.theta_h, return_inverse=True)
    above = (samples.wi[..., 2] >= 0.0) & (samples.wo[..., 2] >= 0.0)
    geometry = _shadowing(samples.wi, samples.wo)
    weights = np.stack([above, above * geometry, above * geometry**2], axis=1)
    sums = np.zeros((len(nodes), 5, samples.count.shape[-1]))
    np.add.at(sums, index, np.concatenate([weights @ samples.count, weights[:, :2] @ samples.total], axis=1))
    n, g, gg, f, fg = sums.transpose(1, 2, 0)

    # Cholesky factor of [[n, g], [g, gg]]; a row without weight says nothing
    first = np.sqrt(n)
    across = ratio(g, first)
    second = np.sqrt(np.maximum(gg - across**2, 0.0))
    second[second**2 < 1e-12 * gg] = 0.0
    target = ratio(f, first)
    rows = np.stack([np.stack([first, np.zeros_like(first)], -1), np.stack([across, second], -1)], axis=-2)
    return np.tan(nodes) ** 2, rows, np.stack([target, ratio(fg - across * target, second)], axis=-1)


def _best_pairs(columns: Array, target: Array) -> list[tuple[int, int]]:
    """Pairs of lobes that fit best with column 0 of (row, 1 + lobe), apart from each other on the grid."""
    gram, moment = columns.T @ columns, columns.T @ target
    first, second = np.triu_indices(len(gram) - 1, 1)
    members = np.stack([np.zeros_like(first), first + 1, second + 1], axis=-1)
    gain = np.zeros(len(first))
    # Non-negative least squares of three columns: the best of the seven subsets that comes out positive
    for subset in ([0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2]):
        some = members[:, subset]
        diagonal = np.sqrt(np.maximum(gram[some, some], 1e-300))
        scaled = gram[some[:, :, None], some[:, None, :]] / (diagonal[:, :, None] * diagonal[:, None, :])
        scaled += 1e-13 * np.eye(len(subset))
        right = moment[some] / diagonal
        solution = np.linalg.solve(scaled, right[..., None])[..., 0]
        gain = np.maximum(gain, np.where((solution >= 0.0).all(-1), (solution * right).sum(-1), 0.0))
    taken: list[tuple[int, int]] = []
    for pair in np.argsort(-gain, kind="stable"):
        candidate = (int(first[pair]), int(second[pair]))
        if all(max(abs(a - b) for a, b in zip(candidate, other, strict=True)) > 2 for other in taken):
            taken.append(candidate)
        if len(taken) == N_STARTS:
            break
    return taken
