"""Which lobe of one material is which of another, and what stands in for those that are missing (Section 6.C).

The lobes of a channel are ordered by the norm of their gamma curve, from flat to sharp. Materials are laid side by
side at the border between diffuse and specular lobes: lobes of all materials are put in two classes by their norm.
Slots that a material has no lobe for hold a flat lobe.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dsbrdf.paper.curves import CurveBasis

__all__ = ["gamma_norm", "lobe_slots", "pad", "two_class_border"]

Array = NDArray[np.float64]


def gamma_norm(curves: Array, basis: CurveBasis) -> Array:
    """Norm (channel, lobe) of the gamma curves among curves (channel, lobe, function, coefficient): their mean.

    The mean of a function that is not negative is its L1 norm; being linear, it keeps the order of lobes in blends.
    """
    low, high = basis.domain
    mean: Array = curves[:, :, 1] @ basis.gram.sum(0) / (high - low)
    return mean


def two_class_border(norms: Sequence[Array], logarithmic: bool) -> float:
    """Border between the diffuse and the specular lobes of a collection: two-means of the logarithms of their norms.

    Parameters
    ----------
    norms : sequence of (channel, lobe) ndarray
    logarithmic : bool
        Whether the norms are of logarithms already.

    Returns
    -------
    float
        Midway between the classes. The split is the best of all, not only a local one.
    """
    values = np.concatenate([norm.ravel() for norm in norms])
    x = np.sort(values if logarithmic else np.log1p(np.maximum(values, 0.0)))
    if x[0] == x[-1]:
        return float("-inf")
    # Squares within the classes fall with n_a n_b (mean_a - mean_b)^2
    n_low = np.arange(1, x.size)
    total = np.cumsum(x)
    means = total[:-1] / n_low, (total[-1] - total[:-1]) / (x.size - n_low)
    split = int((n_low * (x.size - n_low) * (means[1] - means[0]) ** 2).argmax())
    border = 0.5 * (means[0][split] + means[1][split])
    return float(border if logarithmic else np.expm1(border))


def lobe_slots(norm: Array, border: float, n_diffuse: int) -> NDArray[np.int_]:
    """Slot (channel, lobe) of each lobe: `n_diffuse` slots lie below the border. May be out of range.

    Parameters
    ----------
    norm : (channel, lobe) ndarray
    border : float
    n_diffuse : int
    """
    rank = np.argsort(np.argsort(norm, axis=1, kind="stable"), axis=1)
    below = (norm < border).sum(1, keepdims=True)
    slots: NDArray[np.int_] = rank + n_diffuse - below
    return slots


def pad(curves: Array, slots: NDArray[np.int_], n_slots: int, flat: float) -> tuple[Array, NDArray[np.bool_]]:
    """Put lobes into slots, and flat lobes into the others.

    Parameters
    ----------
    curves : (channel, lobe, function, coefficient) ndarray
    slots : (channel, lobe) ndarray of int
        Without gaps in each channel.
    n_slots : int
    flat : float
        The first function (kappa) of a flat lobe, a constant.

    Returns
    -------
    curves : (channel, slot, function, coefficient) ndarray
        A flat lobe has no height, and the other functions of the channel's nearest lobe: it is between its
        neighbours in order, and what a blend fades in has that lobe's shape.
    present : (channel, slot) ndarray of bool
    """
    n_channels = len(curves)
    channel = np.arange(n_channels)[:, None]
    present = np.zeros((n_channels, n_slots), dtype=bool)
    present[channel, slots] = True
    nearest = np.clip(np.arange(n_slots), slots.min(1, keepdims=True), slots.max(1, keepdims=True))
    lobe_of = np.zeros((n_channels, n_slots), dtype=int)
    lobe_of[channel, slots] = np.arange(curves.shape[1])
    padded = curves[channel, lobe_of[channel, nearest]]
    padded[~present, 0] = flat
    return padded, present
