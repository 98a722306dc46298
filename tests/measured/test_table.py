"""`MeasuredBRDF` and `tabulate`: values and masks, any memory layout, shapes that disagree."""

import dataclasses
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import MeasuredBRDF, half_diff, tabulate
from dsbrdf.geometry.grids import cell_angles
from dsbrdf.measured.source import Source


def test_values_are_scaled_and_nan_where_invalid(damaged_table):
    planes, scale = damaged_table.planes, damaged_table.scale
    valid = np.isfinite(planes) & (planes >= 0.0)
    assert 0.4 < valid.mean() < 0.8
    expected = np.where(valid, planes * scale[:, None, None, None], np.nan)
    assert_array_equal(damaged_table.values, np.moveaxis(expected, 0, -1))
    assert_array_equal(damaged_table.valid, np.moveaxis(valid, 0, -1))
    for rows in ([3], [17, 0, 4], [], np.arange(0, 18, 5)):
        assert_array_equal(damaged_table.rows(rows), expected[:, :, rows])


def test_reading_values_leaves_the_numbers_as_they_are(damaged_table):
    before = damaged_table.planes.copy()
    assert damaged_table.values is damaged_table.values
    damaged_table.rows([2])
    damaged_table.moments([2])
    assert_array_equal(damaged_table.planes, before)


@pytest.mark.parametrize(
    "other",
    [
        np.asfortranarray,
        lambda planes: np.repeat(planes, 2, axis=-1)[..., ::2],
        lambda planes: planes.astype(">f8"),
        lambda planes: (
            np.frombuffer(b"\0" * 4 + planes.tobytes(), np.uint8)[4:].view("<f8").reshape(planes.shape)
        ),
        lambda planes: planes.tolist(),
    ],
    ids=["fortran", "strided", "big-endian", "unaligned read-only", "list"],
)
def test_any_memory_layout_gives_the_same(damaged_table, other):
    same = dataclasses.replace(
        damaged_table, planes=other(damaged_table.planes), scale=list(damaged_table.scale)
    )
    assert_array_equal(same.values, damaged_table.values)
    assert_array_equal(same.moments([1, 7]), damaged_table.moments([1, 7]))


def test_numbers_of_single_precision_are_taken(small_table):
    single = dataclasses.replace(small_table, planes=small_table.planes.astype(np.float32))
    assert single.values.dtype == np.float64
    assert_allclose(single.moments([2]), small_table.moments([2]), rtol=1e-6, atol=1e-6)


def test_an_array_of_the_right_kind_is_not_copied(small_table):
    assert np.shares_memory(dataclasses.replace(small_table).planes, small_table.planes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"planes": np.zeros((12, 18, 20))},
            r"'planes' must be \(channel, theta_h, theta_d, phi_d\), got shape \(12",
        ),
        ({"scale": np.ones(1)}, r"'scale' must have shape \(3,\) for 'planes' of .*, got \(1,\)\.$"),
        ({"scale": 1.0}, r"'scale' must have shape \(3,\) for 'planes' of .*, got \(\)\.$"),
        ({"theta_h": np.zeros(18)}, r"'theta_h' must have shape \(12,\) for .*, got \(18,\)\.$"),
        ({"theta_d": np.zeros((18, 1))}, r"'theta_d' must have shape \(18,\) for .*, got \(18, 1\)\.$"),
        ({"phi_d": np.zeros(3)}, r"'phi_d' must have shape \(20,\) for .*, got \(3,\)\.$"),
    ],
)
def test_shapes_that_disagree_are_refused(small_table, changes, text):
    with pytest.raises(ValueError, match=text):
        dataclasses.replace(small_table, **changes)


def test_rows_outside_the_table_are_refused(small_table):
    with pytest.raises(IndexError, match="row 18 is not among the table's 18"):
        small_table.moments([18])
    with pytest.raises(IndexError, match="out of bounds"):
        small_table.rows([18])


def test_repr_tells_the_size(small_table):
    text = "MeasuredBRDF('small', 12 theta_h x 18 theta_d x 20 phi_d, 3 channels, centre convention)"
    assert repr(small_table) == text


