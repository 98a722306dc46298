"""Model files: exact round trips, the golden file of each schema, hostile content, and writes that fail."""

import dataclasses
import json
import os
import re
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import DSBRDF, ModelFormatError, _files, load
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.source import Source
from dsbrdf.model.file import LOBES, MAX_BYTES, SCHEMA
from dsbrdf.model.lobes import Lobes

GOLDEN = Path(__file__).parents[1] / "golden"
FILES = sorted(file for file in GOLDEN.glob("model-*.json") if "values" not in file.stem)


def random_model(rng, sizes=(5, 4, 3, 1, 2), n_channels=3, n_lobes=2):
    scale, gamma, beta, falloff, colour = sizes
    return DSBRDF(
        Lobes(
            rng.uniform(-30.0, 6.0, (n_lobes, scale)),
            rng.uniform(-14.0, 14.0, (n_lobes, gamma)),
            rng.uniform(-1.0, 1.0, (n_lobes, beta)),
            rng.uniform(-0.9, 20.0, (n_lobes, falloff)),
            rng.uniform(-1e-6, 0.4, (n_channels, n_lobes, colour)),
        ),
        channels=[f"{k} nm" for k in range(n_channels)],
        name='a "quoted" näme\n',
        source=Source(
            description="made up", recorded={"file": "a.binary", "sha256": None, "description": "made up"}
        ),
        fit_options={"loss": "log", "n_lobes": n_lobes, "prior": False, "share": 1 / 3},
        errors={"rel": 0.1 + 0.2, "bivariate_floor": 1e-300},
    )


@pytest.fixture
def model(rng):
    return random_model(rng)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "m.json"


@pytest.fixture
def content(model, path):
    """What a sound file holds, to spoil."""
    model.save(path)
    return json.loads(path.read_text())


def refused(path, content, text):
    """Refused with a message that begins with the file and `text`."""
    if not isinstance(content, str | bytes):
        content = json.dumps(content)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(ModelFormatError, match=f"^{re.escape(f'{path}: {text}')}") as caught:
        load(path)
    assert len(str(caught.value)) < len(str(path)) + 400


def message_of(path):
    """Why `path` is refused, None if it is read."""
    try:
        load(path)
    except ModelFormatError as error:
        return str(error)
    return None


# Round trips


@pytest.mark.parametrize(
    ("sizes", "n_channels", "n_lobes"), [((1,) * 5, 1, 1), ((5, 4, 3, 1, 2), 3, 2), ((6, 7, 2, 3, 4), 31, 10)]
)
def test_everything_comes_back_to_the_last_bit(path, rng, sizes, n_channels, n_lobes):
    model = random_model(rng, sizes, n_channels, n_lobes)
    model.save(path)
    back = load(path)
    for key in LOBES:
        assert_array_equal(getattr(back.lobes, key), getattr(model.lobes, key))
        assert getattr(back.lobes, key).dtype == np.float64
    assert back.channels == model.channels
    assert back.name == model.name
    assert back.source.to_json() == model.source.to_json()
    assert back.source.description == "made up"
    assert back.fit_options == model.fit_options
    assert back.errors == model.errors
    assert back.profile is None


def test_saving_what_was_loaded_gives_the_same_file(model, path):
    model.save(path)
    load(path).save(path.with_name("again.json"))
    assert path.with_name("again.json").read_bytes() == path.read_bytes()


@given(value=st.floats(-20.0, 3.0))
def test_any_number_of_a_model_comes_back(tmp_path_factory, value):
    path = tmp_path_factory.getbasetemp() / "number.json"
    one = np.full((1, 1), value)
    DSBRDF(Lobes(one, one, one, 0 * one, one[None])).save(path)
    assert_array_equal(load(path).lobes.scale, one)


def test_layout_of_schema_1(model, path):
    model.save(str(path))
    content = json.loads(path.read_text(encoding="utf-8"))
    assert list(content) == [
        "format",
        "schema",
        "name",
        "units",
        "formula",
        "azimuthal_width",
        "channels",
        "lobes",
        "source",
        "fit",
        "errors",
    ]
    assert content["format"] == "dsbrdf model"
    assert content["schema"] == SCHEMA == 1
    assert content["channels"] == ["0 nm", "1 nm", "2 nm"]
    assert list(content["lobes"]) == ["scale", "gamma", "beta", "falloff", "colour"]
    assert_array_equal(content["lobes"]["colour"], model.lobes.colour)
    assert path.read_bytes().endswith(b"}\n")


