"""Linear sRGB to spectra: three smooth spectra, of which a colour is the sum.

They lie between 0 and 1, add up to 1 and have, under the illuminant D65 and for the CIE 1931 observer, the colours of
the primaries of sRGB. The map is linear, so it takes values above 1, as reflectances in 1/sr are; a positive colour
has a positive spectrum. After Mallett and Yuksel, *Spectral Primary Decomposition for Rendering with sRGB
Reflectance*, EGSR 2019; `benchmarks/spectral_basis.py` computes the table.
"""

from __future__ import annotations

import numpy as np

__all__ = ["BASIS", "WAVELENGTHS"]

#: Nodes in nm; linear between them, constant beyond.
WAVELENGTHS = np.arange(420.0, 681.0, 20.0)
#: Spectra (wavelength, 3) of the red, green and blue primary.
BASIS = np.array(
    [
        [0.05392, 0.0, 0.94608],
        [0.029997, 0.0, 0.970003],
        [0.004674, 0.0, 0.995326],
        [0.0, 0.258755, 0.741245],
        [0.0, 0.746984, 0.253016],
        [0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.134628, 0.793525, 0.071847],
        [0.797499, 0.20018, 0.002321],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
    ]
)
