"""Tables with which a renderer draws directions from lobes, made with NumPy.

A renderer knows one direction only. For a row of angles of that direction, half vectors are drawn from a mixture of
lobes, those of the slice at that angle, channels merged into one; of a spike; and directions are drawn from the cosine.

- A lobe is a mixture of cosine powers, `expm1(kappa u^gamma) = sum kappa^n u^(n gamma) / n!` with u = cos(theta_h), so
  a draw is `u = xi^(1 / exponent)` with an exponent taken from an alias table (Walker 1977; Vose 1991): one look-up.
  A cosine-weighted direction is one more power.
- A half vector h and its image at the other azimuth are exchanged so that the one turned toward the direction is met
  in proportion to its projected area (Heitz and d'Eon 2014): few samples fall below the horizon.
- The shares of the mixture are those of least Kullback-Leibler divergence from what is to be sampled, the value times
  the cosine; a few steps of EM on quadrature nodes find them.

The density of all this has a closed form, so a weight `value cos / pdf` is exact whatever the shares are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from dsbrdf.geometry import half_diff
from dsbrdf.paper import spike

__all__ = ["COSINE", "N_ROWS", "SPIKE", "SamplingTables", "sampling_tables"]

Array = NDArray[np.float64]

#: Rows in the angle of the known direction: every three degrees.
N_ROWS = 31
#: Least share of cosine-weighted directions; covers what lobes leave out.
MIN_COSINE_SHARE = 0.05
#: Exponents that stand for something else: a cosine-weighted direction, and the spike.
COSINE, SPIKE = -2.0, 0.0
#: Lobes dimmer than this are sampled as if they were as bright.
MIN_KAPPA = 1e-9
EM_STEPS = 15


@dataclass(frozen=True, eq=False)
class SamplingTables:
    """What a renderer looks up by the row of the known direction's angle.

    Parameters
    ----------
    lobes : (row, lobe, 3) ndarray
        kappa, gamma, and the factor from `expm1(kappa u^gamma) u` to the density of half vectors over solid angle.
    shares : (row, 2) ndarray
        Of cosine-weighted directions, and of the spike.
    alias : (row, entry, 3) ndarray
        Probability to stay with an entry, its exponent, and the exponent to take otherwise.
    """

    lobes: Array
    shares: Array
    alias: Array


def sampling_tables(
    value: Callable[[Array, Array], Array], theta_d: Array, kappa: Array, gamma: Array, height: Array
) -> SamplingTables:
    """Tables for a reflectance and lobes that resemble it.

    Parameters
    ----------
    value : callable
        `value(wi, wo)` is (..., channel) in 1/sr for unit vectors (..., 3).
    theta_d : (theta_d,) ndarray, radians
    kappa, gamma : (theta_d, channel, lobe) ndarray
    height : (theta_d, channel) ndarray, 1/sr
        Of the spike.
    """
    nodes = _nodes()
    row_of = np.abs(theta_d - nodes.theta_i[:, None]).argmin(1)
    kappa, gamma = (x[row_of] for x in _merged(kappa, gamma))
    powers, normaliser = _powers(kappa, gamma)
    lobes = normaliser[..., None] * np.expm1(kappa[..., None] * np.exp(gamma[..., None] * nodes.log_u))
    cap = np.broadcast_to(spike.solid_angle_density(nodes.sin2), (N_ROWS, 1, len(nodes.sin2)))
    of_half = np.concatenate([lobes * np.exp(nodes.log_u), cap], axis=1)
    share = _shares(nodes.integrand(value), of_half, nodes, with_spike=bool((height > 0.0).any()))
    of_lobes = share[:, : kappa.shape[1]]
    return SamplingTables(
        np.stack([kappa, gamma, of_lobes * normaliser], axis=-1),
        share[:, [-1, -2]],
        _alias(powers * of_lobes[..., None], gamma, share[:, -1], share[:, -2]),
    )


def _merged(kappa: Array, gamma: Array) -> tuple[Array, Array]:
    """One lobe (theta_d, lobe) for those of all channels: mean height, and shape weighted by mass."""
    height = np.expm1(kappa)
    mass = height / (1.0 + gamma)
    merged = np.exp((mass * np.log(gamma + 0.01)).sum(1) / np.maximum(mass.sum(1), 1e-300))
    return np.maximum(np.log1p(height.mean(1)), MIN_KAPPA), merged


def _powers(kappa: Array, gamma: Array) -> tuple[Array, Array]:
    """Probability (row, lobe, n) of the powers n = 1, 2, ... of lobes times u, and their normalisers (row, lobe)."""
    n = np.arange(1.0, 2.0 ** np.ceil(np.log2(kappa.max() + 10.0 * np.sqrt(kappa.max()) + 8.0)) + 1.0)
    log_mass = n * np.log(kappa)[..., None] - gammaln(n + 1.0) - np.log(n * gamma[..., None] + 2.0)
    mass = np.exp(log_mass)
    total = mass.sum(-1)
    return mass / total[..., None], 1.0 / (2.0 * np.pi * total)


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Half vectors (theta_h, phi) for quadrature over directions at each row; arrays (row, theta_h, phi)."""

    theta_i: Array
    log_u: Array  # (theta_h,)
    sin2: Array  # (theta_h,)
    wi: Array  # (row, 1, 1, 3)
    wo: Array  # (row, theta_h, phi, 3)
    cos_o: Array
    to_pdf: Array  # density of directions for one of half vectors
    weight: Array  # solid angle of directions

    def integrand(self, value: Callable[[Array, Array], Array]) -> Array:
        """Share of all light that each node reflects, channels averaged (row, theta_h, phi)."""
        some = self.weight > 0.0
        result = np.zeros(self.weight.shape)
        wi = np.broadcast_to(self.wi, self.wo.shape)[some]
        result[some] = value(wi, self.wo[some]).mean(-1) * (self.cos_o * self.weight)[some]
        return np.asarray(result / np.maximum(result.sum((1, 2), keepdims=True), 1e-300))