def test_profile_comes_back_to_some_digits(model, path, rng):
    mean = rng.lognormal(size=(2, 3, 5))
    mean[0, 1, 2:] = np.nan
    theta_h = np.tile(np.linspace(0.0, 1.5, 5), (2, 1))
    profile = MeasuredProfile([0.1, 0.7], theta_h, mean, -0.1 * mean)
    model.replace(profile=profile).save(path)
    back = load(path).profile
    for name in ("theta_d", "theta_h", "mean", "amplitude"):
        rtol = {"mean": 5e-3, "amplitude": 5e-2}.get(name, 5e-5)
        assert_allclose(getattr(back, name), getattr(profile, name), rtol=rtol)
    assert len(json.loads(path.read_text())["profile"]["theta_h"]) == 1
    # Slices of scattered samples have theta_h of their own
    theta_h[1] *= 0.9
    model.replace(profile=MeasuredProfile([0.1, 0.7], theta_h, mean, mean)).save(path)
    assert_allclose(load(path).profile.theta_h, theta_h, rtol=5e-5)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"theta_d": [0.1]}, "a profile's 'mean' and 'amplitude' must"),
        ({"mean": [[1.0]]}, "'mean' of a profile must have 3 axes, the first of 2 slices"),
        ({"amplitude": [[[1.0]], [[1.0]]]}, "a profile's 'mean' and 'amplitude' must have shape"),
    ],
)
def test_a_profile_of_wrong_shape_is_refused(path, change, text):
    content = json.loads((GOLDEN / "model-schema-1.json").read_text())
    content["profile"] |= change
    if "theta_d" in change:
        text = "'mean' of a profile must have 3 axes, the first of 1 slices"
    refused(path, content, f"not a sound model: {text}")


def test_another_azimuthal_width_is_refused(path, content):
    content["azimuthal_width"] = 0.03
    refused(path, content, "an azimuthal width of 0.03, where this version has 0.01. Fit the material again.")


def test_source_of_a_file_is_recorded_by_name_and_hash(model, tmp_path, path):
    (tmp_path / "a.binary").write_bytes(b"abc")
    model.replace(source=Source(tmp_path / "a.binary", "text")).save(path)
    (tmp_path / "a.binary").unlink()
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert load(path).source.to_json() == {"file": "a.binary", "sha256": digest, "description": "text"}
    assert str(tmp_path) not in path.read_text()


def test_errors_that_are_not_a_number_are_null_in_the_file(model, path):
    model.replace(errors={"rel": np.nan, "albedo": 0.5}).save(path)

    def not_json(constant):
        raise AssertionError(constant)

    assert json.loads(path.read_text(), parse_constant=not_json)["errors"]["rel"] is None
    errors = load(path).errors
    assert np.isnan(errors["rel"])
    assert errors["albedo"] == 0.5


def test_options_of_numpy_types_are_written_as_plain_ones(model, path):
    options = {
        "n_lobes": np.int64(9),
        "prior": np.bool_(True),
        "x": np.float32(0.5),
        "y": np.arange(2),
    }
    model.replace(fit_options=options).save(path)
    assert load(path).fit_options == {"n_lobes": 9, "prior": True, "x": 0.5, "y": [0, 1]}


def test_parameters_of_other_arrays_are_written_as_numbers(path):
    jnp = pytest.importorskip("jax.numpy")
    values = jnp.asarray([[0.1, 0.2]], dtype=jnp.float32)
    DSBRDF(Lobes(values, values, values, values, values[None])).save(path)
    assert_array_equal(load(path).lobes.scale, np.float32([[0.1, 0.2]]))


def test_what_is_not_needed_may_be_missing_or_null(content, path):
    for key in ("name", "source", "fit", "errors", "units", "formula", "profile"):
        for value in ({}, {key: None}):
            shorter = {k: v for k, v in content.items() if k != key} | value
            path.write_text(json.dumps(shorter))
            back = load(path)
            assert back.name == ("" if key == "name" else content["name"])
            assert (back.errors == {}) == (key == "errors")
            assert (back.fit_options == {}) == (key == "fit")


