"""How certain a fit is: the posterior, its derivatives, and how often its bands hold the truth."""

import numpy as np
import pytest
from fits import known, pairs
from models import random_model

from dsbrdf import Samples, fit, half_diff
from dsbrdf.fitting import uncertainty
from dsbrdf.fitting.estimator import lobes_of, unknowns_of
from dsbrdf.space import Gaussian

SIZES = (5, 4, 3, 1, 2)
ANGLES = np.deg2rad([10.0, 30.0, 50.0, 65.0])


@pytest.fixture(scope="module")
def noisy():
    """Fits of 20 lots of 1,500 samples with noise of 2 %."""
    fits = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        wi, wo = pairs(rng, 1500)
        values = known().eval(wi, wo) * np.exp(0.02 * rng.normal(size=(1500, 3)))
        fits.append(fit(Samples(wi, wo, values), 2, max_iterations=400))
    return fits


def test_derivatives_of_values(rng):
    lobes = random_model(2, n_lobes=2).lobes
    lobes = lobes.take(np.argsort(lobes.gamma.mean(1)))
    n = 7
    log_cos, x, azimuth = -rng.exponential(0.2, n), rng.random(n), rng.uniform(-1.0, 1.0, (n, 2))
    unknowns = unknowns_of(lobes)
    value, jacobian = uncertainty.value_jacobian(lobes, log_cos, x, azimuth)
    for i, step in enumerate(1e-6 * np.eye(len(unknowns))):
        up, down = (
            uncertainty.value_jacobian(lobes_of(unknowns + move, SIZES, 2, 3), log_cos, x, azimuth)[0]
            for move in (step, -step)
        )
        np.testing.assert_allclose(jacobian[..., i], (up - down) / 2e-6, rtol=1e-5, atol=1e-6 * value.max())


def test_values_are_those_of_the_model(rng):
    model = random_model(2)
    wi, wo = pairs(rng, 40)
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
    value, _ = uncertainty.value_jacobian(
        model.lobes, half_diff.log_cos(theta_h), np.cos(theta_d), azimuth[:, None]
    )
    np.testing.assert_allclose(value[:, 0], model.eval(wi, wo), rtol=1e-9)


def test_bands_of_values_hold_the_truth(noisy, rng):
    wi, wo = pairs(rng, 300)
    truth = known().eval(wi, wo)
    held = []
    for found in noisy:
        low, high = found.band(wi, wo)
        assert (low < high).all()
        held.append((low < truth) & (truth < high))
    assert 0.90 <= np.mean(held) <= 0.99


def test_loud_noise_draws_neither_up_nor_down():
    """20 %, a fifth of all positions: means of the logarithm stay, and bands hold the truth."""
    off, held = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        wi, wo = pairs(rng, 1000)
        values = known().eval(wi, wo) * (1.0 + 0.2 * rng.normal(size=(1000, 3)))
        found = fit(Samples(wi, wo, values, weights=np.ones(1000)), 2)
        at = pairs(rng, 300)
        truth, (low, high) = known().eval(*at), found.band(*at)
        off.append(np.log(found.model.eval(*at) / truth))
        held.append((low < truth) & (truth < high))
    assert abs(np.mean(off)) < 0.006
    assert 0.93 <= np.mean(held) <= 0.98


def test_standard_errors_of_curves_hold_the_truth(noisy):
    truth = known().lobes.at(ANGLES)
    held = []
    for found in noisy:
        errors, at = found.standard_errors(ANGLES), found.model.lobes.at(ANGLES)
        held.append(np.abs(np.log(at.kappa / truth.kappa)).ravel() < 1.96 * errors.ln_kappa.ravel())
        held.append(np.abs(np.log(at.gamma / truth.gamma)).ravel() < 1.96 * errors.ln_gamma.ravel())
    assert 0.88 <= np.mean(np.concatenate(held)) <= 0.99


