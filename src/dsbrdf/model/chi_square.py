"""Chi-square test of samples on the hemisphere against a density, after `chi2.py` of Mitsuba 3.

Cells are equal in cos(theta) and phi, hence in solid angle. Expected counts come from Gauss-Legendre
quadrature, refined in each cell until it settles, so that lobes much narrower than a cell are met.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["cell_integrals", "counts", "direction", "p_value", "sidak"]

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

#: Cells in cos(theta) and phi.
CELLS = (20, 40)
#: Cells that expect fewer samples are pooled.
FEWEST = 10.0
#: Nodes along a side of a cell that a quadrature ends with.
MOST_NODES = 512


def cell_integrals(
    function: Function, peak: Array, tolerance: float = 1e-5, cells: tuple[int, int] = CELLS
) -> Array:
    """Integrals (cos theta, phi) over the cells of `function` of directions (..., 3), each to `tolerance`.

    Around the direction `peak` nothing is taken to have settled before many nodes have looked for it.

    Raises
    ------
    RuntimeError
        If the integral of a cell does not settle.
    """
    cell = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 2)
    around = direction(*((cell + 0.5) / cells * [1.0, 2.0 * np.pi]).T) @ peak > np.cos(0.3)
    open_cells, result, order = np.arange(len(cell)), np.zeros(len(cell)), 4
    last = _quadrature(function, cell, cells, order)
    while len(open_cells):
        order *= 2
        if order > MOST_NODES:
            raise RuntimeError(
                f"{len(open_cells)} of {len(cell)} cells do not settle to {tolerance:g} with {MOST_NODES} nodes "
                "a side. Is the function finite and smooth? Use more cells, or a larger tolerance."
            )
        now = _quadrature(function, cell[open_cells], cells, order)
        result[open_cells] = now
        rough = (np.abs(now - last) > tolerance) | (around[open_cells] & (order < 64))
        open_cells, last = open_cells[rough], now[rough]
    return result.reshape(cells)


def _quadrature(function: Function, cell: NDArray[np.int_], cells: tuple[int, int], order: int) -> Array:
    node, weight = np.polynomial.legendre.leggauss(order)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    result = np.empty(len(cell))
    # A few cells at a time: small temporaries
    step = max(1, 200_000 // order**2)
    for start in range(0, len(cell), step):
        part = cell[start : start + step]
        cos_theta = (part[:, 0, None, None] + node[:, None]) / cells[0]
        phi = 2.0 * np.pi * (part[:, 1, None, None] + node) / cells[1]
        values = function(direction(cos_theta, phi))
        result[start : start + step] = np.einsum("...ij,i,j", values, weight, weight)
    return result * 2.0 * np.pi / (cells[0] * cells[1])


def direction(cos_theta: ArrayLike, phi: ArrayLike) -> Array:
    """Unit vectors (..., 3)."""
    cos_theta, phi = np.asarray(cos_theta), np.asarray(phi)
    sin_theta = np.sqrt(1.0 - cos_theta**2)
    x, y, z = np.broadcast_arrays(sin_theta * np.cos(phi), sin_theta * np.sin(phi), cos_theta)
    return np.stack([x, y, z], axis=-1)


def counts(samples: Array, cells: tuple[int, int] = CELLS) -> NDArray[np.int_]:
    """Number of samples (n, 3) in each cell; those below the horizon are in none."""
    above = samples[samples[:, 2] > 0.0]
    row = np.minimum((above[:, 2] * cells[0]).astype(int), cells[0] - 1)
    column = ((np.arctan2(above[:, 1], above[:, 0]) / (2.0 * np.pi)) % 1.0 * cells[1]).astype(int) % cells[1]
    return np.bincount(row * cells[1] + column, minlength=cells[0] * cells[1]).reshape(cells)


def p_value(samples: Array, mass: Array) -> float:
    """Chance of samples as far from `mass` (cells); one more cell holds what is below the horizon."""
    from scipy import stats

    n = len(samples)
    observed, expected = counts(samples, mass.shape).ravel(), n * mass.ravel()
    observed = np.append(observed, n - observed.sum())
    expected = np.append(expected, n - expected.sum())
    if expected[-1] < -FEWEST:
        return 0.0
    order = np.argsort(expected)
    few = np.cumsum(expected[order]) < FEWEST
    few |= expected[order] < FEWEST
    pooled = [observed[order][few].sum(), *observed[order][~few]]
    wanted = [expected[order][few].sum(), *expected[order][~few]]
    # What is pooled may itself be too little to count: then it joins the next cell
    if wanted[0] < FEWEST:
        pooled, wanted = [pooled[0] + pooled[1], *pooled[2:]], [wanted[0] + wanted[1], *wanted[2:]]
    statistic = ((np.array(pooled) - wanted) ** 2 / wanted).sum()
    return float(stats.chi2.sf(statistic, len(wanted) - 1))


def sidak(significance: float, n_tests: int) -> float:
    """Least p-value of a single test, so that all of them fail by chance with probability `significance`."""
    return float(1.0 - (1.0 - significance) ** (1.0 / n_tests))
