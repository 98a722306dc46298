"""What docs/formats.md and the examples show runs as it stands."""

import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

import dsbrdf
from dsbrdf import cli

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "formats.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with the files that the page names."""
    monkeypatch.chdir(tmp_path)
    measured = dsbrdf.material("satin-plastic")
    dsbrdf.write_merl(measured, "nickel.binary")
    dsbrdf.fit(measured, 2).model.save("nickel.json")
    (tmp_path / "materials").mkdir()
    (tmp_path / "materials" / "a.binary").symlink_to(tmp_path / "nickel.binary")
    return tmp_path


@pytest.mark.slow
def test_the_page_runs_from_top_to_bottom(folder, capsys):
    blocks = re.findall(r"```(python|sh)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert [language for language, _ in blocks] == ["python", "sh", "python"]
    for language, code in blocks:
        if language == "python":
            exec(compile(code, str(PAGE), "exec"), {})
            out = capsys.readouterr().out
            assert out.startswith(("measured: theta_d only", "nickel.bsdf: relative RMS"))
            continue
        for line in code.splitlines():
            assert cli.main(shlex.split(line)[1:]) == 0
            assert re.fullmatch(
                r".*: relative RMS [\d.e-]+, [\d.]+% of the entries valid\n", capsys.readouterr().out
            )
    assert {"nickel.npz", "nickel-fitted.binary", "scan.tsv", "back.binary"} <= {
        p.name for p in folder.iterdir()
    }


def example(monkeypatch, name, *arguments):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")


def test_a_scan_becomes_a_model(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example(monkeypatch, "csv_scan.py")
    out = capsys.readouterr().out
    assert out.startswith("Samples('scan', 200 pairs of directions, 3 channels, weighted)\n")
    assert float(re.search(r"rel ([\d.]+)", out)[1]) < 0.05
    assert "95 % at 45 degrees, normal view: r 0." in out
    assert dsbrdf.load("scan.json").name == "scan"
    example(monkeypatch, "csv_scan.py", "scan.csv")
    assert capsys.readouterr().out == out


@pytest.mark.shared
def test_rgl_becomes_merl(data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example(monkeypatch, "rgl_to_merl.py", data / "data" / "rgl" / "vch_silk_blue_rgb.bsdf")
    assert capsys.readouterr().out.startswith("vch_silk_blue_rgb.binary: relative RMS 0.0")
    assert dsbrdf.read("vch_silk_blue_rgb.binary").valid.mean() == pytest.approx(0.624, abs=1e-3)


def test_the_example_tells_how_it_is_used(monkeypatch):
    with pytest.raises(SystemExit, match="Run as"):
        example(monkeypatch, "rgl_to_merl.py")
