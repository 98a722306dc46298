"""How many lobes a material needs (Section 5).

The quality of a fit with K lobes is the Kullback-Leibler divergence between the measured distribution of a slice and
the fitted one, which the expected negative log-probability is up to a constant. From an upper bound down, Williams'
test finds the fewest lobes whose loss is not significant. BIC and the error on held-out phi_d stand beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf._brief import Brief
from dsbrdf.geometry import half_diff
from dsbrdf.paper import metrics, williams
from dsbrdf.paper.collapse import SliceProfile, stack_profiles

__all__ = ["ALPHA", "MAX_TRIED_LOBES", "LobeSelection", "divergence", "select_lobes"]

#: Upper bound from which lobes are taken away.
MAX_TRIED_LOBES = 6
#: Level of Williams' test (Section 5).
ALPHA = 0.01
#: Relative error of a measurement below which differences of shape do not count.
NOISE = 0.01
#: Relative changes of the divergence below this are alike in no two slices, however small the residuals.
LEAST_CHANGE = 0.1
#: Share of the slices that counts as independent: neighbours are 5 degrees apart and alike.
INDEPENDENT_SHARE = 1.0 / 3.0
#: Slices that Williams' test needs at least; with fewer, BIC decides.
MIN_BLOCKS = 6
CRITERIA = ("williams", "bic", "held-out")


@dataclass(frozen=True, eq=False, repr=False)
class LobeSelection(Brief):
    """The number of lobes and why.

    Parameters
    ----------
    n_lobes : int
    criterion : {"williams", "bic", "held-out"}
    values : (max_lobes,) ndarray
        What is compared, for 1, 2, ... lobes: the mean over slices of the log of the divergence; BIC; the relative
        RMS on held-out samples. Lower is better.
    statistic, critical : (max_lobes,) ndarray
        Of Williams' test of that many lobes against `max_lobes`; NaN for `max_lobes` itself and other criteria.
    """

    n_lobes: int
    criterion: str
    values: NDArray[np.float64]
    statistic: NDArray[np.float64]
    critical: NDArray[np.float64]

    @property
    def max_lobes(self) -> int:
        """Upper bound of the choice."""
        return len(self.values)


def divergence(
    profiles: Sequence[SliceProfile], kappa: NDArray[np.float64], gamma: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Kullback-Leibler divergence of fitted from measured distributions, (theta_d, channel), in nats.

    Both are normalised over the samples of a slice; the mean of `-log p` over the measured distribution (the paper's
    E_p of Section 5) less its value for a perfect fit.
    """
    theta_d, theta_h, moments = stack_profiles(profiles)
    count, total = moments[..., 0], moments[..., 1]
    model = count * metrics.profile_model(theta_h, theta_d, kappa, gamma, np.zeros_like(kappa))[0]
    tiny = np.finfo(np.float64).tiny
    measured = np.maximum(total, 0.0)
    p = measured / np.maximum(measured.sum(-1, keepdims=True), tiny)
    q = model / np.maximum(model.sum(-1, keepdims=True), tiny)
    terms = np.where(p > 0.0, p * np.log(np.maximum(p, tiny) / np.maximum(q, tiny)), 0.0)
    nats: NDArray[np.float64] = terms.sum(-1)
    return nats


