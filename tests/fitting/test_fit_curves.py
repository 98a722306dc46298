"""The fit of curves to all slices at once: exactness, Jacobian, limits, degenerate data, and the way through `fit`."""

import dataclasses
import re
import sys

import numpy as np
import pytest
from curve_models import SLICES, random_curves, sliced
from numpy.testing import assert_allclose, assert_array_equal

import dsbrdf
from dsbrdf import DSBRDF, ConvergenceWarning, CurveBasis, cli, fit_curves, load
from dsbrdf.fitting._minimise import Minimum, minimise
from dsbrdf.fitting.fit_splines import ChannelProblem
from dsbrdf.geometry.grids import cell_angles
from dsbrdf.model.components import roughness
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import SliceProfile, gather_profile, stack_profiles

LOG_OFFSET = metrics.LOG_OFFSET


def profiles_of(curves, theta_d=SLICES, noise=0.0, rng=None, n_phi=9):
    """Slices of the exact values of `curves`, some of them missing near grazing."""
    theta_h, phi_d = cell_angles("centre", (30, 1, n_phi))[::2]
    # Uneven, so that cos(2 phi_d) has a mean
    phi_d = 0.7 * phi_d
    profiles = []
    for theta in theta_d:
        model = DSBRDF([theta], *curves.at([theta]))
        h, phi = (x.ravel() for x in np.meshgrid(theta_h, phi_d, indexing="ij"))
        values = model.eval_angles(h, theta, phi)
        values[(h > np.pi / 2 - theta) | (h < np.deg2rad(1.0))] = np.nan
        if noise:
            values *= np.exp(noise * rng.normal(size=values.shape))
        profiles.append(gather_profile(theta, h, phi, values))
    return profiles


def problems(profiles, basis=None, log_offset=None):
    theta_d, theta_h, moments = stack_profiles(profiles)
    design = (basis or CurveBasis()).design(theta_d)
    return [
        ChannelProblem(moments[:, channel], theta_h, theta_d, design, log_offset)
        for channel in range(moments.shape[1])
    ]


def unknowns(curves, channel, azimuthal=True):
    names = ("kappa", "gamma", "beta")[: 3 if azimuthal else 2]
    return np.stack([getattr(curves, name)[channel] for name in names], axis=1)


def disturbed(model, rng, size):
    kappa, gamma = (x * np.exp(size * rng.normal(size=x.shape)) for x in (model.kappa, model.gamma))
    return model.replace(kappa=kappa, gamma=gamma)


# The problem


def test_cost_and_floor_are_the_squares_of_metrics(rng):
    truth, other = random_curves(rng), random_curves(rng)
    profiles = profiles_of(truth, noise=0.1, rng=rng)
    squares = metrics.fit_errors(profiles, *other.at(SLICES)).squares.sum(0)
    for channel, problem in enumerate(problems(profiles)):
        cost = problem.cost(unknowns(other, channel))
        assert_allclose(2.0 * cost + problem.floor, squares[channel], rtol=1e-11)
        assert_allclose(problem.energy, sum(profile.energy[channel] for profile in profiles), rtol=1e-13)


@pytest.mark.parametrize("log_offset", [None, LOG_OFFSET])
@pytest.mark.parametrize("azimuthal", [True, False])
def test_gradient_and_hessian_are_those_of_differences(rng, log_offset, azimuthal):
    problem = problems(profiles_of(random_curves(rng), noise=0.1, rng=rng), log_offset=log_offset)[1]
    x = unknowns(random_curves(rng), 1, azimuthal)

    def rows(x):
        problem.cost(x)
        return problem._state[-1].ravel().copy()

    columns = []
    for index in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[index] = 1e-5
        columns.append((rows(x + step) - rows(x - step)) / 2e-5)
    jacobian = np.array(columns)
    residual = rows(x)
    hessian, gradient = problem.linearise()
    assert hessian.shape == (x.size, x.size)
    assert_allclose(gradient, jacobian @ residual, rtol=1e-6, atol=1e-7 * np.abs(gradient).max())
    assert_allclose(hessian, jacobian @ jacobian.T, rtol=1e-6, atol=1e-7 * np.abs(hessian).max())


# The fit


@pytest.mark.parametrize("variable", ["theta_d", "cosine"])
@pytest.mark.parametrize("loss", ["l2", "log"])
def test_curves_are_recovered_from_their_values(rng, loss, variable):
    truth = random_curves(rng, CurveBasis(variable=variable))
    profiles = profiles_of(truth)
    start = disturbed(sliced(truth), rng, 0.05)
    got, minima = fit_curves(profiles, start, truth.basis, loss=loss)
    errors = metrics.fit_errors(profiles, *got.at(SLICES))
    assert errors.rel_rms < 1e-4
    assert all(minimum.converged for minimum in minima)
    before = metrics.fit_errors(profiles, *start.to_curves(truth.basis).curves.at(SLICES))
    assert before.rel_rms > 0.01


