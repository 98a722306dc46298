"""How far a model is from the samples it was fitted to, and how near any such model could come (Section 6.A).

All errors but the logarithmic one follow exactly from the moments of the slices. Three floors bound them from
below:

- bivariate: no function of (theta_h, theta_d) does better than the mean over phi_d (Romeiro et al. 2008);
- monotone: no sum of lobes does better than the best function that falls with theta_h;
- azimuthal: no model `a + b cos(2 phi_d)` at each (theta_h, theta_d) does better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf._brief import Brief
from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.collapse import SliceProfile, slice_mask, stack_profiles

__all__ = ["LOG_OFFSET", "FitErrors", "fit_errors", "log_rms", "profile_model"]

#: Added to reflectances in 1/sr before their logarithm, so that black is a number.
LOG_OFFSET = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class FitErrors(Brief):
    """Sums of squares of a fit over all samples, (theta_d, channel) each, and their relative RMS.

    Parameters
    ----------
    energy, squares, bivariate, monotone, azimuthal : (theta_d, channel) ndarray, 1/sr^2
        Sum of squares of the samples, of what the model leaves, and of what the floors leave.
    """

    energy: NDArray[np.float64]
    squares: NDArray[np.float64]
    bivariate: NDArray[np.float64]
    monotone: NDArray[np.float64]
    azimuthal: NDArray[np.float64]

    @property
    def rel_rms(self) -> float:
        """Relative (energy-normalised) RMS over all samples."""
        return _relative(self.squares.sum(), self.energy.sum())

    @property
    def bivariate_floor(self) -> float:
        """Least `rel_rms` of any function of (theta_h, theta_d)."""
        return _relative(self.bivariate.sum(), self.energy.sum())

    @property
    def monotone_floor(self) -> float:
        """Least `rel_rms` of any function of (theta_h, theta_d) that falls with theta_h."""
        return _relative(self.monotone.sum(), self.energy.sum())

    @property
    def azimuthal_floor(self) -> float:
        """Least `rel_rms` of any `a(theta_h, theta_d) + b(theta_h, theta_d) cos(2 phi_d)`."""
        return _relative(self.azimuthal.sum(), self.energy.sum())

    @property
    def slice_rel_rms(self) -> NDArray[np.float64]:
        """Relative RMS of each slice and channel, (theta_d, channel); NaN where there is no energy."""
        nothing = np.full_like(self.energy, np.nan)
        return np.sqrt(np.divide(self.squares, self.energy, out=nothing, where=self.energy > 0.0))

    def summary(self) -> dict[str, float]:
        """`rel_rms` and the three floors by name."""
        names = ("rel_rms", "bivariate_floor", "monotone_floor", "azimuthal_floor")
        return {name: getattr(self, name) for name in names}


def _relative(squares: float, energy: float) -> float:
    return float(np.sqrt(squares / energy)) if energy > 0.0 else float("nan")


def profile_model(
    theta_h: NDArray[np.float64],
    theta_d: NDArray[np.float64],
    kappa: NDArray[np.float64],
    gamma: NDArray[np.float64],
    beta: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum of lobes a and amplitude b of `cos(2 phi_d)` at the slices' own parameters.

    Parameters
    ----------
    theta_h : (theta_d, theta_h) ndarray, radians
    theta_d : (theta_d,) ndarray, radians
    kappa, gamma, beta : (theta_d, channel, lobe) ndarray

    Returns
    -------
    a, b : (theta_d, channel, theta_h) ndarray, 1/sr
    """
    log_cos = half_diff.log_cos(theta_h)[:, None, :, None]
    lobes = np.expm1(kappa[:, :, None] * np.exp(gamma[:, :, None] * log_cos))
    factor = half_diff.azimuthal_factor(theta_h, theta_d[:, None])
    return lobes.sum(-1), (lobes * beta[:, :, None]).sum(-1) * factor[:, None]


def fit_errors(
    profiles: Sequence[SliceProfile],
    kappa: NDArray[np.float64],
    gamma: NDArray[np.float64],
    beta: NDArray[np.float64],
) -> FitErrors:
    """Errors and floors of parameters (theta_d, channel, lobe) on the slices they belong to."""
    theta_d, theta_h, moments = stack_profiles(profiles)
    n, f, ff, c, cc, fc = np.moveaxis(moments, -1, 0)
    mean, mean_c = (np.divide(x, n, out=np.zeros_like(x), where=n > 0.0) for x in (f, c))

    # Spread over phi_d about the mean, and the part of it along cos(2 phi_d)
    var_f = np.maximum(ff - mean * f, 0.0)
    var_c = np.maximum(cc - mean_c * c, 0.0)
    cov = fc - mean * c
    slope = np.divide(cov, var_c, out=np.zeros_like(cov), where=var_c > 1e-12 * n)
    off_cosine = np.maximum(var_f - slope * cov, 0.0)

    # Where there is no sample a lobe may be high beyond measure: do not look
    looked_at = np.where(n.any(1), theta_h, np.pi / 2)
    a, b = profile_model(looked_at, theta_d, kappa, gamma, beta)
    of_mean = n * (a + mean_c * b - mean) ** 2
    squares = of_mean + var_c * (b - slope) ** 2 + off_cosine
    isotonic = np.zeros(n.shape[:2])
    for s, channel in np.ndindex(*n.shape[:2]):
        some = n[s, channel] > 0.0
        y, w = mean[s, channel, some], n[s, channel, some]
        isotonic[s, channel] = (w * (y - _core.decreasing(y, w)) ** 2).sum()
    bivariate = var_f.sum(-1)
    return FitErrors(ff.sum(-1), squares.sum(-1), bivariate, bivariate + isotonic, off_cosine.sum(-1))


def log_rms(
    measured: MeasuredBRDF,
    rows: NDArray[np.int_],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    *,
    min_theta_h: float,
    perimeter_mask: bool,
    theta_h_step: int = 1,
) -> float:
    """RMS of `ln((model + e) / (f + e))` over all samples, e = `LOG_OFFSET`.

    Parameters
    ----------
    measured : MeasuredBRDF
    rows : (theta_d,) ndarray of int
        The table's rows that were fitted.
    a, b : (theta_d, channel, theta_h) ndarray, 1/sr
        See `profile_model`.
    min_theta_h, perimeter_mask, theta_h_step
        As in `dsbrdf.paper.collapse.slice_profiles`.
    """
    mask = slice_mask(measured, rows, min_theta_h, perimeter_mask, theta_h_step)
    cos_2phi = np.cos(2.0 * measured.phi_d)
    total, count = 0.0, 0
    for i, row in enumerate(rows):
        f = measured.rows([int(row)])[:, mask[i], 0]
        model = a[i][:, mask[i], None] + b[i][:, mask[i], None] * cos_2phi
        ratio = (model + LOG_OFFSET) / (f + LOG_OFFSET)
        ratio = ratio[np.isfinite(f)]
        total += float((np.log(ratio) ** 2).sum())
        count += ratio.size
    return float(np.sqrt(total / count)) if count else float("nan")
