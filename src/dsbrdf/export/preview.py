"""What all exports of the nearest material have in common: how far it is, in numbers and to the eye."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.baselines.engine import EngineMaterial, Form, Reflectance, cbrt_error, fit_engine
from dsbrdf.export.colour import in_colour
from dsbrdf.geometry.colour_difference import ciede2000, lab
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["Nearness", "fit_preview", "nearness", "sphere"]

Array = NDArray[np.float64]

#: Pixels across the sphere.
SIZE = 40
#: Lights from afar: direction (x to the right, y up, z to the viewer) and irradiance; and the sky, even, of so many.
LIGHTS = (((-0.5, 0.6, 0.7), 2.0), ((0.8, 0.2, 0.5), 0.8), ((0.3, 0.7, -0.6), 1.5))
N_SKY, SKY = 64, 0.3
#: Mean luminance of the picture of the model.
MEAN = 0.18


@dataclass(frozen=True)
class Nearness:
    """How far the nearest material is from the model.

    Parameters
    ----------
    error_cbrt : float
        Relative RMS of the cube root of `f cos_i cos_o` over directions below 80 degrees.
    ciede2000 : float
        Mean colour difference of a sphere under three lamps and a sky.
    """

    error_cbrt: float
    ciede2000: float

    def sentence(self, what: str) -> str:
        """What is lost, for people."""
        return (
            f"{what} is the nearest of its kind: error of the cube root of f cos cos {100.0 * self.error_cbrt:.1f} %, "
            f"CIEDE2000 of a sphere {self.ciede2000:.1f}."
        )

    def numbers(self) -> dict[str, float]:
        """What is stored in files."""
        return {"error_cbrt": round(self.error_cbrt, 4), "ciede2000": round(self.ciede2000, 2)}


def fit_preview(model: DSBRDF, form: Form) -> tuple[EngineMaterial, Nearness]:
    """The nearest material of a form, and how far it is.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    """
    coloured = in_colour(model)
    material = fit_engine(coloured, form, model.name)
    return material, nearness(material, coloured)


def nearness(material: Reflectance, reflectance: Reflectance) -> Nearness:
    """How far a material is from a reflectance."""
    wanted, found = sphere(reflectance), sphere(material)
    exposure = MEAN / max(float((wanted @ [0.2126, 0.7152, 0.0722]).mean()), 1e-300)
    colours = [lab(np.clip(exposure * image, 0.0, 1.0)) for image in (wanted, found)]
    return Nearness(cbrt_error(material, reflectance), float(ciede2000(*colours).mean()))


def sphere(reflectance: Reflectance) -> Array:
    """Radiance (pixel, 3) of a sphere, seen from afar; pixels on the sphere alone."""
    wi, wo, weight = _views()
    values: Any = np.asarray(reflectance.eval(wi, wo[:, None]))
    return np.asarray((values * weight[..., None]).sum(1))


@lru_cache(maxsize=1)
def _views() -> tuple[Array, Array, Array]:
    """Directions toward lights (pixel, light, 3) and viewer (pixel, 3) in each pixel's frame, and `cos E`."""
    at = (np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0
    x, y = (part.ravel() for part in np.meshgrid(at, -at))
    on = x * x + y * y < 0.98
    normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)[on]
    # A frame with the viewer (0, 0, 1) in its xz plane
    wo = np.stack([np.hypot(normal[:, 0], normal[:, 1]), np.zeros(len(normal)), normal[:, 2]], axis=-1)
    x_axis = np.array([0.0, 0.0, 1.0]) - normal[:, 2:] * normal
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    y_axis = np.cross(normal, x_axis)
    lamps = np.array([direction for direction, _ in LIGHTS])
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    # Even over the sphere of directions
    z = 1.0 - (2.0 * np.arange(N_SKY) + 1.0) / N_SKY
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(N_SKY)
    s = np.sqrt(1.0 - z * z)
    toward = np.concatenate([lamps, np.stack([s * np.cos(angle), s * np.sin(angle), z], axis=-1)])
    irradiance = np.array([e for _, e in LIGHTS] + [SKY * 4.0 * np.pi / N_SKY] * N_SKY)
    wi = np.stack([toward @ axis.T for axis in (x_axis, y_axis, normal)], axis=-1).transpose(1, 0, 2)
    return wi, wo, np.maximum(wi[..., 2], 0.0) * irradiance
