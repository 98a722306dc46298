"""The material that rendering programs share: a diffuse base under a GGX lobe, and a clear coat over both.

glTF, OpenPBR, Blender's Principled BSDF and USD's preview surface all have it; they differ in what light the layers
leave to what lies below (`Form.coupling`) and in what a Fresnel factor may be at grazing (`Form.grazing`). `fit_engine`
finds the nearest material within a form, so that what a program shows is what was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.fitting.observations import cell_area
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.colour import LUMINANCE

__all__ = [
    "COAT_F0",
    "FREE_F0",
    "EngineMaterial",
    "Form",
    "Pairs",
    "cbrt_error",
    "fit_engine",
    "ggx",
    "nearest",
    "pairs",
]

Array = NDArray[np.float64]

#: Reflectance at normal incidence of a coat with a refractive index of 1.5.
COAT_F0 = 0.04
#: Range of that of a layer whose index is free: 1.2 to 3.
FREE_F0 = (0.008, 0.25)
#: Range of roughness, the square root of GGX's alpha.
ROUGHNESS = (0.03, 1.0)
#: F0, roughness of the base, weight and roughness of the coat that searches start from.
STARTS = ((0.04, 0.2, 0.2, 0.6), (0.04, 0.6, 0.5, 0.2), (0.6, 0.3, 0.2, 0.6), (0.5, 0.15, 0.2, 0.5))
#: A metal may be so much worse before it is called one, as a factor and in the cube root's error.
METAL_FACTOR, METAL_MARGIN = 1.05, 0.001
MAX_EVALUATIONS, TOLERANCE = 60, 1e-5
#: Weight of the colour of the highlight, at this theta_h.
HUE_WEIGHT, HIGHLIGHT = 0.1, float(np.deg2rad(0.5))
#: Grid over (theta_h, theta_d, phi_d) on which materials are fitted, and the least cosine to the normal.
GRID, LEAST_COSINE = (32, 10, 3), 0.05
#: The same for errors that are told.
FINE_GRID, FINE_LEAST_COSINE = (90, 45, 12), float(np.cos(np.deg2rad(80.0)))


class Reflectance(Protocol):
    """Anything with `eval`."""

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., channel) at pairs of directions."""


@dataclass(frozen=True)
class Form:
    """How a program joins layers.

    Parameters
    ----------
    coupling : {"facet", "normal", "albedo"}
        What a layer leaves to the one below: one minus the Fresnel factor of the facet (of the base) or of the
        normal (of the coat); one minus that of the normal, which is also the factor of the lobes; or one minus the
        layer's directional albedo.
    grazing : {"free", "tint", "one"}
        What the Fresnel factor of the base rises to: a number of its own below one; a colour, of which F0 is a share
        of 0.25 at most; one.
    coat_f0 : (float, float), optional
        Range of the coat's reflectance at normal incidence.
    """

    coupling: Literal["facet", "normal", "albedo"]
    grazing: Literal["free", "tint", "one"]
    coat_f0: tuple[float, float] = (COAT_F0, COAT_F0)


