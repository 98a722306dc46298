"""Functional principal component analysis of several curves at once (Ramsay and Silverman 2005; Section 6.C).

An observation is a set of functions over theta_d, each a spline. Their inner product is the sum over functions of
`weight * integral x(t) y(t) dt`: Eq. (7) for the two curves of a lobe. In coordinates in which that is the plain
product of vectors, the analysis is a singular value decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.paper.curves import CurveBasis

__all__ = ["Fpca", "fit_fpca", "squared_norm"]

Array = NDArray[np.float64]

#: Components of less than this share of the greatest variance are rounding errors.
LEAST_VARIANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Fpca:
    """Mean and principal functions of sets of curves.

    Parameters
    ----------
    basis : CurveBasis
        Of all functions.
    weights : (function,) ndarray
        Of the functions in the inner product.
    mean : (function, coefficient) ndarray
    functions : (component, function, coefficient) ndarray
        Principal functions, orthonormal under the inner product, by falling variance. Their sign is such that the
        inner product with the reference of `fit_fpca` is not negative.
    variances : (component,) ndarray
        Of the scores, with n - 1 in the denominator.
    scores : (observation, component) ndarray
        Of what the analysis was made from.
    """

    basis: CurveBasis
    weights: Array
    mean: Array
    functions: Array
    variances: Array
    scores: Array

    @property
    def explained(self) -> Array:
        """Share (component,) of the variance; adds up to one."""
        share: Array = self.variances / self.variances.sum()
        return share

    def n_components(self, share: float) -> int:
        """Least number of components with at least `share` of the variance.

        Raises
        ------
        ValueError
            If `share` is not in (0, 1].
        """
        if not 0.0 < share <= 1.0:
            raise ValueError(f"'share' must be above 0 and at most 1, got {share!r}.")
        reached = np.cumsum(self.explained) >= share * (1.0 - 1e-12)
        return int(reached.argmax()) + 1

    def transform(self, curves: ArrayLike) -> Array:
        """Scores (..., component) of curves (..., function, coefficient)."""
        return self.inner(np.asarray(curves, dtype=float)[..., None, :, :] - self.mean, self.functions)

    def inverse_transform(self, scores: ArrayLike) -> Array:
        """Curves (..., function, coefficient) of scores (..., component); of the first ones, if fewer are given.

        Raises
        ------
        ValueError
            If there are more scores than components.
        """
        scores = np.asarray(scores, dtype=float)
        n = scores.shape[-1]
        if n > len(self.variances):
            raise ValueError(f"'scores' has {n} components, the analysis has {len(self.variances)}.")
        curves: Array = self.mean + np.tensordot(scores, self.functions[:n], 1)
        return curves

    def inner(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Inner product (...) of curves (..., function, coefficient), which broadcast."""
        weighted = np.asarray(x) * self.weights[:, None]
        product: Array = np.einsum("...fc,cd,...fd->...", weighted, self.basis.gram, np.asarray(y))
        return product


def squared_norm(curves: ArrayLike, basis: CurveBasis) -> Array:
    """Integrals (...) of the squares of curves (..., coefficient)."""
    curves = np.asarray(curves)
    norm: Array = np.einsum("...c,cd,...d->...", curves, basis.gram, curves)
    return norm


def fit_fpca(
    curves: ArrayLike,
    basis: CurveBasis,
    weights: ArrayLike | None = None,
    reference: ArrayLike | None = None,
) -> Fpca:
    """Analyse sets of curves.

    Parameters
    ----------
    curves : (observation, function, coefficient) array_like
    basis : CurveBasis
    weights : (function,) array_like, optional
        By default those of Eq. (7): the reciprocal of the squared norm of each mean curve.
    reference : (function, coefficient) array_like, optional
        Decides signs, see `Fpca`; constant functions by default.

    Returns
    -------
    Fpca

    Raises
    ------
    ValueError
        If shapes disagree, there are fewer than two observations, they are all alike, or a mean curve that is to give a
        weight is zero.
    """
    curves = _check.finite(curves, "curves")
    if curves.ndim != 3 or curves.shape[2] != basis.size:
        raise ValueError(
            f"'curves' must have shape (observation, function, {basis.size} coefficients), got {curves.shape}."
        )
    if len(curves) < 2:
        raise ValueError(f"an analysis needs two observations at least, got {len(curves)}.")
    mean = curves.mean(0)
    weights = _mean_curve_weights(mean, basis) if weights is None else np.asarray(weights, dtype=float)
    if weights.shape != mean.shape[:1] or not (weights > 0.0).all():
        raise ValueError(f"'weights' must be {len(mean)} positive numbers, got {weights}.")

    # The factor's transpose takes coefficients to coordinates with the plain product
    factor = np.linalg.cholesky(basis.gram)
    scale = np.sqrt(weights)[:, None]
    coordinates = ((curves - mean) @ factor * scale).reshape(len(curves), -1)
    left, singular, right = np.linalg.svd(coordinates, full_matrices=False)
    variances = singular**2 / (len(curves) - 1)
    # Rounding of the mean leaves something even where all are alike
    rounding = (1e-14 * np.abs(curves @ factor * scale).max()) ** 2
    kept = variances > max(LEAST_VARIANCE * variances[0], rounding)
    if not kept.any():
        raise ValueError("all observations are alike: there is nothing to analyse.")
    functions = np.linalg.solve(factor.T, (right[kept].reshape(-1, *mean.shape) / scale)[..., None])[..., 0]
    fpca = Fpca(basis, weights, mean, functions, variances[kept], (left * singular)[:, kept])
    sign = _signs(fpca, np.ones_like(mean) if reference is None else np.asarray(reference, dtype=float))
    return Fpca(basis, weights, mean, functions * sign[:, None, None], fpca.variances, fpca.scores * sign)


def _mean_curve_weights(mean: Array, basis: CurveBasis) -> Array:
    norm = squared_norm(mean, basis)
    if not (norm > 0.0).all():
        raise ValueError(
            f"the mean of function {int(np.argmin(norm))} is zero, so that Eq. (7) gives it no weight. Pass 'weights'."
        )
    weights: Array = 1.0 / norm
    return weights


def _signs(fpca: Fpca, reference: Array) -> Array:
    return np.where(fpca.inner(fpca.functions, reference) < 0.0, -1.0, 1.0)
