"""What is read never decides where something is written: one function makes names of files from names of materials."""

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest
from batches import files_in
from hypothesis import given
from hypothesis import strategies as st
from spaces import smooth_model

import dsbrdf
from dsbrdf import _files, batch, cli, library
from dsbrdf.space import build_space

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")

#: Names that would lie elsewhere, or nowhere, as they are.
HOSTILE = {
    "up": "../vict/package",
    "absolute": "/tmp/dsbrdf-victim",
    "windows": "c:\\users\\victim",
    "null": "a\0b",
    "long": "n" * 300,
    "long in bytes": "\N{GREEK SMALL LETTER ALPHA}" * 150,
    "hidden": ".profile",
    "record": ".dsbrdf-batch.jsonl",
    "itself": ".",
    "parent": "..",
    "option": "-rf",
    "device": "AUX",
    "device with ending": "com1.tar",
    "end": "gold.",
    "blank": " ",
    "line": "new\nline",
    "terminal": "\x1b]0;title\x07",
    "turned": "gold\u202egpj",
    "surrogate": "\udcff",
    "empty": "",
}


@pytest.mark.parametrize("name", HOSTILE.values(), ids=HOSTILE)
def test_hostile_names(name, tmp_path):
    made = _files.file_name(name)
    path = tmp_path / f"{made}-parameters.json"
    with _files.aside(path) as part:
        part.write_text("here")
    assert files_in(tmp_path) == [path.name]
    assert made != name


@given(st.text())
def test_any_name(name):
    made = _files.file_name(name)
    assert made
    assert made.isprintable()
    assert 0 < len(made.encode()) <= _files.MAX_NAME
    assert not set(made) & set('<>:"/\\|?*')
    assert made[0] not in ".-~ "
    assert made[-1] not in ". "
    assert Path(made).name == made


@given(st.text(), st.text())
def test_two_names_are_two_files(a, b):
    assert (_files.file_name(a) == _files.file_name(b)) <= (a == b or "%" in a + b)


@pytest.mark.parametrize("name", ["gold, brushed", "Grün 3.2", "50% gloss", "合金", "con-crete", "auxiliary"])
def test_other_names_stay(name):
    assert _files.file_name(name) == name


def measured(small_table, folder, names):
    """Files of a small table, of these names inside."""
    folder.mkdir()
    for i, name in enumerate(names):
        np.savez(
            folder / f"file-{i}.npz",
            name=np.array(name),
            values=np.moveaxis(small_table.planes, 0, -1),
            **{key: getattr(small_table, key) for key in ("theta_h", "theta_d", "phi_d")},
        )
    return folder


def test_a_batch_of_hostile_names(small_table, tmp_path, capsys):
    """All are fitted, into the folder; a file beside it with one of the names stays what it was."""
    victim = tmp_path / "vict" / "package.json"
    victim.parent.mkdir()
    victim.write_text("precious")
    names = [name for name in HOSTILE.values() if not name.startswith(("\udcff", "a\0"))]
    folder = measured(small_table, tmp_path / "in", names)
    before = set(tmp_path.rglob("*"))
    out = tmp_path / "out"
    assert cli.main(["fit", str(folder), "--lobes", "1", "-o", str(out), "--view"]) == 0, capsys.readouterr()
    assert victim.read_text() == "precious"
    written = {path for path in tmp_path.rglob("*") if path not in before}
    assert all(path.parent == out for path in written - {out})
    assert len(list(out.glob("*.json"))) == len(names)
    again = batch.fit_many(folder, out, n_lobes=1, loss="log", curves="standard")
    assert all(outcome.kept for outcome in again)


def test_files_of_others_stay(small_table, tmp_path):
    """A name that is that of a file in the folder fails, unless forced; models and figures of ours are replaced."""
    table = dataclasses.replace(small_table, name="package")
    for name in ("package.json", "package.png"):
        (tmp_path / name).write_text("precious")
        options = {"n_lobes": 1, "record": False, "plots": True}
        (outcome,) = batch.fit_many([table], tmp_path, **options)
        assert "dsbrdf did not write it" in outcome.status
        assert (tmp_path / name).read_text() == "precious"
        assert batch.fit_many([table], tmp_path, force=True, **options)[0].error is None
        assert batch.fit_many([table], tmp_path, **options)[0].error is None


