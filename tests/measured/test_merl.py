"""MERL `.binary` files: layout, cells, lazy mapping, writing back bit by bit, and files that are none."""

import dataclasses
import errno
import os
import re
import struct
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import MeasuredBRDF, MerlFormatError, read, read_merl, write_merl
from dsbrdf.geometry.grids import cell_angles
from dsbrdf.geometry.half_diff import to_directions
from dsbrdf.measured.formats import merl

HEADER = struct.pack("<3i", 90, 90, 180)
N_BYTES = 12 + 3 * 90 * 90 * 180 * 8
SCALE = (1 / 1500, 1.15 / 1500, 1.66 / 1500)
INDICES = [(0, 0, 0, 0), (2, 89, 89, 179), (1, 10, 10, 10), (0, 1, 2, 3), (2, 44, 7, 100), (1, 0, 89, 0)]


def stored_in(path):
    """Stored numbers (channel, theta_h, theta_d, phi_d), read without our reader."""
    return np.fromfile(path, "<f8", offset=12).reshape(3, 90, 90, 180)


def sparse(path, header, size):
    """A file of zeros behind a header that takes no room on the disk."""
    path.write_bytes(header)
    os.truncate(path, size)
    return path


@pytest.fixture
def zeros(tmp_path):
    return sparse(tmp_path / "zeros.binary", HEADER, N_BYTES)


def refused(path, text, reader=read_merl):
    with pytest.raises(MerlFormatError, match=f"^{re.escape(f'{path}: {text}')}$"):
        reader(path)


# Layout


@pytest.mark.parametrize(("c", "h", "d", "phi"), INDICES)
def test_entry_lies_at_its_byte_and_is_scaled(merl_file, c, h, d, phi):
    with merl_file.open("rb") as file:
        file.seek(12 + 8 * (((c * 90 + h) * 90 + d) * 180 + phi))
        (stored,) = struct.unpack("<d", file.read(8))
    value = read_merl(merl_file).values[h, d, phi, c]
    assert_array_equal(value, stored * SCALE[c] if stored >= 0 else np.nan)


def test_every_value_is_stored_number_times_scale_and_invalid_ones_are_nan(merl_file):
    stored = stored_in(merl_file)
    measured = read_merl(merl_file)
    assert_array_equal(np.moveaxis(measured.valid, -1, 0), stored >= 0.0)
    expected = np.where(stored >= 0.0, stored * np.array(SCALE)[:, None, None, None], np.nan)
    assert_array_equal(np.moveaxis(measured.values, -1, 0), expected)
    assert_array_equal(measured.rows([5, 0]), expected[:, :, [5, 0]])
    # A zero is black, not invalid
    assert_array_equal(measured.values[10, 10, 10], 0.0)


def test_channels_may_be_invalid_one_by_one(merl_file):
    assert_array_equal(read_merl(merl_file).valid[0, 0, 0], stored_in(merl_file)[:, 0, 0, 0] >= 0)
    assert not read_merl(merl_file).valid[0, 0, 0, 0]


def test_name_source_and_size(merl_file):
    measured = read_merl(str(merl_file))
    assert measured.name == "made-up"
    assert read_merl(merl_file, name="other").name == "other"
    assert measured.source.file == merl_file
    assert measured.source.to_json()["file"] == "made-up.binary"
    assert measured.planes.shape == (3, 90, 90, 180)
    assert measured.n_channels == 3


def test_read_finds_the_format(merl_file):
    measured = read(merl_file, convention="edge")
    assert measured.convention == "edge"
    assert_array_equal(measured.rows([3]), read_merl(merl_file).rows([3]))


def test_is_merl_wants_the_whole_header():
    assert merl.is_merl(HEADER + b"more")
    for head in (b"", HEADER[:11], HEADER[::-1], struct.pack(">3i", 90, 90, 180), b"tensor_file\0\0\0"):
        assert not merl.is_merl(head)


# Cells


