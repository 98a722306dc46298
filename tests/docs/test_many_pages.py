"""What the pages on many materials and on textures show runs as it stands."""

import re
from pathlib import Path

import pytest

import dsbrdf
from dsbrdf.measured.formats.array_file import write_npz

DOCS = Path(__file__).parents[2] / "docs"


def code(page):
    return "\n".join(re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL))


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_many(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "measured").mkdir()
    for name in ("matte", "rough-gold", "satin-plastic"):
        table = dsbrdf.tabulate(dsbrdf.material(name).eval, name, shape=(20, 12, 8))
        write_npz(table, tmp_path / "measured" / f"{name}.npz")
    exec(compile(code("many.md"), "many.md", "exec"), {})
    assert len(dsbrdf.library.open("mine.dsbrdf")) == 3


def test_textures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space = {}
    exec(compile(code("texels.md"), "texels.md", "exec"), space)
    assert space["albedo"].dims == ("row", "column", "channel")
    assert {"maps.npz", "maps.exr", "values.zarr"} <= {path.name for path in tmp_path.iterdir()}