def test_figures_of_hostile_names(small_table, tmp_path):
    table = dataclasses.replace(small_table, name="../../up $\\frac{")
    (outcome,) = batch.fit_many([table], tmp_path / "deep" / "out", n_lobes=1, plots=True, record=False)
    assert outcome.status == "ok", outcome
    assert files_in(tmp_path) == ["deep"]
    assert len(files_in(tmp_path / "deep" / "out")) == 3


def test_a_bad_target_does_not_stop_the_rest(small_table, tmp_path):
    bad = ["a\0b", "n" * 300, "n" * 300 + ".binary", str(tmp_path), "/dev/zero", "", ".", "\udcff"]
    outcomes = batch.fit_many([*bad, small_table], tmp_path / "out", n_lobes=1)
    assert [outcome.status == "ok" for outcome in outcomes] == [False] * len(bad) + [True]
    assert "1 |" in (tmp_path / "out" / "fits.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("second", ["GOLD", "gold"])
def test_names_that_differ_only_in_case(small_table, tmp_path, second):
    """On another system they would be one file."""
    tables = [dataclasses.replace(small_table, name=name) for name in ("gold", second, "silver")]
    outcomes = batch.fit_many(tables, tmp_path, n_lobes=1)
    assert [outcome.error is None for outcome in outcomes] == [True, False, True]
    assert "is already the file of gold" in outcomes[1].status
    assert [name for name in files_in(tmp_path) if name.endswith(".json")] == ["gold.json", "silver.json"]


def test_a_figure_is_no_other_materials(small_table, tmp_path):
    tables = [dataclasses.replace(small_table, name=name) for name in ("gold", "gold-parameters")]
    outcomes = batch.fit_many(tables, tmp_path, n_lobes=1, plots=True)
    assert [outcome.error is None for outcome in outcomes] == [True, False]


def test_names_of_a_space_file(tmp_path, monkeypatch, capsys):
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    names = ("../a", "/abs/b", "c")
    models = [smooth_model(i, name=name) for i, name in enumerate(names)]
    build_space(models).save("space.npz")
    for command in (["move", "../a"], ["blend", "../a", "/abs/b"], ["draw"]):
        assert cli.main(["space", *command]) == 0, capsys.readouterr()
    assert files_in(tmp_path) == ["in"]
    assert len(files_in(tmp_path / "in")) == 4


@pytest.mark.parametrize("names", [["../a"], ["a", "A"], ["con"], ["x" * 201], ["a\u202eb"], ["a."]])
def test_names_of_a_library(tmp_path, names):
    with pytest.raises(ValueError, match=r"is no name of a material|is there twice"):
        library.write(tmp_path / "x.dsbrdf", [smooth_model(1, name=name) for name in names])
    assert not files_in(tmp_path)


def test_devices_are_not_replaced(tmp_path):
    for path in ("/dev/null", "/dev/full"):
        with pytest.raises(OSError, match="not a regular file, and is not replaced"):
            smooth_model(1).save(path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a regular file"):
        smooth_model(1).save(tmp_path / "pipe")
    assert not Path("/dev/null").is_file()


def test_a_link_is_replaced_and_not_followed(tmp_path):
    """A folder from elsewhere may hold one that leads to a file of yours."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "link.json").symlink_to(victim)
    smooth_model(1).save(tmp_path / "link.json")
    assert victim.read_text() == "precious"
    assert json.loads((tmp_path / "link.json").read_text())["format"] == "dsbrdf model"
    (tmp_path / "lost.json").symlink_to(tmp_path / "nowhere")
    smooth_model(1).save(tmp_path / "lost.json")
    assert dsbrdf.load(tmp_path / "lost.json").n_lobes == 3
    assert not (tmp_path / "nowhere").exists()


def test_a_name_as_long_as_the_system_allows(tmp_path):
    path = tmp_path / f"{'x' * 250}.json"
    smooth_model(1).save(path)
    assert files_in(tmp_path) == [path.name]
