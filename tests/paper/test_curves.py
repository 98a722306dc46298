"""Curves over theta_d: the basis, smoothing of slices, and models that hold curves."""

import re

import numpy as np
import pytest
from curve_models import SLICES, random_curves, sliced
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad_vec
from slices import random_slices, upper

from dsbrdf.paper import CurveBasis, Curves, Slices
from dsbrdf.paper.curves import VARIABLES, sensitivity

COEFFICIENTS = ("kappa", "gamma", "beta", "spike")

BASES = [
    CurveBasis(),
    CurveBasis(4, 3),
    CurveBasis(7, 1, (0.1, 1.2)),
    CurveBasis(2, 0),
    CurveBasis(variable="cosine"),
    CurveBasis(6, 3, (0.2, 1.5), variable="cosine"),
]


# The basis


def test_the_papers_basis_has_six_functions_on_five_uniform_knots():
    basis = CurveBasis()
    assert basis.size == 6
    assert_allclose(np.rad2deg(basis.breaks), [0.0, 22.5, 45.0, 67.5, 90.0])


def test_cosine_knots_are_uniform_in_the_cosine():
    assert_allclose(np.cos(CurveBasis(variable="cosine").breaks), [1.0, 0.75, 0.5, 0.25, 0.0], atol=1e-15)


@pytest.mark.parametrize("basis", BASES, ids=str)
def test_functions_are_positive_and_add_up_to_one(basis):
    theta_d = np.linspace(0.0, np.pi / 2, 1001)
    design = basis.design(theta_d)
    assert design.shape == (1001, basis.size)
    assert (design >= 0.0).all()
    assert_allclose(design.sum(1), 1.0, rtol=1e-14)


@pytest.mark.parametrize("basis", BASES, ids=str)
def test_gram_is_that_of_independent_quadrature(basis):
    low, high = basis.domain

    def products(x):
        (row,) = basis.design([x])
        return np.outer(row, row)

    expected, _ = quad_vec(products, low, high, points=basis.breaks, epsabs=1e-13, epsrel=1e-13)
    assert_allclose(basis.gram, expected, atol=1e-12)


def test_beyond_the_domain_the_ends_hold():
    basis = CurveBasis(domain=(0.3, 1.2))
    assert_array_equal(basis.design([0.0, 1.5]), basis.design([0.3, 1.2]))
    assert_array_equal(basis.design([0.3, 1.2]), np.eye(6)[[0, 5]])


