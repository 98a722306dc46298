"""Measured isotropic reflectances of the RGL material database, evaluated for any pair of directions.

`read_rgl` reads a ``.bsdf`` file into an `RGLReflectance`, whose `eval` gives the reflectance: three channels
of linear sRGB, or one channel a wavelength from a spectral file.

Dupuy and Jakob, *An Adaptive Parameterization for Efficient Material Acquisition and Rendering*, ACM Trans.
Graph. 37(6), 2018. The database is at https://rgl.epfl.ch/materials.

Notes
-----
A direction with angles theta and phi, phi counted from the azimuth of `wi`, has the coordinates
``u = sqrt(2 theta / pi)``, ``v = phi / (2 pi) + 1/2`` in the unit square. For each incident angle theta_i the
file has a density of the visible microfacet normals over this square (`vndf`). Its marginal and conditional
distribution functions take the half vector's (u, v) to a point (s, t) of a second square, with a table of the
measured values. With the distribution D (`ndf`) and the projected area sigma of the microfacet normals,

    f(wi, wo) cos(theta_o) = table(s, t) D(h) / (4 sigma(wi)).

All tables are linear between the nodes of their grids. The densities, each normalised, and the measured
values are linear between the incident angles too.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry.colour import srgb_weights
from dsbrdf.measured.formats.tensor_file import Fields, read_tensor_file
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF, tabulate

__all__ = ["MAX_THETA", "RGLReflectance", "read_rgl", "read_rgl_table"]

#: Directions further from the normal are not measured well: the two orders of a pair of them disagree.
MAX_THETA = float(np.deg2rad(80.0))

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Cosines to the normal count as no less than this, which keeps 1 / cosine finite.
_MIN_COSINE = 1e-12
# Pairs of directions handled at once, so that the working arrays stay in a processor's cache.
_PAIRS = 16384
_LARGEST_THETA_I = np.pi / 2 + 1e-6
_TINY = float(np.finfo(np.float32).tiny)


def read_rgl(path: str | os.PathLike[str]) -> RGLReflectance:
    """Read a measured isotropic reflectance from an RGL ``.bsdf`` file.

    Parameters
    ----------
    path : path-like
        A tensor file with the fields `phi_i`, `theta_i`, `sigma`, `ndf`, `vndf`, `jacobian` and either `rgb`
        or both `spectra` and `wavelengths`.

    Returns
    -------
    RGLReflectance

    Raises
    ------
    ValueError
        If the file is not an RGL tensor file, lacks a field, has one of a wrong shape or with impossible
        values, or holds an anisotropic material.
    """
    fields = read_tensor_file(path)
    return RGLReflectance.from_fields(fields, fields.name)


def read_rgl_table(path: str | os.PathLike[str], *, convention: str = "centre") -> MeasuredBRDF:
    """Read an RGL ``.bsdf`` file and tabulate it over half and difference angles, in linear sRGB.

    Parameters
    ----------
    path : path-like
    convention : {"centre", "edge"}, optional
        Which point of a cell its value belongs to.

    Returns
    -------
    MeasuredBRDF
        On the grid of MERL. An entry is the mean of both orders of its two directions, as the model is
        reciprocal, zero where that is negative (a saturated colour outside sRGB), and invalid where a direction
        is more than `MAX_THETA` from the normal. Spectra become linear sRGB, see `RGLReflectance.linear_srgb`.

    Raises
    ------
    ValueError
        As `read_rgl`; also if a spectrum does not cover the visible wavelengths.
    """
    path = Path(path)
    try:
        measured = read_rgl(path).linear_srgb()
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path.name}: ')}") from None
    limit = np.cos(MAX_THETA)

    def reciprocal(wi: Array, wo: Array) -> Array:
        values = np.full((*wi.shape[:-1], measured.values.shape[-1]), np.nan)
        kept = (wi[..., 2] >= limit) & (wo[..., 2] >= limit)
        both = measured.eval(wi[kept], wo[kept]) + measured.eval(wo[kept], wi[kept])
        values[kept] = np.maximum(0.5 * both, 0.0)
        return values

    source = Source(path, measured.description)
    return tabulate(reciprocal, path.stem, convention=convention, source=source)


@dataclass(frozen=True, eq=False)
class RGLReflectance:
    """A measured isotropic reflectance in the adaptive parameterisation of Dupuy and Jakob (2018).

    Attributes
    ----------
    description : str
        What the file says of the material; may be empty.
    theta_i : (incident,) ndarray
        Incident angles of the tables, rising, in radians.
    wavelengths : (channel,) ndarray or None
        Wavelengths of the channels in nm; None if the channels are linear sRGB.
    values : (incident, t, s, channel) ndarray
        The table of measured values over the second square.
    sigma, ndf : (u,) ndarray
        Projected area and distribution of the microfacet normals, over u.
    weighted : bool
        Whether f cos(theta_o) is the table times ``D / (4 sigma)``, or the table alone.
    """

    description: str
    theta_i: Array
    wavelengths: Array | None
    values: Array = field(repr=False)
    sigma: Array = field(repr=False)
    ndf: Array = field(repr=False)
    weighted: bool
    _warp: _Warp = field(repr=False)

    @classmethod
    def from_fields(cls, arrays: Mapping[str, NDArray[Any]], name: str = "fields") -> RGLReflectance:
        """Build from the arrays of a tensor file, which an error calls `name`; raises as `read_rgl`."""
        fields = Fields(arrays, name)
        phi_i = fields.numbers("phi_i", (None,))
        if phi_i.size > 2:
            raise ValueError(
                f"{name}: an anisotropic material: expected 1 or 2 azimuths in field 'phi_i', "
                f"got {phi_i.size}; give the file of an isotropic material."
            )
        theta_i = fields.numbers("theta_i", (None,), low=0.0)
        if np.any(np.diff(theta_i) <= 0) or theta_i[-1] > _LARGEST_THETA_I:
            got = np.array2string(theta_i, threshold=8)
            fields.refuse("rising angles of at most pi/2 in field 'theta_i'", got)
        incident = (phi_i.size, theta_i.size)

        wavelengths = None if "rgb" in fields else fields.numbers("wavelengths", (None,), low=0.0)
        table, channels = ("rgb", 3) if wavelengths is None else ("spectra", wavelengths.size)
        values = fields.numbers(table, (*incident, channels, None, None))
        vndf = fields.numbers("vndf", (*incident, None, None), low=0.0)
        for key, grid in ((table, values), ("vndf", vndf)):
            if min(grid.shape[-2:]) < 2:
                fields.refuse(f"2 or more nodes along the last two axes of field {key!r}", f"{grid.shape}")
        if vndf.max(axis=(2, 3)).min() < _TINY:
            fields.refuse("a density for each incident angle in field 'vndf'", "one that is 0 everywhere")

        # An isotropic material is the same at each azimuth which the file may have: the mean is taken.
        return cls(
            description=fields.get("description", np.zeros(0, np.uint8)).tobytes().decode(errors="replace"),
            theta_i=theta_i,
            wavelengths=wavelengths,
            values=np.ascontiguousarray(np.moveaxis(values.mean(axis=0), 1, -1)),
            sigma=fields.numbers("sigma", (None, None), low=_TINY).mean(axis=0),
            ndf=fields.numbers("ndf", (None, None), low=0.0).mean(axis=0),
            weighted=bool(fields.numbers("jacobian", (1,))[0]),
            _warp=_Warp.of(vndf),
        )

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Reflectance f(wi, wo) in 1/sr, without the cosine.

        Parameters
        ----------
        wi, wo : (..., 3) array_like
            Unit vectors toward the light and the viewer, in the local frame with the normal along +z; leading
            axes broadcast.

        Returns
        -------
        (..., channel) ndarray
            0 where a direction is at or below the horizon, finite everywhere. Slightly negative where the
            table is: a saturated colour may lie outside sRGB. Reciprocal only as far as the measurement is.

        Raises
        ------
        ValueError
            If a direction is not a unit vector.
        """
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        flat_i, flat_o = wi.reshape(-1, 3), wo.reshape(-1, 3)
        result = np.zeros((flat_i.shape[0], self.values.shape[-1]))
        above = np.flatnonzero((flat_i[:, 2] > 0) & (flat_o[:, 2] > 0))
        for start in range(0, above.size, _PAIRS):
            rows = above[start : start + _PAIRS]
            result[rows] = self._eval_above(flat_i[rows], flat_o[rows])
        return result.reshape(*wi.shape[:-1], result.shape[-1])

    def linear_srgb(self) -> RGLReflectance:
        """The same in linear sRGB: a spectrum as the CIE 1931 2-degree observer sees it under D65.

        Raises
        ------
        ValueError
            If the wavelengths do not cover the visible ones.
        """
        if self.wavelengths is None:
            return self
        values = self.values @ srgb_weights(self.wavelengths).T
        return dataclasses.replace(self, values=values, wavelengths=None)

    def _eval_above(self, wi: Array, wo: Array) -> Array:
        """`eval` of (n, 3) directions above the horizon."""
        theta_i = _polar_angle(wi)
        slices = _Slices.at(theta_i, self.theta_i)
        half = wi + wo
        u, v = _radius(_polar_angle(half)), _turn(half, wi)

        value = slices.bilinear(self.values, *self._warp.invert(u, v, slices))
        factor = 1.0 / np.maximum(wo[:, 2], _MIN_COSINE)
        if self.weighted:
            factor *= _linear(self.ndf, u) / (4.0 * _linear(self.sigma, _radius(theta_i)))
        return value * factor[:, np.newaxis]


