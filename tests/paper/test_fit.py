"""The fit of a whole BRDF: it finds known lobes, keeps its promises and orders its lobes."""

import dataclasses
import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
import twin
from scipy import stats
from tables import (
    EVERY_SAMPLE,
    built_in,
    formula,
    known,
    objectives,
    of_model,
    quiet_fit,
    slice_samples,
    sums_of_squares,
)

from dsbrdf import Samples, read
from dsbrdf.geometry.half_diff import azimuthal_factor
from dsbrdf.paper import Slices, fit_slices
from dsbrdf.paper.metrics import LOG_OFFSET

MATERIALS = ["rough-gold", "polished-chrome", "glossy-plastic", "matte", "grey-primer"]


# Recovery


@pytest.mark.parametrize(("with_beta", "azimuthal"), [(False, False), (False, True), (True, True)])
@pytest.mark.parametrize("n_lobes", [1, 2, 3])
def test_finds_known_lobes(n_lobes, with_beta, azimuthal):
    truth = known(n_lobes, with_beta)
    fitted = fit_slices(of_model(truth, 6), n_lobes, azimuthal=azimuthal, strict=True, **EVERY_SAMPLE)
    np.testing.assert_allclose(fitted.model.kappa, truth.kappa, rtol=1e-6)
    np.testing.assert_allclose(fitted.model.gamma, truth.gamma, rtol=1e-6)
    np.testing.assert_allclose(fitted.model.beta, truth.beta, atol=1e-6)


def unknowns(model, *at, azimuthal):
    """x of the twin."""
    x = [np.log(model.kappa[at]), np.log(model.gamma[at]), np.arcsin(model.beta[at])]
    return np.stack(x[: 2 + azimuthal], axis=-1)


def sample_jacobian(x, theta_h, theta_d, phi_d):
    """Derivatives (sample, unknown) of the model by x of the twin, by complex steps."""
    columns = []
    for unknown in range(x.size):
        at = x.astype(complex)
        at.flat[unknown] += 1e-30j
        kappa, gamma = np.exp(at[None, :, :2].T)[..., 0][..., None].swapaxes(1, 2)
        beta = np.sin(at[:, 2]) if x.shape[1] == 3 else np.zeros(len(x))
        columns.append(formula(theta_h, theta_d, phi_d, kappa, gamma, beta[None])[0].imag / 1e-30)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("azimuthal", [False, True])
@pytest.mark.parametrize("n_lobes", [1, 2, 3])
def test_errors_under_noise_are_those_expected(n_lobes, azimuthal, rng):
    """Each unknown is within 4.5 standard errors, and all together as far off as chance has it."""
    truth = known(n_lobes, azimuthal)
    clean = of_model(truth, 6)
    noisy = clean.planes * (1.0 + 0.01 * rng.standard_normal(clean.planes.shape))
    measured = dataclasses.replace(clean, planes=np.where(clean.planes < 0.0, -1.0, noisy))
    fitted = fit_slices(measured, n_lobes, azimuthal=azimuthal, strict=True, **EVERY_SAMPLE)
    factor = azimuthal_factor(clean.theta_h, clean.theta_d[:, None])

    distance, off = 0.0, []
    # Nearest to grazing, too few samples are above the horizon for the linear theory of errors
    for i, channel in np.ndindex(5, 3):
        x = unknowns(truth, i, channel, azimuthal=azimuthal)
        f = clean.rows([i])[channel, :, 0]
        some = np.isfinite(f) & (clean.theta_h[:, None] >= np.deg2rad(1.0))
        theta_h, phi_d = (angle[some] for angle in np.broadcast_arrays(clean.theta_h[:, None], clean.phi_d))
        j = sample_jacobian(x, theta_h, clean.theta_d[i], phi_d)
        profile = fitted.profiles[i]
        rows = twin.jacobian(
            x, twin.make_slice(profile.moments[channel], twin.ln_cos(profile.theta_h), factor[i])
        )
        np.testing.assert_allclose(rows.T @ rows, j.T @ j, rtol=1e-9, atol=1e-9 * (j**2).sum())

        hessian = np.linalg.inv(j.T @ j)
        covariance = hessian @ (j.T * (0.01 * f[some]) ** 2 @ j) @ hessian
        error = (unknowns(fitted.model, i, channel, azimuthal=azimuthal) - x).ravel()
        off.append(error / np.sqrt(covariance.diagonal()))
        distance += error @ np.linalg.solve(covariance, error)
    assert np.abs(off).max() < 4.5
    assert 1e-4 < stats.chi2.cdf(distance, np.size(off)) < 1.0 - 1e-4


# Promises


@pytest.mark.parametrize("n_lobes", [1, 3, 4])
@pytest.mark.parametrize("name", MATERIALS)
def test_never_above_the_em(name, n_lobes):
    measured = built_in(name)
    em = objectives(quiet_fit(measured, n_lobes, method="em"))
    for options in ({}, {"azimuthal": True}, {"order": "kappa"}):
        assert (objectives(quiet_fit(measured, n_lobes, **options)) <= em * (1.0 + 1e-12)).all()


