"""The sphere of the web page in a headless browser: its values and pictures are those of Python and of Mitsuba."""

import numpy as np
import pytest
from pairs import DECODED, TINY, random_pairs
from sphere_page import (
    DISTANCE,
    HALF_WIDTH,
    POINT_LIGHT,
    N,
    environment_pixels,
    fitted,
    frame,
    hit,
    inside,
    picture,
    shown,
)

import dsbrdf
from dsbrdf.measured import built_in

pytestmark = pytest.mark.filterwarnings("ignore:.*out of iterations")


def assert_sphere_evaluates(page, model, rng):
    wi, wo = random_pairs(rng, 5000)
    pairs = np.concatenate([wi, wo], axis=1).ravel().tolist()
    got = page.evaluate("(pairs) => Array.from(sphere.evaluate(new Float32Array(pairs)))", pairs)
    np.testing.assert_allclose(np.reshape(got, (-1, 3)), model.eval(wi, wo), rtol=1e-3, atol=TINY)


@pytest.mark.parametrize("name", built_in.names())
def test_values_are_those_of_python(browser, rng, name):
    models = fitted(name)
    with shown(browser, models) as call:
        assert_sphere_evaluates(call(name), models[name], rng)


@pytest.mark.shared
@pytest.mark.parametrize("name", DECODED)
def test_values_of_decoded_materials_are_those_of_python(browser, decoded, rng, name):
    model = dsbrdf.fit(dsbrdf.read(decoded(name)), n_lobes=3).model
    with shown(browser, {name: model}) as call:
        assert_sphere_evaluates(call(name), model, rng)


def test_edited_lobes(show_sphere, sphere_models, rng):
    page = show_sphere("satin-plastic")
    page.evaluate("sphere.setLobes(0, [true, false, true], [1.5, 1, 0.5], [0.7, 1, 3])")
    model = sphere_models["satin-plastic"]
    edited = model.replace(
        kappa=model.kappa[..., [0, 2]] * [1.5, 0.5],
        gamma=model.gamma[..., [0, 2]] * [0.7, 3.0],
        beta=model.beta[..., [0, 2]],
    )
    assert_sphere_evaluates(page, edited, rng)
    page.evaluate("sphere.setLobes(0, [false, false, false], [1, 1, 1], [1, 1, 1])")
    assert page.evaluate("Array.from(sphere.evaluate(new Float32Array([0, 0, 1, 0, 0, 1])))") == [
        0.0,
        0.0,
        0.0,
    ]
    assert np.all(picture(page, 1)[inside()] == 0.0)


def test_one_channel_is_grey(browser, sphere_models, rng):
    model = sphere_models["rough-gold"]
    first = {key: getattr(model, key)[:, :1] for key in ("kappa", "gamma", "beta", "spike")}
    grey = model.replace(**{key: np.repeat(value, 3, axis=1) for key, value in first.items()})
    with shown(browser, {"one": model.replace(**first)}) as call:
        assert_sphere_evaluates(call("one"), grey, rng)


@pytest.mark.parametrize("name", ["satin-plastic", "rough-gold"])
def test_point_light_is_what_python_predicts(show_sphere, sphere_models, name):
    page = show_sphere(name)
    page.evaluate("sphere.setLighting('point')")
    got = picture(page, 64)
    rows, columns = np.nonzero(inside())
    normal, wo = hit(rows, columns)
    frames = np.array([[frame(n) for n in line] for line in normal])
    local = [np.einsum("...ij,...j->...i", frames, w) for w in (np.broadcast_to(POINT_LIGHT, wo.shape), wo)]
    local = [w / np.linalg.norm(w, axis=-1, keepdims=True) for w in local]
    value = sphere_models[name].eval(*local) * np.pi * np.maximum(local[0][..., 2:], 0.0)
    np.testing.assert_allclose(got[rows, columns], value.mean(1), rtol=0.03, atol=0.01)
    mean = page.evaluate("sphere.meanPixel()")
    np.testing.assert_allclose(mean, value.mean((0, 1)), rtol=2e-3)


