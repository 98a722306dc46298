"""Figs. 4, 5, 7 and 8 of `dsbrdf paper`, at a few pixels."""

import functools

import pytest

from dsbrdf import paper, tabulate
from dsbrdf.measured import built_in
from dsbrdf.paper import spheres, tables
from dsbrdf.render import scene

NAMES = ("satin-aluminium", "matte")


@functools.cache
def load(name):
    return tabulate(built_in.get(name).reflectance, name, shape=(45, 18, 24))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(tables, "open_tables", lambda _: tables.Tables("small", NAMES, load))
    monkeypatch.setattr(spheres, "SIZE", 12)
    monkeypatch.setattr(spheres, "SPP", 2)
    monkeypatch.setattr(spheres, "MAX_LOBES", 2)
    monkeypatch.setattr(scene, "TABLE", (30, 18, 24))


@pytest.mark.parametrize("what", spheres.FIGURES)
def test_each_figure(tmp_path, what):
    steps = []
    (path,) = paper.run(what, None, tmp_path, steps.append)
    assert path == tmp_path / f"{what}.png"
    assert path.stat().st_size > 10_000
    assert len(steps) == paper.n_steps(what, None)


def test_what_fig4_shows(monkeypatch):
    """One lobe and more, the chosen number in brackets; never further from the measured sphere with more."""
    shown = []
    monkeypatch.setattr("dsbrdf.render.picture.sheet", lambda rows, note: shown.extend([*rows, note]))
    spheres.by_lobe_count(tables.open_tables(None), lambda _: None)
    *rows, note = shown
    assert [row.title for row in rows] == ["satin-aluminium", "matte"]
    titles = [tile.title for tile in rows[1].tiles]
    assert titles == ["measured", "[1 lobe]", "2 lobes"]
    assert "brackets" in note
    assert rows[0].tiles[2].difference.mean < rows[0].tiles[1].difference.mean


def test_missing_mitsuba_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mitsuba", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'dsbrdf\[render\]'"):
        paper.run("fig7", None, tmp_path / "out")
    assert not (tmp_path / "out").exists()
