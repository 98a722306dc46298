"""The command line: what it prints, writes and returns, and what it says when something fails."""

import errno
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import dsbrdf
from dsbrdf import batch, cli
from dsbrdf.batch import jobs
from dsbrdf.cli import _report as report

SRC = Path(dsbrdf.__file__).parents[1]
ERRORS = {"rel", "cbrt", "log", "albedo", "bivariate_floor", "azimuthal_floor"}
OTHERS = {
    "name",
    "n_lobes",
    "n_parameters",
    "channels",
    "converged",
    "objective",
    "coverage",
    "seconds",
    "criteria",
}
HEAVY = {"matplotlib", "scipy", "rich.table", "dsbrdf.plot", "dsbrdf.fitting"}


@pytest.fixture(scope="session")
def gold_file(tmp_path_factory):
    """A MERL file of a built-in material."""
    path = tmp_path_factory.mktemp("gold") / "gold.binary"
    dsbrdf.write_merl(dsbrdf.material("rough-gold"), path)
    return path


@pytest.fixture
def run(capsys):
    """Call with arguments; returns exit status, standard output, and the lines of standard error."""

    def call(*arguments, keep_warnings=False):
        status = cli.main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        err = captured.err.splitlines()
        return (
            status,
            captured.out,
            [x for x in err if keep_warnings or not x.startswith("dsbrdf: warning: ")],
        )

    return call


@pytest.fixture
def replace_fit(monkeypatch):
    """Call with a function to stand in for `dsbrdf.fit`; it gets the real one as first argument."""
    real = jobs.fit

    def replace(stand_in):
        monkeypatch.setattr(jobs, "fit", lambda measured, **options: stand_in(real, measured, **options))

    return replace