@pytest.mark.parametrize("basis", [b for b in BASES if b.degree > 0], ids=str)
def test_curves_are_continuous_at_knots_and_ends(basis, rng):
    coefficients = rng.normal(size=basis.size)
    for at in basis.breaks:
        near = np.clip([at - 1e-9, at, at + 1e-9], 0.0, np.pi / 2)
        assert np.ptp(basis.design(near) @ coefficients) < 1e-6


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((1, 2), "a basis needs 'n_knots' >= 2 and 'degree' >= 0, got 1 and 2."),
        ((5, -1), "a basis needs 'n_knots' >= 2 and 'degree' >= 0, got 5 and -1."),
        ((5, 2, (1.0, 1.0)), "'domain' must be an ascending pair of angles, got (1, 1)."),
        ((5, 2, (0.0, 90.0)), "'domain' must lie in [0, pi/2] radians, got 90 at index 1."),
        ((5, 2, (0.0, 1.0), "sine"), "'variable' must be 'theta_d' or 'cosine', got 'sine'."),
    ],
)
def test_bases_that_are_none_are_refused(arguments, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        CurveBasis(*arguments)


# Smoothing


@pytest.mark.parametrize("logarithmic", [True, False])
@pytest.mark.parametrize("variable", VARIABLES)
def test_a_model_whose_parameters_are_splines_is_recovered(rng, logarithmic, variable):
    curves = random_curves(rng, CurveBasis(variable=variable), logarithmic=logarithmic)
    got = sliced(curves).to_curves(curves.basis, logarithmic=logarithmic)
    assert got.curves.logarithmic is logarithmic
    for name in COEFFICIENTS:
        assert_allclose(getattr(got.curves, name), getattr(curves, name), rtol=1e-6, atol=1e-6)


def test_slices_are_weighted_by_their_light_and_their_samples():
    shape = (len(SLICES), 1, 2)
    model = Slices(SLICES, np.broadcast_to([0.5, 0.005], shape), np.ones(shape), np.zeros(shape))
    weights = sensitivity(model)
    assert (np.diff(weights, axis=0) < 0.0).all(), "fewer samples are above the horizon near grazing"
    assert (weights[..., 0] > 1e3 * weights[..., 1]).all()


def test_weights_decide_between_slices_that_disagree():
    values = np.where(np.arange(len(SLICES)) % 2, 1.0, 2.0)[:, None, None]
    model = Slices(SLICES, values, values, 0.0 * values)
    weights = np.where(values > 1.5, 1.0, 1e-3)
    curves = Curves.of(model, weights=weights)
    assert_allclose(curves.at(SLICES)[0], 2.0, rtol=0.01)


def test_weights_of_another_shape_are_refused():
    with pytest.raises(
        ValueError, match=r"^'weights' must have shape \(7, 3, 3\) like kappa, got \(7, 3\)\.$"
    ):
        Curves.of(random_slices(), weights=np.ones((7, 3)))


@given(seed=st.integers(0, 10_000), n_slices=st.integers(1, 8), logarithmic=st.booleans())
def test_any_model_smooths_to_a_valid_one(seed, n_slices, logarithmic):
    model = random_slices(seed, n_slices=n_slices).to_curves(logarithmic=logarithmic)
    assert len(model.theta_d) == 90
    assert (model.kappa > 0.0).all()


@pytest.mark.parametrize("logarithmic", [True, False])
def test_one_slice_gives_constant_curves(logarithmic):
    model = random_slices(n_slices=1)
    smooth = model.to_curves(logarithmic=logarithmic)
    for name in ("kappa", "gamma", "beta", "spike"):
        values = getattr(smooth, name)
        assert_allclose(values, np.broadcast_to(getattr(model, name), values.shape), rtol=1e-6)


# Models of curves


def test_a_model_of_curves_is_tabulated_at_the_rows_of_a_table(rng):
    curves = random_curves(rng)
    model = curves.model(name="made up")
    assert model.name == "made up"
    assert model.curves is curves
    assert_allclose(np.rad2deg(model.theta_d), np.arange(90) + 0.5)
    for got, want in zip((model.kappa, model.gamma, model.beta), curves.at(model.theta_d), strict=True):
        assert_array_equal(got, want)
    assert_array_equal(model.spike, curves.spike_at(model.theta_d))
    assert model.n_parameters == curves.n_parameters == 3 * 2 * 6 * 3 + 3 * 6
    assert curves.lobe(0).n_parameters == 3 * 6 * 3


def test_lobes_and_spike_of_curves_add_up_to_the_model(rng):
    model = random_curves(rng).model()
    wi, wo = upper(rng, 50), upper(rng, 50)
    lobes = [model.lobe(k) for k in range(2)]
    assert [lobe.curves.kappa.shape for lobe in lobes] == [(3, 1, 6)] * 2
    assert_array_equal(lobes[1].curves.model().kappa, lobes[1].kappa)
    spike = model.eval(wi, wo) - model.replace(spike=None).eval(wi, wo)
    assert_allclose(sum(lobe.eval(wi, wo) for lobe in lobes) + spike, model.eval(wi, wo), rtol=1e-12)


def test_other_parameters_leave_no_stale_curves(rng):
    model = random_curves(rng).model()
    assert model.replace(name="x").curves is model.curves
    for name in ("theta_d", "kappa", "gamma", "beta", "spike"):
        assert model.replace(**{name: getattr(model, name)}).curves is None


def test_raw_curves_are_clipped_to_their_range():
    basis = CurveBasis()
    low, high = np.full((1, 1, 6), -3.0), np.full((1, 1, 6), 1e9)
    kappa, gamma, beta = Curves(basis, low, low, low, logarithmic=False).at([0.3])
    assert 0.0 < kappa[0, 0, 0] < 1e-15
    assert gamma[0, 0, 0] == 0.0
    assert beta[0, 0, 0] == -1.0
    model = Curves(basis, high, high, high, logarithmic=False, spike=low[0]).model()
    assert np.isfinite(np.expm1(model.kappa)).all()
    assert not model.spike.any()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"gamma": np.zeros((3, 2, 5))}, "'curves.gamma' must have shape (channel, lobe, coefficient)"),
        ({"kappa": np.zeros(6)}, "'curves.kappa' must have shape (channel, lobe, coefficient)"),
        ({"beta": np.full((3, 2, 6), np.nan)}, "'curves.beta' must be finite, got nan at index (0, 0, 0)."),
        ({"spike": np.zeros(6)}, "'curves.spike' must have shape (channel, coefficient) (3, 6), got (6,)."),
    ],
)
def test_coefficients_of_wrong_shape_are_refused(rng, change, text):
    curves = random_curves(rng)
    parts = {name: getattr(curves, name) for name in COEFFICIENTS} | change
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        Curves(curves.basis, **parts)
