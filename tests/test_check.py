"""Texts of `_check`: what is wrong, where, what was expected, what came and what to do."""

import re

import numpy as np
import pytest

import dsbrdf
from dsbrdf import _check

DEGREES = "Degrees? Use numpy.deg2rad."


def refused(function, *args, text, **kwargs):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        function(*args, **kwargs)


class Fit:
    """Not the one of the package: what is wrong is told by name."""


@pytest.mark.parametrize(
    ("value", "kinds", "text"),
    [
        (Fit(), dsbrdf.DSBRDF, "'x' must be a DSBRDF, got Fit. The model of a fit is fit.model."),
        ("a.json", dsbrdf.DSBRDF, "'x' must be a DSBRDF, got str. dsbrdf.load(path) reads a model file."),
        (3, dsbrdf.DSBRDF, "'x' must be a DSBRDF, got int."),
        (
            "a.binary",
            (dsbrdf.MeasuredBRDF, dsbrdf.Samples),
            "'x' must be a MeasuredBRDF or Samples, got str. dsbrdf.read(path) reads a file.",
        ),
    ],
)
def test_another_kind_is_refused_with_a_remedy(value, kinds, text):
    with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
        _check.instance(value, kinds, "x")


def test_a_kind_that_is_wanted_passes():
    _check.instance("a", (int, str), "x")
    assert _check.index(np.int32(3), "k") == 3
    _check.generator(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda: _check.generator(1),
            "'rng' must be a numpy.random.Generator, got int. numpy.random.default_rng(1)",
        ),
        (lambda: _check.index(1.5, "k"), "'k' must be an integer, got 1.5."),
        (lambda: _check.numbers("a", "x"), "'x' must be numbers, got 'a'."),
        (lambda: _check.finite({}, "x"), "'x' must be numbers, got {}."),
        (lambda: _check.unit_vectors("a", "wi"), "'wi' must be numbers, got 'a'."),
    ],
)
def test_what_is_no_number_or_generator(call, text):
    with pytest.raises(TypeError, match=f"^{re.escape(text)}"):
        call()


MODEL = dsbrdf.library.load("delrin")
TABLE = dsbrdf.tabulate(lambda wi, wo: 0.3 + 0.0 * (wi + wo), "grey", shape=(10, 6, 8))
SPACE = dsbrdf.space.builtin()
UP = [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: dsbrdf.fit(MODEL), "'measured' must be a MeasuredBRDF or Samples, got DSBRDF."),
        (lambda: dsbrdf.fit(TABLE, prior=3), "'prior' must be a MaterialSpace or Gaussian, got int."),
        (lambda: dsbrdf.DSBRDF({}), "'lobes' must be a Lobes, got dict."),
        (lambda: dsbrdf.material(3), "'name' must be a str, got int."),
        (lambda: dsbrdf.library.load(3), "'name' must be a str, got int."),
        (lambda: dsbrdf.tabulate(MODEL, "x"), "'reflectance' must be a function of wi and wo, got DSBRDF."),
        (lambda: dsbrdf.check_model(TABLE), "'model' must be a DSBRDF, got MeasuredBRDF. dsbrdf.fit"),
        (lambda: dsbrdf.fit_many([MODEL]), "'targets' must be a str or Path or MeasuredBRDF or Samples, got"),
        (lambda: dsbrdf.Samples([UP], [UP], "a"), "'values' must be numbers, got 'a'."),
        (lambda: MODEL.lobe("a"), "'k' must be an integer, got 'a'."),
        (lambda: MODEL.eval("a", UP), "'wi' must be numbers, got 'a'."),
        (lambda: MODEL.albedo("a"), "'theta_i' must be numbers, got 'a'."),
        (lambda: MODEL.sample(UP, 1), "'rng' must be a numpy.random.Generator, got int."),
        (lambda: SPACE.draw(1, 1), "'rng' must be a numpy.random.Generator, got int."),
        (lambda: SPACE.nearest("nickel"), "'model' must be a DSBRDF, got str. dsbrdf.load"),
        (lambda: SPACE.blend(MODEL, TABLE, 0.5), "'b' must be a DSBRDF, got MeasuredBRDF."),
        (lambda: SPACE.move(MODEL, "a", 1.0), "'axis' must be an integer, got 'a'."),
        (lambda: dsbrdf.space.build_space([MODEL, 3]), "'models' must be a DSBRDF, got int."),
        (lambda: dsbrdf.view.page([MODEL, "a.json"]), "'models' must be a DSBRDF, got str."),
        (lambda: dsbrdf.view.page(3), "'models' must be a DSBRDF, got int."),
        (lambda: dsbrdf.export.export(TABLE, "x", "glsl"), "'model' must be a DSBRDF, got MeasuredBRDF."),
        (lambda: dsbrdf.plot.fit_figure(MODEL), "'fit' must be a Fit, got DSBRDF. dsbrdf.fit"),
        (lambda: dsbrdf.plot.parameter_figure(TABLE), "'model' must be a DSBRDF, got MeasuredBRDF."),
        (lambda: dsbrdf.plot.samples_figure(TABLE), "'samples' must be a Samples, got MeasuredBRDF."),
        (lambda: dsbrdf.plot.write_figure(MODEL, "x.png"), "'figure' must be a Figure, got DSBRDF."),
        (
            lambda: dsbrdf.baselines.fit_ggx_pair(MODEL),
            "'measured' must be a MeasuredBRDF, got DSBRDF. dsbrdf.tabulate",
        ),
        (
            lambda: dsbrdf.baselines.fit_bivariate("a"),
            "'measured' must be a MeasuredBRDF, got str. dsbrdf.read",
        ),
        (
            lambda: dsbrdf.render.to_dict(3),
            "'reflectance' must be a DSBRDF or TexelMaps or MeasuredBRDF, got int.",
        ),
    ],
)
def test_the_wrong_thing_is_refused_by_its_kind(call, text):
    with pytest.raises(TypeError, match=f"^{re.escape(text)}"):
        call()