# A candidate this near to the best may be taken for smoother curves
AS_GOOD = 2e-4


@pytest.mark.parametrize("n_lobes", [1, 2, 4])
@pytest.mark.parametrize("name", MATERIALS)
def test_azimuthal_term_never_makes_it_worse(name, n_lobes):
    measured = built_in(name)
    plain = objectives(quiet_fit(measured, n_lobes))
    assert (objectives(quiet_fit(measured, n_lobes, azimuthal=True)) <= plain * (1.0 + AS_GOOD)).all()


@pytest.mark.parametrize("options", [{}, {"azimuthal": True}, {"order": "kappa"}, {"perimeter_mask": False}])
@pytest.mark.parametrize("name", MATERIALS)
def test_objective_is_the_sum_of_squares_over_all_samples(name, options):
    fitted = quiet_fit(built_in(name), 2, **options)
    squares = sums_of_squares(fitted)
    rounding = 1e-14 * fitted.errors.energy.max()
    np.testing.assert_allclose(objectives(fitted), squares, rtol=1e-9, atol=rounding)
    np.testing.assert_allclose(fitted.errors.squares.ravel(), squares, rtol=1e-9, atol=rounding)
    energy = [np.nansum(slice_samples(fitted, i)[0] ** 2) for i in range(len(fitted.profiles))]
    np.testing.assert_allclose(fitted.errors.rel_rms, np.sqrt(squares.sum() / np.sum(energy)), rtol=1e-9)


@pytest.mark.parametrize("azimuthal", [False, True])
def test_log_objective_is_its_counterpart(azimuthal):
    """Logarithms of means over phi_d, squared and counted; the rest of the squares relative to the mean."""
    fitted = quiet_fit(built_in("satin-plastic"), 2, loss="log", azimuthal=azimuthal)
    for i, profile in enumerate(fitted.profiles):
        samples, values = (x.reshape(3, -1, 36) for x in slice_samples(fitted, i))
        valid = np.isfinite(samples)
        count, empty = valid.sum(-1), ~valid.any(-1)

        def mean(x, valid=valid, count=count, empty=empty):
            return np.where(valid, x, 0.0).sum(-1) / np.where(empty, 1, count)

        f, model = mean(samples), mean(values)
        logs = count * np.log((model + LOG_OFFSET) / (f + LOG_OFFSET)) ** 2
        rest = np.where(valid, (samples - f[..., None]) - (values - model[..., None]), 0.0) ** 2
        objective = (logs + rest.sum(-1) / (f + LOG_OFFSET) ** 2).sum(-1)
        reported = [report.objective for report in fitted.slices[3 * i : 3 * i + 3]]
        np.testing.assert_allclose(reported, objective, rtol=1e-6, atol=1e-12)
        assert profile.theta_d == fitted.slices[3 * i].theta_d


def test_log_loss_serves_the_tail():
    measured = built_in("glossy-plastic")
    assert quiet_fit(measured, 3, loss="log").log_rms < 0.9 * quiet_fit(measured, 3).log_rms


def test_log_rms_is_that_of_all_samples():
    fitted = quiet_fit(built_in("satin-plastic"), 2)
    ratios = []
    for i in range(len(fitted.profiles)):
        samples, values = slice_samples(fitted, i)
        ratio = (values + LOG_OFFSET) / (samples + LOG_OFFSET)
        ratios.append(ratio[np.isfinite(ratio)])
    np.testing.assert_allclose(
        fitted.log_rms, np.sqrt((np.log(np.concatenate(ratios)) ** 2).mean()), rtol=1e-10
    )


@pytest.mark.parametrize("azimuthal", [False, True])
@pytest.mark.parametrize("name", ["polished-chrome", "glossy-plastic"])
def test_converged_means_minimum(name, azimuthal):
    """Where the fit says that it converged, SciPy goes on from there and finds nothing better."""
    fitted = quiet_fit(built_in(name), 2, azimuthal=azimuthal)
    drops = []
    for report, (i, channel) in zip(fitted.slices, np.ndindex(18, 3), strict=True):
        if i % 4 or not report.status.ok:
            continue
        profile = fitted.profiles[i]
        factor = azimuthal_factor(profile.theta_h, profile.theta_d)
        s = twin.make_slice(profile.moments[channel], twin.ln_cos(profile.theta_h), factor)
        x = unknowns(fitted.model, i, channel, azimuthal=azimuthal)
        drops.append(1.0 - twin.objective(twin.refine(x, s), s) / report.objective)
    assert len(drops) >= 10
    assert max(drops) < 1e-3


DIGEST = """
import hashlib, warnings
from dsbrdf import tabulate
from dsbrdf.measured import built_in as materials
from dsbrdf.paper import fit_slices

warnings.simplefilter("ignore")
table = tabulate(materials.get("satin-plastic").reflectance, "", shape=(90, 18, 36))
model = fit_slices(table, 3, azimuthal=True).model
print(hashlib.sha256(model.kappa.tobytes() + model.gamma.tobytes() + model.beta.tobytes()).hexdigest())
"""


