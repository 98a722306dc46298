"""What is fitted: moments of a table's cells, samples, weights, and the kernel's residuals against their twin."""

import numpy as np
import pytest
from fits import SMALL, known, pairs
from models import random_model, upper

from dsbrdf import Samples, half_diff, tabulate
from dsbrdf.fitting import uncertainty
from dsbrdf.fitting.estimator import PENALTY, _Options, lobes_of, unknowns_of
from dsbrdf.fitting.observations import MAX_SWING, SHARES, Observations, cell_area

SIZES = [(6, 4, 3, 1, 2), (3, 2, 2, 1, 1), (5, 3, 1, 2, 4)]


# Cells


def test_a_cell_has_the_moments_of_its_row(small_table):
    """Least squares of any a + b cos(2 phi) differ from those of the row by a constant only."""
    found = Observations.of(small_table)
    n_d, n_h = len(small_table.theta_d), len(small_table.theta_h)
    factor = half_diff.azimuthal_factor(small_table.theta_h, small_table.theta_d[:, None])
    nodes = found.azimuth.reshape(n_d, n_h, 3) / factor[..., None]
    values = found.values.reshape(n_d, n_h, 3, 3)
    rows = small_table.planes * small_table.scale[:, None, None, None]
    cos_2phi = np.cos(2.0 * small_table.phi_d)
    seen = 0
    for d, h, channel in np.ndindex(n_d, n_h, 3):
        row = rows[channel, h, d]
        valid = row >= 0.0
        if valid.sum() < 3:
            continue
        f, c = row[valid], cos_2phi[valid]
        v, at = values[d, h, :, channel], nodes[d, h]
        np.testing.assert_allclose(v.mean(), f.mean(), rtol=1e-10)
        np.testing.assert_allclose(at.mean(), c.mean(), atol=1e-10)
        np.testing.assert_allclose(at.var(), c.var(), atol=1e-10)
        covariance = ((f - f.mean()) * (c - c.mean())).mean()
        np.testing.assert_allclose(((v - v.mean()) * at).mean(), covariance, atol=1e-9 * f.mean())
        rest = [
            ((f - a - b * c) ** 2).mean() - ((v - a - b * at) ** 2).mean()
            for a, b in ((0.0, 0.0), (0.3, -0.2), (1.0, 2.0))
        ]
        np.testing.assert_allclose(rest, rest[0], atol=1e-9)
        seen += 1
    assert seen > 400


def test_values_of_a_cell_stay_positive():
    def swinging(wi, wo):
        theta_h, _, phi_d = half_diff.from_directions(wi, wo)
        return (np.maximum(np.cos(2.0 * phi_d), 0.0) ** 8 + 1e-6 + 0.0 * theta_h)[..., None]

    table = tabulate(swinging, "swinging", shape=(12, 18, 20))
    found = Observations.of(table)
    some = found.weights[:, 0, 0] > 0.0
    values = found.values[some, :, 0]
    mean = values.mean(1)
    assert (values > 0.0).all()
    assert (np.abs(values - mean[:, None]) <= (MAX_SWING + 1e-9) * mean[:, None]).all()


def test_cells_that_hold_nothing_weigh_nothing(damaged_table):
    found = Observations.of(damaged_table)
    valid = damaged_table.planes * damaged_table.scale[:, None, None, None]
    n = ((valid >= 0.0) & (valid < np.inf)).sum(-1)  # (channel, theta_h, theta_d)
    some = np.moveaxis(n, 0, -1).swapaxes(0, 1).reshape(-1, 3) > 0
    assert not some[:, 1].all()
    weighs = found.weights > 0.0
    assert (weighs == weighs[:, :1]).all()
    assert not weighs[:, 0][~some].any()
    assert np.isfinite(found.values).all()
    assert np.isfinite(found.weights).all()


def test_channels_weigh_alike(small_table, rng):
    wi, wo = pairs(rng, 100)
    samples = Samples(wi, wo, np.exp(rng.normal(size=(100, 3))) * [1.0, 10.0, 100.0])
    for measured, n_nodes in ((small_table, 3), (samples, 1)):
        totals = Observations.of(measured).weights.sum((0, 1))
        np.testing.assert_allclose(totals, n_nodes * sum(SHARES), rtol=1e-10)


def test_areas_of_cells_add_up_to_all_pairs(small_table):
    """Integral of sin(theta_h) and of cos(theta_d) sin(theta_d) over their ranges."""
    area = cell_area(small_table.theta_h, small_table.theta_d)
    assert area.shape == (18, 12)
    np.testing.assert_allclose(area.sum(), 0.5, rtol=1e-12)
    assert (area > 0.0).all()