def test_keys_of_others_are_let_be(content, path):
    path.write_text(json.dumps(content | {"comment": [1, {"a": None}]}))
    assert_array_equal(load(path).lobes.scale, content["lobes"]["scale"])


# Golden files


def test_there_is_a_golden_file_of_every_schema():
    schemas = {json.loads(file.read_text())["schema"] for file in FILES}
    assert schemas == set(range(1, SCHEMA + 1))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_golden_file_is_read_and_has_its_values(file):
    model = load(file)
    frozen = json.loads(file.with_name(f"{file.stem}-values.json").read_text())
    assert_allclose(model.eval_angles(*np.transpose(frozen["angles"])), frozen["values"], rtol=1e-13)


def test_golden_file_of_schema_1_keeps_every_number():
    model = load(GOLDEN / "model-schema-1.json")
    assert model.name == "hand-made"
    assert model.channels == ("450", "650")
    assert_array_equal(model.lobes.scale[0], [0.1, 1 / 3, -0.25, -1.2345678901234567])
    assert model.lobes.gamma[1, 1] == 2 / 3
    assert model.lobes.beta[1, 0] == 1e-17
    assert_array_equal(model.lobes.falloff, [[0.0], [0.9]])
    assert model.lobes.colour[1, 0, 1] == 1e-14
    assert model.source.description == "made by hand: é, 1/sr"
    assert model.source.to_json()["file"] == "hand.binary"
    assert model.fit_options == {"n_lobes": 2, "loss": "log", "prior": False}
    assert model.errors["rel"] == 0.012345678901234567
    assert np.isnan(model.errors["albedo"])
    assert model.profile.mean.shape == (2, 2, 3)
    assert np.isnan(model.profile.mean[0, 0, 2])


# Hostile content


@pytest.mark.parametrize(
    "bad",
    [
        b"",
        b"\n",
        b"not JSON",
        b"{",
        b'{"format": "dsbrdf model",}',
        b"\xef\xbb\xbf{}",
        b"\xff\xfe{\0}\0",
        bytes(range(256)),
        b"\0" * 1000,
        b"Z" * 100_000,
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"1" * 5000,
        b'{"schema": ' + b"1" * 5000 + b"}",
        b"{} {}",
    ],
    ids=lambda bad: repr(bad[:24]),
)
def test_what_is_not_json_is_refused(path, bad):
    refused(path, bad, "not a model file: not JSON (")


@pytest.mark.parametrize(
    "bad",
    [[], {}, '"text"', 1, None, True, [1, 2], {"format": None}, {"format": "dsbrdf library", "schema": 1}],
)
def test_json_of_another_kind_is_refused(path, bad):
    refused(path, bad, 'not a model file: expected "format": "dsbrdf model".')


@pytest.mark.parametrize("schema", [2, 0, -1, 10**30, 1.0, "1", None, [1], {}])
def test_a_schema_that_is_not_known_is_refused(path, content, schema):
    text = f"schema {schema!r} is not among those this version reads (1). Update dsbrdf."
    refused(path, content | {"schema": schema}, text)


def test_a_file_without_schema_is_refused(path, content):
    del content["schema"]
    refused(path, content, "schema None is not among those this version reads (1).")


@pytest.mark.parametrize("key", LOBES)
def test_a_missing_parameter_is_named(path, content, key):
    del content["lobes"][key]
    refused(path, content, f"not a whole model file: '{key}' is missing.")


@pytest.mark.parametrize("key", ["lobes", "channels"])
def test_a_missing_part_is_named(path, content, key):
    del content[key]
    refused(path, content, f"not a whole model file: '{key}' is missing.")


@pytest.mark.parametrize("key", ["source", "fit", "errors"])
@pytest.mark.parametrize(
    ("value", "text"), [("x", "'x'"), ([1], "[1]"), (3, "3"), ("x" * 10**5, "'" + "x" * 39)]
)
def test_parts_that_are_no_objects_are_named(path, content, key, value, text):
    refused(path, content | {key: value}, f'not a sound model: "{key}" must be an object, got {text}.')


