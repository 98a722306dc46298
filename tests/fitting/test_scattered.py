"""Scattered samples: which slice takes which, what is left out and filled, and how far the fit can be trusted."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scans import random_scan, samples_at
from tables import formula, known, quiet_fit

from dsbrdf import Samples, batch, cli, fit, half_diff, load
from dsbrdf.fitting import scattered
from dsbrdf.fitting.fit_scattered import FOLDS, SAMPLES_A_NUMBER, even_slices
from dsbrdf.measured import built_in


def in_plane_scan(model, noise=0.0, rng=None):
    """A goniometer's 198 directions: light from 0 to 75 degrees, view from -80 to 80."""
    light, view = np.meshgrid(np.deg2rad(np.arange(0, 80, 15)), np.deg2rad(np.arange(-80, 81, 5)))
    vectors = (np.stack([np.sin(t), 0.0 * t, np.cos(t)], axis=-1).reshape(-1, 3) for t in (light, view))
    wi, wo = vectors
    values = model(wi, wo)
    if noise:
        values = values * (1.0 + noise * rng.standard_normal(values.shape))
    return Samples("scan", wi, wo, values)


# Gathering


def test_each_sample_goes_to_the_nearest_slice(rng):
    scan = random_scan(300, rng, known(2, True).eval)
    slices = np.array([0.2, 0.5, 1.1])
    profiles = scattered.gather(scan, slices, min_theta_h=0.0, perimeter_mask=False)
    theta_h, theta_d, phi_d = half_diff.from_directions(scan.wi, scan.wo)
    nearest = np.argmin(np.abs(theta_d[:, None] - slices), axis=1)
    for i, profile in enumerate(profiles):
        of = nearest == i
        assert profile.theta_d == slices[i]
        assert_array_equal(profile.theta_h, np.unique(theta_h[of]))
        f, c = scan.values[of], np.cos(2.0 * phi_d[of])[:, None]
        for moment, terms in enumerate((0.0 * f + 1.0, f, f**2, 0.0 * f + c, c**2 + 0.0 * f, f * c)):
            assert_allclose(profile.moments[..., moment].sum(-1), terms.sum(0), rtol=1e-12)


@pytest.mark.parametrize("tolerance", [0.0, 0.05, None])
def test_what_is_farther_than_the_tolerance_is_left_out(rng, tolerance):
    scan = random_scan(300, rng, known(1, False).eval)
    theta_d = half_diff.from_directions(scan.wi, scan.wo)[1]
    slices = np.array([0.3, theta_d[0]]) if theta_d[0] > 0.3 else np.array([theta_d[0], 1.2])
    profiles = scattered.gather(scan, slices, tolerance, min_theta_h=0.0, perimeter_mask=False)
    limit = np.inf if tolerance is None else tolerance
    within = (np.abs(theta_d[:, None] - slices).min(1) <= limit).sum()
    assert sum(profile.count[0].sum() for profile in profiles) == within
    assert within >= 1


def test_masks_are_those_of_tables(rng):
    scan = random_scan(500, rng, known(1, False).eval)
    theta_h, theta_d, _ = half_diff.from_directions(scan.wi, scan.wo)
    low, edge = theta_h >= 0.2, theta_h < np.pi / 2 - theta_d

    def n_used(**masks):
        return sum(profile.count[0].sum() for profile in scattered.gather(scan, [0.5], **masks))

    assert n_used(min_theta_h=0.2) == (low & edge).sum()
    assert n_used(min_theta_h=0.2, perimeter_mask=False) == low.sum()
    assert n_used(min_theta_h=0.0) == edge.sum()


