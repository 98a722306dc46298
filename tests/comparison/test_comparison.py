"""`dsbrdf compare`: figures of merit by brute force, who is better than whom, and runs that are stopped or repeated."""

import csv
import dataclasses
import math

import numpy as np
import pytest
from figures import assert_nothing_is_cut
from matplotlib.figure import Figure
from tables import built_in

import dsbrdf
from dsbrdf import cli, comparison
from dsbrdf.comparison import Comparison, Row, figure, merit, methods, sphere
from dsbrdf.geometry.colour_difference import ciede2000, lab
from dsbrdf.measured.formats.array_file import write_npz

FEW = (20, 18, 12)
#: Methods that take no time.
QUICK = ["ggx", "bivariate"]


class Scaled:
    """A reflectance times a factor."""

    n_parameters = 1

    def __init__(self, reflectance, factor):
        self.reflectance, self.factor = reflectance, factor

    def eval(self, wi, wo):
        return self.factor * self.reflectance.eval(wi, wo)


def half_as_bright(measured):
    return Scaled(measured, 0.5)


def a_tenth_too_bright(measured):
    return Scaled(measured, 1.1)


def broken(measured):
    raise ZeroDivisionError(measured.name)


@pytest.fixture(autouse=True)
def plain_figures(request, monkeypatch):
    """Figures cost more than what they show here."""
    if "draw" not in request.node.name:
        monkeypatch.setattr(figure, "draw", lambda _: Figure(figsize=(1.0, 1.0)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two tables, and a file that is none."""
    folder = tmp_path_factory.mktemp("measured")
    for name in ("rough-gold", "glossy-plastic"):
        write_npz(built_in(name, FEW), folder / f"{name}.npz")
    (folder / "bad.binary").write_bytes(b"no table")
    return folder


# Figures of merit


def test_figures_of_a_factor():
    """Of a reflectance times 1.1, by hand."""
    measured = built_in("rough-gold", FEW)
    found = merit.Judge(measured).merit(Scaled(measured, 1.1))
    assert found.rel == pytest.approx(0.1)
    assert found.cbrt == pytest.approx(1.1 ** (1 / 3) - 1.0)
    assert found.albedo == pytest.approx(0.1)
    assert 0.9 * math.log(1.1) < found.log < math.log(1.1)
    assert 0.5 < found.ciede2000 < 5.0
    assert merit.Judge(measured).merit(measured).summary() == dict.fromkeys(comparison.FIGURES, 0.0)


def test_figures_by_brute_force(rng):
    """Sums written out, over samples some of which do not count."""
    n = 7
    wi, wo = np.abs(rng.standard_normal((2, n, 3)))
    wi, wo = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (wi, wo))
    f, g = rng.exponential(1.0, (2, n, 3))
    f[2, 1], f[4, 0] = np.nan, 1e-7

    class Model:
        def eval(self, a, b):
            at = [
                int(np.flatnonzero((wi == x).all(1) & (wo == y).all(1))[0]) for x, y in zip(a, b, strict=True)
            ]
            return g[at]

    squares = energy = roots = root_energy = logs = count = 0.0
    for i in (0, 1, 3, 5, 6):
        cosines = wi[i, 2] * wo[i, 2]
        for c in range(3):
            squares, energy = squares + (g[i, c] - f[i, c]) ** 2, energy + f[i, c] ** 2
            a, b = (g[i, c] * cosines) ** (1 / 3), (f[i, c] * cosines) ** (1 / 3)
            roots, root_energy = roots + (a - b) ** 2, root_energy + b * b
            logs, count = logs + math.log((g[i, c] + 1e-4) / (f[i, c] + 1e-4)) ** 2, count + 1
    found = merit.Judge(dsbrdf.Samples(wi, wo, f)).merit(Model())
    assert found.rel == pytest.approx(math.sqrt(squares / energy))
    assert found.cbrt == pytest.approx(math.sqrt(roots / root_energy))
    assert found.log == pytest.approx(math.sqrt(logs / count))
    assert math.isnan(found.albedo)
    assert math.isnan(found.ciede2000)


def test_pairs_are_uniform_below_80_degrees():
    z = np.concatenate([x[:, 2] for x in merit.pairs()])
    assert z.min() >= math.cos(math.radians(80.0))
    assert z.mean() == pytest.approx(0.5 * (1.0 + math.cos(math.radians(80.0))), abs=0.005)


class Matte:
    """White, Lambert."""

    def eval(self, wi, wo):
        return np.full((*np.broadcast_shapes(wi.shape, wo.shape)[:-1], 3), 1.0 / np.pi)


def test_a_matte_sphere_by_a_sum_over_all_directions():
    """The irradiance at each point, by a fine grid of directions in the world, which the lights are given in."""
    seen = sphere.radiance(Matte(), (4, 6))
    z = (np.arange(400) + 0.5) / 200 - 1.0
    phi = 2.0 * np.pi * (np.arange(800) + 0.5) / 800
    s = np.sqrt(1.0 - z * z)[:, None]
    d = np.stack([s * np.cos(phi), s * np.sin(phi), np.broadcast_to(z[:, None], (400, 800))], axis=-1)
    arriving = sphere.light(d) * 4.0 * np.pi / d[..., 0].size
    limit = math.sin(math.radians(80.0))
    for i in range(4):
        r = limit * math.sqrt((i + 0.5) / 4)
        for j in range(6):
            a = 2.0 * math.pi * (j + 0.5) / 6
            cos = d @ np.array([r * math.cos(a), r * math.sin(a), math.sqrt(1.0 - r * r)])
            expected = (arriving * np.where(cos > sphere.LEAST_COSINE, cos, 0.0)).sum() / np.pi
            np.testing.assert_allclose(seen[i, j], expected, rtol=0.02)


def test_a_mirror_shows_the_light():
    """A narrow lobe of all the light, at the mirror direction of each point."""
    narrow = dsbrdf.baselines.FresnelGGX(np.zeros(3), np.full(3, 1e-3), np.full(3, 20.0), 0.003)
    seen = sphere.radiance(narrow, (5, 8))
    limit = math.sin(math.radians(80.0))
    for i in range(4):  # of the outermost circle the mirror direction is near to the horizon
        r = limit * math.sqrt((i + 0.5) / 5)
        a = 2.0 * np.pi * (np.arange(8) + 0.5) / 8
        normal = np.stack([r * np.cos(a), r * np.sin(a), np.full(8, math.sqrt(1.0 - r * r))], axis=-1)
        mirrored = 2.0 * normal[:, 2:] * normal - [0.0, 0.0, 1.0]
        np.testing.assert_allclose(seen[i, :, 0], sphere.light(mirrored), rtol=0.03)


def test_the_colour_difference_of_spheres():
    reference = np.broadcast_to([0.4, 0.2, 0.1], (3, 4, 3))
    factor = 0.22 / (reference[0, 0] @ [0.2126, 0.7152, 0.0722])
    other = reference * [1.2, 1.0, 1.0]
    expected = ciede2000(lab(factor * other[0, 0]), lab(factor * reference[0, 0]))
    assert sphere.difference(other, reference) == pytest.approx(float(expected))


@pytest.mark.shared
def test_a_real_file_is_judged_by_itself_in_both_orders(data):
    from dsbrdf.measured.formats.rgl import read_rgl

    path = data / "data" / "rgl" / "aurora_white_rgb.bsdf"
    raw = read_rgl(path)
    wi, wo = merit.pairs(50)
    found = merit.truth_of(dsbrdf.read(path)).eval(wi, wo)
    np.testing.assert_allclose(found, 0.5 * (raw.eval(wi, wo) + raw.eval(wo, wi)))


# Who is better than whom


def test_the_nearer_method_is_first(folder):
    found = dsbrdf.compare(
        folder / "rough-gold.npz",
        methods=[],
        add={"half": half_as_bright, "tenth": a_tenth_too_bright},
    )
    assert [standing.method for standing in found.standings] == ["tenth", "half"]
    assert found.standings[1].rel == pytest.approx(0.5)
    assert repr(found).splitlines()[2].startswith("tenth")
    assert len(repr(found).splitlines()) <= 15


def test_all_methods_on_a_small_table(folder):
    """The real ones: two lobes do not do worse than one, nothing fails, and numbers are told."""
    found = dsbrdf.compare(folder / "glossy-plastic.npz")
    assert not found.failures
    by_method = {standing.method: standing for standing in found.standings}
    assert set(by_method) == {method.label for method in methods.METHODS.values()}
    assert by_method["Lambert + two GGX"].cbrt <= 1.02 * by_method["Lambert + GGX"].cbrt
    assert by_method["dsbrdf.fit"].cbrt < 0.5 * by_method["Lambert + GGX"].cbrt
    assert by_method["Lambert + GGX, Fresnel"].n_parameters == 10
    assert all(standing.seconds > 0.0 for standing in found.standings)


def test_what_is_drawn():
    """Error bars of each method, but for what is the measurement itself; no text is cut."""
    rng = np.random.default_rng(2)
    rows = [
        Row(f"material {i}", f"method {k} of a long name", 10.0**k, cbrt=error, log=error, ciede2000=error)
        for k in range(1, 6)
        for i, error in enumerate(rng.exponential(0.1, 5) if k < 5 else np.zeros(5))
    ]
    drawn = figure.draw(Comparison(rows))
    assert [len(axes.containers) for axes in drawn.axes] == [4, 4, 4]
    assert_nothing_is_cut(drawn)


def test_medians_are_over_what_there_is():
    rows = [Row("a", "x", cbrt=value, n_parameters=5) for value in (0.1, 0.4, 0.2)]
    rows += [Row("a", "y", cbrt=0.3), Row("b", "y", status="failed")]
    found = Comparison(rows)
    assert [(s.method, s.n_materials, s.cbrt, s.worst) for s in found.standings] == [
        ("x", 3, 0.2, 0.4),
        ("y", 1, 0.3, 0.3),
    ]
    assert not found.is_even
    assert found.failures == [rows[-1]]


@pytest.mark.filterwarnings("ignore::dsbrdf.measured.samples.ReadWarning")
def test_samples_are_judged_where_they_are(rng, tmp_path):
    wi, wo = np.abs(rng.standard_normal((2, 200, 3)))
    wi, wo = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (wi, wo))
    write_npz(
        dsbrdf.Samples(wi, wo, built_in("rough-gold", FEW).eval(wi, wo), name="few"), tmp_path / "few.npz"
    )
    found = dsbrdf.compare(tmp_path / "few.npz", methods=["ggx", "slices"])
    assert [row.status for row in found.rows] == ["ok", "takes tables only, not scattered samples"]
    assert found.rows[0].cbrt < 0.1


# Models from elsewhere


def test_models_from_elsewhere(folder, tmp_path):
    """A model file, a table and weights are found by the name of the material, and what has none is left out."""
    fit = dsbrdf.fit(built_in("rough-gold", FEW), n_lobes=2)
    (tmp_path / "mine").mkdir()
    fit.model.save(tmp_path / "mine" / "rough-gold.json")
    (tmp_path / "weights").mkdir()
    weights(tmp_path / "weights", "rough-gold")
    found = dsbrdf.compare(folder, methods=[], neural=tmp_path / "weights", add={"mine": tmp_path / "mine"})
    assert {(row.material, row.method): row.n_parameters for row in found.rows if row.ok} == {
        ("rough-gold", "mine"): fit.model.n_parameters,
        ("rough-gold", "neural BRDF"): 6 * 3 + 3 + 2 * (9 + 3),
    }
    assert [row.material for row in found.failures] == ["bad"]
    assert found.standings[0].method == "mine"
    assert found.standings[0].cbrt == merit.Judge(built_in("rough-gold", FEW)).merit(fit.model).cbrt


def weights(folder, name, seed=3):
    rng = np.random.default_rng(seed)
    shapes = {"fc1": (6, 3), "b1": 3, "fc2": (3, 3), "b2": 3, "fc3": (3, 3), "b3": 3}
    for part, shape in shapes.items():
        # Bright enough not to be zero anywhere
        np.save(folder / f"{name}_{part}.npy", 0.1 * rng.normal(size=shape) + (part == "b3"))


def test_weights_that_are_the_measurement(tmp_path):
    """Then the error of the network is nothing; a repeated run has the same rows, until a weight has changed."""
    networks, out = tmp_path / "networks", tmp_path / "out"
    networks.mkdir()
    weights(networks, "felt")
    first = dsbrdf.compare(networks, out, methods=["bivariate"], neural=networks)
    assert [(row.material, row.method, row.status) for row in first.rows] == [
        ("felt", "bivariate table", "ok"),
        ("felt", "neural BRDF", "ok"),
    ]
    assert first.rows[1].rel == 0.0
    assert first.rows[0].rel > 0.0
    repeated = dsbrdf.compare(networks, out, methods=["bivariate"], neural=networks)
    assert repeated.to_csv() == first.to_csv()
    np.save(networks / "felt_b3.npy", np.full(3, 0.2))
    again = dsbrdf.compare(networks, out, methods=["bivariate"], neural=networks)
    assert again.rows[0].rel != first.rows[0].rel


def test_a_folder_of_strangers_is_told(folder, tmp_path):
    with pytest.warns(UserWarning, match="no model in it is named like one of the materials"):
        dsbrdf.compare(folder / "rough-gold.npz", methods=["bivariate"], add={"mine": tmp_path})


def test_names_do_not_lead_out_of_a_folder_of_models(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "secret.json").write_text("{}")
    assert methods.Folder("mine", tmp_path / "models").find("../secret") is None


# Files


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_what_is_written_comes_back(folder, tmp_path):
    found = dsbrdf.compare(folder, tmp_path, methods=QUICK)
    back = Comparison.load(tmp_path / "compare.csv")
    assert repr(back) == repr(found)
    for a, b in zip(found.rows, back.rows, strict=True):
        for field in dataclasses.fields(Row):
            first, second = getattr(a, field.name), getattr(b, field.name)
            assert first == second or (math.isnan(first) and math.isnan(second)), field.name
    assert "| Lambert + GGX | 2 | 7 |" in (tmp_path / "compare.md").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compare.csv", "compare.md", "compare.png"]


def test_a_broken_file_and_a_broken_method_are_rows(folder):
    found = dsbrdf.compare([folder, "none.npz"], methods=["bivariate"], add={"mine": broken})
    assert [(row.file, row.method) for row in found.failures] == [
        ("bad.binary", ""),
        ("glossy-plastic.npz", "mine"),
        ("rough-gold.npz", "mine"),
        ("none.npz", ""),
    ]
    assert "ZeroDivisionError" in found.failures[1].status
    assert found.standings[0].n_materials == 2


def counted(monkeypatch):
    """How often a table is averaged."""
    calls = []
    real = methods.METHODS["bivariate"]

    def fit(measured):
        calls.append(measured.name)
        return real.fit(measured)

    monkeypatch.setitem(methods.METHODS, "bivariate", methods.Method(real.label, fit, tables=True))
    return calls


def test_a_repeated_run_fits_what_is_new(folder, tmp_path, monkeypatch):
    calls = counted(monkeypatch)
    target = tmp_path / "gold.npz"
    target.write_bytes((folder / "rough-gold.npz").read_bytes())
    out = tmp_path / "out"
    first = dsbrdf.compare(target, out, methods=["bivariate"])
    again = dsbrdf.compare(target, out, methods=["bivariate"])
    assert len(calls) == 1
    assert again.rows == first.rows
    dsbrdf.compare(target, out, methods=QUICK)
    assert len(calls) == 1
    target.write_bytes((folder / "glossy-plastic.npz").read_bytes())
    dsbrdf.compare(target, out, methods=["bivariate"])
    dsbrdf.compare(target, out, methods=["bivariate"], reading={"scale": 2.0})
    dsbrdf.compare(target, out, methods=["bivariate"], reading={"scale": 2.0}, force=True)
    assert len(calls) == 4


def test_an_interrupted_run_goes_on(folder, tmp_path, monkeypatch):
    calls = counted(monkeypatch)

    def stop(name):
        if "glossy" in name:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dsbrdf.compare(folder, tmp_path, methods=["bivariate"], done=stop)
    assert [row["material"] for row in rows_of(tmp_path / "compare.csv")] == ["bad", "glossy-plastic"]
    found = dsbrdf.compare(folder, tmp_path, methods=["bivariate"])
    assert calls == ["glossy-plastic", "rough-gold"]
    assert len(found.rows) == 3


def test_a_table_that_is_damaged_is_made_anew(folder, tmp_path):
    dsbrdf.compare(folder / "rough-gold.npz", tmp_path, methods=["bivariate"])
    path = tmp_path / "compare.csv"
    text = path.read_text()
    for damaged in (text.replace("0.", "x", 4), text[:300], "\0" + text, text.replace("ok", "no")):
        path.write_text(damaged + "dsbrdf")
        assert dsbrdf.compare(folder / "rough-gold.npz", tmp_path, methods=["bivariate"]).rows[0].ok
        assert rows_of(path)[0]["status"] == "ok"


def test_files_of_others_are_not_replaced(folder, tmp_path):
    (tmp_path / "compare.csv").write_text("mine")
    with pytest.raises(FileExistsError, match="dsbrdf did not write it"):
        dsbrdf.compare(folder / "rough-gold.npz", tmp_path, methods=["bivariate"])
    assert (tmp_path / "compare.csv").read_text() == "mine"
    dsbrdf.compare(folder / "rough-gold.npz", tmp_path, methods=["bivariate"], force=True)
    assert rows_of(tmp_path / "compare.csv")


HOSTILE = "=cmd|' /C calc'!A0\x1b[2J|<b>$x$"


def test_names_that_would_do_something(folder, tmp_path, capsys):
    path = tmp_path / f"{HOSTILE.replace('/', '_')}.npz"
    path.write_bytes((folder / "rough-gold.npz").read_bytes())
    for _ in range(2):
        assert cli.main(["compare", str(path), "--methods", "bivariate", "-o", str(tmp_path / "out")]) == 0
    assert sorted(x.name for x in (tmp_path / "out").iterdir()) == [
        "compare.csv",
        "compare.md",
        "compare.png",
    ]
    (row,) = rows_of(tmp_path / "out" / "compare.csv")
    assert not row["file"].startswith("=")
    for text in ((tmp_path / "out" / "compare.csv").read_text(), capsys.readouterr().out):
        assert "\x1b" not in text


def test_two_runs_at_a_time_are_refused(folder, tmp_path):
    from dsbrdf import _lock

    with (
        _lock.held(tmp_path / comparison.LOCK),
        pytest.raises(_lock.BusyError, match="is writing to this folder"),
    ):
        dsbrdf.compare(folder / "rough-gold.npz", tmp_path, methods=["bivariate"])


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"methods": ["lambert"]}, "unknown method 'lambert': expected some of standard, compact"),
        ({"methods": []}, "expected methods of different labels, got none"),
        ({"add": {"bivariate table": half_as_bright}}, "expected methods of different labels"),
        ({"neural": "nowhere"}, "nowhere: no folder"),
    ],
)
def test_what_cannot_be_compared(folder, options, text):
    with pytest.raises(ValueError, match=text):
        dsbrdf.compare(folder / "rough-gold.npz", **options)


def test_nothing_to_compare(tmp_path):
    with pytest.raises(ValueError, match="nothing to compare"):
        dsbrdf.compare([])
    with pytest.raises(ValueError, match="no measured file"):
        dsbrdf.compare(tmp_path)


# The command


def test_command(folder, tmp_path, capsys):
    """Processes; a broken file is told in the end, and the rest is there."""
    arguments = ["compare", str(folder), "--methods", "bivariate,ggx", "-o", str(tmp_path), "--workers", "2"]
    assert cli.main(arguments) == 1
    said = capsys.readouterr()
    assert "bivariate table" in said.out
    assert said.err.count("\n") == 1
    assert said.err.startswith("dsbrdf: error: bad.binary: ")
    assert [row["status"][:2] for row in rows_of(tmp_path / "compare.csv")].count("ok") == 4


def test_spheres_of_the_worst(folder, tmp_path, monkeypatch, capsys):
    shown = []
    monkeypatch.setattr(comparison, "FINE", (16, 32))
    monkeypatch.setattr(figure, "draw_spheres", lambda rows: shown.extend(rows) or Figure(figsize=(1.0, 1.0)))
    arguments = ["compare", str(folder), "--methods", "ggx", "--worst", "1"]
    assert cli.main(arguments) == 2
    assert "needs a folder: add -o DIR" in capsys.readouterr().err
    assert cli.main([*arguments, "-o", str(tmp_path)]) == 1
    worst = max(Comparison.load(tmp_path / "compare.csv").rows, key=lambda row: (row.ok, row.cbrt))
    ((name, tiles),) = shown
    assert name == worst.material
    assert [label for label, _ in tiles] == ["measured", "Lambert + GGX"]
    assert sphere.difference(tiles[1][1], tiles[0][1]) == pytest.approx(worst.ciede2000, rel=0.1)
    assert (tmp_path / "worst.png").exists()


def test_command_that_cannot_be_understood(folder, capsys):
    assert cli.main(["compare", str(folder), "--methods", "best"]) == 1
    assert "unknown method 'best'" in capsys.readouterr().err


def test_spheres_that_are_drawn():
    """A picture shows what lies at the place of a pixel, x to the right and y up, the middle too."""
    limit = math.sin(math.radians(80.0))
    radius = limit * np.sqrt((np.arange(40) + 0.5) / 40)[:, None]
    azimuth = 2.0 * np.pi * (np.arange(72) + 0.5) / 72
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    shown = sphere.picture(np.stack([0.5 + 0.4 * x, 0.5 + 0.4 * y, 0.3 + 0.0 * x], axis=-1), 1.0, 101)
    at = (np.arange(101) + 0.5) * 2.0 / 101 - 1.0
    x, y = np.meshgrid(at, -at)
    inside = np.hypot(x, y) < 0.97
    for channel, expected in enumerate((0.5 + 0.4 * x, 0.5 + 0.4 * y, 0.3 + 0.0 * x)):
        np.testing.assert_allclose(shown[inside, channel] ** 2.2, expected[inside], atol=0.02)
    assert (shown[inside, 3] == 1.0).all()
    assert shown[0, 0, 3] == 0.0
    judge = merit.Judge(built_in("rough-gold", FEW))
    drawn = figure.draw_spheres([("gold", [("measured", judge.sphere), ("fit", 0.9 * judge.sphere)])])
    assert_nothing_is_cut(drawn)
