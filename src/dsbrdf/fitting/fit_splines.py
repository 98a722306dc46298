"""The fit of curves: all slices of a channel at once, over the coefficients of the splines (Section 6.C).

A slice that holds few samples is then held by its neighbours. What is minimised is what the fit of slices minimises,
exactly: two residual rows a theta_h, from the moments over phi_d. Coefficients are bounded, and with them the curves.
"""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.fitting._minimise import Minimum, minimise
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile, slice_profiles, stack_profiles
from dsbrdf.paper.curves import LN_GAMMA, LN_KAPPA, CurveBasis, Curves
from dsbrdf.paper.fit_slices import ConvergenceWarning, brightest
from dsbrdf.paper.spike import spike_heights

if TYPE_CHECKING:
    from dsbrdf.paper.fit_report import Fit

__all__ = ["ChannelProblem", "fit_curves"]

#: As many coefficients as the paper's, with more of them near grazing (decision record 0010).
BASIS = CurveBasis(variable="cosine")
#: Where samples near the pole tell, at most this many times as high as they are: a coefficient acts on many slices.
ROOM = 1.5


def fit_curves(
    profiles: Sequence[SliceProfile],
    start: DSBRDF,
    basis: CurveBasis | None = None,
    *,
    loss: str = "l2",
    near_pole: Sequence[SliceProfile] | None = None,
) -> tuple[Curves, list[Minimum]]:
    """Fit curves to slices, from a model of slices whose lobes correspond over theta_d.

    Parameters
    ----------
    profiles : sequence of SliceProfile
        Ascending in theta_d. They need not be those that `start` was fitted to: all rows of a table say most.
    start : DSBRDF
        Smoothed to start from. If all its beta are zero, they stay so.
    basis : CurveBasis, optional
        By default quadratic with five knots uniform in cos(theta_d); `CurveBasis()` is that of the paper.
    loss : {"l2", "log"}, optional
        See `dsbrdf.fit`.
    near_pole : sequence of SliceProfile, optional
        The slices with no lower cut of theta_h, which bound what lobes do below it.

    Returns
    -------
    curves : Curves
        Logarithmic, without a spike. The objective is never above that of the smoothed `start`.
    minima : list of Minimum
        How the search ended, one a channel.

    Raises
    ------
    ValueError
        If `loss` is unknown, channels disagree, or there is no valid sample.
    """
    if loss not in ("l2", "log"):
        raise ValueError(f"'loss' must be 'l2' or 'log', got {loss!r}.")
    theta_d, theta_h, moments = stack_profiles(profiles)
    if moments.shape[1] != start.n_channels:
        raise ValueError(
            f"'start' must have the channels of the profiles, {moments.shape[1]}, got {start.n_channels}."
        )
    if not moments[..., 0].any():
        raise ValueError("no slice has a valid sample. Lower 'min_theta_h' or check the measurement.")
    basis = basis or BASIS
    log_offset = metrics.LOG_OFFSET if loss == "log" else None
    smoothed = Curves.of(start, basis)
    names = ("kappa", "gamma", "beta") if np.any(start.beta) else ("kappa", "gamma")
    design = basis.design(theta_d)
    fitted = {name: getattr(smoothed, name).copy() for name in ("kappa", "gamma", "beta")}
    heights = np.full(moments.shape[:2], np.nan) if near_pole is None else brightest(near_pole, profiles)
    minima = []
    for channel in range(start.n_channels):
        x = np.stack([fitted[name][channel] for name in names], axis=1)
        problem = ChannelProblem(
            moments[:, channel], theta_h, theta_d, design, log_offset, heights[:, channel]
        )
        x, minimum = minimise(problem, x)
        for i, name in enumerate(names):
            fitted[name][channel] = x[:, i]
        minima.append(minimum)
    return Curves(basis, **fitted), minima


