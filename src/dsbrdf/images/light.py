"""`Light`: what shines on an object, from so far away that it is the same at every point of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief
from dsbrdf.geometry import panorama
from dsbrdf.measured.formats import image_file

__all__ = ["Light"]

Array = NDArray[np.float64]

#: Rows of the coarsest and of the finest level of a map.
COARSEST, FINEST = 16, 512
#: Rows of the level that every part of a map is taken apart to; beyond, only parts with more than this share of the
#: light.
EVERYWHERE = 128
SHARE = 1.0 / 4096.0


@dataclass(frozen=True, eq=False, repr=False)
class Light(Brief):
    """Distant light: directions with an irradiance, in trees.

    Made by `from_map` or `distant`. The frame is that of `dsbrdf.geometry.panorama`.

    Parameters
    ----------
    direction : (light, 3) ndarray
        Unit vectors toward the light.
    flux : (light, channel) ndarray
        Irradiance on a surface that faces it.
    radius : (light,) ndarray, radians
        Half its width.
    parts : (light, 4) ndarray of int32
        Indices of what it consists of, further down; -1 for none.
    n_roots : int
        The first so many lights are no part of another; they hold all the light.
    map : (height, width, channel) ndarray, optional
        Radiance, where the light is an environment map.
    """

    direction: Array
    flux: Array
    radius: Array
    parts: NDArray[np.int32] = field(repr=False)
    n_roots: int
    map: Array | None = field(default=None, repr=False)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.flux.shape[1])

    @classmethod
    def distant(cls, directions: ArrayLike, irradiance: ArrayLike = 1.0) -> Light:
        """Distant point lights.

        Parameters
        ----------
        directions : (..., 3) array_like
            Unit vectors toward the lights.
        irradiance : (..., channel), (...,) or scalar array_like, optional
            On a surface that faces a light; one number stands for all three channels.

        Raises
        ------
        ValueError
            If a vector is not of unit length, or an irradiance is negative or not finite.

        Examples
        --------
        >>> import dsbrdf
        >>> dsbrdf.images.Light.distant([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]], 2.0).flux.shape
        (2, 3)
        """
        toward = _check.unit_vectors(np.atleast_2d(np.asarray(directions, dtype=np.float64)), "directions")
        toward = toward.reshape(-1, 3)
        flux = _check.finite(irradiance, "irradiance", low=0.0)
        if flux.ndim <= 1:
            flux = np.broadcast_to(flux, len(toward))[:, None] * np.ones(3)
        if flux.shape[:-1] != (len(toward),):
            raise ValueError(
                f"'irradiance' must be a number, ({len(toward)},) or ({len(toward)}, channel) for {len(toward)} "
                f"directions, got shape {flux.shape}."
            )
        n = len(toward)
        parts = np.full((n, 4), -1, dtype=np.int32)
        return cls(np.ascontiguousarray(toward), np.ascontiguousarray(flux), np.zeros(n), parts, n)

    @classmethod
    def from_map(cls, radiance: ArrayLike | str | Path) -> Light:
        """An environment map.

        Parameters
        ----------
        radiance : (height, width, channel) or (height, width) array_like, or path
            Linear radiance in the frame of `dsbrdf.geometry.panorama`, or an EXR or HDR file of it.

        Raises
        ------
        ValueError
            If it is no map: of another shape, negative, not finite, or black; or if the file is damaged.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> import dsbrdf, numpy as np
        >>> sky = np.ones((16, 32, 3)) * np.linspace(1.0, 0.1, 16)[:, None, None]
        >>> dsbrdf.images.Light.from_map(sky).n_channels
        3
        """
        label = "the map"
        if isinstance(radiance, str | Path):
            label = str(radiance)
            radiance = image_file.read_array(Path(radiance))
        given = np.asarray(radiance, dtype=np.float64)
        if given.ndim == 2:
            given = given[..., None] * np.ones(3)
        if given.ndim != 3 or 0 in given.shape:
            raise ValueError(f"{label}: expected (height, width, channel), got shape {given.shape}.")
        if not (np.isfinite(given) & (given >= 0.0)).all():
            raise ValueError(
                f"{label}: radiance must be finite and not negative. Replace such pixels, by 0 for instance."
            )
        if not given.any():
            raise ValueError(f"{label}: is black. Give a map with light in it.")
        return cls(*_tree(given), map=given)

    def __repr__(self) -> str:
        if self.map is not None:
            return f"Light(map of {self.map.shape[1]} x {self.map.shape[0]}, {self.n_channels} channels)"
        return f"Light({self.n_roots} distant, {self.n_channels} channels)"


def _tree(radiance: Array) -> tuple[Array, Array, Array, NDArray[np.int32], int]:
    """Direction, flux, radius and parts of the cells of all levels, and the number of the coarsest."""
    # A coarse map is taken apart too: its pixels are areas, not points
    rows_wanted = np.clip(len(radiance), EVERYWHERE, FINEST)
    steps = int(np.round(np.log2(rows_wanted / COARSEST)))
    rows = COARSEST << steps
    flux = _resized(
        _resized(radiance * panorama.solid_angles(*radiance.shape[:2])[..., None], rows, 0), 2 * rows, 1
    )
    levels = [flux]
    moments = [flux.sum(-1, keepdims=True) * panorama.directions(rows, 2 * rows)]
    for _ in range(steps):
        levels.append(_halved(levels[-1]))
        moments.append(_halved(moments[-1]))
    levels.reverse()
    moments.reverse()

    total = float(flux.sum())
    directions, fluxes, radii, parts = [], [], [], []
    cells = np.arange(2 * COARSEST * COARSEST)
    end = len(cells)
    for level, (flux, moment) in enumerate(zip(levels, moments, strict=True)):
        height, width = flux.shape[:2]
        of, weighted = flux.reshape(-1, flux.shape[-1])[cells], moment.reshape(-1, 3)[cells]
        length = np.sqrt((weighted**2).sum(-1, keepdims=True))
        middle = panorama.directions(height, width).reshape(-1, 3)[cells]
        directions.append(np.where(length > 0.0, weighted / np.where(length > 0.0, length, 1.0), middle))
        fluxes.append(of)
        radii.append(np.full(len(cells), 0.5 * np.pi / height))
        brightness = of.sum(-1)
        split = brightness > (SHARE * total if height >= EVERYWHERE else 0.0)
        split &= level + 1 < len(levels)
        row, column = np.divmod(cells[split], width)
        below = (2 * row[:, None] + [0, 0, 1, 1]) * (2 * width) + 2 * column[:, None] + [0, 1, 0, 1]
        index = np.full((len(cells), 4), -1, dtype=np.int32)
        index[split] = end + np.arange(below.size).reshape(below.shape)
        parts.append(index)
        cells = below.ravel()
        end += len(cells)
    direction, of, radius = (np.concatenate(each) for each in (directions, fluxes, radii))
    return direction, of, radius, np.concatenate(parts), 2 * COARSEST**2


def _halved(sums: Array) -> Array:
    """Sums over 2 x 2 cells."""
    height, width, n = sums.shape
    return np.asarray(sums.reshape(height // 2, 2, width // 2, 2, n).sum((1, 3)))


def _resized(sums: Array, n: int, axis: int) -> Array:
    """Sums along an axis, shared out among `n` cells."""
    size = sums.shape[axis]
    if size == n:
        return sums
    moved = np.moveaxis(sums, axis, 0)
    below = np.concatenate([np.zeros((1, *moved.shape[1:])), np.cumsum(moved, 0)])
    at = np.linspace(0.0, size, n + 1)
    first = np.minimum(at.astype(int), size - 1)
    share = (at - first).reshape(-1, *[1] * (moved.ndim - 1))
    edges = below[first] + share * (below[first + 1] - below[first])
    return np.asarray(np.moveaxis(np.diff(edges, axis=0), 0, axis))
