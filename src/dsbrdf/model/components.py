"""What the lobes of a model are: their share of the light, colour, width, and a name for each (Section 6.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model import hemi_epd
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper import spike

__all__ = ["Component", "Roughness", "components", "half_width", "roughness"]

#: Half widths, radians, above which a lobe is a body, below which it is specular, below which it is a spike.
BODY_WIDTH = float(np.deg2rad(25.0))
SPECULAR_WIDTH = float(np.deg2rad(6.0))
SPIKE_WIDTH = float(np.deg2rad(1.5))
#: Incident angle, radians, of the second share.
OBLIQUE = float(np.deg2rad(45.0))
#: Added to gamma before its logarithm: shapes below a tenth look alike.
GAMMA_OFFSET = 0.1
#: Dimmest lobe there can be, where only the spike is wanted.
NO_LOBE = 1e-300


@dataclass(frozen=True, eq=False)
class Component:
    """One lobe of a model, or its spike.

    Parameters
    ----------
    lobe : int or None
        Number of the lobe; None for the spike.
    share, share_oblique : float
        Part of the model's albedo, mean over channels, at normal incidence and at 45 degrees.
    colour : (channel,) ndarray
        Albedo at normal incidence (at 45 degrees if there is none), linear, its largest channel 1.
    half_width : float, radians
        theta_h at which the lobe falls to half its height at theta_d = 0; mean over channels, weighted by albedo.
    label : {"spike", "specular", "glossy", "body"}
    reason : str
        Why it is called that, a sentence.
    """

    lobe: int | None
    share: float
    share_oblique: float
    colour: NDArray[np.float64]
    half_width: float
    label: str
    reason: str


@dataclass(frozen=True)
class Roughness:
    """Mean squared second difference from slice to slice of the curves of a model.

    Parameters
    ----------
    kappa : float
        Of ln(kappa).
    gamma : float
        Of ln(gamma + 0.1).
    """

    kappa: float
    gamma: float


def components(model: DSBRDF) -> list[Component]:
    """What the lobes of a model are, and its spike if it has one.

    The label follows from the half width w at half height, at theta_d = 0:

    - spike: w < 1.5 degrees, narrower than a measurement or a light resolves; the delta term always;
    - specular: 1.5 <= w < 6 degrees, shows images of lamps and windows;
    - glossy: 6 <= w <= 25 degrees, a highlight without an image;
    - body: w > 25 degrees, no highlight that an eye would find.

    Parameters
    ----------
    model : DSBRDF

    Returns
    -------
    list of Component
        In the order of the lobes; the spike last.
    """
    angles = np.array([0.0, OBLIQUE])
    numbers: list[int | None] = list(range(model.n_lobes))
    albedos = [np.asarray(model.lobe(k).albedo(angles)) for k in range(model.n_lobes)]
    if np.asarray(model.spike).any():
        numbers.append(None)
        albedos.append(np.asarray(_spike_alone(model).albedo(angles)))
    total = np.maximum(np.sum(albedos, axis=(0, 2)), np.finfo(float).tiny)
    found = []
    for number, albedo in zip(numbers, albedos, strict=True):
        share, share_oblique = (float(x) for x in albedo.sum(1) / total)
        seen = albedo[0] if albedo[0].any() else albedo[1]
        width = _spike_width() if number is None else _width(model, number, seen)
        colour = seen / max(float(seen.max()), np.finfo(float).tiny)
        label, reason = _label(width, is_delta=number is None)
        found.append(Component(number, share, share_oblique, colour, width, label, reason))
    return found


def half_width(kappa: NDArray[np.float64], gamma: NDArray[np.float64]) -> NDArray[np.float64]:
    """theta_h in radians at which `expm1(kappa cos(theta_h)^gamma)` is half its height; pi/2 for gamma 0."""
    kappa, gamma = np.asarray(kappa, dtype=float), np.asarray(gamma, dtype=float)
    # ln(1 + expm1(kappa) / 2) without overflow
    half_height = np.where(
        kappa > 1.0,
        kappa + np.log1p(0.5 * np.expm1(-np.maximum(kappa, 1.0))),
        np.log1p(0.5 * np.expm1(np.minimum(kappa, 1.0))),
    )
    fall = -np.log(half_height / kappa)
    with np.errstate(divide="ignore", over="ignore"):
        # tan(theta_h)^2 is 1 / cos^2 - 1
        angle: NDArray[np.float64] = np.arctan(np.sqrt(np.expm1(2.0 * fall / gamma)))
    return angle


def roughness(model: DSBRDF) -> Roughness:
    """How rough the curves of kappa and gamma over theta_d are; low where lobes correspond between slices.

    Squares of second differences over three neighbouring slices are averaged over slices, channels and lobes. The
    weight is the least share of the light (of `expm1(kappa cos^gamma)` over the hemisphere of half vectors) that the
    lobe has in the three, so that lobes that come, go or are absent count for little. NaN with fewer than three slices.

    Parameters
    ----------
    model : DSBRDF

    Returns
    -------
    Roughness
    """
    kappa, gamma = np.asarray(model.kappa, dtype=float), np.asarray(model.gamma, dtype=float)
    if len(kappa) < 3:
        return Roughness(float("nan"), float("nan"))
    log_energy = -hemi_epd.log_normaliser(kappa, gamma)
    energy = np.exp(log_energy - log_energy.max(-1, keepdims=True))
    share = energy / energy.sum(-1, keepdims=True)
    weight = np.minimum(np.minimum(share[:-2], share[1:-1]), share[2:])
    curves = (np.log(kappa), np.log(gamma + GAMMA_OFFSET))
    return Roughness(*(float(np.average(np.diff(curve, 2, axis=0) ** 2, weights=weight)) for curve in curves))


def _spike_alone(model: DSBRDF) -> DSBRDF:
    """The model with its spike and a lobe that is as good as none."""
    lobe = model.lobe(0)
    shape = np.shape(lobe.kappa)
    return lobe.replace(
        kappa=np.full(shape, NO_LOBE),
        gamma=np.zeros(shape),
        beta=np.zeros(shape),
        spike=np.asarray(model.spike, dtype=float),
    )


def _spike_width() -> float:
    return float(np.arcsin(np.sqrt(0.5 * spike.SIN2_WIDTH)))


def _width(model: DSBRDF, k: int, weight: NDArray[np.float64]) -> float:
    # Nearest to theta_d = 0 is the first slice
    widths = half_width(np.asarray(model.kappa)[0, :, k], np.asarray(model.gamma)[0, :, k])
    return float(np.average(widths, weights=weight if weight.any() else None))


def _label(width: float, *, is_delta: bool) -> tuple[str, str]:
    if is_delta:
        return "spike", "It is the delta term, which lives within a degree of the mirror direction."
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
