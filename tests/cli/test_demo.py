"""The demonstration."""

import sys

import numpy as np
import pytest

import dsbrdf
from dsbrdf import cli
from dsbrdf.cli import _demo

# A few slices of some materials run out of iterations
pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


def test_rows_and_models(tmp_path):
    told = []
    (row,) = _demo.run(tmp_path / "a" / "b", ["rough-gold"], plots=False, step=told.append)
    assert told == ["rough-gold"]
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["rough-gold.json"]
    model = dsbrdf.load(row.path)
    np.testing.assert_array_equal(model.kappa, row.fit.model.kappa)
    assert row.albedo == pytest.approx(model.albedo(0.0).mean())
    assert row.table_bytes == 3 * 90 * 90 * 180 * 8
    assert row.table_bytes > 2000 * row.model_bytes


def test_command_prints_a_row_and_writes_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("dsbrdf.measured.built_in.names", lambda: ("matte",))
    assert cli.main(["demo", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    (line,) = [line.split() for line in out.splitlines() if line.startswith("matte")]
    model = dsbrdf.load(tmp_path / "matte.json")
    assert line[1] == f"{model.n_lobes}"
    assert line[2:6] == [
        f"{100 * model.errors[key]:.2f}"
        for key in ("rel_rms", "bivariate_floor", "monotone_floor", "azimuthal_floor")
    ]
    assert line[6] == f"{model.albedo(0.0).mean():.3f}"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["matte.json", "matte.png", _demo.OVERVIEW]
    assert str(tmp_path) in out


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
