"""Write a reflectance as a measured material of the RGL database, which stock renderers load.

Mitsuba 3 (its `measured` plugin) and pbrt-v4 read these files, which `dsbrdf.measured.formats.rgl` explains and reads.
Dupuy and Jakob, *An Adaptive Parameterization for Efficient Material Acquisition and Rendering*, ACM Trans. Graph.
37(6), 2018.

Notes
-----
The file holds `f cos(theta_o)` as a table times ``D(h) / (4 sigma(wi))``, the table over a square that half vectors
come to by a density, one an incident angle. Of a measured surface D, sigma and the density are those of its
microfacets; a renderer needs D and sigma only to make the table smooth, and the density only to put nodes where they
are wanted. So here D is the mean of the reflectance over theta_d, and the density is a root of the light that leaves
toward a direction plus an even share of all that is visible, so that the dim tail of a lobe has nodes too. The
luminance, which serves sampling alone, makes up for the density: directions are drawn in proportion to the light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf._check import require_rgb
from dsbrdf.export import spectrum
from dsbrdf.export.colour import in_colour, take_channels, wavelengths
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.colour import LUMINANCE
from dsbrdf.measured.formats.tensor_file import write_tensor_file
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["FORMS", "Reflectance", "write_rgl"]

Array = NDArray[np.float64]

#: What the channels of a file are, and its nodes in theta_i and along a side of the table.
FORMS = {"rgb": (64, 72), "spectral": (48, 52)}
#: Nodes of D and sigma, and of the density over u and v.
N_DISTRIBUTION = 4096
N_SIGMA = 256
N_DENSITY = (128, 32)
#: The density's share of nodes for the light, raised to this power; the others are even over u and v.
LIGHT_SHARE = 0.6
LIGHT_POWER = 0.4
#: The even share ends where this cosine below the horizon is reached.
MARGIN = 0.05
#: Least D, relative to its peak.
FLOOR = 1e-12
#: Directions are drawn as if they had at least this share of the mean light.
LEAST_LIGHT = 0.01
#: theta_d that D is the mean over.
THETA_D = np.deg2rad(np.arange(2.5, 90.0, 5.0))


class Reflectance(Protocol):
    """Anything that has values of pairs of directions, such as a model."""

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., 3) in 1/sr without the cosine, of unit vectors (..., 3); reciprocal."""
        ...


def write_rgl(
    reflectance: Reflectance,
    path: str | Path,
    *,
    form: str = "rgb",
    n_theta_i: int | None = None,
    n_values: int | None = None,
    description: str | None = None,
) -> None:
    """Write an isotropic reflectance as an RGL `.bsdf` file.

    Parameters
    ----------
    reflectance : DSBRDF, or anything with `eval(wi, wo)`
        Three channels of linear sRGB. One channel of a model becomes grey; wavelengths become colours, or stay what
        they are in spectral form.
    path : str or Path
    form : {"rgb", "spectral"}, optional
        "rgb" is for the RGB variants of Mitsuba, "spectral" for its spectral ones and for pbrt-v4: no file serves
        both. The spectra are those of `dsbrdf.export.spectrum`.
    n_theta_i, n_values : int, optional
        Nodes in theta_i and along a side of the table; 64 and 72 in RGB (6 MB), 48 and 52 in spectral form (9 MB).
    description : str, optional
        By default the name of the reflectance, if it has one.

    Raises
    ------
    ValueError
        If the form is unknown, a number of nodes below 2, or the reflectance has not three channels.
    OSError
        If the file cannot be written.

    Notes
    -----
    Mitsuba's values are within 0.3 % of a model's (median) and 5 % (95th percentile) up to 75 degrees, see
    docs/export.md.
    """
    if form not in FORMS:
        raise ValueError(f"'form' must be {' or '.join(map(repr, FORMS))}, got {form!r}.")
    n_theta_i, n_values = n_theta_i or FORMS[form][0], n_values or FORMS[form][1]
    if min(n_theta_i, n_values) < 2:
        raise ValueError(
            f"'n_theta_i' and 'n_values' must be at least 2, got {n_theta_i} and {n_values}. "
            "Leave them out for what has been tried."
        )
    if description is None:
        description = f"{getattr(reflectance, 'name', '') or 'reflectance'}, written by dsbrdf"
    nm = wavelengths(reflectance.channels) if isinstance(reflectance, DSBRDF) and form == "spectral" else None
    if nm is not None and isinstance(reflectance, DSBRDF):
        order = np.argsort(nm)
        nm, reflectance = nm[order], take_channels(reflectance, [reflectance.channels[i] for i in order])
        fields = _fields(reflectance, n_theta_i, n_values, np.full(len(nm), 1.0 / len(nm)))
        fields["wavelengths"], fields["spectra"] = nm.astype(np.float32), fields.pop("rgb")
    else:
        if isinstance(reflectance, DSBRDF):
            reflectance = in_colour(reflectance)
        fields = _fields(reflectance, n_theta_i, n_values, LUMINANCE)
        if form == "spectral":
            fields["wavelengths"] = spectrum.WAVELENGTHS.astype(np.float32)
            fields["spectra"] = np.einsum("lc,atcij->atlij", spectrum.BASIS, fields.pop("rgb")).astype(
                np.float32
            )
    text = np.frombuffer(description.encode(), np.uint8)
    with _files.aside(path) as part:
        write_tensor_file(part, {"description": text, "jacobian": np.ones(1, np.uint8), **fields})


