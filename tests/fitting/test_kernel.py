"""The kernel's gradient and Hessian against their readable twin, and what is fitted against what was measured."""

import numpy as np
import pytest
from models import random_model, upper
from reflectances import closed_form

from dsbrdf import Samples, half_diff
from dsbrdf.fitting import uncertainty
from dsbrdf.fitting.estimator import _Options, lobes_of, unknowns_of
from dsbrdf.fitting.observations import Observations
from dsbrdf.model.lobes import curve_design

PENALTY = (0.25, 0.05, 0.02)
NAMES = ("scale", "gamma", "beta", "falloff", "colour")


def random_lobes(n_channels, sizes):
    lobes = random_model(3, sizes=sizes, n_channels=n_channels, n_lobes=2).lobes
    # One channel has no colour
    return lobes if n_channels > 1 else lobes.replace(colour=0.0 * lobes.colour)


def twin(lobes, observations, options):
    """Half the cost, its gradient and Gauss-Newton Hessian, with the penalty."""
    residual, jacobian = uncertainty.linearise(lobes, observations, options.loss)
    weights = observations.weights / observations.weights.sum()
    x, penalty = unknowns_of(lobes), uncertainty.penalty_matrix(lobes, options.penalty)
    cost = 0.5 * ((weights * residual**2).sum() + x @ penalty @ x)
    gradient = np.einsum("nkc,nkcp,nkc->p", weights, jacobian, residual) + penalty @ x
    weighted = jacobian * weights[..., None]
    hessian = np.einsum("nkcp,nkcq->pq", weighted, jacobian, optimize=True) + penalty
    if not observations.is_table:
        for above, row in heights(lobes, observations):
            cost += 200.0 * above**2
            gradient = gradient + 400.0 * above * row
            hessian = hessian + 400.0 * np.outer(row, row)
    return cost, gradient, hessian


def heights(lobes, observations):
    """By how much `ln kappa` of lobes is above twice the brightest value, and its derivative, where it is."""
    n_scale, n_colour = lobes.scale.shape[1], lobes.colour.shape[2]
    highest = np.log(np.log1p(2.0 * observations.values[observations.weights > 0.0].max()))
    spans = n_scale - 2
    places = np.clip((np.arange(n_scale) - 0.5) / spans, 0.0, 1.0)
    for channel in range(lobes.n_channels) if lobes.n_channels > 1 else ():
        for k in range(lobes.n_lobes):
            colour = curve_design(places, n_colour)
            for j, above in enumerate(lobes.scale[k] + colour @ lobes.colour[channel, k] - highest):
                row = lobes.replace(**{name: 0.0 * getattr(lobes, name) for name in NAMES})
                row.scale[k, j] = 1.0
                row.colour[channel, k] = colour[j]
                if above > 0.0:
                    yield above, unknowns_of(row)


def kernel(lobes, observations, options):
    x = unknowns_of(lobes)
    found = observations.kernel.normal_equations(options, lobes.n_lobes, x.tolist())
    return found[0], found[1], found[2].reshape(len(x), len(x))


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
@pytest.mark.parametrize("n_channels", [1, 3, 5])
@pytest.mark.parametrize("kind", ["table", "samples"])
def test_cost_and_gradient(make_table, rng, loss, n_channels, kind):
    if kind == "table":
        observations = Observations.of(make_table(n_channels))
    else:
        wi, wo = upper(rng, 300), upper(rng, 300)
        observations = Observations.of(Samples(wi, wo, closed_form(n_channels)(wi, wo)))
    sizes = (6, 4, 3, 1, 2)
    lobes = random_lobes(n_channels, sizes)
    options = _Options(sizes, loss, observations.offset.tolist(), PENALTY, 100.0)
    got, expected = (of(lobes, observations, options) for of in (kernel, twin))
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-9)
    np.testing.assert_allclose(got[1], expected[1], rtol=1e-9, atol=1e-10 * np.abs(expected[1]).max())
    np.testing.assert_array_equal(got[2], got[2].T)


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
@pytest.mark.parametrize("n_channels", [1, 3, 5])
def test_hessian(make_table, loss, n_channels):
    """Rows so far apart that the kernel takes no two together, which it does with neighbours."""
    observations = Observations.of(make_table(n_channels, (20, 4, 12)))
    sizes = (6, 4, 3, 1, 2)
    lobes = random_lobes(n_channels, sizes)
    options = _Options(sizes, loss, observations.offset.tolist(), PENALTY, 100.0)
    got, expected = (of(lobes, observations, options)[2] for of in (kernel, twin))
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
def test_twin_against_differences(make_table, loss):
    observations = Observations.of(make_table(3, (6, 5, 8)))
    sizes = (4, 3, 2, 1, 2)
    lobes = random_model(5, sizes=sizes, n_lobes=2).lobes
    _, jacobian = uncertainty.linearise(lobes, observations, loss)
    at = 0
    for k in range(2):
        for name in ("scale", "gamma", "beta", "falloff"):
            for i in range(getattr(lobes, name).shape[1]):
                ends = []
                for step in (1e-6, -1e-6):
                    part = getattr(lobes, name).copy()
                    part[k, i] += step
                    moved = lobes.replace(**{name: part})
                    ends.append(uncertainty.linearise(moved, observations, loss)[0])
                slope = (ends[0] - ends[1]) / 2e-6
                expected = jacobian[..., at]
                np.testing.assert_allclose(slope, expected, atol=1e-5 * max(np.abs(expected).max(), 1e-3))
                at += 1


