"""Errors over the whole hemisphere, against brute force."""

import numpy as np
import pytest
from fits import pairs
from models import constant_model, random_model

from dsbrdf import Samples, fit, half_diff, tabulate
from dsbrdf.fitting import metrics
from dsbrdf.fitting.observations import cell_area


def brute_force(model, table, which):
    """`rel`, `cbrt` and `log`, an entry at a time."""
    area = cell_area(table.theta_h, table.theta_d)
    sums = np.zeros(6)
    for d, h, p, channel in np.ndindex(len(table.theta_d), len(table.theta_h), len(which), table.n_channels):
        wi, wo = half_diff.to_directions(table.theta_h[h], table.theta_d[d], table.phi_d[which[p]])
        f = table.planes[channel, h, d, which[p]] * table.scale[channel]
        if not (0.0 <= f < np.inf and wi[2] > 0.0 and wo[2] > 0.0):
            continue
        found = model.eval(wi, wo)[channel]
        root = (wi[2] * wo[2]) ** (1 / 3)
        sums += [
            area[d, h] * (found - f) ** 2,
            area[d, h] * f**2,
            area[d, h] * (root * (found ** (1 / 3) - f ** (1 / 3))) ** 2,
            area[d, h] * (root * f ** (1 / 3)) ** 2,
            np.log((found + 1e-6) / (f + 1e-6)) ** 2 if f > 0.0 else 0.0,
            float(f > 0.0),
        ]
    return np.sqrt(sums[::2] / sums[1::2])


@pytest.mark.parametrize("which", ["small_table", "damaged_table"])
def test_errors_of_a_table(which, request):
    table = request.getfixturevalue(which)
    model = random_model(4)
    found = metrics.errors(model, table)
    expected = brute_force(model, table, np.arange(20)[metrics.PHI_STEP // 2 :: metrics.PHI_STEP])
    np.testing.assert_allclose([found.rel, found.cbrt, found.log], expected, rtol=1e-9)


def test_errors_of_samples(rng):
    model = random_model(4)
    wi, wo = pairs(rng, 50)
    values = np.exp(rng.normal(size=(50, 3)))
    values[3, 1] = np.nan
    values[4, 2] = 0.0
    found = metrics.errors(model, Samples(wi, wo, values))
    predicted = model.eval(wi, wo)
    valid = np.isfinite(values)
    f, m = values[valid], predicted[valid]
    root = np.cbrt(wi[:, 2] * wo[:, 2])[:, None].repeat(3, 1)[valid]
    assert found.rel == pytest.approx(np.sqrt(((m - f) ** 2).sum() / (f**2).sum()))
    off = (root * (np.cbrt(m) - np.cbrt(f))) ** 2
    assert found.cbrt == pytest.approx(np.sqrt(off.sum() / ((root * np.cbrt(f)) ** 2).sum()))
    seen = f > 0.0
    logs = np.log((m[seen] + 1e-6) / (f[seen] + 1e-6))
    assert found.log == pytest.approx(np.sqrt((logs**2).mean()))
    assert np.isnan(found.albedo)
    assert np.isnan(found.bivariate_floor)
    assert str(found) == f"rel {found.rel:.3f}, cbrt {found.cbrt:.3f}, log {found.log:.3f}"


def test_a_model_of_its_own_table_has_no_error():
    model = random_model(4, (2, 2, 1, 1, 1))
    found = metrics.errors(model, tabulate(model.eval, "own", shape=(30, 24, 24)))
    assert max(found.rel, found.cbrt, found.log) < 1e-10
    assert found.albedo < 0.1


def test_the_albedo_is_off_by_as_much_as_the_values():
    """A Lambertian surface of which a table says twice as much."""
    model = constant_model(0.2, 1e-9)
    table = tabulate(lambda wi, wo: 2.0 * model.eval(wi, wo), "twice", shape=(30, 24, 24))
    found = metrics.errors(model, table)
    assert found.albedo == pytest.approx(0.5, rel=1e-6)
    assert found.rel == pytest.approx(0.5, rel=1e-6)
    assert found.log == pytest.approx(np.log(2.0), rel=1e-4)
    assert ", albedo 0.500" in str(found)


def stretched(wi, wo):
    """What neither a mean over phi_d nor a cosine describes."""
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    swing = np.sin(theta_d) * np.cos(2.0 * phi_d)
    return np.exp(swing - 3.0 * theta_h**2)[..., None] * [1.0, 2.0]


@pytest.fixture(scope="module")
def stretched_table():
    return tabulate(stretched, "stretched", shape=(12, 18, 20))


def test_floors(stretched_table):
    """By a regression over phi_d in each cell."""
    table = stretched_table
    found = metrics.errors(random_model(4, n_channels=2), table)
    area = cell_area(table.theta_h, table.theta_d)
    cos_2phi = np.cos(2.0 * table.phi_d)
    flat = sloped = energy = 0.0
    for channel, h, d in np.ndindex(2, 12, 18):
        row = table.planes[channel, h, d] * table.scale[channel]
        valid = row >= 0.0
        if not valid.any():
            continue
        f, c = row[valid], cos_2phi[valid]
        energy += area[d, h] * (f**2).sum()
        flat += area[d, h] * ((f - f.mean()) ** 2).sum()
        design = np.stack([np.ones_like(c), c], axis=-1)
        sloped += area[d, h] * ((f - design @ np.linalg.lstsq(design, f)[0]) ** 2).sum()
    assert found.bivariate_floor == pytest.approx(np.sqrt(flat / energy), rel=1e-9)
    assert found.azimuthal_floor == pytest.approx(np.sqrt(sloped / energy), rel=1e-6)
    assert 0.01 < found.azimuthal_floor < 0.5 * found.bivariate_floor


def test_no_function_of_two_angles_is_better_than_the_floor(stretched_table):
    found = fit(stretched_table, 4, loss="l2", max_iterations=1000)
    flat = found.model.replace(lobes=found.model.lobes.replace(beta=0.0 * found.model.lobes.beta))
    assert metrics.errors(flat, stretched_table).rel > 0.9 * found.errors.bivariate_floor
    assert found.errors.rel < found.errors.bivariate_floor
