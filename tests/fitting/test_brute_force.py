"""Errors over the whole hemisphere by brute force, and which angles a measurement covers."""

import dataclasses

import numpy as np
import pytest
from models import known_model, upper
from reflectances import closed_form

from dsbrdf import Samples, fit, half_diff, tabulate
from dsbrdf.fitting import metrics
from dsbrdf.fitting.coverage import Coverage
from dsbrdf.fitting.observations import Observations, cell_area
from dsbrdf.measured import built_in


def test_areas_of_cells_are_integrals():
    theta_h, theta_d = (np.pi / 2 * (np.arange(n) + 0.5) / n for n in (10, 15))
    area = cell_area(theta_h, theta_d)
    # d omega_h d omega_d cos(theta_d) over the hemispheres
    np.testing.assert_allclose(area.sum(), 0.5)
    edges = np.pi / 2 * np.arange(11) / 10
    np.testing.assert_allclose(area.sum(0), 0.5 * -np.diff(np.cos(edges)))


def test_errors_of_a_table_by_brute_force(damaged_table):
    model = known_model()
    got = metrics.errors(model, damaged_table)
    area = cell_area(damaged_table.theta_h, damaged_table.theta_d)
    which = range(metrics.PHI_STEP // 2, len(damaged_table.phi_d), metrics.PHI_STEP)
    sums = np.zeros(6)
    for h, theta_h in enumerate(damaged_table.theta_h):
        for d, theta_d in enumerate(damaged_table.theta_d):
            for phi in which:
                wi, wo = half_diff.to_directions(theta_h, theta_d, damaged_table.phi_d[phi])
                value = model.eval(wi, wo)
                for channel in range(3):
                    f = damaged_table.planes[channel, h, d, phi] * damaged_table.scale[channel]
                    if not (f >= 0.0 and np.isfinite(f) and min(wi[2], wo[2]) > 0.0):
                        continue
                    off, cos = value[channel] - f, wi[2] * wo[2]
                    root = np.cbrt(value[channel] * cos) - np.cbrt(f * cos)
                    sums[:2] += area[d, h] * np.array([off**2, f**2])
                    sums[2:4] += area[d, h] * np.array([root**2, np.cbrt(f * cos) ** 2])
                    if f > 0.0:
                        sums[4:] += np.log((value[channel] + 1e-6) / (f + 1e-6)) ** 2, 1.0
    assert sums[5] > 100
    expected = np.sqrt(sums[::2] / sums[1::2])
    np.testing.assert_allclose([got.rel, got.cbrt, got.log], expected, rtol=1e-9)


def test_errors_of_samples_by_brute_force(rng):
    model = known_model()
    wi, wo = upper(rng, 200), upper(rng, 200)
    f = closed_form(3)(wi, wo)
    f[3, 1], f[5, 2] = np.nan, 0.0
    got = metrics.errors(model, Samples(wi, wo, f))
    value, cos = model.eval(wi, wo), (wi[:, 2] * wo[:, 2])[:, None]
    root, of = np.cbrt(f * cos), np.cbrt(value * cos)
    assert got.rel == pytest.approx(np.sqrt(np.nansum((value - f) ** 2) / np.nansum(f**2)))
    assert got.cbrt == pytest.approx(np.sqrt(np.nansum((root - of) ** 2) / np.nansum(root**2)))
    logs = np.log((value + 1e-6) / (f + 1e-6))[f > 0.0]
    assert got.log == pytest.approx(np.sqrt(np.mean(logs**2)))
    assert np.isnan(got.albedo)
    assert str(got).startswith(f"rel {got.rel:.3f}, cbrt ")
    assert "albedo" not in str(got)


def test_albedo_of_a_model_that_is_twice_as_bright(make_table):
    table = make_table(3, (30, 24, 24))

    class Twice:
        def eval(self, wi, wo):
            return 2.0 * table.eval(wi, wo)

    got = metrics.errors(Twice(), table)
    assert got.albedo == pytest.approx(1.0)
    assert got.rel == pytest.approx(1.0, rel=0.05)
    assert got.log == pytest.approx(np.log(2.0), rel=0.05)


def test_floors_by_brute_force():
    small_table = tabulate(built_in.get("rough-gold").reflectance, "gold", shape=(12, 18, 20))
    area = cell_area(small_table.theta_h, small_table.theta_d)
    cos = np.cos(2.0 * small_table.phi_d)
    squares = np.zeros(3)
    for h in range(len(small_table.theta_h)):
        for d in range(len(small_table.theta_d)):
            for channel in range(3):
                f = small_table.planes[channel, h, d] * small_table.scale[channel]
                valid = (f >= 0.0) & np.isfinite(f)
                if not valid.any():
                    continue
                f, c = f[valid], cos[valid]
                design = np.stack([np.ones_like(c), c], axis=-1)
                rest = [f - f.mean(), f - design @ np.linalg.lstsq(design, f)[0], f]
                squares += area[d, h] * np.array([(part**2).sum() for part in rest])
    got = metrics.errors(known_model(), small_table)
    assert got.bivariate_floor == pytest.approx(np.sqrt(squares[0] / squares[2]), rel=1e-6)
    assert got.azimuthal_floor == pytest.approx(np.sqrt(squares[1] / squares[2]), rel=1e-5)
    assert got.azimuthal_floor < got.bivariate_floor


# Coverage


def test_a_whole_table_is_covered(small_table):
    coverage = Coverage.of(Observations.of(small_table))
    assert coverage.sentence == ""
    assert coverage.azimuth
    assert coverage.empty_channels == ()


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_a_scan_says_what_it_covers():
    theta = np.deg2rad(np.arange(-80.0, 81.0, 2.0))
    wo = np.stack([np.sin(theta), 0.0 * theta, np.cos(theta)], axis=-1)
    wi = np.broadcast_to([0.5, 0.0, np.sqrt(0.75)], wo.shape)
    found = fit(Samples(wi, wo, closed_form(1)(wi, wo)), 1)
    text = (
        "measured: theta_d only 0 to 55 degrees; theta_h only 0 to 55 degrees; 60% of the pairs of angles in all; "
        "no variation with the azimuth. Elsewhere the model follows its curves, not data"
    )
    # Along the scan theta_h = |30 + theta_o| / 2 and theta_d = |30 - theta_o| / 2, as (25, 55) and (55, 25)
    assert found.coverage.sentence == text
    assert text in repr(found)
    assert found.coverage.n_values == len(theta)
    np.testing.assert_allclose(found.coverage.theta_d, np.deg2rad([0.0, 55.0]), atol=1e-6)


def test_channels_and_azimuths_without_values_are_told(rng):
    wi, wo = upper(rng, 3000), upper(rng, 3000)
    values = closed_form(3)(wi, wo)
    values[:, 1] = np.nan
    coverage = Coverage.of(Observations.of(Samples(wi, wo, values)))
    assert coverage.empty_channels == (1,)
    assert "no value in channel 1" in coverage.sentence
    observations = Observations.of(Samples(wi, wo, values))
    flat = dataclasses.replace(observations, azimuth=np.zeros_like(observations.azimuth))
    assert "no variation with the azimuth" in Coverage.of(flat).sentence
