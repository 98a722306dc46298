"""Damaged and hostile files: every reader ends with a clear error or a sound result, soon and in little memory."""

import dataclasses
import json
import os
import struct
import zipfile

import numpy as np
import pytest
from formats import VALID, npy_array, place, sound
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import dsbrdf
from dsbrdf import ModelFormatError, load, read

quick = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
#: Without Keras files: a library in C reads these, and the long run watches it.
FORMATS = [kind for kind in VALID if kind not in ("keras", "hdf5")]


@pytest.fixture(scope="module")
def valid():
    return {kind: make() for kind, make in VALID.items()}


@pytest.mark.parametrize("kind", VALID)
def test_the_valid_files_are_read(valid, tmp_path, kind):
    assert sound(kind, place(kind, tmp_path, valid[kind]))


# Random content


@pytest.mark.parametrize(
    "start",
    [
        b"",
        b"PK\x03\x04",
        b"\x93NUMPY\x01\0",
        b"tensor_file\0\x01\0",
        b"\x89HDF\r\n\x1a\n",
        b"\x89PNG\r\n\x1a\n",
        b"\x76\x2f\x31\x01",
        b"theta_i_deg,theta_o_deg,phi_o_deg,f\n",
        struct.pack("<3i", 90, 90, 180),
        b"{",
    ],
)
@quick
@given(content=st.binary(max_size=2000))
def test_random_bytes(tmp_path, start, content):
    sound("any", place("any", tmp_path, start + content))


@quick
@given(
    st.lists(st.lists(st.floats(width=32) | st.sampled_from(["", "x", "1e999", "-"]), max_size=5), max_size=4)
)
def test_random_numbers_in_text(tmp_path, rows):
    lines = [",".join(map(str, row)) for row in rows]
    text = "\n".join(["theta_i_deg,theta_o_deg,phi_o_deg,f,std", *lines])
    sound("text", place("text", tmp_path, text.encode()))


# Damage to valid files


@pytest.mark.parametrize("kind", FORMATS)
def test_truncation(valid, tmp_path, kind):
    whole = valid[kind]
    step = 1 if len(whole) < 1500 else 7
    for length in range(0, len(whole), step):
        sound(kind, place(kind, tmp_path, whole[:length]))


@pytest.mark.parametrize("kind", FORMATS)
@quick
@given(data=st.data())
def test_changed_bytes(valid, tmp_path, kind, data):
    content = bytearray(valid[kind])
    places = st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255))
    for at, byte in data.draw(st.lists(places, min_size=1, max_size=8)):
        content[at] = byte
    sound(kind, place(kind, tmp_path, content))


@pytest.mark.parametrize("size", [2**31 - 1, 2**32 - 1, 2**62, 2**63 - 1])
def test_absurd_sizes_in_arrays_are_not_allocated(tmp_path, size):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({size}, {size}), }}\n".encode()
    content = b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header + bytes(100)
    (tmp_path / "x.npy").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("values.npy", content)
    for name in ("x.npy", "x.npz"):
        with pytest.raises(ValueError, match=r"an array of shape .* needs [\d,]+ bytes, got \d+"):
            read(tmp_path / name)


def test_a_zip_that_tells_a_wrong_size(tmp_path):
    """A bomb that says it is small: what it holds is read no further than it says."""
    path = tmp_path / "x.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("values.npy", npy_array() + bytes(50_000_000))
    content = bytearray(path.read_bytes())
    size = struct.pack("<I", len(npy_array()) + 50_000_000)
    while (at := content.find(size)) >= 0:
        content[at : at + 4] = struct.pack("<I", len(npy_array()))
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"not a sound \.npz file"):
        read(path)


