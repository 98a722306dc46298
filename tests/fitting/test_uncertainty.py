"""Standard errors: by brute force, by simulation, and by the bootstrap."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scans import random_scan, samples_at
from scipy import stats
from tables import EVERY_SAMPLE, formula, known, of_model, quiet_fit

from dsbrdf import DSBRDF, fit, half_diff
from dsbrdf.fitting import uncertainty
from dsbrdf.fitting.uncertainty import bootstrap, standard_errors
from dsbrdf.paper import collapse
from dsbrdf.paper.metrics import LOG_OFFSET


def noisy_table(truth, rng, noise, n_h=45, n_phi=18):
    clean = of_model(truth, len(truth.theta_d), n_h, n_phi)
    valid = clean.planes >= 0.0
    planes = np.maximum(clean.planes + noise(clean.planes) * rng.standard_normal(clean.planes.shape), 0.0)
    return dataclasses.replace(clean, planes=np.where(valid, planes, -1.0))


def relative(values):
    return 0.02 * values


def constant(_):
    return 0.01


# By brute force


def sample_model(x, theta_h, theta_d, phi_d):
    kappa, gamma, beta = np.exp(x[:, 0]), np.exp(x[:, 1]), np.sin(x[:, 2])
    return formula(theta_h, theta_d, phi_d, kappa[None], gamma[None], beta[None])[0]


def sample_jacobian(x, *angles):
    columns = []
    for unknown in range(x.size):
        at = x.astype(complex)
        at.flat[unknown] += 1e-30j
        columns.append(sample_model(at, *angles).imag / 1e-30)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("azimuthal", [False, True])
@pytest.mark.parametrize("n_lobes", [1, 2])
def test_those_of_the_samples_one_by_one(n_lobes, azimuthal, rng):
    """With the variance at each theta_h, from the samples' own Jacobian."""
    truth = known(n_lobes, azimuthal)
    measured = noisy_table(truth, rng, relative)
    fitted = fit(measured, n_lobes, azimuthal=azimuthal, **EVERY_SAMPLE)
    errors = fitted.standard_errors()
    used = slice(None) if azimuthal else slice(2)
    for i, channel in np.ndindex(5, 3):
        model = fitted.model
        x = np.stack(
            [
                np.log(model.kappa[i, channel]),
                np.log(model.gamma[i, channel]),
                np.arcsin(model.beta[i, channel]),
            ],
            -1,
        )
        f = measured.rows([i])[channel, :, 0]
        some = np.isfinite(f) & (measured.theta_h[:, None] >= np.deg2rad(1.0))
        theta_h, phi_d = np.broadcast_arrays(measured.theta_h[:, None], measured.phi_d)
        angles = (theta_h[some], measured.theta_d[i], phi_d[some])
        j = sample_jacobian(x, *angles).reshape(-1, n_lobes, 3)[..., used].reshape(some.sum(), -1)
        inverse = np.linalg.inv(j.T @ j)
        residual = f[some] - sample_model(x, *angles)
        leverage = np.einsum("sp,pq,sq->s", j, inverse, j)
        variance = np.empty_like(residual)
        for at in np.unique(angles[0]):
            of = angles[0] == at
            # Two combinations of a theta_h's samples tell of the model; the rest is noise alone
            variance[of] = (residual[of] ** 2).mean() / (1.0 - leverage[of].mean()) ** 2
        covariance = inverse @ (j.T * variance @ j) @ inverse
        expected = np.sqrt(covariance.diagonal()).reshape(n_lobes, -1)
        got = np.stack([errors.ln_kappa, errors.ln_gamma, errors.asin_beta], -1)[i, channel]
        assert_allclose(got[:, used], expected, rtol=1e-6)
        assert azimuthal or np.isnan(got[:, 2]).all()
        assert errors.freedom[i, channel] == some.sum() - j.shape[1]


