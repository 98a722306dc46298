"""Columns of samples from values on a grid of angles, as many formats of metrology store them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]
__all__ = ["about_mirror", "columns_of", "from_vectors", "mirrored_azimuths"]


def from_vectors(wi: Array, wo: Array) -> dict[str, Array]:
    """Columns of vectors (..., 3), those below the horizon among them."""
    wi, wo = np.broadcast_arrays(wi, wo)
    return {
        f"{name}_{axis}": w[..., k].ravel()
        for name, w in (("wi", wi), ("wo", wo))
        for k, axis in enumerate("xyz")
    }


def columns_of(angles: Mapping[str, ArrayLike], values: Mapping[str, Array]) -> dict[str, Array]:
    """Columns of angles that span a grid, in the order of the axes of the values, and of the values there."""
    grid = np.meshgrid(*(np.asarray(a, float) for a in angles.values()), indexing="ij")
    columns = {name: axis.ravel() for name, axis in zip(angles, grid, strict=True)}
    return columns | {name: np.asarray(plane, float).ravel() for name, plane in values.items()}


def about_mirror(
    theta_i: ArrayLike,
    phi_i: ArrayLike,
    radial: ArrayLike,
    azimuth: ArrayLike,
    theta_mirror: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Directions of views that are given about the mirror direction.

    Parameters
    ----------
    theta_i, phi_i : (...) array_like, radians
        Of the light.
    radial, azimuth : (...) array_like, radians
        Angle of the view from the mirror direction, and its azimuth about it; 0 points from there to the normal.
    theta_mirror : (...) array_like, radians, optional
        Angle from the normal that takes the place of the mirror direction's.

    Returns
    -------
    wi, wo : (..., 3) ndarray
    """
    theta_i, phi_i, radial, azimuth = np.broadcast_arrays(theta_i, phi_i, radial, azimuth)
    at = theta_i if theta_mirror is None else np.broadcast_to(theta_mirror, theta_i.shape)
    x = -np.sin(at) * np.cos(radial) + np.cos(at) * np.sin(radial) * np.cos(azimuth)
    y = np.sin(radial) * np.sin(azimuth)
    z = np.cos(at) * np.cos(radial) + np.sin(at) * np.sin(radial) * np.cos(azimuth)
    zero = np.zeros_like(x)
    wi = np.stack([np.sin(theta_i) + zero, zero, np.cos(theta_i) + zero], axis=-1)
    wo = np.stack([x, y, z], axis=-1)
    c, s = np.cos(phi_i), np.sin(phi_i)
    turned = (
        np.stack([w[..., 0] * c - w[..., 1] * s, w[..., 0] * s + w[..., 1] * c, w[..., 2]], axis=-1)
        for w in (wi, wo)
    )
    first, second = turned
    return first, second


def mirrored_azimuths(azimuth: Array, values: Array, axis: int) -> tuple[Array, Array]:
    """Azimuths and values on both sides of the plane of incidence, of those on one side."""
    inside = (azimuth > 1e-9) & (azimuth < 180.0 - 1e-9)
    other = np.flip(np.compress(inside, values, axis=axis), axis=axis)
    return np.concatenate([azimuth, 360.0 - azimuth[inside][::-1]]), np.concatenate(
        [values, other], axis=axis
    )
