"""Reflectance from pictures in a known light."""

import dataclasses

import numpy as np
import pytest
from pairs import hemisphere

from dsbrdf import library
from dsbrdf.geometry import half_diff, panorama
from dsbrdf.images import Light, PictureWarning, distant, fit_image, fit_regions, linear, relight
from dsbrdf.images import fit as image_fit
from dsbrdf.images.independence import LEAST, independent
from dsbrdf.images.picture import Picture
from dsbrdf.images.view import Camera, points
from dsbrdf.space import builtin

SIZE = 32


@pytest.fixture(autouse=True)
def few_pixels(monkeypatch):
    """A quarter of the pixels: the tests are about right, not about best."""
    monkeypatch.setattr(image_fit, "N_PIXELS", 150)


@pytest.fixture(scope="module")
def space():
    return builtin(without=["orange-paint"])


@pytest.fixture(scope="module")
def sky():
    """A map with a bright window, a dim floor and colours."""
    up = panorama.directions(32, 64)[..., 1:2]
    radiance = np.array([0.5, 0.7, 1.0]) * (1.2 + up)
    radiance[6:9, 20:24] = [30.0, 28.0, 24.0]
    radiance[14:16, 40:44] = [20.0, 24.0, 30.0]
    return Light.from_map(radiance)


@pytest.fixture(scope="module")
def truth():
    return library.load("orange-paint")


@pytest.fixture(scope="module")
def picture(truth, sky):
    clean = relight(truth, "sphere", sky, size=SIZE)
    return clean * (1.0 + 0.01 * np.random.default_rng(3).standard_normal(clean.shape))


