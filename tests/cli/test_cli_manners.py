"""Manners of the command line: quiet, completion, Ctrl-C, and one bad file among good ones."""

import io
import os
import re
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

import dsbrdf
from dsbrdf import cli, library
from dsbrdf.cli import _app, _report


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two models and a file that is none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    for name in ("nickel", "red-fabric"):
        library.load(name).save(tmp_path / "models" / f"{name}.json")
    (tmp_path / "models" / "broken.json").write_text("{", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        (["view", "models", "-o", "page.html"], "page.html"),
        (["space", "build", "models", "-o", "s.npz"], "s.npz"),
    ],
)
def test_one_bad_file_does_not_stop_the_others(folder, capsys, arguments, written):
    assert cli.main(arguments) == 1
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert errors[0].startswith("dsbrdf: error: models/broken.json: not a model file")
    assert (folder / written).stat().st_size > 1000


def test_nothing_is_written_where_all_are_bad(folder, capsys):
    (folder / "worse.json").write_text("[]", encoding="utf-8")
    assert cli.main(["view", "models/broken.json", "worse.json", "-o", "page.html"]) == 1
    assert capsys.readouterr().err.count("error:") == 2
    assert not (folder / "page.html").exists()


def test_a_bad_file_of_a_space_to_be_fitted(folder, capsys):
    (folder / "scan.csv").write_text("theta_i_deg,theta_o_deg,value\n0,0,oops\n", encoding="utf-8")
    assert cli.main(["space", "build", "models/nickel.json", "scan.csv", "models/red-fabric.json"]) == 1
    assert "scan.csv" in capsys.readouterr().err
    assert dsbrdf.space.load_space("space.npz").names == ("nickel", "red-fabric")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("quiet", [[], ["-q"], ["--quiet"]])
def test_quiet_leaves_notes_out(capsys, quiet):
    assert cli.main(["export", "models/nickel.json", "-t", "gltf", *quiet]) == 0
    assert bool(capsys.readouterr().err) == (not quiet)
    assert cli.main(["check", "models/broken.json", *quiet]) == 1
    assert capsys.readouterr().err.startswith("dsbrdf: error: ")


def test_the_shell_completes_commands():
    words = {"_DSBRDF_COMPLETE": "complete_bash", "COMP_WORDS": "dsbrdf vi", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "dsbrdf"], env=os.environ | words, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["view"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals of POSIX")
def test_ctrl_c_does_not_wait_for_the_kernel():
    """The work would never end: the process does, in one line."""
    code = (
        "import signal, sys, time\n"
        # A parent in the background may have left it ignored
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from dsbrdf.cli import app, main\n"
        "@app.command()\n"
        "def stuck():\n"
        "    print('begun', flush=True)\n"
        "    while True:\n"
        "        try:\n"
        "            time.sleep(60)\n"
        "        except KeyboardInterrupt:\n"
        "            pass\n"
        "sys.exit(main(['stuck']))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "dsbrdf: interrupted\n"


def test_how_certain_a_fit_is(folder, capsys):
    rows = "".join(f"{i},{o},0,{0.3 + 0.001 * i:.4f}\n" for i in (0, 20, 40) for o in range(-60, 61, 10))
    (folder / "scan.csv").write_text("theta_i_deg,theta_o_deg,phi_o_deg,value\n" + rows, encoding="utf-8")
    assert cli.main(["info", "scan.csv", "--uncertainty", "-q"]) == 0
    assert "Standard errors of kappa (%" in capsys.readouterr().out
    with_model = ["info", "models/nickel.json", "--uncertainty"]
    assert cli.main(with_model) == 2
    assert "is a model, without its measurement" in capsys.readouterr().err


SCAN = "theta_i_deg,theta_o_deg,phi_o_deg,value\n" + "".join(
    f"{i},{o},0,{0.1 + 0.001 * i:.4f}\n" for i in (0, 20, 40) for o in range(-60, 61, 10)
)


@pytest.fixture
def pipe(folder, monkeypatch):  # noqa: ARG001
    """Call with bytes that are piped in, and arguments; gives the status."""

    def call(content, *arguments):
        stream = SimpleNamespace(buffer=io.BytesIO(content), isatty=lambda: content is None)
        monkeypatch.setattr(sys, "stdin", stream)
        return cli.main(list(arguments))

    return call


def test_samples_are_read_from_standard_input(pipe, folder, capsys):
    text = SCAN.encode()
    assert pipe(text, "fit", "-", "-o", "out", "--lobes", "1") == 0
    assert dsbrdf.load(folder / "out" / "stdin.json").source.to_json()["file"] == "stdin"
    assert pipe(text, "info", "-") == 0
    assert re.search(r"^file +standard input *$", capsys.readouterr().out, re.MULTILINE)
    assert pipe(text, "convert", "-", "scan.npz") == 0
    assert len(dsbrdf.read("scan.npz")) == SCAN.count("\n") - 1
    assert pipe(text, "view", "-", "models/nickel.json", "-o", "page.html") == 0
    assert pipe(text, "check", "-", "--json") == 0
    # Nothing of it is left
    assert not _app._called


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (
            b"tensor_file\0\1\0",
            r"standard input: expected text with columns, got a binary file that begins with b'tensor_f",
        ),
        (b"a,b\nc,d\n", "standard input: "),
        (b"", "standard input: an empty file."),
        (
            SCAN.encode().replace(b"\n", b"\n\n") * 9,
            "standard input: more than 900 bytes. Write it to a file",
        ),
    ],
)
def test_what_is_not_read_from_standard_input(pipe, capsys, monkeypatch, content, text):
    monkeypatch.setattr(_app, "MAX_INPUT", 900)
    assert pipe(content, "fit", "-") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"dsbrdf: error: {text}")