def test_weights_are_sums_of_samples():
    """A sample of weight two is two samples, but one in number."""
    model = known(2, False)
    once = samples_at(np.linspace(0.05, 1.2, 30), model.theta_d[1], 0.3, model.eval)
    weights = np.arange(len(once)) % 3 + 1.0
    weighted = dataclasses.replace(once, weights=weights)
    repeat = np.repeat(np.arange(len(once)), weights.astype(int))
    repeated = Samples("", once.wi[repeat], once.wo[repeat], once.values[repeat])
    (a,), (b,) = (scattered.gather(scan, model.theta_d[1:2]) for scan in (weighted, repeated))
    assert_allclose(a.moments, b.moments, rtol=1e-13)
    assert_array_equal(b.n_samples[0], weights)
    assert_array_equal(a.n_samples, np.ones_like(a.count))


@pytest.mark.parametrize("slices", [[], [0.5, 0.5], [0.5, 0.2], [[0.5]]])
def test_slices_must_ascend(slices, rng):
    scan = random_scan(10, rng, known(1, False).eval)
    with pytest.raises(ValueError, match="'theta_d' must be a non-empty ascending list of angles, got"):
        scattered.gather(scan, slices)


def test_no_slices():
    with pytest.raises(ValueError, match=r"'n_slices' must be at least 1, got 0\."):
        even_slices(0)


# The fit


@pytest.mark.parametrize("n_lobes", [1, 2])
def test_finds_known_lobes_on_the_slices(n_lobes, rng):
    truth = known(n_lobes, False)
    theta_h = np.pi / 2 * rng.random((6, 60)) ** 2
    scan = samples_at(theta_h, truth.theta_d[:, None], 2.0 * np.pi * rng.random((6, 60)), truth.eval)
    fitted = fit(scan, n_lobes, n_slices=6, perimeter_mask=False, strict=True)
    assert_allclose(fitted.model.theta_d, truth.theta_d)
    assert_allclose(fitted.model.kappa[:5], truth.kappa[:5], rtol=1e-6)
    assert_allclose(fitted.model.gamma[:5], truth.gamma[:5], rtol=1e-6)
    assert fitted.errors.rel_rms < 1e-7
    assert np.isnan(fitted.errors.bivariate_floor)


def test_the_azimuthal_term_on_request(rng):
    truth = known(1, True)
    theta_h = np.pi / 2 * rng.random((6, 60)) ** 2
    scan = samples_at(theta_h, truth.theta_d[:, None], 2.0 * np.pi * rng.random((6, 60)), truth.eval)
    assert not fit(scan, 1, n_slices=6).model.beta.any()
    fitted = fit(scan, 1, n_slices=6, azimuthal=True, perimeter_mask=False)
    assert_allclose(fitted.model.beta[:5], truth.beta[:5], atol=1e-6)


def test_weights_count(rng):
    """Samples of weight zero are not there; the others give the lobes."""
    truth = known(1, False)
    theta_h = np.pi / 2 * rng.random((6, 80)) ** 2
    scan = samples_at(theta_h, truth.theta_d[:, None], 0.2, truth.eval)
    spoilt = scan.values.copy()
    spoilt[::3] *= 5.0
    weights = np.where(np.arange(len(scan)) % 3 == 0, 0.0, 2.0)
    scan = Samples("", scan.wi, scan.wo, spoilt, weights)
    fitted = fit(scan, 1, n_slices=6, perimeter_mask=False)
    assert_allclose(fitted.model.kappa[:5], truth.kappa[:5], rtol=1e-6)
    assert fitted.coverage.held_out_rel_rms < 0.05


@pytest.mark.parametrize("n_channels", [1, 4])
def test_any_number_of_channels(n_channels, rng):
    def reflectance(wi, wo):
        return (0.2 + (wi + wo)[..., 2:] / 8.0) * np.arange(1, n_channels + 1)

    assert fit(random_scan(80, rng, reflectance)).model.n_channels == n_channels


def test_a_channel_may_miss_samples(rng):
    scan = random_scan(120, rng, known(1, False).eval)
    values = scan.values.copy()
    values[:60, 1] = np.nan
    values[:7] = np.nan
    fitted = quiet_fit(dataclasses.replace(scan, values=values), 1, perimeter_mask=False)
    assert fitted.coverage.left_out == {"invalid": 7}
    assert np.isfinite(fitted.model.kappa).all()


