"""Samples of the slices for models that vary with phi_d, and least squares that separate."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.baselines._base import Array, SliceOptions, slice_table
from dsbrdf.paper.collapse import slice_rows

__all__ = ["Samples", "gather_samples", "refine"]


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the slices, those with the same `cos(phi_d)^2` put together.

    An isotropic, mirror-symmetric and reciprocal reflectance has one value there, so its least squares lose
    nothing.

    Parameters
    ----------
    theta_h, theta_d : (cell,) ndarray, radians
        Of the pairs that are fitted.
    wi, wo : (cell, phi_d, 3) ndarray
    count, total : (cell, phi_d, channel) ndarray
        Number and sum, in 1/sr, of the valid samples.
    """

    theta_h: Array
    theta_d: Array
    wi: Array
    wo: Array
    count: Array
    total: Array


def gather_samples(measured: MeasuredBRDF, **options: Unpack[SliceOptions]) -> Samples:
    """Samples that `dsbrdf.paper.fit_slices` takes with the same options.

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.
    """
    theta_d, _, count = slice_table(measured, **options)
    slices, theta_h = np.nonzero(count.any(1))
    rows = slice_rows(len(measured.theta_d), len(theta_d))
    values = np.moveaxis(measured.rows(rows)[:, theta_h, slices], 0, -1)  # (cell, phi_d, channel)
    valid = np.isfinite(values)

    # Sums over samples of the same azimuth but for symmetry, as products with a matrix of ones
    _, first, group = np.unique(
        np.round(np.abs(np.cos(measured.phi_d)), 12), return_index=True, return_inverse=True
    )
    same = (group == np.arange(len(first))[:, None]).astype(np.float64)
    at_h, at_d = measured.theta_h[theta_h], theta_d[slices]
    wi, wo = half_diff.to_directions(at_h[:, None], at_d[:, None], measured.phi_d[first])
    return Samples(at_h, at_d, wi, wo, same @ valid, same @ np.where(valid, values, 0.0))


def refine(
    basis: Callable[[Array], Array], target: Array, starts: Iterable[Array], low: float, high: float
) -> tuple[Array, Array, float]:
    """Least squares `|basis(x) c - target|` over x in [low, high] and c >= 0, the best of several starts.

    Variable projection (Golub and Pereyra, "The differentiation of pseudo-inverses and nonlinear least
    squares problems whose variables separate", SIAM J. Numer. Anal. 10, 1973): only x is searched, c is
    solved for.

    Parameters
    ----------
    basis : callable
        Matrix (row, coefficient) for x.
    target : (row,) ndarray
    starts : iterable of ndarray
    low, high : float

    Returns
    -------
    x, c : ndarray
    cost : float
        Sum of squares.
    """
    from scipy import optimize

    def residual(x: Array) -> Array:
        matrix = basis(x)
        left: Array = matrix @ optimize.nnls(matrix, target)[0] - target
        return left

    solutions = [
        optimize.least_squares(residual, start, bounds=(low, high), xtol=1e-10, ftol=1e-13, gtol=1e-13)
        for start in starts
    ]
    best = min(solutions, key=lambda solution: float(solution.cost))
    x = np.asarray(best.x, dtype=np.float64)
    return x, np.asarray(optimize.nnls(basis(x), target)[0]), 2.0 * float(best.cost)