def test_centre_is_half_a_cell_in_the_square_root_coordinate(merl_file):
    measured = read_merl(merl_file)
    i, j = np.arange(90), np.arange(180)
    assert measured.convention == "centre"
    assert_allclose(np.degrees(measured.theta_h), ((i + 0.5) / 90) ** 2 * 90, rtol=1e-14)
    assert_allclose(np.degrees(measured.theta_d), i + 0.5, rtol=1e-14)
    assert_allclose(np.degrees(measured.phi_d), j + 0.5, rtol=1e-14)


def test_edge_is_the_lower_edge_of_the_cell(merl_file):
    measured = read_merl(merl_file, convention="edge")
    i, j = np.arange(90), np.arange(180)
    assert measured.convention == "edge"
    assert_allclose(np.degrees(measured.theta_h), i**2 / 90, rtol=1e-14)
    assert_allclose(np.degrees(measured.theta_d), i, rtol=1e-14)
    assert_allclose(np.degrees(measured.phi_d), j, rtol=1e-14)


def test_centres_lie_between_the_edges_at_any_size():
    for shape in [(90, 90, 180), (1, 1, 1), (7, 3, 5)]:
        for centre, edge, end in zip(
            cell_angles("centre", shape),
            cell_angles("edge", shape),
            (np.pi / 2, np.pi / 2, np.pi),
            strict=True,
        ):
            upper = np.append(edge[1:], end)
            assert (edge < centre).all()
            assert (centre < upper).all()


def test_convention_of_another_name_is_refused(zeros):
    with pytest.raises(ValueError, match=r"^'convention' must be 'centre' or 'edge', got 'center'\.$"):
        read_merl(zeros, convention="center")


# Mapping


def test_opening_reads_no_values(merl_file):
    read_merl(merl_file)
    tracemalloc.start()
    measured = read_merl(merl_file)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200_000
    assert not measured.planes.flags.writeable


def test_values_are_read_when_they_are_used(zeros):
    measured = read_merl(zeros)
    with zeros.open("r+b") as file:
        file.seek(12 + 8 * 180 * 4)
        file.write(struct.pack("<d", 1500.0))
    assert measured.rows([4])[0, 0, 0, 0] == 1500.0 * SCALE[0]


# Writing


def test_a_file_that_was_read_is_written_back_byte_by_byte(merl_file, tmp_path):
    write_merl(read_merl(merl_file), tmp_path / "new" / "copy.binary")
    assert (tmp_path / "new" / "copy.binary").read_bytes() == merl_file.read_bytes()
    assert [path.name for path in tmp_path.glob("new/*")] == ["copy.binary"]
    (tmp_path / "new" / "copy.binary").unlink()


def test_a_file_may_be_written_over_while_it_is_mapped(zeros):
    measured = read_merl(zeros)
    write_merl(measured, zeros)
    assert zeros.read_bytes() == HEADER + bytes(N_BYTES - 12)
    assert measured.values[0, 0, 0, 0] == 0.0


def test_values_in_reflectance_survive_writing_and_reading_exactly(merl_file, tmp_path):
    """Not the stored numbers: two of these can mean the same value."""
    measured = read_merl(merl_file)
    planes = np.moveaxis(measured.values, -1, 0)
    own = dataclasses.replace(measured, planes=planes, scale=np.ones(3))
    write_merl(own, tmp_path / "own.binary")
    assert_array_equal(read_merl(tmp_path / "own.binary").values, measured.values)
    stored = stored_in(tmp_path / "own.binary")
    assert_array_equal(stored < 0.0, stored_in(merl_file) < 0.0)
    assert_array_equal(stored[stored < 0.0], -1.0)
    assert (stored != stored_in(merl_file)).any()
    (tmp_path / "own.binary").unlink()


