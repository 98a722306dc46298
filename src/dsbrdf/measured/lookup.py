"""Values of a table between its nodes: multilinear in (sqrt(theta_h), theta_d, phi_d), aware of the mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf.geometry import half_diff
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["evaluate", "fill_invalid"]

Array = NDArray[np.float64]
#: Pairs of directions handled at once, so that the working arrays stay in a processor's cache.
PAIRS = 16384


def fill_invalid(measured: MeasuredBRDF) -> Array:
    """Values (theta_h, theta_d, phi_d, channel) in 1/sr with each invalid entry replaced by a valid one near it.

    That is the next valid one toward the pole, else away from it, else at the next smaller or greater theta_d
    or phi_d.

    Raises
    ------
    ValueError
        If a channel has no valid entry.
    """
    filled = np.empty((*measured.planes.shape[1:], measured.n_channels))
    for channel, (plane, scale) in enumerate(zip(measured.planes, measured.scale, strict=True)):
        valid = (plane >= 0.0) & (plane < np.inf)
        if not valid.any():
            raise ValueError(f"{measured.name}: channel {channel} has no valid entry, so it has no values.")
        values = plane * scale
        for axis in range(3):
            values = _fill_along(values, valid, axis)
            valid = np.broadcast_to(valid.any(axis, keepdims=True), valid.shape)
        filled[..., channel] = values
    return filled


def _fill_along(values: Array, valid: NDArray[np.bool_], axis: int) -> Array:
    """Take the last valid entry along an axis, or the first where there is none before."""
    n = values.shape[axis]
    at = np.arange(n, dtype=np.int32).reshape([-1 if i == axis else 1 for i in range(values.ndim)])
    last = np.maximum.accumulate(np.where(valid, at, -1), axis=axis)
    first = valid.argmax(axis=axis, keepdims=True)
    return np.take_along_axis(values, np.where(last < 0, first, last), axis=axis)


def evaluate(measured: MeasuredBRDF, filled: Array, wi: ArrayLike, wo: ArrayLike) -> Array:
    """Values (..., channel) at pairs of directions (..., 3); see `MeasuredBRDF.eval`."""
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    wi, wo = np.asarray(wi), np.asarray(wo)
    above = np.broadcast_to((wi[..., 2] > 0.0) & (wo[..., 2] > 0.0), theta_h.shape)
    rows = np.flatnonzero(above)
    result = np.zeros((theta_h.size, filled.shape[-1]))
    # Both ends of phi_d, which a turn by pi brings back
    nodes = measured.phi_d
    around = np.concatenate([[nodes[-1] - np.pi], nodes, [nodes[0] + np.pi]])
    table = filled.reshape(-1, filled.shape[-1])
    _, n_d, n_phi = filled.shape[:3]
    for start in range(0, rows.size, PAIRS):
        some = rows[start : start + PAIRS]
        h, a = _cell(np.sqrt(measured.theta_h), np.sqrt(theta_h.reshape(-1)[some]))
        d, b = _cell(measured.theta_d, theta_d.reshape(-1)[some])
        phi, c = _cell(around, phi_d.reshape(-1)[some] % np.pi)
        total = np.zeros((some.size, filled.shape[-1]))
        for i, of_h in ((h, 1.0 - a), (np.minimum(h + 1, len(measured.theta_h) - 1), a)):
            for j, of_d in ((d, 1.0 - b), (np.minimum(d + 1, n_d - 1), b)):
                for k, of_phi in (((phi - 1) % n_phi, 1.0 - c), (phi % n_phi, c)):
                    weight = (of_h * of_d * of_phi)[:, None]
                    total += weight * table.take((i * n_d + j) * n_phi + k, axis=0)
        result[some] = total
    return result.reshape(*theta_h.shape, filled.shape[-1])


def _cell(nodes: Array, x: Array) -> tuple[NDArray[np.intp], Array]:
    """Index of the node at or below x, and the place up to the next; ends hold beyond them."""
    place = np.interp(x, nodes, np.arange(len(nodes), dtype=float))
    cell = place.astype(np.intp)
    return cell, place - cell
