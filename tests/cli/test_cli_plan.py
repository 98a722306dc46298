"""`dsbrdf plan`: the file it writes, what it takes, and what it refuses."""

import numpy as np
import pytest

import dsbrdf
from dsbrdf import cli, library


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def command(*arguments):
        status = cli.main([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    return command


def test_a_plan_filled_in_is_read_and_planned_on(run, tmp_path):
    status, out, _ = run("plan", "-n", 4, "--in-plane", "--theta-max", 60, "--picture", "plan.png")
    assert status == 0
    assert out.splitlines()[-2:] == ["plan.csv", "plan.png"]
    assert (tmp_path / "plan.png").stat().st_size > 5000
    head, *lines = (tmp_path / "plan.csv").read_text().splitlines()
    assert head == "theta_i_deg,theta_o_deg,phi_o_deg,r,g,b"
    assert len(lines) == 4
    model, filled = library.load("nickel"), [head]
    for line in lines:
        angles = np.deg2rad([float(text) for text in line.split(",")[:3]])
        wi = np.array([np.sin(angles[0]), 0.0, np.cos(angles[0])])
        wo = np.array(
            [np.sin(angles[1]) * np.cos(angles[2]), np.sin(angles[1]) * np.sin(angles[2]), np.cos(angles[1])]
        )
        filled.append(line.rstrip(",") + "," + ",".join(f"{value:.8g}" for value in model.eval(wi, wo)))
    (tmp_path / "known.csv").write_text("\n".join(filled) + "\n")
    samples = dsbrdf.read(tmp_path / "known.csv", scale=1.0)
    np.testing.assert_allclose(samples.values, model.eval(samples.wi, samples.wo), rtol=1e-5)
    assert run("plan", "-n", 2, "--known", "known.csv", "--scale", 1, "-o", "next.csv")[0] == 0
    assert (tmp_path / "next.csv").read_text().splitlines()[1:] != (
        tmp_path / "plan.csv"
    ).read_text().splitlines()[1:3]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--theta-max", "95"], "'theta_max' must be above 0 and below 90 degrees"),
        (
            ["--theta-max", "10", "--least-angle", "30"],
            "no pair of directions within 10 degrees of the normal",
        ),
        (["--known", "none.csv"], "none.csv"),
        (["-n", "0"], "Invalid value for '--samples'"),
    ],
)
def test_says_what_is_wrong(run, tmp_path, arguments, text):
    status, out, err = run("plan", *arguments)
    assert status in (1, 2)
    assert (out, len(err.splitlines())) == ("", 1)
    assert text in err
    assert not list(tmp_path.iterdir())