def test_a_goniometer_scan_gives_a_sensible_model(rng):
    """Of 198 directions in a plane with 3 % of noise; judged by other directions within reach of the scan."""
    for name in ("satin-plastic", "rough-gold", "matte"):
        reflectance = built_in.get(name).reflectance
        scan = in_plane_scan(reflectance, 0.03, rng)
        chosen, eager = quiet_fit(scan), quiet_fit(scan, 3, n_slices=18)
        others = random_scan(3000, rng, reflectance)
        theta_h, theta_d, _ = half_diff.from_directions(others.wi, others.wo)
        reached = theta_h + theta_d < np.deg2rad(75)

        def off(model, others=others, reached=reached):
            ratio = (model.eval(others.wi, others.wo) + 1e-3) / (others.values + 1e-3)
            return np.sqrt((np.log(ratio[reached]) ** 2).mean())

        assert off(chosen.model) < 0.35
        assert off(chosen.model) < off(eager.model)
        assert chosen.coverage.held_out_log_rms < 0.25
        assert chosen.model.albedo(np.deg2rad([0.0, 45.0])).max() < 1.2


def test_numbers_are_bounded_by_samples(rng):
    for n in (4, 12, 40, 150):
        fitted = quiet_fit(random_scan(n, rng, known(2, False).eval))
        n_slices, n_lobes = len(fitted.model.theta_d), fitted.model.n_lobes
        assert n_slices * n_lobes == 1 or 2 * n_slices * n_lobes * SAMPLES_A_NUMBER <= fitted.coverage.n_used
        assert np.isfinite(fitted.model.eval([0.0, 0.0, 1.0], [0.6, 0.0, 0.8])).all()


def test_the_choice_is_that_of_held_out_error(rng):
    scan = random_scan(200, rng, built_in.get("satin-plastic").reflectance, 0.03)
    fitted = quiet_fit(scan)
    chosen = fitted.selection
    assert chosen.criterion == "held-out"
    assert chosen.values.argmin() + 1 == chosen.n_lobes == fitted.model.n_lobes
    assert chosen.values.min() == fitted.coverage.held_out_log_rms
    for n_slices in (1, 18):
        other = quiet_fit(scan, fitted.model.n_lobes, n_slices=n_slices)
        assert other.selection is None
        assert fitted.coverage.held_out_log_rms <= other.coverage.held_out_log_rms
    assert quiet_fit(scan).model.kappa.tobytes() == fitted.model.kappa.tobytes()


def test_held_out_error_is_that_of_samples_not_fitted(rng):
    """Fold by fold, by hand."""
    truth = known(1, False)
    theta_h = np.sort(np.pi / 2 * rng.random((6, 20)) ** 2)
    scan = samples_at(theta_h, truth.theta_d[:, None] - 0.01, 0.4, truth.eval, 0.1, rng)
    options = {"n_slices": 6, "perimeter_mask": False}
    angles = half_diff.from_directions(scan.wi, scan.wo)
    fold = np.empty(len(scan), int)
    fold[np.lexsort(angles[:2])] = np.arange(len(scan)) % FOLDS
    predicted = np.empty_like(scan.values)
    for out in range(FOLDS):
        some = fold != out
        model = quiet_fit(Samples("", scan.wi[some], scan.wo[some], scan.values[some]), 1, **options).model
        predicted[~some] = model.eval(scan.wi[~some], scan.wo[~some])
    coverage = quiet_fit(scan, 1, **options).coverage
    log = np.log((predicted + 1e-3) / (scan.values + 1e-3))
    assert_allclose(coverage.held_out_log_rms, np.sqrt((log**2).mean()), rtol=1e-6)
    relative = np.sqrt(((predicted - scan.values) ** 2).sum() / (scan.values**2).sum())
    assert_allclose(coverage.held_out_rel_rms, relative, rtol=1e-6)


