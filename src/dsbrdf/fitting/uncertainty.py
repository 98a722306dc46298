"""How uncertain the parameters of a fit are: standard errors from the Jacobian, and by the bootstrap.

Both take the samples of a slice as independent, and let their noise differ from one theta_h to another. They tell how
far other samples of the same material would have moved the parameters; that no sum of lobes is the material shows in
the floors and in held-out errors, not here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.fitting import scattered
from dsbrdf.geometry import half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile, slice_mask, slice_rows
from dsbrdf.paper.fit_slices import fit_profiles

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF
    from dsbrdf.paper.fit_report import Fit

__all__ = ["StandardErrors", "bootstrap", "standard_errors"]

Array = NDArray[np.float64]
#: Least eigenvalue, relative to the largest, of a Hessian of unit diagonal in a direction that the data tell of.
LEAST_EIGENVALUE = 1e-10


@dataclass(frozen=True, eq=False)
class StandardErrors:
    """Standard errors of the parameters of a model.

    Parameters
    ----------
    ln_kappa, ln_gamma, asin_beta : (theta_d, channel, lobe) ndarray
        Of what is estimated. Infinite where the data do not tell; NaN where a parameter is at a limit of the fit, is
        not fitted, or the slice has no sample or no more than the model has numbers.
    freedom : (theta_d, channel) ndarray
        Samples less numbers of the model.
    parameters : (kappa, gamma, beta), each (theta_d, channel, lobe) ndarray
        The estimates.
    """

    ln_kappa: Array
    ln_gamma: Array
    asin_beta: Array
    freedom: Array
    parameters: tuple[Array, Array, Array]

    @property
    def kappa(self) -> Array:
        """Of kappa, to first order."""
        return self.parameters[0] * self.ln_kappa

    @property
    def gamma(self) -> Array:
        """Of gamma, to first order."""
        return self.parameters[1] * self.ln_gamma

    @property
    def beta(self) -> Array:
        """Of beta, to first order."""
        return np.sqrt(1.0 - self.parameters[2] ** 2) * self.asin_beta

    def intervals(self, level: float = 0.95) -> dict[str, tuple[Array, Array]]:
        """Confidence intervals of "kappa", "gamma" and "beta": (low, high), each (theta_d, channel, lobe).

        Symmetric in ln(kappa), ln(gamma) and asin(beta), with quantiles of Student's t.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"'level' must lie between 0 and 1, got {level}.")
        from scipy import special

        freedom = np.where(self.freedom > 0.0, self.freedom, np.nan)
        t = special.stdtrit(freedom, 0.5 + 0.5 * level)[..., None]
        kappa, gamma, beta = self.parameters
        with np.errstate(over="ignore"):
            spread = [np.exp(t * error) for error in (self.ln_kappa, self.ln_gamma)]
            middle, reach = np.arcsin(beta), t * self.asin_beta
            low, high = (np.sin(np.clip(middle + sign * reach, -np.pi / 2, np.pi / 2)) for sign in (-1, 1))
            return {
                "kappa": (kappa / spread[0], kappa * spread[0]),
                "gamma": (gamma / spread[1], gamma * spread[1]),
                "beta": (low, high),
            }


def standard_errors(fit: Fit) -> StandardErrors:
    """Standard errors of the parameters of a fit, from the Jacobian at its end.

    Parameters
    ----------
    fit : Fit
        With `method="joint"`.

    Returns
    -------
    StandardErrors

    Raises
    ------
    ValueError
        If the parameters are not those of least squares, slice by slice.

    Notes
    -----
    The covariance is `H^-1 (sum over theta_h of s^2 J^T J) H^-1` with `H = J^T J` over the rows of all theta_h, and
    s^2 the residual variance at a theta_h, its samples counted less their leverage: the estimate of White (1980), as
    MacKinnon and White (1985) correct it for few samples ("HC3" where each theta_h has one).
    """
    if fit.options.get("method") != "joint" or fit.model.curves is not None:
        raise ValueError(
            "standard errors are those of a fit of slices by method='joint': other parameters are not at the least "
            "of the squares of their slice."
        )
    model = fit.model
    shape = model.kappa.shape
    azimuthal = bool(model.beta.any())
    offset = metrics.LOG_OFFSET if fit.options.get("loss") == "log" else None
    errors = np.full((*shape, 3), np.nan)
    freedom = np.zeros(shape[:2])
    for i, profile in enumerate(fit.profiles):
        for channel in range(shape[1]):
            slice_ = _Slice.of(profile, channel, offset)
            lobes = np.stack([getattr(model, name)[i, channel] for name in ("kappa", "gamma", "beta")], -1)
            errors[i, channel], freedom[i, channel] = slice_.errors(lobes, azimuthal)
    ln_kappa, ln_gamma, asin_beta = np.moveaxis(errors, -1, 0)
    estimates = (model.kappa, model.gamma, model.beta)
    return StandardErrors(ln_kappa, ln_gamma, asin_beta, freedom, estimates)