def local(normal, directions):
    """Directions in a frame with the normal as +z."""
    across = np.cross(normal, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    return directions @ np.stack([across, np.cross(normal, across), normal], axis=-1)


def uniform_pairs(rng, n, limit):
    """Pairs of directions below `limit` degrees from the normal."""
    wi, wo = hemisphere(rng, 2 * n), hemisphere(rng, 2 * n)
    least = np.cos(np.deg2rad(limit))
    kept = np.flatnonzero((wi[:, 2] > least) & (wo[:, 2] > least))[:n]
    return wi[kept], wo[kept]


def miss(model, truth, scale=1.0):
    wi, wo = uniform_pairs(np.random.default_rng(1), 3000, 80.0)
    return np.sqrt((np.log((scale * model.eval(wi, wo) + 1e-3) / (truth.eval(wi, wo) + 1e-3)) ** 2).mean())


@pytest.mark.parametrize("fov", [None, 0.9])
def test_a_pixel_is_reflectance_times_irradiance(truth, fov):
    toward, irradiance = np.array([0.48, 0.6, 0.64]), np.array([[2.0, 3.0, 4.0]])
    rows, columns = np.mgrid[:8, :8]
    normals = np.stack([0.1 * (columns - 4.0), 0.1 * (4.0 - rows), np.ones((8, 8))], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    camera = {} if fov is None else {"camera": "perspective", "fov": fov}
    made = relight(truth, normals, Light.distant(toward, irradiance), **camera)
    for row, column in [(0, 0), (3, 6), (7, 2)]:
        normal = normals[row, column]
        at = np.array([2.0 * (column + 0.5) / 8.0 - 1.0, 1.0 - 2.0 * (row + 0.5) / 8.0])
        view = np.array([*(-np.tan(0.5 * (fov or 0.0)) * at), 1.0])
        wi, wo = local(normal, toward), local(normal, view / np.linalg.norm(view))
        wanted = truth.eval(wi, wo) * irradiance[0] * wi[2]
        np.testing.assert_allclose(made[row, column], wanted, rtol=0.01)


def test_under_a_white_sky_a_pixel_is_the_albedo(truth):
    made = relight(truth, "sphere", Light.from_map(np.ones((32, 64))), size=64)
    for column in (33, 45, 58):
        x = 2.0 * (column + 0.5) / 64.0 - 1.0
        theta = np.arccos(np.sqrt(1.0 - x**2 - (1.0 / 64.0) ** 2))
        np.testing.assert_allclose(made[32, column], truth.albedo(theta), rtol=0.02)


def test_a_pixel_of_a_map_is_a_distant_light(truth):
    radiance = np.zeros((128, 256, 3))
    radiance[40, 100] = [100.0, 200.0, 300.0]
    lamp = Light.distant(
        panorama.directions(128, 256)[40, 100],
        radiance[40, 100:101] * panorama.solid_angles(128, 256)[40],
    )
    a, b = (relight(truth, "sphere", light, size=SIZE) for light in (Light.from_map(radiance), lamp))
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_a_map_holds_all_its_light_at_any_size():
    rng = np.random.default_rng(2)
    for height, width in [(20, 50), (37, 74), (160, 320)]:
        radiance = rng.exponential(1.0, (height, width, 3))
        light = Light.from_map(radiance)
        flux = (radiance * panorama.solid_angles(height, width)[..., None]).sum((0, 1))
        np.testing.assert_allclose(light.flux[: light.n_roots].sum(0), flux, rtol=1e-12)
        whole = light.parts.max(1) >= 0
        np.testing.assert_allclose(light.flux[light.parts[whole]].sum(1), light.flux[whole], atol=1e-12)


def test_a_picture_tells_the_material(picture, sky, space, truth):
    found = fit_image(picture, "sphere", sky, prior=space)
    assert found.converged
    assert miss(found.model, truth) < 0.5 * miss(space.decode(space.curves.mean(0)), truth)
    assert miss(found.model, truth) < 0.2
    assert found.rms < 0.02
    wi, wo = uniform_pairs(np.random.default_rng(4), 500, 80.0)
    low, high = found.band(wi, wo)
    inside = (low < truth.eval(wi, wo)) & (truth.eval(wi, wo) < high)
    assert inside.mean() > 0.8
    assert 5.0 < found.n_decided < len(found.covariance)
    assert np.nanmax(np.abs(found.residual[0])) < 0.2
    assert "by the pictures" in found.summary or "decided" in found.summary


def test_an_unknown_exposure_is_found(picture, sky, space, truth):
    factors = np.array([4.0, 2.0, 3.0])
    found = fit_image(factors * picture, "sphere", sky, prior=space, exposure="unknown")
    assert found.is_up_to_scale
    scale = found.exposure / factors
    assert miss(found.model, truth, scale) < 0.15


def test_pictures_together_tell_more(truth, space):
    lights = [Light.distant(d) for d in ([0.0, 0.6, 0.8], [0.6, 0.0, -0.8], [-0.8, 0.0, 0.6])]
    pictures = [relight(truth, "sphere", light, size=SIZE) for light in lights]
    one = fit_image(pictures[0], "sphere", lights[0], prior=space)
    all_three = fit_image(pictures, "sphere", lights, prior=space)
    assert miss(all_three.model, truth) < miss(one.model, truth)
    assert not one.coverage.cells[4:].any()
    assert all_three.coverage.cells[4:].any()


def test_regions_are_fitted_apart(truth, sky, space):
    other = library.load("green-latex")
    a, b = (relight(model, "sphere", sky, size=SIZE) for model in (truth, other))
    labels = np.ones((SIZE, SIZE), dtype=int)
    labels[:, SIZE // 2 :] = 2
    mixed = np.where((labels == 1)[..., None], a, b)
    normals = points("sphere", (SIZE, SIZE), Camera())
    full = np.zeros((SIZE * SIZE, 3))
    full[normals.pixel] = normals.middles.normal
    length = np.linalg.norm(full, axis=-1, keepdims=True)
    full = np.divide(full, length, out=np.zeros_like(full), where=length > 0.0).reshape(SIZE, SIZE, 3)
    found = fit_regions(mixed, full, sky, labels, prior=space)
    assert miss(found[1].model, truth) < miss(found[2].model, truth)
    assert miss(found[2].model, other) < miss(found[1].model, other)


def test_derivatives_of_residuals(picture, sky, space, rng):
    inputs = image_fit._inputs(picture, "sphere", sky, None, Camera())
    problem = image_fit._problem(*inputs, space.gaussian(), True)
    some = rng.choice(len(problem.pixels), 20, replace=False)
    problem = dataclasses.replace(
        problem, weights=problem.weights[:, some].astype(np.float64), pixels=problem.pixels[some]
    )
    x = problem.start + 0.05 * rng.standard_normal(len(problem.start))
    _, jacobian = problem.linearise(x)
    for unknown in rng.choice(len(x), 25, replace=False):
        step = np.zeros(len(x))
        step[unknown] = 3e-3
        slope = (problem.residual(x + step) - problem.residual(x - step)) / 6e-3
        np.testing.assert_allclose(jacobian[:, :, unknown].T, slope, rtol=0.02, atol=2e-3)


def test_a_perspective_sphere_is_where_rays_meet_it():
    camera, disc = Camera(0.8), (0.2, -0.1, 0.5)
    x, y = np.meshgrid(np.linspace(-0.5, 0.8, 60), np.linspace(-0.8, 0.6, 60))
    normal, views = camera.sphere(x, y, disc), camera.views(x, y)
    seen = np.isfinite(normal[..., 0])
    np.testing.assert_allclose(np.linalg.norm(normal[seen], axis=-1), 1.0, atol=1e-12)
    # From the middle along the normal to the surface, and along the view to the camera: one point for all pixels
    facing = (normal * views).sum(-1)
    assert facing[seen].min() > 0.0
    middle = np.unravel_index(np.nanargmax(np.where(seen, facing, np.nan)), seen.shape)
    assert np.hypot(x[middle] - disc[0], y[middle] - disc[1]) < 0.05


def test_noise_alone_is_independent_and_a_blotch_is_not(rng):
    seen = points("sphere", (SIZE, SIZE), Camera())
    normals = seen.normal[seen.start[:-1]]
    noise = rng.standard_normal((len(normals), 3))
    groups = np.zeros(len(normals), int)
    assert independent(noise, normals, groups) > 0.5 * len(normals)
    assert independent(normals, normals, groups) == LEAST


def test_what_is_clipped_is_left_out(picture, sky, space):
    bright = picture / np.quantile(picture[picture > 0.0], 0.9)
    code = np.where(bright < 0.0031308, 12.92 * bright, 1.055 * np.maximum(bright, 1e-9) ** (1 / 2.4) - 0.055)
    eight = np.uint8(np.round(255.0 * np.clip(code, 0.0, 1.0)))
    with pytest.warns(PictureWarning, match="8 bits, taken for sRGB"):
        found = fit_image(eight, "sphere", sky, prior=space, exposure="unknown")
    shown = found.points[0].pixel
    assert (eight.reshape(-1, 3)[shown] < 255).all()
    assert len(shown) < len(points("sphere", (SIZE, SIZE), Camera()).pixel)


def test_a_picture_of_something_else_is_told(sky, space, rng):
    noise = rng.exponential(1.0, (SIZE, SIZE, 3))
    with pytest.warns(PictureWarning, match="misses the pixels by a factor of"):
        fit_image(noise, "sphere", sky, prior=space)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"image": np.zeros((8, 8, 3))}, "the picture: the picture is black"),
        ({"image": np.ones((8, 8))}, r"must be \(height, width, channel\), got shape \(8, 8\)"),
        ({"image": np.ones((8, 8, 2))}, "2 channels, where the light has 3"),
        ({"normals": np.zeros((8, 8, 3))}, "no pixel shows the object"),
        ({"normals": np.zeros((8, 9, 3))}, r"'normals' must have shape \(8, 8, 3\)"),
        ({"normals": "cube"}, "'normals' must be an array"),
        ({"mask": np.ones((3, 3))}, "'mask' must have the picture's shape"),
        (
            {"light": [Light.distant([0.0, 0.0, 1.0])] * 2},
            "'light' must be one, or one for each of 1 pictures",
        ),
        ({"camera": "fisheye"}, "'camera' must be 'orthographic' or 'perspective'"),
        ({"fov": 0.5}, "'fov' is the angle of view"),
        ({"camera": "perspective", "fov": 40.0}, "'fov' must be between 0 and pi radians"),
        ({"exposure": "auto"}, "'exposure' must be 'known' or 'unknown'"),
        ({"prior": "shelf"}, "'prior' must be 'library'"),
    ],
)
def test_bad_arguments(space, change, text):
    given = {
        "image": np.ones((8, 8, 3)),
        "normals": "sphere",
        "light": Light.distant([0.0, 0.0, 1.0]),
        "prior": space,
    }
    image, normals, light, *rest = ({**given, **change}).items()
    with pytest.raises(ValueError, match=text):
        fit_image(image[1], normals[1], light[1], **dict(rest))


