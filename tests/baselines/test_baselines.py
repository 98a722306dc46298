"""The other models: they find their own parameters, are reflectances, and no search finds better ones."""

import dataclasses

import numpy as np
import pytest
from tables import built_in

from dsbrdf import Samples, half_diff, read, tabulate
from dsbrdf import baselines as bl
from dsbrdf.baselines import fresnel, microfacet
from dsbrdf.fitting.metrics import errors
from dsbrdf.measured import reflectance

FEW = (45, 18, 12)
GGX = bl.LambertGGX(
    np.array([0.3, 0.1, 0.02]), np.array([[0.04], [0.3], [0.9]]), np.ones(1), np.array([0.15]), "known"
)
FRESNEL = bl.FresnelGGX(
    np.array([0.3, 0.1, 0.02]), np.array([1.5, 0.4, 2.0]), np.array([0.05, 2.0, 3.0]), 0.15, "known"
)
PAIR = bl.GGXPair(
    np.array([0.3, 0.1, 0.02]),
    np.array([[0.05, 0.02], [0.3, 0.1], [0.5, 0.3]]),
    np.array([0.8, 0.3]),
    np.array([0.06, 0.4]),
    "known",
)


def random_pairs(rng, n):
    """Directions over the whole sphere."""
    pairs = rng.standard_normal((2, n, 3))
    return pairs / np.linalg.norm(pairs, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def every_model():
    return [GGX, FRESNEL, PAIR, bl.fit_bivariate(built_in("glossy-plastic"))]


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
        with pytest.raises(ValueError, match="'wi' must be unit vectors"):
            model.eval([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])
        with pytest.raises(ValueError, match=r"Degrees\? Use numpy\.deg2rad"):
            model.eval_angles(30.0, 0.1, 0.1)


def test_names_and_numbers_of_parameters(every_model):
    valid = built_in("glossy-plastic").valid.any(2).sum()
    assert [model.n_parameters for model in every_model] == [7, 10, 13, valid]
    assert len({model.label for model in every_model}) == 4
    assert [model.name for model in every_model] == ["known", "known", "known", "glossy-plastic"]


# Formulas


@pytest.mark.parametrize("model", [GGX, PAIR])
def test_microfacets_are_those_of_the_reflectances(model, rng):
    wi, wo = np.abs(random_pairs(rng, 100))
    cos_d = np.linalg.norm(wi + wo, axis=-1) / 2.0
    for channel in range(3):
        expected = np.full(100, model.albedo[channel] / np.pi)
        for f0, f90, alpha in zip(model.f0[channel], model.f90, model.alpha, strict=True):
            fresnel = f0 + (f90 - f0) * (1.0 - cos_d) ** 5
            expected += fresnel * reflectance.ggx(wi, wo, alpha)[:, 0]
        np.testing.assert_allclose(model.eval(wi, wo)[:, channel], expected, rtol=1e-12)


def test_the_lobe_of_the_search_is_that_of_the_reflectances():
    problem = microfacet.Problem.of(built_in("rough-gold", FEW))
    for alpha in (0.004, 0.1, 1.0):
        expected = reflectance.ggx(problem.wi, problem.wo, alpha)[:, 0]
        np.testing.assert_allclose(problem.lobe(np.log(alpha)), expected, rtol=1e-8)


@pytest.mark.parametrize("free_f90", [False, True])
def test_derivatives(free_f90, rng):
    search = microfacet.Search(microfacet.Problem.of(built_in("satin-plastic", (20, 6, 8))), 2, free_f90)
    x = rng.normal(size=search.size) - 2.0
    jacobian = search.jacobian(x)
    for i, step in enumerate(1e-6 * np.eye(search.size)):
        expected = (search.residual(x + step) - search.residual(x - step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, i], expected, rtol=1e-3, atol=1e-7)


def test_fresnel_at_normal_incidence_at_brewsters_angle_and_at_grazing():
    index, extinction = np.array([1.5, 0.2]), np.array([0.0, 3.0])
    at_normal = ((index - 1.0) ** 2 + extinction**2) / ((index + 1.0) ** 2 + extinction**2)
    np.testing.assert_allclose(fresnel.fresnel(np.ones(1), index, extinction), at_normal, rtol=1e-12)
    np.testing.assert_allclose(fresnel.fresnel(np.full(1, 1e-9), index, extinction), 1.0, rtol=1e-7)
    # There only light across the plane of incidence comes back: sin^2(theta - theta') / 2, with theta + theta' a right
    # angle
    angle = np.arctan(1.5)
    expected = 0.5 * np.sin(2.0 * angle - np.pi / 2) ** 2
    found = fresnel.fresnel(np.cos(angle), index[0], extinction[0])
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_derivatives_with_fresnel(rng):
    search = fresnel.Search(microfacet.Problem.of(built_in("satin-plastic", (20, 6, 8))))
    x = 0.5 * rng.normal(size=10) - 0.5
    jacobian = search.jacobian(x)
    for i, step in enumerate(1e-6 * np.eye(10)):
        expected = (search.residual(x + step) - search.residual(x - step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, i], expected, rtol=1e-3, atol=1e-7)


# Recovery


def test_finds_facets_of_known_material():
    """Both parts of an index are told apart by their reflectance at all angles only: that is what is compared."""
    measured = tabulate(FRESNEL.eval, "known", shape=(90, 18, 36))
    found = bl.fit_fresnel_ggx(measured)
    assert found.alpha == pytest.approx(0.15, rel=0.02)
    np.testing.assert_allclose(found.albedo, FRESNEL.albedo, rtol=0.02)
    cos_d = np.linspace(0.2, 1.0, 9)[:, None]
    shares = (fresnel.fresnel(cos_d, model.index, model.extinction) for model in (found, FRESNEL))
    np.testing.assert_allclose(*shares, rtol=0.03)
    assert errors(found, measured).cbrt < 2e-3


@pytest.mark.parametrize(("truth", "fit"), [(GGX, bl.fit_lambert_ggx), (PAIR, bl.fit_ggx_pair)])
def test_finds_its_own_numbers_of_samples(truth, fit, rng):
    wi, wo = np.abs(random_pairs(rng, 3000))
    wo = np.where(rng.random((3000, 1)) < 0.5, wi * [-1.0, -1.0, 1.0] + 0.05 * wo, wo)
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    values = truth.eval(wi, wo)
    values[::7, 1] = np.nan
    found = fit(Samples(wi, wo, values, name="known"))
    for name in ("alpha", "albedo", "f0"):
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), rtol=2e-2, err_msg=name)


