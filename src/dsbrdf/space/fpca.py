"""Functional principal component analysis of several curves at once (Ramsay and Silverman 2005; Section 6.C).

An observation is the coefficients of all its curves in one row. The inner product of functions becomes a matrix:
Eq. (7) for the curves of lobes. In coordinates in which that is the plain product of vectors, the analysis is a
singular value decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief

__all__ = ["Fpca", "fit_fpca"]

Array = NDArray[np.float64]

#: Components of less than this share of the greatest variance are rounding errors.
LEAST_VARIANCE = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Fpca(Brief):
    """Mean and principal functions of rows of coefficients.

    Parameters
    ----------
    metric : (number, number) ndarray
        Of the inner product.
    mean : (number,) ndarray
    functions : (component, number) ndarray
        Principal functions, orthonormal under the inner product, by falling variance. Their sign is such that the
        inner product with the reference of `fit_fpca` is not negative.
    variances : (component,) ndarray
        Of the scores, with n - 1 in the denominator.
    scores : (observation, component) ndarray
        Of what the analysis was made from.

    Examples
    --------
    >>> import dsbrdf
    >>> fpca = dsbrdf.space.builtin().fpca
    >>> fpca.n_components(0.9) < fpca.n_components(0.99)
    True
    """

    metric: Array
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

    def transform(self, rows: ArrayLike) -> Array:
        """Scores (..., component) of rows (..., number)."""
        scores: Array = (np.asarray(rows, dtype=float) - self.mean) @ self.metric @ self.functions.T
        return scores

    def inverse_transform(self, scores: ArrayLike) -> Array:
        """Rows (..., number) of scores (..., component); of the first ones, if fewer are given.

        Raises
        ------
        ValueError
            If there are more scores than components.
        """
        scores = np.asarray(scores, dtype=float)
        n = scores.shape[-1]
        if n > len(self.variances):
            raise ValueError(f"'scores' has {n} components, the analysis has {len(self.variances)}.")
        rows: Array = self.mean + scores @ self.functions[:n]
        return rows

    def inner(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Inner product (...) of rows (..., number), which broadcast."""
        product: Array = ((np.asarray(x) @ self.metric) * np.asarray(y)).sum(-1)
        return product


def fit_fpca(rows: ArrayLike, metric: ArrayLike, reference: ArrayLike | None = None) -> Fpca:
    """Analyse rows of coefficients.

    Parameters
    ----------
    rows : (observation, number) array_like
    metric : (number, number) array_like
        Symmetric, positive definite.
    reference : (number,) array_like, optional
        Decides signs, see `Fpca`; ones by default.

    Returns
    -------
    Fpca

    Raises
    ------
    ValueError
        If shapes disagree, the metric is none, there are fewer than two observations, or they are all alike.

    Examples
    --------
    >>> import numpy as np
    >>> from dsbrdf.space import fit_fpca
    >>> found = fit_fpca([[0.0, 1.0], [2.0, 1.0], [4.0, 1.0]], np.eye(2))
    >>> found.mean, found.explained.round(3)
    (array([2., 1.]), array([1.]))
    """
    rows, metric = _check.finite(rows, "rows"), _check.finite(metric, "metric")
    if metric.ndim != 2 or rows.ndim != 2 or metric.shape != (rows.shape[1],) * 2:
        raise ValueError(
            f"'rows' must have shape (observation, number) and 'metric' (number, number), got {rows.shape} and "
            f"{metric.shape}."
        )
    if len(rows) < 2:
        raise ValueError(f"an analysis needs two observations at least, got {len(rows)}.")
    try:
        # The factor's transpose takes coefficients to coordinates with the plain product
        factor = np.linalg.cholesky(metric)
    except np.linalg.LinAlgError:
        raise ValueError("'metric' must be symmetric and positive definite.") from None
    mean = rows.mean(0)
    left, singular, right = np.linalg.svd((rows - mean) @ factor, full_matrices=False)
    variances = singular**2 / (len(rows) - 1)
    # Rounding of the mean leaves something even where all are alike
    rounding = (1e-14 * np.abs(rows @ factor).max()) ** 2
    kept = variances > max(LEAST_VARIANCE * variances[0], rounding)
    if not kept.any():
        raise ValueError("all observations are alike: there is nothing to analyse.")
    functions = np.linalg.solve(factor.T, right[kept].T).T
    along = functions @ metric @ (np.ones_like(mean) if reference is None else np.asarray(reference, float))
    sign = np.where(along < 0.0, -1.0, 1.0)
    return Fpca(metric, mean, functions * sign[:, None], variances[kept], (left * singular)[:, kept] * sign)
