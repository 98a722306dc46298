"""Built-in materials by name, for use without a measured file: `names` lists them, `material` tabulates one.

Each is a closed-form reflectance with its parameters bound. They are models of a kind of surface, not
measurements of one; the refractive indices of the metals are measured.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.measured.reflectance import coated, ggx, oren_nayar
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF, tabulate

__all__ = ["Material", "get", "material", "names"]


@dataclass(frozen=True)
class Material:
    """A built-in material.

    Attributes
    ----------
    name : str
        Lowercase, with hyphens.
    description : str
        What it looks like and which reflectance it is.
    reflectance : callable
        ``reflectance(wi, wo)`` of unit vectors (..., 3) is linear RGB (..., 3) in 1/sr without the cosine.
        A `functools.partial`, whose `keywords` are the parameters.
    source : str
        Where the model or its numbers come from.
    """

    name: str
    description: str
    reflectance: Callable[[ArrayLike, ArrayLike], NDArray[np.float64]]
    source: str


# Complex refractive indices n + ik at 611, 549 and 464 nm, the dominant wavelengths of the linear sRGB
# primaries, interpolated linearly between the tabulated wavelengths.
GOLD = (0.223 + 3.204j, 0.428 + 2.460j, 1.335 + 1.872j)
COPPER = (0.367 + 3.121j, 1.016 + 2.579j, 1.246 + 2.452j)
ALUMINIUM = (1.320 + 7.307j, 1.011 + 6.616j, 0.683 + 5.623j)
CHROMIUM = (3.179 + 3.300j, 3.180 + 3.330j, 2.447 + 3.205j)

_NOBLE = "n, k: Johnson and Christy, Phys. Rev. B 6, 4370 (1972)"
_TRANSITION = "n, k: Johnson and Christy, Phys. Rev. B 9, 5056 (1974)"
_RAKIC = "n, k: Rakic, Appl. Opt. 34, 4755 (1995)"
_GGX = "lobe: Walter et al., EGSR 2007; masking: Heitz, JCGT 3(2), 2014"
_COAT = f"{_GGX}; coat over base: Saunderson, J. Opt. Soc. Am. 32, 727 (1942); parameters chosen"
_OREN_NAYAR = "Oren and Nayar, SIGGRAPH 1994; parameters chosen"

_CATALOGUE = (
    Material(
        "rough-gold",
        "Sand-blasted gold: GGX of alpha 0.3.",
        partial(ggx, alpha=0.3, fresnel=GOLD),
        f"{_NOBLE}; {_GGX}",
    ),
    Material(
        "rough-copper",
        "Etched copper: GGX of alpha 0.2.",
        partial(ggx, alpha=0.2, fresnel=COPPER),
        f"{_NOBLE}; {_GGX}",
    ),
    Material(
        "satin-aluminium",
        "Aluminium with an isotropic satin finish: GGX of alpha 0.12.",
        partial(ggx, alpha=0.12, fresnel=ALUMINIUM),
        f"{_RAKIC}; {_GGX}",
    ),
    Material(
        "polished-chrome",
        "Chromium, nearly a mirror: GGX of alpha 0.03.",
        partial(ggx, alpha=0.03, fresnel=CHROMIUM),
        f"{_TRANSITION}; {_GGX}",
    ),
    Material(
        "glossy-plastic",
        "Glossy red plastic: GGX of alpha 0.06 over a Lambertian base.",
        partial(coated, albedo=(0.70, 0.07, 0.05), eta=1.5, alpha=0.06),
        _COAT,
    ),
    Material(
        "satin-plastic",
        "Satin blue plastic: GGX of alpha 0.22 over a Lambertian base.",
        partial(coated, albedo=(0.06, 0.16, 0.62), eta=1.5, alpha=0.22),
        _COAT,
    ),
    Material(
        "matte",
        "Unglazed clay: Oren-Nayar of sigma 0.5 rad, no specular lobe.",
        partial(oren_nayar, albedo=(0.60, 0.34, 0.22), sigma=0.15),
        _OREN_NAYAR,
    ),
    Material(
        "paint-two-lobe",
        "Green lacquer: GGX lobes of alpha 0.05 and 0.3 (shares 0.35 and 0.65) over a Lambertian base.",
        partial(coated, albedo=(0.08, 0.45, 0.16), eta=1.5, alpha=(0.05, 0.3), weights=(0.35, 0.65)),
        _COAT,
    ),
    Material(
        "grey-primer",
        "Grey primer: a very rough coat (GGX of alpha 0.5) over an Oren-Nayar base of sigma 0.35 rad.",
        partial(coated, albedo=(0.46, 0.47, 0.48), eta=1.45, alpha=0.5, sigma=0.35),
        f"{_COAT}; base: {_OREN_NAYAR}",
    ),
)
_BY_NAME = {material.name: material for material in _CATALOGUE}


def names() -> tuple[str, ...]:
    """Names of the built-in materials, metals first."""
    return tuple(_BY_NAME)


def get(name: str) -> Material:
    """Built-in material called `name`.

    Raises
    ------
    ValueError
        If there is none of that name; lists the names, and suggests the closest.

    Examples
    --------
    >>> get("rough-gold").reflectance([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]).round(2)
    array([0.82, 0.7 , 0.36])
    """
    _check.instance(name, str, "name")
    if name in _BY_NAME:
        return _BY_NAME[name]
    close = difflib.get_close_matches(name, names(), n=1, cutoff=0.5)
    hint = f" Did you mean {close[0]!r}?" if close else ""
    raise ValueError(
        f"unknown built-in material {name!r}: the built-in materials are {', '.join(names())}.{hint}"
    )


def material(name: str, *, convention: str = "centre") -> MeasuredBRDF:
    """Tabulate a built-in material on the grid of a MERL file.

    Parameters
    ----------
    name : str
        One of `names()`.
    convention : {"centre", "edge"}, optional
        Which point of a cell a value belongs to.

    Returns
    -------
    MeasuredBRDF

    Raises
    ------
    ValueError
        If there is no such material; names those there are.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.material("rough-gold").values.shape
    (90, 90, 180, 3)
    """
    entry = get(name)
    source = Source(description=f"built-in material: {entry.description} {entry.source}")
    return tabulate(entry.reflectance, entry.name, convention=convention, source=source)