def test_of_scattered_samples_it_is_hc3(rng):
    """MacKinnon and White (1985), with the squares of single samples; weights as in weighted least squares."""
    truth = known(2, False)
    n = 50
    weights = rng.uniform(0.5, 2.0, n)
    theta_h = np.sort(0.85 * rng.random(n) ** 2)
    model = DSBRDF(truth.theta_d[2:3], *(getattr(truth, k)[2:3, :1] for k in ("kappa", "gamma", "beta")))
    scan = samples_at(theta_h, truth.theta_d[2], 0.0, model.eval, 0.02, rng, weights)
    fitted = fit(scan, 2, n_slices=1, perimeter_mask=False)
    errors = fitted.standard_errors()
    at = half_diff.from_directions(scan.wi, scan.wo)
    x = np.stack([np.log(fitted.model.kappa[0, 0]), np.log(fitted.model.gamma[0, 0]), np.zeros(2)], -1)
    root = np.sqrt(weights)[:, None]
    angles = (at[0], np.pi / 4, at[2])
    j = root * sample_jacobian(x, *angles).reshape(n, 2, 3)[..., :2].reshape(n, -1)
    residual = root[:, 0] * (scan.values[:, 0] - sample_model(x, *angles))
    inverse = np.linalg.inv(j.T @ j)
    left = 1.0 - np.einsum("sp,pq,sq->s", j, inverse, j)
    covariance = inverse @ (j.T * (residual / left) ** 2 @ j) @ inverse
    got = np.stack([errors.ln_kappa, errors.ln_gamma], -1)[0, 0]
    assert_allclose(got, np.sqrt(covariance.diagonal()).reshape(2, 2), rtol=1e-6)
    assert errors.freedom[0, 0] == n - 4


def test_the_logarithmic_loss(rng):
    """The same, of residuals of the logarithm."""
    truth = known(1, False)
    theta_h = np.sort(np.pi / 2 * rng.random(40) * 0.9)
    model = DSBRDF(np.array([np.pi / 4]), *(getattr(truth, k)[2:3, :1] for k in ("kappa", "gamma", "beta")))
    scan = samples_at(theta_h, np.pi / 4, 0.0, model.eval, 0.05, rng)
    fitted = fit(scan, 1, n_slices=1, perimeter_mask=False, loss="log")
    errors = fitted.standard_errors()
    at = half_diff.from_directions(scan.wi, scan.wo)
    x = np.stack([np.log(fitted.model.kappa[0, 0]), np.log(fitted.model.gamma[0, 0]), np.zeros(1)], -1)
    angles = (at[0], np.pi / 4, at[2])
    value = sample_model(x, *angles)
    j = sample_jacobian(x, *angles)[:, :2] / (value + LOG_OFFSET)[:, None]
    residual = np.log((value + LOG_OFFSET) / (scan.values[:, 0] + LOG_OFFSET))
    inverse = np.linalg.inv(j.T @ j)
    left = 1.0 - np.einsum("sp,pq,sq->s", j, inverse, j)
    covariance = inverse @ (j.T * (residual / left) ** 2 @ j) @ inverse
    got = np.stack([errors.ln_kappa, errors.ln_gamma], -1)[0, 0, 0]
    assert_allclose(got, np.sqrt(covariance.diagonal()), rtol=1e-6)


# By simulation


def covered(truth, measure, options, repetitions, rng):
    """How often intervals that should hold the truth 95 times in 100 do, and of how many."""
    inside, told = np.zeros(3), np.zeros(3)
    for _ in range(repetitions):
        intervals = quiet_fit(measure(rng), truth.n_lobes, **options).standard_errors().intervals()
        for k, name in enumerate(("kappa", "gamma", "beta")):
            low, high = intervals[name]
            known_ = np.isfinite(low) & np.isfinite(high)
            true = getattr(truth, name)
            inside[k] += ((low <= true) & (true <= high) & known_).sum()
            told[k] += known_.sum()
    return inside, told


def check_coverage(inside, told):
    """Between 93 and 97 in 100, given the chance in so many repetitions."""
    for some, all_ in zip(inside, told, strict=True):
        if all_:
            chance = 4.0 * np.sqrt(0.95 * 0.05 / all_)
            assert 0.93 - chance < some / all_ < 0.97 + chance, (inside, told)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [relative, constant])