def test_standard_errors_at_default_angles(noisy):
    errors = noisy[0].standard_errors()
    np.testing.assert_allclose(np.rad2deg(errors.theta_d), [0.0, 15.0, 30.0, 45.0, 60.0, 75.0])
    assert errors.ln_kappa.shape == (6, 3, 2)
    assert errors.ln_gamma.shape == errors.beta.shape == errors.falloff.shape == (6, 2)
    with pytest.raises(ValueError, match=r"'theta_d' must lie in \[0, pi/2\] radians, got 30"):
        noisy[0].standard_errors([30.0])


def test_twice_the_noise_is_twice_the_error():
    rng = np.random.default_rng(3)
    wi, wo = pairs(rng, 1500)
    truth, noise = known().eval(wi, wo), rng.normal(size=(1500, 3))
    small, large = (
        fit(Samples(wi, wo, truth * np.exp(size * noise)), 2, max_iterations=400) for size in (0.02, 0.04)
    )
    ratio = large.std(wi[:200], wo[:200]) / small.std(wi[:200], wo[:200])
    assert np.median(ratio) == pytest.approx(2.0, rel=0.1)


def test_deviations_of_values_and_bands_agree(noisy, rng):
    wi, wo = pairs(rng, 30)
    found = noisy[0]
    deviation = found.posterior.deviation(wi, wo)
    value = found.model.eval(wi, wo)
    np.testing.assert_allclose(found.std(wi, wo), value * deviation)
    low, high = found.band(wi, wo, level=0.6826894921)
    np.testing.assert_allclose(high, value * np.exp(deviation), rtol=1e-8)
    np.testing.assert_allclose(low, value / np.exp(deviation), rtol=1e-8)
    assert found.std(wi[0], wo[:5]).shape == (5, 3)
    for level in (0.0, 1.0, 95):
        with pytest.raises(ValueError, match=rf"'level' must be between 0 and 1, got {level}"):
            found.band(wi, wo, level)


def test_what_data_do_not_decide_keeps_the_spread_of_the_prior(rng):
    """One sample, and a prior of one deviation: most of the unknowns are as uncertain as before."""
    lobes = known().lobes
    mean = unknowns_of(lobes)
    prior = Gaussian((6, 4, 3, 1, 2), 2, mean, np.eye(len(mean)) / 0.3**2, ("r", "g", "b"))
    wi, wo = pairs(rng, 1)
    posterior = fit(Samples(wi, wo, known().eval(wi, wo)), prior=prior).posterior
    spread = np.sqrt(np.diag(posterior.covariance))
    assert (spread <= 0.3 * (1.0 + 1e-5)).all()
    assert (spread > 0.29).sum() > 20
    assert 0.0 < posterior.n_decided < 4.0


def test_lobes_of_a_prior_keep_their_spread_in_any_order(rng):
    lobes = known().lobes
    wi, wo = pairs(rng, 5)
    samples = Samples(wi, wo, known().eval(wi, wo) * np.exp(0.1 * rng.normal(size=(5, 3))))
    spreads = []
    for given, flat in ((lobes, 0), (lobes.take([1, 0]), 1)):
        mean = unknowns_of(given)
        deviation = np.full((2, 14), 0.3)
        deviation[flat] = 0.05
        precision = np.concatenate([deviation.ravel(), np.full(len(mean) - 28, 0.3)]) ** -2.0
        prior = Gaussian((6, 4, 3, 1, 2), 2, mean, np.diag(precision), ("r", "g", "b"))
        spreads.append(fit(samples, prior=prior).posterior.deviation(wi, wo))
    np.testing.assert_allclose(*spreads, rtol=1e-3)


def test_data_decide_what_they_cover(noisy):
    n = len(unknowns_of(noisy[0].model.lobes))
    assert n == 40
    # What is common to the colours of a lobe is part of its scale
    assert all(30.0 < found.posterior.n_decided <= 36.0 for found in noisy)


def test_too_many_unknowns_are_refused(noisy, monkeypatch):
    monkeypatch.setattr(uncertainty, "MAX_UNKNOWNS", 39)
    with pytest.raises(
        ValueError, match=r"^40 unknowns are too many for their covariance, 39 at most\. Fit fewer"
    ):
        uncertainty.posterior(noisy[0].estimate)