def select_lobes(
    profiles: Sequence[SliceProfile],
    *,
    criterion: str = "williams",
    max_lobes: int = MAX_TRIED_LOBES,
    alpha: float = ALPHA,
    held_out: Sequence[SliceProfile] | None = None,
) -> LobeSelection:
    """Choose the number of lobes from fits with 1 to `max_lobes`, each grown from the one before.

    Parameters
    ----------
    profiles : sequence of SliceProfile
    criterion : {"williams", "bic", "held-out"}, optional
        With fewer than six slices that hold light, "williams" gives way to "bic".
    max_lobes : int, optional
    alpha : float, optional
        Level of Williams' test.
    held_out : sequence of SliceProfile, optional
        For `criterion="held-out"`: the same slices over other phi_d (`MeasuredBRDF.every_other_phi_d`).

    Returns
    -------
    LobeSelection

    Raises
    ------
    ValueError
        If an option is out of range, or held-out slices are missing.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> paper.select_lobes(paper.slice_profiles(dsbrdf.material("matte"), n_slices=3), max_lobes=2).n_lobes
    1
    """
    if criterion not in CRITERIA:
        raise ValueError(f"'criterion' must be one of {', '.join(map(repr, CRITERIA))}, got {criterion!r}.")
    if max_lobes < 1:
        raise ValueError(f"'max_lobes' must be at least 1, got {max_lobes}.")
    _, theta_h, moments = stack_profiles(profiles)
    fits = _core.grow(moments, half_diff.log_cos(theta_h), max_lobes)
    if criterion == "williams" and (moments[..., 2].sum((1, 2)) > 0.0).sum() < MIN_BLOCKS:
        criterion = "bic"
    if criterion == "williams":
        return _by_williams([divergence(profiles, *fit) for fit in fits], moments, alpha)
    if criterion == "bic":
        values = np.array([_bic(profiles, *fit) for fit in fits])
    else:
        if held_out is None:
            raise ValueError("criterion='held-out' needs the slices that were held out.")
        values = np.array([metrics.fit_errors(held_out, *fit, np.zeros_like(fit[0])).rel_rms for fit in fits])
    nothing = np.full(max_lobes, np.nan)
    return LobeSelection(int(values.argmin()) + 1, criterion, values, nothing, nothing)


def _by_williams(
    divergences: Sequence[NDArray[np.float64]], moments: NDArray[np.float64], alpha: float
) -> LobeSelection:
    """Williams' test in blocks: slices are the blocks, lobes taken away the dose (decision record 0008)."""
    some = moments[..., 2].sum(-1) > 0.0
    log_loss = np.log(np.stack(divergences, axis=-1) + 0.5 * NOISE**2)
    weight = some[..., None].astype(float)
    blocks = weight.sum(1)[:, 0] > 0.0
    loss = ((log_loss * weight).sum(1) / np.maximum(weight.sum(1), 1.0))[blocks]
    max_lobes = loss.shape[1]
    values = loss.mean(0)
    statistic, critical = np.full(max_lobes, np.nan), np.full(max_lobes, np.nan)
    if max_lobes == 1 or len(loss) < MIN_BLOCKS:
        return LobeSelection(max_lobes, "williams", values, statistic, critical)
    # Control first: all lobes; then one, two, ... lobes fewer
    table = loss[:, ::-1]
    test = williams.from_blocks(
        table,
        alpha=alpha,
        effective_blocks=INDEPENDENT_SHARE * len(table),
        least_variance=LEAST_CHANGE**2,
    )
    statistic[:-1] = test.statistic[::-1]
    critical[:-1] = test.critical_value[::-1]
    lowest = test.minimum_effective_dose
    removed = max_lobes - 1 if lowest is None else lowest
    return LobeSelection(max_lobes - removed, "williams", values, statistic, critical)


def _bic(profiles: Sequence[SliceProfile], kappa: NDArray[np.float64], gamma: NDArray[np.float64]) -> float:
    """Bayesian information criterion of least squares on the means over phi_d, summed over slices and channels."""
    theta_d, theta_h, moments = stack_profiles(profiles)
    count = moments[..., 0]
    mean = np.divide(moments[..., 1], count, out=np.zeros_like(count), where=count > 0.0)
    a, _ = metrics.profile_model(theta_h, theta_d, kappa, gamma, np.zeros_like(kappa))
    squares = (count * (a - mean) ** 2).sum(-1)
    energy = (count * mean**2).sum(-1)
    n = (count > 0.0).sum(-1)
    some = energy > 0.0
    # A misfit below rounding error is none
    ratio = np.maximum(squares[some] / energy[some], 1e-24)
    return float((n[some] * np.log(ratio) + 2 * kappa.shape[-1] * np.log(n[some])).sum())
