"""What the lobes of a model are: their share of the light, colour, width, and a name for each (Section 6.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["Component", "components", "half_width"]

#: Half widths, radians, above which a lobe is a body, below which it is specular, below which it is a spike.
BODY_WIDTH = float(np.deg2rad(25.0))
SPECULAR_WIDTH = float(np.deg2rad(6.0))
SPIKE_WIDTH = float(np.deg2rad(1.5))
#: Incident angle, radians, of the second share.
OBLIQUE = float(np.deg2rad(45.0))
N_HALVINGS = 80


@dataclass(frozen=True, eq=False)
class Component:
    """One lobe of a model.

    Parameters
    ----------
    lobe : int
        Number of the lobe.
    share, share_oblique : float
        Part of the model's albedo, mean over channels, at normal incidence and at 45 degrees.
    colour : (channel,) ndarray
        Albedo at normal incidence (at 45 degrees if there is none), linear, its largest channel 1.
    half_width : float, radians
        theta_h at which the lobe falls to half its height at theta_d = 0; mean over channels,
        weighted by albedo, as a higher lobe of the same gamma is narrower.
    label : {"spike", "specular", "glossy", "body"}
    reason : str
        Why it is called that, a sentence.
    """

    lobe: int
    share: float
    share_oblique: float
    colour: NDArray[np.float64]
    half_width: float
    label: str
    reason: str


def components(model: DSBRDF) -> list[Component]:
    """What the lobes of a model are.

    The label follows from the half width w at half height, at theta_d = 0:

    - spike: w < 1.5 degrees, narrower than a measurement or a light resolves;
    - specular: 1.5 <= w < 6 degrees, shows images of lamps and windows;
    - glossy: 6 <= w <= 25 degrees, a highlight without an image;
    - body: w > 25 degrees, no highlight that an eye would find.

    Parameters
    ----------
    model : DSBRDF

    Returns
    -------
    list of Component
        In the order of the lobes.
    """
    angles = np.array([0.0, OBLIQUE])
    albedos = [np.asarray(model.lobe(k).albedo(angles)) for k in range(model.n_lobes)]
    total = np.maximum(np.sum(albedos, axis=(0, 2)), np.finfo(float).tiny)
    at_zero = model.lobes.at([0.0])
    found = []
    for number, albedo in enumerate(albedos):
        share, share_oblique = (float(x) for x in albedo.sum(1) / total)
        seen = albedo[0] if albedo[0].any() else albedo[1]
        widths = half_width(at_zero.kappa[0, :, number], at_zero.gamma[0, number], at_zero.falloff[0, number])
        width = float(np.average(widths, weights=seen if seen.any() else None))
        colour = seen / max(float(seen.max()), np.finfo(float).tiny)
        label, reason = _label(width)
        found.append(Component(number, share, share_oblique, colour, width, label, reason))
    return found


def half_width(kappa: ArrayLike, gamma: ArrayLike, falloff: ArrayLike = 0.0) -> NDArray[np.float64]:
    """theta_h in radians at which a lobe is half its height; pi/2 where it never is.

    Parameters
    ----------
    kappa, gamma, falloff : (...) array_like
        Of `expm1(kappa cos(theta_h)^gamma) cos(theta_h)^falloff`; they broadcast.

    Returns
    -------
    (...) ndarray
    """
    kappa, gamma, falloff = np.broadcast_arrays(
        *(np.asarray(x, dtype=float) for x in (kappa, gamma, falloff))
    )
    # In y = -ln cos(theta_h), found by halving: the logarithm of the lobe falls from its height, or rises above it
    ln_height = _ln_expm1(kappa)
    low, high = np.zeros(kappa.shape), np.full(kappa.shape, 40.0)
    for _ in range(N_HALVINGS):
        # Geometric, as widths span decades
        middle = np.where(low > 0.0, np.sqrt(low * high), high * 1e-3)
        above = _ln_expm1(kappa * np.exp(-gamma * middle)) - falloff * middle > ln_height - np.log(2.0)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    angle: NDArray[np.float64] = np.arctan(np.sqrt(np.expm1(2.0 * np.minimum(high, 300.0))))
    return np.where(high >= 39.0, np.pi / 2, angle)


def _ln_expm1(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """`ln(expm1(x))` without overflow."""
    small = np.minimum(x, 1.0)
    ln: NDArray[np.float64] = np.where(
        x > 1.0, x + np.log1p(-np.exp(-np.maximum(x, 1.0))), np.log(np.maximum(np.expm1(small), 1e-300))
    )
    return ln


def _label(width: float) -> tuple[str, str]:
    degrees, spike_limit, specular, body = (
        np.rad2deg(x) for x in (width, SPIKE_WIDTH, SPECULAR_WIDTH, BODY_WIDTH)
    )
    half = f"It falls to half its height at {degrees:.2g} degrees"
    if width < SPIKE_WIDTH:
        return "spike", f"{half}, below {spike_limit:g}."
    if width < SPECULAR_WIDTH:
        return "specular", f"{half}, from {spike_limit:g} to below {specular:g}."
    if width <= BODY_WIDTH:
        return "glossy", f"{half}, from {specular:g} to {body:g}."
    return "body", f"{half}, beyond {body:g}."
