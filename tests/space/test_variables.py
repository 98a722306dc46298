"""Rows of numbers: there and back, curves of other sizes, ranges, and the unknowns of the estimator."""

import numpy as np
import pytest
from spaces import smooth_model

from dsbrdf.model.lobes import FALLOFF, MAX_BETA, Lobes
from dsbrdf.space.variables import DARK, LEAST_KAPPA, Sizes, Variables, gram, resized

VARIABLES = Variables(Sizes(), 3)


def assert_same_curves(a, b, **tolerance):
    theta_d = np.linspace(0.0, np.pi / 2, 31)
    for name, x, y in zip(a.at(theta_d)._fields, a.at(theta_d), b.at(theta_d), strict=True):
        np.testing.assert_allclose(x, y, err_msg=name, **tolerance)


@pytest.mark.parametrize("sizes", [Sizes(), (2, 1, 3, 1, 1), (3, 2, 1, 1, 6), (1, 3, 2, 1, 3)])
def test_lobes_come_back(sizes):
    lobes = smooth_model(5, sizes=Sizes(*sizes)).lobes
    assert_same_curves(VARIABLES.lobes(VARIABLES.of(lobes)), lobes, rtol=1e-9)


def test_lobes_of_one_channel_come_back():
    variables = Variables(Sizes(), 1)
    lobes = smooth_model(5, n_channels=1).lobes
    assert_same_curves(variables.lobes(variables.of(lobes)), lobes, rtol=1e-9)


def test_curves_of_more_coefficients_become_the_nearest():
    lobes = smooth_model(7, sizes=Sizes(8, 6, 4, 2, 8)).lobes
    back = VARIABLES.lobes(VARIABLES.of(lobes))
    assert back.scale.shape == (3, 6)
    assert_same_curves(back, lobes, rtol=0.4, atol=0.2)


def test_dark_ends_do_not_bend_what_is_seen():
    """A lobe of eight coefficients that falls off a cliff: what is above stays, where plain least squares rings."""
    scale = np.array([[-38.0, -38.0, -30.0, -6.0, -0.8, -0.6, -0.5, -0.5]])
    lobes = Lobes(scale, [[3.0]], [[0.0]], [[0.0]], np.zeros((3, 1, 1)))
    plain = lobes.replace(scale=resized(scale, 6))
    bright = np.deg2rad([0.0, 20.0, 40.0, 50.0])
    wanted, got, rung = (
        np.log(x.at(bright).kappa) for x in (lobes, VARIABLES.lobes(VARIABLES.of(lobes)), plain)
    )
    assert np.abs(got - wanted).max() < 0.2
    assert np.abs(rung - wanted).max() > 0.4


def test_colours_are_those_of_what_is_seen():
    """Of a lobe that is dark toward grazing light, where its height has no colour."""
    scale = np.array([[-14.0, -12.0, -9.0, -2.0, 0.0, 1.0]])
    colour = np.array([[[0.9, 0.6]], [[0.0, 0.0]], [[-0.9, -0.6]]])
    rows = VARIABLES.of(Lobes(scale, [[3.0]], [[0.0]], [[0.0]], colour))
    np.testing.assert_allclose(VARIABLES.unknowns(rows)[14:].reshape(3, 2), colour[:, 0], atol=0.2)


def test_any_rows_give_valid_lobes(rng):
    rows = 50.0 * rng.normal(size=(1000, VARIABLES.n_numbers))
    lobes = VARIABLES.lobes(rows)
    at = lobes.at(np.linspace(0.0, np.pi / 2, 9))
    assert np.isfinite(np.expm1(at.kappa)).all()
    assert ((at.gamma > 0.0) & np.isfinite(at.gamma)).all()
    assert (np.abs(at.beta) <= MAX_BETA).all()
    assert ((at.falloff >= FALLOFF[0]) & (at.falloff <= FALLOFF[1])).all()


def test_the_height_is_that_of_the_peak_and_ends_in_the_dark():
    kappa = np.array([5.0, 0.3, 1e-9])
    lobes = Lobes(np.log(kappa)[:, None], np.ones((3, 1)), *np.zeros((2, 3, 1)), np.zeros((3, 3, 1)))
    height = VARIABLES.parts(VARIABLES.of(lobes)).height
    np.testing.assert_allclose(np.exp(height) - DARK, np.expm1(kappa)[:, None] * np.ones(6), rtol=1e-6)
    assert height[2] == pytest.approx(VARIABLES.dark, abs=1e-5)


def test_dark_lobes_are_left_out():
    rows = VARIABLES.of(smooth_model(3).lobes)
    parts = VARIABLES.parts(rows)
    parts.height[1], parts.colour[1] = VARIABLES.dark, 0.0
    dark = VARIABLES.joined(parts)
    assert VARIABLES.lobes(dark).n_lobes == 2
    assert VARIABLES.lobes(dark[1:2]).n_lobes == 1


def test_metric_is_the_mean_over_theta_d(rng):
    a, b = rng.normal(size=(2, VARIABLES.n_numbers))
    theta_d = np.pi / 2 * (np.arange(20_000) + 0.5) / 20_000

    def mean(x, y):
        from dsbrdf.model.lobes import curve_design

        design = curve_design(np.cos(theta_d), x.shape[-1])
        return ((design @ x.T) * (design @ y.T)).mean()

    x, y = VARIABLES.parts(a), VARIABLES.parts(b)
    expected = mean(x.height, y.height) + mean(x.gamma, y.gamma) + mean(x.beta, y.beta)
    expected += np.exp(-4.0) * mean(x.falloff, y.falloff)
    expected += np.mean([mean(x.colour[c], y.colour[c]) for c in range(3)])
    assert a @ VARIABLES.metric(2.0) @ b == pytest.approx(expected, rel=1e-4)


def test_gram_and_resized():
    assert gram(6).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(resized(np.array([[1.0, 3.0]]), 4), [[1.0, 1.5, 2.5, 3.0]], atol=1e-9)


@pytest.mark.parametrize("n_channels", [1, 3, 4])
def test_unknowns_are_those_of_the_estimator(n_channels):
    """The coefficients of a model whose lobes are all seen, in the kernel's order."""
    variables = Variables(Sizes(), n_channels)
    lobes = smooth_model(4, n_channels=n_channels).lobes
    shared = np.concatenate([lobes.scale, lobes.gamma, lobes.beta, lobes.falloff], axis=1)
    expected = np.concatenate([shared.ravel(), lobes.colour.ravel() if n_channels > 1 else []])
    got = variables.unknowns(variables.of(lobes))
    assert got.shape == expected.shape
    # The logarithms of gamma end softly, at 0.05
    np.testing.assert_allclose(got, expected, atol=0.1)


def test_unknowns_of_what_is_dark_are_finite_and_the_same():
    rows = np.stack([VARIABLES.of(smooth_model(i).lobes) for i in range(2)])
    parts = VARIABLES.parts(rows)
    parts.height[:, 0], parts.colour[:, 0] = VARIABLES.dark, 0.0
    unknowns = VARIABLES.unknowns(VARIABLES.joined(parts))
    np.testing.assert_allclose(unknowns[:, :6], np.log(LEAST_KAPPA), atol=1e-6)
    n_shared = 3 * sum(Sizes()[:4])
    np.testing.assert_allclose(unknowns[:, n_shared:].reshape(2, 3, 3, 2)[:, :, 0], 0.0, atol=1e-9)


def test_sizes_are_positive():
    with pytest.raises(
        ValueError, match=r"a coefficient at least, .* got sizes \(6, 0, 3, 1, 2\) and 3 channels"
    ):
        Variables(Sizes(gamma=0), 3)