def test_unknowns_and_lobes_are_the_same():
    lobes = random_model(2).lobes
    sizes = tuple(part.shape[-1] for part in lobes.parts)
    back = lobes_of(unknowns_of(lobes), sizes, lobes.n_lobes, lobes.n_channels)
    order = np.argsort(lobes.gamma.mean(1))
    np.testing.assert_array_equal(back.gamma, lobes.gamma[order])
    rng = np.random.default_rng(0)
    wi, wo = upper(rng, 200), upper(rng, 200)
    model = random_model(2)
    np.testing.assert_allclose(model.replace(lobes=back).eval(wi, wo), model.eval(wi, wo), rtol=1e-11)


# Observations


def test_cells_have_the_moments_of_their_rows(damaged_table, small_table):
    """Mean and covariance with cos(2 phi_d) of the three azimuths are those of all entries of a cell."""
    observations = Observations.of(small_table)
    n_h, n_d = len(small_table.theta_h), len(small_table.theta_d)
    values = observations.values.reshape(n_d, n_h, 3, -1)
    weights = observations.weights.reshape(n_d, n_h, 3, -1)
    azimuth = observations.azimuth.reshape(n_d, n_h, 3)
    some = checked = 0
    for d in range(n_d):
        for h in range(n_h):
            row = small_table.planes[:, h, d, :] * small_table.scale[:, None]
            c = np.cos(2.0 * small_table.phi_d)
            valid = (row >= 0.0) & np.isfinite(row)
            for channel in range(3):
                if not valid[channel].any():
                    assert not weights[d, h, :, channel].any()
                    continue
                some += 1
                f, cos = row[channel, valid[channel]], c[valid[channel]]
                got, factor = (
                    values[d, h, :, channel],
                    half_diff.azimuthal_factor(small_table.theta_h[h], small_table.theta_d[d]),
                )
                np.testing.assert_allclose(got.mean(), f.mean(), rtol=1e-9)
                assert (weights[d, h, :, channel] > 0.0).all()
                # Clipped where the swing is more than the mean
                if np.abs(got / f.mean() - 1.0).max() < 0.89 and len(f) > 1:
                    checked += 1
                    np.testing.assert_allclose(azimuth[d, h].mean(), factor * cos.mean(), atol=1e-9)
                    np.testing.assert_allclose(azimuth[d, h].var(), factor**2 * cos.var(), atol=1e-9)
                    covariance = np.mean((got - got.mean()) * (azimuth[d, h] - azimuth[d, h].mean()))
                    expected = factor * np.mean((f - f.mean()) * (cos - cos.mean()))
                    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-12)
    assert some > 300
    assert checked > 0.8 * some
    # Nothing that is invalid gets in
    broken = Observations.of(damaged_table)
    assert np.isfinite(broken.values[broken.weights > 0.0]).all()


def test_samples_are_positions_with_one_azimuth(rng):
    wi, wo = upper(rng, 50), upper(rng, 50)
    values = closed_form(3)(wi, wo)
    values[3, 1] = np.nan
    observations = Observations.of(Samples(wi, wo, values, weights=np.arange(50.0)))
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    np.testing.assert_allclose(observations.log_cos, np.log(np.cos(theta_h)), rtol=1e-9)
    np.testing.assert_allclose(observations.x, np.cos(theta_d))
    expected = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
    np.testing.assert_allclose(observations.azimuth[:, 0], expected)
    assert not observations.weights[0].any()
    assert observations.weights[3, 0, 1] == 0.0
    assert (observations.weights[4:] > 0.0).all()
    assert observations.n_effective == 49.0