def _fields(
    reflectance: Reflectance, n_theta_i: int, n_values: int, luminance: Array
) -> dict[str, NDArray[np.float32]]:
    """Arrays of a file in RGB; `luminance` (channel,) are weights that say where there is light."""
    even = np.linspace(0.0, 1.0, n_theta_i)
    # Closer toward grazing, where reflectance rises
    theta_i = np.pi / 4 * (even + np.sin(np.pi / 2 * even))
    d = _distribution(reflectance, luminance)
    nodes = [_of_incident(reflectance, float(theta), n_values, luminance) for theta in theta_i]
    density, u, light, values = (np.array(part) for part in zip(*nodes, strict=True))
    weight = 4.0 * _projected_area(d, theta_i)[:, None, None] / _at(d, u)
    fields = {
        "phi_i": np.zeros(1),
        "theta_i": theta_i,
        # A renderer wants two rows of what does not depend on phi
        "ndf": np.tile(d, (2, 1)),
        "sigma": np.tile(_projected_area(d, np.pi / 2 * np.linspace(0.0, 1.0, N_SIGMA) ** 2), (2, 1)),
        "vndf": density[None],
        # For sampling alone
        "luminance": light[None],
        "rgb": np.moveaxis(values * weight[..., None], -1, 1)[None],
    }
    return {name: array.astype(np.float32) for name, array in fields.items()}


def _of_incident(
    reflectance: Reflectance, theta_i: float, n_values: int, luminance: Array
) -> tuple[Array, Array, Array, Array]:
    """Density (v, u) at an incident angle; u of the nodes (t, s), light a node stands for, `f cos(theta_o)` there."""
    wi = np.array([np.sin(theta_i), 0.0, np.cos(theta_i)])
    u, v = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in N_DENSITY))
    _, light, cos_o = _reflected(reflectance, wi, u, v, luminance)
    light **= LIGHT_POWER
    visible = np.clip(1.0 + cos_o / MARGIN, 1e-2, 1.0)
    share = LIGHT_SHARE if light.any() else 0.0
    density = (1.0 - share) * visible / visible.mean() + share * light / (light.mean() or 1.0)

    u, v, density_there = _warp(density, np.linspace(0.0, 1.0, n_values))
    values, light, _ = _reflected(reflectance, wi, u, v, luminance)
    light /= density_there
    return density, u, light + LEAST_LIGHT * light.mean() if light.any() else np.ones_like(light), values