def test_a_light_must_be_one(space):
    with pytest.raises(TypeError, match=r"'light' must be a dsbrdf\.images\.Light, got float"):
        fit_image(np.ones((8, 8, 3)), "sphere", 1.0, prior=space)


@pytest.mark.parametrize(
    ("radiance", "text"),
    [
        (np.zeros((4, 8, 3)), "is black"),
        (-np.ones((4, 8, 3)), "finite and not negative"),
        (np.ones(5), r"expected \(height, width, channel\)"),
    ],
)
def test_bad_maps(radiance, text):
    with pytest.raises(ValueError, match=text):
        Light.from_map(radiance)


def test_bad_distant_lights():
    with pytest.raises(ValueError, match="'directions' must be unit vectors"):
        Light.distant([[0.0, 0.0, 2.0]])
    with pytest.raises(ValueError, match="'irradiance' must be"):
        Light.distant([[0.0, 0.0, 1.0]], np.ones((2, 3)))


@pytest.mark.parametrize("n", [1, 3])
def test_distant_lights_do_not_invent_light_at_grazing_angles(n):
    """The space says what no light shows: near 90 degrees, too, the material is of its kind."""
    truth = library.load("orange-paint")
    directions = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8], [-0.8, 0.6, 0.0]])[:n]
    lights = [Light.distant(direction, 3.0) for direction in directions]
    pictures = [relight(truth, "sphere", light, size=32) for light in lights]
    found = fit_image(pictures, "sphere", lights, prior=builtin(without=["orange-paint"]))
    theta_d = np.deg2rad([5.0, 30.0, 60.0, 80.0, 86.0, 89.0])
    wi, wo = half_diff.to_directions(np.full(6, np.deg2rad(8.0)), theta_d, np.full(6, np.pi / 2))
    off = np.log(found.model.eval(wi, wo) / truth.eval(wi, wo))
    # A light shows theta_d up to some 20 degrees here
    assert np.abs(off[:2]).max() < 0.2
    assert off.max() < np.log(10.0)
    low, high = found.band(wi[1:4], wo[1:4])
    assert (low < high).all()


