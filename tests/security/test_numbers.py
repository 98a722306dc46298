"""What is said of a fit holds: energy, whatever the width of a mirror; any scale, any order of channels, any gaps."""

import dataclasses

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf import Samples, half_diff, tabulate
from dsbrdf.model import energy

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


@pytest.fixture(scope="module")
def table():
    """A rough base and a highlight in colour."""

    def reflectance(wi, wo):
        theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
        highlight = np.exp(-((theta_h / 0.2) ** 2)) * (1.0 + (1.0 - np.cos(theta_d)) ** 5)
        return 0.1 + highlight[..., None] * [1.0, 0.6, 0.3]

    return tabulate(reflectance, "shiny", shape=(24, 18, 16))


@pytest.mark.parametrize("width", [0.07, 0.3, 1.0])
def test_the_light_of_a_narrow_mirror_is_kept(width):
    """Values of 1e4 within so many degrees: their share of the albedo is there, and the printed error is no smaller."""

    def reflectance(wi, wo):
        theta_h, _, _ = half_diff.from_directions(wi, wo)
        return (0.1 / np.pi + 1e4 * np.exp(-((np.rad2deg(theta_h) / width) ** 4)))[..., None]

    fit = dsbrdf.fit(tabulate(reflectance, "mirror", shape=(90, 20, 16)))
    for theta_i in np.deg2rad([0.0, 30.0]):
        theta = np.deg2rad(width) * np.linspace(0.0, 3.0, 3000)
        spot = 1e4 * np.exp(-((np.rad2deg(theta) / width) ** 4)) * np.sin(theta)
        # The solid angle of the light is 4 cos(theta_d) times that of the half vector
        true = 0.1 + 8.0 * np.pi * np.trapezoid(spot, theta) * np.cos(theta_i) ** 2
        found = fit.model.albedo(theta_i)[0]
        assert abs(found / true - 1.0) < 0.06
        assert abs(found / true - 1.0) < max(fit.errors.albedo, 0.01)


@pytest.mark.parametrize("order", [[2, 1, 0], [1, 2, 0]])
def test_lobes_do_not_depend_on_the_order_of_channels(table, order):
    turned = dataclasses.replace(table, planes=table.planes[order], scale=table.scale[order])
    a, b = dsbrdf.fit(table).model.lobes, dsbrdf.fit(turned).model.lobes
    # As near as the search comes to its minimum; another order would be whole units away
    np.testing.assert_allclose(b.gamma, a.gamma, atol=5e-3)
    np.testing.assert_allclose(b.colour, a.colour[order], atol=5e-3)


@pytest.mark.parametrize("factor", [1e-12, 1e-3, 1e12])
def test_a_fit_is_as_good_in_any_unit(table, factor):
    a, b = (dsbrdf.fit(dataclasses.replace(table, scale=s * table.scale), 2).errors for s in (1.0, factor))
    assert b.rel < 1.1 * a.rel
    assert b.cbrt < 1.1 * a.cbrt


@pytest.mark.parametrize("factor", [1e200, 1e305, 1e-300, 1e-30])
def test_values_out_of_all_proportion_are_refused(table, factor):
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    for measured in (
        dataclasses.replace(table, scale=factor * table.scale),
        Samples(up, up, np.full((3, 1), factor)),
    ):
        with pytest.raises(
            ValueError, match=r"the brightest value is .*/sr, expected 1e-15 to 1e\+30\. Bring it to"
        ):
            dsbrdf.fit(measured)


def test_what_has_no_data_is_said(table):
    planes = np.array(table.planes)
    planes[1] = -1.0
    planes[:, :, 9:] = -1.0
    sentence = dsbrdf.fit(dataclasses.replace(table, planes=planes), 1).coverage.sentence
    assert "no value in channel 1" in sentence
    assert "theta_d only" in sentence


@pytest.mark.parametrize("brighter", [0.0, 0.02, 0.5, 2.0])
def test_fits_warn_of_what_check_finds(brighter):
    """The same angles, the same limit: just below and just above an albedo of 1."""
    model = smooth_model(1, n_lobes=1).conserve_energy()
    lobes = model.lobes
    top = float(model.albedo(energy.ALBEDO_ANGLES).max())
    model = model.replace(lobes=lobes.replace(scale=lobes.scale - np.log(top) + brighter - 0.01))
    found = any("more light than it receives" in problem for problem in dsbrdf.check_model(model).problems)
    assert bool(energy.warning([model])) == found
    assert found == (model.albedo(energy.ALBEDO_ANGLES).max() > 1.001)