def refit(fit: Fit, basis: CurveBasis | None = None, *, strict: bool = False) -> Fit:
    """Go on from a fit of slices to curves, which all rows of the table hold (of scattered samples, the slices).

    Raises
    ------
    RuntimeError
        With `strict`, if a channel did not converge.

    Warns
    -----
    ConvergenceWarning
        If channels ran out of iterations.
    """
    start = time.perf_counter()
    profiles = near_pole = fit.profiles
    if isinstance(fit.measured, MeasuredBRDF):
        masks = {key: fit.options[key] for key in ("perimeter_mask", "theta_h_step")}
        n_rows = len(fit.measured.theta_d)
        near_pole = slice_profiles(fit.measured, n_slices=n_rows, min_theta_h=0.0, **masks)
        profiles = [profile.cut(fit.options["min_theta_h"]) for profile in near_pole]
    curves, minima = fit_curves(profiles, fit.model, basis, loss=fit.options["loss"], near_pole=near_pole)
    theta_d = np.array([profile.theta_d for profile in profiles])
    parameters = curves.at(theta_d)
    heights = spike_heights(near_pole, *parameters[:2]) if np.any(fit.model.spike) else np.zeros(0)
    if heights.any():
        curves = curves.with_spike(theta_d, heights)
    seconds = time.perf_counter() - start
    _report_trouble(minima, strict)

    errors = metrics.fit_errors(profiles, *parameters)
    options = fit.options | {"curves": True}
    kept = {key: getattr(fit.model, key) for key in ("name", "source", "profile")}
    model = curves.model(**kept, fit_options=options, errors=errors.summary())
    fit = dataclasses.replace(fit, model=model, errors=errors, profiles=profiles, options=options)
    return dataclasses.replace(fit, seconds=fit.seconds + seconds)


def _report_trouble(minima: Sequence[Minimum], strict: bool) -> None:
    trouble = [str(channel) for channel, minimum in enumerate(minima) if not minimum.converged]
    if not trouble:
        return
    text = (
        f"the curves of channel {', '.join(trouble)} ran out of iterations; the best so far are kept. "
        "Fewer lobes converge sooner."
    )
    if strict:
        raise RuntimeError(text)
    warnings.warn(text, ConvergenceWarning, stacklevel=4)


