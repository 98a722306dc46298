"""The sampler of a model: directions from powers of the half vector's cosine, and the density they have.

All renderers use its tables. A renderer knows one direction only: for a row of angles of that direction, half vectors
are drawn from a mixture of fixed powers of u = cos(theta_h), each half as wide as the one before it, and directions are
drawn from the cosine.

- A draw from a power is `u = xi^(1 / exponent)`, with an exponent taken from an alias table (Walker 1977; Vose 1991):
  one look-up. A cosine-weighted direction is one more power.
- A half vector h and its image at the other azimuth are exchanged so that the one turned toward the direction is met
  in proportion to its projected area (Heitz and d'Eon 2014): few samples fall below the horizon.
- The shares of the mixture are those of least Kullback-Leibler divergence from what is to be sampled, the value times
  the cosine; some steps of EM on quadrature nodes find them.

A lobe is itself a mixture of powers of the cosine, but the fixed ones sample as well as the lobes' own, cost one
exponential for all of them, and suit any reflectance. The azimuthal factor is left to the weight. The density of all
this has a closed form, so a weight `value cos / pdf` is exact whatever the shares are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.directions import polar
from dsbrdf.model import evaluation
from dsbrdf.model.lobes import Lobes

__all__ = ["COSINE", "N_ROWS", "POWERS", "SamplingTables", "pdf", "sample", "tables", "tables_for"]

Array = NDArray[np.float64]
Value = Callable[[Array, Array], Array]

#: Half vectors have densities `(power + 2) / (2 pi) u^(power + 1)` over solid angle.
POWERS = 4.0 ** np.arange(11)
#: Rows in the angle of the known direction: every three degrees.
N_ROWS = 31
#: Least share of cosine-weighted directions; covers what lobes leave out.
MIN_COSINE_SHARE = 0.05
#: Exponent that stands for a cosine-weighted direction.
COSINE = -2.0
#: Steps of EM, all but the first three lengthened by this power: it halves the steps that are needed.
EM_STEPS, EM_POWER = 30, 1.9


@dataclass(frozen=True, eq=False)
class SamplingTables:
    """What a sampler looks up by the row of the known direction's angle.

    Parameters
    ----------
    shares : (row, power) ndarray
        Of half vectors from `POWERS`; the rest is the share of cosine-weighted directions.
    alias : (row, entry, 3) ndarray
        Probability to stay with an entry, its exponent, and the exponent to take otherwise.
    """

    shares: Array
    alias: Array

    @property
    def cosine(self) -> Array:
        """Share (row,) of cosine-weighted directions."""
        return np.asarray(1.0 - self.shares.sum(1))


_made: WeakKeyDictionary[Lobes, SamplingTables] = WeakKeyDictionary()


def tables(lobes: Lobes) -> SamplingTables:
    """Tables of a model's lobes; kept as long as the lobes are, if these are NumPy's.

    Raises
    ------
    TypeError
        If the parameters carry gradients and have no values here.
    """
    made = _made.get(lobes)
    if made is None:
        plain = lobes.numpy
        made = tables_for(lambda wi, wo: evaluation.evaluate_numpy(plain, wi, wo))
        # Arrays of other libraries may be changed in place, as optimisers do
        if all(isinstance(part, np.ndarray) for part in lobes.parts):
            _made[lobes] = made
    return made


def tables_for(value: Value) -> SamplingTables:
    """Tables for any reflectance.

    Parameters
    ----------
    value : callable
        `value(wi, wo)` is (n, channel) in 1/sr for unit vectors (n, 3).
    """
    nodes = _nodes()
    share = _shares(nodes.integrand(value), _densities(nodes.log_u), nodes)
    return SamplingTables(share[:, :-1], _alias(share))


def _densities(log_u: Array) -> Array:
    """Density (power, ...) of half vectors over solid angle, of each power at ln u (...)."""
    column = POWERS.reshape(-1, *(1,) * np.ndim(log_u))
    return np.asarray((column + 2.0) / (2.0 * np.pi) * np.exp((column + 1.0) * log_u))


def _row(cos_theta: Array) -> NDArray[np.int_]:
    """Row of the angle of a direction with this cosine."""
    place = np.arccos(np.clip(cos_theta, 0.0, 1.0)) * ((N_ROWS - 1) / (0.5 * np.pi))
    return np.asarray(np.minimum(place + 0.5, N_ROWS - 1), dtype=np.int_)


def sample(lobes: Lobes, wo: ArrayLike, rng: np.random.Generator) -> Array:
    """Draw directions toward the light; see `DSBRDF.sample`."""
    _check.generator(rng)
    made = tables(lobes)
    wo = _check.unit_vectors(wo, "wo")
    flat = wo.reshape(-1, 3)
    n_entries = made.alias.shape[1]
    place = rng.random(len(flat)) * n_entries
    entry = np.minimum(place.astype(int), n_entries - 1)
    stay, here, there = made.alias[_row(flat[:, 2]), entry].T
    stays = place - entry < stay
    exponent = np.where(stays, here, there)

    log_u2 = 2.0 * np.log1p(-rng.random(len(flat))) / np.abs(exponent)
    sin_theta = np.sqrt(-np.expm1(log_u2))
    drawn = polar(sin_theta, np.exp(0.5 * log_u2), 2.0 * np.pi * rng.random(len(flat)))
    toward = (flat * drawn).sum(1)
    image = 2.0 * drawn[:, 2] * flat[:, 2] - toward
    both = np.maximum(toward, 0.0) + np.maximum(image, 0.0)
    keep = (rng.random(len(flat)) * both < toward)[:, None]
    half = np.where(keep, drawn, drawn * [-1.0, -1.0, 1.0])
    mirrored = 2.0 * np.where(keep, toward[:, None], image[:, None]) * half - flat
    return np.where((exponent == COSINE)[:, None], drawn, mirrored).reshape(wo.shape)


def pdf(lobes: Lobes, wi: ArrayLike, wo: ArrayLike) -> Array:
    """Density of `sample`; see `DSBRDF.pdf`."""
    made = tables(lobes)
    wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
    above = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
    density = np.zeros(above.shape)
    wi, wo = wi[above], wo[above]
    s = wi + wo
    length2 = (s * s).sum(1)
    log_u = 0.5 * np.log1p(-np.minimum((s[:, 0] ** 2 + s[:, 1] ** 2) / length2, 1.0 - 2.0**-53))
    row = _row(wo[:, 2])
    half = np.einsum("nk,kn->n", made.shares[row], _densities(log_u))
    length = np.sqrt(length2)
    cos_d = 0.5 * length
    image = np.maximum(2.0 * s[:, 2] / length * wo[:, 2] - cos_d, 0.0)
    density[above] = made.cosine[row] * wi[:, 2] / np.pi + 0.5 * half / (cos_d + image)
    return density


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Half vectors (theta_h, phi) for quadrature over directions at each row; arrays (row, theta_h, phi)."""

    theta_i: Array
    log_u: Array  # (theta_h,)
    wi: Array  # (row, 1, 1, 3)
    wo: Array  # (row, theta_h, phi, 3)
    cos_o: Array
    to_pdf: Array  # density of directions for one of half vectors
    weight: Array  # solid angle of directions

    def integrand(self, value: Value) -> Array:
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
    half = polar(np.sin(theta)[:, None], np.cos(theta)[:, None], phi)
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
        wi,
        wo,
        np.where(visible, wo[..., 2], 0.0),
        0.5 / np.maximum(both, 1e-12),
        np.where(visible, 4.0 * toward, 0.0) * solid_angle[:, None],
    )


