"""How different two pictures look: CIEDE2000 and SSIM of tone-mapped pictures.

CIEDE2000: see `dsbrdf.geometry.colour_difference`.
SSIM: Wang, Bovik, Sheikh and Simoncelli, IEEE Trans. Image Process. 13(4), 2004, of luminance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry.colour_difference import TO_XYZ, ciede2000, lab
from dsbrdf.render import picture

__all__ = ["Difference", "ciede2000", "compare", "lab", "ssim"]

Array = NDArray[np.float64]

#: Standard deviation of SSIM's window in pixels, and its constants for values in [0, 1].
WINDOW, C1, C2 = 1.5, 0.01**2, 0.03**2


@dataclass(frozen=True, eq=False)
class Difference:
    """How a picture differs from a reference.

    Parameters
    ----------
    map : (height, width) ndarray
        CIEDE2000 of each pixel; NaN off the object.
    mean, worst : float
        Mean and 99th percentile of the map.
    ssim : float
        Mean over the object.
    """

    map: Array
    mean: float
    worst: float
    ssim: float


def compare(image: Array, reference: Array, exposure: float) -> Difference:
    """Difference of two pictures (height, width, 4) of linear RGB and coverage, both under `exposure`."""
    inside = reference[..., 3] > 0.5
    shown, wanted = (np.clip(exposure * x[..., :3], 0.0, 1.0) for x in (image, reference))
    delta = np.where(inside, ciede2000(lab(shown), lab(wanted)), np.nan)
    similarity = ssim(*(picture.encode(x @ TO_XYZ[1]) for x in (shown, wanted)))
    found = delta[inside]
    return Difference(
        delta, float(found.mean()), float(np.percentile(found, 99.0)), float(similarity[inside].mean())
    )


def ssim(first: Array, second: Array) -> Array:
    """Structural similarity (height, width) of two pictures with values in [0, 1]."""
    from scipy.ndimage import gaussian_filter

    def mean(x: Array) -> Array:
        return np.asarray(gaussian_filter(x, WINDOW, truncate=3.5))

    m_1, m_2 = mean(first), mean(second)
    v_1, v_2 = mean(first * first) - m_1 * m_1, mean(second * second) - m_2 * m_2
    together = mean(first * second) - m_1 * m_2
    return (2.0 * m_1 * m_2 + C1) * (2.0 * together + C2) / ((m_1**2 + m_2**2 + C1) * (v_1 + v_2 + C2))
