"""The paper's figures and claims, on small tables of built-in materials."""

import csv
import dataclasses
import functools

import numpy as np
import pytest

from dsbrdf import paper, tabulate
from dsbrdf.measured import built_in
from dsbrdf.paper import claims, spheres, subsampling, survey, tables
from dsbrdf.paper.claims import Status
from dsbrdf.render import scene

NAMES = ("satin-aluminium", "paint-two-lobe", "matte")
SHAPE = (45, 18, 24)
FACTORS = (1, 2, 4)


@functools.cache
def load(name):
    return tabulate(built_in.get(name).reflectance, name, shape=SHAPE)


measure, subsampled = survey.measure, subsampling._curve


@functools.cache
def numbers(name):
    return measure(load(name), name)


@functools.cache
def curve_of(name, noise, factors):
    return subsampled(name, load(name), noise, factors)


@pytest.fixture(scope="module", autouse=True)
def once():
    """Numbers and curves of a material are found once, whichever figures show them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(survey, "measure", lambda _, name: numbers(name))
        patch.setattr(subsampling, "_curve", lambda name, _, noise, factors: curve_of(name, noise, factors))
        yield


@pytest.fixture
def small(monkeypatch):
    """`run` on three small tables, with few factors and a small sample."""
    monkeypatch.setattr(tables, "open_tables", lambda _: tables.Tables("small", NAMES, load))
    few = functools.partial(subsampling.subsample, factors=FACTORS)
    monkeypatch.setattr(subsampling, "subsample", few)
    monkeypatch.setattr(survey, "compare_shapes", functools.partial(survey.compare_shapes, n=1))
    monkeypatch.setattr(survey, "N_SAMPLE", 1)
    monkeypatch.setattr(spheres, "SIZE", 12)
    monkeypatch.setattr(spheres, "SPP", 1)
    monkeypatch.setattr(spheres, "MAX_LOBES", 2)
    monkeypatch.setattr(scene, "TABLE", (30, 18, 24))


@pytest.fixture(scope="module")
def found():
    """Every claim about the small tables, by its check."""
    small = tables.Tables("small", NAMES, load)
    rows = survey.survey(small, lambda _: None)
    curves = subsampling.subsample(small, lambda _: None, factors=FACTORS)
    shapes = survey.compare_shapes(small, lambda _: None, n=3, n_lobes=(1,))
    judged = claims.judge(rows, curves, shapes)
    by_check = {check: claim for (_, _, check), claim in zip(claims.CLAIMS, judged, strict=True)}
    return {"rows": {row.name: row for row in rows}, "curves": curves, "shapes": shapes, "claims": by_check}


def row(name="made-up", **changes):
    numbers = {field.name: 0.1 for field in dataclasses.fields(survey.Row)}
    return survey.Row(**{**numbers, "name": name, "n_lobes": 3, "unconverged": 0, **changes})


def check(function, rows=(), curves=(), shapes=None):
    return function(claims._Evidence(list(rows), list(curves), shapes))


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("what", ["fig1", "fig2", "fig3", "fig5", "fig6"])
def test_each_figure(tmp_path, what):
    steps = []
    (path,) = paper.run(what, None, tmp_path / "new", steps.append)
    assert path == tmp_path / "new" / f"{what}.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    assert len(steps) == paper.n_steps(what, None)


@pytest.mark.usefixtures("small")
def test_all_names_every_claim_with_a_status(tmp_path):
    steps = []
    written = paper.run("all", None, tmp_path, steps.append)
    assert {path.name for path in written} == {path.name for path in tmp_path.iterdir()}
    assert len(steps) == paper.n_steps("all", None)
    report = (tmp_path / "report.md").read_text()
    assert report.startswith("# The paper's claims: small\n")
    lines = [line.split(" | ") for line in report.splitlines() if line.startswith(("| Sec. ", "| Fig. "))]
    assert [cells[1] for cells in lines] == [text for _, text, _ in claims.CLAIMS]
    assert {cells[2].strip("*") for cells in lines} <= {str(status) for status in Status}
    for figure in paper.WHAT[1:-1]:
        assert f"({figure}.png)" in report


@pytest.mark.usefixtures("small")
def test_table_of_all_materials(tmp_path, found):
    assert paper.run("table", None, tmp_path) == [tmp_path / "table.md", tmp_path / "table.csv"]
    with (tmp_path / "table.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["name"] for line in lines] == list(NAMES)
    for line in lines:
        expected = found["rows"][line["name"]]
        np.testing.assert_allclose(float(line["rel_rms"]), expected.rel_rms, rtol=1e-6)
        assert int(line["n_lobes"]) == expected.n_lobes
    for name in NAMES:
        assert f"\n| {name} | " in (tmp_path / "table.md").read_text()


def test_unknown_figure(tmp_path):
    with pytest.raises(ValueError, match=r"'what' must be one of 'all', .*, got 'fig99'"):
        paper.run("fig99", None, tmp_path)


def test_folder_with_other_files(tmp_path, merl_file):
    (tmp_path / "made-up.binary").symlink_to(merl_file)
    (tmp_path / "notes.txt").write_text("none of ours")
    (tmp_path / "short.binary").write_bytes(b"abc")
    (tmp_path / "folder.binary").mkdir()
    opened = tables.open_tables(tmp_path)
    assert opened.names == ("made-up",)
    assert opened.title == tmp_path.name
    assert opened.load("made-up").name == "made-up"
    (skipped,) = opened.skipped
    assert "short.binary" in skipped


def test_folder_without_tables(tmp_path):
    with pytest.raises(ValueError, match="no such folder"):
        paper.run("table", tmp_path / "none", tmp_path)
    with pytest.raises(ValueError, match=r"no readable \.binary file"):
        paper.run("table", tmp_path, tmp_path)
    (tmp_path / "short.binary").write_bytes(b"abc")
    with pytest.raises(ValueError, match=r"no readable \.binary file in this folder \(.*short"):
        paper.run("table", tmp_path, tmp_path)


def test_materials_of_a_figure():
    small = tables.Tables("small", NAMES, load)
    assert small.pick(["matte", "paint-two-lobe"], 2) == ["matte", "paint-two-lobe"]
    # Of others, those whose highlights differ most
    assert small.pick(["teflon"], 2)[-1] == "matte"
    assert len(small.pick(["teflon"], 5)) == 3
    assert small.sample(2) == ["satin-aluminium", "matte"]


def test_claim_flexibility(found):
    shapes = found["shapes"]
    assert (np.array(shapes.hemi_epd) < 1.01 * np.array(shapes.von_mises_fisher)).all()
    flat = survey.Shapes(["a"], (1, 2), [[0.5, 0.2]], [[0.3, 0.2]], [0.1])
    text, status, why = check(claims._flexibility, shapes=flat)
    assert status is Status.DIFFERS
    assert "1: 0.3000 against 0.5000" in text
    assert "with 2 lobe" in why


def test_claim_em(found):
    for each in found["rows"].values():
        assert each.em >= each.rel_rms * (1.0 - 1e-9)
    assert check(claims._em, [row()])[1] is Status.REPRODUCED
    assert check(claims._em, [row(em=0.2)])[1] is Status.DIFFERS
    assert check(claims._em, [row(rel_rms=0.0)])[1] is Status.UNTESTED


def test_claim_lobes(found):
    assert found["claims"][claims._lobes].status is Status.UNTESTED
    assert found["rows"]["matte"].n_lobes < found["rows"]["paint-two-lobe"].n_lobes
    as_printed = [row(name, n_lobes=n) for name, n in claims.LOBES.items()]
    assert check(claims._lobes, as_printed)[1] is Status.REPRODUCED
    text, status, why = check(claims._lobes, [*as_printed[:2], row("orange-paint", n_lobes=3)])
    assert status is Status.DIFFERS
    assert "orange-paint 3 (2)" in text
    assert "off by 1" in why


def test_claim_bivariate(found):
    for each in found["rows"].values():
        assert each.bivariate_floor <= each.monotone_floor <= each.rel_rms * (1.0 + 1e-9)
    assert check(claims._bivariate, [row(rel_rms=0.14)])[1] is Status.REPRODUCED
    text, status, why = check(claims._bivariate, [row(rel_rms=0.16)])
    assert (status, why) == (Status.DIFFERS, "1.60 times the bivariate table")
    assert text.startswith("median 0.1600, bivariate table 0.1000")


def test_claim_decentred():
    floors = {"bivariate_floor": 0.1, "monotone_floor": 0.3}
    assert check(claims._decentred, [row(rel_rms=0.31, **floors)])[1] is Status.REPRODUCED
    assert check(claims._decentred, [row(rel_rms=0.5, **floors)])[1] is Status.DIFFERS
    still = row(rel_rms=0.0, bivariate_floor=0.0, monotone_floor=0.0)
    assert check(claims._decentred, [still])[1] is Status.UNTESTED


def test_claim_smaller(found):
    assert found["claims"][claims._smaller].status is Status.REPRODUCED
    assert check(claims._smaller, [row(n_lobes=3)])[0].startswith("13,500 times")
    assert check(claims._smaller, [row(n_lobes=5)])[1] is Status.DIFFERS


def test_claim_interpolation(found):
    by_name = {curve.name: curve for curve in found["curves"] if not curve.noise}
    assert by_name["satin-aluminium"].better_from in (2, 4)
    # All samples: interpolation is the floor then
    floor = found["rows"]["satin-aluminium"].bivariate_floor
    np.testing.assert_allclose(by_name["satin-aluminium"].interpolation[0], floor, rtol=1e-6)
    curve = subsampling.Curve("a", 0.0, (1, 2, 4, 8), [0.2, 0.2, 0.3, 0.9], [0.1, 0.3, 0.4, 0.8])
    assert (curve.first_better, curve.better_from, curve.better_at) == (2, None, [2, 4])
    text, status, why = check(claims._interpolation, curves=[curve])
    assert status is Status.REPRODUCED
    assert "at 2, 4 of 1 to 8" in text
    assert "few theta_h" in why
    never = dataclasses.replace(curve, model=[1.0] * 4)
    assert check(claims._interpolation, curves=[never])[1] is Status.DIFFERS


def test_claim_torrance_sparrow(found):
    # Glossy: a coat whose reflectance rises toward grazing
    assert found["rows"]["paint-two-lobe"].rel_rms < found["rows"]["paint-two-lobe"].torrance_sparrow
    assert check(claims._torrance_sparrow, [row(torrance_sparrow=0.2)])[1] is Status.REPRODUCED
    text, status, _ = check(claims._torrance_sparrow, [row(torrance_sparrow=0.05)])
    assert status is Status.DIFFERS
    assert text.startswith("lower error on 0 of 1")


def test_noise_is_fixed(monkeypatch):
    monkeypatch.setattr(subsampling, "_curve", subsampled)
    one = tables.Tables("small", NAMES[-1:], load)
    first, second = (subsampling.subsample(one, lambda _: None, factors=(2,)) for _ in range(2))
    assert first == second
    assert first[0].model != first[1].model


def test_claim_fair_form(found):
    """Thirteen numbers, and the model of today, beside the slices: over their samples and over the whole hemisphere."""
    for each in found["rows"].values():
        assert max(each.cbrt, each.fit_cbrt, each.ggx_pair_cbrt) < 0.15
    # Its own kind of material
    assert found["rows"]["satin-aluminium"].ggx_pair_cbrt < 0.01
    better = {"rel_rms": 0.1, "ggx_pair": 0.2, "cbrt": 0.1, "ggx_pair_cbrt": 0.2}
    assert check(claims._ggx_pair, [row(**better)])[1] is Status.REPRODUCED
    text, status, why = check(claims._ggx_pair, [row(**better | {"cbrt": 0.3})])
    assert status is Status.DIFFERS
    assert "lower error on 1 of 1" in text
    assert "fitted to all of it, on 0 (" in text
    assert "whole hemisphere" in why
