"""`export`: what it writes, what it refuses, and the command."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from by_hand import by_hand
from pairs import random_pairs

import dsbrdf
from dsbrdf import _files, read_merl
from dsbrdf.cli import main
from dsbrdf.export import FORMATS, colour, export
from dsbrdf.geometry.colour import srgb_weights
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.shader import LANGUAGES

MODEL = by_hand([1.5, 0.1], [150.0, 0.5], [-0.3, 0.1], name="made up")
ONE_CHANNEL = by_hand([0.5], [3.0], [0.0], tint=(1.0,))
TWO_CHANNELS = by_hand([0.5], [3.0], [0.0], tint=(1.0, 0.5))
EXAMPLE = Path(__file__).parents[2] / "examples" / "stock_mitsuba.py"


@pytest.fixture
def model_file(tmp_path):
    path = tmp_path / "made-up.json"
    MODEL.save(path)
    return path


def test_every_format_writes_a_file(tmp_path):
    heads = {
        "rgl": b"tensor_file\0",
        "rgl-spectral": b"tensor_file\0",
        "merl": np.array([90, 90, 180], "<i4").tobytes(),
        "brdf": b"analytic",
        **dict.fromkeys(LANGUAGES, b"// made up, written by dsbrdf"),
        "principled": b"{",
        "gltf": b"{",
        "glb": b"glTF",
        "openpbr": b"<?xml",
        "usd": b"#usda",
        "blender": b"# made up",
    }
    assert heads.keys() == FORMATS.keys()
    for name, head in heads.items():
        path = tmp_path / f"x.{FORMATS[name].suffix}"
        lost = export(MODEL, path, name)
        assert path.read_bytes().startswith(head)
        assert (lost is None) == FORMATS[name].exact
        # What says that we wrote it is replaced
        if name != "merl":
            export(MODEL, path, name)
    assert len(list(tmp_path.iterdir())) == len(FORMATS)


def test_a_merl_file_holds_the_values_of_the_model(tmp_path):
    export(MODEL, tmp_path / "x.binary", "merl")
    table = read_merl(tmp_path / "x.binary")
    i, j, k = np.array([[0, 5, 30], [20, 3, 44], [60, 89, 120], [70, 10, 20]]).T
    expected = MODEL.eval_angles(table.theta_h[i], table.theta_d[j], table.phi_d[k])
    valid = table.valid[i, j, k, 0]
    assert valid.tolist() == [True, True, False, True]
    np.testing.assert_allclose(table.values[i, j, k][valid], expected[valid], rtol=1e-12)


@pytest.mark.parametrize("name", FORMATS)
def test_formats_refuse_channels_that_tell_no_colour(name, tmp_path):
    with pytest.raises(ValueError, match=r"its 2 channels \(0, 1\) tell no colour\. Choose one or three"):
        export(TWO_CHANNELS, tmp_path / "x", name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["rgl", "merl", "glsl", "gltf", "openpbr", "usd", "blender", "principled"])
def test_one_channel_is_grey(name, tmp_path):
    grey, again = tmp_path / "grey", tmp_path / "again"
    export(ONE_CHANNEL, grey, name)
    three = by_hand([0.5], [3.0], [0.0], tint=(1.0, 1.0, 1.0), name=ONE_CHANNEL.name)
    export(three, again, name)
    assert grey.read_bytes() == again.read_bytes()


def test_channels_are_chosen_by_name(tmp_path):
    """Red stays red wherever it stands."""
    export(MODEL, tmp_path / "bgr.glsl", "glsl", channels=("b", "g", "r"))
    export(MODEL, tmp_path / "rgb.glsl", "glsl")
    assert (tmp_path / "bgr.glsl").read_bytes() == (tmp_path / "rgb.glsl").read_bytes()
    with pytest.raises(ValueError, match=r"there is no channel 'x'; the model has r, g, b\."):
        export(MODEL, tmp_path / "x.glsl", "glsl", channels=("r", "x", "b"))


def spectral_model():
    """Seven wavelengths, more red than blue."""
    nm = np.linspace(400.0, 700.0, 7)
    model = by_hand([0.4, 0.8], [0.3, 60.0], [0.0, 0.0], tint=tuple(0.3 + (nm - 400.0) / 300.0))
    return model.replace(channels=[f"{x:g}nm" for x in nm]), nm


def test_wavelengths_become_colours(rng):
    model, nm = spectral_model()
    wi, wo = random_pairs(rng, 400)
    expected = model.eval(wi, wo) @ srgb_weights(nm).T
    np.testing.assert_allclose(colour.in_colour(model).eval(wi, wo), expected, rtol=1e-12)
    # In any order
    turned = colour.take_channels(model, model.channels[::-1])
    np.testing.assert_allclose(colour.in_colour(turned).eval(wi, wo), expected, rtol=1e-12)


def test_wavelengths_as_lobes(rng):
    model, nm = spectral_model()
    wi, wo = random_pairs(rng, 400)
    expected = model.eval(wi, wo) @ srgb_weights(nm).T
    lobes = colour.lobes_in_colour(model)
    assert lobes.channels == ("r", "g", "b")
    assert np.median(np.abs(lobes.eval(wi, wo) / expected - 1.0)) < 0.01


def test_wavelengths_stay_in_a_spectral_file(tmp_path, rng):
    """Each wavelength of the file is the channel of the model."""
    model, nm = spectral_model()
    shuffled = colour.take_channels(model, [model.channels[i] for i in (3, 0, 6, 1, 5, 2, 4)])
    export(shuffled, tmp_path / "x.bsdf", "rgl-spectral")
    raw = read_rgl(tmp_path / "x.bsdf")
    np.testing.assert_array_equal(raw.wavelengths, nm)
    wi, wo = random_pairs(rng, 400)
    some = (wi[:, 2] > 0.3) & (wo[:, 2] > 0.3)
    expected = model.eval(wi[some], wo[some])
    assert np.median(np.abs(raw.eval(wi[some], wo[some]) / expected - 1.0)) < 0.01


# What may be replaced


def test_a_foreign_file_is_kept(tmp_path):
    path = tmp_path / "x.gltf"
    path.write_text("of another program")
    with pytest.raises(FileExistsError, match=r"x\.gltf is there already, and dsbrdf did not write it\."):
        export(MODEL, path, "gltf")
    assert path.read_text() == "of another program"
    export(MODEL, path, "gltf", force=True)
    assert _files.is_ours(path)


def test_the_measurement_is_kept_even_by_force(table_file, tmp_path):
    measured = tmp_path / "gold.binary"
    shutil.copy(table_file, measured)
    model = MODEL.replace(source=read_merl(measured).source)
    model.save(tmp_path / "gold.json")
    for of in (model, dsbrdf.load(tmp_path / "gold.json")):
        for path in (measured, tmp_path / "copy.binary"):
            if path != measured:
                shutil.copy(table_file, path)
            before = path.read_bytes()
            with pytest.raises(FileExistsError, match="is what this is made from, and is not replaced"):
                export(of, path, "merl", force=True)
            assert path.read_bytes() == before


def test_an_unknown_format(tmp_path):
    with pytest.raises(ValueError, match=r"'format' must be one of rgl, .*, got 'obj'\."):
        export(MODEL, tmp_path / "x", "obj")


# The command


def test_the_command_writes_beside_the_model(model_file, capsys):
    assert main(["export", str(model_file), "-t", "brdf"]) == 0
    out = capsys.readouterr().out
    assert out == f"Written: {model_file.with_suffix('.brdf')}\n"
    assert model_file.with_suffix(".brdf").read_text().startswith("analytic")


def test_the_command_tells_what_the_nearest_material_loses(model_file, tmp_path, capsys):
    out = tmp_path / "out" / "preview.json"
    assert main(["export", str(model_file), "--to", "gltf", "-o", str(out)]) == 0
    told = re.search(
        r"the glTF material is .* cos cos ([\d.]+) %, CIEDE2000 of a sphere ([\d.]+)\.",
        capsys.readouterr().err,
    )
    (material,) = json.loads(out.read_text())["materials"]
    assert material["name"] == "made up"
    stored = material["extras"]["dsbrdf"]
    assert [100.0 * stored["error_cbrt"], stored["ciede2000"]] == pytest.approx(
        [*map(float, told.groups())], abs=0.06
    )


def test_each_format_has_a_name_of_its_own():
    suffixes = [entry.suffix for entry in FORMATS.values()]
    assert len(set(suffixes)) == len(suffixes)
    assert "json" not in suffixes
    assert "binary" not in suffixes


def test_the_command_keeps_what_it_reads(model_file, tmp_path, capsys):
    link = tmp_path / "link.json"
    link.symlink_to(model_file)
    before = model_file.read_bytes()
    for out in (model_file, link):
        assert main(["export", str(model_file), "-t", "principled", "-o", str(out), "--force"]) == 2
        assert "is what this is made from, and is not replaced" in capsys.readouterr().err
    assert model_file.read_bytes() == before


def test_the_command_asks_for_force(model_file, capsys):
    out = model_file.with_suffix(".brdf")
    out.write_text("of another program")
    assert main(["export", str(model_file), "-t", "brdf"]) == 2
    assert "dsbrdf did not write it. Give another name, or add --force" in capsys.readouterr().err
    assert main(["export", str(model_file), "-t", "brdf", "--force"]) == 0
    assert main(["export", str(model_file), "-t", "brdf"]) == 0


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_commands_fit_what_was_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "matte", "-t", "glsl"]) == 0
    assert (tmp_path / "matte.glsl").read_text().startswith("// matte")
    assert main(["check", "matte"]) == 0
    assert main(["info", "matte"]) == 0
    assert "albedo at" in capsys.readouterr().out


def test_the_command_takes_channels(model_file, tmp_path):
    out = tmp_path / "grey.glsl"
    assert main(["export", str(model_file), "-t", "glsl", "-o", str(out), "--channels", "g"]) == 0
    chosen = colour.take_channels(MODEL, ["g"])
    export(chosen, tmp_path / "again.glsl", "glsl")
    assert out.read_text() == (tmp_path / "again.glsl").read_text()


def test_the_command_lists_the_formats(model_file, capsys):
    assert main(["export", str(model_file), "-t", "obj"]) == 2
    assert f"expected one of {', '.join(FORMATS)}, got 'obj'" in capsys.readouterr().err
    assert main(["export", "--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"{name}: " in out for name in FORMATS)


def test_the_example_renders_with_stock_mitsuba(tmp_path):
    pytest.importorskip("mitsuba")
    picture = tmp_path / "spheres.png"
    command = [sys.executable, "-W", "error", str(EXAMPLE), str(picture), "16", "4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