def test_a_terminal_is_not_waited_for(pipe, capsys):
    assert pipe(None, "fit", "-") == 1
    assert "standard input: nothing is piped in" in capsys.readouterr().err


def test_verbose_shows_versions_steps_and_where_warnings_come_from(pipe, capsys):
    # A channel without a valid value
    dark = SCAN.replace("\n", ",-1\n").replace("value,-1", "450nm,550nm", 1).encode()
    assert pipe(dark, "fit", "-", "-v") == 0
    first, *others, last = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"dsbrdf: [\d.]+ s: dsbrdf \S+, numpy \S+, scipy \S+, Python .*, \d+ cores", first)
    assert re.fullmatch(r"dsbrdf: [\d.]+ s: end, [\d.]+ s of processor time", last)
    assert any(re.fullmatch(r"dsbrdf: [\d.]+ s: standard input", line) for line in others)
    assert any(re.search(r"s: \w+Warning, .*\.py:\d+$", line) for line in others)
    assert pipe(dark, "fit", "-") == 0
    errors = capsys.readouterr().err
    assert "channel 550nm holds no valid value" in errors
    assert "Warning, " not in errors


def row(name, **changes):
    numbers = {"rel": 0.1, "cbrt": 0.1, "log": 0.1, "albedo": float("nan"), "bivariate_floor": float("nan")}
    return {"name": name, "n_lobes": 1, "n_parameters": 4, "seconds": 0.1, **numbers, **changes}


def test_notes_of_many_fits_are_told_once(capsys):
    same, other = {"coverage": "only half"}, {"coverage": "all but one", "remarks": ["2 left out"]}
    _report.print_fits([row("a", **same), row("b", **other), row("c", **same), row("d")])
    out = capsys.readouterr().out
    assert "albedo" not in out
    assert "floor" not in out
    lines = [line.split() for line in out.splitlines()]
    assert {line[0]: line[7:] for line in lines if len(line) > 6 and line[0] in "abcd"} == {
        "a": ["1"],
        "b": ["2", "3", "4"],
        "c": ["1"],
        "d": [],
    }
    assert [line for line in out.splitlines() if line[:2] in ("1:", "2:", "3:", "4:")] == [
        "1: only half.",
        "2: channels .",
        "3: 2 left out.",
        "4: all but one.",
    ]


def test_of_one_fit_the_notes_stand_below(capsys):
    _report.print_fits([row("a", coverage="only half", albedo=0.2)])
    out = capsys.readouterr().out
    assert "a: only half." in out
    assert "notes" not in out
    assert "albedo: largest relative error" in out


@pytest.mark.parametrize(
    "arguments",
    [
        ["view", "models/nickel.json", "-o", "mine.html"],
        ["space", "build", "nickel", "red-fabric", "-o", "mine.npz"],
        ["space", "blend", "nickel", "red-fabric", "-o", "mine.json"],
        ["library", "write", "models/nickel.json", "-o", "mine.dsbrdf"],
        ["export", "nickel", "-t", "glsl", "-o", "mine.glsl"],
        ["plan", "-n", "1", "-o", "mine.csv"],
    ],
)
def test_what_others_wrote_is_replaced_only_by_force(folder, capsys, arguments):
    mine = folder / arguments[-1]
    mine.write_text("years of work", encoding="utf-8")
    assert cli.main(arguments) == 2
    assert f"{arguments[-1]} is there already" in capsys.readouterr().err
    assert mine.read_text(encoding="utf-8") == "years of work"
    assert cli.main([*arguments, "--force"]) == 0
    assert mine.read_bytes() != b"years of work"
    # What we wrote may be replaced, but for a plan, which may have been filled in
    assert cli.main(arguments) == (2 if arguments[0] == "plan" else 0)


def test_options_have_one_name_everywhere():
    """Where a file is written, -o or --out names it and --force replaces it."""
    import typer

    def commands(of, path=()):
        for name, command in getattr(of, "commands", {}).items():
            yield from commands(command, (*path, name))
        if not hasattr(of, "commands"):
            yield " ".join(path), {option for parameter in of.params for option in parameter.opts}

    for name, options in commands(typer.main.get_command(cli.app)):
        assert ("--out" in options) == ("-o" in options), name
        folders = name in ("demo", "paper", "space plot", "convert")
        assert ("--force" in options) == ("--out" in options) or folders or name == "info", name
