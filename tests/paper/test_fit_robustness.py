"""The fit of a BRDF given odd options, odd tables and adversarial profiles."""

import numpy as np
import pytest
import twin
from hypothesis import given, settings
from hypothesis import strategies as st
from tables import (
    EVERY_SAMPLE,
    KNOWN,
    built_in,
    known,
    lobes,
    objectives,
    of_model,
    quiet_fit,
    sums_of_squares,
)

from dsbrdf import tabulate
from dsbrdf.measured import built_in as materials
from dsbrdf.paper import ConvergenceWarning, FitStatus, SliceProfile, fit_slices
from dsbrdf.paper.slice_fit import fit_profiles

# Options


def test_rows_and_steps_choose_the_samples():
    measured = built_in("satin-plastic")
    fitted = quiet_fit(measured, 1, n_slices=6, theta_h_step=3)
    np.testing.assert_array_equal(fitted.model.theta_d, measured.theta_d[::3])
    assert fitted.model.kappa.shape == (6, 3, 1)
    used = fitted.profiles[0].count[0] > 0.0
    np.testing.assert_array_equal(np.flatnonzero(used) % 3, 0)
    assert used.sum() > 20
    np.testing.assert_allclose(objectives(fitted), sums_of_squares(fitted), rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"method": "lm"}, r"'method' must be 'joint' or 'em', got 'lm'\."),
        ({"loss": "l1"}, r"'loss' must be 'l2' or 'log', got 'l1'\."),
        ({"order": "gamma"}, r"'order' must be 'follow' or 'kappa', got 'gamma'\."),
        ({"n_lobes": 0}, r"'n_lobes' must be between 1 and 10, or 'auto', got 0\."),
        ({"n_lobes": 11}, r"'n_lobes' must be between 1 and 10, or 'auto', got 11\."),
        ({"n_lobes": "many"}, r"'n_lobes' must be between 1 and 10, or 'auto', got 'many'\."),
        ({"method": "em", "loss": "log"}, r"takes loss='l2' only\. Use method='joint'\."),
        ({"method": "em", "azimuthal": True}, r"has no azimuthal term.*Use azimuthal=False"),
        ({"n_slices": 0}, r"'n_slices' must be between 1 and the table's 18 rows, got 0\."),
        ({"n_slices": 19}, r"'n_slices' must be between 1 and the table's 18 rows, got 19\."),
        ({"theta_h_step": 0}, r"'theta_h_step' must be at least 1, got 0\."),
        ({"min_theta_h": -0.1}, r"'min_theta_h' must lie in \[0, pi/2\] radians, got -0\.1"),
        ({"min_theta_h": 2.0}, r"'min_theta_h' must lie in \[0, pi/2\] radians, got 2.*deg2rad"),
    ],
)
def test_says_what_is_wrong_with_an_option(options, text):
    with pytest.raises(ValueError, match=text):
        fit_slices(built_in("matte"), **options)


def test_warns_once_and_points_at_the_caller():
    with pytest.warns(
        ConvergenceWarning, match=r"of 54 slices \(theta_d [0-9.]+ degrees channel.*out of iterations"
    ) as caught:
        fitted = fit_slices(built_in("polished-chrome"), 3, method="em")
    assert len(caught) == 1
    assert caught[0].filename == __file__
    late = [report for report in fitted.slices if not report.status.ok]
    assert caught[0].message.args[0].startswith(f"{len(late)} of 54 slices")
    assert all(
        report.status is FitStatus.MAX_ITERATIONS and "Fewer lobes" in report.status.message
        for report in late
    )
    assert np.isfinite(fitted.model.kappa).all()


def test_strict_raises_instead():
    # A warning would be an error here too, and another one
    with pytest.raises(RuntimeError, match=r"of 54 slices .*out of iterations"):
        fit_slices(built_in("polished-chrome"), 3, method="em", strict=True)


def test_number_of_lobes_of_any_integer_type():
    assert quiet_fit(built_in("matte"), np.int64(2)).model.n_lobes == 2
    assert quiet_fit(built_in("matte"), np.int64(2)).selection is None


