"""Spectra to linear sRGB, against sums over the CIE tables at every nanometre."""

import json
from pathlib import Path

import numpy as np
import pytest

from dsbrdf.geometry.colour import rgb_weights, srgb_weights

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


def test_colours_of_channels_by_their_names():
    np.testing.assert_array_equal(rgb_weights("bgr") @ [0.8, 0.5, 0.2], [0.2, 0.5, 0.8])
    np.testing.assert_array_equal(rgb_weights(["v"]) @ [0.3], [0.3, 0.3, 0.3])
    nm = [f"{w}nm" for w in range(400, 701, 10)]
    np.testing.assert_allclose(rgb_weights(nm) @ np.full(31, 0.3 / np.pi), 0.3 / np.pi, rtol=1e-12)
    red = np.where(np.arange(400, 701, 10) >= 600, 1.0, 0.2)
    r, g, b = rgb_weights(nm) @ red
    assert r > g
    assert r > b
    np.testing.assert_allclose(rgb_weights(nm[::-1]) @ red[::-1], [r, g, b], rtol=1e-12)
    # White of D65, whose luminance is 1
    np.testing.assert_allclose(rgb_weights(["Z", "X", "Y"]) @ [1.0888, 0.9505, 1.0], 1.0, atol=1e-3)


@pytest.mark.parametrize("names", [["a", "b"], ["450nm", "b", "g"], ["450nm", "450"], ["r", "g"], ["X", "Y"]])
def test_channels_that_tell_no_colour_are_refused(names):
    with pytest.raises(
        ValueError, match="tell no colour: expected r, g, b; X, Y, Z; wavelengths such as 450nm"
    ):
        rgb_weights(names)
    with pytest.raises(ValueError, match="must cover 490 to 600 nm to make a colour, got 700 to 900 nm"):
        rgb_weights(["700nm", "900nm"])
