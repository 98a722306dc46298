"""What the pages on curves, the space and the browser show runs as it stands."""

import re
from pathlib import Path

import pytest

import dsbrdf

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a few materials in `merl`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "merl").mkdir()
    for name in ("matte", "rough-gold", "satin-plastic"):
        dsbrdf.write_merl(dsbrdf.material(name), tmp_path / "merl" / f"{name}.binary")
    return tmp_path


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
@pytest.mark.parametrize(
    ("page", "written"),
    [
        ("curves", "merl"),
        ("space", "space.npz"),
        ("view", "page.html"),
        ("photos", "orange.json"),
        ("tutorial_few_samples", "twenty.png"),
    ],
)
def test_python_runs(folder, page, written):
    path = DOCS / f"{page}.md"
    (code,) = re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(code, str(path), "exec"), {})
    assert (folder / written).exists()
