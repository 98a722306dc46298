"""The nearest material of the kinds that all programs have: Disney's principled one, and that of glTF 2.0.

Neither can hold a model. They are for a first look, with the error told: a base colour and one GGX lobe (Burley,
*Physically Based Shading at Disney*, SIGGRAPH 2012 course notes; glTF 2.0 specification, Appendix B).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf._check import require_rgb
from dsbrdf.geometry import half_diff
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["gltf", "principled", "write_gltf", "write_principled"]

Array = NDArray[np.float64]
#: Reflectance (pair, channel) of parameters for unit vectors (pair, 3).
Material = Callable[[Array, Array, Array], Array]

#: Reflectance of a dielectric at normal incidence that glTF assumes.
DIELECTRIC = 0.04
#: Least alpha of a GGX lobe in Mitsuba.
MIN_ALPHA = 1e-3
#: Least specular: at 0 Mitsuba leaves out all reflection, that of a metal too.
MIN_SPECULAR = 0.01
#: Parameters from the fourth on that fits start from: metallic, roughness, and specular of 'principled'.
STARTS = ((0.1, 0.2, 0.5), (0.1, 0.6, 0.5), (0.9, 0.2, 0.5), (0.9, 0.6, 0.5))


def write_principled(model: DSBRDF, path: str | Path) -> str:
    """Write the nearest `principled` plugin of Mitsuba 3 as JSON, a dictionary for `mitsuba.load_dict`.

    Returns
    -------
    str
        What is lost.

    Raises
    ------
    ValueError
        If the model has not three channels.
    OSError
        If the file cannot be written.
    """
    parameters, loss = _fit(model, principled, 6, "a principled material")
    *colour, metallic, roughness, specular = parameters.tolist()
    content = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": colour},
        "metallic": metallic,
        "roughness": roughness,
        "specular": specular,
    }
    _write(content, path)
    return loss


def write_gltf(model: DSBRDF, path: str | Path) -> str:
    """Write the nearest metallic-roughness material as a glTF 2.0 asset that holds nothing else.

    Returns
    -------
    str
        What is lost.

    Raises
    ------
    ValueError
        If the model has not three channels.
    OSError
        If the file cannot be written.
    """
    parameters, loss = _fit(model, gltf, 5, "a glTF material")
    *colour, metallic, roughness = parameters.tolist()
    material = {
        "name": model.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*colour, 1.0],
            "metallicFactor": metallic,
            "roughnessFactor": roughness,
        },
    }
    _write({"asset": {"version": "2.0", "generator": "dsbrdf"}, "materials": [material]}, path)
    return loss


def _write(content: dict[str, Any], path: str | Path) -> None:
    with _files.aside(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _fit(model: DSBRDF, material: Material, size: int, what: str) -> tuple[Array, str]:
    """Best parameters, each in [0, 1], and a sentence on what is lost.

    Least squares of the cube root of `f cos cos`, which is nearer to what the eye makes of it than the value is
    (Fores et al., *Toward a perceptually based metric for BRDF modeling*, CIC 2012).
    """
    from scipy.optimize import least_squares

    require_rgb(model.n_channels, what)
    wi, wo = _pairs()
    cosines = wi[:, 2:] * wo[:, 2:]
    wanted = model.eval(wi, wo) * cosines

    def residual(x: Array) -> Array:
        off: Array = np.cbrt(material(x, wi, wo) * cosines) - np.cbrt(wanted)
        return off.ravel()

    colour = np.clip(model.albedo(0.5), 0.01, 0.99)
    low = np.array([0.0, 0.0, 0.0, 0.0, 0.0, MIN_SPECULAR])[:size]
    starts = (np.array([*colour, *start])[:size] for start in STARTS)
    fits = [least_squares(residual, start, bounds=(low, 1.0)) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    got = material(best.x, wi, wo) * cosines
    squares = float(((got - wanted) ** 2).sum() / max(float((wanted**2).sum()), 1e-300))
    root = np.sqrt(2.0 * best.cost / max(float(np.cbrt(wanted**2).sum()), 1e-300))
    return best.x, (
        f"{what} is a preview: relative RMS of f cos cos {100.0 * np.sqrt(squares):.0f} %, "
        f"of its cube root {100.0 * root:.0f} %."
    )


def _pairs() -> tuple[Array, Array]:
    """Directions above the horizon on a grid of the angles of a MERL table, peaks well covered."""
    theta_h = np.pi / 2 * ((np.arange(32) + 0.5) / 32)[:, None, None] ** 2
    theta_d = np.deg2rad(np.arange(2.5, 85.0, 7.5))[:, None]
    wi, wo = half_diff.to_directions(theta_h, theta_d, np.deg2rad([0.0, 45.0, 90.0, 135.0]))
    above = (wi[..., 2] > 0.02) & (wo[..., 2] > 0.02)
    return wi[above], wo[above]


def principled(x: Array, wi: Array, wo: Array) -> Array:
    """Mitsuba's `principled` of base colour (3), metallic, roughness and specular; all else off."""
    base, metallic, roughness, specular = x[:3], x[3], x[4], x[5]
    cos_i, cos_o, cos_d, lobe = _ggx(wi, wo, max(float(roughness) ** 2, MIN_ALPHA))
    eta = 2.0 / (1.0 - np.sqrt(0.08 * specular)) - 1.0
    of_metal = metallic * _schlick(base, cos_d)
    coat = (1.0 - metallic) * _fresnel(cos_d, eta) + of_metal
    weight_i, weight_o = (1.0 - cos_i) ** 5, (1.0 - cos_o) ** 5
    retro = 2.0 * roughness * cos_d**2
    diffuse = (1.0 - 0.5 * weight_i) * (1.0 - 0.5 * weight_o)
    diffuse = diffuse + retro * (weight_o + weight_i + weight_o * weight_i * (retro - 1.0))
    value: Array = coat * lobe + (1.0 - metallic) * base / np.pi * diffuse
    return value


