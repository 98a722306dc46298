"""Models that reflect no more light than they receive."""

import numpy as np
import pytest
from by_hand import by_hand
from models import upper

from dsbrdf.model import energy

TOO_BRIGHT = {
    "lambert": by_hand([np.log1p(1.3 / np.pi)], [1e-9], [0.0], rise=0.0, tint=(1.0, 0.5, 1.0)),
    "metal": by_hand([1.7, 0.4], [60.0, 8.0], [-0.4, 0.3]),
    "grazing": by_hand([0.8], [12.0], [0.0], rise=0.9),
}
TOO_BRIGHT["falloff"] = TOO_BRIGHT["metal"].replace(
    lobes=TOO_BRIGHT["metal"].lobes.replace(falloff=[[2.0], [-0.4]])
)
ANGLES = np.deg2rad(np.linspace(0.0, 89.0, 40))


@pytest.fixture(scope="module", params=TOO_BRIGHT)
def pair(request):
    model = TOO_BRIGHT[request.param]
    return model, model.conserve_energy()


def test_no_albedo_is_above_one(pair):
    before, after = pair
    assert before.albedo(ANGLES).max() > 1.05
    assert after.albedo(ANGLES).max() <= 1.0 + 1e-3
    # No more than needed
    assert after.albedo(ANGLES).max() > 0.95


def test_it_stays_reciprocal_and_is_nowhere_much_brighter(pair, rng):
    before, after = pair
    wi, wo = upper(rng, 2000), upper(rng, 2000)
    values = after.eval(wi, wo)
    np.testing.assert_array_equal(values, after.eval(wo, wi))
    # A curve may rise a little where its neighbours fall
    assert (values <= 1.02 * before.eval(wi, wo) + 1e-3).all()


def test_shapes_stay(pair):
    before, after = pair
    for name in ("scale", "gamma", "beta", "falloff"):
        np.testing.assert_array_equal(getattr(after.lobes, name), getattr(before.lobes, name))
    assert after.errors == {}


def test_what_conserves_energy_is_not_touched():
    model = by_hand([0.2], [4.0], [0.0])
    assert model.albedo(ANGLES).max() < 1.0
    assert model.conserve_energy() is model


def test_a_channel_below_one_is_not_touched():
    model = TOO_BRIGHT["lambert"]
    after = model.conserve_energy()
    before, now = (m.lobes.at(ANGLES).kappa for m in (model, after))
    np.testing.assert_allclose(now[:, 1], before[:, 1], rtol=1e-9)
    assert (now[:, 0] < before[:, 0]).all()


def test_curves_of_few_coefficients_are_refined_exactly(rng):
    from dsbrdf.model.lobes import curve_design

    x = np.linspace(0.0, 1.0, 50)
    for size in (1, 2, 3):
        coefficients = rng.normal(size=(2, 3, size))
        refined = energy._refined(coefficients, 8)
        np.testing.assert_allclose(
            refined @ curve_design(x, 8).T, coefficients @ curve_design(x, size).T, atol=1e-12
        )


def test_warning_names_the_bright_ones():
    fine = by_hand([0.2], [4.0], [0.0], name="fine")
    bright = [TOO_BRIGHT["metal"].replace(name=f"bright {i}") for i in range(7)]
    assert energy.warning([fine]) == ""
    text = energy.warning([fine, *bright])
    assert text.startswith("warning: reflects more light than it receives: bright 0 (")
    assert "bright 4 (" in text
    assert "and 2 more. 'dsbrdf check' tells where" in text
