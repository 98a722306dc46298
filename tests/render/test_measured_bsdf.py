"""The plugin `dsbrdf_measured`: a table's values, and samples that follow its density."""

import dataclasses

import mitsuba as mi
import mitsuba_tools as tools
import numpy as np
import pytest
from models import upper
from tables import built_in

from dsbrdf import render, tabulate, write_merl

THETA_I = np.deg2rad([0.0, 30.0, 60.0, 80.0])


@pytest.fixture(autouse=True)
def variant():
    tools.compiled()


def pairs(rng, n=2000):
    wi, wo = upper(rng, n), upper(rng, n)
    wo[: n // 2] = wi[: n // 2] * [-1, -1, 1] + 0.05 * rng.normal(size=(n // 2, 3))
    wo[:, 2] = np.abs(wo[:, 2])
    return wi, wo / np.linalg.norm(wo, axis=1, keepdims=True)


@pytest.mark.parametrize("convention", ["centre", "edge"])
def test_values_are_those_of_the_table(make_table, convention, rng):
    table, (wi, wo) = make_table(convention=convention), pairs(rng)
    value, density = tools.evaluate(tools.load(table), wi, wo)
    np.testing.assert_allclose(value, table.eval(wi, wo), rtol=2e-4)
    assert (density > 0.0).all()


def test_invalid_entries_are_filled(damaged_table, rng):
    """From in-between the valid ones, as `MeasuredBRDF.eval` does it."""
    wi, wo = pairs(rng)
    value, _ = tools.evaluate(tools.load(damaged_table), wi, wo)
    assert np.isfinite(value).all()
    expected = damaged_table.eval(wi, wo)
    assert np.quantile(np.abs(value - expected) / (expected + 1e-3), 0.99) < 1e-3


@pytest.mark.parametrize("theta_i", THETA_I, ids=lambda x: f"{np.rad2deg(x):.0f}")
@pytest.mark.parametrize("name", ["rough-gold", "polished-chrome", "glossy-plastic"])
def test_chi_square(name, theta_i):
    test = tools.chi2_test(tools.load(built_in(name)), theta_i)
    assert test.run(0.01, 12, quiet=True), test.messages


@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic"])
def test_mean_weight_is_the_albedo(name, rng):
    """Against cosine sampling of the table in NumPy."""
    table = built_in(name)
    wi = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    _, _, weight = tools.draw(tools.load(table), wi, rng, 400_000)
    radius2, phi = (np.arange(200)[:, None] + 0.5) / 200, 2.0 * np.pi * (np.arange(400) + 0.5) / 400
    radius = np.sqrt(radius2)
    wo = np.stack(np.broadcast_arrays(radius * np.cos(phi), radius * np.sin(phi), np.sqrt(1.0 - radius2)), -1)
    albedo = np.pi * table.eval(wi, wo).mean((0, 1))
    np.testing.assert_allclose(weight.mean(0), albedo, rtol=0.01)


def test_files_in_dict_and_xml(make_table, tmp_path, rng):
    table, (wi, wo) = make_table(shape=(90, 90, 180)), pairs(rng, 200)
    write_merl(table, tmp_path / "small.binary")
    by_name = mi.load_dict({"type": "dsbrdf_measured", "filename": str(tmp_path / "small.binary")})
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="dsbrdf_measured">'
        '<string name="filename" value="small.binary"/></bsdf></shape></scene>'
    )
    in_xml = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].bsdf()
    for bsdf in (by_name, in_xml):
        np.testing.assert_allclose(tools.evaluate(bsdf, wi, wo)[0], table.eval(wi, wo), rtol=2e-4)
    assert "small" in str(by_name)
    assert "cells = (90, 90, 180)" in str(by_name)


def test_uneven_cells_are_put_on_even_ones(make_table, rng):
    table = make_table(shape=(40, 40, 40))
    uneven = dataclasses.replace(table, planes=table.planes[:, :, :30], theta_d=table.theta_d[:30])
    wi, wo = pairs(rng)
    value, _ = tools.evaluate(tools.load(uneven), wi, wo)
    assert np.median(np.abs(value / uneven.eval(wi, wo) - 1.0)) < 0.01


def test_one_channel_is_grey(make_table, rng):
    table, (wi, wo) = make_table(1), pairs(rng, 100)
    value, _ = tools.evaluate(tools.load(table), wi, wo)
    np.testing.assert_array_equal(value[:, 0], value[:, 2])
    np.testing.assert_allclose(value[:, :1], table.eval(wi, wo), rtol=2e-4)


def test_what_does_not_fit(make_table, tmp_path):
    with pytest.raises(RuntimeError, match="needs 1 or 3 channels, the table has 2"):
        tools.load(make_table(2))
    with pytest.raises(RuntimeError, match="'filename' of a table, or 'values'"):
        mi.load_dict({"type": "dsbrdf_measured"})
    with pytest.raises(
        RuntimeError, match=r"'values' must be \(theta_h, theta_d, phi_d, channel\), got shape"
    ):
        mi.load_dict({"type": "dsbrdf_measured", "values": mi.TensorXf(np.ones((2, 3), np.float32))})
    np.savetxt(
        tmp_path / "scattered.txt", [[10.0, 20.0, 0.0, 0.5]] * 9, header="theta_i_deg theta_o_deg phi_deg r"
    )
    with pytest.raises(RuntimeError, match=r"scattered samples|no known format|column"):
        mi.load_dict({"type": "dsbrdf_measured", "filename": str(tmp_path / "scattered.txt")})


def test_tabulated_baseline(rng):
    """Anything with `eval` can become a table."""
    table = tabulate(built_in("matte").eval, "again", shape=(20, 18, 36))
    assert render.to_dict(table)["type"] == "dsbrdf_measured"
    value, _ = tools.evaluate(tools.load(table), *pairs(rng, 10))
    assert value.shape == (10, 3)
