"""Slices: which rows and theta_h they hold, and the collapse over phi_d by brute force."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from slices import profile_of

from dsbrdf import half_diff, read_merl
from dsbrdf.paper import slice_profiles
from dsbrdf.paper.collapse import (
    MIN_THETA_H,
    MOMENTS,
    SliceProfile,
    slice_rows,
    stack_profiles,
)


def brute_moments(f, phi_d):
    """The six moments of values (phi_d,), sample by sample."""
    sums = np.zeros(6)
    for value, phi in zip(f, phi_d, strict=True):
        if np.isfinite(value):
            c = np.cos(2 * phi)
            sums += [1.0, value, value**2, c, c**2, value * c]
    return sums


def kept(profile, channel=0):
    return np.flatnonzero(profile.count[channel] > 0)


def unmasked(measured, **options):
    return slice_profiles(measured, min_theta_h=0.0, perimeter_mask=False, **options)


# Which rows and which theta_h


def test_eighteen_slices_are_every_fifth_row_and_ninety_every_row():
    assert_array_equal(slice_rows(90), np.arange(0, 90, 5))
    assert_array_equal(slice_rows(90, 90), np.arange(90))
    assert_array_equal(slice_rows(18), np.arange(18))
    assert_array_equal(slice_rows(90, 1), [0])
    assert_array_equal(slice_rows(7, 3), [0, 2, 4])
    assert_array_equal(slice_rows(7, 5), [0, 1, 2, 4, 5])


@given(n_rows=st.integers(1, 400), data=st.data())
def test_any_number_of_slices_takes_different_rows_in_order(n_rows, data):
    n_slices = data.draw(st.integers(1, n_rows))
    rows = slice_rows(n_rows, n_slices)
    assert len(rows) == n_slices
    assert rows[0] == 0
    assert rows[-1] < n_rows
    assert n_rows - rows[-1] <= -(-n_rows // n_slices)
    assert (np.diff(rows) > 0).all()
    assert np.ptp(np.diff(rows)) <= 1 if n_slices > 1 else True


@pytest.mark.parametrize("n_slices", [0, -1, 19])
def test_more_slices_than_rows_or_none_are_refused(small_table, n_slices):
    text = rf"^'n_slices' must be between 1 and the table's 18 rows, got {n_slices}\.$"
    with pytest.raises(ValueError, match=text):
        slice_profiles(small_table, n_slices=n_slices)


@pytest.mark.parametrize("convention", ["centre", "edge"])
def test_slices_of_a_merl_file_are_five_degrees_apart(merl_file, convention):
    measured = read_merl(merl_file, convention=convention)
    first = 0.5 if convention == "centre" else 0.0
    profiles = slice_profiles(measured)
    assert_allclose(np.degrees([p.theta_d for p in profiles]), first + 5 * np.arange(18), rtol=1e-13)
    assert all(isinstance(p.theta_d, float) for p in profiles)
    everything = slice_profiles(measured, n_slices=90)
    assert_allclose(np.degrees([p.theta_d for p in everything]), first + np.arange(90), rtol=1e-13)
    assert_array_equal(everything[5].moments, profiles[1].moments)


def test_samples_nearer_to_the_pole_than_one_degree_are_left_out(merl_file):
    # Row 9 of centres is at 9.5^2 / 90 = 1.003 degrees, row 10 of edges at 1.11, row 9 at 0.9
    for convention, first in (("centre", 9), ("edge", 10)):
        profile = slice_profiles(read_merl(merl_file, convention=convention))[0]
        assert kept(profile)[0] == first
        assert np.degrees(profile.theta_h[first - 1]) < 1.0 <= np.degrees(profile.theta_h[first])
    assert np.degrees(MIN_THETA_H) == 1.0


@pytest.mark.parametrize("min_theta_h", [0.0, 0.3, np.pi / 2])
def test_min_theta_h_keeps_what_is_at_or_above_it(small_table, min_theta_h):
    profile = slice_profiles(small_table, min_theta_h=min_theta_h, perimeter_mask=False)[0]
    expected = np.flatnonzero((small_table.theta_h >= min_theta_h) & small_table.valid[:, 0, :, 0].any(1))
    assert_array_equal(kept(profile), expected)
    exactly = small_table.theta_h[4]
    assert kept(slice_profiles(small_table, min_theta_h=exactly)[0])[0] == 4


def test_cutting_a_slice_is_the_same_as_leaving_samples_out(damaged_table):
    exactly = damaged_table.theta_h[4]
    for whole, without in zip(
        unmasked(damaged_table),
        slice_profiles(damaged_table, min_theta_h=exactly, perimeter_mask=False),
        strict=True,
    ):
        cut = whole.cut(exactly)
        assert_array_equal(cut.moments, without.moments)
        assert_array_equal(cut.theta_h, whole.theta_h)
        assert cut.theta_d == whole.theta_d


def test_perimeter_mask_leaves_whole_circles_of_phi_d(make_table):
    table = make_table(1, shape=(30, 30, 12))
    for profile in slice_profiles(table, n_slices=30, min_theta_h=0.0):
        inside = table.theta_h < np.pi / 2 - profile.theta_d
        assert_array_equal(profile.count[0], np.where(inside, 12, 0))


def test_without_perimeter_mask_all_valid_entries_count(make_table):
    table = make_table(1, shape=(30, 30, 12))
    profiles = unmasked(table, n_slices=30)
    assert sum(p.count.sum() for p in profiles) == table.valid.sum()
    masked = slice_profiles(table, n_slices=30, min_theta_h=0.0)
    assert sum(p.count.sum() for p in masked) < table.valid.sum()


@pytest.mark.parametrize("step", [1, 2, 5, 100])
def test_theta_h_step_keeps_every_such_row(small_table, step):
    profile = unmasked(small_table, theta_h_step=step)[0]
    everything = unmasked(small_table)[0]
    rows = np.arange(12) % step == 0
    assert_array_equal(profile.moments[:, rows], everything.moments[:, rows])
    assert not profile.moments[:, ~rows].any()
    assert_array_equal(profile.theta_h, small_table.theta_h)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"theta_h_step": 0}, r"^'theta_h_step' must be at least 1, got 0\.$"),
        ({"theta_h_step": -2}, r"^'theta_h_step' must be at least 1, got -2\.$"),
        ({"min_theta_h": 1.7}, r"^'min_theta_h' must lie in \[0, pi/2\] radians, got 1\.7\. Degrees\?"),
        ({"min_theta_h": np.nan}, r"^'min_theta_h' must lie in \[0, pi/2\] radians, got nan\."),
    ],
)
def test_options_out_of_range_are_refused(small_table, options, text):
    with pytest.raises(ValueError, match=text):
        slice_profiles(small_table, **options)


# Collapse


def test_moments_are_the_sums_over_valid_phi_d_by_brute_force(damaged_table):
    profiles = unmasked(damaged_table)
    for row, profile in enumerate(profiles):
        assert profile.moments.shape == (3, 12, len(MOMENTS))
        for h, channel in np.ndindex(12, 3):
            expected = brute_moments(damaged_table.values[h, row, :, channel], damaged_table.phi_d)
            assert_allclose(profile.moments[channel, h], expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("n_channels", [1, 5])
@pytest.mark.parametrize("n_phi", [1, 2, 3, 4, 5, 7])
def test_moments_of_any_number_of_channels_and_phi_d(make_table, n_channels, n_phi):
    table = make_table(n_channels, shape=(6, 4, n_phi))
    for row, profile in enumerate(unmasked(table, n_slices=4)):
        assert profile.moments.shape == (n_channels, 6, 6)
        for h, channel in np.ndindex(6, n_channels):
            expected = brute_moments(table.values[h, row, :, channel], table.phi_d)
            assert_allclose(profile.moments[channel, h], expected, rtol=1e-13, atol=1e-14)


def test_moments_of_a_mapped_file(merl_file):
    measured = read_merl(merl_file)
    rows = slice_rows(90)
    values = measured.rows(rows)
    valid = np.isfinite(values)
    f = np.where(valid, values, 0.0)
    c = valid * np.cos(2 * measured.phi_d)
    expected = np.stack([x.sum(-1) for x in (valid, f, f * f, c, c * c, f * c)], axis=-1)
    moments = measured.moments(rows)
    assert_array_equal(moments[..., 0], np.moveaxis(expected, 2, 0)[..., 0])
    assert_allclose(moments, np.moveaxis(expected, 2, 0), rtol=1e-11, atol=1e-10)


def test_absurd_numbers_under_the_mask_leave_no_trace(small_table):
    planes = small_table.planes.copy()
    planes[:, 0] = 1e300
    spoilt = dataclasses.replace(small_table, planes=planes)
    for got, want in zip(
        slice_profiles(spoilt, min_theta_h=0.1), slice_profiles(small_table, min_theta_h=0.1), strict=True
    ):
        assert_array_equal(got.moments, want.moments)


def test_a_slice_without_a_valid_entry_is_empty(small_table):
    planes = small_table.planes.copy()
    planes[:, :, 4] = -1.0
    profile = slice_profiles(dataclasses.replace(small_table, planes=planes))[4]
    assert not profile.moments.any()
    assert np.isnan(profile.mean).all()
    assert np.isnan(profile.azimuthal_amplitude).all()
    assert_array_equal(profile.energy, [0.0, 0.0, 0.0])
    # Beyond 89 degrees the perimeter mask and the one degree leave nothing
    assert not slice_profiles(small_table, min_theta_h=0.2)[17].moments.any()


# What a profile tells


def test_mean_and_energy_are_those_of_the_valid_samples(damaged_table):
    for row, profile in enumerate(unmasked(damaged_table)):
        f = np.moveaxis(damaged_table.values[:, row], -1, 0)
        some = np.isfinite(f).any(-1)
        assert_allclose(profile.mean[some], [np.nanmean(line) for line in f[some]], rtol=1e-13)
        assert np.isnan(profile.mean[~some]).all()
        assert_allclose(profile.energy, np.nansum(f**2, axis=(1, 2)), rtol=1e-13)


def test_azimuthal_amplitude_is_that_of_least_squares(damaged_table):
    told = 0
    for row, profile in enumerate(unmasked(damaged_table)):
        amplitude = profile.azimuthal_amplitude
        for h, channel in np.ndindex(12, 3):
            f = damaged_table.values[h, row, :, channel]
            c = np.cos(2 * damaged_table.phi_d[np.isfinite(f)])
            if c.size and np.ptp(c) > 1e-6:
                basis = np.stack([np.ones_like(c), c], axis=1)
                expected = np.linalg.lstsq(basis, f[np.isfinite(f)], rcond=None)[0][1]
                assert_allclose(amplitude[channel, h], expected, rtol=1e-9, atol=1e-12)
                told += 1
            else:
                assert np.isnan(amplitude[channel, h])
    assert 300 < told < 18 * 12 * 3


def test_azimuthal_amplitude_of_a_cosine_is_its_own(small_table):
    planes = 2.0 + 0.7 * np.cos(2 * small_table.phi_d) + np.zeros(small_table.planes.shape)
    profile = unmasked(dataclasses.replace(small_table, planes=planes))[3]
    assert_allclose(profile.azimuthal_amplitude, 0.7, rtol=1e-13)
    assert_allclose(profile.mean, 2.0, rtol=1e-13)


def test_stacking_fills_short_slices_with_empty_theta_h(rng):
    short = profile_of(0.1, [0.5, 0.2], [0.0, 1.0], rng.random((2, 3)))
    long = profile_of(0.7, [0.5, 0.2, 0.9, 0.1], np.zeros(4), rng.random((4, 3)))
    theta_d, theta_h, moments = stack_profiles([short, long])
    assert_array_equal(theta_d, [0.1, 0.7])
    assert_array_equal(theta_h, [[0.2, 0.5, 0.0, 0.0], [0.1, 0.2, 0.5, 0.9]])
    assert moments.shape == (2, 3, 4, 6)
    assert_array_equal(moments[0, :, :2], short.moments)
    assert not moments[0, :, 2:].any()
    assert_array_equal(moments[1], long.moments)


def test_fitted_theta_h_have_both_directions_above_the_horizon(small_table):
    for profile in slice_profiles(small_table, min_theta_h=0.0):
        theta_h = profile.theta_h[kept(profile)]
        wi, wo = half_diff.to_directions(theta_h[:, None], profile.theta_d, np.linspace(0, np.pi, 50))
        assert (wi[..., 2] > 0).all()
        assert (wo[..., 2] > 0).all()


def test_a_profile_is_frozen():
    profile = SliceProfile(0.1, np.zeros(1), np.zeros((1, 1, 6)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        profile.theta_d = 0.2