SHAPE = "must have shape (lobe, coefficient) with a coefficient at least and as many lobes as 'scale', got"
COLOUR = SHAPE.replace("(lobe,", "(channel, lobe,")
COLOUR = f"'colour' {COLOUR}"


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("scale", [0.1, 0.2], f"'scale' {SHAPE} (2,)."),
        ("scale", [], f"'scale' {SHAPE} (0,)."),
        ("scale", [[], []], f"'scale' {SHAPE} (2, 0)."),
        ("scale", 1.0, f"'scale' {SHAPE} ()."),
        ("scale", None, f"'scale' {SHAPE} ()."),
        ("scale", [[0.1]], f"'gamma' {SHAPE} (2, 4)."),
        ("scale", [[0.1], [None]], "'scale' must be finite, got nan at index (1, 0)."),
        ("scale", [["0.1"], [0.2]], "'scale' must hold numbers, got '0.1'."),
        ("scale", [[True], [0.2]], "'scale' must hold numbers, got True."),
        ("scale", "0.1", "'scale' must hold numbers, got '0.1'."),
        ("scale", {"a": 1}, ""),
        ("scale", ["a"], ""),
        ("scale", [[10**400], [0]], ""),
        ("scale", [[1.0], [1.0, 2.0]], ""),
        ("gamma", np.ones((3, 4)).tolist(), f"'gamma' {SHAPE} (3, 4)."),
        ("beta", np.ones((2, 3, 1)).tolist(), f"'beta' {SHAPE} (2, 3, 1)."),
        (
            "falloff",
            [[0.0], [-1.0]],
            "'falloff' must be >= -0.9 and <= 20 and finite, got -1 at index (1, 0).",
        ),
        (
            "falloff",
            [[0.0], [99.0]],
            "'falloff' must be >= -0.9 and <= 20 and finite, got 99 at index (1, 0).",
        ),
        ("colour", np.ones((2, 2)).tolist(), f"{COLOUR} (2, 2)."),
        ("colour", np.ones((3, 1, 2)).tolist(), f"{COLOUR} (3, 1, 2)."),
        ("colour", np.ones((4, 2, 2)).tolist(), "'channels' must be 4 different names, got ["),
    ],
)
def test_parameters_that_make_no_model_are_refused(path, content, key, value, text):
    content["lobes"][key] = value
    refused(path, content, f"not a sound model: {text}")


@pytest.mark.parametrize("lobes", [[], [1.0], "x", 3, None])
def test_lobes_that_are_no_object_are_refused(path, content, lobes):
    refused(path, content | {"lobes": lobes}, "not a sound model: ")


@pytest.mark.parametrize("channels", [["a", "a", "b"], ["a"], 3, None])
def test_channels_that_are_no_names_are_refused(path, content, channels):
    refused(path, content | {"channels": channels}, "not a sound model: ")


@pytest.mark.parametrize("key", LOBES)
@pytest.mark.parametrize(
    ("number", "got"), [("NaN", "nan"), ("Infinity", "inf"), ("-1e999", "-inf"), ("1e999", "inf")]
)
def test_numbers_that_are_not_finite_are_refused(path, content, key, number, got):
    rows = content["lobes"][key]
    (rows[1] if key == "colour" else rows)[1][0] = "@"
    text = json.dumps(content).replace('"@"', number)
    path.write_text(text)
    at = "1, 1, 0" if key == "colour" else "1, 0"
    with pytest.raises(ModelFormatError, match=rf"'{key}' must be .*, got {got} at index \({at}\)\.$"):
        load(path)


@pytest.mark.parametrize("key", ["name", "source", "fit", "errors", "schema", "lobes", "channels", "other"])
@pytest.mark.parametrize("depth", [50, 500, 900, 950, 980, 990, 995, 100_000])
def test_deep_nesting_is_read_or_refused(path, content, key, depth):
    nested = "[" * depth + "]" * depth
    path.write_text(json.dumps(content | {key: "@"}).replace('"@"', nested))
    message = message_of(path)
    assert (message is None and key in ("name", "other")) or message.startswith(f"{path}: ")


