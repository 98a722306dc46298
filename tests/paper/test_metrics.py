"""Errors of a fit and the floors below them, against sums over all samples and independent routes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import isotonic_regression
from slices import profile_of

from dsbrdf import half_diff
from dsbrdf.paper import slice_profiles
from dsbrdf.paper.collapse import MIN_THETA_H, slice_mask, slice_rows
from dsbrdf.paper.metrics import LOG_OFFSET, fit_errors, log_rms, profile_model

MASKS = [
    {"min_theta_h": MIN_THETA_H, "perimeter_mask": True, "theta_h_step": 1},
    {"min_theta_h": 0.0, "perimeter_mask": False, "theta_h_step": 1},
    {"min_theta_h": 0.1, "perimeter_mask": True, "theta_h_step": 3},
]
every_mask = pytest.mark.parametrize("masks", MASKS, ids=["default", "none", "sparse"])


def random_parameters(rng, n_slices, n_channels=3, n_lobes=2, azimuthal=True):
    shape = (n_slices, n_channels, n_lobes)
    beta = rng.uniform(-1, 1, shape) if azimuthal else np.zeros(shape)
    return rng.uniform(0.01, 1.5, shape), 10 ** rng.uniform(-1, 2, shape), beta


def model_value(theta_h, theta_d, phi_d, kappa, gamma, beta):
    """Sum of lobes (lobe,) at one direction, as the paper writes it, with the azimuthal term."""
    lobes = np.exp(kappa * np.cos(theta_h) ** gamma) - 1
    p, q = np.sin(theta_h) * np.sin(theta_d), np.cos(theta_h) * np.cos(theta_d)
    factor = p / np.sqrt(p**2 + (half_diff.AZIMUTHAL_WIDTH * q) ** 2) if p else 0.0
    return (lobes * (1 + beta * factor * np.cos(2 * phi_d))).sum()


def samples(measured, row, masks):
    """Indices and values of the valid samples of a row that masks leave: theta_h, phi_d, channel, value."""
    kept = slice_mask(measured, np.array([row]), *masks.values())[0]
    for h, phi, channel in np.ndindex(*measured.values[:, row].shape):
        value = measured.values[h, row, phi, channel]
        if kept[h] and np.isfinite(value):
            yield h, phi, channel, value


@every_mask
def test_errors_are_those_of_all_samples_one_by_one(damaged_table, rng, masks):
    parameters = random_parameters(rng, 18)
    errors = fit_errors(slice_profiles(damaged_table, **masks), *parameters)
    squares, energy = np.zeros((18, 3)), np.zeros((18, 3))
    logs = []
    for row, theta_d in enumerate(damaged_table.theta_d):
        for h, phi, c, f in samples(damaged_table, row, masks):
            of_lobes = [parameter[row, c] for parameter in parameters]
            model = model_value(damaged_table.theta_h[h], theta_d, damaged_table.phi_d[phi], *of_lobes)
            squares[row, c] += (model - f) ** 2
            energy[row, c] += f**2
            logs.append(np.log((model + LOG_OFFSET) / (f + LOG_OFFSET)))
    assert_allclose(errors.squares, squares, rtol=1e-11, atol=1e-12)
    assert_allclose(errors.energy, energy, rtol=1e-12)
    assert_allclose(errors.rel_rms, np.sqrt(squares.sum() / energy.sum()), rtol=1e-12)
    lit = energy > 0
    assert_allclose(errors.slice_rel_rms[lit], np.sqrt(squares[lit] / energy[lit]), rtol=1e-11, atol=1e-12)
    assert np.isnan(errors.slice_rel_rms[~lit]).all()

    theta_h = np.broadcast_to(damaged_table.theta_h, (18, 12))
    a, b = profile_model(theta_h, damaged_table.theta_d, *parameters)
    expected = np.sqrt(np.mean(np.square(logs)))
    assert_allclose(log_rms(damaged_table, np.arange(18), a, b, **masks), expected, rtol=1e-12)


@every_mask
def test_floors_by_independent_routes(damaged_table, rng, masks):
    errors = fit_errors(slice_profiles(damaged_table, **masks), *random_parameters(rng, 18))
    bivariate, monotone, azimuthal = np.zeros((3, 18, 3))
    for row in range(18):
        groups = {}
        for h, phi, c, f in samples(damaged_table, row, masks):
            groups.setdefault((c, h), []).append((f, np.cos(2 * damaged_table.phi_d[phi])))
        means = [([], []) for _ in range(3)]
        for (c, _), group in sorted(groups.items()):
            f, cosine = np.array(group).T
            bivariate[row, c] += ((f - f.mean()) ** 2).sum()
            means[c][0].append(f.mean())
            means[c][1].append(f.size)
            basis = np.stack([np.ones_like(f), cosine], axis=1)
            solution = np.linalg.lstsq(basis, f, rcond=None)[0]
            azimuthal[row, c] += ((f - basis @ solution) ** 2).sum()
        for c, (mean, count) in enumerate(means):
            if mean:
                fall = isotonic_regression(mean, weights=count, increasing=False).x
                monotone[row, c] = bivariate[row, c] + (count * (mean - fall) ** 2).sum()
    assert_allclose(errors.bivariate, bivariate, rtol=1e-10, atol=1e-11)
    assert_allclose(errors.monotone, monotone, rtol=1e-10, atol=1e-11)
    assert_allclose(errors.azimuthal, azimuthal, rtol=1e-10, atol=1e-11)
    energy = errors.energy.sum()
    assert_allclose(errors.bivariate_floor, np.sqrt(bivariate.sum() / energy), rtol=1e-11)
    assert_allclose(errors.monotone_floor, np.sqrt(monotone.sum() / energy), rtol=1e-11)
    assert_allclose(errors.azimuthal_floor, np.sqrt(azimuthal.sum() / energy), rtol=1e-11)
    # The table is such that the floors differ
    assert errors.azimuthal_floor < 0.99 * errors.bivariate_floor
    assert errors.bivariate_floor < 0.999 * errors.monotone_floor


def test_profile_model_is_the_sum_of_lobes_at_each_theta_h(rng):
    theta_d = np.array([0.0, 0.4, 1.5])
    theta_h = np.sort(rng.uniform(0.0, 1.5, (3, 7)))
    theta_h[:, 0] = 0.0
    kappa, gamma, beta = random_parameters(rng, 3, n_channels=2)
    a, b = profile_model(theta_h, theta_d, kappa, gamma, beta)
    assert a.shape == b.shape == (3, 2, 7)
    for s, c, h in np.ndindex(3, 2, 7):
        for phi in (0.0, 0.7, np.pi / 2):
            value = model_value(theta_h[s, h], theta_d[s], phi, kappa[s, c], gamma[s, c], beta[s, c])
            assert_allclose(a[s, c, h] + b[s, c, h] * np.cos(2 * phi), value, rtol=1e-12, atol=1e-15)
    assert_array_equal(b[0], 0.0)
    assert_array_equal(b[:, :, 0], 0.0)


def test_profile_model_at_the_horizon_is_finite_and_its_limit():
    one = np.ones((1, 1, 1))
    for gamma, limit in [(0.0, np.expm1(2.0)), (1e-3, np.expm1(2.0 * 1e-8**1e-3)), (50.0, 0.0)]:
        a, _ = profile_model(np.array([[np.pi / 2]]), np.zeros(1), 2.0 * one, gamma * one, one)
        assert_allclose(a[0, 0, 0], limit, rtol=1e-3)


def of_model(measured, kappa, gamma, beta):
    """`measured` with the values of lobes in place of its own where it is valid."""
    theta_h = np.broadcast_to(measured.theta_h, (len(measured.theta_d), len(measured.theta_h)))
    a, b = profile_model(theta_h, measured.theta_d, kappa, gamma, beta)
    values = a[..., None] + b[..., None] * np.cos(2 * measured.phi_d)
    planes = np.where(measured.planes >= 0.0, values.transpose(1, 2, 0, 3), -1.0)
    return dataclasses.replace(measured, planes=planes, scale=np.ones(3)), a, b


@every_mask
def test_a_perfect_model_has_no_error(damaged_table, rng, masks):
    parameters = random_parameters(rng, 18)
    measured, a, b = of_model(damaged_table, *parameters)
    errors = fit_errors(slice_profiles(measured, **masks), *parameters)
    # The square root of the rounding error of a sum of squares
    assert errors.rel_rms < 1e-7
    assert errors.azimuthal_floor < 1e-7
    assert errors.bivariate_floor > 1e-3
    assert log_rms(measured, np.arange(18), a, b, **masks) < 1e-13


def test_a_perfect_model_without_azimuthal_term_meets_all_floors_at_zero(damaged_table, rng):
    parameters = random_parameters(rng, 18, azimuthal=False)
    measured, _, _ = of_model(damaged_table, *parameters)
    errors = fit_errors(slice_profiles(measured), *parameters)
    for error in (errors.rel_rms, errors.bivariate_floor, errors.monotone_floor, errors.azimuthal_floor):
        assert error < 1e-7


def test_black_model_has_an_error_of_one(small_table):
    black = np.full((18, 3, 1), 1e-300)
    errors = fit_errors(slice_profiles(small_table), black, np.ones_like(black), np.zeros_like(black))
    assert_allclose(errors.rel_rms, 1.0, rtol=1e-12)
    lit = errors.energy > 0.0
    assert_allclose(errors.slice_rel_rms[lit], 1.0, rtol=1e-12)


def test_data_without_energy_has_no_relative_error(small_table, rng):
    dark = dataclasses.replace(small_table, planes=np.zeros_like(small_table.planes))
    errors = fit_errors(slice_profiles(dark), *random_parameters(rng, 18))
    assert errors.squares.sum() > 0.0
    assert np.isnan(errors.slice_rel_rms).all()
    for error in (errors.rel_rms, errors.bivariate_floor, errors.monotone_floor, errors.azimuthal_floor):
        assert np.isnan(error)


positive = st.floats(0.0, 5.0)


@given(
    values=arrays(float, (6, 8, 2), elements=positive | st.just(np.nan)),
    kappa=arrays(float, (1, 2, 2), elements=st.floats(1e-6, 3.0)),
    gamma=arrays(float, (1, 2, 2), elements=st.floats(0.0, 50.0)),
    beta=arrays(float, (1, 2, 2), elements=st.floats(-1.0, 1.0)),
    theta_d=st.floats(0.0, np.pi / 2),
    weights=arrays(float, 48, elements=st.floats(0.01, 3.0)),
)
def test_floors_are_below_every_model(values, kappa, gamma, beta, theta_d, weights):
    theta_h, phi_d = np.meshgrid(np.linspace(0.0, 1.5, 6), np.linspace(0.1, 3.0, 8), indexing="ij")
    profile = profile_of(theta_d, theta_h.ravel(), phi_d.ravel(), values.reshape(48, 2), weights)
    slack = 1e-9 * (1.0 + profile.energy)
    with_term = fit_errors([profile], kappa, gamma, beta)
    assert (with_term.azimuthal[0] <= with_term.squares[0] + slack).all()
    without = fit_errors([profile], kappa, gamma, 0.0 * beta)
    assert (without.monotone[0] <= without.squares[0] + slack).all()
    assert (without.bivariate[0] <= without.monotone[0] + slack).all()
    assert (without.azimuthal[0] <= without.bivariate[0] + slack).all()
    assert (without.monotone[0] <= without.energy[0] + slack).all()


def test_slices_of_different_length_are_taken_each_by_itself(rng):
    profiles = [
        profile_of(theta_d, rng.uniform(0.1, 1.4, n), rng.uniform(0, 3, n), rng.uniform(0, 2, (n, 2)))
        for theta_d, n in [(0.1, 3), (0.6, 25), (1.2, 0), (1.3, 9)]
    ]
    parameters = random_parameters(rng, 4, n_channels=2)
    together = fit_errors(profiles, *parameters)
    for i, profile in enumerate(profiles):
        alone = fit_errors([profile], *(parameter[i : i + 1] for parameter in parameters))
        for field in dataclasses.fields(together):
            assert_allclose(getattr(together, field.name)[i], getattr(alone, field.name)[0], rtol=1e-12)


def test_lobes_too_high_to_number_where_there_is_no_sample_do_no_harm(small_table):
    """A narrow lobe of kappa 800 is infinite at theta_h = 0, which the default masks leave out."""
    kappa, gamma = np.full((18, 3, 1), 800.0), np.full((18, 3, 1), 1e5)
    measured = dataclasses.replace(small_table, theta_h=small_table.theta_h - small_table.theta_h[0])
    errors = fit_errors(slice_profiles(measured), kappa, gamma, np.zeros_like(kappa))
    assert np.isfinite(errors.squares).all()
    ragged = [
        profile_of(0.1, [0.5], [0.0], [[1.0]]),
        profile_of(0.2, [0.5, 0.6], [0, 0], [[1.0], [2.0]]),
    ]
    assert np.isfinite(fit_errors(ragged, kappa[:2, :1], gamma[:2, :1], 0 * kappa[:2, :1]).rel_rms)


@pytest.mark.parametrize("n_channels", [1, 5])
def test_any_number_of_channels(make_table, rng, n_channels):
    measured = make_table(n_channels)
    parameters = random_parameters(rng, 6, n_channels=n_channels)
    errors = fit_errors(slice_profiles(measured, n_slices=6), *parameters)
    assert errors.squares.shape == (6, n_channels)
    rows = slice_rows(18, 6)
    theta_h = np.broadcast_to(measured.theta_h, (6, 12))
    a, b = profile_model(theta_h, measured.theta_d[rows], *parameters)
    assert log_rms(measured, rows, a, b, **MASKS[0]) > 0.0


def test_log_rms_counts_a_model_that_is_off_beyond_measure(small_table):
    a = np.full((18, 3, 12), 1.0)
    a[0, 0, 3] = np.inf
    assert log_rms(small_table, np.arange(18), a, np.zeros_like(a), **MASKS[0]) == np.inf
    a[0, 0, 3] = np.nan
    assert np.isnan(log_rms(small_table, np.arange(18), a, np.zeros_like(a), **MASKS[0]))


def test_log_rms_of_a_constant_ratio_is_its_logarithm(small_table):
    dark = dataclasses.replace(small_table, planes=np.where(small_table.planes >= 0, 0.0, -1.0))
    a = np.full((18, 3, 12), LOG_OFFSET)
    assert_allclose(log_rms(dark, np.arange(18), a, 0 * a, **MASKS[1]), np.log(2.0), rtol=1e-14)


def test_log_rms_without_samples_is_nan(small_table):
    a = np.ones((18, 3, 12))
    assert np.isnan(log_rms(small_table, np.arange(18), a, a, **(MASKS[0] | {"min_theta_h": np.pi / 2})))
    assert np.isnan(log_rms(small_table, np.arange(0), a[:0], a[:0], **MASKS[0]))
