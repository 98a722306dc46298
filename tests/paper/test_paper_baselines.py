"""The paper's competitors: they find their own parameters, are reflectances, and are measured alike."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize
from tables import built_in, quiet_fit

from dsbrdf import half_diff, tabulate
from dsbrdf.baselines import GGXPair, fit_bivariate, fit_ggx_pair
from dsbrdf.paper import baselines as bl
from dsbrdf.paper import slice_profiles
from dsbrdf.paper.baselines import lambert_torrance_sparrow, von_mises_fisher
from dsbrdf.paper.baselines._samples import gather_samples
from dsbrdf.paper.collapse import slice_mask, slice_rows

SHAPE = (90, 18, 36)
FEW = (45, 18, 12)
ANGLES = np.pi / 2 * (np.arange(18) + 0.5) / 18

TORRANCE_SPARROW = bl.LambertTorranceSparrow(
    albedo=np.array([0.3, 0.1, 0.05]),
    lobe_albedo=np.array([[0.04, 0.1], [0.02, 0.3], [0.5, 0.2]]),
    roughness=np.array([[0.05, 0.3], [0.08, 0.2], [0.1, 0.6]]),
    name="known",
)
VON_MISES_FISHER = bl.VonMisesFisher(
    ANGLES,
    np.array([2.0, 0.5, 0.1]) * (1.0 + ANGLES)[:, None, None] * np.array([[1.0], [0.6], [0.3]]),
    np.array([900.0, 30.0, 0.8]) * (1.0 + 0.3 * ANGLES)[:, None, None] * np.ones((3, 1)),
    "known",
)


def table_of(model, shape=SHAPE, **options):
    return tabulate(model.eval, "known", shape=shape, **options)


def random_pairs(rng, n):
    """Directions over the whole sphere."""
    pairs = rng.standard_normal((2, n, 3))
    return pairs / np.linalg.norm(pairs, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def table_models():
    """The tabulated baselines of a small material."""
    return [bl.fit_interpolation(built_in("glossy-plastic"), theta_h_step=3)]


@pytest.fixture(scope="module")
def every_model(table_models):
    return [TORRANCE_SPARROW, VON_MISES_FISHER, *table_models]


# The interface


def test_reciprocal_to_the_last_bit(every_model, rng):
    wi, wo = random_pairs(rng, 2000)
    for model in every_model:
        np.testing.assert_array_equal(model.eval(wi, wo), model.eval(wo, wi), err_msg=model.label)


def test_positive_above_the_horizon_and_zero_below(every_model, rng):
    wi, wo = random_pairs(rng, 4000)
    above = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    for model in every_model:
        values = model.eval(wi, wo)
        assert values.shape == (4000, 3)
        assert (values[above] > 0.0).all(), model.label
        assert (values[~above] == 0.0).all(), model.label


def test_finite_at_the_ends(every_model):
    x, z = np.eye(3)[[0, 2]]
    grazing = np.array([np.sqrt(1.0 - 1e-24), 0.0, 1e-12])
    for model in every_model:
        for wi, wo in [(x, x), (x, -x), (z, z), (z, -z), (x, z), (grazing, grazing), (grazing, -x), (-z, -z)]:
            values = model.eval(wi, wo)
            assert values.shape == (3,)
            assert np.isfinite(values).all(), (model.label, wi, wo)
            assert (values >= 0.0).all()


def test_angles_are_directions(every_model, rng):
    theta_h, theta_d, phi_d = rng.uniform(0.0, [[1.0], [1.2], [np.pi]], (3, 50))
    wi, wo = half_diff.to_directions(theta_h, theta_d, phi_d)
    for model in every_model:
        np.testing.assert_array_equal(model.eval_angles(theta_h, theta_d, phi_d), model.eval(wi, wo))
        assert model.eval(wi[:, None], wo[:4]).shape == (50, 4, 3)


def test_bad_arguments_are_refused(every_model):
    for model in every_model:
        with pytest.raises(ValueError, match="'wi' must be unit vectors"):
            model.eval([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])
        with pytest.raises(ValueError, match=r"Degrees\? Use numpy\.deg2rad"):
            model.eval_angles(30.0, 0.1, 0.1)


def test_names_and_numbers_of_parameters(every_model):
    assert [model.n_parameters for model in every_model[:2]] == [15, 18 * 3 * 6]
    kept = slice_mask(built_in("glossy-plastic"), np.arange(18), np.deg2rad(1.0), True, 3)
    assert every_model[2].n_parameters == 3 * kept.sum()
    assert len({model.label for model in every_model}) == 3
    assert [model.name for model in every_model] == ["known", "known", "glossy-plastic"]


# Formulas


def test_torrance_sparrow_is_the_textbook_formula(rng):
    wi, wo = np.abs(random_pairs(rng, 300))
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
    cos_h, cos_i, cos_o, along = half[:, 2], wi[:, 2], wo[:, 2], (wi * half).sum(-1)
    shadowing = np.minimum(1.0, np.minimum(2.0 * cos_h * cos_i / along, 2.0 * cos_h * cos_o / along))
    tan_sq = np.tan(np.arccos(cos_h)) ** 2
    values = TORRANCE_SPARROW.eval(wi, wo)
    for channel in range(3):
        expected = np.full(300, TORRANCE_SPARROW.albedo[channel] / np.pi)
        for a, m in zip(
            TORRANCE_SPARROW.lobe_albedo[channel], TORRANCE_SPARROW.roughness[channel], strict=True
        ):
            density = np.exp(-tan_sq / m**2) / (np.pi * m**2 * cos_h**4)
            expected += a * density * shadowing / (4.0 * cos_i * cos_o)
        np.testing.assert_allclose(values[:, channel], expected, rtol=1e-9)


@pytest.mark.parametrize("theta", [0.0, 0.8, 1.5])
@pytest.mark.parametrize("roughness", [0.1, 0.5])
def test_torrance_sparrow_lobe_reflects_at_most_what_it_gets(theta, roughness):
    lobe = bl.LambertTorranceSparrow(np.zeros(1), np.ones((1, 1)), np.full((1, 1), roughness))
    z, phi = (np.arange(400) + 0.5) / 400, 2.0 * np.pi * (np.arange(400) + 0.5) / 400
    z, phi = z[:, None], phi[None, :]
    radius = np.sqrt(1.0 - z * z)
    wo = np.stack(np.broadcast_arrays(radius * np.cos(phi), radius * np.sin(phi), z), axis=-1)
    values = lobe.eval([np.sin(theta), 0.0, np.cos(theta)], wo)[..., 0]
    reflected = (values * z).mean() * 2.0 * np.pi
    assert reflected <= 1.001
    if theta == 0.0 and roughness == 0.1:
        assert reflected == pytest.approx(1.0, abs=0.01)


def test_von_mises_fisher_interpolates_values_between_slices():
    theta_h = np.linspace(0.0, 0.3, 7)
    between = 0.3 * ANGLES[4] + 0.7 * ANGLES[5]
    amplitude, kappa = VON_MISES_FISHER.amplitude, VON_MISES_FISHER.kappa
    depth = (np.cos(theta_h) - 1.0)[:, None, None]
    at = [(amplitude[s] * np.exp(kappa[s] * depth)).sum(-1) for s in (4, 5, 17)]
    value = VON_MISES_FISHER.eval_angles(theta_h, between, 0.4)
    np.testing.assert_allclose(value, 0.3 * at[0] + 0.7 * at[1], rtol=1e-9)
    beyond = VON_MISES_FISHER.eval_angles(theta_h[:1], np.pi / 2, np.pi / 2)
    np.testing.assert_allclose(beyond, at[2][:1], rtol=1e-9)


# Recovery


@pytest.mark.parametrize("convention", ["centre", "edge"])
def test_finds_torrance_sparrow_lobes(convention):
    measured = table_of(TORRANCE_SPARROW, convention=convention)
    found = bl.fit_lambert_torrance_sparrow(measured)
    np.testing.assert_allclose(found.albedo, TORRANCE_SPARROW.albedo, rtol=1e-5)
    np.testing.assert_allclose(found.lobe_albedo, TORRANCE_SPARROW.lobe_albedo, rtol=1e-5)
    np.testing.assert_allclose(found.roughness, TORRANCE_SPARROW.roughness, rtol=1e-5)
    assert bl.errors(found, measured).rel_rms < 1e-7
    assert found.name == "known"


def test_finds_ggx_lobes_by_least_squares():
    """And no step from there is better; what is fitted to the whole hemisphere is worse on the slices."""
    truth = GGXPair(
        np.array([0.3, 0.1, 0.02]),
        np.array([[0.05, 0.02], [0.3, 0.1], [0.5, 0.3]]),
        np.array([0.8, 0.3]),
        np.array([0.06, 0.4]),
        "known",
    )
    measured = table_of(truth)
    found = bl.fit_ggx_pair(measured)
    assert bl.errors(found, measured).rel_rms < 1e-3
    np.testing.assert_allclose(found.alpha, truth.alpha, rtol=0.02)
    for name in ("glossy-plastic", "rough-gold"):
        measured = built_in(name, FEW)
        found = bl.fit_ggx_pair(measured)
        best = bl.errors(found, measured).rel_rms
        assert best <= bl.errors(fit_ggx_pair(measured), measured).rel_rms
        assert best < bl.errors(bl.fit_lambert_torrance_sparrow(measured), measured).rel_rms
        for part in ("albedo", "f0", "f90", "alpha"):
            for factor in (0.97, 1.03):
                other = dataclasses.replace(found, **{part: factor * getattr(found, part)})
                assert best <= bl.errors(other, measured).rel_rms * (1.0 + 1e-3)


@pytest.mark.parametrize("n_lobes", [1, 2, 3])
def test_finds_von_mises_fisher_lobes(n_lobes):
    parts = {key: getattr(VON_MISES_FISHER, key)[..., :n_lobes] for key in ("amplitude", "kappa")}
    truth = dataclasses.replace(VON_MISES_FISHER, **parts)
    measured = table_of(truth)
    found = bl.fit_von_mises_fisher(measured, n_lobes)
    # Towards grazing too little of the wide lobe is left to tell its parameters, yet its values fit
    assert bl.errors(found, measured).rel_rms < 1e-6
    np.testing.assert_allclose(found.kappa[:9], truth.kappa[:9], rtol=1e-3)
    np.testing.assert_allclose(found.amplitude[:9], truth.amplitude[:9], rtol=1e-3)
    np.testing.assert_array_equal(found.theta_d, measured.theta_d)


def test_more_lobes_fit_better():
    measured = built_in("rough-gold")
    fits = [bl.fit_von_mises_fisher(measured, n, n_slices=6) for n in (1, 2, 3)]
    left = [bl.errors(fitted, measured, n_slices=6).squares for fitted in fits]
    assert (left[1] <= left[0] * (1.0 + 1e-9)).all()
    assert (left[2] <= left[1] * (1.0 + 1e-9)).all()
    assert left[2].sum() < 0.5 * left[0].sum()


@pytest.mark.parametrize("name", ["glossy-plastic", "rough-gold"])
def test_no_random_start_beats_torrance_sparrow(name, rng):
    """Against all five parameters at once, over the raw samples, from starts all over their range."""
    measured = built_in(name, FEW)
    fitted = bl.fit_lambert_torrance_sparrow(measured)
    left = bl.errors(fitted, measured).squares.sum(0)[0]
    rows = slice_rows(18)
    mask = slice_mask(measured, rows, np.deg2rad(1.0), True, 1)
    f = np.moveaxis(measured.rows(rows)[0], 1, 0)[mask]
    d, h = np.nonzero(mask)
    unit = np.ones((1, 1))
    wide = bl.LambertTorranceSparrow(np.zeros(1), unit, 2.0 * unit)
    angles = measured.theta_h[h, None], measured.theta_d[d, None], measured.phi_d
    tan_sq = np.tan(angles[0]) ** 2

    def facets(m):
        return np.exp(-tan_sq / m**2) / (m * np.cos(angles[0]) ** 2) ** 2 / np.pi

    shadowing = wide.eval_angles(*angles)[..., 0] / facets(2.0)

    def residual(x):
        albedo, a, b, m, n = np.exp(x)
        return (albedo / np.pi + (a * facets(m) + b * facets(n)) * shadowing - f).ravel()

    low, high = np.log([1e-4] * 3 + [0.005] * 2), np.log([1e2] * 3 + [2.0] * 2)
    for _ in range(3):
        start = np.log(np.concatenate([rng.uniform(0.01, 1.0, 3), np.exp(rng.uniform(-4.0, 0.0, 2))]))
        found = optimize.least_squares(residual, start, bounds=(low, high), max_nfev=40)
        assert left <= 2.0 * found.cost * (1.0 + 1e-6)


def test_lobes_of_von_mises_fisher_start_where_they_fit_best():
    """Of all pairs in a list none is better than the pair that exchange finds."""
    depth = np.cos(np.linspace(0.0, 1.5, 60)) - 1.0
    columns = np.exp(np.geomspace(0.1, 1e4, 12) * depth[:, None])
    for pair in [(0, 11), (3, 4), (5, 9), (10, 11)]:
        for third in (2, 7):
            target = columns[:, pair].sum(1) + 0.1 * columns[:, third]
            costs = {
                (i, j): optimize.nnls(columns[:, [i, j]], target)[1] for j in range(12) for i in range(j)
            }
            found = tuple(sorted(von_mises_fisher._exchange(columns, target, 2)))
            assert costs[found] <= min(costs.values()) * (1.0 + 1e-9)


def test_pairs_of_torrance_sparrow_start_where_they_fit_best(rng):
    """The first start is the best pair of all, and none is near another."""
    tan_sq = np.linspace(0.01, 1.5, 60) ** 2
    columns = np.exp(-tan_sq[:, None] / np.geomspace(0.02, 2.0, 14) ** 2)
    columns = np.concatenate([np.ones((60, 1)), columns], axis=1)
    for _ in range(5):
        target = columns @ rng.exponential(1.0, 15) * (rng.random(60) + 0.5)
        costs = {
            (i, j): optimize.nnls(columns[:, [0, i + 1, j + 1]], target)[1]
            for j in range(14)
            for i in range(j)
        }
        starts = lambert_torrance_sparrow._best_pairs(columns, target)
        assert costs[starts[0]] <= min(costs.values()) * (1.0 + 1e-6)
        assert np.diff([costs[start] for start in starts]).min() >= -1e-6
        assert all(np.abs(np.subtract(a, b)).max() > 2 for a in starts for b in starts if a is not b)


# Tables


@pytest.mark.parametrize("options", [{}, {"perimeter_mask": False, "min_theta_h": 0.0}])
def test_bivariate_error_is_the_floor(options):
    measured = built_in("rough-gold")
    errors = bl.errors(fit_bivariate(measured), measured, n_slices=18, **options)
    assert errors.rel_rms == pytest.approx(errors.bivariate_floor, rel=1e-10)
    np.testing.assert_allclose(errors.squares, errors.bivariate, rtol=1e-8)


@pytest.mark.parametrize("step", [1, 2, 5])
def test_interpolation_is_exact_at_kept_samples_and_linear_between(step):
    measured = built_in("glossy-plastic")
    model = bl.fit_interpolation(measured, theta_h_step=step)
    for row, profile in enumerate(slice_profiles(measured, theta_h_step=step)):
        some = profile.count[0] > 0.0
        if not some.any():
            continue
        nodes, mean = profile.theta_h[some], profile.mean[:, some].T
        values = model.eval_angles(nodes, measured.theta_d[row], 0.5 * np.pi)
        np.testing.assert_allclose(values, mean, rtol=1e-9)
        theta_h = np.linspace(0.0, nodes[-1] + 0.3 * (np.pi / 2 - nodes[-1]), 40)
        expected = np.stack([np.interp(theta_h, nodes, mean[:, channel]) for channel in range(3)], axis=-1)
        at = model.eval_angles(theta_h, measured.theta_d[row], 0.5 * np.pi)
        np.testing.assert_allclose(at, expected, rtol=1e-8)


def test_interpolation_of_all_samples_reaches_the_floor_and_of_fewer_does_not():
    measured = built_in("glossy-plastic")
    all_errors = [
        bl.errors(bl.fit_interpolation(measured, theta_h_step=step), measured) for step in (1, 2, 4, 8)
    ]
    assert all_errors[0].rel_rms == pytest.approx(all_errors[0].bivariate_floor, rel=1e-10)
    assert (np.diff([errors.rel_rms for errors in all_errors]) > 0.0).all()


# One measure of error


@pytest.mark.parametrize(
    "options",
    [{}, {"n_slices": 6}, {"min_theta_h": 0.2, "theta_h_step": 2}, {"perimeter_mask": False, "n_slices": 9}],
)
def test_errors_of_a_model_are_those_of_its_fit(options, damaged_table):
    # The damaged table has entries below the horizon, where lobes go on and reflectances end
    inside = options.get("perimeter_mask", True)
    for measured in (built_in("rough-gold"), *[damaged_table] * inside):
        fitted = quiet_fit(measured, 2, **options)
        errors = bl.errors(fitted.model, measured, **options)
        assert errors.rel_rms == pytest.approx(fitted.errors.rel_rms, rel=1e-9)
        np.testing.assert_allclose(errors.slice_rel_rms, fitted.errors.slice_rel_rms, atol=1e-9)
        for floor in ("bivariate_floor", "monotone_floor", "azimuthal_floor"):
            assert getattr(errors, floor) == getattr(fitted.errors, floor)


def test_errors_are_those_of_brute_force(damaged_table):
    model = bl.fit_lambert_torrance_sparrow(damaged_table)
    squares = energy = 0.0
    for d in slice_rows(len(damaged_table.theta_d)):
        for h, theta_h in enumerate(damaged_table.theta_h):
            if theta_h < np.deg2rad(1.0) or theta_h >= np.pi / 2 - damaged_table.theta_d[d]:
                continue
            for p, phi_d in enumerate(damaged_table.phi_d):
                value = model.eval_angles(theta_h, damaged_table.theta_d[d], phi_d)
                f = damaged_table.values[h, d, p]
                squares += ((value - f)[np.isfinite(f)] ** 2).sum()
                energy += (f[np.isfinite(f)] ** 2).sum()
    errors = bl.errors(model, damaged_table)
    assert errors.rel_rms == pytest.approx(np.sqrt(squares / energy), rel=1e-9)


def test_fits_minimise_these_errors(damaged_table):
    """Also with invalid samples strewn in, a step in any direction goes up."""
    # Outside the perimeter mask some entries lie below the horizon
    options = {"perimeter_mask": False}
    fitted = bl.fit_lambert_torrance_sparrow(damaged_table, **options)
    best = bl.errors(fitted, damaged_table, **options).squares.sum()
    for name in ("albedo", "lobe_albedo", "roughness"):
        values = getattr(fitted, name)
        for index in np.ndindex(values.shape):
            for factor in (0.97, 1.03):
                changed = values.copy()
                changed[index] *= factor
                other = dataclasses.replace(fitted, **{name: changed})
                left = bl.errors(other, damaged_table, **options).squares.sum()
                assert best <= left * (1.0 + 1e-9)


# Samples


@pytest.mark.parametrize("convention", ["centre", "edge"])
@pytest.mark.parametrize("options", [{}, {"n_slices": 6, "perimeter_mask": False, "theta_h_step": 2}])
def test_samples_are_those_of_the_profiles(convention, options, damaged_table, make_table):
    measured = damaged_table if convention == "centre" else make_table(convention="edge")
    samples = gather_samples(measured, **options)
    n_phi = measured.planes.shape[-1]
    assert samples.wi.shape[1] == (n_phi // 2 if convention == "centre" else n_phi // 2 + 1)
    profiles = slice_profiles(measured, **options)
    for profile in profiles:
        some = samples.theta_d == profile.theta_d
        index = np.searchsorted(profile.theta_h, samples.theta_h[some])
        moments = profile.moments[:, index]
        np.testing.assert_array_equal(samples.count[some].sum(1).T, moments[..., 0])
        np.testing.assert_allclose(samples.total[some].sum(1).T, moments[..., 1], rtol=1e-12)
    # Same azimuths but for symmetry: the sums with cos(2 phi_d) agree too
    _, theta_d, phi_d = half_diff.from_directions(samples.wi, samples.wo)
    weighted = (np.cos(2.0 * phi_d)[..., None] * samples.total).sum(1)
    expected = np.concatenate([profile.moments[:, profile.count.any(0), 5].T for profile in profiles])
    some = samples.theta_d > 0.0
    np.testing.assert_allclose(weighted[some], expected[some], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(theta_d, np.broadcast_to(samples.theta_d[:, None], theta_d.shape), atol=1e-12)


FITS = [
    bl.fit_ggx_pair,
    bl.fit_lambert_torrance_sparrow,
    bl.fit_von_mises_fisher,
    bl.fit_interpolation,
]


@pytest.mark.parametrize("fit_baseline", FITS)
def test_without_a_sample_there_is_no_fit(fit_baseline, small_table):
    empty = dataclasses.replace(small_table, planes=np.full_like(small_table.planes, -1.0))
    with pytest.raises(ValueError, match="no slice has a valid sample"):
        fit_baseline(empty)


@pytest.mark.parametrize("fit_baseline", FITS)
def test_slices_without_a_sample_and_black_channels(fit_baseline, small_table, rng):
    planes = small_table.planes.copy()
    planes[:, :, 5] = -1.0
    planes[1] = np.where(planes[1] > 0.0, 0.0, planes[1])
    planes[2, :, 7:] = -1.0
    measured = dataclasses.replace(small_table, planes=planes)
    model = fit_baseline(measured)
    wi, wo = np.abs(random_pairs(rng, 500))
    values = model.eval(wi, wo)
    assert np.isfinite(values).all()
    assert (values >= 0.0).all()
    if fit_baseline is not bl.fit_ggx_pair:  # Schlick's term is there whatever F0 is
        assert (values[:, 1] == 0.0).all()
    assert np.isfinite(bl.errors(model, measured).rel_rms)


@pytest.mark.parametrize("fit_baseline", FITS)
@pytest.mark.parametrize("n_channels", [1, 4])
def test_any_number_of_channels(fit_baseline, n_channels, make_table):
    measured = make_table(n_channels)
    model = fit_baseline(measured)
    assert model.eval([0.0, 0.0, 1.0], [0.6, 0.0, 0.8]).shape == (n_channels,)
    assert bl.errors(model, measured).squares.shape == (18, n_channels)


def test_bad_options_are_refused(small_table):
    with pytest.raises(ValueError, match="'n_lobes' must be at least 1, got 0"):
        bl.fit_von_mises_fisher(small_table, 0)
    with pytest.raises(ValueError, match="'theta_h_step' must be at least 1"):
        bl.fit_interpolation(small_table, theta_h_step=0)
    with pytest.raises(ValueError, match="'n_slices' must be between 1"):
        bl.errors(TORRANCE_SPARROW, small_table, n_slices=99)


@pytest.mark.parametrize("name", ["glossy-plastic", "rough-gold", "grey-primer"])
def test_the_model_beats_lambert_and_torrance_sparrow(name):
    """Fig. 7: three lobes a slice against three for all."""
    measured = built_in(name, FEW)
    fitted = bl.fit_lambert_torrance_sparrow(measured)
    assert quiet_fit(measured, 3).errors.rel_rms < 0.5 * bl.errors(fitted, measured).rel_rms
