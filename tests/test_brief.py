"""Texts of values at the prompt: short, whatever they hold."""

import dataclasses
import re
import warnings
from dataclasses import dataclass

import numpy as np
import pytest

import dsbrdf
from dsbrdf import baselines, library, paper, space
from dsbrdf._brief import Brief


@dataclass(frozen=True, eq=False, repr=False)
class Held(Brief):
    array: object
    many: object = ()
    small: float = 0.5


@pytest.fixture(scope="module")
def fit():
    measured = dsbrdf.tabulate(
        dsbrdf.measured.built_in.get("rough-gold").reflectance, "gold", shape=(30, 18, 24)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
        return dsbrdf.fit(measured, 3)


def test_arrays_are_shown_by_their_shape():
    held = Held(np.zeros((900, 3)), list(range(1000)))
    assert repr(held) == "Held(array=<float64 (900, 3)>, many=<list of 1000>, small=0.5)"
    assert repr(Held(held)).startswith("Held(array=Held(array=<float64 (900, 3)>, ")
    assert repr(Held("x" * 100)) == "Held(array=<str>, many=(), small=0.5)"


def test_every_result_is_short(fit):
    scan = dsbrdf.Samples(
        np.tile([0.0, 0.0, 1.0], (500, 1)), np.tile([0.6, 0.0, 0.8], (500, 1)), np.ones((500, 31))
    )
    materials = space.builtin()
    shown = [
        fit,
        *(getattr(fit, field.name) for field in dataclasses.fields(fit)),
        fit.coverage,
        fit.posterior,
        fit.standard_errors(),
        fit.standard_errors(np.linspace(0.0, 1.5, 400)),
        fit.model.lobes,
        fit.model.profile,
        dsbrdf.check_model(fit.model),
        scan,
        library.builtin(),
        materials,
        materials.fpca,
        materials.gaussian(),
        paper.fit_slices(fit.measured, n_lobes=1),
        baselines.fit_bivariate(fit.measured),
        baselines.fit_lambert_ggx(fit.measured),
    ]
    for value in shown:
        text = repr(value)
        assert text.count("\n") < 15, type(value)
        assert len(text) < 1500, type(value)


def test_errors_have_their_floors(fit):
    errors = fit.errors
    for word, value in (
        ("rel", errors.rel),
        ("albedo", errors.albedo),
        ("bivariate floor", errors.bivariate_floor),
    ):
        assert f"{word} {value:.3f}" in repr(errors)
    assert "floor" not in repr(dataclasses.replace(errors, bivariate_floor=np.nan, azimuthal_floor=np.nan))


def test_standard_errors_are_a_table(fit):
    found = fit.standard_errors(np.deg2rad([20.0, 50.0]))
    title, header, *rows = repr(found).splitlines()
    assert title.startswith("Standard errors of kappa (%")
    assert header.split() == ["theta_d", "lobe", "0", "lobe", "1", "lobe", "2"]
    assert [row.split()[0] for row in rows] == ["20", "50"]
    for i, row in enumerate(rows):
        numbers = [float(text.replace(">", "")) for text in re.findall(r"\S+", row)[1:]]
        want = np.stack([100 * found.ln_kappa[i].max(0), 100 * found.ln_gamma[i], found.beta[i]], axis=-1)
        want[:, :2] = np.minimum(want[:, :2], 100.0)
        np.testing.assert_allclose(np.reshape(numbers, (3, 3)), want, rtol=0.06)
