"""`check_model`: whether a renderer can trust a model.

Reciprocity, values, energy, and the sampler: that it follows its density, and saves samples over cosine-weighted
directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.model import chi_square
from dsbrdf.model.energy import ALBEDO_ANGLES, ALBEDO_TOLERANCE

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["CheckReport", "check_model"]

Array = NDArray[np.float64]

#: Incident angles at which the sampler is tried, in radians.
SAMPLER_ANGLES = np.deg2rad([0.0, 30.0, 60.0, 80.0])
N_PAIRS = 20_000
#: Of the mass of a cell; far below what so many samples can tell.
QUADRATURE_TOLERANCE = 1e-4
N_SAMPLES = 20_000
#: Probability that a right sampler is found wrong at any of the angles.
SIGNIFICANCE = 1e-3
#: How much noisier than cosine-weighted directions a sampler may be: nothing is to be saved on what is Lambertian.
WORSE = 0.03


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What `check_model` found.

    Attributes
    ----------
    name : str
    reciprocity : float
        Largest difference of the values for `wi`, `wo` and for `wo`, `wi`, relative to the larger.
    minimum : float, 1/sr
        Least value found; NaN if one is not a finite number.
    theta_i : (theta_i,) ndarray, radians
    albedo : (theta_i, channel) ndarray
        Share of light that is reflected; more than 1 is impossible.
    theta_o : (theta_o,) ndarray, radians
    p_value : (theta_o,) ndarray
        Of the chi-square test of the samples against their density.
    weight_std, cosine_std : (theta_o,) ndarray
        Standard deviation of the weight of a sample relative to its mean, channels averaged: of the sampler, and of
        cosine-weighted directions.
    problems : tuple of str
        A sentence for each thing that is wrong.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.check_model(dsbrdf.library.load("nickel"))
    CheckReport('nickel', albedo up to 0.236, ok)
    """

    name: str
    reciprocity: float
    minimum: float
    theta_i: Array
    albedo: Array
    theta_o: Array
    p_value: Array
    weight_std: Array
    cosine_std: Array
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems

    def __repr__(self) -> str:
        found = "ok" if self.ok else "; ".join(self.problems)
        return f"CheckReport({self.name!r}, albedo up to {self.albedo.max():.3f}, {found})"

    def summary(self) -> dict[str, Any]:
        """Everything, ready for JSON; angles in radians."""
        arrays = ("theta_i", "albedo", "theta_o", "p_value", "weight_std", "cosine_std")
        return {
            "name": self.name,
            "ok": self.ok,
            "problems": list(self.problems),
            "reciprocity": self.reciprocity,
            "minimum": self.minimum,
            **{key: getattr(self, key).tolist() for key in arrays},
        }


def check_model(model: DSBRDF, rng: np.random.Generator | None = None) -> CheckReport:
    """Check reciprocity, values, energy and sampling of a model; in about a second.

    Parameters
    ----------
    model : DSBRDF
    rng : numpy.random.Generator, optional
        The same numbers every time by default.

    Returns
    -------
    CheckReport
        Its `problems` are empty if all is well.

    Examples
    --------
    >>> import dsbrdf
    >>> report = dsbrdf.check_model(dsbrdf.library.load("nickel"))
    >>> report.ok, report.reciprocity
    (True, 0.0)
    """
    from dsbrdf.model.dsbrdf import DSBRDF

    _check.instance(model, DSBRDF, "model")
    rng = np.random.default_rng(0) if rng is None else rng
    wi, wo = _directions(rng, N_PAIRS), _directions(rng, N_PAIRS)
    values, swapped = model.eval(wi, wo), model.eval(wo, wi)
    size = np.maximum(np.abs(values), np.abs(swapped))
    apart = np.divide(np.abs(values - swapped), size, out=np.zeros_like(size), where=size > 0.0)
    sampler = np.array([_try_sampler(model, theta, rng) for theta in SAMPLER_ANGLES]).T
    report = CheckReport(
        name=model.name,
        reciprocity=float(apart.max()),
        minimum=float(values.min()),
        theta_i=ALBEDO_ANGLES,
        albedo=model.albedo(ALBEDO_ANGLES),
        theta_o=SAMPLER_ANGLES,
        p_value=sampler[0],
        weight_std=sampler[1],
        cosine_std=sampler[2],
        problems=(),
    )
    object.__setattr__(report, "problems", tuple(_problems(report)))
    return report


def _directions(rng: np.random.Generator, n: int) -> Array:
    return chi_square.direction(rng.random(n), 2.0 * np.pi * rng.random(n))


def _try_sampler(model: DSBRDF, theta: float, rng: np.random.Generator) -> tuple[float, float, float]:
    """p-value of samples for one direction, and the two standard deviations."""
    wo, mirror = (np.array([sign * np.sin(theta), 0.0, np.cos(theta)]) for sign in (1.0, -1.0))
    samples = model.sample(np.broadcast_to(wo, (N_SAMPLES, 3)), rng)
    mass = chi_square.cell_integrals(lambda wi: model.pdf(wi, wo), mirror, QUADRATURE_TOLERANCE)
    p_value = chi_square.p_value(samples, mass)

    # Second moments of both estimators from the same samples: those of the sampler are where the light is
    wi = samples[samples[:, 2] > 0.0]
    light = model.eval(wi, wo).mean(-1) * wi[:, 2]
    pdf, cosine_pdf = model.pdf(wi, wo), wi[:, 2] / np.pi
    mean = (light / pdf).sum() / N_SAMPLES
    if mean**2 == 0.0:
        return p_value, 0.0, 0.0
    spread = [
        np.sqrt(max((light**2 / (pdf * other)).sum() / (N_SAMPLES * mean**2) - 1.0, 0.0))
        for other in (pdf, cosine_pdf)
    ]
    return p_value, *spread


def _problems(report: CheckReport) -> list[str]:
    found = []
    if report.reciprocity > 0.0:
        found.append(
            f"not reciprocal: values for exchanged directions differ by up to {report.reciprocity:.1e} of their size."
        )
    if not report.minimum >= 0.0:
        found.append(f"values must be finite and >= 0, got {report.minimum:g}/sr.")
    if not report.albedo.max() <= 1.0 + ALBEDO_TOLERANCE:
        at, channel = np.unravel_index(np.argmax(report.albedo), report.albedo.shape)
        found.append(
            f"reflects more light than it receives: albedo {report.albedo[at, channel]:.3f} at "
            f"{np.rad2deg(report.theta_i[at]):.0f} degrees, channel {channel}. model.conserve_energy() lowers it."
        )
    limit = chi_square.sidak(SIGNIFICANCE, report.p_value.size)
    for theta, p_value in zip(report.theta_o, report.p_value, strict=True):
        if not p_value > limit:
            found.append(
                f"samples do not follow their density at {np.rad2deg(theta):.0f} degrees: p-value {p_value:.1e}."
            )
    for theta, ours, cosine in zip(report.theta_o, report.weight_std, report.cosine_std, strict=True):
        if not ours <= cosine + WORSE:
            found.append(
                f"the sampler is worse than cosine-weighted directions at {np.rad2deg(theta):.0f} degrees: weights "
                f"have a standard deviation of {ours:.2f} of their mean, against {cosine:.2f}."
            )
    return found
