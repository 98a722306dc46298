"""Reference colours of `dsbrdf.geometry.colour`, written to `cie.json` beside this file.

Run with `python tests/reference/cie.py`; it needs colour-science (0.4) and takes seconds. Each line is centre and width
in nm of a Gaussian on a base of 0.05, from 380 to 780 nm, and its linear sRGB under D65: sums at every nm over the CIE
1931 2-degree observer, divided by those of a white surface.
"""

import json
from pathlib import Path

import colour
import numpy as np

NM = np.arange(380, 781)
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


def main():
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    seen = np.array([observer[nm] for nm in NM])
    d65 = colour.SDS_ILLUMINANTS["D65"]
    light = seen * np.interp(NM, d65.wavelengths, d65.values)[:, None]
    white = XYZ_TO_RGB @ light.sum(0)
    colours = []
    for centre in range(400, 701, 50):
        for width in (15, 40, 100):
            spectrum = 0.05 + np.exp(-0.5 * ((NM - centre) / width) ** 2)
            rgb = XYZ_TO_RGB @ (light.T @ spectrum) / white
            colours.append([centre, width, *(float(f"{x:.9g}") for x in rgb)])
    text = json.dumps({"colour-science": colour.__version__, "srgb": colours}).replace("], [", "],\n[")
    Path(__file__).with_suffix(".json").write_text(text + "\n")


if __name__ == "__main__":
    main()
