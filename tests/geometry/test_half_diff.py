"""Half and difference angles (Eq. 2): both ways, against rotation matrices, symmetries, degenerate pairs."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH, azimuthal_factor, from_directions, to_directions

polar = st.floats(0.0, np.pi / 2)
inner = st.floats(1e-3, np.pi / 2 - 1e-3)
azimuth = st.floats(0.0, 2 * np.pi, exclude_max=True)


def direction(theta, phi):
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


above = st.builds(direction, polar, azimuth)


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turned(angle):
    """An angle brought to within (-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def random_pairs(rng, *shape):
    return (direction(rng.uniform(0, np.pi / 2, shape), rng.uniform(0, 2 * np.pi, shape)) for _ in range(2))


@given(theta_h=inner, theta_d=inner, phi_d=azimuth)
def test_angles_survive_the_way_there_and_back(theta_h, theta_d, phi_d):
    back = from_directions(*to_directions(theta_h, theta_d, phi_d))
    assert_allclose(back[:2], (theta_h, theta_d), rtol=0, atol=1e-11)
    assert abs(turned(back[2] - phi_d)) < 1e-9


@given(wi=above, wo=above)
def test_directions_survive_the_way_there_and_back(wi, wo):
    assume(np.linalg.norm(wi + wo) > 1e-4)
    half = wi + wo
    back = to_directions(*from_directions(wi, wo))
    # `to_directions` has the half vector in the x-z plane
    turn = about_z(np.arctan2(half[1], half[0]))
    assert_allclose(turn @ back[0], wi, rtol=0, atol=1e-10)
    assert_allclose(turn @ back[1], wo, rtol=0, atol=1e-10)


@given(wi=above, wo=above)
def test_equation_2_by_rotation_matrices(wi, wo):
    half = wi + wo
    assume(np.linalg.norm(half) > 1e-4)
    theta_h, theta_d, phi_d = from_directions(wi, wo)
    half = half / np.linalg.norm(half)
    assert_allclose(theta_h, np.arctan2(np.hypot(half[0], half[1]), half[2]), rtol=0, atol=1e-11)
    wd = about_y(-theta_h) @ about_z(-np.arctan2(half[1], half[0])) @ wi
    assert_allclose(direction(theta_d, phi_d), wd, rtol=0, atol=1e-10)


@given(theta_h=polar, theta_d=polar, phi_d=azimuth)
def test_to_directions_inverts_equation_2_by_rotation_matrices(theta_h, theta_d, phi_d):
    wi, wo = to_directions(theta_h, theta_d, phi_d)
    assert_allclose(about_y(-theta_h) @ wi, direction(theta_d, phi_d), rtol=0, atol=1e-14)
    assert_allclose(about_y(-theta_h) @ wo, direction(theta_d, phi_d + np.pi), rtol=0, atol=1e-14)


@given(wi=above, wo=above)
def test_angles_of_directions_above_the_horizon_are_in_range(wi, wo):
    theta_h, theta_d, phi_d = from_directions(wi, wo)
    assert 0.0 <= theta_h <= np.pi / 2
    assert 0.0 <= theta_d <= np.pi / 2
    assert 0.0 <= phi_d < 2 * np.pi


def test_phi_d_just_below_zero_does_not_round_to_a_full_turn():
    wi = np.array([np.sin(1.0), -1e-20, np.cos(1.0)])
    assert from_directions(wi, wi * [-1, -1, 1])[2] == 0.0


@given(wi=above, wo=above)
def test_exchange_keeps_theta_to_the_last_bit_and_adds_pi_to_phi_d(wi, wo):
    theta_h, theta_d, phi_d = from_directions(wi, wo)
    exchanged = from_directions(wo, wi)
    assert_array_equal(exchanged[:2], (theta_h, theta_d))
    if theta_d > 0.0:
        assert_allclose(abs(turned(exchanged[2] - phi_d)), np.pi, rtol=0, atol=1e-14)


def test_exchange_keeps_theta_to_the_last_bit_on_many_pairs(rng):
    wi, wo = random_pairs(rng, 100_000)
    here, there = from_directions(wi, wo), from_directions(wo, wi)
    assert_array_equal(here[0], there[0])
    assert_array_equal(here[1], there[1])


def test_turning_both_directions_about_the_normal_changes_nothing(rng):
    wi, wo = random_pairs(rng, 1000)
    turn = about_z(1.234).T
    here, there = from_directions(wi, wo), from_directions(wi @ turn, wo @ turn)
    assert_allclose(there[:2], here[:2], rtol=0, atol=1e-12)
    assert np.abs(turned(there[2] - here[2])).max() < 1e-9


def test_phi_d_is_zero_where_the_light_is_on_the_far_side_of_the_half_vector():
    theta_h, theta_d, phi_d = from_directions(direction(0.9, 2.0), direction(0.3, 2.0))
    assert_allclose([theta_h, theta_d], [0.6, 0.3], rtol=1e-14)
    assert abs(turned(phi_d)) < 1e-14


@given(w=above)
def test_equal_directions_have_no_difference(w):
    theta_h, theta_d, phi_d = from_directions(w, w)
    assert_allclose(theta_h, np.arctan2(np.hypot(w[0], w[1]), w[2]), rtol=1e-15, atol=1e-300)
    assert theta_d == 0.0
    assert phi_d == 0.0


def test_no_difference_gives_equal_directions():
    theta_h = np.linspace(0.0, np.pi / 2, 7)
    wi, wo = to_directions(theta_h, 0.0, 1.0)
    assert_array_equal(wi, wo)
    assert_allclose(wi, direction(theta_h, 0.0), rtol=0, atol=1e-16)


@given(theta=st.floats(1e-6, np.pi / 2), phi=azimuth)
def test_mirror_pairs_are_at_the_pole_with_the_azimuth_of_the_light(theta, phi):
    wi = direction(theta, phi)
    theta_h, theta_d, phi_d = from_directions(wi, wi * [-1, -1, 1])
    assert theta_h == 0.0
    assert_allclose(theta_d, theta, rtol=1e-12)
    assert abs(turned(phi_d - phi)) < 1e-12


@given(phi=azimuth)
def test_opposite_grazing_directions_take_the_normal_as_half_vector(phi):
    wi = np.array([np.cos(phi), np.sin(phi), 0.0])
    for wo in (-wi, -wi + 0.0):
        theta_h, theta_d, phi_d = from_directions(wi, wo)
        assert theta_h == 0.0
        assert theta_d == np.pi / 2
        assert abs(turned(phi_d - phi)) < 1e-14


def test_opposite_directions_of_any_height_are_finite():
    pairs = [
        ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]),
        ([0.6, 0.0, 0.8], [-0.6, 0.0, -0.8]),
        ([1.0, 0.0, -0.0], [-1.0, 0.0, -0.0]),
    ]
    for wi, wo in pairs:
        theta_h, theta_d, phi_d = from_directions(wi, wo)
        assert theta_h == 0.0
        assert theta_d == np.pi / 2
        assert 0.0 <= phi_d < 2 * np.pi


