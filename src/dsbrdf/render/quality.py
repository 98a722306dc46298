"""How different two pictures look: CIEDE2000 and SSIM of tone-mapped pictures.

CIEDE2000: Sharma, Wu and Dalal, Color Res. Appl. 30(1), 2005. One unit is about what can just be told side by side.
SSIM: Wang, Bovik, Sheikh and Simoncelli, IEEE Trans. Image Process. 13(4), 2004, of luminance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.render import picture

__all__ = ["Difference", "ciede2000", "compare", "lab", "ssim"]

Array = NDArray[np.float64]

#: Linear sRGB to XYZ of D65, white at Y = 1 (IEC 61966-2-1).
TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]],
)
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


def lab(rgb: Array) -> Array:
    """CIELAB (..., 3) of linear sRGB (..., 3) in [0, 1], white D65."""
    x, y, z = np.moveaxis(rgb @ (TO_XYZ / TO_XYZ.sum(1, keepdims=True)).T, -1, 0)
    f = [np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29) for t in (x, y, z)]
    return np.stack([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])], axis=-1)


def ciede2000(first: Array, second: Array) -> Array:
    """Colour difference (...) of two CIELAB colours (..., 3)."""
    (l_1, a_1, b_1), (l_2, a_2, b_2) = (np.moveaxis(np.asarray(x, float), -1, 0) for x in (first, second))
    mean_c7 = (0.5 * (np.hypot(a_1, b_1) + np.hypot(a_2, b_2))) ** 7
    g = 0.5 * (1.0 - np.sqrt(mean_c7 / (mean_c7 + 25.0**7)))
    c_1, c_2 = np.hypot((1.0 + g) * a_1, b_1), np.hypot((1.0 + g) * a_2, b_2)
    h_1, h_2 = (np.degrees(np.arctan2(b, (1.0 + g) * a)) % 360.0 for a, b in ((a_1, b_1), (a_2, b_2)))

    # Hues of greys mean nothing: then the other one's holds
    grey = c_1 * c_2 == 0.0
    turn = np.where(grey, 0.0, (h_2 - h_1 + 180.0) % 360.0 - 180.0)
    middle = np.where(grey, h_1 + h_2, (h_1 + 0.5 * ((h_2 - h_1 + 180.0) % 360.0 - 180.0)) % 360.0)
    delta_l, delta_c = l_2 - l_1, c_2 - c_1
    delta_h = 2.0 * np.sqrt(c_1 * c_2) * np.sin(np.radians(turn) / 2.0)

    mean_l, mean_c = 0.5 * (l_1 + l_2), 0.5 * (c_1 + c_2)
    t = 1.0
    for factor, multiple, shift in ((-0.17, 1, -30.0), (0.24, 2, 0.0), (0.32, 3, 6.0), (-0.20, 4, -63.0)):
        t = t + factor * np.cos(np.radians(multiple * middle + shift))
    s_l = 1.0 + 0.015 * (mean_l - 50.0) ** 2 / np.sqrt(20.0 + (mean_l - 50.0) ** 2)
    s_c, s_h = 1.0 + 0.045 * mean_c, 1.0 + 0.015 * mean_c * t
    rotation = 60.0 * np.exp(-(((middle - 275.0) / 25.0) ** 2))
    r = -2.0 * np.sqrt(mean_c**7 / (mean_c**7 + 25.0**7)) * np.sin(np.radians(rotation))
    light, chroma, hue = delta_l / s_l, delta_c / s_c, delta_h / s_h
    return np.asarray(np.sqrt(np.maximum(light**2 + chroma**2 + hue**2 + r * chroma * hue, 0.0)))


def ssim(first: Array, second: Array) -> Array:
    """Structural similarity (height, width) of two pictures with values in [0, 1]."""
    from scipy.ndimage import gaussian_filter

    def mean(x: Array) -> Array:
        return np.asarray(gaussian_filter(x, WINDOW, truncate=3.5))

    m_1, m_2 = mean(first), mean(second)
    v_1, v_2 = mean(first * first) - m_1 * m_1, mean(second * second) - m_2 * m_2
    together = mean(first * second) - m_1 * m_2
    return (2.0 * m_1 * m_2 + C1) * (2.0 * together + C2) / ((m_1**2 + m_2**2 + C1) * (v_1 + v_2 + C2))
