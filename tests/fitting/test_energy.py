"""The light of a fit is that of the table."""

import numpy as np
import pytest
from models import known_model

from dsbrdf.fitting import energy

ANGLES = len(energy.ANGLES)


@pytest.fixture
def cells(rng):
    """Positions, azimuths and how much they count for each angle; the light of a known model there."""
    n = 200
    log_cos, x = np.log(np.cos(1.2 * rng.random(n))), rng.random(n)
    azimuth, light = rng.uniform(-1.0, 1.0, (n, 3)), rng.random((ANGLES, n, 3))
    return log_cos, x, azimuth, light


def light_of(lobes, cells):
    return energy._light(lobes, *cells)[0]


def values(lobes, cells):
    """Values (position, node), channels averaged, from sums over single nodes."""
    log_cos, x, azimuth, _ = cells
    one = np.eye(azimuth.size).reshape(-1, *azimuth.shape)
    return energy._light(lobes, log_cos, x, azimuth, one)[0].reshape(azimuth.shape)


def test_light_is_the_sum_of_values(cells):
    lobes = known_model().lobes
    log_cos, x, azimuth, light = cells
    from dsbrdf.fitting.uncertainty import value_jacobian

    expected = np.tensordot(light, value_jacobian(lobes, log_cos, x, azimuth)[0].mean(-1), 2)
    np.testing.assert_allclose(light_of(lobes, cells), expected, rtol=1e-12)


def test_derivatives_equal_differences(cells):
    lobes = known_model().lobes
    _, by_scale = energy._light(lobes, *cells)
    for at in np.ndindex(lobes.scale.shape):
        step = np.zeros(lobes.scale.shape)
        step[at] = 1e-5
        high, low = (light_of(lobes.replace(scale=lobes.scale + s), cells) for s in (step, -step))
        np.testing.assert_allclose(by_scale[(slice(None), *at)], (high - low) / 2e-5, rtol=1e-6, atol=1e-9)


def test_lobes_that_are_the_table_stay(cells):
    lobes = known_model().lobes
    log_cos, x, azimuth, light = cells
    kept = energy.keep_light(lobes, log_cos, x, azimuth, values(lobes, cells), light)
    np.testing.assert_allclose(kept.scale, lobes.scale, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("factor", [0.8, 1.3])
def test_light_of_a_brighter_table_is_met(cells, factor):
    lobes = known_model().lobes
    log_cos, x, azimuth, light = cells
    kept = energy.keep_light(lobes, log_cos, x, azimuth, factor * values(lobes, cells), light)
    ratio = light_of(kept, cells) / light_of(lobes, cells)
    np.testing.assert_allclose(ratio, factor, rtol=0.02)
    assert abs(np.log(ratio / factor).mean()) < 1e-3


def test_shares_add_up_to_both_directions(rng):
    cosines = tuple(np.cos(rng.uniform(0.0, np.deg2rad(79.0), (2, 50))))
    np.testing.assert_allclose(energy.shares(cosines).sum(0), 2.0 * cosines[0] * cosines[1], rtol=1e-12)
    assert not energy.shares((np.array([0.1]), np.array([1.0]))).any()
