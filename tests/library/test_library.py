"""Libraries of models: what comes back, the built-in one, and files that are none."""

import json
import struct

import numpy as np
import pytest
from spaces import smooth_model

from dsbrdf import library
from dsbrdf.measured import built_in
from dsbrdf.measured.source import Source
from dsbrdf.space import builtin

WI, WO = np.array([0.6, 0.0, 0.8]), np.array([-0.48, 0.36, 0.8])


@pytest.fixture
def path(tmp_path):
    models = [
        smooth_model(i, n_lobes=2 + i % 2, n_channels=1 + 2 * (i % 2)).replace(
            name=f"material {i}",
            source=Source(recorded={"file": f"{i}.binary", "description": "made up"}),
            fit_options={"n_lobes": "auto"},
            errors={"rel": 0.1234567, "albedo": float("nan")},
        )
        for i in range(5)
    ]
    library.write(tmp_path / "some.dsbrdf", models, {"made up": {"licence": "none"}})
    return tmp_path / "some.dsbrdf"


def test_models_come_back_in_single_precision(path):
    opened = library.open(path)
    assert opened.names == tuple(f"material {i}" for i in range(5))
    assert opened.sources == {"made up": {"licence": "none"}}
    assert (len(opened), "material 3" in opened, "nickel" in opened) == (5, True, False)
    for i, name in enumerate(opened.names):
        want, got = smooth_model(i, n_lobes=2 + i % 2, n_channels=1 + 2 * (i % 2)), opened.load(name)
        assert (got.name, got.channels) == (name, want.channels)
        np.testing.assert_allclose(got.eval(WI, WO), want.eval(WI, WO), rtol=1e-5)
        for a, b in zip(got.lobes.parts, want.lobes.parts, strict=True):
            np.testing.assert_array_equal(a, np.clip(b.astype(np.float32), -np.inf, np.inf))
        assert got.errors == {"rel": 0.1235}
        assert got.fit_options == {"n_lobes": "auto"}
        assert got.source.to_json() == {"file": f"{i}.binary", "description": "made up"}


def test_what_was_read_can_be_written_again_to_the_same_bytes(path, tmp_path):
    opened = library.open(path)
    library.write(tmp_path / "again.dsbrdf", map(opened.load, opened.names), opened.sources)
    assert (tmp_path / "again.dsbrdf").read_bytes() == path.read_bytes()


def test_only_the_names_are_read_at_first(path):
    """A damaged record is none of the others' business."""
    opened = library.open(path)
    content = bytearray(path.read_bytes())
    content[opened.starts[2] + 2] = 0
    path.write_bytes(content)
    opened = library.open(path)
    opened.load("material 1")
    with pytest.raises(
        library.LibraryFormatError, match=r"some.dsbrdf: the record of 'material 2' is not sound"
    ):
        opened.load("material 2")


def test_a_file_that_shrinks_while_it_is_open(path):
    opened = library.open(path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(library.LibraryFormatError, match="It has changed since it was opened"):
        opened.load("material 4")


def test_unknown_names():
    with pytest.raises(ValueError, match=r"no material 'nikel' among the 106 .* Near are nickel"):
        library.load("nikel")


def with_header(path, change):
    content = path.read_bytes()
    n_header, n = struct.unpack("<II", content[8:16])
    header, rest = json.loads(content[16 : 16 + n_header]), content[16 + n_header :]
    change(header)
    text = json.dumps(header).encode()
    index = np.frombuffer(rest[: 8 * (n + 1)], "<u8") + len(text) - n_header
    return (
        content[:8]
        + struct.pack("<II", len(text), n)
        + text
        + index.astype("<u8").tobytes()
        + rest[8 * (n + 1) :]
    )


def test_names_must_be_names(path):
    for names, match in (
        (["a", "b"], "5 materials have no list of as many names"),
        (["a", "b", "c", "d", "a"], "the name 'a' is there twice"),
        (["a", "b", "c", "d", "../e"], r"'../e' is no name of a material"),
        (["a", "b", "c", "d", 5], "5 is no name of a material"),
        (["a", "b", "c", "d", "\x1b[2J"], ".* is no name of a material"),
    ):
        broken = path.with_name("broken.dsbrdf")
        broken.write_bytes(with_header(path, lambda header, names=names: header.update(names=names)))
        with pytest.raises(library.LibraryFormatError, match=f"broken.dsbrdf: not a sound library: {match}"):
            library.open(broken)


def test_other_constants(path):
    path.write_bytes(with_header(path, lambda header: header.update(azimuthal_width=3.0)))
    with pytest.raises(
        library.LibraryFormatError, match=r"an azimuthal width of 3\.0, where this version has"
    ):
        library.open(path)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "does not begin with"),
        (b"PK\x03\x04 anything", "does not begin with"),
        (b"dsbrdfL1\x00", "ends after 9 bytes"),
        (b"dsbrdfL1" + struct.pack("<II", 0xFFFFFFFF, 0xFFFFFFFF), "do not go into 16 bytes"),
        (
            b"dsbrdfL1" + struct.pack("<II", 2, 0) + b"{}" + struct.pack("<Q", 26),
            "'azimuthal_width' is missing",
        ),
        (b"dsbrdfL1" + struct.pack("<II", 2, 0) + b"[]" + struct.pack("<Q", 26), "not a sound library"),
        (b"dsbrdfL1" + struct.pack("<II", 2, 0) + b"{}" + struct.pack("<Q", 2**63), "do not fill the file"),
    ],
)
def test_files_that_are_no_libraries(tmp_path, content, match):
    (tmp_path / "x.dsbrdf").write_bytes(content)
    with pytest.raises(library.LibraryFormatError, match=match):
        library.open(tmp_path / "x.dsbrdf")


def test_no_byte_of_a_file_can_make_more_than_an_error_by_name(path):
    """Every byte turned over in turn: it opens or is refused, and so does each model."""
    content = path.read_bytes()
    for at in range(0, len(content), 3):
        broken = bytearray(content)
        broken[at] ^= 0xFF
        path.write_bytes(broken)
        try:
            opened = library.open(path)
            for name in opened.names:
                opened.load(name)
        except library.LibraryFormatError as error:
            assert str(path) in str(error)  # noqa: PT017


def test_what_cannot_be_written(tmp_path):
    model = smooth_model(0)
    for models, match in (
        ([model.replace(name="")], "is no name of a material"),
        ([model.replace(name="a"), model.replace(name="a")], "is there twice"),
        ([model.replace(name="a", lobes=model.lobes.replace(scale=model.lobes.scale * 1e40))], "too large"),
    ):
        with pytest.raises(ValueError, match=match):
            library.write(tmp_path / "x.dsbrdf", models)
    assert not list(tmp_path.iterdir())


def test_the_built_in_library():
    names = library.names()
    assert len(names) == 106
    assert library.builtin().path.stat().st_size < 1300 * len(names)
    assert not set(names) & set(built_in.names())
    errors = []
    for name in names:
        model = library.load(name)
        about = library.builtin().sources[model.source.description]
        assert about["licence"]
        assert about["citation"]
        assert len(model.source.to_json()["sha256"]) == 64
        errors.append(model.errors["cbrt"])
    assert np.median(errors) < 0.03


def test_the_built_in_space_leaves_out_what_it_is_told_to():
    space = builtin()
    assert space.names == library.names()
    rest = builtin(without=["nickel", "brass"])
    assert set(space.names) - set(rest.names) == {"nickel", "brass"}
    assert len(builtin(without="nickel").names) == 105
    with pytest.raises(ValueError, match="no material 'nikel' in this space"):
        builtin(without=["nikel"])