def look_up(pixels, direction):
    """Bilinear interpolation of an equirectangular image, as `environment.js` lays it out."""
    height, width = pixels.shape[:2]
    u = np.arctan2(direction[:, 0], -direction[:, 2]) / (2.0 * np.pi) * width - 0.5
    v = np.arccos(np.clip(direction[:, 1], -1.0, 1.0)) / np.pi * height - 0.5
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    s, t = (u - i)[:, None], (v - j)[:, None]
    rows, columns = np.clip([j, j + 1], 0, height - 1), np.array([i, i + 1]) % width
    upper, lower = ((1.0 - s) * pixels[row, columns[0]] + s * pixels[row, columns[1]] for row in rows)
    return (1.0 - t) * upper + t * lower


def shaded(model, pixels, normal, view):
    """Radiance toward `view` under an environment, by quadrature over half vectors; no sampling, no shader."""
    edges = np.concatenate([[0.0], np.geomspace(1e-4, np.pi / 2, 28)])
    node, weight = np.polynomial.legendre.leggauss(8)
    width = np.diff(edges)[:, None]
    theta = (edges[:-1, None] + 0.5 * width * (node + 1.0)).ravel()
    phi = 2.0 * np.pi * (np.arange(128) + 0.5) / 128
    solid_angle = np.repeat((0.5 * width * weight).ravel() * np.sin(theta) * 2.0 * np.pi / 128, 128)
    theta, phi = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    half = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    axes = frame(normal)
    wo = axes @ view
    cos_d = half @ wo
    wi = 2.0 * cos_d[:, None] * half - wo
    some = (cos_d > 0.0) & (wi[:, 2] > 0.0)
    wi = wi[some] / np.linalg.norm(wi[some], axis=-1, keepdims=True)
    light = look_up(pixels, wi @ axes)
    value = model.eval(wi, wo / np.linalg.norm(wo))
    return (value * light * (4.0 * wi[:, 2] * cos_d[some] * solid_angle[some])[:, None]).sum(0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "environment"),
    [("satin-plastic", "soft-boxes"), ("polished-chrome", "window"), ("rough-gold", "sky")],
)
def test_converges_to_the_integral(show_sphere, sphere_models, rng, name, environment):
    page = show_sphere(name)
    page.evaluate("(name) => sphere.setEnvironment(name)", environment)
    got = picture(page, 1024)
    pixels = environment_pixels(page)
    rows, columns = rng.permutation(np.argwhere(inside()))[:40].T
    normal, view = hit(rows, columns)
    expected = np.array(
        [
            np.mean([shaded(sphere_models[name], pixels, *place) for place in zip(*at, strict=True)], axis=0)
            for at in zip(normal, view, strict=True)
        ]
    )
    assert np.mean(np.abs(got[rows, columns] / expected - 1.0)) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("name", ["satin-plastic", "polished-chrome"])
def test_agrees_with_mitsuba(show_sphere, sphere_models, name):
    import mitsuba as mi
    from mitsuba_tools import compiled

    from dsbrdf import render

    compiled()
    page = show_sphere(name)
    got = picture(page, 1024)
    film = {"type": "hdrfilm", "width": N, "height": N, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "perspective",
            "fov": float(2.0 * np.rad2deg(np.arctan(HALF_WIDTH))),
            "to_world": mi.ScalarTransform4f().look_at([0, 0, DISTANCE], [0, 0, 0], [0, 1, 0]),
            "film": film,
        },
        "light": {"type": "envmap", "bitmap": mi.Bitmap(environment_pixels(page).astype(np.float32))},
        "ball": {"type": "sphere", "bsdf": render.to_dict(sphere_models[name])},
    }
    expected = np.array(mi.render(mi.load_dict(scene), spp=4096))
    within = inside()
    assert np.mean(np.abs(got[within] / expected[within] - 1.0)) < 0.02
    np.testing.assert_allclose(got[within].mean(0), expected[within].mean(0), rtol=5e-3)
    np.testing.assert_allclose(got[0], expected[0], rtol=0.02)


def test_flat_light_shows_the_albedo(show_sphere, sphere_models):
    """An even light of radiance 1/2: at a pixel, half the directional albedo of the angle it is seen under."""
    page = show_sphere("rough-gold")
    page.evaluate("sphere.setLighting('flat')")
    got = picture(page, 1024)
    rows, columns = np.full(4, N // 2), N // 2 + np.array([0, 6, 12, 17])
    normal, view = hit(rows, columns)
    theta = np.arccos((normal * view).sum(-1))
    albedo = sphere_models["rough-gold"].albedo(theta).mean(1)
    np.testing.assert_allclose(got[rows, columns], 0.5 * albedo, rtol=0.03)
    np.testing.assert_allclose(got[0], 0.5, rtol=1e-5)
