"""`MeasuredBRDF.eval`: a table between its nodes, at its ends, around phi_d, and where entries are invalid."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import MeasuredBRDF, half_diff, tabulate
from dsbrdf.geometry.grids import cell_angles
from dsbrdf.measured import reflectance
from dsbrdf.measured.lookup import fill_invalid


def directions(rng, n, lowest=0.02):
    z, phi = rng.uniform(lowest, 1.0, (2, n)), rng.uniform(-np.pi, np.pi, (2, n))
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=-1)


def multilinear(h, d, phi):
    """Values at half and difference angles that the interpolation has exactly."""
    base = (1.0 + 2.0 * np.sqrt(h)) * (3.0 - d) * (2.0 + np.abs(phi % np.pi - np.pi / 2))
    return base[..., None] * np.array([1.0, 0.5])


def test_values_at_the_nodes_are_those_of_the_table(damaged_table):
    h, d, phi = damaged_table.theta_h, damaged_table.theta_d, damaged_table.phi_d
    wi, wo = half_diff.to_directions(h[:, None, None], d[:, None], phi)
    value = damaged_table.eval(wi, wo)
    known = damaged_table.valid & ((wi[..., 2] > 0) & (wo[..., 2] > 0))[..., None]
    assert known.mean() > 0.3
    assert_allclose(value[known], damaged_table.values[known], rtol=1e-9, atol=1e-12)


def test_between_the_nodes_it_is_linear_in_each_coordinate(rng):
    # Nodes at phi_d = 0 and pi/2, where the values have their kinks
    h, d, phi = angles = cell_angles("edge", (9, 10, 12))
    planes = np.moveaxis(multilinear(*np.meshgrid(*angles, indexing="ij")), -1, 0)
    table = MeasuredBRDF("x", planes, np.ones(2), h, d, phi, "edge")
    wi, wo = directions(rng, 4000)
    at = half_diff.from_directions(wi, wo)
    inside = (at[0] < h[-1]) & (at[1] < d[-1])
    assert inside.mean() > 0.5
    assert_allclose(table.eval(wi, wo)[inside], multilinear(*at)[inside], rtol=1e-12)


def test_it_is_reciprocal_and_zero_below_the_horizon(small_table, rng):
    wi, wo = directions(rng, 500)
    assert_allclose(small_table.eval(wi, wo), small_table.eval(wo, wi), rtol=1e-12)
    down = wi * [1, 1, -1]
    for pair in ((down, wo), (wi, -wo), (down, -wo)):
        assert_array_equal(small_table.eval(*pair), 0.0)


def test_shapes_broadcast(small_table, rng):
    wi, wo = directions(rng, 6)
    value = small_table.eval(wi[:, None], wo)
    assert value.shape == (6, 6, 3)
    assert_array_equal(value[2, 4], small_table.eval(wi[2], wo[4]))
    assert small_table.eval(wi[:0], wo[0]).shape == (0, 3)
    with pytest.raises(ValueError, match="'wi' must be unit vectors"):
        small_table.eval([0, 0, 2], [0, 0, 1])


@pytest.mark.parametrize(("alpha", "median", "rms"), [(0.1, 3e-3, 0.012), (0.4, 8e-4, 3e-3)])
def test_error_on_a_table_of_the_size_of_merl(rng, alpha, median, rms):
    def ggx(wi, wo):
        return reflectance.ggx(wi, wo, alpha)

    table = tabulate(ggx, "x")
    wi, wo = directions(rng, 20_000, 0.1)
    expected = ggx(wi, wo)
    error = np.abs(table.eval(wi, wo) - expected)
    assert np.median(error / expected) < median
    assert np.sqrt((error**2).sum() / (expected**2).sum()) < rms


def test_invalid_entries_take_the_nearest_toward_the_pole(make_table):
    table = make_table(2, (4, 3, 5))
    planes = table.planes.copy()
    planes[0, 2:, 1, 3] = [np.nan, -1.0]
    planes[0, 0, 1, 2] = np.inf
    planes[0, :, 0, :] = -1.0
    planes[1, :, :, 4] = -1.0
    filled = fill_invalid(dataclasses.replace(table, planes=planes))
    assert filled.min() > 0.0
    assert_array_equal(filled[2:, 1, 3, 0], planes[0, 1, 1, 3])
    assert filled[0, 1, 2, 0] == planes[0, 1, 1, 2]
    # A whole theta_d, a whole phi_d
    assert_array_equal(filled[:, 0, :, 0], filled[:, 1, :, 0])
    assert_array_equal(filled[:, :, 4, 1], filled[:, :, 3, 1])


def test_one_valid_entry_is_everywhere(make_table, rng):
    table = make_table(1, (4, 3, 5))
    planes = np.full_like(table.planes, np.nan)
    planes[0, 2, 1, 3] = 0.25
    value = dataclasses.replace(table, planes=planes).eval(*directions(rng, 50))
    assert_allclose(value, 0.25, rtol=1e-14)


def test_a_channel_without_a_value_is_refused(make_table):
    table = make_table(2, (4, 3, 5))
    planes = table.planes.copy()
    planes[1] = -1.0
    with pytest.raises(ValueError, match="small: channel 1 has no valid entry, so it has no values"):
        dataclasses.replace(table, planes=planes).eval([0, 0, 1], [0, 0, 1])


def test_one_phi_d_stands_for_all(make_table, rng):
    table = make_table(3, (6, 7, 1))
    wi, wo = directions(rng, 200)
    turned = half_diff.to_directions(*half_diff.from_directions(wi, wo)[:2], 1.0)
    up = (turned[0][:, 2] > 0) & (turned[1][:, 2] > 0)
    assert up.sum() > 100
    assert_allclose(table.eval(wi, wo)[up], table.eval(*turned)[up], rtol=1e-9)