# Unusual tables


def test_empty_slices_take_the_nearest_lobes():
    measured = of_model(known(1, True), 6)
    measured.planes[:, :, [0, 1, 5]] = -1.0
    measured.planes[1, :, 3] = np.nan
    fitted = fit_slices(measured, 1, azimuthal=True, **EVERY_SAMPLE)
    status = np.array([report.status for report in fitted.slices]).reshape(6, 3)
    empty = np.zeros((6, 3), bool)
    empty[[0, 1, 5]] = True
    empty[3, 1] = True
    np.testing.assert_array_equal(status, np.where(empty, FitStatus.NO_DATA, FitStatus.CONVERGED))
    assert "nearest slice" in FitStatus.NO_DATA.message
    for values in (fitted.model.kappa, fitted.model.gamma, fitted.model.beta):
        for i, nearest in ((0, 2), (1, 2), (5, 4)):
            np.testing.assert_array_equal(values[i], values[nearest])
        assert values[3, 1] in (values[2, 1], values[4, 1])
    truth = np.where(empty[..., None], np.nan, known(1, True).kappa)
    got = np.where(empty[..., None], np.nan, fitted.model.kappa)
    np.testing.assert_allclose(got, truth, rtol=1e-6)


@pytest.mark.parametrize("options", [{}, {"method": "em"}, {"loss": "log"}])
def test_a_slice_too_dim_to_see_harms_nothing(options):
    measured = of_model(known(2, False), 6)
    whole = quiet_fit(measured, 2, **EVERY_SAMPLE, **options).model
    measured.planes[:, :, 4] *= 1e-25
    fitted = quiet_fit(measured, 2, **EVERY_SAMPLE, **options).model
    np.testing.assert_allclose(fitted.kappa[:4], whole.kappa[:4], rtol=0.1)
    assert np.isfinite(fitted.gamma).all()
    assert (fitted.eval_angles(0.1, fitted.theta_d[4], 0.3) < 1e-12).all()


def constant(value, channels=3, shape=(20, 6, 12)):
    return tabulate(
        lambda wi, wo: np.full((*np.broadcast(wi[..., 0], wo[..., 0]).shape, channels), value),
        "",
        shape=shape,
    )


@pytest.mark.parametrize("options", [{}, {"method": "em"}, {"loss": "log"}, {"order": "kappa"}])
@pytest.mark.parametrize("n_lobes", [2, "auto"])
def test_black_stays_black(n_lobes, options):
    fitted = fit_slices(constant(0.0), n_lobes, n_slices=6, **options)
    assert all(report.status is FitStatus.NO_DATA for report in fitted.slices)
    up = np.array([0.0, 0.0, 1.0])
    assert (fitted.model.eval(up, up) < 1e-9).all()
    assert np.isnan(fitted.errors.rel_rms)


@pytest.mark.parametrize("options", [{}, {"method": "em"}, {"loss": "log"}, {"azimuthal": True}])
@pytest.mark.parametrize("n_lobes", [1, 3])
def test_lambert_is_flat(n_lobes, options):
    fitted = quiet_fit(constant(0.25), n_lobes, n_slices=6, **options)
    assert fitted.errors.rel_rms < 1e-6
    up, low = np.array([0.0, 0.0, 1.0]), np.array([0.8, 0.0, 0.6])
    np.testing.assert_allclose(fitted.model.eval([up, low], [up, low]), 0.25, rtol=1e-5)
    if n_lobes == 1:
        assert (fitted.model.gamma < 1e-5).all()


@pytest.mark.parametrize("n_lobes", [1, "auto"])
def test_nothing_valid_is_an_error(n_lobes):
    measured = constant(0.2)
    measured.planes[:] = -1.0
    with pytest.raises(ValueError, match=r"no slice has a valid sample after masking\. Lower 'min_theta_h'"):
        fit_slices(measured, n_lobes, n_slices=6)


