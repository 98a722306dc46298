"""`read`: the format is told from the content, under any name, and what is none is refused."""

import gzip
import os
import re
import struct
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import MeasuredBRDF, Samples, cli, load, read, read_merl
from dsbrdf.measured.formats import array_file
from dsbrdf.measured.formats.array_file import write_npz


def test_a_merl_file_under_any_name(merl_file, tmp_path):
    (tmp_path / "x.csv").symlink_to(merl_file)
    assert_array_equal(read(tmp_path / "x.csv").rows([3]), read_merl(merl_file).rows([3]))


def test_a_table_in_npz_comes_back(damaged_table, tmp_path):
    path = tmp_path / "new" / "table.binary"
    write_npz(damaged_table, path)
    back = read(path)
    assert isinstance(back, MeasuredBRDF)
    assert_array_equal(back.values, damaged_table.values)
    for name in ("theta_h", "theta_d", "phi_d", "name", "convention"):
        assert_array_equal(getattr(back, name), getattr(damaged_table, name))
    assert [file.name for file in path.parent.iterdir()] == ["table.binary"]


def test_samples_in_npz_come_back(tmp_path):
    wi = np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 1.0]])
    for weights in (None, np.array([0.5, 2.0])):
        samples = Samples(
            wi, wi[::-1], [[1.0, np.nan], [0.0, 2.0]], name="s", weights=weights, channels=("x", "450nm")
        )
        write_npz(samples, tmp_path / "s.npz")
        back = read(tmp_path / "s.npz")
        assert isinstance(back, Samples)
        assert_array_equal(back.values, samples.values)
        assert_allclose(back.wo, samples.wo, atol=1e-15)
        assert_array_equal(back.weights, weights)
        assert tuple(back.channels) == ("x", "450nm")


def test_angles_of_an_npz_table_default_to_cells(tmp_path):
    values = np.ones((4, 5, 6, 1))
    np.savez(tmp_path / "t.npz", values=values, theta_h=np.array([0.0, 0.1, 0.3, 1.5]))
    table = read(tmp_path / "t.npz", convention="edge")
    assert_array_equal(table.theta_h, [0.0, 0.1, 0.3, 1.5])
    assert_allclose(table.theta_d, np.deg2rad([0, 18, 36, 54, 72]))
    assert table.convention == "edge"


def test_a_table_in_npy(tmp_path):
    values = np.arange(1.0, 121.0).reshape(3, 4, 5, 2)
    np.save(tmp_path / "t.npy", np.asfortranarray(values.astype(">f4")))
    assert_array_equal(read(tmp_path / "t.npy").values, values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta_h": [0.1, 0.1]}, "theta_h must be ascending angles from 0 to 1.5708 radians"),
        ({"theta_h": [0.1, 10.0]}, "theta_h must be ascending"),
        ({"theta_d": [-0.1, 0.1]}, "theta_d must be ascending"),
        ({"phi_d": [0.1, np.nan]}, "phi_d must be ascending angles from 0 to 3.14159 radians"),
        ({"theta_h": [0.1, 0.2, 0.3]}, r"'theta_h' must have shape \(2,\)"),
        ({"theta_d": ["a", "b"]}, "theta_d must be ascending"),
        ({"convention": "center"}, "the convention must be 'centre' or 'edge', got 'center'"),
        ({"values": np.zeros((2, 2, 2, 0))}, r"expected numbers \(theta_h, theta_d, phi_d, channel\), got float64"),
        ({"values": np.array([["a"]])}, r"expected numbers \(theta_h, theta_d\) or .* got <U1 of shape \(1, 1\)"),
        ({"values": np.zeros(3)}, r"expected numbers \(theta_h, theta_d\) or .* got float64 of shape \(3,\)"),
    ],
)  # fmt: skip
def test_wrong_tables_are_refused(tmp_path, change, message):
    path = tmp_path / "x.npz"
    arrays = {
        "values": np.ones((2, 2, 2, 1)),
        "theta_h": [0.1, 0.2],
        "theta_d": [0.1, 0.2],
        "phi_d": [0.1, 0.2],
    }
    np.savez(path, **arrays | change)
    with pytest.raises(ValueError, match=message):
        read(path)


# The .npy header


def npy(header, data=b"", version=b"\x01\0"):
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header + data


GOOD = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2, 2), }"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (npy(GOOD), "an array of shape (2, 2) needs 101 bytes, got 69. Write it again."),
        (npy(GOOD, bytes(33)), "an array of shape (2, 2) needs 101 bytes, got 102."),
        (npy(GOOD.replace(b"(2, 2)", b"(99999999999, 2)")), "an array of shape (99999999999, 2) needs 1,600,0"),
        (npy(GOOD.replace(b"<f8", b"|O")), "not an array of numbers. Write it with numpy.save, without objects."),
        (npy(GOOD.replace(b"<f8", b"<f9"), bytes(36)), "an array of type <f9. Convert it to float64."),
        (npy(GOOD.replace(b"<f8", b"<U1"), bytes(16)), "expected numbers (theta_h, theta_d) or"),
        (npy(GOOD.replace(b"'<f8'", b"[('a', '<f8')]"), bytes(32)), "not an array of numbers."),
        (npy(GOOD.replace(b"False", b"__import__('os')"), bytes(32)), "not an array of numbers."),
        (npy(GOOD.replace(b"(2, 2)", b"(-2, -2)"), bytes(32)), "not an array of numbers."),
        (npy(GOOD, bytes(32), b"\x09\0"), "not a .npy array. Write it with numpy.save."),
        (b"\x93NUMPY", "not a .npy array. Write it with numpy.save."),
        (npy(GOOD)[:20], "not an array of numbers."),
        (npy(GOOD.replace(b"(2, 2)", b"()"), bytes(8)), "expected numbers (theta_h, theta_d) or"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_refused(tmp_path, content, message):
    path = tmp_path / "x.npy"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"^{re.escape(f'{path}: {message}')}"):
        read(path)