@pytest.mark.parametrize(("n_lobes", "azimuthal"), [(1, True), (2, False), (2, True)])
def test_intervals_of_tables_cover_the_truth(n_lobes, azimuthal, noise, rng):
    truth = known(n_lobes, azimuthal)
    options = {"azimuthal": azimuthal, "min_theta_h": 0.0, **EVERY_SAMPLE}
    check_coverage(*covered(truth, lambda rng: noisy_table(truth, rng, noise), options, 60, rng))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [relative, constant])
@pytest.mark.parametrize(("n_lobes", "n"), [(1, 30), (2, 60)])
def test_intervals_of_scattered_samples_cover_the_truth(n_lobes, n, noise, rng):
    truth = known(n_lobes, False)

    def measure(rng):
        theta_h = np.pi / 2 * rng.random((6, n)) ** 2
        scan = samples_at(theta_h, truth.theta_d[:, None], 2 * np.pi * rng.random((6, n)), truth.eval)
        moved = scan.values + noise(scan.values) * rng.standard_normal(scan.values.shape)
        return dataclasses.replace(scan, values=np.maximum(moved, 0.0))

    options = {"n_slices": 6, "perimeter_mask": False}
    check_coverage(*covered(truth, measure, options, 60, rng))


def test_the_coverage_test_can_fail(rng, monkeypatch):
    """With variances half of what they are."""
    truth = known(1, False)
    real = uncertainty._Slice._covariance
    monkeypatch.setattr(uncertainty._Slice, "_covariance", lambda *arguments: 0.5 * real(*arguments))
    options = {"azimuthal": False, "min_theta_h": 0.0, **EVERY_SAMPLE}
    counts = covered(truth, lambda rng: noisy_table(truth, rng, relative), options, 12, rng)
    with pytest.raises(AssertionError):
        check_coverage(*counts)


# By the bootstrap


def spread(draws):
    """Half the width of the middle 68 %, which outliers do not move."""
    low, high = np.quantile(draws, [0.1587, 0.8413], axis=0)
    return (high - low) / 2.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["table", "samples"])
def test_the_bootstrap_agrees(kind, rng):
    truth = known(2, kind == "table")
    if kind == "table":
        fitted = fit(noisy_table(truth, rng, relative), 2, **EVERY_SAMPLE)
    else:
        theta_h, phi_d = np.pi / 2 * rng.random((6, 80)) ** 2, 2 * np.pi * rng.random((6, 80))
        scan = samples_at(theta_h, truth.theta_d[:, None], phi_d, truth.eval, 0.02, rng)
        fitted = fit(scan, 2, n_slices=6, perimeter_mask=False)
    errors = fitted.standard_errors()
    kappa, gamma, _ = bootstrap(fitted, rng, 100)
    assert kappa.shape == (100, *fitted.model.kappa.shape)
    # The slice nearest to grazing has too few samples for either
    for draws, error in ((np.log(kappa), errors.ln_kappa), (np.log(gamma), errors.ln_gamma)):
        ratio = (spread(draws) / error)[:5]
        assert 0.85 < np.median(ratio) < 1.15
        assert ratio.min() > 0.6
        assert ratio.max() < 1.5


def test_a_draw_counts_samples_as_often_as_they_are_drawn(small_table):
    """All moments are those of the samples repeated."""
    fitted = quiet_fit(small_table, 1, n_slices=3, min_theta_h=0.3)

    class Twice:
        def poisson(self, size):
            return np.full(size, 2)

    drawn = uncertainty._drawn(fitted, Twice())
    for once, twice in zip(fitted.profiles, drawn, strict=True):
        assert_allclose(twice.moments, 2.0 * once.moments, rtol=1e-12, atol=1e-12)
        assert twice.theta_d == once.theta_d


def test_a_draw_is_repeatable(rng):
    fitted = quiet_fit(random_scan(60, rng, known(1, False).eval), 1, n_slices=2)
    one, other = (bootstrap(fitted, np.random.default_rng(3), 2)[0] for _ in range(2))
    assert_array_equal(one, other)
    assert (one[0] != one[1]).any()


# What cannot be told


