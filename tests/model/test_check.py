"""`check_model` and its command: what is right passes, each thing that is wrong is told."""

import dataclasses
import json
import re

import numpy as np
import pytest
from by_hand import by_hand

from dsbrdf.cli import main
from dsbrdf.model import check, chi_square, sampling
from dsbrdf.model.check import check_model

FINE = by_hand([1.5, 0.1], [150.0, 0.5], [-0.3, 0.1], name="fine")
BRIGHT = by_hand([np.log1p(1.2 / np.pi)], [1e-9], [0.0], rise=0.0, tint=(0.5, 1.0, 0.5), name="bright")


@pytest.fixture(scope="module")
def fine():
    return check_model(FINE)


def test_a_sound_model_passes(fine):
    assert fine.ok
    assert fine.problems == ()
    assert fine.reciprocity == 0.0
    assert fine.minimum >= 0.0
    np.testing.assert_array_equal(fine.albedo, FINE.albedo(fine.theta_i))


def test_standard_deviations_are_those_of_samples(fine, rng):
    theta, n = fine.theta_o[1], 200_000
    wo = np.array([np.sin(theta), 0.0, np.cos(theta)])
    wi = FINE.sample(np.broadcast_to(wo, (n, 3)), rng)
    weight = np.zeros(n)
    above = wi[:, 2] > 0.0
    weight[above] = FINE.eval(wi[above], wo).mean(-1) * wi[above, 2] / FINE.pdf(wi[above], wo)
    assert fine.weight_std[1] == pytest.approx(weight.std() / weight.mean(), rel=0.05)
    wi = chi_square.direction(np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n))
    weight = FINE.eval(wi, wo).mean(-1) * np.pi
    assert fine.cosine_std[1] == pytest.approx(weight.std() / weight.mean(), rel=0.1)


def test_too_much_light():
    report = check_model(BRIGHT)
    assert not report.ok
    (problem,) = report.problems
    assert problem.startswith("reflects more light than it receives: albedo 1.20")
    assert "channel 1. model.conserve_energy() lowers it" in problem
    assert check_model(BRIGHT.conserve_energy()).ok


def test_a_sampler_that_is_wrong(monkeypatch):
    right = sampling.sample

    def tilted(lobes, wo, rng):
        return right(lobes, wo, rng) @ [[1.0, 0.0, 0.0], [0.0, 0.98, 0.199], [0.0, -0.199, 0.98]]

    monkeypatch.setattr(sampling, "sample", tilted)
    problems = check_model(FINE).problems
    assert len(problems) == len(check.SAMPLER_ANGLES)
    assert all("samples do not follow their density at " in problem for problem in problems)


def test_a_sampler_that_is_worse_than_cosine(monkeypatch):
    """One for another material: exact, and noisy."""
    other = by_hand([3.0], [2e4], [0.0]).lobes
    tables = sampling.tables(other)
    monkeypatch.setattr(sampling, "tables", lambda _: tables)
    matte = by_hand([0.1], [1.5], [0.0], name="matte")
    problems = check_model(matte).problems
    assert problems
    assert all(
        text.startswith("the sampler is worse than cosine-weighted directions at ") for text in problems
    )
    assert re.search(r"at 0 degrees: .* deviation of \d\.\d\d of their mean, against 0\.\d\d\.", problems[0])


def test_a_black_model_passes():
    assert check_model(by_hand([1e-300], [2.0], [0.0])).ok


def changed(change):
    """A model with other values."""

    class Changed(type(FINE)):
        def eval(self, wi, wo):
            return change(super().eval(wi, wo), wi)

    return Changed(**{field.name: getattr(FINE, field.name) for field in dataclasses.fields(FINE)})


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda values, wi: values * (1.0 + 0.1 * wi[..., :1]), "not reciprocal: values for exchanged"),
        (lambda values, wi: values - 0.01 + 0.0 * wi[..., :1], "values must be finite and >= 0, got -0.0"),
    ],
)
def test_values_that_are_wrong(change, text):
    assert any(text in problem for problem in check_model(changed(change)).problems)


def test_the_limit_of_significance_allows_for_several_angles():
    assert chi_square.sidak(check.SIGNIFICANCE, 3) == pytest.approx(check.SIGNIFICANCE / 3, rel=1e-3)


def test_the_command(tmp_path, capsys):
    for model in (FINE, BRIGHT):
        model.save(tmp_path / f"{model.name}.json")
    assert main(["check", str(tmp_path / "fine.json")]) == 0
    out, err = capsys.readouterr()
    assert "weight" in out
    assert err == ""
    assert main(["check", "--json", *(str(tmp_path / f"{name}.json") for name in ("fine", "bright"))]) == 1
    out, err = capsys.readouterr()
    fine, bright = map(json.loads, out.splitlines())
    assert (fine["ok"], bright["ok"]) == (True, False)
    assert f"dsbrdf: {tmp_path / 'bright.json'}: reflects more light than it receives" in err
    assert err.count("\n") == 1


def test_a_cell_that_does_not_settle():
    def rough(wi):
        return np.sin(1e6 * wi[..., 2])

    with pytest.raises(RuntimeError, match=r"cells do not settle to 1e-05 with 512 nodes a side\. Is the"):
        chi_square.cell_integrals(rough, np.array([0.0, 0.0, 1.0]), cells=(2, 2))
