"""What README.md shows runs as it stands."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[2] / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def test_python_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python")
    exec(compile(code, str(README), "exec"), {})
    assert "rel 0.0" in capsys.readouterr().out
    assert (tmp_path / "rough-gold.json").stat().st_size > 1000


def test_commands_exist():
    from typer.testing import CliRunner

    from dsbrdf.cli import app

    texts = [*blocks("sh"), *re.findall(r"`(dsbrdf [^`]*)`", README.read_text(encoding="utf-8"))]
    commands = set(re.findall(r"^dsbrdf ([a-z]+)", "\n".join(texts), re.MULTILINE))
    # Each question has its command
    assert commands >= {
        "fit",
        "info",
        "view",
        "render",
        "check",
        "export",
        "convert",
        "photo",
        "plan",
        "space",
    }
    for command in commands:
        assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0


@pytest.mark.parametrize(
    "document",
    [
        "README.md",
        "CONTRIBUTING.md",
        *sorted(str(p.relative_to(README.parent)) for p in (README.parent / "docs").rglob("*.md")),
    ],
)
def test_links_lead_somewhere(document):
    path = README.parent / document
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", path.read_text(encoding="utf-8")):
        assert (path.parent / target).exists(), f"{document}: {target}"