@lru_cache(maxsize=1)
def _nodes() -> _Nodes:
    theta_i = np.linspace(0.0, np.pi / 2, N_ROWS)
    # Panels that shrink toward the pole meet lobes of any width
    edges = np.concatenate([[0.0], np.geomspace(2e-4, np.pi / 2, 24)])
    node, node_weight = np.polynomial.legendre.leggauss(4)
    low, width = edges[:-1, None], np.diff(edges)[:, None]
    theta = (low + 0.5 * width * (node + 1.0)).ravel()
    n_phi = 16
    phi = np.pi * (np.arange(n_phi) + 0.5) / n_phi
    solid_angle = (0.5 * width * node_weight).ravel() * np.sin(theta) * 2.0 * np.pi / n_phi
    x, y = np.sin(theta)[:, None] * np.cos(phi), np.sin(theta)[:, None] * np.sin(phi)
    half = np.stack([x, y, np.broadcast_to(np.cos(theta)[:, None], x.shape)], axis=-1)
    # At 90 degrees nothing is to be seen: look from just above
    seen = np.minimum(theta_i, np.deg2rad(89.0))
    wi = np.stack([np.sin(seen), np.zeros(N_ROWS), np.cos(seen)], axis=-1)[:, None, None]
    toward = (wi * half).sum(-1)
    image = (wi * half * [-1.0, -1.0, 1.0]).sum(-1)
    wo = 2.0 * toward[..., None] * half - wi
    visible = (toward > 0.0) & (wo[..., 2] > 0.0)
    both = np.maximum(toward, 0.0) + np.maximum(image, 0.0)
    return _Nodes(
        theta_i,
        half_diff.log_cos(theta),
        np.sin(theta) ** 2,
        wi,
        wo,
        np.where(visible, wo[..., 2], 0.0),
        0.5 / np.maximum(both, 1e-12),
        np.where(visible, 4.0 * toward, 0.0) * solid_angle[:, None],
    )


def _shares(target: Array, of_half: Array, nodes: _Nodes, *, with_spike: bool) -> Array:
    """Shares (row, component) of lobes, spike and cosine that bring the mixture near `target` (row, theta_h, phi)."""
    n = of_half.shape[1]
    share = np.full((N_ROWS, n + 1), 1.0 / (n + 1))
    share[:, n - 1] *= with_spike
    cosine = nodes.cos_o / np.pi
    for _ in range(EM_STEPS):
        mixture = np.einsum("rk,rkt->rt", share[:, :-1], of_half)[..., None] * nodes.to_pdf
        mixture += share[:, -1, None, None] * cosine
        ratio = target / np.maximum(mixture, 1e-300)
        share[:, :-1] *= np.einsum("rkt,rt->rk", of_half, (ratio * nodes.to_pdf).sum(-1))
        share[:, -1] *= (ratio * cosine).sum((1, 2))
        share /= np.maximum(share.sum(1, keepdims=True), 1e-300)
    rest = share[:, :-1].sum(1)
    cosine_share = np.where(rest > 0.0, np.maximum(1.0 - rest, MIN_COSINE_SHARE), 1.0)
    share[:, :-1] *= ((1.0 - cosine_share) / np.maximum(rest, 1e-300))[:, None]
    share[:, -1] = cosine_share
    return share


def _alias(powers: Array, gamma: Array, cosine: Array, of_spike: Array) -> Array:
    """Alias tables (row, entry, 3) of the powers (row, lobe, n), the cosine and the spike."""
    n = np.arange(1.0, powers.shape[-1] + 1.0)
    exponents = (n * gamma[..., None] + 2.0).reshape(N_ROWS, -1)
    exponents = np.column_stack([exponents, np.full(N_ROWS, COSINE), np.full(N_ROWS, SPIKE)])
    mass = np.column_stack([powers.reshape(N_ROWS, -1), cosine, of_spike])
    tables = np.empty((*mass.shape, 3))
    for table, of_row, exponent in zip(tables, mass, exponents, strict=True):
        stay, other = _alias_row(of_row)
        table[:] = np.column_stack([stay, exponent, exponent[other]])
    return tables


def _alias_row(mass: Array) -> tuple[Array, NDArray[np.int_]]:
    """Vose's method: the probability to stay with each entry, and where to go otherwise."""
    stay = mass * (len(mass) / mass.sum())
    other = np.arange(len(mass))
    small, large = (list(np.flatnonzero(which)) for which in (stay < 1.0, stay >= 1.0))
    while small and large:
        poor, rich = small.pop(), large[-1]
        other[poor] = rich
        stay[rich] -= 1.0 - stay[poor]
        if stay[rich] < 1.0:
            small.append(large.pop())
    stay[small + large] = 1.0
    return stay, other
