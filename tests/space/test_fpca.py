"""Functional PCA: against an independent route and against scikit-fda, orthonormality, signs, errors."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from dsbrdf.paper.curves import CurveBasis
from dsbrdf.space.fpca import fit_fpca, squared_norm

BASIS = CurveBasis()
REFERENCE = Path(__file__).parents[1] / "reference" / "fpca.json"


def observations(n=30, n_functions=4):
    rng = np.random.default_rng(33)
    scale = 10.0 ** np.arange(n_functions)[:, None]
    return scale * (1.0 + rng.normal(size=(n, n_functions, BASIS.size)) * np.arange(1, BASIS.size + 1))


def gram_of(fpca):
    return fpca.inner(fpca.functions[:, None], fpca.functions[None])


def test_principal_functions_are_orthonormal():
    fpca = fit_fpca(observations(), BASIS)
    np.testing.assert_allclose(gram_of(fpca), np.eye(len(fpca.variances)), atol=1e-12)


def test_inner_product_is_that_of_equation_7():
    curves = observations(n_functions=2)
    fpca = fit_fpca(curves, BASIS)
    t, dt = np.linspace(0.0, np.pi / 2, 200_001, retstep=True)
    x, y = (curves[i] @ BASIS.design(t).T for i in (0, 1))
    mean = curves.mean(0) @ BASIS.design(t).T
    expected = sum(np.trapezoid(x[f] * y[f], dx=dt) / np.trapezoid(mean[f] ** 2, dx=dt) for f in (0, 1))
    assert fpca.inner(curves[0], curves[1]) == pytest.approx(expected, rel=1e-8)


def test_variances_are_those_of_a_generalised_eigenproblem_on_a_dense_grid():
    curves = observations()
    fpca = fit_fpca(curves, BASIS)
    t, dt = np.linspace(0.0, np.pi / 2, 100_001, retstep=True)
    values = BASIS.design(t)
    weights = np.full(t.size, dt)
    weights[[0, -1]] /= 2.0
    gram = values.T @ (weights[:, None] * values)
    mean = curves.mean(0)
    metric = scipy.linalg.block_diag(*(gram / (m @ gram @ m) for m in mean))
    centred = (curves - mean).reshape(len(curves), -1)
    covariance = centred.T @ centred / (len(curves) - 1)
    variances = scipy.linalg.eigh(metric @ covariance @ metric, metric, eigvals_only=True)[::-1]
    np.testing.assert_allclose(fpca.variances, variances[: len(fpca.variances)], rtol=1e-8)


def test_variances_are_those_of_scikit_fda():
    """Numbers of another library; `reference/fpca.py` makes them."""
    reference = json.loads(REFERENCE.read_text())
    curves = np.array(reference["curves"])
    fpca = fit_fpca(curves, BASIS)
    np.testing.assert_allclose(fpca.variances, reference["variances"], rtol=1e-8)
    np.testing.assert_allclose(np.abs(fpca.scores), np.abs(reference["scores"]), rtol=1e-6, atol=1e-8)


def test_scores_give_the_curves_back():
    curves = observations()
    fpca = fit_fpca(curves, BASIS)
    np.testing.assert_allclose(fpca.transform(curves), fpca.scores, atol=1e-9)
    np.testing.assert_allclose(fpca.inverse_transform(fpca.scores), curves, rtol=1e-9, atol=1e-9)


def test_scores_are_uncorrelated_and_ordered():
    fpca = fit_fpca(observations(), BASIS)
    covariance = np.cov(fpca.scores.T)
    np.testing.assert_allclose(covariance, np.diag(fpca.variances), atol=1e-10 * fpca.variances[0])
    assert (np.diff(fpca.variances) <= 0.0).all()
    assert fpca.explained.sum() == pytest.approx(1.0)


def test_first_components_are_the_best_approximation_of_their_number():
    curves = observations()
    fpca = fit_fpca(curves, BASIS)
    left = curves - fpca.inverse_transform(fpca.scores[:, :3])
    assert fpca.inner(left, left).sum() == pytest.approx(fpca.variances[3:].sum() * (len(curves) - 1))


def test_sign_is_that_of_the_reference():
    curves = observations()
    rng = np.random.default_rng(2)
    for reference in (np.ones(curves.shape[1:]), rng.normal(size=curves.shape[1:])):
        for data in (curves, 2.0 * curves.mean(0) - curves):
            fpca = fit_fpca(data, BASIS, weights=np.ones(4), reference=reference)
            assert (fpca.inner(fpca.functions, reference) >= 0.0).all()
            np.testing.assert_allclose(fpca.transform(data), fpca.scores, atol=1e-6)


def test_scale_of_a_function_does_not_matter_with_the_weights_of_equation_7():
    curves = observations()
    scaled = curves * np.array([1.0, 7.0, 1e-3, 2.0])[:, None]
    np.testing.assert_allclose(
        fit_fpca(curves, BASIS).variances, fit_fpca(scaled, BASIS).variances, rtol=1e-9
    )


def test_number_of_components():
    fpca = fit_fpca(observations(), BASIS)
    reached = np.cumsum(fpca.explained)
    for share in (0.5, 0.9, 0.99):
        n = fpca.n_components(share)
        assert reached[n - 1] >= share
        assert n == 1 or reached[n - 2] < share
    assert fpca.n_components(1.0) == len(fpca.variances)
    with pytest.raises(ValueError, match="'share' must be above 0 and at most 1, got"):
        fpca.n_components(1.5)


def test_squared_norm_of_a_constant():
    assert squared_norm(np.full(BASIS.size, 3.0), BASIS) == pytest.approx(9.0 * np.pi / 2)


def test_rounding_is_no_component():
    curves = np.repeat(observations(1), 4, axis=0)
    curves[0, 0] += 1.0
    assert len(fit_fpca(curves, BASIS).variances) == 1


@pytest.mark.parametrize(
    ("curves", "options", "message"),
    [
        (
            np.ones((3, 2, 5)),
            {},
            r"must have shape \(observation, function, 6 coefficients\), got \(3, 2, 5\)",
        ),
        (np.ones((1, 2, 6)), {}, "two observations at least, got 1"),
        (np.ones((3, 2, 6)), {}, "all observations are alike"),
        (np.full((3, 2, 6), np.nan), {}, "'curves' must be finite"),
        (np.array([[[1.0] * 6], [[-1.0] * 6]]), {}, r"mean of function 0 is zero, .* Pass 'weights'"),
        (observations(), {"weights": [1.0, 2.0]}, "'weights' must be 4 positive numbers"),
        (observations(), {"weights": [1.0, 2.0, 3.0, 0.0]}, "'weights' must be 4 positive numbers"),
    ],
)
def test_errors(curves, options, message):
    with pytest.raises(ValueError, match=message):
        fit_fpca(curves, BASIS, **options)


def test_more_scores_than_components():
    fpca = fit_fpca(observations(4), BASIS)
    with pytest.raises(ValueError, match="'scores' has 9 components, the analysis has 3"):
        fpca.inverse_transform(np.zeros(9))
