"""What docs/accuracy.md shows runs as it stands, on small files."""

import re
import shlex
from pathlib import Path

import numpy as np
from tables import built_in

from dsbrdf import cli, comparison
from dsbrdf.baselines import fit_bivariate
from dsbrdf.comparison import Comparison, methods
from dsbrdf.measured.formats.array_file import write_npz

TEXT = (Path(__file__).parents[2] / "docs" / "accuracy.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)


def test_the_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Coarse pictures, and methods that take no time
    monkeypatch.setattr(comparison, "FINE", (8, 16))
    for key, method in methods.METHODS.items():
        monkeypatch.setitem(methods.METHODS, key, methods.Method(method.label, fit_bivariate))
    for folder in ("rgl", "nbrdf"):
        Path(folder).mkdir()
    write_npz(built_in("rough-gold", (20, 18, 12)), "rgl/gold.npz")
    for part, shape in {"fc1": (6, 2), "b1": 2, "fc2": (2, 2), "b2": 2, "fc3": (2, 3), "b3": 3}.items():
        np.save(f"nbrdf/felt_{part}.npy", np.full(shape, 0.1))
    (commands,) = blocks("sh")
    for line in commands.splitlines():
        assert cli.main(shlex.split(line)[1:]) == 0, line
    for out, n in (("compared-rgl", 7), ("compared-merl", 8)):
        assert {f"compare.{ending}" for ending in ("csv", "md", "png")} | {"worst.png"} == {
            path.name for path in Path(out).iterdir()
        }
        assert len(Comparison.load(Path(out, "compare.csv")).standings) == n


def test_the_python_runs(capsys):
    (code,) = blocks("python")
    exec(compile(code, "accuracy.md", "exec"), {})
    assert "grey" in capsys.readouterr().out


def test_the_page_has_all_methods():
    medians = TEXT[TEXT.index("## Medians") :]
    for method in methods.METHODS.values():
        assert f"| {method.label} |" in TEXT[: TEXT.index("## Medians")]
        assert medians.count(f"| {method.label} |") == 2