def _reflected(
    reflectance: Reflectance, wi: Array, u: Array, v: Array, luminance: Array
) -> tuple[Array, Array, Array]:
    """What is mirrored at half vectors: `f cos(theta_o)` (..., channel), zero below the horizon; its light over u and
    v; `cos(theta_o)`.
    """
    half, stretch = _half_vector(u, v)
    cos_d = half @ wi
    wo = 2.0 * cos_d[..., None] * half - wi
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    cos_o = wo[..., 2]
    values = (
        np.asarray(reflectance.eval(np.broadcast_to(wi, wo.shape), wo)) * np.maximum(cos_o, 0.0)[..., None]
    )
    light = np.maximum(values @ luminance * cos_d * stretch, 0.0)
    return values, light, cos_o


def _distribution(reflectance: Reflectance, luminance: Array) -> Array:
    """D at nodes even in u: the mean over `THETA_D` of luminance relative to that at the pole."""
    u = np.linspace(0.0, 1.0, N_DISTRIBUTION)
    # At phi_d = 90 degrees both directions are as high; just above the horizon at the last node
    theta_h = np.minimum(np.pi / 2 * u**2, np.pi / 2 - 1e-4)
    values = np.asarray(reflectance.eval(*half_diff.to_directions(theta_h, THETA_D[:, None], np.pi / 2)))
    if values.shape[-1] != len(luminance):
        require_rgb(values.shape[-1], "an RGL file")
    light = values @ luminance
    peak = light.max(axis=1, keepdims=True)
    d: Array = np.divide(light, peak, out=np.ones_like(light), where=peak > 0.0).mean(0)
    return np.maximum(d, FLOOR)


def _projected_area(d: Array, theta_i: Array) -> Array:
    """Sigma at incident angles: the integral of D over half vectors, times their cosine to the direction."""
    u, v = (np.arange(1024) + 0.5) / 1024, (np.arange(64) + 0.5) / 64
    half, stretch = _half_vector(*np.meshgrid(u, v))
    weight = _at(d, u) * stretch / stretch.size
    wi = np.stack([np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i)])
    return np.array([(weight * np.maximum(half @ w, 0.0)).sum() for w in wi.T])


def _half_vector(u: Array, v: Array) -> tuple[Array, Array]:
    """Half vectors (..., 3) at points of the square, and the solid angle of a unit of it."""
    theta, phi = np.pi / 2 * u**2, np.pi * (2.0 * v - 1.0)
    sin = np.sin(theta)
    half = np.stack(np.broadcast_arrays(sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)), axis=-1)
    return half, 2.0 * np.pi**2 * u * sin


def _at(table: Array, u: Array) -> Array:
    """A table over [0, 1], interpolated."""
    return np.interp(u, np.linspace(0.0, 1.0, table.size), table)


def _warp(density: Array, even: Array) -> tuple[Array, Array, Array]:
    """Points u, v (t, s) that the density takes an even square (t, s) to, and the density there.

    First v by whole rows, then u in a row.
    """
    n_v, n_u = density.shape
    row, b = _invert_cdf(0.5 * (density[:, 1:] + density[:, :-1]).sum(1), even)
    rows = (1.0 - b)[:, None] * density[row] + b[:, None] * density[row + 1]
    column, a = (np.array(part) for part in zip(*(_invert_cdf(of_row, even) for of_row in rows), strict=True))
    left, right = (np.take_along_axis(rows, column + i, axis=1) for i in (0, 1))
    v = ((row + b) / (n_v - 1))[:, None]
    return (column + a) / (n_u - 1), np.broadcast_to(v, column.shape), (1.0 - a) * left + a * right


def _invert_cdf(density: Array, share: Array) -> tuple[NDArray[np.intp], Array]:
    """Cell, and place in it, up to which a piecewise linear density has these shares of its integral."""
    steps = 0.5 * (density[1:] + density[:-1])
    up_to = np.concatenate([[0.0], np.cumsum(steps)])
    target = share * up_to[-1]
    cell = np.clip(np.searchsorted(up_to, target, side="right") - 1, 0, steps.size - 1)
    left, right = density[cell], density[cell + 1]
    rest = target - up_to[cell]
    root = np.sqrt(np.maximum(left**2 + 2.0 * rest * (right - left), 0.0))
    return cell, np.clip(2.0 * rest / (left + root), 0.0, 1.0)
