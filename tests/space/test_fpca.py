"""Functional PCA: against an independent route and against scikit-fda, orthonormality, signs, errors."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.interpolate import BSpline

from dsbrdf.space.fpca import fit_fpca

REFERENCE = Path(__file__).parents[1] / "reference" / "fpca.json"
N, N_NUMBERS = 30, 12


def observations(n=N):
    rng = np.random.default_rng(33)
    return 1.0 + rng.normal(size=(n, N_NUMBERS)) * np.arange(1, N_NUMBERS + 1)


def metric():
    rng = np.random.default_rng(34)
    root = rng.normal(size=(N_NUMBERS, N_NUMBERS))
    return root @ root.T + np.eye(N_NUMBERS)


def test_principal_functions_are_orthonormal():
    fpca = fit_fpca(observations(), metric())
    gram = fpca.inner(fpca.functions[:, None], fpca.functions[None])
    np.testing.assert_allclose(gram, np.eye(len(fpca.variances)), atol=1e-12)


def test_variances_are_those_of_a_generalised_eigenproblem():
    rows, m = observations(), metric()
    covariance = np.cov(rows.T)
    variances = scipy.linalg.eigh(m @ covariance @ m, m, eigvals_only=True)[::-1]
    np.testing.assert_allclose(fit_fpca(rows, m).variances, variances, rtol=1e-8)


def test_variances_are_those_of_scikit_fda():
    """Numbers of another library, of two splines each weighted by Eq. (7); `reference/fpca.py` makes them."""
    reference = json.loads(REFERENCE.read_text())
    curves = np.array(reference["curves"])
    end = np.pi / 2
    knots = np.r_[[0.0] * 2, np.linspace(0.0, end, 5), [end] * 2]
    t = (np.arange(20_000) + 0.5) / 20_000 * end
    design = BSpline.design_matrix(t, knots, 2).toarray()
    gram = design.T @ design * (end / len(t))
    mean = curves.mean(0)
    weights = 1.0 / np.einsum("fc,cd,fd->f", mean, gram, mean)
    fpca = fit_fpca(curves.reshape(len(curves), -1), np.kron(np.diag(weights), gram))
    np.testing.assert_allclose(fpca.variances, reference["variances"], rtol=1e-6)
    np.testing.assert_allclose(np.abs(fpca.scores), np.abs(reference["scores"]), rtol=1e-5, atol=1e-6)


def test_scores_give_the_rows_back():
    rows = observations()
    fpca = fit_fpca(rows, metric())
    np.testing.assert_allclose(fpca.transform(rows), fpca.scores, atol=1e-9)
    np.testing.assert_allclose(fpca.inverse_transform(fpca.scores), rows, rtol=1e-9, atol=1e-9)


def test_scores_are_uncorrelated_and_ordered():
    fpca = fit_fpca(observations(), metric())
    covariance = np.cov(fpca.scores.T)
    np.testing.assert_allclose(covariance, np.diag(fpca.variances), atol=1e-10 * fpca.variances[0])
    assert (np.diff(fpca.variances) <= 0.0).all()
    assert fpca.explained.sum() == pytest.approx(1.0)


def test_first_components_are_the_best_approximation_of_their_number():
    rows = observations()
    fpca = fit_fpca(rows, metric())
    left = rows - fpca.inverse_transform(fpca.scores[:, :3])
    assert fpca.inner(left, left).sum() == pytest.approx(fpca.variances[3:].sum() * (N - 1))


def test_sign_is_that_of_the_reference():
    rows = observations()
    rng = np.random.default_rng(2)
    for reference in (np.ones(N_NUMBERS), rng.normal(size=N_NUMBERS)):
        for data in (rows, 2.0 * rows.mean(0) - rows):
            fpca = fit_fpca(data, metric(), reference)
            assert (fpca.inner(fpca.functions, reference) >= 0.0).all()
            np.testing.assert_allclose(fpca.transform(data), fpca.scores, atol=1e-6)


def test_number_of_components():
    fpca = fit_fpca(observations(), metric())
    reached = np.cumsum(fpca.explained)
    for share in (0.5, 0.9, 0.99):
        n = fpca.n_components(share)
        assert reached[n - 1] >= share
        assert n == 1 or reached[n - 2] < share
    assert fpca.n_components(1.0) == len(fpca.variances)
    with pytest.raises(ValueError, match="'share' must be above 0 and at most 1, got"):
        fpca.n_components(1.5)


def test_rounding_is_no_component():
    rows = np.repeat(observations(1), 4, axis=0)
    rows[0, 0] += 1.0
    assert len(fit_fpca(rows, metric()).variances) == 1


@pytest.mark.parametrize(
    ("rows", "given", "message"),
    [
        (np.ones((3, 2)), np.eye(3), r"got \(3, 2\) and \(3, 3\)"),
        (np.ones(3), np.eye(3), r"'rows' must have shape \(observation, number\) and 'metric'"),
        (np.ones((1, 2)), np.eye(2), "two observations at least, got 1"),
        (np.ones((3, 2)), np.eye(2), "all observations are alike"),
        (np.full((3, 2), np.nan), np.eye(2), "'rows' must be finite"),
        (observations(), np.diag([1.0] * 11 + [-1.0]), "'metric' must be symmetric and positive definite"),
    ],
)
def test_errors(rows, given, message):
    with pytest.raises(ValueError, match=message):
        fit_fpca(rows, given)


def test_more_scores_than_components():
    fpca = fit_fpca(observations(4), metric())
    with pytest.raises(ValueError, match="'scores' has 9 components, the analysis has 3"):
        fpca.inverse_transform(np.zeros(9))
