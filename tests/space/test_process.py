"""The Gaussian process of a space: against dense formulas, and what it says of materials it does not know."""

import warnings

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf import library
from dsbrdf.measured import Samples
from dsbrdf.space import build_space, builtin, process
from dsbrdf.space.process import Positions, scaled, unscaled

KNOWN = ("delrin", "nickel", "red-fabric", "blue-metallic-paint", "specular-violet-phenolic", "white-marble")


def pairs(n, seed, limit=80.0):
    """Pairs of directions (n, 3), even over both hemispheres up to `limit` degrees from the normal."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(np.cos(np.deg2rad(limit)), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


def noisy(reflectance, n, seed, noise=0.02):
    wi, wo = pairs(n, seed)
    values = reflectance(wi, wo)
    values = values * (1.0 + noise * np.random.default_rng([seed, 1]).standard_normal(values.shape))
    return Samples(wi, wo, values, name="few")


@pytest.fixture(scope="module")
def models():
    return [smooth_model(i, n_lobes=2 + i % 2) for i in range(9)]


@pytest.fixture(scope="module")
def small(models):
    return build_space(models).process


def test_values_are_those_of_the_models(small, models):
    wi, wo = pairs(700, 0)
    values = small.values(Positions.of_directions(wi, wo))
    for model, value in zip(models, values, strict=True):
        np.testing.assert_allclose(value, model.eval(wi, wo), rtol=1e-6)


def test_the_scale_and_back():
    values = np.array([0.0, 1e-6, 1e-3, 1.0, 1e4])
    np.testing.assert_allclose(unscaled(scaled(values)), values, rtol=1e-12)


def dense(small, at, values, weights, scale, noise, tested):
    """Mean, deviation and logarithm of the evidence by the formulas of a Gaussian process."""
    mean, added = small.at(at)
    valid = weights > 0.0
    rows, target = added[:, valid], (scaled(values) - mean)[valid]
    relative = (weights[valid] / weights[valid].mean()) ** -0.5
    covariance = scale**2 * rows.T @ rows + noise**2 * np.diag(relative**2)
    inverse = np.linalg.inv(covariance)
    new_mean, new = small.at(tested)
    flat = new.reshape(len(new), -1)
    cross = scale**2 * flat.T @ rows
    expected = new_mean.ravel() + cross @ inverse @ target
    variance = scale**2 * (flat**2).sum(0) - np.einsum("ij,jk,ik->i", cross, inverse, cross) + noise**2
    evidence = -0.5 * (target @ inverse @ target + np.linalg.slogdet(covariance)[1])
    return expected.reshape(new_mean.shape), np.sqrt(variance).reshape(new_mean.shape), evidence


@pytest.mark.parametrize("n", [2, 12])
def test_expectation_is_that_of_the_dense_formulas(small, n):
    samples = noisy(smooth_model(50).eval, n, 3, 0.1)
    at = Positions.of_directions(samples.wi, samples.wo)
    weights = np.random.default_rng(0).uniform(0.2, 1.0, samples.values.shape)
    weights[0, 1] = 0.0
    found = small.given(at, samples.values, weights)
    tested = Positions.of_directions(*pairs(40, 9))
    mean, deviation, _ = dense(small, at, samples.values, weights, found.scale, found.noise, tested)
    np.testing.assert_allclose(found.mean(small.at(tested)), mean, atol=1e-8)
    np.testing.assert_allclose(found.deviation(small.at(tested)), deviation, rtol=1e-8)
    added = small.at(tested)[1].reshape(small.n_materials, -1)
    np.testing.assert_allclose(
        np.einsum("mi,mk,ki->i", added, found.covariance, added) + found.noise**2,
        deviation.ravel() ** 2,
        rtol=1e-8,
    )

    def evidence(scale, noise):
        at_scale = dense(small, at, samples.values, weights, scale, noise, tested)[2]
        return (
            at_scale
            - 0.5 * (np.log(scale) / process.SPREAD_OF_SCALE) ** 2
            - 0.5 * (np.log(noise / process.NOISE) / process.SPREAD_OF_NOISE) ** 2
        )

    best = max((evidence(s, e), s, e) for s in process.SCALES for e in process.NOISES)
    assert (found.scale, found.noise) == best[1:]


def test_nothing_measured(small):
    at = small.at(Positions.of_directions(*pairs(30, 2)))
    nothing = small.unmeasured
    np.testing.assert_array_equal(nothing.mean(at), at[0])
    spread = np.sqrt((at[1] ** 2).sum(0) + process.NOISE**2)
    np.testing.assert_allclose(nothing.deviation(at), spread)
    assert nothing.n_decided == 0.0


def test_support_is_above_the_horizon_and_reaches_the_peak():
    positions, weights = process.support()
    assert weights.sum() == pytest.approx(1.0)
    assert len(weights) > 150
    assert positions.log_cos.max() > np.log(np.cos(np.deg2rad(0.2)))


@pytest.fixture(scope="module")
def fits():
    """Fits of 20 samples of materials that the library is without, with it and not."""
    found = []
    for i, name in enumerate(KNOWN):
        model = library.load(name)
        samples = noisy(model.eval, 20, i)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
            fits = dsbrdf.fit(samples, prior=builtin(without=[name])), dsbrdf.fit(samples)
        found.append((model, *fits))
    return found


def log_error(model, truth):
    wi, wo = pairs(1000, 77)
    return float(np.sqrt((np.log((model.eval(wi, wo) + 1e-3) / (truth.eval(wi, wo) + 1e-3)) ** 2).mean()))


def test_few_samples_of_materials_of_the_library(fits):
    """`benchmarks/prior.py` has all 100, and real tables."""
    prior = np.array([log_error(fit.model, truth) for truth, fit, _ in fits])
    plain = np.array([log_error(fit.model, truth) for truth, _, fit in fits])
    assert np.median(plain / prior) > 2.0
    assert prior.max() < 0.35
    assert (prior < 1.05 * plain).all()


def test_bands_hold_values(fits):
    wi, wo = pairs(1000, 78)
    covered = []
    for truth, fit, _ in fits:
        low, high = fit.band(wi, wo)
        values = truth.eval(wi, wo)
        covered.append(((low <= values) & (values <= high)).mean())
    assert 0.90 < np.mean(covered) < 0.99
    assert min(covered) > 0.75


def test_the_data_decide_some_numbers(fits):
    for _, fit, _ in fits:
        assert 5.0 < fit.n_decided < 60.0
        assert fit.summary()["n_decided"] == fit.n_decided
        assert np.isfinite(fit.standard_errors().ln_kappa).all()


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_of_another_kind_it_widens():
    """Light that rises away from the highlight, as no material has it."""

    def strange(wi, wo):
        theta_h = dsbrdf.half_diff.from_directions(wi, wo)[0]
        return np.repeat((0.02 + 5.0 * np.sin(3.0 * theta_h) ** 8)[:, None], 3, axis=1)

    with pytest.warns(dsbrdf.fitting.PriorWarning, match="no material of the prior is like it"):
        found = dsbrdf.fit(noisy(strange, 40, 0), prior="library")
    assert found.estimate.prior.noise > 0.25
    wi, wo = pairs(500, 5)
    usual = dsbrdf.fit(noisy(library.load("delrin").eval, 40, 0), prior="library")
    assert np.median(found.posterior.deviation(wi, wo)) > 3.0 * np.median(usual.posterior.deviation(wi, wo))


def test_many_values_count_as_some():
    """What materials do not describe is alike at pairs near each other: the same values again decide nothing more."""
    whole = builtin(without=["nickel"]).process
    wi, wo = pairs(process.WORTH // 3, 5)
    values, at = library.load("nickel").eval(wi, wo), Positions.of_directions(wi, wo)
    once = whole.given(at, values, np.ones_like(values))
    again = Positions(*(np.tile(part, 4) for part in at))
    four = whole.given(again, np.tile(values, (4, 1)), np.ones((4 * len(values), 3)))
    assert four.n_decided == pytest.approx(once.n_decided, rel=1e-6)
    np.testing.assert_allclose(four.coefficients, once.coefficients, rtol=1e-4, atol=1e-6)
