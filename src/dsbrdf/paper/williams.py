"""Williams' test: from which dose level on does the response differ from a zero-dose control.

Williams, Biometrics 27, 103 (1971) and 28, 519 (1972); the test of Section 5. Dose levels 1..k are ordered,
their means assumed not to decrease. The entry points are `from_groups`, `from_blocks` and `williams_test`.
Critical values are computed, for any number of doses, degrees of freedom and replicates.

Notes
-----
M_k, the isotonic mean of the top dose, is the largest mean over doses u..k. So M_k <= x if the walk with
steps r_j (x - X_j), from the top dose down, never falls below 0. Its steps have drift r_j x and variance r_j.
As the drift is proportional to the variance, the densities of walks of different x differ by a factor of the
end point alone (Cameron-Martin), and one recursion serves all x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check, _core

__all__ = [
    "WilliamsResult",
    "critical_value",
    "from_blocks",
    "from_groups",
    "isotonic_means",
    "williams_test",
]

Array = NDArray[np.float64]
Alternative = Literal["greater", "less"]

_REACH = 8.0  # standard deviations beyond which a normal tail is left out: 6e-16
_RATIO = 1000.0  # largest ratio of replicates, which sets the number of nodes
_TILT = 300.0  # largest exponent of the factor between walks of one recursion
_GAUSS, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class WilliamsResult:
    """Outcome of Williams' test; entry i of the arrays belongs to dose i, the lowest first.

    `statistic` is the isotonic mean less the control mean in standard errors, positive in the direction of
    `alternative`; `critical_value` its upper `alpha` point if that dose and all below equal the control. A
    dose is `significant` if it and all higher doses pass; `minimum_effective_dose` is the index, from 0, of
    the lowest such dose, or None.
    """

    statistic: Array
    critical_value: Array
    significant: NDArray[np.bool_]
    isotonic_mean: Array
    minimum_effective_dose: int | None
    variance: float
    df: float
    alpha: float
    alternative: Alternative


def isotonic_means(means: ArrayLike, replicates: ArrayLike) -> Array:
    """Amalgamated means: the non-decreasing sequence nearest to `means` in weighted least squares.

    Parameters
    ----------
    means : (dose,) array_like
    replicates : (dose,) or scalar array_like, > 0

    Examples
    --------
    >>> isotonic_means([9.9, 10.0, 10.6, 11.4, 11.9, 11.7], 8).tolist()  # Williams (1971), Section 2
    [9.9, 10.0, 10.6, 11.4, 11.8, 11.8]
    """
    row = _row(means, "means")
    return -_core.decreasing(-row, _replicates(replicates, row.size))


def critical_value(
    k: int, df: float, alpha: float, *, replicates: ArrayLike | None = None, control: float | None = None
) -> float:
    """Upper `alpha` point of Williams' statistic of dose `k`, where doses 1 to `k` equal the control.

    Parameters
    ----------
    k : int >= 1
        Number of dose levels; with one, the point is that of Student's t.
    df : float > 0
        Degrees of freedom of the variance estimate; infinite for a known variance.
    alpha : float in (0, 0.5)
    replicates : (k,) or scalar array_like > 0, optional
        Replicates of the doses, the lowest first; only ratios matter, up to 1000. Equal by default.
    control : float > 0, optional
        Replicates of the control; by default those of dose `k`.

    Examples
    --------
    >>> round(critical_value(6, 40, 0.01), 2)
    2.5
    """
    if k != int(k) or k < 1:
        raise ValueError(f"'k' must be an integer >= 1, got {k:g}.")
    if not df > 0.0:
        raise ValueError(f"'df' must be > 0, got {df:g}. Use math.inf for a known variance.")
    if not 0.0 < alpha < 0.5:
        raise ValueError(f"'alpha' must lie in (0, 0.5), got {alpha:g}.")
    rows = _replicates(1.0 if replicates is None else replicates, int(k))
    base = float(rows[-1] if control is None else _check.finite(control, "control", low=0.0, open_low=True))
    least, most = min(base, *rows), max(base, *rows)
    if most > _RATIO * least:
        raise ValueError(
            f"'replicates' and 'control' must lie within a factor of {_RATIO:g}, got {least:g} to {most:g}."
        )
    return _critical_value(tuple((rows / rows[-1]).tolist()), base / float(rows[-1]), float(df), float(alpha))


def williams_test(
    control_mean: float,
    dose_means: ArrayLike,
    *,
    variance: float,
    df: float,
    replicates: ArrayLike,
    control_replicates: float | None = None,
    alpha: float = 0.05,
    alternative: Alternative = "greater",
) -> WilliamsResult:
    """Test dose means against a control, from the highest dose down to the first that is not significant.

    Parameters
    ----------
    control_mean : float
    dose_means : (dose,) array_like, the lowest dose first
    variance, df : float > 0
        Pooled variance of one replicate and its degrees of freedom.
    replicates, control_replicates : (dose,) or scalar array_like > 0, float > 0
        Replicates behind the means; by default the control has those of the highest dose.
    alpha : float in (0, 0.5)
        One-sided level; bounds the probability that any ineffective dose is called effective.
    alternative : {"greater", "less"}
        Whether means increase or decrease with dose.

    Notes
    -----
    The statistic of dose i is (M_i - X_0) / sqrt(s^2 / r_i + s^2 / c), with M_i amalgamated over all doses
    and the control mean X_0 as it is; its critical value is that of i dose levels.
    """
    if alternative not in ("greater", "less"):
        raise ValueError(f"'alternative' must be 'greater' or 'less', got {alternative!r}.")
    sign = 1.0 if alternative == "greater" else -1.0
    means = _row(dose_means, "dose_means")
    rows = _replicates(replicates, means.size)
    given = rows[-1] if control_replicates is None else control_replicates
    base = float(_check.finite(given, "control_replicates", low=0.0, open_low=True))
    zero = float(_check.finite(control_mean, "control_mean"))
    variance = float(_check.finite(variance, "variance", low=0.0, open_low=True))
    points = [
        critical_value(i, df, alpha, replicates=rows[:i], control=base) for i in range(1, means.size + 1)
    ]

    critical = np.array(points)
    amalgamated = sign * isotonic_means(sign * means, rows)
    statistic = sign * (amalgamated - zero) / np.sqrt(variance * (1.0 / rows + 1.0 / base))
    significant = np.logical_and.accumulate((statistic > critical)[::-1])[::-1]
    lowest = int(np.argmax(significant)) if significant.any() else None
    return WilliamsResult(
        statistic, critical, significant, amalgamated, lowest, variance, df, alpha, alternative
    )


def from_groups(
    control: ArrayLike,
    doses: Sequence[ArrayLike],
    *,
    alpha: float = 0.05,
    alternative: Alternative = "greater",
) -> WilliamsResult:
    """Williams' test of raw groups, (replicate,) each, with the variance pooled within groups.

    `doses` holds one group a dose, the lowest first; sizes may differ. See `williams_test`.
    """
    groups = [_row(control, "control"), *(_row(group, f"doses[{i}]") for i, group in enumerate(doses))]
    sizes = np.array([group.size for group in groups])
    df = int(sizes.sum()) - len(groups)
    if len(groups) == 1 or df < 1:
        raise ValueError(
            f"'doses' must hold at least 1 dose and leave df >= 1, got groups of {sizes.tolist()}."
        )
    means = np.array([group.mean() for group in groups])
    variance = sum(float(((group - group.mean()) ** 2).sum()) for group in groups) / df
    design = {"variance": variance, "df": float(df), "control_replicates": float(sizes[0]), "alpha": alpha}
    return williams_test(means[0], means[1:], replicates=sizes[1:], alternative=alternative, **design)


def from_blocks(
    table: ArrayLike,
    *,
    effective_blocks: float | None = None,
    least_variance: float = 0.0,
    alpha: float = 0.05,
    alternative: Alternative = "greater",
) -> WilliamsResult:
    """Williams' test of a randomised block design; treatment 0 is the control, the lowest dose comes next.

    Parameters
    ----------
    table : (block, treatment) array_like
    effective_blocks : float in (1, blocks], optional
        Number of independent blocks that give treatment means as precise as these, if blocks are correlated.
    least_variance : float, optional
        Variance that the estimate is raised to, where residuals are smaller than differences that matter.
    alpha, alternative : as in `williams_test`

    Notes
    -----
    With S the squared residuals of the additive layout of b blocks and t treatments, n effective blocks:
    s^2 = S n / (b (n - 1) (t - 1)), n replicates, max(1, (n - 1)(t - 1)) degrees of freedom; for n = b
    the residual mean square with (b - 1)(t - 1). A mean over blocks has variance sigma^2 / n, so S has
    the expectation sigma^2 (b - b / n)(t - 1) and s^2 is unbiased; the degrees of freedom are approximate.
    """
    values = _check.finite(table, "table")
    if values.ndim != 2 or min(values.shape) < 2:
        raise ValueError(
            f"'table' must be (block, treatment) with at least 2 of each, got shape {values.shape}."
        )
    b, t = values.shape
    n = float(b if effective_blocks is None else effective_blocks)
    if not 1.0 < n <= b:
        raise ValueError(f"'effective_blocks' must be > 1 and <= {b}, the number of blocks, got {n:g}.")
    means = values.mean(axis=0)
    residual = values - means - values.mean(axis=1, keepdims=True) + values.mean()
    variance = float((residual**2).sum()) * n / (b * (n - 1.0) * (t - 1))
    variance = max(variance, float(_check.finite(least_variance, "least_variance", low=0.0)))
    design = {"variance": variance, "df": max(1.0, (n - 1.0) * (t - 1)), "alpha": alpha}
    return williams_test(means[0], means[1:], replicates=n, alternative=alternative, **design)


@lru_cache(maxsize=4096)
def _critical_value(replicates: tuple[float, ...], control: float, df: float, alpha: float) -> float:
    """`critical_value`, of replicates in units of those of the top dose."""
    from scipy.optimize import brentq
    from scipy.special import ndtri, stdtrit

    # The top mean alone bounds from below, Bonferroni for k means of no larger variance from above
    k = len(replicates)
    low, high = (-float(ndtri(p) if math.isinf(df) else stdtrit(df, p)) for p in (alpha, alpha / k))
    if k == 1:
        return low
    return float(brentq(lambda t: _upper_tail(t, replicates, control, df) - alpha, low, high, xtol=1e-10))


def _upper_tail(t: float, replicates: tuple[float, ...], control: float, df: float) -> float:
    """Probability that the statistic of the top dose exceeds `t` > 0; replicates in units of its own."""
    from scipy.special import gammainccinv, gammaincinv, gammaln, ndtr

    x, weighted = _top_mean(replicates, max(1.0, control))
    root, error = math.sqrt(control), math.sqrt(1.0 + 1.0 / control)

    def exceeds(s: Array) -> Array:
        """The same given the estimate `s` of the standard deviation; over the control mean."""
        shift = t * error * s
        density = np.exp(-0.5 * control * (x - shift[:, None]) ** 2) * (root / math.sqrt(2.0 * np.pi))
        return np.asarray(ndtr(root * (_REACH - shift)) - density @ weighted)

    if math.isinf(df):
        return float(exceeds(np.ones(1))[0])
    # Over s, from where it has mass to where no mean gets; the fourth root tames the power at 0
    half = 0.5 * df
    low, high = math.sqrt(gammaincinv(half, 1e-16) / half), math.sqrt(gammainccinv(half, 1e-16) / half)
    scale = min(0.5 / math.sqrt(df), 0.5 / t)
    top = max(min(high, _REACH / t), low * 1.001) ** 0.25
    v, dv = _panels(low**0.25, top, 0.25 * scale / min(1.0, top**3))
    log_density = (
        math.log(8.0) + half * math.log(half) - gammaln(half) + (4.0 * df - 1.0) * np.log(v) - half * v**8
    )
    return float(np.sum(dv * np.exp(log_density) * exceeds(v**4)))


@lru_cache(maxsize=256)
def _top_mean(replicates: tuple[float, ...], sharpness: float) -> tuple[Array, Array]:
    """Nodes x up to `_REACH`; P(M_k <= x) times weights, for densities of precision up to `sharpness`."""
    low = -_REACH / math.sqrt(sum(replicates))
    x, dx = _panels(low, _REACH, 1.0 / math.sqrt(max(*replicates, sharpness)))
    return x, dx * _stays_up(x, np.array(replicates[::-1]))


def _stays_up(x: Array, replicates: Array) -> Array:
    """Probability that a walk with steps of mean r x and variance r never falls below 0, for ascending x."""
    reached = np.cumsum(replicates)
    if x.size > 1 and (x[-1] - x[0]) ** 2 * reached[-1] / 8.0 > _TILT:
        return np.concatenate([_stays_up(part, replicates) for part in np.array_split(x, 2)])

    # Nodes after each step, from the least to the largest position that any x gets to
    low = np.maximum(x[0] * reached - _REACH * np.sqrt(reached), 0.0)
    high = np.maximum(x[-1] * reached, 0.0) + _REACH * np.sqrt(reached)
    scale = np.sqrt(np.minimum(replicates, np.append(replicates[1:], np.inf)))
    grids = [_panels(*ends) for ends in zip(low, high, scale, strict=True)]

    # Density of the walk with the drift of the middle of x, then the factor to the other drifts
    drift = 0.5 * (x[0] + x[-1])
    density = _normal(grids[0][0], replicates[0], drift)
    for ((u, du), (y, _)), r in zip(pairwise(grids), replicates[1:], strict=True):
        density = _normal(y[:, None] - u, r, drift) @ (du * density)
    y, dy = grids[-1]
    factor = np.exp((x - drift)[:, None] * y - 0.5 * reached[-1] * (x**2 - drift**2)[:, None])
    return np.asarray(factor @ (dy * density))


def _normal(y: Array, r: float, drift: float) -> Array:
    """Density at `y` of a step."""
    return np.asarray(np.exp(-0.5 / r * (y - drift * r) ** 2) / math.sqrt(2.0 * np.pi * r))


def _panels(low: float, high: float, scale: float) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on [low, high], in panels of at most 5 times the integrand's scale."""
    n = max(1, math.ceil((high - low) / (5.0 * scale)))
    half = 0.5 * (high - low) / n
    centre = low + half * (2.0 * np.arange(n) + 1.0)
    return (centre[:, None] + half * _GAUSS).ravel(), np.tile(half * _GAUSS_WEIGHT, n)


def _row(value: ArrayLike, name: str) -> Array:
    array = _check.finite(value, name)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"'{name}' must be one-dimensional and not empty, got shape {array.shape}.")
    return array


def _replicates(value: ArrayLike, k: int) -> Array:
    array = _check.finite(value, "replicates", low=0.0, open_low=True)
    if array.shape not in ((), (k,)):
        raise ValueError(
            f"'replicates' must be a number or one for each of the {k} doses, got shape {array.shape}."
        )
    return np.full(k, array, dtype=np.float64)