# What is left out and filled


def test_coverage_tells_what_became_of_each_sample(rng):
    scan = random_scan(400, rng, known(1, False).eval)
    theta_h, theta_d, _ = half_diff.from_directions(scan.wi, scan.wo)
    fitted = quiet_fit(scan, 1, n_slices=3, tolerance=0.1, min_theta_h=0.05)
    coverage = fitted.coverage
    low = theta_h < 0.05
    edge = ~low & (theta_h >= np.pi / 2 - theta_d)
    far = ~low & ~edge & (np.abs(theta_d[:, None] - fitted.model.theta_d).min(1) > 0.1)
    assert coverage.left_out == {
        "near the pole": low.sum(),
        "perimeter": edge.sum(),
        "far from every slice": far.sum(),
    }
    assert coverage.n_samples == len(scan)
    assert coverage.n_used == len(scan) - sum(coverage.left_out.values())
    assert_array_equal(coverage.per_slice, [p.count[0].sum() for p in fitted.profiles])
    assert fitted.summary()["samples_used"] == coverage.n_used
    assert fitted.model.fit_options["tolerance"] == 0.1


def with_gaps(rng):
    truth = known(2, True)
    theta_d = np.repeat(truth.theta_d[[1, 4]], 60)
    scan = samples_at(np.pi / 2 * rng.random(120) ** 2, theta_d, 2 * np.pi * rng.random(120), truth.eval)
    return truth, scan, {"n_slices": 6, "perimeter_mask": False, "azimuthal": True}


def test_slices_without_a_sample_take_the_nearest(rng):
    _, scan, options = with_gaps(rng)
    fitted = quiet_fit(scan, 2, **options)
    assert_array_equal(fitted.coverage.per_slice == 0, [True, False, True, True, False, True])
    for name in ("kappa", "gamma", "beta"):
        values = getattr(fitted.model, name)
        assert_array_equal(values, values[[1, 1, 1, 4, 4, 4]])


def test_slices_without_a_sample_are_interpolated(rng):
    truth, scan, options = with_gaps(rng)
    model = quiet_fit(scan, 2, fill="linear", **options).model
    assert_array_equal(model.kappa[[0, 5]], model.kappa[[1, 4]])
    assert_allclose(model.kappa[2] ** 3, model.kappa[1] ** 2 * model.kappa[4], rtol=1e-10)
    assert_allclose(model.gamma[3] ** 3, model.gamma[1] * model.gamma[4] ** 2, rtol=1e-10)
    assert_allclose(model.beta[3], (model.beta[1] + 2.0 * model.beta[4]) / 3.0, rtol=1e-10)
    assert_allclose(model.kappa[1:5], truth.kappa[1:5], rtol=0.05)


def test_lobes_stay_themselves_across_a_gap(rng):
    truth, scan, options = with_gaps(rng)
    model = quiet_fit(scan, 2, fill="linear", **options).model
    value = formula(0.3, truth.theta_d[2], 0.7, truth.kappa[2], truth.gamma[2], truth.beta[2])
    assert_allclose(model.eval_angles(0.3, truth.theta_d[2], 0.7), value, rtol=0.05)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"fill": "zero"}, r"'fill' must be 'nearest' or 'linear', got 'zero'\."),
        (
            {"criterion": "bic"},
            r"'criterion' must be 'held-out' for scattered samples, got 'bic': the other two",
        ),
        ({"theta_h_step": 2}, r"'theta_h_step' is for tables, got 2 for scattered samples\."),
        ({"n_slices": 0}, r"'n_slices' must be at least 1, got 0\."),
        ({"n_lobes": 11}, r"'n_lobes' must be between 1 and 10, or 'auto', got 11\."),
        ({"min_theta_h": 1.5}, r"no slice has a valid sample after masking"),
    ],
)
def test_says_what_is_wrong_with_an_option(options, text, rng):
    with pytest.raises(ValueError, match=text):
        fit(random_scan(30, rng, known(1, False).eval), **options)


