"""Where materials lie on the page's map, and in the coordinates in which it finds the nearest ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import half_diff
from dsbrdf.model.dsbrdf import DSBRDF

if TYPE_CHECKING:
    from dsbrdf.space import MaterialSpace

__all__ = ["Places", "likeness", "place"]

Array = NDArray[np.float64]

#: Angles in degrees at which reflectances are compared, and what is added before the logarithm, 1/sr.
THETA_H = (0.5, 2.0, 5.0, 10.0, 20.0, 35.0, 55.0)
THETA_D = (5.0, 25.0, 45.0, 65.0)
OFFSET = 1e-3
#: Coordinates that the page carries of a material, at most.
N_COORDINATES = 8
#: The axis that varies less is drawn so many times wider than the other, at most.
MAX_STRETCH = 3.0
#: Distance at which pictures do not overlap, in widths of the map, rounds of pushing, and for how many materials.
GAP, ROUNDS, MOST_APART = 0.07, 60, 120


@dataclass(frozen=True)
class Places:
    """Materials on a map.

    Parameters
    ----------
    at : (material, 2) ndarray
        x and y in [0, 1].
    coordinates : (material, coordinate) ndarray
        Near in them is alike.
    about, distance : str
        What the map shows, and what nearness is, in a line each.
    """

    at: Array
    coordinates: Array
    about: str
    distance: str


def place(models: Sequence[DSBRDF], space: MaterialSpace | None = None) -> Places | None:
    """Where each model lies; None for a single one.

    Raises
    ------
    ValueError
        If a model does not go into the space.
    """
    if len(models) < 2:
        return None
    if space is not None:
        coordinates = np.array([space.scores(model)[:N_COORDINATES] for model in models])
        if coordinates.shape[1] < 2:
            # The space of two materials
            coordinates = np.pad(coordinates, ((0, 0), (0, 1)))
        first, second = 100.0 * np.append(space.fpca.explained, 0.0)[:2]
        about = (
            f"Places: the first two scores of the space ({first:.0f} % and {second:.0f} % of its variance)"
        )
        distance = f"Distance in the first {coordinates.shape[1]} scores of the space."
    else:
        coordinates = likeness(models)
        about = "Near each other: alike in the logarithm of reflectance (two principal components)"
        distance = f"Distance in {coordinates.shape[1]} principal components of the logarithm of reflectance."
    scores = coordinates[:, :2]
    low, high = scores.min(0), scores.max(0)
    width = np.maximum(high - low, max(float((high - low).max()) / MAX_STRETCH, 1e-12))
    at = 0.5 + (scores - 0.5 * (low + high)) / width
    if len(models) <= MOST_APART:
        at, about = _apart(at), f"{about}, moved apart where pictures would overlap"
    return Places(at, coordinates, f"{about}.", distance)


def _apart(at: Array) -> Array:
    """Points (model, 2) within [0, 1] pushed apart where pictures would hide each other."""
    at = at.copy()
    for _ in range(ROUNDS):
        away = at[:, None] - at
        distance = np.hypot(away[..., 0], away[..., 1])
        np.fill_diagonal(distance, np.inf)
        push = np.maximum(GAP - distance, 0.0) / np.maximum(distance, 1e-6)
        at = np.clip(at + 0.25 * (push[..., None] * away).sum(1), 0.0, 1.0)
    return at


def likeness(models: Sequence[DSBRDF]) -> Array:
    """Principal components (model, coordinate) of the logarithm of reflectance over channels and angles."""
    theta_h, theta_d = np.meshgrid(np.deg2rad(THETA_H), np.deg2rad(THETA_D))
    directions = half_diff.to_directions(theta_h.ravel(), theta_d.ravel(), np.pi / 2)
    features = []
    for model in models:
        value = np.asarray(model.eval(*directions))
        # Any number of channels: their mean, and the first and last against it
        mean = np.log(value.mean(-1) + OFFSET)
        colours = np.log(value[:, [0, -1]] + OFFSET) - mean[:, None]
        features.append(np.concatenate([mean, colours.ravel()]))
    centred = np.array(features) - np.mean(features, 0)
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    scores: Array = u[:, :N_COORDINATES] * s[:N_COORDINATES]
    return scores