@pytest.mark.parametrize("errors", [{"rel": "much"}, {"rel": [0.1]}, {"rel": 10**400}])
def test_errors_must_be_numbers(path, content, errors):
    refused(path, content | {"errors": errors}, "not a sound model: ")


def test_every_truncation_is_refused(path, model):
    model.save(path)
    whole = path.read_bytes()
    for size in {*range(60), *range(60, len(whole) - 2, 37), len(whole) - 3, len(whole) - 2}:
        refused(path, whole[:size], "not a model file: not JSON (")


def test_a_file_larger_than_any_model_is_not_read(path, model):
    model.save(path)
    os.truncate(path, MAX_BYTES + 1)
    text = "not a model file: 50,000,001 bytes are more than any model has."
    with pytest.raises(ModelFormatError, match=f"^{re.escape(f'{path}: {text}')}$"):
        load(path)


def test_a_merl_file_is_refused(merl_file):
    with pytest.raises(ModelFormatError, match="not a model file: not JSON"):
        load(merl_file)


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.json"):
        load(tmp_path / "nothing.json")
    with pytest.raises(OSError, match=re.escape(str(tmp_path))):
        load(tmp_path)


@given(changes=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_files_are_read_or_refused(tmp_path_factory, changes):
    content = bytearray((GOLDEN / "model-schema-1.json").read_bytes())
    for at, byte in changes:
        content[at % len(content)] = byte
    path = tmp_path_factory.getbasetemp() / "damaged.json"
    path.write_bytes(content)
    assert "damaged.json: " in (message_of(path) or "damaged.json: ")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(
    key=st.sampled_from(
        ["lobes", *LOBES, "channels", "profile", "schema", "name", "source", "fit", "errors"]
    ),
    value=json_values,
)
def test_any_json_in_any_place_is_read_or_refused(tmp_path_factory, key, value):
    content = json.loads((GOLDEN / "model-schema-1.json").read_text())
    path = tmp_path_factory.getbasetemp() / "strange.json"
    (content["lobes"] if key in LOBES else content)[key] = value
    path.write_text(json.dumps(content))
    assert "strange.json: " in (message_of(path) or "strange.json: ")


# Writes that fail


def test_a_failed_write_leaves_the_old_file(model, path):
    model.save(path)
    before = path.read_bytes()
    broken = model.replace(name="new", fit_options={"what": object()})
    with pytest.raises(TypeError, match="object does not fit into JSON"):
        broken.save(path)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_an_interrupted_write_leaves_the_old_file(model, path, monkeypatch):
    model.save(path)
    before = path.read_bytes()
    places = []

    def half_written(self, text, encoding):
        with self.open("w", encoding=encoding) as file:
            file.write(text[: len(text) // 2])
        places.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_text", half_written)
    with pytest.raises(KeyboardInterrupt):
        model.replace(name="new").save(path)
    monkeypatch.undo()
    assert places[0].parent == path.parent, "a rename within a folder cannot fail half-way"
    assert places[0] != path
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_threads_that_write_the_same_file_do_not_share_what_is_half_written(path):
    places = []

    def write():
        with _files.aside(path) as part:
            places.append(part)
            part.write_text("whole")

    with _files.aside(path) as part:
        thread = threading.Thread(target=write)
        thread.start()
        thread.join()
        assert path.read_text() == "whole"
        part.write_text("later")
    assert places[0] != part
    assert path.read_text() == "later"


def test_saving_makes_the_folder(model, tmp_path):
    model.save(tmp_path / "a" / "b" / "m.json")
    assert [file.name for file in (tmp_path / "a" / "b").iterdir()] == ["m.json"]


def test_places_that_cannot_be_written_are_named(model, tmp_path, path):
    path.write_text("x")
    for place, name, kind in [
        (tmp_path, tmp_path, IsADirectoryError),
        (Path(), ".", IsADirectoryError),
        (path / "m.json", path, FileExistsError),
    ]:
        with pytest.raises(kind, match=re.escape(f"'{name}'")):
            model.save(place)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "x"


def test_a_loaded_model_can_be_replaced_and_saved_again(model, path):
    model.save(path)
    load(path).replace(name="other").save(path)
    back = load(path)
    assert back.name == "other"
    assert dataclasses.asdict(back)["errors"] == model.errors
