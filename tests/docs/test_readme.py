"""What README.md shows runs as it stands."""

import re
import runpy
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


def test_links_can_be_made_absolute():
    """For PyPI, which shows the page without its repository."""
    absolute = runpy.run_path(str(README.parent / "tools" / "absolute_links.py"))["absolute"]
    text = README.read_text(encoding="utf-8")
    home = "https://forge/owner/name"
    made = absolute(text, f"{home}/", "v1")
    assert not re.search(r"\]\((?!https?:|#)", made)
    # The same files, each as what it is; a picture that is a link is both
    expected = [path.split("#")[0] for path in re.findall(r"\]\((?!https?:|#)([^)]+)", text)]
    found = re.findall(rf"\]\({home}/(raw|blob)/v1/([^)#]+)", made)
    assert [path for _, path in found] == expected
    assert {path.startswith("docs/images/") for kind, path in found if kind == "raw"} == {True}
    assert {path.startswith("docs/images/") for kind, path in found if kind == "blob"} == {False}
    assert (
        f"[![A page of 100 materials]({home}/raw/v1/docs/images/view.jpg)]({home}/blob/v1/docs/view.md)"
        in made
    )
    assert absolute(made, "https://elsewhere", "v2") == made