def test_arrays_that_unpack_to_much_more_are_refused(tmp_path):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, values=np.zeros(8_000_000))
    with pytest.raises(
        ValueError, match=r"64,000,1\d\d bytes of arrays in a file of 6\d,\d+ bytes. Store it without"
    ):
        read(path)


def test_a_damaged_npz_is_refused(tmp_path):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, wi=np.ones((100, 3)))
    whole = bytearray(path.read_bytes())
    whole[60:80] = bytes(20)
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=r"not a sound \.npz file: .*Write it again with numpy\.savez\."):
        read(path)


def test_an_array_cut_inside_a_zip_is_refused(monkeypatch, tmp_path):
    path = tmp_path / "x.npy"
    path.write_bytes(npy(GOOD, bytes(31)))
    monkeypatch.setattr(array_file._files, "regular_size", lambda _: 101)
    with pytest.raises(ValueError, match=r"the file ends early\. Write it again"):
        read(path)


@pytest.mark.parametrize("n", [1, 5])
def test_any_number_of_channels_goes_from_a_file_to_a_model_and_back(make_table, tmp_path, capsys, n):
    table = make_table(n)
    write_npz(table, tmp_path / "t.npz")
    path = tmp_path / "small.json"
    assert cli.main(["fit", str(tmp_path / "t.npz"), "-o", str(tmp_path), "--lobes", "3", "--json"]) == 0
    assert cli.main(["info", str(path)]) == 0
    capsys.readouterr()
    model = load(path)
    assert model.n_channels == n
    value = model.eval_angles(table.theta_h[5], table.theta_d[4], table.phi_d)
    assert_allclose(value, table.values[5, 4], rtol=0.3)


# What is none


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "an empty file. Expected a MERL .binary, RGL .bsdf,"),
        (gzip.compress(b"x", mtime=0), "a compressed file. Unpack it first."),
        (b'\n {"format": "dsbrdf model"}', "JSON, not a measurement. A model file is read by dsbrdf.load."),
        (bytes(100), "no known format: expected a MERL"),
        (b"\xff\xfe\x01", "no known format: expected a MERL .binary, RGL"),
        (struct.pack(">3i", 90, 90, 180), r"no known format: .* got a file that begins with b'"),
        (
            b"Copyright notice\n",
            "no samples: expected lines of numbers after a header and comments, or another",
        ),
        (b"tensor_file\0", "not an RGL tensor file"),
    ],
)
def test_what_is_none_is_refused(tmp_path, content, message):
    path = tmp_path / "x.dat"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*{message}"):
        read(path)


def test_a_binary_file_that_is_none_is_told_as_merl(tmp_path):
    path = tmp_path / "x.binary"
    path.write_bytes(struct.pack(">3i", 90, 90, 180))
    with pytest.raises(ValueError, match="not a MERL file: expected a header of 90 x 90 x 180"):
        read(path)


def test_what_is_no_file(tmp_path):
    with pytest.raises(ValueError, match=r"a folder without a neural BRDF \(NAME_fc1.npy to NAME_b3.npy\)"):
        read(tmp_path)
    with pytest.raises(FileNotFoundError, match="nothing"):
        read(tmp_path / "nothing")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(OSError, match="symbolic links"):
        read(tmp_path / "loop")
    for path in (tmp_path / "pipe", "/dev/zero", "/dev/null"):
        with pytest.raises(
            ValueError, match=f"^{path}: not a regular file. Copy what it gives to a file first"
        ):
            read(path)


# Memory

PEAK = """
import sys
from pathlib import Path
import dsbrdf

def peak():
    # Not that of getrusage, which has the parent's too
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])

before = peak()
try:
    measured = dsbrdf.read(sys.argv[1])
    sum(float(measured.rows([row])[0, 0, 0, 0]) for row in range(90)) if hasattr(measured, "rows") else None
except ValueError:
    pass
print(peak() - before)
"""


@pytest.mark.parametrize("kind", ["merl", "text", "npz", "random"])
def test_memory_stays_below_a_small_multiple_of_the_file(kind, merl_file, tmp_path):
    path = tmp_path / "x"
    if kind == "merl":
        path.symlink_to(merl_file)
    elif kind == "text":
        row = "30.12345,45.12345,180.12345,0.123456,0.123456,0.123456\n"
        path.write_text("theta_i_deg,theta_o_deg,phi_o_deg,r,g,b\n" + 300_000 * row)
    elif kind == "npz":
        n = 600_000
        up = np.tile([0.0, 0.0, 1.0], (n, 1))
        np.savez(path.with_suffix(".npz"), wi=up, wo=up, values=np.ones((n, 3)))
        path = path.with_suffix(".npz")
    else:
        path.write_bytes(np.random.default_rng(1).bytes(60_000_000))
    done = subprocess.run([sys.executable, "-c", PEAK, path], capture_output=True, text=True, check=True)
    peak = int(done.stdout) * 1024
    assert peak < 1.5 * path.stat().st_size + 100e6
