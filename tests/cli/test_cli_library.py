"""`dsbrdf library`, and names of its materials where a command takes a model."""

import json

import numpy as np
import pytest
from page_tools import described

import dsbrdf
from dsbrdf import cli, library


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def command(*arguments):
        status = cli.main([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    return command


def test_list_and_show(run):
    status, out, _ = run("library", "list")
    assert (status, tuple(out.split())) == (0, library.names())
    status, out, _ = run("library", "show", "nickel")
    assert status == 0
    for text in ("nickel.binary", "NBRDF-decoded MERL", "licence: MIT", "citation: A. Sztrajman"):
        assert text in out
    status, _, err = run("library", "show", "nikel")
    assert status == 1
    assert "Near are nickel" in err


def test_a_library_of_ones_own(run, tmp_path):
    for name in ("nickel", "brass"):
        library.load(name).save(tmp_path / "models" / f"{name}.json")
    assert run("library", "write", "models", "-o", "own.dsbrdf")[:2] == (0, "own.dsbrdf: 2 materials\n")
    assert run("library", "list", "-f", "own.dsbrdf")[1] == "brass\nnickel\n"
    assert "nickel.binary" in run("library", "show", "nickel", "-f", "own.dsbrdf")[1]
    status, _, err = run("library", "write", "models", "-o", "own.npz")
    assert (status, "a library is a .dsbrdf file" in err) == (2, True)
    status, _, err = run("library", "list", "-f", "models/brass.json")
    assert (status, "not a library" in err) == (1, True)


def test_names_are_models(run, tmp_path):
    status, out, _ = run("check", "brass", "--json")
    assert (status, json.loads(out)["model"]) == (0, "brass")
    assert "nickel.binary" in run("info", "nickel")[1]
    assert run("export", "nickel", "-t", "merl", "-o", "n.binary")[0] == 0
    assert (tmp_path / "n.binary").stat().st_size > 1000
    assert run("view", "nickel", "brass", "-o", "page.html")[0] == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert [material["name"] for material in described(page)] == ["nickel", "brass"]


def test_a_file_comes_before_the_library(run, tmp_path):
    (tmp_path / "nickel").write_text("theta_i_deg,theta_o_deg,phi_o_deg,value\n0,10,0,x\n")
    assert library.model_named("nickel") is None
    assert library.model_named("brass").name == "brass"
    assert library.model_named("rough-gold") is None
    assert run("info", "nickel")[0] == 1


def test_fit_with_the_library_as_prior(run, tmp_path):
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(0.2, 1.0, (2, 20)), 2.0 * np.pi * rng.random((2, 20))
    s = np.sqrt(1.0 - z**2)
    wi, wo = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    samples = dsbrdf.Samples(wi, wo, library.load("red-fabric").eval(wi, wo), name="few")
    np.savez(tmp_path / "few.npz", wi=samples.wi, wo=samples.wo, values=samples.values)
    assert run("fit", "few.npz", "--prior", "library", "-o", "out", "--scale", "1")[0] == 0
    assert dsbrdf.load(tmp_path / "out" / "few.json").n_lobes == 5
