"""Manners of the command line: quiet, completion, Ctrl-C, and one bad file among good ones."""

import os
import signal
import subprocess
import sys

import pytest

import dsbrdf
from dsbrdf import cli, library


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
