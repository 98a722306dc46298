"""The light that a model reflects, and models that reflect no more than they receive.

Nothing in the model bounds its directional albedo. What exceeds 1 is lowered by functions of theta_d, one a channel:
theta_d is the same for exchanged directions, so reciprocity stays. Such a function is a curve that is taken from
`ln(kappa)` of all lobes; it is raised where the albedo is too high until nothing exceeds 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import directions
from dsbrdf.model.lobes import curve_design

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["ALBEDO_ANGLES", "ALBEDO_TOLERANCE", "albedo", "conserve_energy", "warning"]

Array = NDArray[np.float64]

#: How far an albedo may be above 1: the error of its quadrature.
ALBEDO_TOLERANCE = 1e-3
#: Incident angles at which an excess is looked for, in radians.
ANGLES = np.deg2rad(np.linspace(0.0, 89.0, 31))
#: Incident angles at which the albedo is told, and warned of, in radians.
ALBEDO_ANGLES = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0, 89.0])
#: Azimuths of a quick look, and from where on a model is looked at closely.
QUICK_N_PHI = 8
QUICK_LIMIT = 0.9
#: Models named in a warning.
MAX_NAMED = 5
MAX_ROUNDS = 60
#: Azimuths of the quadrature that finds how much to take.
N_PHI = 32
#: Coefficients of the curves that are taken from `ln(kappa)`, at least.
N_COEFFICIENTS = 8


def albedo(model: DSBRDF, theta_i: ArrayLike, n_phi: int = 128) -> Array:
    """Directional albedo (..., channel) by quadrature over the half vector; see `DSBRDF.albedo`."""
    theta_i = _check.angle(theta_i, "theta_i")
    result = np.zeros((*theta_i.shape, model.n_channels))
    for position, theta in np.ndenumerate(theta_i):
        wi, wo, weight = directions.albedo_nodes(float(theta), n_phi)
        result[position] = weight @ np.asarray(model.eval(wi, wo))
    return result


def warning(models: Iterable[DSBRDF]) -> str:
    """A sentence on the models with an albedo above 1, as `check_model` finds it, empty if there are none."""
    bright = []
    for model in models:
        # Some milliseconds a model; only of those near 1 the albedo itself
        if albedo(model, ALBEDO_ANGLES, QUICK_N_PHI).max() < QUICK_LIMIT:
            continue
        if (most := float(albedo(model, ALBEDO_ANGLES).max())) > 1.0 + ALBEDO_TOLERANCE:
            bright.append(f"{model.name or 'model'} ({most:.3g})")
    if not bright:
        return ""
    more = f" and {len(bright) - MAX_NAMED} more" if len(bright) > MAX_NAMED else ""
    return (
        f"warning: reflects more light than it receives: {', '.join(bright[:MAX_NAMED])}{more}. "
        "'dsbrdf check' tells where, model.conserve_energy() lowers it."
    )


def conserve_energy(model: DSBRDF) -> DSBRDF:
    """See `DSBRDF.conserve_energy`."""
    light = albedo(model, ANGLES, N_PHI)
    if light.max() <= 1.0 + 0.5 * ALBEDO_TOLERANCE:
        return model
    lobes = model.lobes.numpy
    size = max(N_COEFFICIENTS, lobes.colour.shape[2], lobes.scale.shape[1])
    colour = _refined(lobes.colour, size)
    # Which coefficients the light of an angle asks to be lowered: most of it has a theta_d below its own angle
    reach = curve_design(np.cos(ANGLES), size)
    for i in range(MAX_ROUNDS):
        excess = np.maximum(np.log(np.maximum(light, 1e-300) / (1.0 - 0.2 * ALBEDO_TOLERANCE)), 0.0)
        # Where the light of an angle comes from elsewhere, the whole channel is lowered in the end
        from_where = reach[..., None] if i < MAX_ROUNDS // 2 else np.ones((1, size, 1))
        taken = (from_where * excess[:, None]).max(0)
        colour = colour - 1.1 * taken.T[:, None, :]
        lowered = model.replace(lobes=lobes.replace(colour=colour), errors={})
        light = albedo(lowered, ANGLES, N_PHI)
        if light.max() <= 1.0 + 0.5 * ALBEDO_TOLERANCE:
            return lowered
    raise RuntimeError(
        f"the albedo of {model.name or 'the model'} is still {light.max():.3f} after {MAX_ROUNDS} rounds. "
        "Fit it anew with fewer lobes, or check the scale of the measurement."
    )


def _refined(coefficients: Array, size: int) -> Array:
    """Curves (..., coefficient) as ones of `size` coefficients: the nearest; constants, lines and parabolas exactly."""
    if coefficients.shape[-1] == size:
        return coefficients
    x = np.linspace(0.0, 1.0, 8 * size + 1)
    values = coefficients @ curve_design(x, coefficients.shape[-1]).T
    refined = np.linalg.lstsq(curve_design(x, size), values.reshape(-1, len(x)).T)[0].T
    return np.asarray(refined, dtype=np.float64).reshape(*coefficients.shape[:-1], size)