@pytest.mark.parametrize(("truth", "fit"), [(GGX, bl.fit_lambert_ggx), (PAIR, bl.fit_ggx_pair)])
@pytest.mark.parametrize("convention", ["centre", "edge"])
def test_finds_its_own_numbers(truth, fit, convention):
    measured = tabulate(truth.eval, "known", shape=(90, 18, 36), convention=convention)
    found = fit(measured)
    assert found.name == "known"
    for name in ("alpha", "albedo", "f0", "f90"):
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), rtol=2e-2, err_msg=name)
    assert errors(found, measured).cbrt < 1e-3


@pytest.mark.parametrize("name", ["paint-two-lobe", "rough-gold", "grey-primer"])
def test_no_other_start_of_a_pair_is_better_by_much(name, rng):
    problem = microfacet.Problem.of(built_in(name, FEW))
    search = microfacet.Search(problem, 2, True)
    fitted = bl.fit_ggx_pair(built_in(name, FEW))
    numbers = [fitted.albedo, fitted.f0.ravel(), fitted.f90, fitted.alpha]
    best = (search.residual(np.log(np.maximum(np.concatenate(numbers), 1e-6))) ** 2).sum()
    from scipy import optimize

    low, high = np.log(microfacet.STRENGTH)
    bounds = np.full((2, search.size), [[low], [high]])
    bounds[:, -2:] = np.log(microfacet.ALPHA)[:, None]
    for alphas in np.exp(rng.uniform(*np.log([0.01, 1.0]), (3, 2))):
        found = optimize.least_squares(
            search.residual, search.start(tuple(alphas)), search.jacobian, bounds=bounds, max_nfev=60
        )
        assert best <= 1.1 * 2.0 * found.cost


