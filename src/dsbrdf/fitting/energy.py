"""The light that a fit reflects is that of the table it was fitted to.

Least squares of logarithms divide what lobes cannot describe evenly between too bright and too dark, and light is a
sum: without this the albedo of some fits is off by a tenth. Two numbers for all lobes, a factor and its change with
cos(theta_d), are moved until the light from near a few angles is that of the data, as nearly as two numbers can
(decision record 0021). A lobe's `ln kappa` moves so that its peak changes by that factor. Both sides are summed over
the same cells, so that a table of lobes is left as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes, curve_design

__all__ = ["ANGLES", "keep_light", "shares"]

Array = NDArray[np.float64]

#: Incident angles, radians, near which the light is looked at.
ANGLES = np.deg2rad([5.0, 20.0, 40.0, 60.0, 75.0])
#: Pairs with a direction within ten degrees of the horizon are left out: few instruments measure there.
LEAST_COSINE = float(np.cos(np.deg2rad(80.0)))
#: Steps of Newton's method.
STEPS = 3


def shares(cosines: tuple[Array, Array]) -> Array:
    """How much pairs of directions (...) count for the light from near each angle (angle, ...)."""
    seen = np.minimum(*cosines) > LEAST_COSINE
    unit = np.eye(len(ANGLES))
    theta = [np.arccos(np.clip(c, 0.0, 1.0)) for c in cosines]
    near = np.stack([sum(np.interp(t, ANGLES, row) for t in theta) for row in unit])
    found: Array = near * seen * cosines[0] * cosines[1]
    return found


def keep_light(lobes: Lobes, log_cos: Array, x: Array, azimuth: Array, values: Array, light: Array) -> Lobes:
    """Lobes that reflect as much as was measured.

    Parameters
    ----------
    lobes : Lobes
    log_cos, x : (position,) ndarray
        `ln cos(theta_h)` and `cos(theta_d)`.
    azimuth : (position, node) ndarray
        Azimuthal factor times `cos(2 phi_d)`.
    values : (position, node) ndarray
        What was measured, the mean over channels.
    light : (angle, position, node) ndarray
        How much each counts for the light from near each angle.
    """
    size = lobes.scale.shape[1]
    measured = np.tensordot(light, values, 2)
    some = measured > 0.0
    if not some.any():
        return lobes
    line = np.linspace(0.0, 1.0, size) - 0.5
    for _ in range(STEPS):
        reflected, by_scale = _light(lobes, log_cos, x, azimuth, light[some])
        kappa = np.exp(np.minimum(lobes.scale, MAX_LN_KAPPA))
        # d ln(kappa) for a change of a peak's logarithm
        moves = -np.expm1(-kappa) / kappa * np.stack([np.ones(size), line])[: min(2, size), None]
        slopes = np.einsum("alj,mlj->am", by_scale, moves) / reflected[:, None]
        taken = np.linalg.lstsq(slopes, np.log(measured[some] / reflected))[0]
        lobes = lobes.replace(scale=np.minimum(lobes.scale + np.tensordot(taken, moves, 1), MAX_LN_KAPPA))
    return lobes


def _light(lobes: Lobes, log_cos: Array, x: Array, azimuth: Array, light: Array) -> tuple[Array, Array]:
    """Light (angle,), channels averaged, and its derivatives (angle, lobe, coefficient) by the scale."""
    scale, gamma, beta, falloff = (
        curve_design(x, part.shape[1]) @ part.T
        for part in (lobes.scale, lobes.gamma, lobes.beta, lobes.falloff)
    )
    by_scale = curve_design(x, lobes.scale.shape[1])
    colours = curve_design(x, lobes.colour.shape[2])
    reflected = np.zeros(len(light))
    slopes = np.empty((len(light), *lobes.scale.shape))
    for k in range(lobes.n_lobes):
        ln_power = scale[:, k] + np.exp(gamma[:, k]) * log_cos
        power = np.exp(np.clip(ln_power[:, None] + colours @ lobes.colour[:, k].T, -700.0, MAX_LN_KAPPA))
        factor = np.exp(beta[:, k, None] * azimuth + (falloff[:, k] * log_cos)[:, None])
        part = np.einsum("apn,pn->ap", light, factor)
        reflected += part @ np.expm1(power).mean(1)
        slopes[:, k] = (part * (power * np.exp(power)).mean(1)) @ by_scale
    return reflected, slopes