@dataclass(frozen=True, eq=False)
class _Slice:
    """A slice of one channel as the fit sees it: two rows a theta_h, and what is left of the squares.

    The sum of squares over phi_d is `(w_a (a + skew b) - y_a)^2 + (w_b b - y_b)^2 + rest`, with a the sum of lobes and
    b their azimuthal amplitude; for the logarithmic loss see the kernel.
    """

    ln_cos: Array
    n: Array
    w_a: Array
    skew: Array
    mean: Array
    w_b: Array
    y_b: Array
    rest: Array
    offset: float | None

    @classmethod
    def of(cls, profile: SliceProfile, channel: int, offset: float | None) -> _Slice:
        some = profile.count[channel] > 0.0
        weight, f, ff, c, cc, fc = profile.moments[channel][some].T
        theta_h = profile.theta_h[some]
        mean, mean_c = f / weight, c / weight
        var_c = np.maximum(cc - mean_c * c, 0.0)
        seen = var_c > 1e-12 * weight
        spread_c = np.sqrt(np.where(seen, var_c, 1.0))
        along = np.where(seen, (fc - mean * c) / spread_c, 0.0)
        rest = np.maximum(ff - mean * f - along**2, 0.0)
        factor = half_diff.azimuthal_factor(theta_h, profile.theta_d)
        unit = np.ones_like(mean) if offset is None else 1.0 / (mean + offset)
        return cls(
            half_diff.log_cos(theta_h),
            profile.n_samples[channel][some],
            np.sqrt(weight),
            mean_c * factor,
            mean,
            np.where(seen, factor * spread_c, 0.0) * unit,
            along * unit,
            rest * unit**2,
            offset,
        )

    def errors(self, lobes: Array, azimuthal: bool) -> tuple[Array, float]:
        """Standard errors (lobe, 3) of ln(kappa), ln(gamma) and asin(beta), and degrees of freedom."""
        errors = np.full(lobes.shape, np.nan)
        free = self._free(lobes, azimuthal)
        freedom = float(self.n.sum() - free.sum())
        if not self.n.size or freedom <= 0.0:
            return errors, freedom
        residual, jacobian = self._rows(lobes)
        jacobian = jacobian[..., free]
        scale = np.sqrt((jacobian**2).sum((0, 1)))
        told = scale > 0.0
        of_free = np.full(len(scale), np.inf)
        if told.any():
            covariance = self._covariance(residual, jacobian[..., told] / scale[told])
            of_free[told] = np.sqrt(covariance) / scale[told]
        errors[free] = of_free
        return errors, freedom

    def _free(self, lobes: Array, azimuthal: bool) -> NDArray[np.bool_]:
        """Which parameters (lobe, 3) are fitted and at no limit of the fit."""
        brightest = self.mean.max(initial=0.0)
        near = 1.0 - 1e-9
        return np.stack(
            [
                np.expm1(lobes[:, 0]) < near * _core.MAX_HEIGHT * brightest,
                np.abs(np.log(lobes[:, 1])) < near * _core.MAX_LN_GAMMA,
                azimuthal & (np.abs(np.arcsin(lobes[:, 2])) < near * _core.MAX_ASIN_BETA),
            ],
            axis=-1,
        )

    def _rows(self, lobes: Array) -> tuple[Array, Array]:
        """Residuals (2, theta_h) and their Jacobian (2, theta_h, lobe, 3)."""
        kappa, gamma, beta = lobes.T
        x = kappa * np.exp(gamma * self.ln_cos[:, None])
        value, slope = np.expm1(x), x * np.exp(x)
        a, b = value.sum(-1), (value * beta).sum(-1)
        model = a + self.skew * b
        if self.offset is None:
            w_a = self.w_a
            mean_row = w_a * (model - self.mean)
        else:
            w_a = self.w_a / (model + self.offset)
            mean_row = self.w_a * np.log((model + self.offset) / (self.mean + self.offset))
        by_a = np.stack([slope, slope * gamma * self.ln_cos[:, None], np.zeros_like(value)], -1)
        by_b = by_a * beta[:, None]
        by_b[..., 2] = value * np.sqrt(1.0 - beta**2)
        skew, w_b = self.skew[:, None, None], self.w_b[:, None, None]
        jacobian = np.stack([w_a[:, None, None] * (by_a + skew * by_b), w_b * by_b])
        return np.stack([mean_row, self.w_b * b - self.y_b]), jacobian

    def _covariance(self, residual: Array, jacobian: Array) -> Array:
        """Variances (parameter,) for a Jacobian (2, theta_h, parameter) of columns of unit length."""
        hessian = np.einsum("rhp,rhq->pq", jacobian, jacobian)
        values, vectors = np.linalg.eigh(hessian)
        seen = values > LEAST_EIGENVALUE * values[-1]
        inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
        leverage = np.einsum("rhp,pq,rhq->h", jacobian, inverse, jacobian)
        squares = (residual**2).sum(0) + self.rest
        left = np.maximum(1.0 - leverage / self.n, 1e-6)
        variance = squares / self.n / left**2
        meat = np.einsum("rhp,h,rhq->pq", jacobian, variance, jacobian)
        variances = np.diagonal(inverse @ meat @ inverse).copy()
        hidden = vectors[:, ~seen]
        variances[(np.abs(hidden) > 1e-6).any(-1)] = np.inf
        return variances


