"""Levenberg-Marquardt with Nielsen's damping within bounds, on normal equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["LeastSquares", "Minimum", "minimise"]

#: Unknowns are of order one: what asks for a longer step has next to no effect, and must not hold up the others.
MAX_STEP = 8.0
#: The descent has ended if this share of the squares goes in `WINDOW` steps, or a thousandth of it in one.
TOLERANCE = 3e-4
WINDOW = 8
#: Damping below which equations may be singular, and beyond which no descent is left.
MIN_DAMPING, MAX_DAMPING = 1e-12, 1e30
#: An unknown without effect keeps a little damping.
LEAST_SCALE = 1e-30
MAX_ITERATIONS = 300


class LeastSquares(Protocol):
    """A sum of squares."""

    #: What is left at best, and not part of the cost.
    floor: float

    def cost(self, x: NDArray[np.float64]) -> float:
        """Half the sum of squares at `x`."""

    def linearise(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Gauss-Newton Hessian and gradient at the last `x` that `cost` was asked for."""

    def limits(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest unknowns."""


@dataclass(frozen=True)
class Minimum:
    """How a search ended.

    Parameters
    ----------
    cost : float
        Half the sum of squares.
    iterations : int
    converged : bool
    """

    cost: float
    iterations: int
    converged: bool


def minimise(
    problem: LeastSquares, x: NDArray[np.float64], max_iterations: int = MAX_ITERATIONS
) -> tuple[NDArray[np.float64], Minimum]:
    """Minimum of `problem` from `x`, of any shape; the cost never rises."""
    low, high = problem.limits(x.shape)
    x = np.clip(x, low, high)
    cost = milestone = problem.cost(x)
    hessian, gradient = problem.linearise()
    damping, growth = 1e-3, 2.0
    for iteration in range(1, max_iterations + 1):
        # Unknowns that would leave the allowed range stay where they are, so that the others move freely
        free = ~(((x <= low).ravel() & (gradient > 0.0)) | ((x >= high).ravel() & (gradient < 0.0)))
        step, predicted = _damped_step(hessian, gradient * free, damping, free)
        trial = np.clip(x - step.reshape(x.shape), low, high)
        new_cost = problem.cost(trial)
        least = TOLERANCE * (cost + problem.floor)
        better = new_cost < cost
        # A step that is small because it was damped says nothing
        if damping < 1.0 and max(predicted, cost - new_cost if better else 0.0) <= 1e-3 * least:
            return (
                (trial, Minimum(new_cost, iteration, True)) if better else (x, Minimum(cost, iteration, True))
            )
        if better:
            ratio = (cost - new_cost) / predicted
            x, cost = trial, new_cost
            if iteration % WINDOW == 0:
                if milestone - cost <= least:
                    return x, Minimum(cost, iteration, True)
                milestone = cost
            hessian, gradient = problem.linearise()
            damping = max(damping * min(max(1.0 - (2.0 * ratio - 1.0) ** 3, 0.1), 2.0), MIN_DAMPING)
            growth = 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
            if damping > MAX_DAMPING:
                return x, Minimum(cost, iteration, True)
    return x, Minimum(cost, max_iterations, False)


def _damped_step(
    hessian: NDArray[np.float64], gradient: NDArray[np.float64], damping: float, free: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], float]:
    """Solution of `(H + damping D) step = gradient`, D the diagonal of H, and the decrease it promises."""
    root = np.sqrt(np.maximum(hessian.diagonal(), LEAST_SCALE))
    scaled = np.where(free[:, None] & free, hessian, 0.0) / (root[:, None] * root)
    np.fill_diagonal(scaled, 1.0 + damping)
    step = np.clip(np.linalg.solve(scaled, gradient / root) / root, -MAX_STEP, MAX_STEP)
    return step, 0.5 * float(step @ (gradient + damping * root**2 * step))
