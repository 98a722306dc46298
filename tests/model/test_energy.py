"""Models that reflect no more light than they receive."""

import numpy as np
import pytest
from tables import built_in, lobes, quiet_fit

from dsbrdf.model import energy

TOO_BRIGHT = {
    "lambert": lobes([np.log1p(1.3 / np.pi)], [0.0], [0.0], rise=0.0, tint=(1.0, 0.5, 1.0)),
    "metal": lobes([1.7, 0.4], [60.0, 8.0], [-0.4, 0.3]),
    "grazing": lobes([0.8], [12.0], [0.0], rise=0.9),
}
TOO_BRIGHT["spike"] = lobes([0.1], [1.0], [0.0]).replace(spike=np.full((6, 3), 2000.0))
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
    assert after.albedo(ANGLES).max() > 0.99


def test_it_stays_reciprocal_and_is_nowhere_much_brighter(pair, rng):
    before, after = pair
    wi = rng.normal(size=(2000, 3))
    wo = rng.normal(size=(2000, 3))
    for w in (wi, wo):
        w[:, 2] = np.abs(w[:, 2])
        w /= np.linalg.norm(w, axis=-1, keepdims=True)
    values = after.eval(wi, wo)
    np.testing.assert_array_equal(values, after.eval(wo, wi))
    # Lobes keep their kind: the tail may gain a little where the peak loses
    assert (values <= 1.02 * before.eval(wi, wo) + 1e-3).all()
    np.testing.assert_array_equal(after.beta, before.beta)


def test_what_conserves_energy_is_not_touched():
    model = quiet_fit(built_in("rough-gold"), 2).model
    assert model.conserve_energy() is model


def test_a_channel_below_one_is_not_touched():
    model = TOO_BRIGHT["lambert"]
    after = model.conserve_energy()
    np.testing.assert_allclose(after.kappa[:, 1], model.kappa[:, 1], rtol=1e-12)
    assert (after.kappa[:, 0] < model.kappa[:, 0]).all()


def test_a_lobe_times_a_factor_keeps_peak_and_integral():
    model = lobes([2.0, 0.3], [200.0, 1.0], [0.5, -0.4])
    factors = np.linspace(0.3, 1.0, 18).reshape(6, 3)
    scaled = energy._scale(model, factors)
    np.testing.assert_allclose(np.expm1(scaled.kappa), factors[..., None] * np.expm1(model.kappa))
    theta_h = np.linspace(0.0, np.pi / 2, 20001)[:, None, None, None]
    for kept, wanted in ((scaled, model),):
        integrals = [
            np.trapezoid(np.expm1(m.kappa * np.cos(theta_h) ** m.gamma) * np.sin(theta_h), theta_h, axis=0)
            for m in (kept, wanted)
        ]
        np.testing.assert_allclose(integrals[0], factors[..., None] * integrals[1], rtol=1e-5)


def test_light_of_slices_adds_up_to_the_albedo():
    model = lobes([2.0, 0.3], [200.0, 1.0], [0.5, -0.4]).replace(spike=np.full((6, 3), 100.0))
    theta_i = np.deg2rad([0.0, 40.0, 80.0])
    light = energy._light_of_slices(model, theta_i)
    np.testing.assert_allclose(light.sum(1), model.albedo(theta_i), rtol=2e-3)
    assert light[0, 0].min() > 0.0
    assert light[0, -1].max() < 0.05 * light[0, 0].max()


def test_a_model_that_cannot_be_brought_down_says_so(monkeypatch):
    monkeypatch.setattr(energy, "MAX_ROUNDS", 1)
    with pytest.raises(
        RuntimeError, match=r"the albedo of the model is still .* after 1 rounds\. Fit it anew"
    ):
        TOO_BRIGHT["metal"].conserve_energy()


def test_warning_names_what_is_too_bright():
    fine = lobes([0.1], [0.0], [0.0])
    assert energy.warning([fine, fine]) == ""
    bright = TOO_BRIGHT["lambert"].replace(name="snow")
    text = energy.warning([fine, bright, *[TOO_BRIGHT["spike"]] * 6])
    assert text.startswith("warning: reflects more light than it receives: snow (1.30), model (")
    assert "and 2 more. 'dsbrdf check' tells where" in text