def bootstrap(fit: Fit, rng: np.random.Generator, n_draws: int = 200) -> tuple[Array, Array, Array]:
    """Parameters of fits to samples drawn with replacement from those that were fitted.

    Parameters
    ----------
    fit : Fit
        Of slices.
    rng : numpy.random.Generator
    n_draws : int, optional

    Returns
    -------
    kappa, gamma, beta : (draw, theta_d, channel, lobe) ndarray
        Lobes of a draw are matched to those of `fit`, slice by slice.

    Raises
    ------
    ValueError
        If `fit` has curves, or there is no draw.

    Notes
    -----
    Each sample counts as often as a Poisson variable of mean one says, the same for all channels (Efron and Tibshirani
    1993; the Poisson variant is that of Hanley and MacGibbon 2006).
    """
    if n_draws < 1:
        raise ValueError(f"'n_draws' must be at least 1, got {n_draws}.")
    if fit.model.curves is not None:
        raise ValueError("the bootstrap is that of a fit of slices: fit without curves.")
    how = {key: fit.options[key] for key in ("method", "loss", "azimuthal", "order", "fill")}
    draws = []
    for _ in range(n_draws):
        drawn, _ = fit_profiles(_drawn(fit, rng), fit.model.n_lobes, **how)
        draws.append(_matched(drawn, fit.model))
    kappa, gamma, beta = (np.stack(part) for part in zip(*draws, strict=True))
    return kappa, gamma, beta


def _drawn(fit: Fit, rng: np.random.Generator) -> list[SliceProfile]:
    """The slices of a fit from samples drawn with replacement."""
    theta_d = fit.model.theta_d
    masks = {key: fit.options[key] for key in ("min_theta_h", "perimeter_mask")}
    if isinstance(fit.measured, Samples):
        samples = fit.measured
        weights = np.ones(len(samples)) if samples.weights is None else samples.weights
        drawn = dataclasses.replace(samples, weights=weights * rng.poisson(size=len(samples)))
        return scattered.gather(drawn, theta_d, fit.options["tolerance"], **masks)
    rows = slice_rows(len(fit.measured.theta_d), len(theta_d))
    kept = slice_mask(fit.measured, rows, **masks, theta_h_step=fit.options["theta_h_step"])
    values = fit.measured.rows(rows)
    weight = np.isfinite(values) * rng.poisson(size=values.shape[1:]) * kept.T[:, :, None]
    f, c = np.nan_to_num(values), np.cos(2.0 * fit.measured.phi_d)
    terms = (np.ones_like(f), f, f**2, c + 0.0 * f, c**2 + 0.0 * f, f * c)
    moments = np.stack([(weight * term).sum(-1) for term in terms], axis=-1).transpose(2, 0, 1, 3)
    theta_h = fit.measured.theta_h
    return [
        SliceProfile(float(t), theta_h, np.ascontiguousarray(m))
        for t, m in zip(theta_d, moments, strict=True)
    ]


def _matched(drawn: Sequence[Array], model: DSBRDF) -> list[Array]:
    """Drawn parameters with lobes in the order of the model's nearest, slice by slice."""
    from scipy.optimize import linear_sum_assignment

    parts = [part.copy() for part in drawn]
    tiny = np.finfo(np.float64).tiny
    new, old = (
        np.log(np.maximum(np.stack(pair, -1), tiny))
        for pair in ((parts[0], parts[1]), (model.kappa, model.gamma))
    )
    for at in np.ndindex(*model.kappa.shape[:2]):
        _, order = linear_sum_assignment(np.abs(old[at][:, None] - new[at][None]).sum(-1))
        for part in parts:
            part[at] = part[at][order]
    return parts