def test_same_bits_however_many_threads():
    digests = []
    for threads in ("1", "2"):
        environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        done = subprocess.run([sys.executable, "-c", DIGEST], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        digests.append(done.stdout.strip())
    for _ in range(2):
        model = quiet_fit(built_in("satin-plastic"), 3, azimuthal=True).model
        data = model.kappa.tobytes() + model.gamma.tobytes() + model.beta.tobytes()
        digests.append(hashlib.sha256(data).hexdigest())
    assert len(set(digests)) == 1


# Order of lobes


def crossing(n_slices=9):
    """Two lobes, of which the flat one overtakes the narrow one in kappa."""
    theta_d = np.pi / 2 * (np.arange(n_slices) + 0.5) / n_slices
    t = np.linspace(0.0, 1.0, n_slices)
    kappa = np.stack([2.5 * 0.2**t, 0.4 * 5.0**t], axis=-1)
    gamma = np.broadcast_to([80.0, 1.5], kappa.shape)
    shape = (n_slices, 1, 2)
    return Slices(theta_d, kappa.reshape(shape), gamma.reshape(shape), np.zeros(shape))


@pytest.mark.parametrize("azimuthal", [False, True])
def test_follows_lobes_where_they_cross(azimuthal):
    truth = crossing()
    options = {"n_slices": 9, "perimeter_mask": False, "azimuthal": azimuthal}
    followed = fit_slices(of_model(truth, 9), 2, **options).model
    np.testing.assert_allclose(followed.gamma, truth.gamma, rtol=1e-5)
    np.testing.assert_allclose(followed.kappa, truth.kappa, rtol=1e-5)
    by_kappa = fit_slices(of_model(truth, 9), 2, order="kappa", **options).model
    assert (np.diff(by_kappa.kappa) < 0.0).all()
    assert (by_kappa.gamma[0] > by_kappa.gamma[-1]).tolist() == [[True, False]]


@pytest.mark.parametrize("empty", [[0], [4], [3, 4], [8]])
def test_follows_lobes_across_empty_slices(empty):
    truth = crossing()
    shape = (9, 1, 3)
    truth = Slices(
        truth.theta_d,
        np.concatenate([truth.kappa, np.full((9, 1, 1), 0.9)], axis=-1),
        np.broadcast_to([80.0, 1.5, 2000.0], shape),
        np.zeros(shape),
    )
    measured = of_model(truth, 9)
    measured.planes[:, :, empty] = -1.0
    gamma = fit_slices(measured, 3, n_slices=9, perimeter_mask=False).model.gamma
    np.testing.assert_allclose(gamma, np.broadcast_to(gamma[1], shape), rtol=1e-5)


@pytest.mark.parametrize("name", MATERIALS)
def test_order_kappa_sorts_each_slice(name):
    model = quiet_fit(built_in(name), 3, order="kappa").model
    assert (np.diff(model.kappa) <= 0.0).all()


@pytest.mark.parametrize("order", ["follow", "kappa"])
@pytest.mark.parametrize("permutation", [[2, 1, 0], [1, 2, 0]])
def test_channels_do_not_see_each_other(permutation, order):
    """But for the order of lobes, which all channels share."""
    measured = built_in("satin-plastic")
    permuted = dataclasses.replace(
        measured, planes=np.ascontiguousarray(measured.planes[permutation]), scale=measured.scale[permutation]
    )
    one, other = (quiet_fit(m, 2, order=order, azimuthal=True) for m in (measured, permuted))
    objective = objectives(one).reshape(-1, 3)[:, permutation]
    np.testing.assert_allclose(objectives(other).reshape(-1, 3), objective, rtol=1e-6)
    for name in ("kappa", "gamma", "beta"):
        want, got = (np.sort(getattr(f.model, name), axis=-1) for f in (one, other))
        np.testing.assert_allclose(got, want[:, permutation], rtol=1e-4, atol=1e-6)


# Neurally decoded measurements


@pytest.mark.shared
@pytest.mark.parametrize("name", ["nickel", "orange-paint", "specular-blue-phenolic"])
def test_promises_hold_on_decoded_materials(decoded, name):
    measured = read(decoded(name))
    em = objectives(quiet_fit(measured, 3, method="em"))
    plain = objectives(quiet_fit(measured, 3))
    fitted = quiet_fit(measured, 3, azimuthal=True)
    with_term = objectives(fitted)
    assert (plain <= em * (1.0 + 1e-12)).all()
    assert (with_term <= em * (1.0 + 1e-12)).all()
    assert (with_term <= plain * (1.0 + AS_GOOD)).all()
    np.testing.assert_allclose(with_term, sums_of_squares(fitted), rtol=1e-8)


def test_only_tables_are_fitted():
    up = np.array([[0.0, 0.0, 1.0]])
    for measured in ("a.binary", np.ones((3, 3)), Samples(up, up, np.ones((1, 3)))):
        name = type(measured).__name__
        text = rf"'measured' must be a MeasuredBRDF, got {name}\. .*scattered samples have no slices: fit them with"
        with pytest.raises(TypeError, match=text):
            fit_slices(measured)