@pytest.mark.parametrize("loss", ["l2", "log"])
def test_the_fit_never_ends_above_smoothing(rng, loss):
    for _ in range(5):
        profiles = profiles_of(random_curves(rng), noise=0.3, rng=rng)
        start = disturbed(sliced(random_curves(rng)), rng, 0.5)
        smooth = start.to_curves().curves
        _, minima = fit_curves(profiles, start, smooth.basis, loss=loss)
        for channel, problem in enumerate(
            problems(profiles, log_offset=LOG_OFFSET if loss == "log" else None)
        ):
            x = np.clip(unknowns(smooth, channel), *problem.limits((2, 3, 6)))
            assert minima[channel].cost <= problem.cost(x)


def test_without_beta_there_stays_none(rng):
    truth = random_curves(rng)
    start = sliced(truth)
    curves, _ = fit_curves(profiles_of(truth), start.replace(beta=np.zeros_like(start.beta)), truth.basis)
    assert not curves.beta.any()


def test_coefficients_stay_within_their_limits(rng):
    truth = random_curves(rng)
    truth = dataclasses.replace(truth, beta=np.sign(truth.beta))
    profiles = profiles_of(truth, noise=1.0, rng=rng)
    curves, _ = fit_curves(profiles, disturbed(sliced(truth), rng, 3.0), truth.basis)
    assert np.abs(curves.beta).max() == 1.0
    assert (np.exp(curves.kappa) < 700.0).all()
    assert (np.abs(curves.gamma) <= 14.0).all()


def test_samples_near_the_pole_bound_the_lobes(rng):
    truth = random_curves(rng)
    whole = profiles_of(truth)
    # A narrow lobe that no fitted sample sees
    start = sliced(truth)
    start = start.replace(kappa=np.where([True, False], 6.0, start.kappa), gamma=start.gamma * [1e5, 1.0])
    dim = [dataclasses.replace(profile, moments=0.5 * profile.moments) for profile in whole]
    near_pole = [
        SliceProfile(p.theta_d, p.theta_h, np.maximum(p.moments, d.moments))
        for p, d in zip(whole, dim, strict=True)
    ]
    curves, _ = fit_curves(dim, start, truth.basis, near_pole=near_pole)
    brightest = max(np.nanmax(profile.mean) for profile in near_pole)
    assert np.expm1(curves.at(SLICES)[0]).max() <= 1.5 * brightest
    free, _ = fit_curves(dim, start, truth.basis)
    assert np.expm1(free.at(SLICES)[0]).max() > 1.5 * brightest


def test_a_slice_without_samples_is_held_by_its_neighbours(rng):
    truth = random_curves(rng)
    whole = profiles_of(truth)
    damaged = list(whole)
    for i in (3, 9, 10):
        damaged[i] = SliceProfile(whole[i].theta_d, whole[i].theta_h, np.zeros_like(whole[i].moments))
    got, _ = fit_curves(damaged, disturbed(sliced(truth), rng, 0.02), truth.basis)
    assert metrics.fit_errors(whole, *got.at(SLICES)).rel_rms < 1e-3


def test_one_slice_one_lobe_and_a_black_channel_are_fitted(rng):
    truth = random_curves(rng, n_lobes=1)
    theta_d = SLICES[4:5]
    (profile,) = profiles_of(truth, theta_d)
    moments = profile.moments.copy()
    moments[2, :, [1, 2, 5]] = 0.0
    profile = SliceProfile(profile.theta_d, profile.theta_h, moments)
    curves, minima = fit_curves([profile], sliced(truth, theta_d))
    assert len(minima) == 3
    model = curves.model()
    assert np.isfinite(model.eval_angles(0.1, theta_d, 0.3)).all()
    assert model.eval_angles(0.1, theta_d, 0.3)[0, 2] < 1e-6


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"loss": "l1"}, "'loss' must be 'l2' or 'log', got 'l1'."),
        ({"n_channels": 2}, "'start' must have the channels of the profiles, 3, got 2."),
        ({"empty": True}, "no slice has a valid sample. Lower 'min_theta_h' or check the measurement."),
    ],
)
def test_what_cannot_be_fitted_is_refused(rng, change, text):
    truth = random_curves(rng)
    (profile,) = profiles_of(truth, SLICES[:1])
    if change.get("empty"):
        profile = SliceProfile(profile.theta_d, profile.theta_h, np.zeros_like(profile.moments))
    start = sliced(random_curves(rng, n_channels=change.get("n_channels", 3)))
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        fit_curves([profile], start, loss=change.get("loss", "l2"))


# The search


class Rosenbrock:
    """Its valley, with an upper bound."""

    floor = 0.0

    def __init__(self, high):
        self.high = high

    def cost(self, x):
        self.x = x
        self.rows = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        return 0.5 * float(self.rows @ self.rows)

    def linearise(self):
        jacobian = np.array([[-20.0 * self.x[0], 10.0], [-1.0, 0.0]])
        return jacobian.T @ jacobian, jacobian.T @ self.rows

    def limits(self, shape):
        return np.full(shape, -10.0), np.full(shape, self.high)


