"""Lobes where nothing is fitted: no higher than what was measured near the pole."""

import numpy as np
import pytest

from dsbrdf import _core, fit, half_diff, tabulate
from dsbrdf.paper.collapse import MOMENTS, slice_profiles
from dsbrdf.paper.fit_slices import fit_profiles

PEAK, WIDTH = 500.0, np.deg2rad(1.0)


def plateau(wi, wo):
    """Flat up to a degree, and steep from there on: what is fitted asks for a far higher peak."""
    theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
    return (PEAK * np.minimum((WIDTH / np.maximum(theta_h, 1e-9)) ** 3, 1.0) * (1.0 + theta_d) + 0.1)[
        ..., None
    ] * [1.0, 0.5]


@pytest.fixture(scope="module")
def table():
    return tabulate(plateau, "plateau", shape=(90, 6, 12))


@pytest.mark.parametrize("loss", ["l2", "log"])
def test_no_lobe_goes_above_what_was_measured(table, loss):
    fitted = fit(table, 3, n_slices=6, loss=loss)
    brightest = np.nanmax(table.values, axis=(0, 2))
    heights = np.expm1(fitted.model.kappa).max(-1)
    assert (heights <= brightest * (1.0 + 1e-9)).all()
    # As high as that, so the limit is what holds it
    assert (heights > 0.5 * brightest).any()


def test_without_the_pole_a_lobe_overshoots(table):
    profiles = slice_profiles(table, n_slices=6)
    (kappa, _, _), _ = fit_profiles(profiles, 3)
    assert np.expm1(kappa).max() > 3.0 * np.nanmax(table.values)


def test_slices_with_nothing_near_the_pole_are_as_before(table):
    profiles = slice_profiles(table, n_slices=6)
    np.testing.assert_array_equal(
        fit_profiles(profiles, 2)[0], fit_profiles(profiles, 2, near_pole=profiles)[0]
    )


def test_the_kernel_wants_a_height_for_each_slice():
    moments, angles = np.ones((2, 1, 8, len(MOMENTS))), np.zeros((2, 8))
    with pytest.raises(ValueError, match=r"'max_height' must have shape \[2, 1\], got \[2\]"):
        _core.fit(
            moments, angles, angles, n_lobes=1, method="joint", azimuthal=False, follow=True,
            log_offset=None, max_height=np.ones(2),
        )  # fmt: skip