@pytest.mark.parametrize("tilt", [1e-3, 1e-8, 1e-15, 1e-100])
def test_nearly_opposite_grazing_directions_tend_to_the_limit(tilt):
    wi = np.array([np.sqrt(1 - tilt**2), 0.0, tilt])
    theta_h, theta_d, phi_d = from_directions(wi, wi * [-1, 1, 1])
    assert theta_h == 0.0
    assert_allclose(theta_d, np.pi / 2 - tilt, rtol=1e-9)
    assert phi_d == 0.0


def test_grazing_directions_side_by_side_have_a_grazing_half_vector():
    wi, wo = direction(np.pi / 2, [0.3, 0.0]), direction(np.pi / 2, [0.9, 3.0])
    theta_h, theta_d, phi_d = from_directions(wi, wo)
    assert_allclose(theta_h, np.pi / 2, rtol=1e-14)
    assert_allclose(theta_d, [0.3, 1.5], rtol=1e-14)
    assert_allclose(phi_d, 1.5 * np.pi, rtol=1e-14)


def test_theta_h_exceeds_a_right_angle_only_below_the_horizon():
    theta_h, _, _ = from_directions(direction(2.0, 0.0), direction(1.5, 0.0))
    assert_allclose(theta_h, 1.75, rtol=1e-14)


@pytest.mark.parametrize(
    ("shapes", "expected"),
    [
        (((), (), ()), ()),
        (((5, 1, 1), (4, 1), (3,)), (5, 4, 3)),
        (((3,), (), ()), (3,)),
        (((), (3,), ()), (3,)),
        (((), (), (3,)), (3,)),
        (((0, 1), (4,), ()), (0, 4)),
    ],
)
def test_angles_broadcast(shapes, expected):
    wi, wo = to_directions(*(np.full(shape, 0.3) for shape in shapes))
    assert wi.shape == wo.shape == (*expected, 3)
    assert_allclose(np.linalg.norm(wi, axis=-1), 1.0, rtol=1e-15)


def test_directions_broadcast():
    for shapes, expected in [
        (((3,), (3,)), ()),
        (((3,), (0, 3)), (0,)),
        (((4, 1, 3), (5, 3)), (4, 5)),
    ]:
        angles = from_directions(*(np.broadcast_to([0.6, 0.0, 0.8], shape) for shape in shapes))
        assert all(np.shape(angle) == expected for angle in angles)