@pytest.mark.parametrize(("high", "least"), [(10.0, [1.0, 1.0]), (0.5, [0.5, 0.25])])
def test_the_search_finds_the_least_within_limits(high, least):
    x, minimum = minimise(Rosenbrock(high), np.array([-1.2, 0.4]))
    assert minimum.converged
    assert_allclose(x, least, atol=1e-5)


def test_the_search_says_when_it_ran_out_of_steps():
    x, minimum = minimise(Rosenbrock(10.0), np.array([-1.2, 1.0]), max_iterations=2)
    assert not minimum.converged
    assert minimum.iterations == 2
    assert minimum.cost == Rosenbrock(10.0).cost(x)


# Through `fit`


@pytest.fixture(scope="module")
def gold():
    return dsbrdf.material("rough-gold")


def test_fit_gives_curves_that_are_better_than_blended_slices(gold):
    slices, curves = (dsbrdf.fit(gold, 2, curves=choice) for choice in (False, True))
    assert slices.model.curves is None
    assert curves.model.curves.basis == CurveBasis(variable="cosine")
    assert len(curves.profiles) == 90
    assert curves.options["curves"] is True
    assert curves.model.name == "rough-gold"
    assert curves.seconds > slices.seconds
    assert curves.errors.rel_rms == pytest.approx(curves.model.errors["rel_rms"])
    assert curves.errors.rel_rms < blended_error(slices.model, curves.profiles)
    assert curves.log_rms < 1.0


def blended_error(model, profiles):
    """Relative RMS of a model of slices on the means over phi_d of other slices."""
    squares = energy = 0.0
    for profile in profiles:
        phi_d = cell_angles()[2]
        h, phi = np.meshgrid(profile.theta_h, phi_d, indexing="ij")
        seen = profile.count.T > 0.0
        mean = model.eval_angles(h, profile.theta_d, phi).mean(1)
        squares += (((mean - np.nan_to_num(profile.mean.T)) * seen) ** 2).sum()
        energy += (np.nan_to_num(profile.mean.T) ** 2).sum()
    return np.sqrt(squares / energy)


def test_a_basis_and_a_loss_can_be_asked_for(gold, tmp_path):
    basis = CurveBasis(6)
    fit = dsbrdf.fit(gold, 1, curves=basis, loss="log")
    assert fit.model.curves.basis == basis
    fit.model.save(tmp_path / "m.json")
    back = load(tmp_path / "m.json")
    assert_array_equal(back.kappa, fit.model.kappa)
    assert back.fit_options["curves"] is True
    assert fit.log_rms < dsbrdf.fit(gold, 1, curves=basis).log_rms


def test_a_table_of_another_convention_is_fitted_at_its_own_angles(make_table):
    fit = dsbrdf.fit(make_table(1, convention="edge"), 1, curves=True, n_slices=9)
    assert fit.profiles[0].theta_d == 0.0
    assert len(fit.profiles) == 18
    assert fit.log_rms > 0.0


def test_running_out_of_iterations_is_told(gold, monkeypatch):
    # The function of that name hides the module from attribute access
    module = sys.modules["dsbrdf.fitting.fit_splines"]
    monkeypatch.setattr(module, "minimise", lambda _, x: (x, Minimum(1.0, 300, False)))
    with pytest.warns(ConvergenceWarning, match=r"^the curves of channel 0, 1, 2 ran out of iterations"):
        dsbrdf.fit(gold, 1, curves=True)
    with pytest.raises(RuntimeError, match="ran out of iterations"):
        dsbrdf.fit(gold, 1, curves=True, strict=True)


@pytest.mark.shared
def test_six_coefficients_cost_little_on_a_decoded_material(decoded):
    slices = dsbrdf.fit(dsbrdf.read(decoded("cherry-235")), 3, azimuthal=False)
    theta_d = slices.model.theta_d
    curves, _ = fit_curves(slices.profiles, slices.model, CurveBasis())
    smooth = slices.model.to_curves().curves
    error, smoothed = (metrics.fit_errors(slices.profiles, *c.at(theta_d)).rel_rms for c in (curves, smooth))
    assert slices.errors.rel_rms < error < 1.05 * slices.errors.rel_rms
    assert smoothed > error
    steep = theta_d > np.deg2rad(65.0)
    free, fitted = (
        roughness(DSBRDF(theta_d[steep], *(x[steep] for x in parameters)))
        for parameters in ((slices.model.kappa, slices.model.gamma, slices.model.beta), curves.at(theta_d))
    )
    assert fitted.kappa < free.kappa / 3.0
    assert fitted.gamma < free.gamma / 3.0


def test_the_command_fits_curves(tmp_path, capsys):
    assert cli.main(["fit", "rough-gold", "--curves", "--lobes", "1", "-o", str(tmp_path)]) == 0
    assert load(tmp_path / "rough-gold.json").curves is not None
    assert "rough-gold" in capsys.readouterr().out