@pytest.mark.parametrize("channels", [1, 5])
def test_any_number_of_channels(channels):
    tint = np.linspace(0.5, 1.5, channels)
    kappa, gamma, beta = map(np.array, KNOWN[2])
    truth = lobes(kappa, gamma, beta, tint=tint)
    fitted = fit_slices(of_model(truth, 6), 2, azimuthal=True, **EVERY_SAMPLE)
    assert fitted.model.kappa.shape == (6, channels, 2)
    np.testing.assert_allclose(fitted.model.kappa, truth.kappa, rtol=1e-6)
    assert [report.channel for report in fitted.slices] == list(range(channels)) * 6


@pytest.mark.parametrize("options", [{}, {"method": "em"}, {"loss": "log"}])
def test_ten_lobes(options):
    fitted = quiet_fit(built_in("paint-two-lobe", (90, 6, 24)), 10, n_slices=6, **options)
    assert fitted.model.n_lobes == 10
    assert np.isfinite(fitted.model.eval([0.0, 0.0, 1.0], [0.6, 0.0, 0.8])).all()


@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 1), (1, 3, 4), (4, 2, 1), (3, 3, 3)])
@pytest.mark.parametrize("options", [{}, {"method": "em"}, {"loss": "log"}, {"order": "kappa"}])
def test_small_tables(shape, options):
    measured = tabulate(materials.get("satin-plastic").reflectance, "", shape=shape)
    fitted = quiet_fit(measured, 2, n_slices=shape[1], perimeter_mask=False, **options)
    rounding = 1e-13 * fitted.errors.energy.max()
    np.testing.assert_allclose(
        fitted.errors.squares.ravel(), sums_of_squares(fitted), rtol=1e-9, atol=rounding
    )


# Adversarial profiles


@st.composite
def profiles(draw):
    """A few slices of a random number of points, values over many decades."""
    n_slices, n = draw(st.integers(1, 3)), draw(st.sampled_from([1, 2, 3, 8, 20]))
    low, high = sorted(draw(st.tuples(st.integers(-8, 6), st.integers(-8, 6))))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    phi_d = np.pi * (np.arange(draw(st.sampled_from([1, 2, 12]))) + 0.5) / 12
    theta_h = np.sort(rng.uniform(0.0, np.pi / 2, n))
    values = 10.0 ** rng.uniform(low, high, (n_slices, 1, n, len(phi_d)))
    if draw(st.booleans()):
        values = -np.sort(-values.mean(-1, keepdims=True), axis=2) + 0.0 * values
    values[rng.random(values.shape) < draw(st.sampled_from([0.0, 0.3]))] = np.nan
    theta_d = np.linspace(0.1, 1.4, n_slices)
    moments = twin.collapse(values, phi_d)
    return [SliceProfile(t, theta_h, m) for t, m in zip(theta_d, moments, strict=True)]


@settings(max_examples=150, deadline=None, derandomize=True, database=None)
@given(
    profiles(),
    st.integers(1, 4),
    st.booleans(),
    st.sampled_from(["l2", "log"]),
    st.sampled_from(["follow", "kappa"]),
)
def test_survives_any_profile(slices, n_lobes, azimuthal, loss, order):
    if not any(profile.count.any() for profile in slices):
        return
    (kappa, gamma, beta), reports = fit_profiles(slices, n_lobes, loss=loss, azimuthal=azimuthal, order=order)
    assert np.isfinite(kappa).all()
    assert (kappa > 0.0).all()
    assert np.isfinite(gamma).all()
    assert (gamma >= 0.0).all()
    assert (np.abs(beta) <= 1.0).all()
    assert azimuthal or not beta.any()
    objective = np.array([report.objective for report in reports])
    assert np.isfinite(objective).all()
    assert (objective >= 0.0).all()
    if loss == "l2":
        _, em = fit_profiles(slices, n_lobes, method="em", order=order)
        energy = np.array([profile.energy[0] for profile in slices])
        assert (objective <= np.array([report.objective for report in em]) + 1e-12 * energy).all()
