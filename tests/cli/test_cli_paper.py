"""`dsbrdf paper` at the command line."""

import pytest
from typer.testing import CliRunner

from dsbrdf.cli import app


def test_writes_a_figure(tmp_path):
    done = CliRunner().invoke(app, ["paper", "fig1", "-o", str(tmp_path / "out")], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "fig1.png").stat().st_size > 5000
    assert "fig1.png" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(["fig99"], "'what' must be one of"), (["table", "--data", "nowhere"], "nowhere")],
)
def test_says_what_is_wrong(tmp_path, monkeypatch, capsys, arguments, text):
    from dsbrdf import cli

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["dsbrdf", "paper", *arguments, "-o", "out"])
    assert cli.main() in (1, 2)
    assert text in capsys.readouterr().err
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())
