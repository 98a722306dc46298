"""Fits of slices to real measurements (RGL database), on a coarse grid of half and difference angles."""

import warnings

import numpy as np
import pytest

from dsbrdf import tabulate
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.paper import ConvergenceWarning, fit_slices

# Relative RMS with three azimuthal lobes as measured on this grid, and 5 % more
AZIMUTHAL = {
    "aurora_white": 0.0641,
    "cc_ibiza_sunset": 0.0332,
    "chm_orange": 0.4156,
    "ilm_solo_m_68": 0.1913,
    "irid_flake_paint1": 0.0490,
    "vch_silk_blue": 0.0086,
}


@pytest.mark.shared
@pytest.mark.parametrize("name", AZIMUTHAL)
def test_reaches_the_floor_and_goes_below(data, name):
    measured = read_rgl(data / "data" / "rgl" / f"{name}_rgb.bsdf")

    def reflectance(wi, wo):
        """Mean of the reciprocal pair; invalid beyond 80 degrees, where measurements end, and where negative."""
        value = 0.5 * (measured.eval(wi, wo) + measured.eval(wo, wi))
        value[np.minimum(wi[..., 2], wo[..., 2]) < np.cos(np.deg2rad(80))] = np.nan
        return value

    table = tabulate(reflectance, name, shape=(90, 18, 60))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        plain = fit_slices(table, 3, perimeter_mask=False).errors
        azimuthal = fit_slices(table, 3, azimuthal=True, perimeter_mask=False).errors
    assert plain.rel_rms <= 1.05 * plain.monotone_floor
    assert azimuthal.rel_rms < 0.75 * plain.bivariate_floor
    assert azimuthal.rel_rms < AZIMUTHAL[name]
