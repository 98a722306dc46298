"""Whether numbers look like a BRDF in 1/sr in the convention of the package; what does not is said, not changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import half_diff

Array: TypeAlias = NDArray[np.float64]
__all__ = ["doubts"]

#: Fewer samples say nothing, and of more than these every few are looked at.
LEAST, MOST = 6, 5_000
#: Of the brightest samples, and how much brighter than the median they must be to be a peak.
BRIGHT, PEAK = 0.05, 2.0
#: Albedo far from the mirror direction above which values can hardly be in 1/sr.
ALBEDO = 1.2
#: Angles in degrees: a half vector that far from the normal is not in the peak; a peak that far from the mirror
#: direction is none.
OFF_PEAK, FAR = 40.0, 10.0
#: Largest deviation from proportionality to the cosine, and least range of cosines, of values that hold it.
PROPORTIONAL, RANGE = 0.03, 0.5
#: Ratio of values at one pair of angles above which turning the sample matters.
TURNED = 1.25


def doubts(
    wi: Array,
    wo: Array,
    values: Array,
    channels: Sequence[str],
    *,
    azimuth_is_known: bool = False,
    scale_is_known: bool = False,
) -> list[str]:
    """What speaks against taking these numbers as they are, a sentence each.

    Parameters
    ----------
    wi, wo : (n, 3) ndarray
    values : (n, channel) ndarray
        NaN where invalid.
    channels : sequence of str
    azimuth_is_known, scale_is_known : bool, optional
        What the caller has said, and is not doubted.
    """
    seen = np.isfinite(values)
    found = [
        f"channel {name} holds no valid value: it is dark in what comes of it. Leave it out with ignore=['{name}'] "
        f"(--ignore {name})."
        for name, some in zip(channels, np.asarray(seen.any(axis=0)).tolist(), strict=True)
        if not some
    ]
    rows = np.flatnonzero(seen.any(1))
    rows = rows[:: -(-len(rows) // MOST) or 1]
    if len(rows) < LEAST:
        return found
    wi, wo = wi[rows], wo[rows]
    grey = np.nanmean(np.where(seen[rows], values[rows], np.nan), axis=1)
    found += _turned(wi, wo, grey)
    if not azimuth_is_known:
        found += _toward_light(wi, wo, grey)
    if not scale_is_known:
        found += _too_bright(wi, wo, grey) + _times_cosine(wi, wo, grey)
    return found


def _half_angle(wi: Array, wo: Array) -> Array:
    return np.rad2deg(half_diff.from_directions(wi, wo)[0])


def _toward_light(wi: Array, wo: Array, grey: Array) -> list[str]:
    """The brightest samples are near the mirror direction, not mirrored to the side of the light."""
    n = max(3, int(np.ceil(BRIGHT * len(grey))))
    top = np.argsort(grey)[-n:]
    if not grey[top].mean() > PEAK * np.median(grey) > 0.0:
        return []
    here = np.average(_half_angle(wi[top], wo[top]))
    there = np.average(_half_angle(wi[top], wo[top] * (-1.0, -1.0, 1.0)))
    if here < there + FAR:
        return []
    return [
        f"the brightest samples are {here:.0f} degrees off the mirror direction, on the side of the light. If "
        f"the mirror "
        "direction is at phi = 0 in this file, or theta has the other sign, say phi_offset=180 (--phi-offset "
        "180); if the "
        "material throws light back, phi_offset=0."
    ]


def _too_bright(wi: Array, wo: Array, grey: Array) -> list[str]:
    """Far from the mirror direction no material is brighter than white."""
    off = _half_angle(wi, wo) > OFF_PEAK
    if off.sum() < LEAST:
        return []
    albedo = np.pi * float(np.median(grey[off]))
    if albedo <= ALBEDO:
        return []
    what, scale = (
        ("percent", 0.01 / np.pi) if albedo / np.pi > 2.0 * ALBEDO else ("reflectance factors", 1.0 / np.pi)
    )
    return [
        f"far from the mirror direction the values are {albedo:.2g} times those of a white surface. If they are "
        f"{what}, say "
        f"scale={scale:.4g} (--scale {scale:.4g}); if they are in 1/sr, scale=1."
    ]


def _times_cosine(wi: Array, wo: Array, grey: Array) -> list[str]:
    """Values of a matte material do not fall with the cosine of the view."""
    cosine = wo[:, 2]
    off = (_half_angle(wi, wo) > 0.5 * OFF_PEAK) & (cosine > 0.05) & (grey > 0.0)
    if off.sum() < LEAST or np.ptp(cosine[off]) < RANGE:
        return []
    ratio = np.log(grey[off] / cosine[off])
    plain = np.log(grey[off])
    if np.std(ratio) > PROPORTIONAL or np.std(plain) < 5.0 * np.std(ratio):
        return []
    return [
        "the values fall as the cosine of theta_o does. If they are BRDF times cosine, say cosine=True "
        "(--cosine); if they "
        "are in 1/sr, scale=1."
    ]


def _turned(wi: Array, wo: Array, grey: Array) -> list[str]:
    """Turning the sample, or the plane of incidence over it, changes nothing."""
    phi_i = np.arctan2(wi[:, 1], wi[:, 0])
    oblique = (wi[:, 2] < 0.999) & (grey > 0.0)
    if oblique.sum() < LEAST or np.ptp(phi_i[oblique]) < 0.01:
        return []
    relative = np.cos(np.arctan2(wo[:, 1], wo[:, 0]) - phi_i)
    key = np.round(np.stack([wi[:, 2], wo[:, 2], relative], axis=-1)[oblique], 4)
    _, group, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    log = np.log(grey[oblique])
    mean = np.bincount(group.ravel(), log) / count
    spread = np.sqrt(np.bincount(group.ravel(), (log - mean[group.ravel()]) ** 2) / count)
    several = count > 1
    if several.sum() < LEAST or np.median(spread[several]) < np.log(TURNED):
        return []
    return [
        f"values at the same angles differ by a factor of {np.exp(np.median(spread[several])):.2f} as the "
        f"sample is turned: it is "
        "anisotropic, and the fit is of their mean."
    ]
