"""Where the pixels of a picture look: masks, normals and directions toward the camera.

The camera is on +z and looks to -z, x is to its right and y up; normals are in this frame. It is orthographic, or a
perspective one with an angle of view over the picture's shorter side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Camera", "Points", "points"]

Array = NDArray[np.float64]

#: A pixel of a sphere sees several normals: points along a side of the sphere, and most along one of a pixel.
FINE, MOST_POINTS = 256, 4
#: Of 4 x 4 points of a pixel those that stand for all where a whole picture is rendered, no two of a row or column.
FEW = np.array([1, 7, 8, 14])
#: Normals further than this from the camera, as a cosine, are left out: there pixels mix normals, and models err most.
LEAST_COSINE = float(np.cos(np.deg2rad(80.0)))


@dataclass(frozen=True)
class Camera:
    """An orthographic camera, or one with an angle of view.

    Parameters
    ----------
    fov : float or None, radians
        Over the shorter side of the picture; None for orthographic.

    Raises
    ------
    ValueError
        If the angle is out of range.
    """

    fov: float | None = None

    def __post_init__(self) -> None:
        if self.fov is not None and not 0.0 < self.fov < np.pi:
            raise ValueError(
                f"'fov' must be between 0 and pi radians, got {self.fov:g}. Degrees? Use numpy.deg2rad."
            )

    def views(self, x: Array, y: Array) -> Array:
        """Unit vectors (..., 3) toward the camera from what is seen at (x, y), -1 to 1 over the shorter side."""
        if self.fov is None:
            return np.broadcast_to([0.0, 0.0, 1.0], (*x.shape, 3)).copy()
        tangent = np.tan(0.5 * self.fov)
        toward = np.stack([-tangent * x, -tangent * y, np.ones_like(x)], axis=-1)
        return np.asarray(toward / np.linalg.norm(toward, axis=-1, keepdims=True))

    def sphere(self, x: Array, y: Array, disc: tuple[float, float, float]) -> Array:
        """Normals (..., 3) of a sphere whose outline is a disc (x, y, radius); NaN off it."""
        u, v = (x - disc[0]) / disc[2], (y - disc[1]) / disc[2]
        r2 = u**2 + v**2
        inside = r2 < 1.0
        if self.fov is None:
            normal = np.stack([u, v, np.sqrt(np.where(inside, 1.0 - r2, 0.0))], axis=-1)
        else:
            # A sphere of radius 1 in the direction of the disc's middle, at the distance at which it fills the disc
            views = self.views(x, y)
            axis = -self.views(np.array(disc[0]), np.array(disc[1]))
            tangent = np.tan(0.5 * self.fov) * disc[2]
            distance = np.sqrt(1.0 + 1.0 / tangent**2)
            along = -(views @ axis) * distance
            gap = along**2 - distance**2 + 1.0
            inside = gap > 0.0
            depth = along - np.sqrt(np.where(inside, gap, 0.0))
            normal = -views * depth[..., None] - distance * axis
        return np.where(inside[..., None], normal, np.nan)


@dataclass(frozen=True, eq=False)
class Points:
    """Points of the pixels that are used.

    Parameters
    ----------
    pixel : (pixel,) ndarray of int
        Indices of the pixels in the picture, rows after each other.
    normal, view : (point, 3) ndarray
    start : (pixel + 1,) ndarray of int
        First point of each pixel, and the end.
    """

    pixel: NDArray[np.int_]
    normal: Array
    view: Array
    start: NDArray[np.int_]

    @property
    def middles(self) -> Points:
        """The same with one point a pixel, the mean of its own."""
        means = []
        for array in (self.normal, self.view):
            mean = self.means(array)
            means.append(mean / np.linalg.norm(mean, axis=-1, keepdims=True))
        return Points(self.pixel, means[0], means[1], np.arange(len(self.pixel) + 1))

    def means(self, values: Array) -> Array:
        """Means (pixel, n) over the points of each pixel of values (point, n)."""
        return np.asarray(np.add.reduceat(values, self.start[:-1]) / np.diff(self.start)[:, None])

    def pairs(self, direction: Array) -> tuple[Array, Array]:
        """A direction (3,) and that toward the camera, (point, 3) each, in frames with the normal as +z."""
        frames = self.frames
        return frames @ direction, (frames @ self.view[..., None])[..., 0]

    @property
    def few(self) -> Points:
        """The same with 4 of 16 points of a pixel, and one of fewer."""
        if (np.diff(self.start) != MOST_POINTS**2).any():
            return self.middles
        rows = (self.start[:-1, None] + FEW).ravel()
        start = len(FEW) * np.arange(len(self.pixel) + 1)
        return Points(self.pixel, self.normal[rows], self.view[rows], start)

    @property
    def frames(self) -> Array:
        """Rotations (point, 3, 3) to frames with the normal as +z."""
        normal = self.normal
        helper = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        across = np.cross(normal, helper)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        return np.stack([across, np.cross(normal, across), normal], axis=1)

    def take(self, which: NDArray[np.int_]) -> Points:
        """Some of the pixels."""
        counts = np.diff(self.start)
        if len(which) and (counts == counts[0]).all():
            n = int(counts[0])
            rows = (n * which[:, None] + np.arange(n)).ravel()
            return Points(
                self.pixel[which], self.normal[rows], self.view[rows], n * np.arange(len(which) + 1)
            )
        rows = np.concatenate(
            [np.arange(self.start[i], self.start[i + 1]) for i in which] or [np.empty(0, int)]
        )
        start = np.concatenate([[0], np.cumsum(counts[which])])
        return Points(self.pixel[which], self.normal[rows], self.view[rows], start)


def points(
    normals: ArrayLike | str,
    shape: tuple[int, int],
    camera: Camera,
    mask: NDArray[np.bool_] | None = None,
    *,
    least_cosine: float = LEAST_COSINE,
    per_side: int | None = None,
) -> Points:
    """Points of a picture (height, width).

    Parameters
    ----------
    normals : (height, width, 3) array_like or "sphere"
        Unit vectors; NaN or zero where there is no object. A sphere fills the picture's shorter side, or the box
        around the mask.
    shape : (int, int)
    camera : Camera
    mask : (height, width) ndarray of bool, optional
        Pixels that may be used.
    least_cosine : float, optional
        Of the angle between normal and camera.
    per_side : int, optional
        Points along a side of a pixel of a sphere; as many as its size asks for by default.

    Raises
    ------
    ValueError
        If shapes differ, or no pixel is left.
    """
    height, width = shape
    least = min(height, width)
    if mask is not None and mask.shape != shape:
        raise ValueError(f"'mask' must have the picture's shape {shape}, got {mask.shape}.")
    n = 1
    if isinstance(normals, str):
        n = per_side or min(max(round(FINE / least), 1), MOST_POINTS)
    offset = (np.arange(n) + 0.5) / n
    x = (2.0 * (np.arange(width)[:, None] + offset) - width) / least
    y = (height - 2.0 * (np.arange(height)[:, None] + offset)) / least
    # (row, column, point of the pixel)
    grid_y, grid_x = np.broadcast_arrays(y[:, None, :, None], x[None, :, None, :])
    at_x, at_y = grid_x.reshape(height, width, -1), grid_y.reshape(height, width, -1)
    if isinstance(normals, str):
        if normals != "sphere":
            raise ValueError(f"'normals' must be an array (height, width, 3) or 'sphere', got {normals!r}.")
        found = camera.sphere(at_x, at_y, _disc(mask, shape))
    else:
        found = np.asarray(normals, dtype=np.float64)
        if found.shape != (*shape, 3):
            raise ValueError(
                f"'normals' must have shape {(*shape, 3)} as the picture has, got {found.shape}."
            )
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            length = np.linalg.norm(found, axis=-1, keepdims=True)
            found = np.where(np.abs(length - 1.0) < 0.1, found / length, np.nan)[:, :, None]
    views = camera.views(at_x, at_y)
    with np.errstate(invalid="ignore"):
        used = ((found * views).sum(-1) > least_cosine).all(-1)
    if mask is not None:
        used &= mask
    pixel = np.flatnonzero(used)
    if not len(pixel):
        raise ValueError(
            "no pixel shows the object: check that normals are unit vectors with z toward the camera, and the mask."
        )
    rows, columns = np.divmod(pixel, width)
    normal, view = (array[rows, columns].reshape(-1, 3) for array in (found, views))
    return Points(
        pixel, np.ascontiguousarray(normal), np.ascontiguousarray(view), n * n * np.arange(len(pixel) + 1)
    )


def _disc(mask: NDArray[np.bool_] | None, shape: tuple[int, int]) -> tuple[float, float, float]:
    """Middle and radius of a sphere's outline; -1 to 1 over the shorter side."""
    if mask is None:
        return 0.0, 0.0, 1.0
    height, width = shape
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return 0.0, 0.0, 1.0
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    least = min(height, width)
    radius = 0.5 * ((bottom - top) + (right - left)) / least
    return (left + right - width) / least, (height - top - bottom) / least, radius
