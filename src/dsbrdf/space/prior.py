"""Maximum a posteriori fits: a material from few or noisy samples, with a space of materials as prior (Section 6.C).

The prior of the scores is normal, with the variances of the space. The likelihood is normal in the logarithm of the
reflectance, `ln(f + e)` with e = `dsbrdf.paper.metrics.LOG_OFFSET`: reflectances span decades, and noise and what no
model describes are about proportional to them. What balances the two, the standard deviation sigma of that logarithm,
is not chosen but estimated along the way, by the evidence approximation (MacKay, "Bayesian interpolation", Neural
Computation 4(3), 1992).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.space.material_space import MaterialSpace

__all__ = ["PriorFit", "fit_scores"]

Array = NDArray[np.float64]

#: Sigma is at least this, 1 %: no instrument and no model are better, and few samples can be met by chance.
LEAST_SIGMA = 0.01
FIRST_SIGMA = 0.1
#: Starts: the mean material, and the materials of the space that are nearest to the data.
N_NEAREST = 3
MAX_STEPS = 60
#: Relative changes of the cost and of sigma that end the search.
TOLERANCE = 1e-4, 0.02


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Scores found with a prior.

    Parameters
    ----------
    scores : (component,) ndarray
        Most probable ones; `MaterialSpace.model` gives the material.
    covariance : (component, component) ndarray
        Of the scores, after the data (Laplace's approximation).
    sigma : float
        Standard deviation of `ln(f + e)` about the model: noise and what the model cannot describe.
    n_effective : float
        Scores that the data decide, between none and all; the prior decides the others.
    log_evidence : float
        Of the data, up to a constant; tells starts, or spaces, apart.
    steps : int
    """

    scores: Array
    covariance: Array
    sigma: float
    n_effective: float
    log_evidence: float
    steps: int


def fit_scores(
    space: MaterialSpace,
    theta_h: ArrayLike,
    theta_d: ArrayLike,
    phi_d: ArrayLike,
    values: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    sigma: float | None = None,
) -> PriorFit:
    """The most probable material of a space, given samples.

    Parameters
    ----------
    space : MaterialSpace
    theta_h, theta_d, phi_d : (sample,) array_like, radians
    values : (sample, channel) array_like, 1/sr
        NaN where invalid.
    weights : (sample,) array_like, optional
        In proportion to 1 / variance of the values; by default all relative errors are alike.
    sigma : float, optional
        Standard deviation of the logarithms, if it is known; estimated by default.

    Returns
    -------
    PriorFit

    Raises
    ------
    ValueError
        If shapes disagree, an angle is out of range, or nothing is valid.
    """
    data = _Data.of(space, theta_h, theta_d, phi_d, values, weights)
    if sigma is not None and not 0.0 < sigma < np.inf:
        raise ValueError(f"'sigma' must be positive, got {sigma!r}.")
    found = [_search(data, start, sigma) for start in _starts(space, data)]
    best = max(found, key=lambda end: end.log_evidence)
    deviation = np.sqrt(space.fpca.variances)
    scores = best.x * deviation
    return PriorFit(
        scores,
        np.linalg.inv(best.hessian) * np.outer(deviation, deviation),
        best.sigma,
        best.n_effective,
        best.log_evidence,
        best.steps,
    )