def process(*arguments, **options):
    """The command in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SRC), *sys.path])}
    command = [sys.executable, "-m", "dsbrdf", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, **options)


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


# What it prints


def test_help_without_arguments(run):
    status, out, err = run()
    assert status == 0
    assert not err
    assert all(f"\n  {command} " in out for command in ("demo", "fit", "info"))


@pytest.mark.parametrize("command", ["demo", "fit", "info"])
def test_help_of_a_command(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"dsbrdf {command}" in out


def test_version_of_the_module():
    with process("--version", stdout=subprocess.PIPE) as done:
        out, err = done.communicate()
    assert (done.returncode, out, err) == (0, f"dsbrdf {dsbrdf.__version__}\n", "")


def test_help_needs_no_heavy_modules():
    code = "import sys, dsbrdf.cli; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(SRC), *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert HEAVY.isdisjoint(done.stdout.split())


def test_fit_prints_a_table(run, gold_file):
    status, out, err = run("fit", gold_file)
    assert status == 0
    assert not err
    expected = dsbrdf.fit(dsbrdf.read(gold_file))
    (line,) = [line.split() for line in out.splitlines() if line.startswith("gold")]
    errors = expected.errors
    shown = (errors.rel, errors.cbrt, errors.log, errors.albedo, errors.bivariate_floor)
    assert line[:3] == ["gold", f"{expected.model.n_lobes}", f"{expected.model.n_parameters}"]
    assert line[3:8] == [f"{value:.3f}" for value in shown]


def test_fit_of_one_material_says_why_so_many_lobes(run, gold_file):
    _, out, _ = run("fit", gold_file)
    criteria = dsbrdf.fit(dsbrdf.read(gold_file)).estimate.criteria
    table = out[out.index("BIC") :].splitlines()[2:]
    rows = [line.split(maxsplit=2) for line in table if line.strip()]
    assert [row[:2] for row in rows] == [
        [f"{k}", f"{value:.0f}"] for k, value in enumerate(criteria, start=1)
    ]
    assert [row[0] for row in rows if row[2:] == ["chosen: lowest"]] == [f"{criteria.argmin() + 1}"]
    assert "BIC" not in run("fit", gold_file, gold_file)[1]
    assert "BIC" not in run("fit", gold_file, "--lobes", 2)[1]


def test_fit_prints_json(run, gold_file, tmp_path):
    status, out, err = run("fit", gold_file, "--json", "-o", tmp_path)
    assert status == 0
    assert not err
    (line,) = out.splitlines()
    content = json.loads(line)
    assert set(content) == {"model"} | OTHERS | ERRORS
    assert content["model"] == str(tmp_path / "gold.json")
    expected = dsbrdf.fit(dsbrdf.read(gold_file))
    assert {key: content[key] for key in ERRORS} == expected.errors.summary()
    assert content["channels"] == ["r", "g", "b"]
    assert content["criteria"] == expected.estimate.criteria.tolist()
    model = dsbrdf.load(tmp_path / "gold.json")
    for written, fitted in zip(model.lobes.parts, expected.model.lobes.parts, strict=True):
        np.testing.assert_array_equal(written, fitted)
    assert files_in(tmp_path) == ["gold.json"]


def test_json_has_null_for_what_is_not_a_number(run, gold_file):
    _, out, _ = run("fit", gold_file, "--json")
    assert json.loads(out)["model"] is None
    assert json.loads(report.json_line({"rel": float("nan"), "n": 3})) == {"rel": None, "n": 3}


def test_fit_takes_the_name_of_a_material(run, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    status, out, _ = run("fit", "matte", "--json")
    assert status == 0
    assert json.loads(out)["name"] == "matte"


def test_a_file_wins_over_a_material_of_its_name(run, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("matte").write_text("not a table")
    status, out, err = run("fit", "matte", "--json")
    assert status == 1
    assert not out
    expected = "no samples: expected lines of numbers after a header and comments, or another format."
    assert err == [f"dsbrdf: error: matte: {expected}"]


def test_options_reach_the_fit(run, gold_file, tmp_path):
    run("fit", gold_file, "-o", tmp_path, "--lobes", 2, "--curves", "compact", "--loss", "gamma")
    model = dsbrdf.load(tmp_path / "gold.json")
    assert model.n_lobes == 2
    assert tuple(part.shape[-1] for part in model.lobes.parts) == (3, 2, 2, 1, 1)
    chosen = {key: model.fit_options[key] for key in ("n_lobes", "loss", "curves", "prior")}
    assert chosen == {"n_lobes": 2, "loss": "gamma", "curves": "compact", "prior": False}


def test_info_tells_what_a_model_holds(run, gold_file, tmp_path):
    run("fit", gold_file, "-o", tmp_path)
    status, out, err = run("info", tmp_path / "gold.json")
    assert status == 0
    assert not err
    model = dsbrdf.load(tmp_path / "gold.json")
    assert "gold.binary" in out
    assert dsbrdf.read(gold_file).source.sha256 in out
    assert "n_lobes auto, loss log, curves standard" in out
    assert f" {model.n_parameters} " in next(line for line in out.splitlines() if line.startswith("numbers"))
    for angle in (0, 45, 75):
        values = model.albedo(np.deg2rad(angle))
        assert f"{angle} degrees " in out
        assert "  ".join(f"{value:.3f}" for value in values) in out


def test_plots_lie_beside_the_model(run, gold_file, tmp_path):
    status, _, _ = run("fit", gold_file, "-o", tmp_path, "--plot")
    assert status == 0
    assert files_in(tmp_path) == ["gold-parameters.png", "gold.json", "gold.png"]


def test_warnings_take_one_line(run, gold_file, replace_fit):
    def stand_in(real, measured, **options):
        warnings.warn("out of\niterations", dsbrdf.ConvergenceWarning, stacklevel=2)
        return real(measured, **options)

    replace_fit(stand_in)
    status, _, err = run("fit", gold_file, gold_file, keep_warnings=True)
    assert status == 0
    assert err.count(f"dsbrdf: warning: {gold_file}: out of iterations") == 2


# What it says when something fails


def test_bad_files_do_not_stop_the_others(run, gold_file, tmp_path):
    text = tmp_path / "notes.binary"
    text.write_text("text")
    short = tmp_path / "short.binary"
    short.write_bytes(gold_file.read_bytes()[:5000])
    missing = tmp_path / "nothing.binary"
    (tmp_path / "empty").mkdir()
    status, out, err = run("fit", text, short, missing, tmp_path / "empty", gold_file, "--json")
    assert status == 1
    assert [json.loads(line)["name"] for line in out.splitlines()] == ["gold"]
    assert err == [
        f"dsbrdf: error: {tmp_path / 'empty'}: no measured file ({', '.join(batch.SUFFIXES)}) in this folder.",
        f"dsbrdf: error: {text}: not a MERL file: expected 34,992,012 bytes, the file has 4.",
        f"dsbrdf: error: {short}: not a whole MERL file: the header says 90 x 90 x 180 (34,992,012 bytes), "
        "the file has 5,000 bytes. Fetch it again.",
        f"dsbrdf: error: {missing}: no such file.",
    ]


def test_a_misspelt_material(run):
    status, out, err = run("fit", "rough-gol")
    assert (status, out) == (1, "")
    (line,) = err
    assert line.startswith("dsbrdf: error: rough-gol: no such file; unknown built-in material")
    assert line.endswith("Did you mean 'rough-gold'?")


def test_two_files_of_one_name(run, gold_file, tmp_path):
    (tmp_path / "gold.binary").hardlink_to(gold_file)
    out = tmp_path / "models"
    status, _, err = run("fit", gold_file, tmp_path / "gold.binary", "-o", out)
    assert status == 1
    (line,) = err
    assert f"{out / 'gold.json'} is already the file of {gold_file}" in line
    assert dsbrdf.load(out / "gold.json").source.to_json()["file"] == "gold.binary"


@pytest.mark.parametrize("below", ["", "models"])
@pytest.mark.parametrize("command", ["fit", "demo"])
def test_a_file_where_the_folder_should_be(run, gold_file, tmp_path, command, below):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    files = [gold_file] if command == "fit" else []
    status, out, err = run(command, *files, "--out", taken / below)
    assert (status, out) == (1, "")
    assert err == [f"dsbrdf: error: {taken}: {os.strerror(errno.ENOTDIR)}."]
    assert taken.read_text() == "mine"


def test_a_folder_that_may_not_be_written(run, gold_file, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, _mode: path != tmp_path)
    status, out, err = run("fit", gold_file, "-o", tmp_path / "models")
    assert (status, out) == (1, "")
    assert err == [f"dsbrdf: error: {tmp_path}: {os.strerror(errno.EACCES)}."]


def test_a_full_disk_leaves_nothing_half_written(run, gold_file, tmp_path, monkeypatch):
    real = Path.write_text

    def fill_up(path, text, **options):
        real(path, text[:100], **options)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(Path, "write_text", fill_up)
    status, out, err = run("fit", gold_file, "-o", tmp_path / "models")
    assert (status, out) == (1, "")
    assert err == [f"dsbrdf: error: {tmp_path / 'models' / 'gold.json'}: {os.strerror(errno.ENOSPC)}."]
    assert files_in(tmp_path / "models") == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_behind_standard_output():
    with open("/dev/full", "w") as full, process("--help", stdout=full) as done:  # noqa: PTH123
        _, err = done.communicate()
    assert done.returncode == 1
    assert err == f"dsbrdf: error: standard output: {os.strerror(errno.ENOSPC)}.\n"


def test_interruption_keeps_what_is_done(run, gold_file, tmp_path, replace_fit):
    def stand_in(real, measured, **options):
        if measured.name == "second":
            raise KeyboardInterrupt
        return real(measured, **options)

    replace_fit(stand_in)
    second = tmp_path / "second.binary"
    second.hardlink_to(gold_file)
    status, out, err = run("fit", gold_file, second, "-o", tmp_path / "models")
    assert status == 130
    assert err == ["dsbrdf: interrupted"]
    assert "\ngold " in out
    assert files_in(tmp_path / "models") == sorted(["gold.json", batch.RECORD, *batch.TABLES])


def test_a_reader_that_goes_away(gold_file):
    with process("fit", *[gold_file] * 3, "--json", stdout=subprocess.PIPE) as done:
        assert json.loads(done.stdout.readline())["name"] == "gold"
        done.stdout.close()
        assert done.stderr.read() == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paint"], "No such command 'paint'"),
        (["fit"], "Missing argument"),
        (["fit", "matte", "--lobes", "0"], "expected a number from 1 to 10, or auto, got '0'"),
        (["fit", "matte", "--lobes", "many"], "--lobes"),
        (["fit", "matte", "--curves", "long"], "--curves"),
        (["fit", "matte", "--loss", "l3"], "--loss"),
        (["fit", "matte", "--speed", "9"], "--speed"),
        (["fit", "matte", "--plot"], "add -o DIR"),
        (["fit", "matte", "--prior", "s.npz", "--lobes", "3"], "--prior': the space decides on lobes"),
        (["fit", "matte", "--prior", "s.npz", "--curves", "compact"], "leave out --lobes and --curves"),
    ],
)
def test_usage(run, arguments, message):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    (line,) = err
    assert line.startswith("dsbrdf: error: ")
    assert message in line
    assert line.endswith(f"Try 'dsbrdf{'' if arguments == ['paint'] else ' fit'} --help'.")


def test_info_of_what_is_no_model(run, tmp_path):
    status, out, err = run("info", tmp_path / "nothing.json")
    assert (status, out) == (1, "")
    assert err == [f"dsbrdf: error: {tmp_path / 'nothing.json'}: {os.strerror(errno.ENOENT)}."]
    (tmp_path / "no-model.json").write_text("{}")
    status, out, err = run("info", tmp_path / "no-model.json")
    assert (status, out) == (1, "")
    assert len(err) == 1
    assert err[0].startswith(f"dsbrdf: error: {tmp_path / 'no-model.json'}: not a model file")


def test_an_error_of_ours_takes_one_line_too(run, gold_file, replace_fit):
    def stand_in(_real, _measured, **_options):
        raise ZeroDivisionError("division\nby zero")

    replace_fit(stand_in)
    status, _, err = run("fit", gold_file)
    assert status == 1
    assert len(err) == 1
    assert err[0].startswith(f"dsbrdf: error: {gold_file}: unexpected ZeroDivisionError: division by zero.")


@pytest.mark.parametrize("position", [0, 2])
def test_debug_raises(tmp_path, position):
    arguments = ["fit", str(tmp_path / "nothing.binary")]
    arguments.insert(position, "--debug")
    with pytest.raises(ValueError, match="no such file"):
        cli.main(arguments)


@pytest.mark.usefixtures("without_matplotlib")
def test_plots_need_matplotlib(run, gold_file, tmp_path):
    status, out, err = run("fit", gold_file, "-o", tmp_path, "--plot")
    assert (status, out) == (1, "")
    assert err == ['dsbrdf: error: dsbrdf.plot needs matplotlib: pip install "dsbrdf[plot]"']
    assert files_in(tmp_path) == []


@pytest.fixture
def without_matplotlib(monkeypatch):
    monkeypatch.delattr(dsbrdf, "plot", raising=False)
    monkeypatch.delitem(sys.modules, "dsbrdf.plot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)


@pytest.mark.usefixtures("without_matplotlib")
def test_demo_without_matplotlib(run, tmp_path, monkeypatch):
    monkeypatch.setattr("dsbrdf.cli._demo.MATERIALS", {"satin-aluminium": ""})
    status, out, err = run("demo", "--out", tmp_path / "demo")
    assert status == 0
    assert err == ['dsbrdf: no plots: dsbrdf.plot needs matplotlib: pip install "dsbrdf[plot]"']
    assert "\nsatin-aluminium " in out
    assert files_in(tmp_path / "demo") == ["satin-aluminium.json"]
