"""`dsbrdf space` at the command line."""

import numpy as np
import pytest
from page_tools import described
from spaces import smooth_model

import dsbrdf
from dsbrdf import cli
from dsbrdf.space import load_space


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    from dsbrdf.plot import space as plot

    monkeypatch.setattr(plot, "N_PIXELS", 16)
    monkeypatch.setattr(plot, "N_DRAWS", 3)


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Call with arguments, in a folder with models; returns exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    for i in range(5):
        smooth_model(i, 2 + i % 2).save(tmp_path / "models" / f"material-{i}.json")

    def call(*arguments):
        status = cli.main(["space", *map(str, arguments)])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


@pytest.fixture
def built(run):
    assert run("build", "models")[0] == 0
    return run


def test_build(run, tmp_path):
    status, out, err = run("build", "models", "-o", "my.npz")
    assert (status, err) == (0, "")
    assert "MaterialSpace(5 materials, 3 channels, 3 lobes) in my.npz" in out
    assert load_space(tmp_path / "my.npz").names == tuple(f"material-{i}" for i in range(5))


def test_build_options(run, tmp_path):
    assert run("build", "models", "--correspondence", "border")[0] == 0
    assert load_space(tmp_path / "space.npz").settings.correspondence == "border"


def test_build_writes_a_page(run, tmp_path):
    """Laid out by the space, not by the likeness of reflectance."""
    from dsbrdf.view import page

    status, out, _ = run("build", "models", "--view", "pages/space.html")
    assert status == 0
    assert out.splitlines()[-1] == "Page: pages/space.html"
    models = [dsbrdf.load(path) for path in sorted((tmp_path / "models").glob("*.json"))]
    written = (tmp_path / "pages" / "space.html").read_text(encoding="utf-8")
    assert written == page(models, space=load_space(tmp_path / "space.npz"))
    assert written != page(models)


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_build_fits_what_is_measured(run, tmp_path, small_table):
    from dsbrdf.export.convert import write_csv
    from dsbrdf.measured.formats.array_file import write_npz
    from dsbrdf.space import FIT

    (tmp_path / "measured").mkdir()
    write_npz(small_table, tmp_path / "measured" / "b.npz")
    write_csv(small_table, tmp_path / "measured" / "a.csv")
    (tmp_path / "measured" / "notes.txt").write_text("Not a measurement.")
    assert run("build", "measured", "models/material-0.json")[0] == 0
    made = load_space(tmp_path / "space.npz")
    assert made.names == ("a", small_table.name, "material-0")
    expected = dsbrdf.fit(dsbrdf.read(tmp_path / "measured" / "b.npz"), **FIT).model
    np.testing.assert_allclose(made.curves[1], made.encode(expected))


def test_nearest(built):
    status, out, _ = built("nearest", "models/material-2.json", "-n", 2)
    assert status == 0
    lines = out.splitlines()
    assert lines[2].split() == ["material-2", "0.000"]
    assert len(lines) == 4


def test_blend_move_and_draw(built, tmp_path):
    assert (
        built("blend", "material-0", "models/material-1.json", "--t", 0.25)[1]
        == "material-0-75-material-1-25.json\n"
    )
    assert (
        built("move", "material-0", "--axis", 2, "--by", -1.5, "-o", "out/moved.json")[1]
        == "out/moved.json\n"
    )
    assert built("draw", "-n", 2, "--seed", 7, "-o", "drawn")[1] == "drawn/draw-1.json\ndrawn/draw-2.json\n"
    for name in ("material-0-75-material-1-25", "out/moved", "drawn/draw-1", "drawn/draw-2"):
        assert dsbrdf.load(tmp_path / f"{name}.json").n_channels == 3
    first = dsbrdf.load(tmp_path / "drawn" / "draw-1.json")
    again = load_space(tmp_path / "space.npz").draw(1, np.random.default_rng(7))[0]
    np.testing.assert_array_equal(first.lobes.scale, again.lobes.scale)