# Values that make no measurement


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 0.0, 0.25])
def test_constant_tables_end_well(make_table, value):
    table = make_table(1)
    measured = dataclasses.replace(table, planes=np.full_like(table.planes, value))
    if value >= 0.0 and value < np.inf:
        model = dsbrdf.fit(measured, 2).model
        assert all(np.isfinite(part).all() for part in model.lobes.parts)
    else:
        with pytest.raises(ValueError, match="no value is valid"):
            dsbrdf.fit(measured, 2)


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_one_valid_entry_makes_a_model_without_nan(make_table):
    table = make_table(1)
    planes = np.full_like(table.planes, -1.0)
    planes[0, 4, 0, 3] = 0.5
    model = dsbrdf.fit(dataclasses.replace(table, planes=planes), 2).model
    assert all(np.isfinite(part).all() for part in model.lobes.parts)


# Model files


@quick
@given(st.binary(max_size=500))
def test_random_model_files(tmp_path, content):
    for start in (b"", b'{"format": "dsbrdf model", "schema": 1, '):
        sound("model", place("model", tmp_path, start + content))


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@quick
@given(data=st.data())
def test_model_files_with_anything_in_a_field(valid, tmp_path, data):
    content = json.loads(valid["model"])
    parts = ("lobes", "profile", "errors")
    target = data.draw(st.sampled_from([content, *(content[part] for part in parts)]))
    key = data.draw(st.sampled_from(sorted(target)))
    target[key] = data.draw(anything)
    sound("model", place("model", tmp_path, json.dumps(content).encode()))


def test_truncated_model_files(valid, tmp_path):
    whole = valid["model"]
    for length in range(0, len(whole) - 1, 3):
        (tmp_path / "x").write_bytes(whole[:length])
        with pytest.raises(ModelFormatError):
            load(tmp_path / "x")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": True}, "schema True is not among those this version reads"),
        ({"schema": [0] * 1000}, r"schema \[0, 0, .{30,40} is not among"),
        ({"lobes": {"scale": [["0.1"]]}}, "not a sound model: 'scale' must hold numbers, got '0.1'"),
        ({"lobes": {"beta": [[True]]}}, "not a sound model: 'beta' must hold numbers, got True"),
        ({"lobes": [1]}, "not a sound model: "),
        ({"channels": 3}, "not a sound model: "),
        ({"profile": {"theta_d": 0.5, "theta_h": 0.5, "mean": 0.5, "amplitude": 0.5}}, "not a sound model: "),
        (
            {"profile": {"theta_d": ["a"], "theta_h": [[1]], "mean": [], "amplitude": []}},
            "not a sound model: ",
        ),
        ({"profile": [1]}, "not a sound model: "),
        ({"lobes": {"gamma": [[float("nan")], [1.0]]}}, "'gamma' must be finite, got nan"),
        ({"lobes": {"falloff": [[float("inf")], [1.0]]}}, "'falloff' must be .*finite, got inf"),
    ],
)
def test_wrong_types_in_a_model_are_refused(valid, tmp_path, change, message):
    content = json.loads(valid["model"])
    for key, value in change.items():
        merge = key == "lobes" and isinstance(value, dict)
        content[key] = content[key] | value if merge else value
    (tmp_path / "x").write_text(json.dumps(content))
    with pytest.raises(ModelFormatError, match=message):
        load(tmp_path / "x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000 + "]" * 100_000, "not JSON|more values than any such file has"),
        ('{"a":' * 5000 + "1" + "}" * 5000, "not JSON"),
        ('{"format": "dsbrdf model", "schema": ' + "9" * 5000 + "}", "not JSON"),
        ("[" + "[]," * 2_000_000 + "0]", "not a model file: more values than any such file has"),
        ("[" + "1.5," * 3_000_001 + "0]", "not a model file: more values than any such file has"),
    ],
    ids=["deep lists", "deep objects", "huge number", "many lists", "many numbers"],
)
def test_json_that_would_take_much_is_refused(tmp_path, text, message):
    (tmp_path / "x").write_text(text)
    with pytest.raises(ModelFormatError, match=message):
        load(tmp_path / "x")


def test_what_is_no_file_is_no_model(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/zero", tmp_path / "pipe"):
        with pytest.raises(ValueError, match=f"^{path}: not a regular file"):
            load(path)
    with pytest.raises(IsADirectoryError):
        load(tmp_path)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(OSError, match="symbolic links"):
        load(tmp_path / "loop")