def test_samples_are_positions(rng):
    wi, wo = upper(rng, 60), upper(rng, 60)
    values = rng.random((60, 2))
    values[3] = np.nan
    values[5, 1] = np.nan
    found = Observations.of(Samples(wi, wo, values))
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    np.testing.assert_allclose(found.log_cos, np.log(np.cos(theta_h)), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(found.x, np.cos(theta_d))
    azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
    np.testing.assert_allclose(found.azimuth, azimuth[:, None])
    np.testing.assert_array_equal(found.weights[:, 0] > 0.0, np.isfinite(values))
    assert found.n_effective == 59.0


def test_a_sample_counts_as_its_weight_says(rng):
    wi, wo = upper(rng, 60), upper(rng, 60)
    values, weights = rng.random((60, 2)), np.ones(60)
    weights[7] = 2.0
    plain, twice = (
        Observations.of(Samples(wi, wo, values, weights=w)).weights[:, 0] for w in (np.ones(60), weights)
    )
    ratio = twice / plain
    assert (ratio[7] > 1.2 * np.delete(ratio, 7, axis=0)).all()


def test_nothing_valid_is_said():
    empty = Samples([[0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0]], [[np.nan]], name="empty")
    with pytest.raises(
        ValueError, match=r"^empty: no value is valid\. Check that it holds positive values in 1/sr"
    ):
        Observations.of(empty)


# Unknowns


@pytest.mark.parametrize("n_channels", [1, 3, 5])
@pytest.mark.parametrize("sizes", SIZES)
def test_lobes_of_unknowns(sizes, n_channels):
    lobes = random_model(3, sizes, n_channels).lobes
    lobes = lobes.take(np.argsort(lobes.gamma.mean(1)))
    back = lobes_of(unknowns_of(lobes), sizes, lobes.n_lobes, n_channels)
    theta_d = np.linspace(0.0, np.pi / 2, 20)
    if n_channels > 1:
        for part, expected in zip(back.at(theta_d), lobes.at(theta_d), strict=True):
            np.testing.assert_allclose(part, expected, rtol=1e-10, atol=1e-12)
        # Unless the scale's curve cannot hold what is common to the colours
        if sizes[-1] <= 3:
            np.testing.assert_allclose(back.colour.mean(0), 0.0, atol=1e-14)
    else:
        np.testing.assert_array_equal(back.scale, lobes.scale)
        assert back.colour.shape == (1, lobes.n_lobes, sizes[-1])
        assert not back.colour.any()


# The kernel against its twin


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("n_channels", [1, 3])
def test_kernel_equals_its_twin(loss, sizes, n_channels, make_table):
    observations = Observations.of(make_table(n_channels))
    model = random_model(5, sizes, n_channels, 2)
    lobes = model.lobes
    if n_channels == 1:
        lobes = lobes.replace(colour=0.0 * lobes.colour)
    x = unknowns_of(lobes)
    how = _Options(sizes, loss, observations.offset.tolist(), PENALTY, observations.n_effective)
    cost, gradient, _ = observations.kernel.normal_equations(how, 2, x.tolist())

    weights = observations.weights / observations.weights.sum()
    residual, jacobian = uncertainty.linearise(lobes, observations, loss)
    held = uncertainty.penalty_matrix(lobes, PENALTY)
    np.testing.assert_allclose(cost, 0.5 * (weights * residual**2).sum() + 0.5 * x @ held @ x, rtol=1e-9)
    expected = np.einsum("nkc,nkcp->p", weights * residual, jacobian) + held @ x
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
@pytest.mark.parametrize("sizes", SIZES)
def test_hessian_equals_its_twin(loss, sizes, rng):
    """At few x: the kernel takes functions of curves at the middles of bins of x."""
    n = 400
    observations = Observations(
        -rng.exponential(0.1, n),
        np.repeat([0.15, 0.45, 0.75, 0.98], n // 4),
        rng.uniform(-1.0, 1.0, (n, 2)),
        np.exp(rng.normal(size=(n, 2, 3))),
        rng.uniform(0.0, 1.0, (n, 2, 3)),
        400.0,
    )
    lobes = random_model(7, sizes, 3, 2).lobes
    how = _Options(sizes, loss, observations.offset.tolist(), PENALTY, observations.n_effective)
    hessian = observations.kernel.normal_equations(how, 2, unknowns_of(lobes).tolist())[2]
    weights = observations.weights / observations.weights.sum()
    _, jacobian = uncertainty.linearise(lobes, observations, loss)
    expected = np.einsum("nkc,nkcp,nkcq->pq", weights, jacobian, jacobian, optimize=True)
    expected += uncertainty.penalty_matrix(lobes, PENALTY)
    np.testing.assert_allclose(
        np.reshape(hessian, expected.shape), expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
def test_the_gradient_is_that_of_the_cost(loss, small_table):
    observations = Observations.of(small_table)
    lobes = random_model(6, n_lobes=2).lobes
    how = _Options((5, 4, 3, 1, 2), loss, observations.offset.tolist(), PENALTY, observations.n_effective)
    x = unknowns_of(lobes)

    def cost(x):
        return observations.kernel.normal_equations(how, 2, x.tolist())[0]

    gradient = observations.kernel.normal_equations(how, 2, x.tolist())[1]
    differences = [(cost(x + step) - cost(x - step)) / 2e-6 for step in 1e-6 * np.eye(len(x))]
    np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


def test_residuals_vanish_at_the_truth():
    model = known(beta=False)
    observations = Observations.of(tabulate(model.eval, "known", shape=SMALL))
    for loss in ("log", "gamma", "l2"):
        residual, _ = uncertainty.linearise(model.lobes, observations, loss)
        assert np.abs(residual[observations.weights > 0.0]).max() < 1e-9