def test_a_tolerance_is_not_for_tables(small_table):
    with pytest.raises(
        ValueError, match="'tolerance' is for scattered samples: the slices of a table are rows"
    ):
        fit(small_table, 1, tolerance=0.1)


def test_one_sample():
    up = [[0.0, 0.0, 1.0]]
    fitted = quiet_fit(Samples("", up, up, [[0.3]]))
    assert_allclose(fitted.model.eval(up, up), 0.3, rtol=1e-6)
    assert np.isnan(fitted.coverage.held_out_log_rms)


def test_black(rng):
    fitted = fit(random_scan(50, rng, lambda wi, _: 0.0 * wi))
    assert (fitted.model.eval([0.0, 0.0, 1.0], [0.0, 0.6, 0.8]) < 1e-9).all()


# The command


def write_scan(path, scan):
    angles = [np.arccos(scan.wi[:, 2]), np.arctan2(scan.wi[:, 1], scan.wi[:, 0])]
    angles += [np.arccos(scan.wo[:, 2]), np.arctan2(scan.wo[:, 1], scan.wo[:, 0])]
    columns = np.column_stack([np.rad2deg(np.array(angles).T), scan.values])
    header = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,r,g,b"
    np.savetxt(path, columns, delimiter=",", header=header, comments="")


def test_a_scan_from_a_file(tmp_path, capsys, rng):
    write_scan(tmp_path / "scan.csv", in_plane_scan(built_in.get("matte").reflectance, 0.02, rng))
    assert cli.main(["fit", str(tmp_path / "scan.csv"), "-o", str(tmp_path / "out")]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "scan: 198 of 198 samples in" in out
    assert "Samples held out are missed by a factor of 1." in out
    assert load(tmp_path / "out" / "scan.json").fit_options["fill"] == "nearest"


def test_the_criterion_can_be_chosen(capsys):
    assert cli.main(["fit", "matte", "--slices", "6", "--criterion", "bic"]) == 0
    assert "BIC" in capsys.readouterr().out
    assert cli.main(["fit", "matte", "--criterion", "aic"]) == 2
    assert "'aic' is not one of 'williams', 'bic', 'held-out'" in capsys.readouterr().err


@pytest.mark.shared
def test_high_floors_are_named(data, capsys):
    files = [str(data / "data" / "rgl" / f"{name}_rgb.bsdf") for name in ("chm_orange", "vch_silk_blue")]
    assert cli.main(["fit", *files, "--lobes", "3"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "chm_orange_rgb: high bivariate floor, 66.41 %: it depends on more than theta_h and theta_d." in out
    )
    assert "% no model of this kind can remove." in out
    assert "vch_silk_blue_rgb: high" not in out


def test_figures_need_a_table(tmp_path, capsys):
    scan = in_plane_scan(built_in.material("matte").eval)
    path, out = tmp_path / "scan.csv", tmp_path / "out"
    write_scan(path, scan)
    assert cli.main(["fit", str(path), "-o", str(out), "--plot", "--view"]) == 0
    text = (
        f"warning: scan: no figures: they show a measured table, and these are {len(scan)} scattered samples."
    )
    assert capsys.readouterr().err.count(text) == 1
    assert sorted(file.suffix for file in out.iterdir()) == [".html", ".json"]
    with pytest.raises(ValueError, match="or make a table with 'dsbrdf convert'"):
        _ = quiet_fit(scan).table


def test_scans_without_figures_are_kept(tmp_path):
    scan = tmp_path / "scan.csv"
    write_scan(scan, in_plane_scan(built_in.material("matte").eval))
    options = {"plots": True, "n_lobes": 1, "n_slices": 3}
    with pytest.warns(UserWarning, match="scan: no figures: they show a measured table, and these are 198"):
        batch.fit_many([scan], tmp_path / "out", **options)
    assert batch.fit_many([scan], tmp_path / "out", **options)[0].kept