def test_what_a_pixel_is_of_its_middle():
    """A pixel of a small sphere is a mean over the highlight: what a model makes of that leads back to its middle."""
    truth, light = library.load("blue-acrylic"), Light.distant([0.0, 0.6, 0.8], 3.0)
    seen = points("sphere", (SIZE, SIZE), Camera())
    image = np.zeros((SIZE * SIZE, 3))
    values = linear.NODES.values(truth.lobes).T[..., None]
    image[seen.pixel] = (linear.weights(seen, light) @ values)[..., 0].T
    picture = Picture.of(image.reshape(SIZE, SIZE, 3), "blue")
    lit = distant.Lit.of(seen, light)
    plain = distant.samples([picture], [lit], truth.channels)
    told = distant.samples([picture], [lit], truth.channels, truth)
    values = truth.eval(plain.wi, plain.wo)
    assert np.abs(np.log(plain.values / values)).max() > 0.3
    # The picture is made by values at nodes, which a sharp lobe is not exactly between
    spread = np.abs(np.log(told.values / plain.values)).max(-1)
    moderate = spread < np.log(distant.MOST_SPREAD) - 1e-9
    assert (spread[moderate] > 0.2).any()
    np.testing.assert_allclose(told.values[moderate], values[moderate], rtol=0.06)


@pytest.mark.parametrize(("size", "n"), [(64, 4), (85, 1), (128, 1), (256, 1)])
def test_few_points_stand_for_a_pixel(size, n):
    seen = points("sphere", (size, size), Camera())
    few = seen.few
    assert (np.diff(few.start) == n).all()
    np.testing.assert_array_equal(few.pixel, seen.pixel)
    cosine = (few.middles.normal * seen.middles.normal).sum(-1)
    assert np.arccos(np.minimum(cosine, 1.0)).max() < np.deg2rad(0.3)