def gltf(x: Array, wi: Array, wo: Array) -> Array:
    """Metallic-roughness material of glTF 2.0 of base colour (3), metallic and roughness."""
    base, metallic, roughness = x[:3], x[3], x[4]
    _, _, cos_d, lobe = _ggx(wi, wo, max(float(roughness) ** 2, MIN_ALPHA))
    dielectric = _schlick(DIELECTRIC, cos_d)
    coated = (1.0 - dielectric) * base / np.pi + dielectric * lobe
    value: Array = (1.0 - metallic) * coated + metallic * _schlick(base, cos_d) * lobe
    return value


def _schlick(at_normal: Array | float, cos_d: Array) -> Array:
    value: Array = at_normal + (1.0 - at_normal) * (1.0 - cos_d) ** 5
    return value


def _fresnel(cosine: Array, eta: float) -> Array:
    """Unpolarised reflectance of a dielectric."""
    transmitted = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    parallel = (eta * cosine - transmitted) / (eta * cosine + transmitted)
    across = (cosine - eta * transmitted) / (cosine + eta * transmitted)
    value: Array = 0.5 * (parallel**2 + across**2)
    return value


def _ggx(wi: Array, wo: Array, alpha: float) -> tuple[Array, Array, Array, Array]:
    """Cosines (pair, 1) of the directions to the normal and to the half vector, and a GGX lobe without Fresnel."""
    half = wi + wo
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    cos_d = (wi * half).sum(-1, keepdims=True)
    cos_h2 = half[:, 2:] ** 2
    distribution = alpha**2 / (np.pi * (1.0 + (alpha**2 - 1.0) * cos_h2) ** 2)
    cos_i, cos_o = wi[:, 2:], wo[:, 2:]
    masking = np.ones_like(cos_i)
    for cosine in (cos_i, cos_o):
        masking = masking / (cosine + np.sqrt(alpha**2 + (1.0 - alpha**2) * cosine**2))
    return cos_i, cos_o, cos_d, distribution * masking
