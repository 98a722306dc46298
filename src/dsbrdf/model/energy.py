"""Models that reflect no more light than they receive; see `DSBRDF.conserve_energy`.

Nothing in the model bounds its directional albedo. What exceeds 1 is lowered slice by slice: theta_d is the same for
exchanged directions, so reciprocity stays, and light is taken only where there is too much. The albedo is linear in
the factors of the slices; of those that keep every albedo at most 1, the ones nearest to 1 are taken (least squares,
slices weighted by their light).

A lobe has no amplitude to scale. Its kappa is set so that the peak has the factor, and its gamma so that the integral
over half vectors has it too. The shape gives a little, so factors are found again until the albedo is within bounds.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import directions, half_diff
from dsbrdf.model import hemi_epd

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["ALBEDO_TOLERANCE", "conserve_energy", "warning"]

Array = NDArray[np.float64]

#: How far an albedo may be above 1: the error of its quadrature.
ALBEDO_TOLERANCE = 1e-3
#: Incident angles at which an excess is looked for, in radians.
ANGLES = np.deg2rad([0.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0, 87.0, 89.0])
#: The same for a quick look, the azimuths of its quadrature, and what is too much for its error.
QUICK_ANGLES = tuple(np.deg2rad([0.0, 45.0, 75.0]))
QUICK_N_PHI = 8
QUICK_LIMIT = 1.01
#: Models named in a warning.
MAX_NAMED = 5
MAX_ROUNDS = 20
#: Azimuths of the quadrature that finds factors.
N_PHI = 32
#: Least factor of a round.
MIN_FACTOR = 1e-3
#: Halvings of an interval of gamma.
N_HALVINGS = 50


def warning(models: Iterable[DSBRDF]) -> str:
    """A sentence on the models with an albedo above 1, empty if there are none; a quick look, 1 ms a model."""
    albedos = [(model.name, max(_rough_albedo(model, theta) for theta in QUICK_ANGLES)) for model in models]
    bright = [f"{name or 'model'} ({albedo:.2f})" for name, albedo in albedos if albedo > QUICK_LIMIT]
    if not bright:
        return ""
    more = f" and {len(bright) - MAX_NAMED} more" if len(bright) > MAX_NAMED else ""
    return (
        f"warning: reflects more light than it receives: {', '.join(bright[:MAX_NAMED])}{more}. "
        "'dsbrdf check' tells where, model.conserve_energy() lowers it."
    )


def _rough_albedo(model: DSBRDF, theta_i: float) -> float:
    wi, wo, weight = directions.albedo_nodes(theta_i, QUICK_N_PHI)
    return float((model.eval(wi, wo) * weight[:, None]).sum(0).max())


def conserve_energy(model: DSBRDF) -> DSBRDF:
    """See `DSBRDF.conserve_energy`."""
    # Narrow lobes see little but the slices on either side: an excess can lie between them
    n = len(model.theta_d)
    dense = np.interp(np.arange(8 * n - 7) / 8.0, np.arange(n), model.theta_d)
    theta_i = np.unique(np.concatenate([ANGLES, dense[dense <= ANGLES[-1]]]))
    for _ in range(MAX_ROUNDS):
        light = _light_of_slices(model, theta_i)
        if light.sum(1).max() <= 1.0 + 0.5 * ALBEDO_TOLERANCE:
            return model
        factors = [_factors(of_channel) for of_channel in np.moveaxis(light, -1, 0)]
        model = _scale(model, np.stack(factors, axis=1))
    raise RuntimeError(
        f"the albedo of {model.name or 'the model'} is still {light.sum(1).max():.3f} after {MAX_ROUNDS} rounds. "
        "Fit it anew with fewer lobes, or check the scale of the measurement."
    )


def _light_of_slices(model: DSBRDF, theta_i: Array) -> Array:
    """Albedo (theta_i, theta_d, channel) that each slice adds."""
    n = len(model.theta_d)
    even = np.arange(n) % 2 == 0
    # Of two neighbouring slices one is even: where it alone is left, a value is its share
    tiny, spike = np.finfo(float).tiny, np.asarray(model.spike)
    halves = [
        model.replace(kappa=np.where(kept[:, None, None], model.kappa, tiny), spike=spike * kept[:, None])
        for kept in (even, ~even)
    ]
    light = np.zeros((len(theta_i), n, model.n_channels))
    for at, theta in enumerate(theta_i):
        wi, wo, weight = directions.albedo_nodes(float(theta), N_PHI)
        _, theta_d, _ = half_diff.from_directions(wi, wo)
        below = np.clip(np.searchsorted(model.theta_d, theta_d, side="right") - 1, 0, max(n - 2, 0))
        above = np.minimum(below + 1, n - 1)
        for parity, half in enumerate(halves):
            values = half.eval(wi, wo) * weight[:, None]
            slices = np.where(below % 2 == parity, below, above)
            for channel in range(model.n_channels):
                light[at, :, channel] += np.bincount(slices, values[:, channel], n)
    return light


def _factors(light: Array) -> Array:
    """Factors (theta_d,) in (0, 1] of slices of this light (theta_i, theta_d) that keep its sums at most 1."""
    from scipy.optimize import minimize

    start = np.full(light.shape[1], 1.0 / max(float(light.sum(1).max()), 1.0))
    if (start == 1.0).all():
        return start
    weight = light.sum(0) / light.sum()
    result = minimize(
        lambda factor: (weight @ (1.0 - factor) ** 2, 2.0 * weight * (factor - 1.0)),
        start,
        jac=True,
        bounds=[(MIN_FACTOR, 1.0)] * start.size,
        constraints={"type": "ineq", "fun": lambda factor: 1.0 - light @ factor, "jac": lambda _: -light},
        method="SLSQP",
    )
    # The same factor for all slices will do, if nothing better is found
    return np.where(result.success, result.x, start)


def _scale(model: DSBRDF, factors: Array) -> DSBRDF:
    """Peaks of lobes, their integrals over half vectors, and spikes times `factors` (theta_d, channel)."""
    kappa, gamma = np.asarray(model.kappa), np.asarray(model.gamma)
    lowered = np.log1p(factors[..., None] * np.expm1(kappa))
    wanted = hemi_epd.log_normaliser(kappa, gamma) - np.log(factors[..., None])
    # What is asked for is narrower than a lobe of the lowered kappa and the same gamma, but not kappa times
    low, high = gamma, (2.0 + kappa) * gamma
    for _ in range(N_HALVINGS):
        middle = 0.5 * (low + high)
        wide = hemi_epd.log_normaliser(lowered, middle) < wanted
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    spike = factors * np.asarray(model.spike)
    return model.replace(kappa=lowered, gamma=0.5 * (low + high), spike=spike, errors={})