class ChannelProblem:
    """Least squares of one channel over coefficients (lobe, parameter, coefficient) of ln(kappa), ln(gamma), beta.

    Parameters
    ----------
    moments : (theta_d, theta_h, 6) ndarray
        See `SliceProfile`.
    theta_h : (theta_d, theta_h) ndarray, radians
    theta_d : (theta_d,) ndarray, radians
    design : (theta_d, coefficient) ndarray
        Values of the basis.
    log_offset : float, optional
        In 1/sr, of the logarithmic loss; least squares by default.
    max_height : (theta_d,) ndarray, optional
        Greatest height of a lobe in 1/sr, NaN where it is not known.

    Notes
    -----
    With `a` the sum of lobes and `b` its azimuthal amplitude over g, the squares over phi_d are
    `w_a^2 (a + skew b - mean)^2 + (w_b b - y_b)^2` and a constant, `floor`. Without beta, the second row is constant.
    """

    def __init__(
        self,
        moments: NDArray[np.float64],
        theta_h: NDArray[np.float64],
        theta_d: NDArray[np.float64],
        design: NDArray[np.float64],
        log_offset: float | None = None,
        max_height: NDArray[np.float64] | None = None,
    ) -> None:
        n, f, ff, c, cc, fc = np.moveaxis(moments, -1, 0)
        some = n > 0.0
        count = np.where(some, n, 1.0)
        mean, mean_c = f / count, c / count
        var_f, var_c = np.maximum(ff - mean * f, 0.0), np.maximum(cc - mean_c * c, 0.0)
        told = var_c > 1e-12 * count
        root = np.sqrt(np.where(told, var_c, 0.0))
        along = np.divide(fc - mean * c, root, out=np.zeros_like(root), where=told)
        factor = half_diff.azimuthal_factor(theta_h, theta_d[:, None])
        # The logarithmic loss is relative: it divides what is not in the mean by the mean
        unit = np.ones_like(mean) if log_offset is None else 1.0 / (mean + log_offset)
        self.design, self.log_offset, self.mean = design, log_offset, mean
        # Where there is no sample a lobe may be high beyond measure: do not look
        self.ln_cos = half_diff.log_cos(np.where(some, theta_h, np.pi / 2))[:, None]
        self.w_a, self.skew = np.sqrt(n), mean_c * factor
        self.w_b, self.y_b = factor * root * unit, along * unit
        self.floor = float((np.maximum(var_f - along**2, 0.0) * unit**2).sum())
        self.energy = float((ff * unit**2).sum())
        peak = max(float(mean.max()), np.finfo(float).tiny)
        height = np.full(len(mean), _core.MAX_HEIGHT * peak)
        if max_height is not None:
            height = np.where(max_height > 0.0, ROOM * max_height, height)
        self.ln_kappa_high = np.minimum(_greatest(np.log(np.log1p(height)), design), LN_KAPPA[1])

    def limits(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest coefficients, each of `shape` (lobe, parameter, coefficient)."""
        # Dim channels have low peaks
        low, high = np.empty(shape), np.empty(shape)
        low[:, 0] = min(LN_KAPPA[0], self.ln_kappa_high.min() - 10.0)
        high[:, 0] = self.ln_kappa_high
        low[:, 1], high[:, 1] = LN_GAMMA
        low[:, 2:], high[:, 2:] = -1.0, 1.0
        return low, high

    def cost(self, x: NDArray[np.float64]) -> float:
        """Half the sum of squares less `floor` (without beta: and less the constant rows)."""
        at = np.einsum("sc,kpc->pks", self.design, x).swapaxes(1, 2)
        kappa, gamma = np.exp(at[:2])[..., None]
        beta = at[2][..., None] if len(at) > 2 else None
        with np.errstate(over="ignore", invalid="ignore"):
            power = kappa * np.exp(gamma * self.ln_cos)
            lobes = np.expm1(power)
            slopes = power * (lobes + 1.0)
            b = (lobes * beta).sum(1) if beta is not None else 0.0
            model = lobes.sum(1) + self.skew * b
            if self.log_offset is None:
                rows, weight = self.w_a * (model - self.mean), self.w_a
            else:
                model = model + self.log_offset
                rows, weight = self.w_a * np.log(model / (self.mean + self.log_offset)), self.w_a / model
            if beta is not None:
                rows = np.concatenate([rows, self.w_b * b - self.y_b], axis=-1)
            self._state = (gamma, beta, lobes, slopes, weight, rows)
            return 0.5 * float(np.vdot(rows, rows))

    def linearise(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Gauss-Newton Hessian and gradient at the last `x` of `cost`, unknowns in the order of its entries."""
        jacobian, rows = self.slice_jacobian(), self._state[-1]
        # Each slice sees its parameters, and these are sums of coefficients
        hessian = jacobian @ jacobian.swapaxes(1, 2)
        gradient = (jacobian @ rows[..., None])[..., 0]
        n_slices, p = gradient.shape
        size = self.design.shape[1]
        pairs = (self.design[:, :, None] * self.design[:, None]).reshape(n_slices, -1)
        whole = (hessian.reshape(n_slices, -1).T @ pairs).reshape(p, p, size, size)
        return whole.swapaxes(1, 2).reshape(p * size, p * size), (gradient.T @ self.design).ravel()

    def slice_jacobian(self) -> NDArray[np.float64]:
        """Derivatives (theta_d, lobe and parameter, row) of residual rows by the parameters at their slice."""
        gamma, beta, lobes, slopes, weight, _ = self._state
        n_slices, n_lobes, n_h = lobes.shape
        by_gamma = gamma * self.ln_cos
        if beta is None:
            by_kappa = weight[:, None] * slopes
            columns = np.stack([by_kappa, by_kappa * by_gamma], axis=2)
            return columns.reshape(n_slices, -1, n_h)
        columns = np.empty((n_slices, n_lobes, 3, 2 * n_h))
        w_a, w_b = weight[:, None], self.w_b[:, None]
        skewed = w_a * self.skew[:, None]
        for rows_of, by_a, by_b in (
            (slice(None, n_h), w_a + skewed * beta, skewed),
            (slice(n_h, None), w_b * beta, w_b),
        ):
            columns[:, :, 0, rows_of] = by_a * slopes
            columns[:, :, 1, rows_of] = columns[:, :, 0, rows_of] * by_gamma
            columns[:, :, 2, rows_of] = by_b * lobes
        return columns.reshape(n_slices, -1, 2 * n_h)


def _greatest(values: NDArray[np.float64], design: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest of `values` (theta_d,) where each function (coefficient,) of the basis has half of its peak or more."""
    near = design >= 0.5 * np.maximum(design.max(0), np.finfo(float).tiny)
    greatest = np.where(near, values[:, None], -np.inf).max(0)
    return np.asarray(np.where(near.any(0), greatest, values.max()))
