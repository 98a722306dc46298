"""The pages of the documentation: what they show runs as it stands, each is reached, and the reference is whole."""

import importlib
import pkgutil
import re
import shlex
from pathlib import Path

import pytest

import dsbrdf
from dsbrdf import cli

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
@pytest.mark.parametrize(
    ("page", "written"),
    [
        ("getting_started", "page.html"),
        ("tutorial_research", ""),
        ("tutorial_graphics", "between.json"),
        ("tutorial_goniometer", "models/paint.json"),
    ],
)
def test_a_page_runs_from_top_to_bottom(tmp_path, monkeypatch, page, written):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    names: dict = {}
    for language, code in re.findall(r"^```(python|sh)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if language == "python":
            exec(compile(code, page, "exec"), names)
            continue
        for line in code.splitlines():
            if line.startswith("dsbrdf "):
                assert cli.main(shlex.split(line, comments=True)[1:]) == 0, line
    assert (tmp_path / written).exists()


def test_every_page_is_in_a_table_of_contents():
    listed = {"index"}
    for page in DOCS.glob("*.md"):
        for entries in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for entry in re.findall(r"^(\w\S*)$", entries, re.MULTILINE):
                found = [path.relative_to(DOCS) for path in DOCS.glob(f"{entry}.md")]
                assert found, f"{page.name}: there is no page {entry}"
                listed |= {str(path.with_suffix("")) for path in found}
    pages = {str(path.relative_to(DOCS).with_suffix("")) for path in DOCS.rglob("*.md")}
    assert pages == listed


def test_the_reference_has_every_module_that_shows_something():
    shown = set(
        re.findall(r"^   (dsbrdf\S*)$", (DOCS / "reference.md").read_text(encoding="utf-8"), re.MULTILINE)
    )
    rooms = {
        name
        for _, name, is_package in pkgutil.iter_modules(dsbrdf.__path__, "dsbrdf.")
        if is_package and hasattr(importlib.import_module(name), "__all__") and name != "dsbrdf.cli"
    }
    assert rooms <= shown