def test_lists_single_precision_and_strided_views_give_the_same(rng):
    wi, wo = (w.astype(np.float32) for w in random_pairs(rng, 6))
    expected = from_directions(wi.astype(float), wo.astype(float))
    wide = np.zeros((12, 6), np.float32)
    wide[::2, ::2] = wi
    for a, b in [(wi, wo), (wi.tolist(), wo.tolist()), (wide[::2, ::2], np.asfortranarray(wo))]:
        for angle, want in zip(from_directions(a, b), expected, strict=True):
            assert angle.dtype == np.float64
            assert_array_equal(angle, want)


def test_arguments_are_not_written_to():
    wi = np.array([0.6, 0.0, 0.8])
    wi.setflags(write=False)
    angles = np.array([0.1, 0.2])
    angles.setflags(write=False)
    from_directions(wi, wi)
    to_directions(angles, angles, angles)
    azimuthal_factor(angles, angles)


@pytest.mark.parametrize(
    ("wi", "wo", "text"),
    [
        (
            [0.0, 0.0, 0.5],
            [0.0, 0.0, 1.0],
            r"'wi' must be unit vectors on the last axis, got norm 0\.5\. Divide",
        ),
        (
            [0.0, 0.0, 1.0],
            [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]],
            r"'wo' must be unit .* got norm 2 at index 1\.",
        ),
        ([0.0, 1.0], [0.0, 0.0, 1.0], r"'wi' must have x, y, z on its last axis, got shape \(2,\)\."),
        ([0.0, 0.0, 1.0], 1.0, r"'wo' must have x, y, z on its last axis, got shape \(\)\."),
        ([0.0, 0.0, np.nan], [0.0, 0.0, 1.0], r"'wi' must be unit vectors .* got norm nan\."),
    ],
)
def test_bad_directions_are_refused(wi, wo, text):
    with pytest.raises(ValueError, match=text):
        from_directions(wi, wo)


@pytest.mark.parametrize(
    ("angles", "text"),
    [
        ((85.0, 0.1, 0.0), r"'theta_h' must lie in \[0, pi/2\] radians, got 85\. Degrees\?"),
        ((0.1, [0.1, -0.1], 0.0), r"'theta_d' must lie in \[0, pi/2\] radians, got -0\.1 at index 1\."),
        ((0.1, 0.1, [0.0, np.inf]), r"'phi_d' must be finite, got inf at index 1\."),
    ],
)
def test_bad_angles_are_refused(angles, text):
    with pytest.raises(ValueError, match=text):
        to_directions(*angles)


def test_directions_that_do_not_broadcast_are_refused():
    with pytest.raises(ValueError, match="shape mismatch"):
        from_directions(np.tile([0.0, 0.0, 1.0], (2, 1)), np.tile([0.0, 0.0, 1.0], (3, 1)))


@given(theta_h=polar, theta_d=polar)
def test_azimuthal_factor_is_between_zero_and_one_and_symmetric(theta_h, theta_d):
    factor = azimuthal_factor(theta_h, theta_d)
    assert 0.0 <= factor <= 1.0
    assert_allclose(azimuthal_factor(theta_d, theta_h), factor, rtol=1e-14, atol=1e-280)


def test_azimuthal_factor_vanishes_where_phi_d_means_nothing():
    angles = np.linspace(0.0, np.pi / 2, 9)
    assert_array_equal(azimuthal_factor(0.0, angles), 0.0)
    assert_array_equal(azimuthal_factor(angles, 0.0), 0.0)


def test_azimuthal_factor_sets_in_at_its_width_and_saturates():
    theta_d = np.array([0.1, 0.7, 1.4])
    at_width = np.arctan(AZIMUTHAL_WIDTH / np.tan(theta_d))
    assert_allclose(azimuthal_factor(at_width, theta_d), np.sqrt(0.5), rtol=1e-14)
    grazing = np.pi / 2 - 1e-6
    assert_allclose(azimuthal_factor(AZIMUTHAL_WIDTH / np.tan(grazing), grazing), np.sqrt(0.5), rtol=1e-9)
    # Proportional to tan(theta_h) tan(theta_d) far below, 1 less half the inverse square far above
    below = np.arctan(1e-6 * np.tan(at_width))
    assert_allclose(azimuthal_factor(below, theta_d), 1e-6, rtol=1e-10)
    assert_allclose(azimuthal_factor(np.pi / 2, theta_d), 1.0, rtol=1e-15)
    assert_allclose(
        1 - azimuthal_factor(1.0, 1.0), 0.5 * (AZIMUTHAL_WIDTH / np.tan(1.0) ** 2) ** 2, rtol=1e-3
    )


def test_azimuthal_factor_rises_with_theta_h():
    factor = azimuthal_factor(np.linspace(0.0, np.pi / 2, 200)[:, None], [0.01, 0.5, 1.5])
    assert factor.shape == (200, 3)
    assert (np.diff(factor, axis=0) > 0.0).sum() > 3 * 150
    assert (np.diff(factor, axis=0) >= -1e-15).all()
