"""Neural BRDFs: both published layouts, against an evaluation of their own, and what is none."""

import re

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import read, read_merl
from dsbrdf.geometry.half_diff import to_directions

PARTS = ("fc1", "b1", "fc2", "b2", "fc3", "b3")


@pytest.fixture(scope="module")
def weights():
    rng = np.random.default_rng(3)
    shapes = [(6, 21), (21,), (21, 21), (21,), (21, 3), (3,)]
    return [rng.normal(0.0, 0.4, shape).astype(np.float32) for shape in shapes]


def write_set(folder, weights, name="cloth"):
    for part, array in zip(PARTS, weights, strict=True):
        np.save(folder / f"{name}_{part}.npy", array)
    return folder


def write_h5(path, weights, prefix="", names=("dense_4", "dense_5", "dense_6")):
    with h5py.File(path, "w") as file:
        # Not in the order of the layers
        for i in (2, 0, 1):
            group = file.create_group(f"{prefix}{names[i]}/{names[i]}")
            group["kernel:0"], group["bias:0"] = weights[2 * i : 2 * i + 2]
        file["optimizer_weights/kernel:0"] = np.zeros((6, 21), np.float32)
    return path


def network(weights, half, difference):
    """One pair at a time, in plain words."""
    x = np.concatenate([half, difference])
    for i in (0, 2):
        x = np.maximum(x @ weights[i].astype(float) + weights[i + 1], 0.0)
    return np.maximum(np.exp(x @ weights[4].astype(float) + weights[5]) - 1.0, 0.0)


@pytest.fixture(scope="module")
def table(weights, tmp_path_factory):
    return read(write_set(tmp_path_factory.mktemp("set"), weights))


@pytest.mark.parametrize(("i", "j", "k"), [(0, 0, 0), (3, 20, 100), (40, 10, 7), (60, 20, 179), (20, 70, 90)])
def test_an_entry_is_the_mean_of_both_orders_at_the_edge_of_its_cell(table, weights, i, j, k):
    h, d, phi = np.deg2rad([i**2 / 90, j, k])
    half = np.array([np.sin(h), 0.0, np.cos(h)])
    difference = np.array([np.sin(d) * np.cos(phi), np.sin(d) * np.sin(phi), np.cos(d)])
    both = [network(weights, half, difference * sign) for sign in ([1, 1, 1], [-1, -1, 1])]
    assert_allclose(table.values[i, j, k], np.mean(both, axis=0), rtol=1e-5)


def test_what_is_below_the_horizon_is_invalid(table):
    i, j, k = 70, 60, 0
    assert min(w[2] for w in to_directions(*np.deg2rad([i**2 / 90, j, k]))) < 0.0
    assert not table.valid[i, j, k].any()
    assert 0.75 < table.valid.mean() < 0.77
    assert table.name == "cloth"
    assert table.source.to_json()["description"] == "decoded from a neural BRDF (Sztrajman et al. 2021)"


@pytest.mark.parametrize(("prefix", "names"), [("", "abc"), ("model_weights/", ("z", "y", "x"))])
def test_keras_files_and_sets_give_the_same(table, weights, tmp_path, prefix, names):
    path = write_h5(tmp_path / "cloth.dat", weights, prefix, names)
    assert_array_equal(read(path).planes, table.planes)


def test_any_file_of_a_set_stands_for_it(table, weights, tmp_path):
    write_set(tmp_path, weights)
    other = read(tmp_path / "cloth_b2.npy", convention="edge")
    assert_array_equal(other.planes, table.planes)
    assert other.convention == "edge"
    assert other.name == "cloth"


@pytest.mark.shared
def test_against_the_decoded_files(data, decoded, tmp_path):
    arrays = dict(np.load(data / "data" / "nbrdf" / "merl.npz"))
    at = [str(name) for name in arrays["material"]].index("nickel")
    write_set(tmp_path, [arrays[key][at] for key in ("w1", "b1", "w2", "b2", "w3", "b3")], "nickel")
    mine, expected = read(tmp_path), read_merl(decoded("nickel"))
    assert_array_equal(mine.valid, expected.valid)
    # They were decoded in single precision
    assert np.nanmax(np.abs(mine.values - expected.values) / (expected.values + 1e-3)) < 1e-4


def test_what_overflows_is_invalid(weights, tmp_path):
    large = [*weights[:5], np.full(3, 800.0, np.float32)]
    measured = read(write_set(tmp_path, large))
    assert not measured.valid.any()


def test_two_sets_in_a_folder(weights, tmp_path):
    write_set(write_set(tmp_path, weights), weights, "silk")
    with pytest.raises(
        ValueError, match=r"2 neural BRDFs in this folder. Give one, such as .*cloth_fc1\.npy"
    ):
        read(tmp_path)
    assert read(tmp_path / "silk_fc1.npy").name == "silk"


def test_half_a_set_is_no_set(weights, tmp_path):
    write_set(tmp_path, weights)
    (tmp_path / "cloth_b3.npy").unlink()
    with pytest.raises(ValueError, match="a folder without a neural BRDF"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("index", "array", "message"),
    [
        (
            0,
            np.zeros((5, 21)),
            "expected layers of 6 to n to m to 3 numbers, n and m at most 64, got arrays of shape",
        ),
        (2, np.zeros((22, 21)), "expected layers of"),
        (3, np.zeros((21, 1)), "expected layers of"),
        (4, np.zeros((21, 4)), "expected layers of"),
        (1, np.zeros(21, int), "expected layers of"),
        (5, np.array([0.0, np.nan, 0.0]), "not a sound neural BRDF: a weight is not finite. Fetch it again."),
    ],
)
def test_wrong_weights_are_refused(weights, tmp_path, index, array, message):
    changed = [array if i == index else old for i, old in enumerate(weights)]
    with pytest.raises(ValueError, match=message):
        read(write_set(tmp_path, changed))


def test_wide_networks_are_refused(tmp_path):
    wide = [np.zeros(shape) for shape in [(6, 65), (65,), (65, 65), (65,), (65, 3), (3,)]]
    with pytest.raises(ValueError, match="n and m at most 64"):
        read(write_set(tmp_path, wide))


@pytest.mark.parametrize("n", [1, 4, 1000])
def test_hdf5_files_of_another_kind_are_refused(tmp_path, n):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        for i in range(n):
            file[f"layer{i}/kernel"] = np.zeros((6, 3), np.float32)
            file[f"layer{i}/bias"] = np.zeros(3, np.float32)
    with pytest.raises(ValueError, match="not a neural BRDF: expected layers of"):
        read(tmp_path / "x.h5")


@pytest.mark.parametrize("content", [np.zeros(10_000), np.zeros(3, int)])
def test_hdf5_arrays_of_another_kind_are_not_read(tmp_path, content):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a/kernel"] = content
    with pytest.raises(ValueError, match="not a sound Keras file of a neural BRDF: array a/kernel of"):
        read(tmp_path / "x.h5")


def test_a_damaged_keras_file_is_refused(weights, tmp_path):
    path = write_h5(tmp_path / "x.h5", weights)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: not a sound HDF5 file: "):
        read(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(10_000_000))
    with pytest.raises(ValueError, match="not a sound HDF5 file: "):
        read(path)


def test_h5py_is_named_where_it_is_missing(weights, tmp_path, monkeypatch):
    path = write_h5(tmp_path / "x.h5", weights)
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(ModuleNotFoundError, match=r"HDF5 files need h5py: pip install 'dsbrdf\[hdf5\]'"):
        read(path)