def test_invalid_entries_of_every_kind_are_written_as_minus_one(tmp_path):
    planes = np.zeros((3, 90, 90, 180))
    planes[:, 0, 0, :5] = [np.nan, np.inf, -np.inf, -0.5, 2.0]
    for scale in (np.ones(3), np.array(SCALE)):
        measured = MeasuredBRDF("m", planes, scale, *cell_angles())
        write_merl(measured, tmp_path / "m.binary")
        stored = stored_in(tmp_path / "m.binary")
        assert_array_equal(stored[:, 0, 0, :4], -1.0)
        assert (stored[:, 0, 0, 4] > 0.0).all()
        assert_array_equal(stored[:, 0, 0, 5:], 0.0)


@pytest.mark.parametrize("n_channels", [1, 3])
def test_tables_of_another_size_are_refused(make_table, tmp_path, n_channels):
    path = tmp_path / "small.binary"
    text = f"{path}: a MERL file holds 3 channels of 90 x 90 x 180, got ({n_channels}, 12, 18, 20). Tabulate"
    with pytest.raises(ValueError, match=f"^{re.escape(text)} the reflectance on that grid first.$"):
        write_merl(make_table(n_channels), path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
@pytest.mark.parametrize("before", [None, b"what was there"])
def test_interrupted_writing_leaves_what_was_there(zeros, tmp_path, monkeypatch, stop, before):
    folder = tmp_path / "out"
    folder.mkdir()
    path = folder / "m.binary"
    if before:
        path.write_bytes(before)
    sizes = []

    def fails_on_the_second_plane(valid, _stored, invalid):
        if sizes:
            raise stop
        sizes.append([file.stat().st_size for file in folder.iterdir() if file != path])
        return np.full(valid.shape, invalid)

    measured = read_merl(zeros)
    monkeypatch.setattr(merl.np, "where", fails_on_the_second_plane)
    with pytest.raises(type(stop)) as caught:
        write_merl(measured, path)
    monkeypatch.undo()
    assert len(sizes[0]) == 1, "it is written beside its place"
    assert [file.name for file in folder.iterdir()] == (["m.binary"] if before else [])
    if before:
        assert path.read_bytes() == before
    if isinstance(stop, OSError):
        assert str(caught.value) == f"[Errno {errno.ENOSPC}] No space left on device: '{path}'"


def test_a_full_disk_that_numpy_reports_without_a_number_is_named(zeros, tmp_path, monkeypatch):
    def full(*_):
        raise OSError("1458000 requested and 512 written")

    measured = read_merl(zeros)
    monkeypatch.setattr(merl.np, "where", full)
    with pytest.raises(OSError, match=r"1458000 requested and 512 written: '.*m\.binary'$"):
        write_merl(measured, tmp_path / "m.binary")


def test_places_that_cannot_be_written_are_named(zeros, tmp_path):
    measured = read_merl(zeros)
    with pytest.raises(IsADirectoryError, match=re.escape(f"'{tmp_path}'")):
        write_merl(measured, tmp_path)
    with pytest.raises(IsADirectoryError, match=re.escape("'.'")):
        write_merl(measured, ".")
    with pytest.raises(FileExistsError, match=re.escape(f"'{zeros}'")):
        write_merl(measured, zeros / "m.binary")
    assert [file.name for file in tmp_path.iterdir()] == [zeros.name]


# Files that are none


@pytest.mark.parametrize("size", range(12))
def test_a_file_shorter_than_a_header_is_refused(tmp_path, size):
    path = tmp_path / "short.binary"
    path.write_bytes(HEADER[:size])
    refused(path, f"not a MERL file: expected 34,992,012 bytes, the file has {size}.")


@pytest.mark.parametrize(
    "size", [12, 13, 1225, 12 + N_BYTES // 3, N_BYTES - 8, N_BYTES - 1, N_BYTES + 1, 2 * N_BYTES]
)
def test_a_file_of_another_size_than_its_header_says_is_refused(tmp_path, size):
    path = sparse(tmp_path / "cut.binary", HEADER, size)
    text = "not a whole MERL file: the header says 90 x 90 x 180 (34,992,012 bytes), the file has"
    refused(path, f"{text} {size:,} bytes. Fetch it again.")
    refused(path, f"{text} {size:,} bytes. Fetch it again.", reader=read)


@pytest.mark.parametrize(
    ("header", "dims"),
    [
        (struct.pack("<3i", 90, 90, 360), "90 x 90 x 360"),
        (struct.pack("<3i", 90, 180, 90), "90 x 180 x 90"),
        (struct.pack("<3i", 0, 0, 0), "0 x 0 x 0"),
        (struct.pack("<3i", -90, -90, 180), "-90 x -90 x 180"),
        (struct.pack("<3i", 2**31 - 1, 2**31 - 1, -(2**31)), "2147483647 x 2147483647 x -2147483648"),
        (struct.pack(">3i", 90, 90, 180), "1509949440 x 1509949440 x -1275068416"),
        (struct.pack("<3q", 90, 90, 180)[:12], "90 x 0 x 90"),
        (b"Copyright Notice: ...", "2037411651 x 1751607666 x 1867391092"),
        (b"tensor_file\0", "1936614772 x 1717531247 x 6646889"),
    ],
)
@pytest.mark.parametrize("size", [24, N_BYTES])
def test_another_header_is_refused_whatever_the_size(tmp_path, header, dims, size):
    path = sparse(tmp_path / "other.binary", header, size)
    text = f"not a MERL file: expected a header of 90 x 90 x 180, got {dims}. Is it another format?"
    refused(path, text)


def test_a_folder_is_refused(tmp_path):
    refused(tmp_path, "not a MERL file: it is not a regular file.")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_a_pipe_is_refused_without_waiting_for_it(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    raised = []

    def attempt():
        try:
            read_merl(path)
        except MerlFormatError as error:
            raised.append(str(error))

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(timeout=5)
    assert raised == [f"{path}: not a MERL file: it is not a regular file."]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.binary"):
        read_merl(tmp_path / "nothing.binary")


@given(content=st.binary(max_size=64) | st.binary(max_size=64).map(lambda rest: HEADER + rest))
def test_random_bytes_are_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "random.binary"
    path.write_bytes(content)
    with pytest.raises(MerlFormatError, match=r"random\.binary: not a .*MERL file: "):
        read_merl(path)


@given(size=st.integers(0, 2 * N_BYTES).filter(lambda size: size != N_BYTES))
def test_any_other_size_is_refused(tmp_path_factory, size):
    path = sparse(tmp_path_factory.getbasetemp() / "size.binary", HEADER, size)
    with pytest.raises(MerlFormatError, match=f"{size:,}"):
        read_merl(path)


# NBRDF-decoded files


@pytest.mark.shared
def test_decoded_file_has_the_share_of_valid_entries_that_the_horizon_leaves(decoded):
    """The decoder takes entries at the lower edges of cells, and marks what is below the horizon there."""
    measured = read_merl(decoded("red-phenolic"), convention="edge")
    angles = np.meshgrid(measured.theta_h, measured.theta_d, measured.phi_d, indexing="ij")
    wi, wo = to_directions(*angles)
    height = np.minimum(wi[..., 2], wo[..., 2])
    clear = np.abs(height) > 1e-9
    for channel in range(3):
        assert_array_equal(measured.valid[..., channel][clear], height[clear] > 0.0)
    assert 0.76 < measured.valid.mean() < 0.765


@pytest.mark.shared
def test_channels_of_a_decoded_red_material_are_red_first(decoded, tmp_path):
    path = decoded("red-phenolic")
    measured = read_merl(path)
    red, green, blue = np.nanmedian(measured.values, axis=(0, 1, 2))
    assert red > 3 * green
    assert red > 3 * blue
    write_merl(measured, tmp_path / "copy.binary")
    assert (tmp_path / "copy.binary").read_bytes() == Path(path).read_bytes()
    (tmp_path / "copy.binary").unlink()
