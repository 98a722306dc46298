"""A space as a prior: the Gaussian's layout, what it knows and does not, and fits of few samples with it."""

import numpy as np
import pytest
from spaces import smooth_model

from dsbrdf import half_diff
from dsbrdf.fitting.fit import fit
from dsbrdf.measured.samples import Samples
from dsbrdf.space import Sizes, build_space


@pytest.fixture(scope="module")
def models():
    return [smooth_model(i) for i in range(30)]


@pytest.fixture(scope="module")
def space(models):
    return build_space(models[1:])


def directions(n, seed):
    """Pairs of unit vectors (n, 3) above the horizon."""
    w = np.random.default_rng(seed).normal(size=(2, n, 3))
    w[..., 2] = np.abs(w[..., 2]) + 0.1
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def few_samples(model, n, noise=0.02, seed=1):
    wi, wo = directions(n, seed)
    values = model.eval(wi, wo)
    values *= 1.0 + noise * np.random.default_rng([seed, 1]).standard_normal(values.shape)
    return Samples(wi, wo, values, name="few")


def log_rms(a, b):
    wi, wo = directions(4000, 99)
    return float(np.sqrt((np.log((a.eval(wi, wo) + 1e-4) / (b.eval(wi, wo) + 1e-4)) ** 2).mean()))


@pytest.mark.parametrize("n_channels", [1, 3])
def test_layout(n_channels):
    models = [smooth_model(i, n_channels=n_channels) for i in range(6)]
    gaussian = build_space(models).gaussian()
    n = 3 * sum(Sizes()[:4]) + (3 * n_channels * Sizes().colour if n_channels > 1 else 0)
    assert (gaussian.sizes, gaussian.n_lobes, gaussian.channels) == (Sizes(), 3, models[0].channels)
    assert gaussian.mean.shape == (n,)
    assert gaussian.precision.shape == (n, n)
    np.testing.assert_array_equal(gaussian.precision, gaussian.precision.T)
    assert np.linalg.eigvalsh(gaussian.precision).min() > 0.0


def test_mean_and_variances_are_those_of_the_materials(space):
    """A little wider: the mean of a few materials is not known exactly."""
    unknowns = space.variables.unknowns(space.curves)
    gaussian = space.gaussian()
    np.testing.assert_allclose(gaussian.mean, unknowns.mean(0))
    variances = np.diag(np.linalg.inv(gaussian.precision))
    expected = (1.0 + 1.0 / 29) * (unknowns.var(0, ddof=1) + 0.03**2)
    np.testing.assert_allclose(variances, expected, rtol=0.05)


def test_what_no_material_did_is_unlikely_but_not_forbidden(space):
    """Along directions in which the materials do not vary at all there is some room."""
    unknowns = space.variables.unknowns(space.curves)
    standard = (unknowns - unknowns.mean(0)) / unknowns.std(0)
    unseen = np.linalg.svd(standard)[2][-1] * unknowns.std(0)
    seen = np.linalg.svd(standard)[2][0] * unknowns.std(0)
    covariance = np.linalg.inv(space.gaussian().precision)
    distance = [direction @ space.gaussian().precision @ direction for direction in (seen, unseen)]
    assert np.isfinite(covariance).all()
    assert distance[0] < distance[1] < 1.0 / 0.02


def test_missing_lobes_are_sensible_numbers():
    models = [smooth_model(i, n_lobes=2 + i % 2) for i in range(8)]
    gaussian = build_space(models).gaussian()
    assert gaussian.n_lobes == 3
    scale = gaussian.mean[2 * 14 : 2 * 14 + 6]
    assert ((scale > -12.0) & (scale < 2.0)).all()


@pytest.mark.filterwarnings("ignore::dsbrdf.fitting.fit.ConvergenceWarning")
def test_few_samples_are_better_with_a_prior(space, models):
    with_prior, without = [], []
    for seed in range(4):
        samples = few_samples(models[0], 20, seed=seed)
        with_prior.append(log_rms(fit(samples, prior=space).model, models[0]))
        without.append(log_rms(fit(samples).model, models[0]))
    assert np.median(with_prior) < 0.8 * np.median(without)
    assert np.median(with_prior) < 0.2


def test_many_samples_decide(space, models):
    found = fit(few_samples(models[0], 3000, noise=0.01), prior=space).model
    assert log_rms(found, models[0]) < 0.02


def test_a_fit_of_a_table(space, models):
    """A table of which only two rows of theta_d are known."""
    import dataclasses

    import dsbrdf

    table = dsbrdf.tabulate(models[0].eval, "partial", shape=(30, 18, 36))
    planes = table.planes.copy()
    planes[:, :, [i for i in range(18) if i not in (3, 9)]] = -1.0
    found = fit(dataclasses.replace(table, planes=planes), prior=space)
    assert log_rms(found.model, models[0]) < 0.15


def test_the_same_every_time(space, models):
    samples = few_samples(models[0], 20)
    first, second = (fit(samples, prior=space).model.lobes for _ in range(2))
    np.testing.assert_array_equal(first.scale, second.scale)


def test_data_of_other_channels(space):
    theta = np.deg2rad([5.0, 20.0, 40.0])
    samples = Samples(*half_diff.to_directions(theta, theta, theta), np.ones((3, 2)), name="two")
    with pytest.raises(ValueError, match="a measurement of 2 channels does not go with this prior"):
        fit(samples, prior=space)


@pytest.mark.filterwarnings("ignore::dsbrdf.fitting.fit.ConvergenceWarning")
def test_the_built_in_library_by_name():
    import dsbrdf

    samples = few_samples(dsbrdf.library.load("nickel"), 20)
    by_name, by_space = fit(samples, prior="library").model, fit(samples, prior=dsbrdf.space.builtin()).model
    np.testing.assert_array_equal(by_name.lobes.scale, by_space.lobes.scale)
    with pytest.raises(ValueError, match="'prior' must be 'library', a space or a Gaussian, got 'merl'"):
        fit(samples, prior="merl")
