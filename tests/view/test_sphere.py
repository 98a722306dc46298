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
    quiet_fit,
    shown,
)

import dsbrdf
from dsbrdf import Lobes
from dsbrdf.geometry.colour import rgb_weights
from dsbrdf.measured import built_in
from dsbrdf.model import sampling


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
    model = quiet_fit(dsbrdf.read(decoded(name)), 3).model
    with shown(browser, {name: model}) as call:
        assert_sphere_evaluates(call(name), model, rng)


EDIT = """
async (edits) => {
    const { editedModel } = await import("/material.js");
    sphere.setMaterials(editedModel(materials[0], edits));
}
"""


def test_edited_lobes(show_sphere, sphere_models, rng):
    page = show_sphere("satin-plastic")
    factors = [(True, 1.5, 0.7), (False, 1.0, 1.0), (True, 0.5, 3.0)]
    edits = [{"on": on, "kappa": kappa, "gamma": gamma} for on, kappa, gamma in factors]
    page.evaluate(EDIT, edits)
    lobes = sphere_models["satin-plastic"].lobes
    kappa, gamma = np.log([edit[1:] for edit in factors]).T[..., None]
    scaled = lobes.replace(scale=lobes.scale + kappa, gamma=lobes.gamma + gamma)
    assert_sphere_evaluates(page, dsbrdf.DSBRDF(scaled.take([0, 2])), rng)
    page.evaluate(EDIT, [{"on": False, "kappa": 1.0, "gamma": 1.0}] * 3)
    assert page.evaluate("Array.from(sphere.evaluate(new Float32Array([0, 0, 1, 0, 0, 1])))") == [
        0.0,
        0.0,
        0.0,
    ]
    assert np.all(picture(page, 1)[inside()] == 0.0)


def test_one_channel_is_grey(browser, sphere_models, rng):
    lobes = sphere_models["rough-gold"].lobes
    one, grey = (dsbrdf.DSBRDF(lobes.replace(colour=lobes.colour[[0] * n])) for n in (1, 3))
    with shown(browser, {"one": one}) as call:
        assert_sphere_evaluates(call("one"), grey, rng)


@pytest.mark.parametrize(
    ("channels", "shares", "typical", "rare"),
    [
        # Shares of gold's red in a channel, the rest being its blue; errors in the median and in one case of twenty
        (["b", "g", "r"], [0.0, 0.5, 1.0], 1e-6, 1e-5),
        ([f"{nm}nm" for nm in range(700, 390, -20)], np.linspace(1.0, 0.0, 16), 0.003, 0.03),
        (["X", "Y", "Z"], [0.8, 0.6, 0.1], 0.003, 0.05),
    ],
)
def test_channels_are_shown_in_their_colours(browser, sphere_models, rng, channels, shares, typical, rare):
    lobes = sphere_models["rough-gold"].lobes
    share = np.reshape(shares, (-1, 1, 1))
    model = dsbrdf.DSBRDF(
        lobes.replace(colour=(1.0 - share) * lobes.colour[2] + share * lobes.colour[0]), channels
    )
    wi, wo = random_pairs(rng, 2000)
    expected = np.maximum(model.eval(wi, wo) @ rgb_weights(channels).T, 0.0)
    with shown(browser, {"model": model}) as call:
        pairs = np.concatenate([wi, wo], axis=1).ravel().tolist()
        got = call("model").evaluate("pairs => Array.from(sphere.evaluate(new Float32Array(pairs)))", pairs)
    error = np.abs(np.reshape(got, (-1, 3)) - expected) / np.maximum(expected.max(-1, keepdims=True), TINY)
    assert np.median(error) < typical
    assert np.quantile(error, 0.95) < rare


@pytest.mark.parametrize("sizes", [(1, 1, 1, 1, 1), (2, 3, 1, 2, 4), (7, 4, 3, 1, 2)])
def test_curves_of_any_size(browser, rng, sizes):
    scale, gamma, beta, falloff, colour = sizes
    lobes = Lobes(
        rng.uniform(-3.0, 1.0, (2, scale)),
        rng.uniform(-2.0, 6.0, (2, gamma)),
        rng.uniform(-1.0, 1.0, (2, beta)),
        rng.uniform(-0.5, 3.0, (2, falloff)),
        rng.uniform(-0.5, 0.5, (3, 2, colour)),
    )
    with shown(browser, {"any": dsbrdf.DSBRDF(lobes)}) as call:
        assert_sphere_evaluates(call("any"), dsbrdf.DSBRDF(lobes), rng)


@pytest.mark.parametrize("name", ["satin-plastic", "rough-gold", "polished-chrome"])
def test_shares_are_those_of_python(show_sphere, sphere_models, name):
    """Found from fewer nodes, they need not be the same; but draw as well."""
    page = show_sphere(name)
    script = "async () => (await import('/sampler.js')).samplingShares(materials[0])"
    got = np.array(page.evaluate(script))
    made = sampling.tables(sphere_models[name].lobes)
    expected = np.column_stack([made.shares, made.cosine])
    np.testing.assert_allclose(got.sum(1), 1.0)
    # The last row looks along the horizon
    assert np.abs(got - expected)[:-1].sum(1).max() < 0.2


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