@pytest.mark.parametrize(
    ("value", "limits", "text"),
    [
        (-0.3, {"low": 0.0}, "'x' must be >= 0 and finite, got -0.3."),
        (0.0, {"low": 0.0, "open_low": True}, "'x' must be > 0 and finite, got 0."),
        ([1.0, 2.5], {"high": 2.0}, "'x' must be <= 2 and finite, got 2.5 at index 1."),
        (
            [[0.0, 3.0]],
            {"low": -1.0, "high": 1.0},
            "'x' must be >= -1 and <= 1 and finite, got 3 at index (0, 1).",
        ),
        (np.nan, {}, "'x' must be finite, got nan."),
        ([0.0, -np.inf, np.nan], {}, "'x' must be finite, got -inf at index 1."),
        ([1, 2, np.inf], {"low": 0.0}, "'x' must be >= 0 and finite, got inf at index 2."),
    ],
)
def test_finite_names_the_limits_and_the_first_offender(value, limits, text):
    refused(_check.finite, value, "x", **limits, text=text)


def test_finite_gives_float64_and_takes_the_limits_themselves():
    for value in ([0, 1], (0.0, 1.0), np.array([0.0, 1.0], np.float32), np.array([False, True])):
        checked = _check.finite(value, "x", low=0.0, high=1.0)
        assert checked.dtype == np.float64
        np.testing.assert_array_equal(checked, [0.0, 1.0])
    assert _check.finite([], "x", low=0.0, high=-1.0).shape == (0,)


@pytest.mark.parametrize(
    ("value", "high", "text"),
    [
        (85.0, np.pi / 2, f"'x' must lie in [0, pi/2] radians, got 85. {DEGREES}"),
        ([0.1, -0.2], np.pi / 2, f"'x' must lie in [0, pi/2] radians, got -0.2 at index 1. {DEGREES}"),
        (
            [[0.1], [np.nan]],
            np.pi / 2,
            f"'x' must lie in [0, pi/2] radians, got nan at index (1, 0). {DEGREES}",
        ),
        (np.inf, np.pi / 2, f"'x' must lie in [0, pi/2] radians, got inf. {DEGREES}"),
        (4.0, 3.0, f"'x' must lie in [0, 3] radians, got 4. {DEGREES}"),
    ],
)
def test_angle_names_the_range_and_asks_for_degrees(value, high, text):
    refused(_check.angle, value, "x", high=high, text=text)


def test_angle_clips_rounding_errors_of_either_precision():
    single = np.float32(np.pi / 2)
    assert float(single) > np.pi / 2
    clipped = _check.angle([-1e-12, single, np.nextafter(single, np.float32(2.0))], "x")
    np.testing.assert_array_equal(clipped, [0.0, np.pi / 2, np.pi / 2])
    refused(
        _check.angle, np.pi / 2 + 1e-4, "x", text=f"'x' must lie in [0, pi/2] radians, got 1.5709. {DEGREES}"
    )


@pytest.mark.parametrize(
    ("value", "shape"), [(1.0, "()"), ([1.0, 0.0], "(2,)"), (np.zeros((3, 4)), "(3, 4)"), ([], "(0,)")]
)
def test_unit_vectors_need_three_components(value, shape):
    refused(
        _check.unit_vectors, value, "wi", text=f"'wi' must have x, y, z on its last axis, got shape {shape}."
    )


@pytest.mark.parametrize(
    ("value", "norm"),
    [
        ([0.0, 0.0, 0.93], "0.93"),
        ([[0.0, 0.0, 1.0], [0.0, 3.0, 4.0]], "5 at index 1"),
        ([[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]], "0 at index (0, 1)"),
        ([0.0, np.nan, 0.0], "nan"),
        ([[np.inf, 0.0, 0.0]], "inf at index 0"),
        ([0.0, 1e200, 0.0], "1e+200"),
    ],
)
def test_unit_vectors_say_which_is_not(value, norm):
    text = f"'wo' must be unit vectors on the last axis, got norm {norm}. Divide by "
    refused(_check.unit_vectors, value, "wo", text=f"{text}numpy.linalg.norm(wo, axis=-1, keepdims=True).")


def test_unit_vectors_come_back_as_given():
    nearly = np.array([[0.0, 0.0, 1.0 + 9e-5], [0.6, 0.0, 0.8]])
    np.testing.assert_array_equal(_check.unit_vectors(nearly, "wi"), nearly)
    np.testing.assert_array_equal(_check.unit_vectors(np.asfortranarray(nearly)[::-1], "wi"), nearly[::-1])
    assert _check.unit_vectors(np.zeros((0, 4, 3), np.float32), "wi").shape == (0, 4, 3)
