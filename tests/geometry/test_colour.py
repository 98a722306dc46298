"""Spectra to linear sRGB, against sums over the CIE tables at every nanometre."""

import json
from pathlib import Path

import numpy as np
import pytest

from dsbrdf.geometry.colour import srgb_weights

COLOURS = json.loads((Path(__file__).parents[1] / "reference" / "cie.json").read_text())["srgb"]


@pytest.mark.parametrize("case", COLOURS)
def test_colours_of_spectra(case):
    centre, width, *expected = case
    wavelengths = np.arange(380.0, 781.0, 2.0)
    spectrum = 0.05 + np.exp(-0.5 * ((wavelengths - centre) / width) ** 2)
    colour = srgb_weights(wavelengths) @ spectrum
    np.testing.assert_allclose(colour, expected, rtol=0, atol=4e-3 * np.abs(expected).max())


def test_colours_are_linear_between_wavelengths():
    coarse, fine = np.array([400.0, 500.0, 620.0, 700.0]), np.arange(400.0, 701.0)
    spectrum = np.array([0.1, 0.9, 0.3, 0.6])
    at_all = srgb_weights(fine) @ np.interp(fine, coarse, spectrum)
    np.testing.assert_allclose(srgb_weights(coarse) @ spectrum, at_all, rtol=1e-9)
