"""How different two colours look: CIEDE2000 (Sharma, Wu and Dalal, Color Res. Appl. 30(1), 2005) of CIELAB.

One unit is about what can just be told side by side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["TO_XYZ", "ciede2000", "lab"]

Array = NDArray[np.float64]

#: Linear sRGB to XYZ of D65, white at Y = 1 (IEC 61966-2-1).
TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]],
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