def test_plot(built, tmp_path):
    status, out, _ = built("plot", "-o", "figures")
    assert status == 0
    names = ["materials", "lobes", "variance", "functions", "blends", "draws"]
    assert out.splitlines() == [f"figures/space-{name}.png" for name in names]
    for name in names:
        assert (tmp_path / "figures" / f"space-{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["build", "models/material-0.json"], "a space needs two models at least, got 1."),
        (["build", "nowhere"], "nowhere: no such file; "),
        (["build", "empty"], "empty: no model file (.json) and no measured file in this folder."),
        (["build"], "Missing argument 'MODEL'"),
        (["nearest", "jade"], "jade: neither a file nor one of the 5 materials of the space."),
        (["nearest", "material-0", "-s", "none.npz"], "none.npz: there is no space yet."),
        (["nearest", "material-0", "-s", "models/material-0.json"], "not a sound .npz file"),
        (["nearest", "models/one-channel.json"], "one-channel: channels value, where the space has r, g, b."),
        (["blend", "material-0", "material-1", "--t", "2"], "'t' must be between 0 and 1, got 2.0."),
        (["move", "material-0", "--axis", "9"], "'axis' must be between 1 and 4, got 9."),
        (["draw", "-n", "0"], "Invalid value for '-n'"),
    ],
)
def test_says_what_is_wrong(built, tmp_path, arguments, text):
    (tmp_path / "empty").mkdir()
    smooth_model(9, n_channels=1, name="one-channel").save(tmp_path / "models" / "one-channel.json")
    status, out, err = built(*arguments)
    assert status in (1, 2)
    assert out == ""
    assert text in err
    assert len(err.splitlines()) == 1


def test_nothing_is_written_over_what_is_read(built, tmp_path):
    model = tmp_path / "models" / "material-0.json"
    before = model.read_bytes()
    status, _, err = built("build", "models", "-o", "models/material-0.json")
    assert status == 2
    assert "a space is an .npz file, got models/material-0.json" in err
    for arguments in (("move", model), ("blend", model, "material-1")):
        status, _, err = built(*arguments, "-o", model)
        assert status == 2
        assert "is what this is made from, and is not replaced" in err
    assert model.read_bytes() == before


def test_far_moves_are_told(built):
    assert "beyond all materials; run 'dsbrdf check'" in built("move", "material-0", "--by", "9")[2]
    assert built("move", "material-0", "--by", "2", "-o", "near.json")[2] == ""


def test_a_space_that_is_not_there(run):
    status, _, err = run("nearest", "material-0", "-s", "space.npz")
    assert status == 1
    assert "space.npz: there is no space yet. Make one with 'dsbrdf space build'." in err


def test_where_none_was_built_it_is_that_of_the_library(run, tmp_path):
    for arguments in ((), ("-s", "library")):
        status, out, _ = run("nearest", "nickel", *arguments)
        assert status == 0
        assert out.split()[0:2] != []
        assert "nickel" in out
    assert run("blend", "nickel", "red-fabric", "-o", "half.json")[0] == 0
    assert dsbrdf.load(tmp_path / "half.json").n_lobes == 5


def test_a_library_file_is_its_materials(run, tmp_path):
    """In the space and on the page, as files of its models would be; single ones by name."""
    models = [smooth_model(i) for i in range(3)]
    file = tmp_path / "mine.dsbrdf"
    dsbrdf.library.write(file, models)
    assert run("build", file, "-o", tmp_path / "space.npz")[0] == 0
    made = load_space(tmp_path / "space.npz")
    assert made.names == tuple(model.name for model in models)
    assert cli.main(["view", str(file), "-o", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert [material["name"] for material in described(page)] == [model.name for model in models]
    name = models[1].name
    np.testing.assert_allclose(
        dsbrdf.library.model_named(f"{file}/{name}").lobes.gamma, models[1].lobes.gamma, rtol=1e-6
    )
    before = file.read_bytes()
    assert run("build", file, "-o", file)[0] != 0
    assert file.read_bytes() == before