@dataclass(frozen=True, eq=False)
class EngineMaterial:
    """A diffuse base under a GGX lobe, and a clear coat.

    Parameters
    ----------
    base_color : (3,) ndarray in [0, 1]
        Albedo of the diffuse base; zero of a metal.
    f0, f90 : (3,) ndarray in [0, 1]
        Reflectance of the facets of the base at normal incidence and at grazing.
    roughness : float in [0, 1]
        Square root of the width alpha.
    coat : float in [0, 1]
        Share of the surface under the coat.
    coat_f0 : float
        Reflectance of the coat's facets at normal incidence; 1 at grazing.
    coat_roughness : float in [0, 1]
    metal : bool
        No diffuse base, and F90 = 1.
    form : Form
    name : str, optional

    Notes
    -----
    `A_coat (A (base_color / pi) + F D G / (4 cos_i cos_o)) + coat F_coat D G / (4 cos_i cos_o)`, D and G as in
    `dsbrdf.measured.reflectance.ggx`, F by Schlick (Computer Graphics Forum 13(3), 1994), and A what the layers
    above leave (see `Form`). Reflectances in [0, 1] keep the energy. A depends on the direction toward the viewer
    alone, as in the programs: such a material is not reciprocal.
    """

    base_color: Array
    f0: Array
    f90: Array
    roughness: float
    coat: float
    coat_f0: float
    coat_roughness: float
    metal: bool
    form: Form
    name: str = ""

    @property
    def n_parameters(self) -> int:
        """Numbers that describe the material."""
        fixed = self.form.coat_f0[0] == self.form.coat_f0[1]
        return (3 if self.metal else 6 + (self.form.grazing == "free")) + 3 + (not fixed)

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Values (..., 3) in 1/sr without the cosine, of unit vectors (..., 3); zero below the horizon.

        Raises
        ------
        ValueError
            If a direction is not a unit vector.
        """
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        values = np.zeros(wi.shape)
        above = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
        values[above] = self._values(Pairs.of(wi[above], wo[above]))
        return values

    def _values(self, at: Pairs) -> Array:
        at_view = ((1.0 - at.cos_o) ** 5)[:, None]
        grazing = at_view if self.form.coupling == "normal" else ((1.0 - at.cos_d) ** 5)[:, None]
        fresnel = self.f0 + (self.f90 - self.f0) * grazing
        alpha, coat_alpha = self.roughness**2, self.coat_roughness**2
        of_coat = self.coat_f0 + (1.0 - self.coat_f0) * grazing
        if self.form.coupling != "albedo":
            left = 1.0 - fresnel.max(-1, keepdims=True)
            under = self.coat_f0 + (1.0 - self.coat_f0) * at_view
        else:
            at_normal, rising = directional_albedo(at.cos_o, alpha)
            left = 1.0 - (self.f0 * at_normal + self.f90 * rising).max(-1, keepdims=True)
            at_normal, rising = directional_albedo(at.cos_o, coat_alpha)
            under = self.coat_f0 * at_normal + rising
        base = left * (self.base_color / np.pi) + fresnel * ggx(at, alpha)[:, None]
        values: Array = (1.0 - self.coat * under) * base + self.coat * of_coat * ggx(at, coat_alpha)[:, None]
        return values


@dataclass(frozen=True, eq=False)
class Pairs:
    """What reflectances need of pairs of directions, all (pair,).

    Parameters
    ----------
    wi, wo : (pair, 3) ndarray
    cos_i, cos_o, cos_d : (pair,) ndarray
        Cosines of the angles to the normal, and of theta_d.
    sin2, cos2 : (pair,) ndarray
        Of theta_h, squared.
    """

    wi: Array
    wo: Array
    cos_i: Array
    cos_o: Array
    cos_d: Array
    sin2: Array
    cos2: Array

    @classmethod
    def of(cls, wi: Array, wo: Array) -> Pairs:
        """Of unit vectors (pair, 3)."""
        s = wi + wo
        across, along = s[:, 0] ** 2 + s[:, 1] ** 2, s[:, 2] ** 2
        both = np.maximum(across + along, 1e-300)
        cos_d = np.minimum(0.5 * np.sqrt(both), 1.0)
        return cls(wi, wo, wi[:, 2], wo[:, 2], cos_d, across / both, along / both)


def ggx(at: Pairs, alpha: float) -> Array:
    """`D G / (4 cos_i cos_o)` (pair,) of a GGX lobe: `dsbrdf.measured.reflectance.ggx` without its checks."""
    alpha2 = alpha * alpha
    facets = alpha2 / (np.pi * (alpha2 * at.cos2 + at.sin2) ** 2)
    s_i, s_o = (np.sqrt(alpha2 + (1.0 - alpha2) * cos * cos) for cos in (at.cos_i, at.cos_o))
    values: Array = 0.5 * facets / (at.cos_i * s_o + at.cos_o * s_i)
    return values


def directional_albedo(cos_o: Array, alpha: float) -> tuple[Array, Array]:
    """Albedos (n, 1) of a GGX lobe whose Fresnel factor is `1 - (1 - cos(theta_d))^5`, and this power alone.

    Of any F0 and F90 the albedo is the first times F0 and the second times F90.
    """
    cosines, alphas, table = _albedos()
    place = np.interp(np.sqrt(alpha), alphas, np.arange(len(alphas)))
    low = min(int(place), len(alphas) - 2)
    row = table[low] + (place - low) * (table[low + 1] - table[low])
    first, second = (np.interp(cos_o, cosines, part)[:, None] for part in row)
    return first, second


@lru_cache(maxsize=1)
def _albedos() -> tuple[Array, Array, Array]:
    """Cosines, square roots of alpha, and the two albedos (alpha, part, cosine).

    The mean of F G2 / G1 over normals that are seen, of which a square of numbers is mapped to each (Heitz, "Sampling
    the GGX distribution of visible normals", JCGT 7(4), 2018).
    """
    cosines, roots = np.linspace(0.0, 1.0, 33), np.linspace(0.0, 1.0, 25)
    cosines[0] = 1e-3
    u = (np.arange(24) + 0.5) / 24
    radius, phi = np.sqrt(u)[:, None], 2.0 * np.pi * u
    table = np.zeros((len(roots), 2, len(cosines)))
    for i, root in enumerate(roots):
        alpha = max(root, 0.02) ** 2
        cos = cosines[:, None, None]
        stretched = np.stack([alpha * np.sqrt(1.0 - cosines**2), cosines], axis=-1)
        stretched /= np.linalg.norm(stretched, axis=-1, keepdims=True)
        sin_v, cos_v = (part[:, None, None] for part in stretched.T)
        x, y = radius * np.cos(phi), radius * np.sin(phi)
        y = 0.5 * ((1.0 - cos_v) * np.sqrt(1.0 - x * x) + (1.0 + cos_v) * y)
        up = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
        # The frame of the stretched view: v, one across, one level
        normal_x, normal_y, normal_z = alpha * (up * sin_v - y * cos_v), alpha * x, up * cos_v + y * sin_v
        norm = np.sqrt(normal_x**2 + normal_y**2 + normal_z**2)
        normal_x, normal_z = normal_x / norm, np.maximum(normal_z, 0.0) / norm
        cos_d = np.clip(normal_x * np.sqrt(1.0 - cos * cos) + normal_z * cos, 0.0, 1.0)
        cos_out = 2.0 * cos_d * normal_z - cos
        lit = np.maximum(cos_out, 1e-6)
        s_v, s_l = (np.sqrt(alpha**2 + (1.0 - alpha**2) * c * c) for c in (cos, lit))
        seen = np.where(cos_out > 0.0, lit * (cos + s_v) / (cos * s_l + lit * s_v), 0.0)
        rising = (1.0 - cos_d) ** 5
        table[i] = [((1.0 - rising) * seen).mean((1, 2)), (rising * seen).mean((1, 2))]
    return cosines, roots, table


@lru_cache(maxsize=2)
def pairs(grid: tuple[int, int, int] = GRID, least_cosine: float = LEAST_COSINE) -> tuple[Pairs, Array]:
    """Pairs of directions on a grid of half and difference angles, and their weights (pair,) by solid angle."""
    n_h, n_d, n_phi = grid
    theta_h = 0.5 * np.pi * ((np.arange(n_h) + 0.5) / n_h) ** 2
    theta_d = 0.5 * np.pi * (np.arange(n_d) + 0.5) / n_d
    wi, wo = half_diff.to_directions(
        theta_h[:, None, None], theta_d[:, None], np.pi * (np.arange(n_phi) + 0.5) / n_phi
    )
    above = (wi[..., 2] > least_cosine) & (wo[..., 2] > least_cosine)
    area = np.broadcast_to(cell_area(theta_h, theta_d).T[..., None], above.shape)[above]
    return Pairs.of(wi[above], wo[above]), area


@lru_cache(maxsize=1)
def _highlight() -> Pairs:
    """Pairs in the highlight."""
    theta_d = np.deg2rad([10.0, 25.0, 40.0, 55.0])
    return Pairs.of(*half_diff.to_directions(HIGHLIGHT, theta_d, 0.5 * np.pi))


def _hue(values: Array) -> Array:
    """Colours (pair, 3) relative to their luminance."""
    luminance = (values @ LUMINANCE)[:, None]
    return np.asarray(values / np.maximum(luminance, 1e-12))


def cbrt_error(material: Reflectance, reflectance: Reflectance) -> float:
    """Relative RMS of the cube root of `f cos_i cos_o` over all pairs of directions below 80 degrees."""
    at, area = pairs(FINE_GRID, FINE_LEAST_COSINE)
    cosines = (at.cos_i * at.cos_o)[:, None]
    found, wanted = (
        np.cbrt(np.maximum(np.asarray(f.eval(at.wi, at.wo)), 0.0) * cosines) for f in (material, reflectance)
    )
    squares, energy = (float((area[:, None] * x**2).sum()) for x in (found - wanted, wanted))
    return float(np.sqrt(squares / energy)) if energy > 0.0 else 0.0


def fit_engine(reflectance: Reflectance, form: Form, name: str = "") -> EngineMaterial:
    """Fit the material of a form.

    Parameters
    ----------
    reflectance : anything with `eval(wi, wo)`
        Three channels of linear sRGB.
    form : Form
    name : str, optional

    Returns
    -------
    EngineMaterial

    Notes
    -----
    `cbrt_error` is what is minimised, from several starts. Then a metal is tried, which has no diffuse base and three
    numbers less; it is taken where it is as good.
    """
    at, _ = pairs()
    # What is seen far from the highlight, and in it
    side = np.median(np.asarray(reflectance.eval(at.wi, at.wo)), axis=0)
    peak = np.asarray(reflectance.eval(*half_diff.to_directions(1e-3, 0.3, 0.5 * np.pi)))
    albedo, tint = np.clip(np.pi * side, 2e-3, 0.9), np.clip(peak / max(float(peak.max()), 1e-300), 0.05, 1.0)
    low_coat, high_coat = form.coat_f0
    middle = float(np.clip(COAT_F0, low_coat, high_coat))
    free_coat = high_coat > low_coat

    def material(x: Array, metal: bool = False) -> EngineMaterial:
        if metal:
            base, f0, f90, rest = np.zeros(3), x[:3], np.ones(3), x[3:]
        elif form.grazing == "tint":
            base, f0, f90, rest = x[:3], x[3:6] * x[6], x[3:6], x[7:]
        elif form.grazing == "free":
            base, f0, f90, rest = x[:3], x[3:6] * x[6], np.full(3, x[6]), x[7:]
        else:
            base, f0, f90, rest = x[:3], x[3:6], np.ones(3), x[6:]
        coat_f0 = float(rest[3]) if free_coat else low_coat
        roughness, coat, coat_roughness = map(float, rest[:3])
        return EngineMaterial(base, f0, f90, roughness, coat, coat_f0, coat_roughness, metal, form, name)

    def search(starts: Sequence[Array], metal: bool) -> tuple[EngineMaterial, float]:
        n = len(starts[0]) - free_coat
        low, high = np.zeros(n), np.ones(n)
        low[[n - 3, n - 1]] = ROUGHNESS[0]
        if form.grazing == "tint" and not metal:
            high[6] = FREE_F0[1]
        if free_coat:
            low, high = np.append(low, low_coat), np.append(high, high_coat)
        x, error = nearest(lambda x, at: material(x, metal)._values(at), reflectance, starts, low, high)
        return material(x, metal), error

    def tail(roughness: float, coat: float, coat_roughness: float) -> list[float]:
        return [roughness, coat, coat_roughness, *([middle] if free_coat else [])]

    starts = []
    for f0, *rest in STARTS:
        f0_start = np.full(3, f0) if f0 < 0.1 else np.maximum(f0 * tint, 0.02)
        if form.grazing == "tint":
            f0_start = np.append(np.full(3, 0.9) if f0 < 0.1 else np.maximum(tint, 0.05), f0)
        elif form.grazing == "free":
            f0_start = np.append(f0_start, 0.9)
        starts.append(np.array([*albedo, *f0_start, *tail(*rest)]))
    best = search(starts, metal=False)
    metals = [np.array([*np.maximum(f0 * tint, 0.02), *tail(*rest)]) for f0, *rest in STARTS if f0 > 0.1]
    metals.append(np.array([*np.clip(best[0].f0, 0.02, 0.98), *tail(best[0].roughness, 0.1, 0.5)]))
    as_metal = search(metals, metal=True)
    return as_metal[0] if as_metal[1] <= METAL_FACTOR * best[1] + METAL_MARGIN else best[0]


def nearest(
    values: Callable[[Array, Pairs], Array],
    reflectance: Reflectance,
    starts: Sequence[Array],
    low: Array,
    high: Array,
) -> tuple[Array, float]:
    """Parameters within bounds at which `values`, of parameters and pairs, are nearest to a reflectance, and the error.

    Squares of differences of the cube root of `f cos_i cos_o`, which is nearer to what the eye makes of it than the
    value is (Fores et al., "Toward a perceptually based metric for BRDF modeling", CIC 2012), weighted by solid angle;
    and of the colour of the highlight, which covers little of that.
    """
    from scipy.optimize import least_squares

    at, area = pairs()
    glint = _highlight()
    hue = _hue(np.asarray(reflectance.eval(glint.wi, glint.wo)))
    cosines = (at.cos_i * at.cos_o)[:, None]
    wanted = np.cbrt(np.maximum(np.asarray(reflectance.eval(at.wi, at.wo)), 0.0) * cosines)
    weight = np.sqrt(area)[:, None]
    weight = weight / (float(np.sqrt(((weight * wanted) ** 2).sum())) or 1.0)

    def residual(x: Array) -> Array:
        off = weight * (np.cbrt(values(x, at) * cosines) - wanted)
        off_hue = HUE_WEIGHT * (_hue(values(x, glint)) - hue)
        return np.concatenate([off.ravel(), off_hue.ravel()])

    results = [
        least_squares(
            residual,
            np.clip(start, low + 1e-4 * (high - low), high - 1e-4 * (high - low)),
            bounds=(low, high),
            x_scale=0.1 * (high - low),
            ftol=TOLERANCE,
            xtol=1e-4 * TOLERANCE**0.5,
            max_nfev=MAX_EVALUATIONS,
        )
        for start in starts
    ]
    best: Any = min(results, key=lambda result: float(result.cost))
    return np.asarray(best.x), float(np.sqrt(2.0 * best.cost))