def test_intervals_are_symmetric_in_the_logarithm(rng):
    fitted = fit(noisy_table(known(1, True), rng, relative), 1, azimuthal=True, **EVERY_SAMPLE)
    errors = fitted.standard_errors()
    low, high = errors.intervals()["kappa"]
    assert_allclose(low * high, fitted.model.kappa**2)
    t = stats.t.ppf(0.975, errors.freedom)[..., None]
    assert_allclose(np.log(high / fitted.model.kappa), t * errors.ln_kappa)
    narrow = errors.intervals(0.5)["gamma"]
    wide = errors.intervals(0.99)["gamma"]
    assert (wide[0] < narrow[0]).all()
    assert_allclose(errors.kappa, fitted.model.kappa * errors.ln_kappa)
    assert_allclose(errors.gamma, fitted.model.gamma * errors.ln_gamma)
    assert_allclose(errors.beta, np.cos(np.arcsin(fitted.model.beta)) * errors.asin_beta)


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_levels_are_shares(level, rng):
    errors = quiet_fit(random_scan(30, rng, known(1, False).eval), 1, n_slices=1).standard_errors()
    with pytest.raises(ValueError, match=rf"'level' must lie between 0 and 1, got {level}\."):
        errors.intervals(level)


def test_a_flat_slice_is_at_the_limit_of_gamma():
    flat = np.linspace(0.1, 1.2, 20)
    scan = samples_at(flat, np.pi / 4, 1.0, lambda wi, _: np.full((len(wi), 1), 0.2))
    errors = fit(scan, 1, n_slices=1, perimeter_mask=False).standard_errors()
    assert np.isfinite(errors.ln_kappa).all()
    gamma = fit(scan, 1, n_slices=1, perimeter_mask=False).model.gamma
    assert np.isnan(errors.ln_gamma).all() or (gamma > 1e-6).all()


def test_two_lobes_alike_cannot_be_told_apart():
    truth = known(1, False)
    profile = quiet_fit(of_model(truth, 6), 1, azimuthal=False, **EVERY_SAMPLE)
    kappa, gamma, beta = (np.repeat(getattr(profile.model, k), 2, -1) for k in ("kappa", "gamma", "beta"))
    twins = dataclasses.replace(profile, model=profile.model.replace(kappa=kappa, gamma=gamma, beta=beta))
    assert np.isinf(standard_errors(twins).ln_kappa).all()
    low, high = standard_errors(twins).intervals()["kappa"]
    assert (low == 0.0).all()
    assert np.isinf(high).all()


def test_too_few_samples_tell_nothing():
    scan = samples_at(np.array([0.2, 0.7]), np.pi / 4, 0.0, known(1, False).eval)
    errors = quiet_fit(scan, 1, n_slices=1).standard_errors()
    assert np.isnan(errors.ln_kappa).all()
    assert np.isnan(errors.intervals()["gamma"][0]).all()


def test_slices_without_a_sample_tell_nothing(rng):
    scan = samples_at(np.linspace(0.1, 1.0, 30), 0.2, 0.0, known(1, False).eval, 0.01, rng)
    errors = quiet_fit(scan, 1, n_slices=3).standard_errors()
    assert np.isfinite(errors.ln_kappa[0]).all()
    assert np.isnan(errors.ln_kappa[1:]).all()


def test_only_of_a_fit_of_slices(small_table):
    em = quiet_fit(small_table, 1, n_slices=3, method="em")
    with pytest.raises(ValueError, match=r"standard errors are those of a fit of slices by method='joint'"):
        em.standard_errors()
    curved = dataclasses.replace(em, model=em.model.replace(curves=object()))
    with pytest.raises(ValueError, match="the bootstrap is that of a fit of slices: fit without curves"):
        bootstrap(curved, np.random.default_rng(1))
    with pytest.raises(ValueError, match="'n_draws' must be at least 1, got 0"):
        bootstrap(em, np.random.default_rng(1), 0)


def test_the_number_of_samples_is_kept_by_a_cut():
    profile = collapse.gather_profile(0.3, [0.1, 0.5], [0.0, 0.0], [[1.0], [2.0]], [3.0, 4.0])
    assert_array_equal(profile.cut(0.2).n_samples, [[0.0, 1.0]])
    assert isinstance(profile, collapse.SliceProfile)
