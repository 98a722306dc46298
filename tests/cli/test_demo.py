"""The demonstration."""

import sys

import numpy as np
import pytest

import dsbrdf
from dsbrdf import Lobes, cli, plot
from dsbrdf.cli import _demo
from dsbrdf.measured import built_in
from dsbrdf.model.components import components

# Some materials run out of iterations
pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


def test_rows_and_models(tmp_path):
    told = []
    (row,) = _demo.run(tmp_path / "a" / "b", ["rough-gold"], plots=False, step=told.append)
    assert told == ["rough-gold"]
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["rough-gold.json"]
    model = dsbrdf.load(row.path)
    for written, fitted in zip(model.lobes.parts, row.fit.model.lobes.parts, strict=True):
        np.testing.assert_array_equal(written, fitted)
    assert row.albedo == pytest.approx(model.albedo(0.0).mean())
    assert row.n_table == 3 * 90 * 90 * 180


def test_command_prints_a_row_and_writes_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(_demo, "MATERIALS", {"matte": "what there is to see"})
    assert cli.main(["demo", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    (line,) = [line.split() for line in out.splitlines() if line.startswith("matte ")]
    model = dsbrdf.load(tmp_path / "matte.json")
    assert line[1] == f"{model.n_lobes}"
    assert line[2:7] == [
        f"{model.errors[key]:.3f}" for key in ("rel", "cbrt", "log", "albedo", "bivariate_floor")
    ]
    assert line[7] == f"{model.albedo(0.0).mean():.3f}"
    assert line[9] == f"{model.n_parameters}"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["matte.json", "matte.png", _demo.OVERVIEW]
    assert str(tmp_path) in out
    assert "\nmatte: what there is to see\n" in out


def test_materials_of_the_demonstration():
    """Each is built in, and explained in a sentence or two that its figure has room for."""
    assert set(_demo.MATERIALS) < set(built_in.names())
    assert all(20 < len(note) < 4 * plot.model.NOTE_WIDTH for note in _demo.MATERIALS.values())


def test_without_matplotlib_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "dsbrdf.plot", raising=False)
    monkeypatch.delattr(dsbrdf, "plot", raising=False)
    with pytest.raises(ModuleNotFoundError, match=r'needs matplotlib: pip install "dsbrdf\[plot\]"'):
        _demo.run(tmp_path, ["matte"])
    assert not list(tmp_path.iterdir())


def test_an_unknown_material(tmp_path):
    with pytest.raises(ValueError, match="unknown built-in material 'mat'"):
        _demo.run(tmp_path, ["mat"], plots=False)
    assert not list(tmp_path.iterdir())


def test_info_tells_what_a_model_is(tmp_path, capsys):
    _demo.run(tmp_path, ["glossy-plastic"], plots=False)
    path = tmp_path / "glossy-plastic.json"
    model = dsbrdf.load(path)
    assert cli.main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    before_albedos = out[: out.index("albedo at")].splitlines()
    told = {line.split()[0]: line.split()[1:] for line in before_albedos if line.strip()}
    assert told["numbers"] == [f"{model.n_parameters}"]
    assert told["channels"] == ["3:", "r,", "g,", "b"]
    for key in ("rel", "cbrt", "log"):
        assert told[key] == [f"{model.errors[key]:.4f}"]
    for part in components(model):
        kind, share, share_oblique, width, *colour = told[f"{part.lobe}"][:7]
        assert kind == part.label
        expected = [100 * part.share, 100 * part.share_oblique]
        assert [float(share), float(share_oblique)] == pytest.approx(expected, abs=0.06)
        assert float(width) == pytest.approx(np.rad2deg(part.half_width), abs=0.006)
        np.testing.assert_allclose(np.array(colour, dtype=float), part.colour, atol=0.006)
    assert out.splitlines()[-1].split() == [
        "75",
        "degrees",
        *(f"{x:.3f}" for x in model.albedo(np.deg2rad(75.0))),
    ]


def test_info_of_many_channels_tells_of_some(tmp_path, capsys):
    n = 31
    names = [f"{400 + 10 * i}nm" for i in range(n)]
    lobes = Lobes(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((n, 1, 1)))
    dsbrdf.DSBRDF(lobes, names).save(tmp_path / "spectral.json")
    assert cli.main(["info", str(tmp_path / "spectral.json")]) == 0
    out = capsys.readouterr().out
    assert "31: 400nm, 440nm, 490nm, 530nm, 570nm, 610nm, 660nm, 700nm" in out