@dataclass(frozen=True, eq=False)
class _Slices:
    """Linear interpolation of tables (incident, ...) at n incident angles.

    Attributes
    ----------
    below, above : (n,) ndarray
        Indices of the incident angles on either side.
    share : (n,) ndarray in [0, 1]
        Weight of the one above.
    """

    below: Index
    above: Index
    share: Array

    @classmethod
    def at(cls, theta_i: Array, nodes: Array) -> _Slices:
        above = np.clip(np.searchsorted(nodes, theta_i), min(1, nodes.size - 1), nodes.size - 1)
        below = np.maximum(above - 1, 0)
        gap = np.where(above > below, nodes[above] - nodes[below], 1.0)
        return cls(below, above, np.clip((theta_i - nodes[below]) / gap, 0.0, 1.0))

    def take(self, table: Array, *index: Index | int) -> Array:
        """Entries ``table[theta_i, *index]``, (n,) or (n, channel)."""
        low: Array = table[(self.below, *index)]
        high: Array = table[(self.above, *index)]
        return low + self.share.reshape(-1, *[1] * (low.ndim - 1)) * (high - low)

    def bilinear(self, table: Array, x: Array, y: Array) -> Array:
        """Table (incident, y, x, channel) at points of the unit square, (n, channel)."""
        column, a = _cell(x, table.shape[2])
        row, b = _cell(y, table.shape[1])
        a, b = a[:, np.newaxis], b[:, np.newaxis]
        near = (1 - a) * self.take(table, row, column) + a * self.take(table, row, column + 1)
        far = (1 - a) * self.take(table, row + 1, column) + a * self.take(table, row + 1, column + 1)
        return (1 - b) * near + b * far