def test_pickling_keeps_everything(damaged_table):
    back = pickle.loads(pickle.dumps(damaged_table))
    assert_array_equal(back.values, damaged_table.values)
    assert back.name == damaged_table.name


@pytest.mark.parametrize("convention", ["centre", "edge"])
@pytest.mark.parametrize("n_channels", [1, 3, 5])
def test_tabulated_value_is_the_reflectance_at_the_angles_of_the_cell(n_channels, convention):
    def reflectance(wi, wo):
        return np.arange(1.0, n_channels + 1) * ((wi + 2 * wo) ** 2).sum(-1)[..., None] + wi[..., 2:]

    shape = (5, 6, 8)
    measured = tabulate(reflectance, "x", shape=shape, convention=convention)
    assert measured.values.shape == (*shape, n_channels)
    angles = cell_angles(convention, shape)
    for got, want in zip((measured.theta_h, measured.theta_d, measured.phi_d), angles, strict=True):
        assert_array_equal(got, want)
    for h, d, phi in np.ndindex(*shape):
        wi, wo = half_diff.to_directions(angles[0][h], angles[1][d], angles[2][phi])
        expected = reflectance(wi, wo) if min(wi[2], wo[2]) > 0.0 else np.full(n_channels, np.nan)
        assert_allclose(measured.values[h, d, phi], expected, rtol=1e-14)


def test_reflectance_may_give_read_only_lists_and_single_precision():
    constant = np.broadcast_to(np.float32(0.25), (6, 8, 2))
    for result in (constant, constant.tolist()):
        measured = tabulate(lambda wi, wo, result=result: result, "x", shape=(5, 6, 8))  # noqa: ARG005
        assert set(np.unique(measured.planes)) == {-1.0, 0.25}


@pytest.mark.parametrize(
    "result", [0.5, np.ones(3), np.ones((8, 8)), np.ones((8, 1, 3)), np.ones((5, 8, 8, 3))]
)
def test_reflectance_of_another_shape_is_refused(result):
    with pytest.raises(ValueError, match=r"^'reflectance' must return shape \(8, 8, channel\), got \("):
        tabulate(lambda wi, wo: result, "x", shape=(5, 8, 8))  # noqa: ARG005


def test_bad_options_of_tabulate_are_refused(make_table):
    with pytest.raises(ValueError, match=r"'shape' must hold at least one theta_h, got \(0, 18, 20\)\."):
        make_table(shape=(0, 18, 20))
    with pytest.raises(ValueError, match=r"'convention' must be 'centre' or 'edge', got 'middle'\."):
        make_table(convention="middle")


def test_source_tells_name_and_hash_but_no_folder(tmp_path):
    path = tmp_path / "a.binary"
    path.write_bytes(b"abc")
    source = Source(path, "made up")
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert source.to_json() == {"file": "a.binary", "sha256": digest, "description": "made up"}
    assert Source().to_json() == {"file": None, "sha256": None, "description": ""}
    assert Source(recorded={"file": "b"}).to_json() == {"file": "b"}


def test_source_that_is_gone_has_no_hash(tmp_path):
    assert Source(tmp_path / "gone.binary").to_json()["sha256"] is None


def test_measured_brdf_needs_no_source():
    measured = MeasuredBRDF("x", np.ones((1, 2, 2, 2)), np.ones(1), *cell_angles("centre", (2, 2, 2)))
    assert measured.source.to_json()["file"] is None
    assert measured.convention == "centre"


def test_every_other_phi_d_parts_the_table(small_table):
    first, second = small_table.every_other_phi_d()
    np.testing.assert_array_equal(first.phi_d, small_table.phi_d[::2])
    np.testing.assert_array_equal(second.values, small_table.values[:, :, 1::2])
    rows = range(len(small_table.theta_d))
    both = first.moments(rows) + second.moments(rows)
    np.testing.assert_allclose(both, small_table.moments(rows), rtol=1e-12, atol=1e-12)
