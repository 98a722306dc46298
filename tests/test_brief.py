"""Texts of values at the prompt: short, whatever they hold."""

import base64
import dataclasses
import io
import re
import sys
import warnings
from dataclasses import dataclass

import matplotlib.image
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


def test_a_fit_shows_itself_in_a_notebook(fit, monkeypatch):
    with_picture = fit._repr_html_()
    data = re.search(r'src="data:image/png;base64,([^"]+)"', with_picture)[1]
    pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(data)), format="png")
    assert pixels.shape == (120, 240, 4)
    # Measured on the left, fitted on the right, and they are alike
    assert 0.0 < np.abs(pixels[:, :120] - pixels[:, 120:]).mean() < 0.02
    assert f"<td>{fit.errors.rel:.3f}</td>" in with_picture
    named = dataclasses.replace(fit, model=fit.model.replace(name="<b>"))
    assert "&lt;b&gt;: 3 lobes" in named._repr_html_()
    for name in [name for name in sys.modules if name.startswith(("dsbrdf.plot", "matplotlib"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(dsbrdf, "plot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    alone = fit._repr_html_()
    assert "<img" not in alone
    assert f"<td>{fit.errors.rel:.3f}</td>" in alone


def test_a_model_draws_itself(fit):
    assert fit.model.plot().get_suptitle().startswith("gold: 3 lobes")