@pytest.mark.parametrize("name", ["glossy-plastic", "paint-two-lobe", "rough-gold"])
def test_two_lobes_are_better_than_one(name):
    measured = built_in(name, FEW)
    one, two = (errors(fit(measured), measured) for fit in (bl.fit_lambert_ggx, bl.fit_ggx_pair))
    assert two.cbrt <= 1.02 * one.cbrt


# Cube root over the whole hemisphere, and 10 % more
CBRT = {"nickel": 0.075, "delrin": 0.040, "orange-paint": 0.031}
CBRT_RGL = {"aurora_white": 0.077, "vch_silk_blue": 0.160}


@pytest.mark.shared
@pytest.mark.parametrize("name", CBRT)
def test_decoded_materials(decoded, name):
    measured = read(decoded(name))
    assert errors(bl.fit_ggx_pair(measured), measured).cbrt < CBRT[name]


@pytest.mark.shared
@pytest.mark.parametrize("name", CBRT_RGL)
def test_real_materials(data, name):
    measured = read(data / "data" / "rgl" / f"{name}_rgb.bsdf")
    assert errors(bl.fit_ggx_pair(measured), measured).cbrt < CBRT_RGL[name]


# The table without phi_d


def test_bivariate_error_is_the_floor():
    measured = built_in("rough-gold")
    found = errors(bl.fit_bivariate(measured), measured)
    # Errors look at some azimuths, the floor at all
    assert found.rel == pytest.approx(found.bivariate_floor, rel=0.05)


def test_bivariate_is_bilinear_between_cell_centres():
    measured = built_in("rough-gold")
    model = bl.fit_bivariate(measured)
    mean = np.nanmean(measured.values[20:22, 6:8], axis=2)
    root = np.sqrt(measured.theta_h[20:22])
    theta_h = (0.25 * root[0] + 0.75 * root[1]) ** 2
    theta_d = 0.4 * measured.theta_d[6] + 0.6 * measured.theta_d[7]
    expected = np.einsum("h,d,hdc->c", [0.25, 0.75], [0.4, 0.6], mean)
    np.testing.assert_allclose(model.eval_angles(theta_h, theta_d, 1.0), expected, rtol=1e-9)
    nearest = np.nanmean(measured.values[0, 0], axis=0)
    np.testing.assert_allclose(model.eval_angles(0.0, 0.0, 0.0), nearest, rtol=1e-9)


# Odd tables

FITS = [bl.fit_lambert_ggx, bl.fit_fresnel_ggx, bl.fit_ggx_pair, bl.fit_bivariate]


@pytest.mark.parametrize("fit", FITS)
def test_without_a_sample_there_is_no_fit(fit, small_table):
    empty = dataclasses.replace(small_table, planes=np.full_like(small_table.planes, -1.0))
    with pytest.raises(ValueError, match=r"^small: no value is valid\. Check that it holds positive values"):
        fit(empty)


@pytest.mark.parametrize("fit", FITS)
def test_rows_without_a_sample_and_black_channels(fit, small_table, rng):
    planes = small_table.planes.copy()
    planes[:, :, 5] = -1.0
    planes[1] = np.where(planes[1] > 0.0, 0.0, planes[1])
    planes[2, :, 7:] = -1.0
    measured = dataclasses.replace(small_table, planes=planes)
    model = fit(measured)
    wi, wo = np.abs(random_pairs(rng, 500))
    values = model.eval(wi, wo)
    assert np.isfinite(values).all()
    assert (values >= 0.0).all()
    if fit is bl.fit_bivariate:  # Schlick's term is there whatever F0 is
        assert (values[:, 1] == 0.0).all()


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("n_channels", [1, 4])
def test_any_number_of_channels(fit, n_channels, make_table):
    model = fit(make_table(n_channels))
    assert model.eval([0.0, 0.0, 1.0], [0.6, 0.0, 0.8]).shape == (n_channels,)


def test_black_is_black(small_table):
    black = dataclasses.replace(small_table, planes=np.where(small_table.planes >= 0.0, 0.0, -1.0))
    up = np.array([0.0, 0.0, 1.0])
    assert (bl.fit_ggx_pair(black).eval(up, up) == 0.0).all()