def _shares(target: Array, of_half: Array, nodes: _Nodes) -> Array:
    """Shares (row, component) of powers and cosine that bring the mixture near `target` (row, theta_h, phi)."""
    share = np.full((N_ROWS, len(of_half) + 1), 0.5 / len(of_half))
    share[:, -1] = 0.5
    cosine = nodes.cos_o / np.pi
    for step in range(EM_STEPS):
        mixture = (share[:, :-1] @ of_half)[..., None] * nodes.to_pdf
        mixture += share[:, -1, None, None] * cosine
        ratio = target / np.maximum(mixture, 1e-300)
        factor = np.empty(share.shape)
        factor[:, :-1] = (ratio * nodes.to_pdf).sum(-1) @ of_half.T
        factor[:, -1] = (ratio * cosine).sum((1, 2))
        share *= factor if step < 3 else factor**EM_POWER
        share /= np.maximum(share.sum(1, keepdims=True), 1e-300)
    rest = share[:, :-1].sum(1)
    cosine_share = np.where(rest > 0.0, np.maximum(1.0 - rest, MIN_COSINE_SHARE), 1.0)
    share[:, :-1] *= ((1.0 - cosine_share) / np.maximum(rest, 1e-300))[:, None]
    share[:, -1] = cosine_share
    return share


def _alias(share: Array) -> Array:
    """Alias tables (row, entry, 3) of the shares (row, component) of powers and cosine."""
    exponent = np.append(POWERS + 2.0, COSINE)
    made = np.empty((*share.shape, 3))
    for table, of_row in zip(made, share, strict=True):
        stay, other = _alias_row(of_row)
        table[:] = np.column_stack([stay, exponent, exponent[other]])
    return made


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
