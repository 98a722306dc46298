"""Spectral reflectance to linear sRGB, with the CIE 1931 2-degree observer under the illuminant D65.

Colour matching functions (CIE 018:2019) and D65 (CIE 15:2018) are given every 10 nm. Between them D65 is linear, as the
standard has it, and the functions are cubic: on smooth spectra the colour is that of the tables at every nm to
4e-4 of the largest channel in 95 of 100 cases, and to 4e-3 at worst.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LUMINANCE", "rgb_weights", "srgb_weights", "wavelength"]

#: Wavelength in nm, D65, and the colour matching functions x, y and z.
TABLE = """
380 49.9755 0.001368 3.9e-05 0.00645
390 54.6482 0.004243 0.00012 0.02005
400 82.7549 0.01431 0.000396 0.06785
410 91.486 0.04351 0.00121 0.2074
420 93.4318 0.1344 0.004 0.6456
430 86.6823 0.2839 0.0116 1.386
440 104.865 0.3483 0.023 1.747
450 117.008 0.3362 0.038 1.772
460 117.812 0.2908 0.06 1.669
470 114.861 0.1954 0.09098 1.288
480 115.923 0.09564 0.139 0.813
490 108.811 0.03201 0.208 0.4652
500 109.354 0.0049 0.323 0.272
510 107.802 0.0093 0.503 0.1582
520 104.79 0.06327 0.71 0.07825
530 107.689 0.1655 0.862 0.04216
540 104.405 0.2904 0.954 0.0203
550 104.046 0.4334 0.995 0.00875
560 100 0.5945 0.995 0.0039
570 96.3342 0.7621 0.952 0.0021
580 95.788 0.9163 0.87 0.00165
590 88.6856 1.026 0.757 0.0011
600 90.0062 1.062 0.631 0.0008
610 89.5991 1.003 0.503 0.00034
620 87.6987 0.8544 0.381 0.00019
630 83.2886 0.6424 0.265 5e-05
640 83.6992 0.4479 0.175 2e-05
650 80.0268 0.2835 0.107 0
660 80.2146 0.1649 0.061 0
670 82.2778 0.0874 0.032 0
680 78.2842 0.04677 0.017 0
690 69.7213 0.0227 0.00821 0
700 71.6091 0.01136 0.004102 0
710 74.349 0.00579 0.002091 0
720 61.604 0.002899 0.001047 0
730 69.8856 0.00144 0.00052 0
740 75.087 0.0006901 0.0002492 0
750 63.5927 0.0003323 0.00012 0
760 46.4182 0.0001662 6e-05 0
770 66.8054 8.308e-05 3e-05 0
780 63.3828 4.151e-05 1.499e-05 0
"""
#: IEC 61966-2-1: XYZ to linear sRGB.
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
#: Luminance of linear sRGB (Rec. 709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
#: A spectrum must cover at least these, in nm: beyond, 1 % of the light is seen.
VISIBLE = (410.0, 680.0)
#: Three lines of an instrument must span at least these, in nm, to be held constant beyond.
LINES = (490.0, 600.0)
_WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*(?:nm)?")


def wavelength(name: str) -> float | None:
    """Wavelength in nm that a channel is named after, as in 450nm or 450; None if it is not."""
    match = _WAVELENGTH.fullmatch(name.strip())
    return float(match[1]) if match is not None and float(match[1]) >= 100.0 else None


def rgb_weights(channels: Sequence[str]) -> NDArray[np.float64]:
    """Weights (3, channel) that take values of named channels to linear sRGB: wherever a colour is needed.

    Parameters
    ----------
    channels : sequence of str
        r, g and b in any order; X, Y and Z of the CIE 1931 observer under D65; wavelengths, as in 450nm, in any
        order; a
        single channel of any name, which is grey.

    Returns
    -------
    (3, channel) ndarray
        Of wavelengths as `srgb_weights`; those of a few lines that span `LINES` are held constant beyond.

    Raises
    ------
    ValueError
        If the channels tell no colour.

    Examples
    --------
    >>> rgb_weights(["b", "g", "r"]) @ [0.8, 0.5, 0.2]
    array([0.2, 0.5, 0.8])
    >>> (rgb_weights(["450nm", "550nm", "650nm"]) @ [0.3, 0.3, 0.3]).round(6)
    array([0.3, 0.3, 0.3])
    """
    names = list(channels)
    if len(names) == 1:
        return np.ones((3, 1))
    if sorted(names) == ["b", "g", "r"]:
        return np.stack([np.eye(3)[names.index(name)] for name in "rgb"])
    if sorted(names) == ["X", "Y", "Z"]:
        return XYZ_TO_RGB[:, ["XYZ".index(name) for name in names]]
    nm = np.array([wavelength(name) or np.nan for name in names])
    if np.isnan(nm).any() or len(np.unique(nm)) != len(nm):
        raise ValueError(
            f"the channels {', '.join(names):.100} tell no colour: expected r, g, b; X, Y, Z; wavelengths such "
            f"as 450nm; or a "
            "single channel."
        )
    order = np.argsort(nm)
    weights = np.empty((3, len(nm)))
    weights[:, order] = srgb_weights(nm[order], span=LINES)
    return weights


def srgb_weights(wavelengths: ArrayLike, *, span: tuple[float, float] = VISIBLE) -> NDArray[np.float64]:
    """Weights (channel, wavelength) that take reflectances at some wavelengths to linear sRGB.

    Parameters
    ----------
    wavelengths : (wavelength,) array_like, nm
        Ascending. The spectrum is linear between them, and constant beyond.
    span : (float, float), optional
        Wavelengths in nm that they must span.

    Returns
    -------
    (3, wavelength) ndarray
        A reflectance that is the same at all wavelengths is the same in all channels.

    Raises
    ------
    ValueError
        If the wavelengths are not ascending, or do not cover `span`.
    """
    from scipy.interpolate import CubicSpline

    wavelengths = np.asarray(wavelengths, dtype=np.float64)
    if wavelengths.ndim != 1 or wavelengths.size < 2 or (np.diff(wavelengths) <= 0.0).any():
        raise ValueError(f"wavelengths must be ascending, got {np.array2string(wavelengths, threshold=8)}.")
    if wavelengths[0] > span[0] or wavelengths[-1] < span[1]:
        raise ValueError(
            f"wavelengths must cover {span[0]:g} to {span[1]:g} nm to make a colour, got "
            f"{wavelengths[0]:g} to {wavelengths[-1]:g} nm. Fit the wavelengths as channels instead."
        )
    nm, d65, *matching = np.array(TABLE.split(), dtype=np.float64).reshape(-1, 5).T
    fine = np.arange(nm[0], nm[-1] + 0.5)
    seen = CubicSpline(nm, np.transpose(matching))(fine) * np.interp(fine, nm, d65)[:, None]
    shares = np.stack([np.interp(fine, wavelengths, hat) for hat in np.eye(wavelengths.size)], axis=1)
    rgb = XYZ_TO_RGB @ seen.T @ shares
    weights: NDArray[np.float64] = rgb / rgb.sum(1, keepdims=True)
    return weights
