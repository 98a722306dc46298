"""Where materials lie on the page's map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.dsbrdf import DSBRDF

if TYPE_CHECKING:
    from dsbrdf.space import MaterialSpace

__all__ = ["place"]

#: Fewer materials stand in a row.
MIN_MATERIALS = 3
#: Angles in degrees at which reflectances are compared, and what is added before the logarithm, 1/sr.
THETA_H = (0.5, 2.0, 5.0, 10.0, 20.0, 35.0, 55.0)
THETA_D = (5.0, 25.0, 45.0, 65.0)
OFFSET = 1e-3
#: The axis that varies less is drawn so many times wider than the other, at most.
MAX_STRETCH = 3.0
#: Distance at which pictures do not overlap, in widths of the map, and rounds of pushing.
GAP, ROUNDS = 0.07, 60


def place(
    models: Sequence[DSBRDF], space: MaterialSpace | None = None
) -> tuple[list[dict[str, Any]], str | None]:
    """Position of each model, x and y in [0, 1], and what the map shows; None for models in a row.

    Raises
    ------
    ValueError
        If a model does not go into the space.
    """
    if space is not None:
        scores = np.array([space.scores(model)[:2] for model in models])
        first, second = 100.0 * space.fpca.explained[:2]
        text = f"Places: the first two scores of the space ({first:.0f} % and {second:.0f} % of its variance)"
    elif len(models) >= MIN_MATERIALS:
        scores = likeness(models)
        text = "Near each other: alike in the logarithm of reflectance (two principal components)"
    else:
        return [{} for _ in models], None
    low, high = scores.min(0), scores.max(0)
    width = np.maximum(high - low, max(float((high - low).max()) / MAX_STRETCH, 1e-12))
    at = _apart(0.5 + (scores - 0.5 * (low + high)) / width)
    places: list[dict[str, Any]] = [{"position": [round(float(x), 4) for x in point]} for point in at]
    if space is not None:
        for place, score in zip(places, scores, strict=True):
            place["scores"] = [round(float(x), 4) for x in score]
    return places, f"{text}, moved apart where pictures would overlap."


def _apart(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (model, 2) within [0, 1] pushed apart where pictures would hide each other."""
    at = at.copy()
    for _ in range(ROUNDS):
        away = at[:, None] - at
        distance = np.hypot(away[..., 0], away[..., 1])
        np.fill_diagonal(distance, np.inf)
        push = np.maximum(GAP - distance, 0.0) / np.maximum(distance, 1e-6)
        at = np.clip(at + 0.25 * (push[..., None] * away).sum(1), 0.0, 1.0)
    return at


def likeness(models: Sequence[DSBRDF]) -> NDArray[np.float64]:
    """Two principal components (model, 2) of the logarithm of reflectance over channels and angles."""
    theta_h, theta_d = np.meshgrid(np.deg2rad(THETA_H), np.deg2rad(THETA_D))
    across = np.pi / 2
    values = [np.asarray(model.eval_angles(theta_h, theta_d, across)) for model in models]
    # Any number of channels: their mean, and the first and last against it
    means = [np.log(value.mean(-1) + OFFSET) for value in values]
    colours = [
        np.log(value[..., [0, -1]] + OFFSET) - mean[..., None]
        for value, mean in zip(values, means, strict=True)
    ]
    features = np.array([np.concatenate([m.ravel(), c.ravel()]) for m, c in zip(means, colours, strict=True)])
    u, s, _ = np.linalg.svd(features - features.mean(0), full_matrices=False)
    scores: NDArray[np.float64] = u[:, :2] * s[:2]
    return scores