@dataclass(frozen=True, eq=False)
class _Data:
    """Samples, and what the space says at their directions."""

    space: MaterialSpace
    log_cos: Array
    azimuth: Array
    design: Array
    target: Array
    weight: Array
    functions: Array
    mean: Array

    @classmethod
    def of(
        cls,
        space: MaterialSpace,
        theta_h: ArrayLike,
        theta_d: ArrayLike,
        phi_d: ArrayLike,
        values: ArrayLike,
        weights: ArrayLike | None,
    ) -> _Data:
        theta_h, theta_d = _check.angle(theta_h, "theta_h"), _check.angle(theta_d, "theta_d")
        phi_d, values = _check.finite(phi_d, "phi_d"), np.asarray(values, dtype=float)
        if values.ndim != 2 or not theta_h.shape == theta_d.shape == phi_d.shape == values.shape[:1]:
            raise ValueError(
                f"'theta_h' {theta_h.shape}, 'theta_d' {theta_d.shape} and 'phi_d' {phi_d.shape} must have shape "
                f"(sample,), 'values' {values.shape} (sample, channel)."
            )
        if values.shape[1] != space.n_channels:
            raise ValueError(
                f"samples of {values.shape[1]} channels do not go with a space of {space.n_channels}. Build a space of "
                "models with the same channels."
            )
        valid = np.isfinite(values) & (values >= 0.0)
        if not valid.any():
            raise ValueError("no sample is valid: check that the measurement holds positive values.")
        target = np.log(np.where(valid, values, 0.0) + LOG_OFFSET)
        weight = valid.astype(float)
        if weights is not None:
            # What is 1 / variance of a value becomes that of its logarithm
            root = np.sqrt(_check.finite(weights, "weights", low=0.0))[:, None] * np.exp(target)
            weight *= root / np.median(root[valid])
        azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
        deviation = np.sqrt(space.fpca.variances)[:, None, None]
        shape = space.curves.shape[1:]
        return cls(
            space,
            half_diff.log_cos(theta_h)[:, None, None],
            azimuth[:, None, None],
            space.settings.basis.design(theta_d),
            target,
            weight,
            (space.fpca.functions * deviation).reshape(-1, *shape),
            space.fpca.mean.reshape(shape),
        )

    def residuals(self, x: Array) -> Array:
        """Weighted residuals (sample, channel) at standard scores `x`."""
        return self._evaluate(x)[0]

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Residuals (sample * channel,) and their derivatives (sample * channel, component)."""
        residuals, slopes = self._evaluate(x)
        jacobian = sum(
            np.einsum("ncl,nq,zclq->ncz", slope, self.design, self.functions[..., f, :], optimize=True)
            for f, slope in enumerate(slopes())
        )
        return residuals.ravel(), np.asarray(jacobian).reshape(residuals.size, -1)

    def _evaluate(self, x: Array) -> tuple[Array, Callable[[], list[Array]]]:
        variables = self.space.settings.variables
        coefficients = self.mean + np.tensordot(x, self.functions, 1)
        values = np.einsum("nq,clfq->nclf", self.design, coefficients, optimize=True)
        kappa, gamma, beta = variables.parameters(values)
        power = np.exp(gamma * self.log_cos)
        lobe = np.expm1(kappa * power)
        varied = 1.0 + beta * self.azimuth
        total = (lobe * varied).sum(-1) + LOG_OFFSET
        residuals: Array = self.weight * (np.log(total) - self.target)

        def slopes() -> list[Array]:
            outer = (self.weight / total)[..., None]
            by_kappa = outer * varied * (lobe + 1.0) * power
            of_kappa, of_gamma = variables.slopes(kappa, gamma)
            parts = [
                by_kappa * of_kappa,
                by_kappa * kappa * self.log_cos * of_gamma,
                outer * lobe * self.azimuth,
            ]
            return parts[: len(variables.names)]

        return residuals, slopes


def _starts(space: MaterialSpace, data: _Data) -> list[Array]:
    """Standard scores of the mean material, and of those nearest to the data."""
    known = space.fpca.scores / np.sqrt(space.fpca.variances)
    misfit = [(data.residuals(x) ** 2).sum() for x in known]
    return [np.zeros(known.shape[1]), *known[np.argsort(misfit)[:N_NEAREST]]]


@dataclass(frozen=True, eq=False)
class _End:
    x: Array
    hessian: Array
    sigma: float
    n_effective: float
    log_evidence: float
    steps: int


def _search(data: _Data, x: Array, known_sigma: float | None) -> _End:
    """Levenberg-Marquardt over standard scores, sigma estimated anew after each step."""
    n = int((data.weight > 0.0).sum())
    sigma = known_sigma or FIRST_SIGMA
    damping, steps = 1e-2, 0
    r, jacobian = data.linearise(x)
    while steps < MAX_STEPS:
        steps += 1
        cost = float((r @ r) / sigma**2 + x @ x)
        hessian = jacobian.T @ jacobian / sigma**2 + np.eye(x.size)
        gradient = jacobian.T @ r / sigma**2 + x
        new_cost = cost
        while damping < 1e8:
            trial = x - np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            left = data.residuals(trial)
            new_cost = float((left**2).sum() / sigma**2 + trial @ trial)
            if new_cost < cost:
                break
            damping *= 4.0
        else:
            break
        x, damping = trial, max(damping / 5.0, 1e-6)
        r, jacobian = data.linearise(x)
        old, sigma = sigma, known_sigma or _sigma(r, jacobian, sigma, n)
        if cost - new_cost < TOLERANCE[0] * max(cost, 1.0) and abs(np.log(sigma / old)) < TOLERANCE[1]:
            break
    curvature = jacobian.T @ jacobian / sigma**2
    eigenvalues = np.maximum(np.linalg.eigvalsh(curvature), 0.0)
    log_evidence = -0.5 * ((r @ r) / sigma**2 + x @ x + np.log1p(eigenvalues).sum()) - n * np.log(sigma)
    n_effective = float((eigenvalues / (1.0 + eigenvalues)).sum())
    return _End(x, curvature + np.eye(x.size), sigma, n_effective, float(log_evidence), steps)


def _sigma(r: Array, jacobian: Array, sigma: float, n: int) -> float:
    """Root of the squares that are left, each counted by the samples that no score has used up."""
    eigenvalues = np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian / sigma**2), 0.0)
    free = max(n - (eigenvalues / (1.0 + eigenvalues)).sum(), 1.0)
    return max(float(np.sqrt((r @ r) / free)), LEAST_SIGMA)
