"""`export`: what it writes, what it refuses, and the command."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from by_hand import by_hand

from dsbrdf import read_merl
from dsbrdf.cli import main
from dsbrdf.export import FORMATS, export

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
        "glsl": b"// made up",
        "principled": b"{",
        "gltf": b"{",
    }
    assert heads.keys() == FORMATS.keys()
    for name, head in heads.items():
        path = tmp_path / f"{name}.{FORMATS[name].suffix}"
        lost = export(MODEL, path, name)
        assert path.read_bytes().startswith(head)
        assert (lost is not None) == (name in ("principled", "gltf"))


def test_a_merl_file_holds_the_values_of_the_model(tmp_path):
    export(MODEL, tmp_path / "x.binary", "merl")
    table = read_merl(tmp_path / "x.binary")
    i, j, k = np.array([[0, 5, 30], [20, 3, 44], [60, 89, 120], [70, 10, 20]]).T
    expected = MODEL.eval_angles(table.theta_h[i], table.theta_d[j], table.phi_d[k])
    valid = table.valid[i, j, k, 0]
    assert valid.tolist() == [True, True, False, True]
    np.testing.assert_allclose(table.values[i, j, k][valid], expected[valid], rtol=1e-12)


@pytest.mark.parametrize("name", FORMATS)
def test_formats_refuse_two_channels(name, tmp_path):
    with pytest.raises(ValueError, match="channel"):
        export(TWO_CHANNELS, tmp_path / "x", name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["merl", "principled", "gltf"])
def test_colour_formats_say_what_to_do(name, tmp_path):
    with pytest.raises(
        ValueError, match=r"has 3 channels, linear sRGB; the model has 1\. Make a model of three"
    ):
        export(ONE_CHANNEL, tmp_path / "x", name)


def test_an_unknown_format(tmp_path):
    with pytest.raises(ValueError, match=r"'format' must be one of rgl, .*, got 'obj'\."):
        export(MODEL, tmp_path / "x", "obj")


# The command


def test_the_command_writes_beside_the_model(model_file, capsys):
    assert main(["export", str(model_file), "-t", "brdf"]) == 0
    out = capsys.readouterr().out
    assert out == f"Written: {model_file.with_suffix('.brdf')}\n"
    assert model_file.with_suffix(".brdf").read_text().startswith("analytic")


def test_the_command_tells_what_a_preview_loses(model_file, tmp_path, capsys):
    out = tmp_path / "out" / "preview.json"
    assert main(["export", str(model_file), "--to", "gltf", "-o", str(out)]) == 0
    assert "a glTF material is a preview: relative RMS" in capsys.readouterr().err
    assert json.loads(out.read_text())["materials"][0]["name"] == "made up"


def test_the_command_keeps_the_model(model_file, capsys):
    before = model_file.read_bytes()
    assert main(["export", str(model_file), "-t", "principled"]) == 2
    assert "is read by this command: give another name" in capsys.readouterr().err
    assert model_file.read_bytes() == before


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
