"""Plans of measurements: what each pair lowers, what can be reached, and what is known already."""

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf.fitting import plan as plans
from dsbrdf.measured import Samples
from dsbrdf.space import build_space
from dsbrdf.space.process import Positions, support


@pytest.fixture(scope="module")
def space():
    return build_space([smooth_model(i) for i in range(12)])


def spread(space, wi, wo):
    """RMS deviation over all directions once these pairs are measured, by the formula of a Gaussian process."""
    process = space.process
    goal_at, area = process.at_support[1], support()[1]
    targets = goal_at.reshape(len(goal_at), -1)
    rows = process.at(Positions.of_directions(wi, wo))[1].reshape(process.n_materials, -1)
    cross = targets.T @ rows
    inverse = np.linalg.inv(rows.T @ rows + process.unmeasured.noise**2 * np.eye(rows.shape[1]))
    variance = (targets**2).sum(0) - np.einsum("ij,jk,ik->i", cross, inverse, cross)
    return float(np.sqrt(np.repeat(area, 3) @ variance / 3))


def test_each_pair_is_the_one_that_lowers_most(space):
    found = dsbrdf.plan(3, space=space, in_plane=True, theta_max=40.0)
    wi, wo = found.directions
    for n in range(1, 4):
        assert found.deviation[n] == pytest.approx(spread(space, wi[:n], wo[:n]), rel=1e-6)
    candidates = plans._candidates(True, 40.0, 0.0)
    lights, viewers = plans._unit(candidates[0], 0.0 * candidates[0]), plans._unit(*candidates[1:])
    best = min(
        spread(space, np.vstack([wi[:2], light]), np.vstack([wo[:2], viewer]))
        for light, viewer in zip(lights, viewers, strict=True)
    )
    assert found.deviation[3] == pytest.approx(best, rel=1e-6)


def test_what_cannot_be_reached_is_left_out(space):
    found = dsbrdf.plan(12, space=space, in_plane=True, theta_max=60.0, least_angle=15.0)
    assert max(found.theta_i.max(), found.theta_o.max()) <= 60.0
    assert set(found.phi_o) <= {0.0, 180.0}
    wi, wo = found.directions
    assert np.rad2deg(np.arccos((wi * wo).sum(-1))).min() >= 15.0 - 1e-6


def test_planned_pairs_tell_more_than_random_ones(space):
    found = dsbrdf.plan(4, space=space)
    rng = np.random.default_rng(0)
    for _ in range(10):
        z, phi = rng.uniform(0.26, 1.0, (2, 4)), 2.0 * np.pi * rng.random((2, 4))
        s = np.sqrt(1.0 - z * z)
        assert found.deviation[-1] < spread(space, *np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1))


def test_what_is_known_is_not_asked_for_again(space):
    first = dsbrdf.plan(3, space=space)
    wi, wo = first.directions
    known = Samples(wi, wo, smooth_model(3).eval(wi, wo))
    found = dsbrdf.plan(2, space=space, known=known)
    assert found.deviation[0] < 1.5 * first.deviation[-1]
    again = {tuple(row) for row in np.c_[first.theta_i, first.theta_o, first.phi_o]}
    assert not again & {tuple(row) for row in np.c_[found.theta_i, found.theta_o, found.phi_o]}


def test_what_is_refused(space):
    wi, wo = dsbrdf.plan(2, space=space).directions
    with pytest.raises(ValueError, match="1 channels, where the space has 3"):
        dsbrdf.plan(2, space=space, known=Samples(wi, wo, np.ones((2, 1))))
    with pytest.raises(ValueError, match="'n_samples' must be at least 1, got 0"):
        dsbrdf.plan(0, space=space)
