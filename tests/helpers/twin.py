"""Short NumPy twins of the compiled kernel (crates/dsbrdf-core): slow, readable, and for tests only.

The unknowns of a slice are x, (lobe, 2) or (lobe, 3): ln kappa, ln gamma and, with the azimuthal term, asin
beta.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

ASIN_BETA = (-1.57, 1.57)


def collapse(values, phi_d):
    """Moments (..., 6) over phi_d of values (..., phi_d), invalid where NaN."""
    valid = np.isfinite(values)
    f = np.where(valid, values, 0.0)
    c = np.where(valid, np.cos(2.0 * phi_d), 0.0)
    return np.stack([valid, f, f * f, c, c * c, f * c], axis=-1).sum(-2)


def ln_cos(theta_h):
    """ln cos(theta_h), finite at 90 degrees."""
    return 0.5 * np.log1p(-np.minimum(np.sin(theta_h) ** 2, 1.0 - 2.0**-53))


@dataclass
class Slice:
    """sum_phi (f - a - b g c)^2 = sum_h w_a^2 (a + skew b - mean)^2 + (w_b b - y_b)^2 + floor."""

    ln_cos: np.ndarray
    w_a: np.ndarray
    skew: np.ndarray
    mean: np.ndarray
    w_b: np.ndarray
    y_b: np.ndarray
    floor: float

    @property
    def bivariate_floor(self):
        return self.floor + (self.y_b**2).sum()


def make_slice(moments, ln_cos, factor=0.0):
    """Slice of moments (theta_h, 6); `factor` is the azimuthal g at each theta_h."""
    some = moments[:, 0] > 0.0
    n, f, ff, c, cc, fc = moments[some].T
    var_f, var_c = (np.maximum(x, 0.0) for x in (ff - f * f / n, cc - c * c / n))
    told = var_c > 1e-12 * n
    along = np.where(told, (fc - f * c / n) / np.sqrt(np.where(told, var_c, 1.0)), 0.0)
    g = np.broadcast_to(factor, some.shape)[some]
    w_b = np.where(told, g * np.sqrt(var_c), 0.0)
    floor = np.maximum(var_f - along**2, 0.0).sum()
    return Slice(ln_cos[some], np.sqrt(n), g * c / n, f / n, w_b, along, floor)


def lobes(x, ln_cos):
    """Values (lobe, theta_h); complex x passes through."""
    kappa, gamma = np.exp(x[:, 0, None]), np.exp(x[:, 1, None])
    return np.expm1(kappa * np.exp(gamma * ln_cos))


def residual(x, s, target=None):
    """Residual rows: of the mean over phi_d and, with beta among the unknowns, of cos(2 phi_d)."""
    value = lobes(x, s.ln_cos)
    target = s.mean if target is None else target
    if x.shape[1] == 2:
        return s.w_a * (value.sum(0) - target)
    b = (np.sin(x[:, 2, None]) * value).sum(0)
    return np.concatenate([s.w_a * (value.sum(0) + s.skew * b - target), s.w_b * b - s.y_b])


def jacobian(x, s):
    """Derivatives (row, unknown) of `residual`."""
    value = lobes(x, s.ln_cos)
    by_kappa = np.exp(x[:, 0, None] + np.exp(x[:, 1, None]) * s.ln_cos) * (value + 1.0)
    by_gamma = by_kappa * np.exp(x[:, 1, None]) * s.ln_cos
    columns = np.stack([by_kappa, by_gamma], axis=1)
    if x.shape[1] == 3:
        beta, slope = np.sin(x[:, 2, None, None]), np.cos(x[:, 2, None]) * value
        of_mean = np.concatenate([columns * (1.0 + s.skew * beta), (slope * s.skew)[:, None]], axis=1)
        of_cos = np.concatenate([columns * beta, slope[:, None]], axis=1)
        columns = np.concatenate([s.w_a * of_mean, s.w_b * of_cos], axis=-1)
    else:
        columns = s.w_a * columns
    return columns.reshape(x.size, -1).T


def objective(x, s):
    """Sum of squares over all samples of the slice."""
    floor = s.floor if x.shape[1] == 3 else s.bivariate_floor
    return (residual(x, s) ** 2).sum() + floor


def bounds(s):
    """Least and greatest ln kappa and ln gamma; a lobe is at most 100 times as high as the slice."""
    return np.array([-40.0, -14.0]), np.array([np.log(np.log1p(100.0 * s.mean.max())), 14.0])


def refine(x, s, target=None):
    """Least-squares fit of all lobes together, from x; to `target` instead of the mean over phi_d."""
    low, high = (
        [*limits, limit][: x.shape[1]] * len(x) for limits, limit in zip(bounds(s), ASIN_BETA, strict=True)
    )
    best = least_squares(
        lambda y: residual(y.reshape(x.shape), s, target),
        np.clip(x.ravel(), np.add(low, 1e-9), np.add(high, -1e-9)),
        lambda y: jacobian(y.reshape(x.shape), s),
        bounds=(low, high),
        x_scale="jac",
        max_nfev=100,
    )
    return best.x.reshape(x.shape)


def fit_lobe(x, s, share):
    """Least-squares fit (2,) of one lobe to its share, from x (2,): the M-step, to its end."""
    return refine(x[None], s, share)[0]


def estimate_lobe(s, target):
    """kappa from the peak, then gamma by log-linear least squares (Section 4, "first estimating kappa")."""
    kappa = max(np.log1p(target.max()), 1e-12)
    height = np.log1p(target) / kappa
    some = height > 1e-6
    weight = s.w_a[some] ** 2 * s.ln_cos[some]
    gamma = (weight @ np.log(height[some])) / (weight @ s.ln_cos[some])
    return np.log([kappa, max(gamma, 1e-12)])


def shares(x, s):
    """Each lobe's share (lobe, theta_h) of the slice: its responsibility times the mean (E-step)."""
    value = lobes(x, s.ln_cos)
    total = value.sum(0)
    return value / np.where(total > 0.0, total, 1.0) * s.mean


def em(s, n_lobes, rounds):
    """The EM of Section 4 from the paper's start: x, and the objective before and after each round."""
    x = estimate_lobe(s, s.mean) - np.log(2.0) * np.arange(n_lobes)[:, None]
    history = [objective(x, s)]
    for _ in range(rounds):
        x = np.array([fit_lobe(lobe, s, share) for lobe, share in zip(x, shares(x, s), strict=True)])
        history.append(objective(x, s))
    return x, history
