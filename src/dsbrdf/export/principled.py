"""Mitsuba 3's `principled` plugin: Disney's material (Burley, SIGGRAPH 2012 course notes), as a dictionary or XML.

Its highlight is white, or of a metal's base colour, and rises to one at grazing; the coat is weak. Mitsuba renders the
model itself as `rgl`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.baselines.engine import Pairs, nearest, pairs
from dsbrdf.export import text
from dsbrdf.export.colour import in_colour
from dsbrdf.export.preview import Nearness, nearness
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["NAMES", "Principled", "fit_principled", "write_principled"]

Array = NDArray[np.float64]

#: Parameters beside the base colour.
NAMES = ("metallic", "roughness", "specular", "clearcoat", "clearcoat_gloss")
#: Least roughness, and least specular: at 0 Mitsuba leaves out all reflection, that of a metal too.
LOW, HIGH = np.array([0.0, 0.0, 0.0, 0.0, 0.03, 0.01, 0.0, 0.0]), np.ones(8)
#: What searches start from, of these parameters.
STARTS = (
    (0.1, 0.2, 0.5, 0.1, 0.5),
    (0.1, 0.6, 0.5, 0.5, 0.8),
    (0.9, 0.2, 0.5, 0.1, 0.5),
    (0.9, 0.6, 0.5, 0.5, 0.8),
)
#: Alpha of the coat's shadowing, and its range by gloss.
COAT_MASKING, COAT_ALPHA = 0.25, (0.1, 0.001)


class Principled:
    """The plugin's values.

    Parameters
    ----------
    x : (8,) ndarray
        Base colour and `NAMES`.
    """

    def __init__(self, x: Array) -> None:
        self.x = x

    def eval(self, wi: Any, wo: Any) -> Array:
        """Values (..., 3) in 1/sr without the cosine; zero below the horizon."""
        wi, wo = np.broadcast_arrays(wi, wo)
        values = np.zeros(wi.shape)
        above = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
        values[above] = principled(self.x, Pairs.of(wi[above], wo[above]))
        return values


def principled(x: Array, at: Pairs) -> Array:
    """Values (pair, 3) of parameters (8,)."""
    base, (metallic, roughness, specular, coat, gloss) = x[:3], x[3:]
    cos_i, cos_o, cos_d = (part[:, None] for part in (at.cos_i, at.cos_o, at.cos_d))
    rising = (1.0 - cos_d) ** 5
    eta = 2.0 / (1.0 - np.sqrt(0.08 * specular)) - 1.0
    layer = (1.0 - metallic) * _fresnel(cos_d, eta) + metallic * (base + (1.0 - base) * rising)

    weight_i, weight_o = (1.0 - cos_i) ** 5, (1.0 - cos_o) ** 5
    retro = 2.0 * roughness * cos_d**2
    diffuse = (1.0 - 0.5 * weight_i) * (1.0 - 0.5 * weight_o)
    diffuse = diffuse + retro * (weight_o + weight_i + weight_o * weight_i * (retro - 1.0))

    alpha2 = max(float(roughness) ** 2, 1e-3) ** 2
    lobe = alpha2 / (np.pi * (alpha2 * at.cos2 + at.sin2) ** 2) * _masking(at, alpha2)

    coat_alpha2 = (COAT_ALPHA[0] + gloss * (COAT_ALPHA[1] - COAT_ALPHA[0])) ** 2
    clear = (coat_alpha2 - 1.0) / (np.pi * np.log(coat_alpha2) * (coat_alpha2 * at.cos2 + at.sin2))
    # The coat's lobe lacks the division by four cosines
    clear = clear * _masking(at, COAT_MASKING**2) * 4.0 * at.cos_i * at.cos_o
    value: Array = (
        layer * lobe[:, None]
        + (1.0 - metallic) * base / np.pi * diffuse
        + 0.25 * coat * (0.04 + 0.96 * rising) * clear[:, None]
    )
    return value


def _masking(at: Pairs, alpha2: float) -> Array:
    """`G / (4 cos_i cos_o)` of GGX, the product of one for each direction (pair,)."""
    value = np.ones_like(at.cos_i)
    for cos in (at.cos_i, at.cos_o):
        value = value / (cos + np.sqrt(alpha2 + (1.0 - alpha2) * cos * cos))
    return value


def _fresnel(cosine: Array, eta: float) -> Array:
    """Unpolarised reflectance of a dielectric."""
    transmitted = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    parallel = (eta * cosine - transmitted) / (eta * cosine + transmitted)
    across = (cosine - eta * transmitted) / (cosine + eta * transmitted)
    value: Array = 0.5 * (parallel**2 + across**2)
    return value


def fit_principled(model: DSBRDF) -> tuple[dict[str, Any], Nearness]:
    """The nearest plugin, a dictionary for `mitsuba.load_dict`, and how far it is.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    """
    coloured = in_colour(model)
    at, _ = pairs()
    colour = np.clip(np.pi * np.median(np.asarray(coloured.eval(at.wi, at.wo)), axis=0), 0.01, 0.99)
    starts = [np.array([*colour, *start]) for start in STARTS]
    x, _ = nearest(principled, coloured, starts, LOW, HIGH)
    rounded = [round(float(value), 5) for value in x]
    parameters = dict(zip(NAMES, rounded[3:], strict=True))
    content = {"type": "principled", "base_color": {"type": "rgb", "value": rounded[:3]}, **parameters}
    return content, nearness(Principled(x), coloured)


def write_principled(model: DSBRDF, path: str | Path) -> str:
    """Write the nearest plugin: a scene file with one bsdf where the name ends in `.xml`, else a dictionary in JSON.

    Returns
    -------
    str
        What is lost.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.
    """
    content, near = fit_principled(model)
    numbers = ", ".join(f"{key} {value}" for key, value in near.numbers().items())
    name = text.identifier(model.name)
    if Path(path).suffix.lower() == ".xml":
        colour = ", ".join(map(str, content["base_color"]["value"]))
        written = [
            '<scene version="3.0.0">',
            f"    <!-- dsbrdf: {numbers} -->",
            f'    <bsdf type="principled" id="{name}">',
            f'        <rgb name="base_color" value="{colour}" />',
            *(f'        <float name="{name}" value="{content[name]}" />' for name in NAMES),
            "    </bsdf>",
            "</scene>",
        ]
        whole = "\n".join(written)
    else:
        # All that Mitsuba takes beside its parameters is an id
        whole = json.dumps({"id": f"{name}, dsbrdf: {numbers}", **content}, indent=1)
    with _files.aside(path) as part:
        part.write_text(whole + "\n", encoding="utf-8")
    return near.sentence("the principled material")
