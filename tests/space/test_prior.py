"""Maximum a posteriori fits: derivatives, limits of much and of no data, the noise level, errors."""

import dataclasses

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf import half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.space import build_space
from dsbrdf.space.prior import _Data, fit_scores


@pytest.fixture(scope="module")
def space():
    return build_space([smooth_model(i) for i in range(25)])


@pytest.fixture(scope="module")
def truth(space):
    """A material within the space that is none of its own."""
    rng = np.random.default_rng(77)
    return space.model(rng.standard_normal(4) * np.sqrt(space.fpca.variances[:4]), "truth")


def angles(n, seed=3):
    """Angles of directions above the horizon."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(2, n, 3))
    w[..., 2] = np.abs(w[..., 2])
    return half_diff.from_directions(*(w / np.linalg.norm(w, axis=-1, keepdims=True)))


def noisy(model, n, noise, seed=3):
    at = angles(n, seed)
    rng = np.random.default_rng([seed, 1])
    values = model.eval_angles(*at)
    return (*at, values * (1.0 + noise * rng.standard_normal(values.shape)))


def log_rms(a, b, n=2000):
    at = angles(n, 9)
    return np.sqrt(
        (np.log((a.eval_angles(*at) + LOG_OFFSET) / (b.eval_angles(*at) + LOG_OFFSET)) ** 2).mean()
    )


@pytest.mark.parametrize("logarithmic", [True, False])
@pytest.mark.parametrize("azimuthal", [True, False])
def test_derivatives(logarithmic, azimuthal):
    models = [smooth_model(i, 2 + i % 2, beta=True) for i in range(8)]
    space = build_space(models, logarithmic=logarithmic, azimuthal=azimuthal)
    data = _Data.of(space, *noisy(models[0], 30, 0.1), None)
    x = 0.05 * np.random.default_rng(1).standard_normal(len(space.fpca.variances))
    residuals, jacobian = data.linearise(x)
    np.testing.assert_array_equal(residuals, data.residuals(x).ravel())
    for k in range(x.size):
        step = 1e-5 * np.eye(x.size)[k]
        numeric = (data.residuals(x + step) - data.residuals(x - step)).ravel() / 2e-5
        np.testing.assert_allclose(jacobian[:, k], numeric, rtol=1e-5, atol=1e-5)


def test_residuals_are_those_of_the_model(space, truth):
    at = angles(40)
    values = 1.7 * truth.eval_angles(*at)
    data = _Data.of(space, *at, values, None)
    x = space.scores(truth) / np.sqrt(space.fpca.variances)
    model = space.model(space.scores(truth), theta_d=np.sort(at[1]))
    expected = np.log((model.eval_angles(*at) + LOG_OFFSET) / (values + LOG_OFFSET))
    np.testing.assert_allclose(data.residuals(x), expected, atol=1e-6)


def test_much_data_decide(space, truth):
    found = fit_scores(space, *noisy(truth, 3000, 0.01))
    assert log_rms(space.model(found.scores), truth) < 0.01
    assert found.sigma == pytest.approx(0.01, abs=0.003)
    assert found.n_effective > 15.0


def test_no_information_leaves_the_mean(space):
    """Samples of the mean material, of no weight to speak of."""
    found = fit_scores(space, *noisy(space.model(np.zeros(1)), 5, 0.0), sigma=100.0)
    np.testing.assert_allclose(found.scores, 0.0, atol=0.01)
    assert found.n_effective < 0.1
    deviation = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(deviation, np.sqrt(space.fpca.variances), rtol=0.01)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.3])
def test_noise_level_is_estimated(space, truth, noise):
    theta_h, theta_d, phi_d, values = noisy(truth, 600, noise)
    # In the dark the offset of the logarithm drowns the noise
    values[values < 0.02] = np.nan
    found = fit_scores(space, theta_h, theta_d, phi_d, values)
    assert found.sigma == pytest.approx(noise, rel=0.25)


def test_more_noise_means_more_prior(space, truth):
    decided = [fit_scores(space, *noisy(truth, 60, noise)).n_effective for noise in (0.01, 0.1, 0.5)]
    assert decided[0] > decided[1] > decided[2]


def test_few_samples_are_better_with_a_prior(space, truth):
    with_prior, without = [], []
    for seed in range(4):
        theta_h, theta_d, phi_d, values = noisy(truth, 20, 0.02, seed)
        samples = Samples("few", *half_diff.to_directions(theta_h, theta_d, phi_d), values)
        with_prior.append(log_rms(dsbrdf.fit(samples, prior=space).model, truth))
        without.append(log_rms(dsbrdf.fit(samples, loss="log").model, truth))
    assert np.median(with_prior) < 0.5 * np.median(without)


def test_uncertainty_covers_the_truth(space, truth):
    found = fit_scores(space, *noisy(truth, 100, 0.05))
    deviation = np.sqrt(np.diag(found.covariance))
    off = np.abs(found.scores - space.scores(truth)) / deviation
    assert np.quantile(off, 0.8) < 2.5
    assert (deviation < 1.001 * np.sqrt(space.fpca.variances)).all()


def test_invalid_samples_do_not_count(space, truth):
    theta_h, theta_d, phi_d, values = noisy(truth, 50, 0.02)
    few = fit_scores(space, theta_h[:40], theta_d[:40], phi_d[:40], values[:40])
    values[40:] = np.nan
    same = fit_scores(space, theta_h, theta_d, phi_d, values)
    np.testing.assert_allclose(same.scores, few.scores, rtol=1e-9, atol=1e-12)


def test_samples_without_weight_do_not_count(space, truth):
    theta_h, theta_d, phi_d, values = noisy(truth, 50, 0.02)
    weights = np.where(np.arange(50) < 40, 1.0 / values.mean(1) ** 2, 0.0)
    few = fit_scores(space, theta_h[:40], theta_d[:40], phi_d[:40], values[:40], weights=weights[:40])
    values[40:] *= 100.0
    same = fit_scores(space, theta_h, theta_d, phi_d, values, weights=weights)
    np.testing.assert_allclose(same.scores, few.scores, rtol=1e-3, atol=1e-4)


def test_a_fit_of_samples(space, truth):
    theta_h, theta_d, phi_d, values = noisy(truth, 200, 0.02)
    values[0] = np.nan
    samples = Samples("few", *half_diff.to_directions(theta_h, theta_d, phi_d), values)
    fit = dsbrdf.fit(samples, prior=space)
    assert fit.model.name == "few"
    assert fit.options["prior"]["materials"] == 25
    assert fit.coverage.left_out["invalid"] == 1
    assert fit.coverage.n_used == fit.coverage.per_slice.sum() <= 199
    assert fit.log_rms < 0.05
    assert fit.summary()["samples"] == 200
    assert fit.model.albedo(np.deg2rad([0.0, 45.0, 80.0])).max() <= 1.001


def test_a_fit_of_a_table(space, truth):
    """A table of which only two rows of theta_d are known."""
    table = dsbrdf.tabulate(truth.eval, "partial", shape=(30, 18, 36))
    planes = table.planes.copy()
    planes[:, :, [i for i in range(18) if i not in (3, 9)]] = -1.0
    fit = dsbrdf.fit(dataclasses.replace(table, planes=planes), prior=space)
    assert log_rms(fit.model, truth) < 0.15
    assert fit.errors.rel_rms < 0.1
    assert np.isfinite(fit.log_rms)


def test_a_space_without_such_a_material():
    """One warning where the space is too poor; none for a material as those in it."""
    poor = build_space([smooth_model(i) for i in range(6)])
    theta_h, theta_d, phi_d, values = noisy(smooth_model(3), 200, 0.02)
    wi, wo = half_diff.to_directions(theta_h, theta_d, phi_d)
    dsbrdf.fit(Samples("known", wi, wo, values), prior=poor)
    colours = np.random.default_rng(2).uniform(0.5, 2.0, 3)
    strange = np.outer(0.05 + 3.0 * np.sin(theta_h) ** 4, colours)
    text = (
        r"^strange: no material of the space is like it: its samples are missed by a factor of \d+\.\d "
        r"\(sigma \d\.\d\d\)\. Build the space of more materials, .* \(now 6\), or leave out 'prior'\.$"
    )
    with pytest.warns(UserWarning, match=text) as told:
        dsbrdf.fit(Samples("strange", wi, wo, strange), prior=poor)
    assert len(told) == 1


def test_the_same_every_time(space, truth):
    data = noisy(truth, 20, 0.05)
    first, second = (fit_scores(space, *data) for _ in range(2))
    np.testing.assert_array_equal(first.scores, second.scores)


def test_errors(space, truth):
    theta_h, theta_d, phi_d, values = noisy(truth, 10, 0.02)
    with pytest.raises(ValueError, match="samples of 2 channels do not go with a space of 3"):
        fit_scores(space, theta_h, theta_d, phi_d, values[:, :2])
    with pytest.raises(
        ValueError, match=r"'theta_h' \(10,\), 'theta_d' \(9,\) and 'phi_d' \(10,\) must have shape"
    ):
        fit_scores(space, theta_h, theta_d[1:], phi_d, values)
    with pytest.raises(ValueError, match="no sample is valid"):
        fit_scores(space, theta_h, theta_d, phi_d, values * np.nan)
    with pytest.raises(ValueError, match="'sigma' must be positive, got 0"):
        fit_scores(space, theta_h, theta_d, phi_d, values, sigma=0.0)
    samples = Samples("few", *half_diff.to_directions(theta_h, theta_d, phi_d), values)
    for options in ({"n_lobes": 2}, {"curves": True}):
        with pytest.raises(ValueError, match="the space decides on lobes and curves"):
            dsbrdf.fit(samples, prior=space, **options)


def test_tables_of_another_convention(small_table):
    models = [smooth_model(i, fit_options={"convention": "edge"}) for i in range(3)]
    with pytest.raises(
        ValueError, match=r"small: read with the 'centre' convention .* where the space has 'edge'"
    ):
        dsbrdf.fit(small_table, prior=build_space(models))
