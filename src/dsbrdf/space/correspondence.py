"""Which lobe of one material is which of another, and what stands in for those that are missing (Section 6.C).

The lobes of a material are ordered by their sharpness, from flat to sharp. Materials are laid side by side either at
the flattest lobe ("rank"), or at the border between diffuse and specular lobes ("border", the paper): lobes of all
materials are put in two classes by their sharpness. Slots that a material has no lobe for hold a dark lobe.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dsbrdf.space.variables import Variables

__all__ = ["CORRESPONDENCES", "lobe_slots", "pad", "two_class_border"]

Array = NDArray[np.float64]

CORRESPONDENCES = ("rank", "border")


def two_class_border(sharpness: Sequence[Array]) -> float:
    """Border between the diffuse and the specular lobes of a collection, by two-means.

    Parameters
    ----------
    sharpness : sequence of (lobe,) ndarray

    Returns
    -------
    float
        Midway between the classes. The split is the best of all, not only a local one.
    """
    x = np.sort(np.concatenate(list(sharpness)))
    if x[0] == x[-1]:
        return float("-inf")
    # Squares within the classes fall with n_a n_b (mean_a - mean_b)^2
    n_low = np.arange(1, x.size)
    total = np.cumsum(x)
    means = total[:-1] / n_low, (total[-1] - total[:-1]) / (x.size - n_low)
    split = int((n_low * (x.size - n_low) * (means[1] - means[0]) ** 2).argmax())
    return float(0.5 * (means[0][split] + means[1][split]))


def lobe_slots(sharpness: Array, border: float, n_diffuse: int) -> NDArray[np.int_]:
    """Slot (lobe,) of each lobe: `n_diffuse` slots lie below the border. May be out of range.

    Parameters
    ----------
    sharpness : (lobe,) ndarray
    border : float
    n_diffuse : int
    """
    rank = np.argsort(np.argsort(sharpness, kind="stable"))
    slots: NDArray[np.int_] = rank + n_diffuse - (sharpness < border).sum()
    return slots


def pad(
    rows: Array, slots: NDArray[np.int_], n_slots: int, variables: Variables
) -> tuple[Array, NDArray[np.bool_]]:
    """Put lobes into slots, and dark lobes into the others.

    Parameters
    ----------
    rows : (lobe, number) ndarray
    slots : (lobe,) ndarray of int
        Without gaps.
    n_slots : int
    variables : Variables

    Returns
    -------
    rows : (slot, number) ndarray
        A dark lobe has no height and no colour, and the shape of the nearest lobe: it is between its neighbours in
        order, and what a blend fades in has that lobe's shape.
    present : (slot,) ndarray of bool
    """
    present = np.zeros(n_slots, dtype=bool)
    present[slots] = True
    lobe_of = np.zeros(n_slots, dtype=int)
    lobe_of[slots] = np.arange(len(rows))
    padded = rows[lobe_of[np.clip(np.arange(n_slots), slots.min(), slots.max())]]
    parts = variables.parts(padded)
    parts.height[~present] = variables.dark
    parts.colour[~present] = 0.0
    return variables.joined(parts), present
