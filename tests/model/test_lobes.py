"""The numbers of a model: curves over cos(theta_d), shapes, counts, names, and what is wrong with them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import SIZES, by_angles, curve, random_model

from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes, curve_design

X = np.linspace(0.0, 1.0, 201)
SIZE = pytest.mark.parametrize("size", range(1, 8))


# Curves


@SIZE
def test_functions_of_a_curve_share_out_one(size):
    design = curve_design(X, size)
    assert design.shape == (len(X), size)
    assert (design >= 0.0).all()
    np.testing.assert_allclose(design.sum(1), 1.0, rtol=1e-15)


@SIZE
def test_curves_are_b_splines(size):
    np.testing.assert_allclose(curve_design(X, size), curve(np.eye(size), X).T, atol=1e-14)


@SIZE
def test_curves_end_at_their_first_and_last_coefficient(size):
    ends = curve_design([0.0, 1.0], size)
    np.testing.assert_array_equal(ends, np.eye(size)[[0, -1]])


@pytest.mark.parametrize("size", range(2, 8))
def test_a_line_is_a_curve_of_any_size(size):
    # Coefficients of a line lie at the means of two neighbouring knots
    spans = max(size - 2, 1)
    knots = np.clip((np.arange(size + 1) - 1) / spans, 0.0, 1.0) if size > 2 else np.array([0.0, 0.0, 2.0])
    places = 0.5 * (knots[:-1] + knots[1:])
    np.testing.assert_allclose(curve_design(X, size) @ places, X, atol=1e-15)


@given(st.integers(3, 7), st.integers(1, 4), st.floats(-1e-9, 1e-9))
def test_curves_have_no_steps_nor_kinks_at_knots(size, knot, step):
    at = min(knot, size - 3) / (size - 2)
    x = np.clip([at - 1e-4, at - abs(step), at, at + abs(step), at + 1e-4], 0.0, 1.0)
    design = curve_design(x, size)
    assert np.abs(np.diff(design[1:4], axis=0)).max() < 1e-7
    if at > 0.0:
        left, right = (design[2] - design[0]) / 1e-4, (design[4] - design[2]) / 1e-4
        np.testing.assert_allclose(left, right, atol=0.02)


# Parameters


def test_parameters_at_an_angle(rng):
    lobes = random_model(sizes=(6, 4, 3, 2, 5), n_channels=5).lobes
    theta_d = rng.uniform(0.0, np.pi / 2, 9)
    x = np.cos(theta_d)
    found = lobes.at(theta_d)
    assert found.kappa.shape == (9, 5, 3)
    expected = np.exp(curve(lobes.scale, x) + curve(lobes.colour, x))
    np.testing.assert_allclose(found.kappa, np.moveaxis(expected, -1, 0), rtol=1e-12)
    np.testing.assert_allclose(found.gamma, np.exp(curve(lobes.gamma, x)).T, rtol=1e-12)
    np.testing.assert_allclose(found.beta, curve(lobes.beta, x).T, rtol=1e-12)
    np.testing.assert_allclose(found.falloff, curve(lobes.falloff, x).T, rtol=1e-12)
    with pytest.raises(ValueError, match=r"'theta_d' must lie in \[0, pi/2\] radians, got 45"):
        lobes.at([45.0])


def test_kappa_has_an_upper_end():
    lobes = random_model().lobes
    lobes = lobes.replace(scale=lobes.scale + 100.0)
    np.testing.assert_allclose(lobes.at([0.3]).kappa, np.exp(MAX_LN_KAPPA))


@pytest.mark.parametrize(("n_channels", "expected"), [(1, 39), (3, 51), (31, 219)])
def test_number_of_parameters(n_channels, expected):
    model = random_model(n_channels=n_channels)
    assert SIZES == (5, 4, 3, 1, 2)
    assert model.n_parameters == model.lobes.n_parameters == expected


def test_what_channels_share_of_a_colour_is_no_number_of_its_own(rng):
    """As many numbers as the values have directions to move in."""
    model = random_model(n_lobes=2)
    angles = rng.uniform(0.0, [[1.0], [np.pi / 2], [np.pi]], (3, 400))
    columns = []
    for name in ("scale", "gamma", "beta", "falloff", "colour"):
        part = getattr(model.lobes, name)
        for at in np.ndindex(part.shape):
            moved = [part.copy(), part.copy()]
            moved[0][at] += 1e-5
            moved[1][at] -= 1e-5
            up, down = (np.log(by_angles(model.lobes.replace(**{name: to}), *angles)) for to in moved)
            columns.append((up - down).ravel() / 2e-5)
    singular = np.linalg.svd(np.array(columns), compute_uv=False)
    assert (singular > 1e-7 * singular[0]).sum() == model.n_parameters


def test_take():
    lobes = random_model().lobes
    for which, expected in ((1, [1]), ([2, 0], [2, 0]), (slice(1, 3), [1, 2])):
        taken = lobes.take(which)
        np.testing.assert_array_equal(taken.gamma, lobes.gamma[expected])
        np.testing.assert_array_equal(taken.colour, lobes.colour[:, expected])


def test_lists_become_arrays():
    lobes = Lobes([[0]], [[1]], [[0]], [[0]], [[[0]], [[1]]])
    assert lobes.scale.dtype == np.float64
    assert (lobes.n_lobes, lobes.n_channels) == (1, 2)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"scale": np.zeros(3)},
            r"'scale' must have shape \(lobe, coefficient\) with a coeff.*, got \(3,\)\.",
        ),
        ({"scale": np.zeros((3, 0))}, r"'scale' must have shape .* got \(3, 0\)\."),
        ({"scale": 0.0}, r"'scale' must have shape .* got \(\)\."),
        ({"scale": None}, r"'scale' must have shape .* got \(\)\."),
        ({"gamma": np.zeros((2, 4))}, r"'gamma' must have .* as many lobes as 'scale', got \(2, 4\)\."),
        ({"beta": np.zeros((3, 4, 1))}, r"'beta' must have shape .* got \(3, 4, 1\)\."),
        (
            {"colour": np.zeros((3, 2))},
            r"'colour' must have shape \(channel, lobe, coefficient\).* got \(3, 2\)\.",
        ),
        ({"colour": np.zeros((3, 2, 2))}, r"'colour' must have shape .* got \(3, 2, 2\)\."),
        ({"colour": np.zeros((0, 3, 2))}, r"'colour' must have shape .* got \(0, 3, 2\)\."),
        ({"scale": np.full((3, 2), np.nan)}, r"'scale' must be finite, got nan at index \(0, 0\)\."),
        ({"gamma": np.full((3, 2), np.inf)}, r"'gamma' must be finite, got inf at index \(0, 0\)\."),
        ({"falloff": np.full((3, 1), -1.0)}, r"'falloff' must be >= -0\.9 and <= 20 and finite, got -1 at"),
        ({"falloff": np.full((3, 1), 21.0)}, r"'falloff' must be >= -0\.9 and <= 20 and finite, got 21 at"),
    ],
)
def test_says_what_is_wrong_with_a_parameter(change, text):
    with pytest.raises(ValueError, match=text):
        random_model().lobes.replace(**change)


@pytest.mark.parametrize("names", [("r", "g"), ("r", "g", "g"), ["a", "b", "c", "d"]])
def test_a_name_for_each_channel(names):
    with pytest.raises(ValueError, match=r"'channels' must be 3 different names, got \["):
        random_model().replace(channels=names)


@pytest.mark.parametrize(
    ("n_channels", "expected"), [(1, ("value",)), (3, ("r", "g", "b")), (4, ("0", "1", "2", "3"))]
)
def test_names_of_channels_by_default(n_channels, expected):
    assert random_model(n_channels=n_channels).channels == expected