@dataclass(frozen=True, eq=False)
class _Warp:
    """Map of the unit square to itself by the distribution functions of densities, one an incident angle.

    Attributes
    ----------
    density : (incident, v, u) ndarray
        Values at the nodes; the trapezoid rule with steps of one node gives 1.
    along : (incident, v, u) ndarray
        Integral of `density` over u up to the node.
    rows : (incident, v) ndarray
        Integral of the whole rows over v up to the node: the marginal distribution function.
    """

    density: Array
    along: Array
    rows: Array

    @classmethod
    def of(cls, vndf: Array) -> _Warp:
        """From densities (azimuth, incident, v, u), each of any scale."""
        total = _cumulate(_cumulate(vndf)[..., -1])[..., -1]
        density = (vndf / total[..., np.newaxis, np.newaxis]).mean(axis=0)
        along = _cumulate(density)
        return cls(density, along, _cumulate(along[..., -1]))

    def invert(self, u: Array, v: Array, slices: _Slices) -> tuple[Array, Array]:
        """Map (u, v) to (s, t): t is the share of the rows up to v, s that of the row at v up to u."""
        column, a = _cell(u, self.density.shape[2])
        row, b = _cell(v, self.density.shape[1])

        def at_row(table: Array, column: Index) -> Array:
            return (1 - b) * slices.take(table, row, column) + b * slices.take(table, row + 1, column)

        left, right = at_row(self.density, column), at_row(self.density, column + 1)
        up_to_u = at_row(self.along, column) + a * (left + 0.5 * a * (right - left))
        first, last = slices.take(self.along, row, -1), slices.take(self.along, row + 1, -1)
        whole = (1 - b) * first + b * last
        s = up_to_u / np.where(whole > 0, whole, 1.0)
        t = slices.take(self.rows, row) + b * (first + 0.5 * b * (last - first))
        return np.clip(s, 0.0, 1.0), np.clip(t, 0.0, 1.0)


def _cumulate(density: Array) -> Array:
    """Trapezoid rule with unit steps over the last axis, up to each node."""
    steps = 0.5 * (density[..., 1:] + density[..., :-1])
    return np.concatenate([np.zeros_like(density[..., :1]), np.cumsum(steps, axis=-1)], axis=-1)


def _cell(x: Array, nodes: int) -> tuple[Index, Array]:
    """Cell of a grid over [0, 1] with this many nodes, and the place in the cell."""
    cell = np.minimum((x * (nodes - 1)).astype(np.intp), nodes - 2)
    return cell, x * (nodes - 1) - cell


def _linear(table: Array, x: Array) -> Array:
    """A table over [0, 1], interpolated."""
    return np.interp(x, np.linspace(0.0, 1.0, table.size), table)


def _polar_angle(w: Array) -> Array:
    """Angle to the normal, precise near it."""
    return np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])


def _radius(theta: Array) -> Array:
    """Coordinate u of a polar angle in [0, pi/2]."""
    return np.sqrt(theta * (2 / np.pi))


def _turn(half: Array, wi: Array) -> Array:
    """Coordinate v of the half vector's azimuth counted from that of `wi`, from +x if `wi` is the normal."""
    x, y = np.where(wi[:, :2].any(axis=1), wi[:, 0], 1.0), wi[:, 1]
    phi = np.arctan2(half[:, 1] * x - half[:, 0] * y, half[:, 0] * x + half[:, 1] * y)
    v = phi / (2 * np.pi) + 0.5
    return v - np.floor(v)
