"""The delta term: found where lobes fall short below a degree, and nowhere else."""

import numpy as np
import pytest

from dsbrdf import half_diff, hemi_epd, tabulate
from dsbrdf.paper import Slices, fit_slices, spike

HEIGHT = 40.0


def lobe_and_cap(height):
    """A broad lobe, and a cap of the half vector below one degree."""

    def reflectance(wi, wo):
        theta_h, _, _ = half_diff.from_directions(wi, wo)
        value = hemi_epd.lobe(theta_h, 0.5, 8.0) + height * spike.cap(np.sin(theta_h) ** 2)
        return np.repeat(value[..., None], 2, axis=-1)

    return tabulate(reflectance, "cap", shape=(90, 18, 20))


def test_height_is_recovered():
    model = fit_slices(lobe_and_cap(HEIGHT), 1, n_slices=6).model
    assert model.spike.shape == (6, 2)
    np.testing.assert_allclose(model.spike, HEIGHT, rtol=1e-4)
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(model.eval(up, up), HEIGHT + np.expm1(0.5), rtol=1e-4)


def test_none_where_lobes_suffice_and_on_request():
    assert not fit_slices(lobe_and_cap(0.0), 1, n_slices=6).model.spike.any()
    assert not fit_slices(lobe_and_cap(HEIGHT), 1, n_slices=6, spike=False).model.spike.any()


def test_lobes_and_errors_do_not_depend_on_it():
    with_spike, without = (fit_slices(lobe_and_cap(HEIGHT), 1, n_slices=6, spike=on) for on in (True, False))
    np.testing.assert_array_equal(with_spike.model.kappa, without.model.kappa)
    assert with_spike.errors.rel_rms == without.errors.rel_rms


def test_ends_at_one_degree():
    model = fit_slices(lobe_and_cap(HEIGHT), 1, n_slices=6).model
    inside, outside = np.deg2rad([0.5, 1.001])
    plain = model.replace(spike=None)
    assert (model.eval_angles(inside, 0.3, 0.1) > plain.eval_angles(inside, 0.3, 0.1) + 1.0).all()
    np.testing.assert_array_equal(model.eval_angles(outside, 0.3, 0.1), plain.eval_angles(outside, 0.3, 0.1))


def test_lobe_alone_has_none_and_parts_add_up():
    model = fit_slices(lobe_and_cap(HEIGHT), 2, n_slices=6).model
    wi, wo = half_diff.to_directions([0.0, 0.005, 0.3], 0.2, 1.0)
    only_spike = model.replace(kappa=np.full_like(model.kappa, 1e-300)).eval(wi, wo)
    lobes = sum(model.lobe(k).eval(wi, wo) for k in range(2))
    np.testing.assert_allclose(lobes + only_spike, model.eval(wi, wo), rtol=1e-12)


@pytest.mark.parametrize(
    ("spikes", "text"), [([[-1.0]], "'spike' must be >= 0"), ([[1.0, 2.0]], "'spike' must have shape")]
)
def test_says_what_is_wrong(spikes, text):
    one = np.ones((1, 1, 1))
    with pytest.raises(ValueError, match=text):
        Slices(theta_d=[0.1], kappa=one, gamma=one, beta=0.0 * one, spike=spikes)
