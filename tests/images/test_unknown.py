"""Material and light of a picture when neither is known."""

import dataclasses

import numpy as np
import pytest

from dsbrdf import library
from dsbrdf.fitting import uncertainty
from dsbrdf.geometry import panorama
from dsbrdf.images import Light, fit_image, relight, search, unknown
from dsbrdf.images import fit as image_fit
from dsbrdf.images.view import Camera, points
from dsbrdf.space import build_space
from dsbrdf.space.process import scaled

#: Some like what is asked for, and some unlike it.
NAMES = [
    "light-red-paint",
    "dark-red-paint",
    "yellow-paint",
    "delrin",
    "nickel",
    "pink-fabric",
    "red-fabric",
    "blue-rubber",
    "specular-red-phenolic",
    "red-metallic-paint",
    "yellow-plastic",
]
ROWS = 24


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(image_fit, "N_PIXELS", 150)
    monkeypatch.setattr(unknown, "N_PIXELS", 40)
    monkeypatch.setattr(unknown, "ROWS", ROWS)


@pytest.fixture(scope="module")
def space():
    return build_space([library.load(name) for name in NAMES])


@pytest.fixture(scope="module")
def sky():
    toward = panorama.directions(2 * ROWS, 4 * ROWS)
    radiance = np.exp(1.5 * toward[..., 1:2] + toward[..., :1]) * np.array([0.6, 0.8, 1.0])
    radiance[10:16, 60:68] = 12.0
    return Light.from_map(radiance)


def scaled_miss(model, truth, rng):
    """RMS of the logarithm over all channels, after the best factor a channel."""
    z, phi = rng.uniform(0.2, 1.0, (2, 3000)), 2.0 * np.pi * rng.random((2, 3000))
    s = np.sqrt(1.0 - z * z)
    wi, wo = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    return np.sqrt(np.log(model.eval(wi, wo) / truth.eval(wi, wo)).var(axis=0).mean())


def test_material_and_light_are_found(space, sky, rng):
    truth = library.load("orange-paint")
    picture = relight(truth, "sphere", sky, size=32)
    found = fit_image(picture, "sphere", "unknown", prior=space)
    mean = space.decode(space.curves.mean(0))
    assert scaled_miss(found.model, truth, rng) < 0.7 * scaled_miss(mean, truth, rng)
    assert found.is_up_to_scale
    assert found.rms < 0.15
    assert "up to a scale a channel" in found.summary.lower()
    assert 0.0 < found.n_decided < len(NAMES)
    light = found.light[0].map
    assert light.shape == (ROWS, 2 * ROWS, 3)
    wanted = np.log(sky.map.reshape(ROWS, 2, 2 * ROWS, 2, 3).mean((1, 3)))
    ahead = panorama.directions(ROWS, 2 * ROWS)[..., 2] > -0.5
    assert np.corrcoef(np.log(light)[ahead].ravel(), wanted[ahead].ravel())[0, 1] > 0.7


def test_nothing_depends_on_a_factor_a_channel(sky):
    truth = library.load("delrin")
    seen = points("sphere", (32, 32), Camera())
    picture = relight(truth, "sphere", sky, size=32).reshape(-1, 3)
    some = seen.take(np.arange(0, len(seen.pixel), 20)).middles
    scene = unknown.Scene(some, picture[some.pixel], unknown.Grid(ROWS))
    transfer = scene.transfer(truth.lobes)
    factors = np.array([3.0, 0.2, 1.0])
    a, b = scene.guess(transfer), scene.guess(factors[:, None, None] * transfer)
    np.testing.assert_allclose(b.evidence, a.evidence, rtol=1e-8)
    np.testing.assert_allclose(b.light * factors, a.light, rtol=1e-6)


def test_a_transfer_is_the_picture_of_a_map(sky):
    truth = library.load("delrin")
    seen = points("sphere", (24, 24), Camera())
    grid = unknown.Grid(ROWS)
    scene = unknown.Scene(seen.middles, np.ones((len(seen.pixel), 3)), grid)
    made = np.einsum(
        "cpl,lc->pc",
        scene.transfer(truth.lobes),
        sky.map.reshape(ROWS, 2, 2 * ROWS, 2, 3).mean((1, 3)).reshape(-1, 3),
    )
    wanted = relight(truth, "sphere", sky, size=24).reshape(-1, 3)[seen.pixel]
    assert np.sqrt((np.log(made / wanted) ** 2).mean()) < 0.03


def test_the_kernel_of_cells():
    grid = unknown.Grid(16)
    whole = grid.root @ grid.root.T + np.diag(grid.own)
    exact = unknown._kernel(grid.directions, grid.directions)
    np.testing.assert_allclose(np.diag(whole), 1.0, atol=1e-9)
    assert np.abs(whole - exact).max() < 0.45
    assert np.abs(whole - exact).mean() < 0.02
    values = np.random.default_rng(0).standard_normal((2, len(exact)))
    np.testing.assert_allclose(grid.smoothed(values), values @ whole, atol=1e-9)


@pytest.mark.parametrize("n_channels", [1, 3])
def test_a_scale_is_no_part_of_the_covariance(n_channels, rng):
    models = [library.load(name) for name in NAMES[:4]]
    if n_channels == 1:
        models = [
            model.replace(
                lobes=dataclasses.replace(model.lobes, colour=model.lobes.colour[:1]), channels=("Y",)
            )
            for model in models
        ]
    space = build_space(models)
    gaussian, x = space.gaussian(), space.variables.unknowns(space.curves)[3]
    keep = unknown._unscaled(x, gaussian)
    np.testing.assert_allclose(keep @ keep, keep, atol=1e-8)
    assert round(np.trace(keep)) == len(x) - n_channels

    z, phi = rng.uniform(0.2, 1.0, (2, 300)), 2.0 * np.pi * rng.random((2, 300))
    s = np.sqrt(1.0 - z * z)
    pairs = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    lobes = search.raw_lobes(x, gaussian)

    def deviation(change):
        posterior = uncertainty.Posterior(lobes, np.outer(change, change), 0.0)
        return posterior.deviation(*pairs)[:, 0].mean()

    # All lobes brighter in the first channel, and the widest alone
    all_lobes, one = np.zeros((2, len(x)))
    if n_channels == 1:
        of_lobe = all_lobes.reshape(gaussian.n_lobes, -1)
        of_lobe[:, : gaussian.sizes.scale] = 1.0
        one[: gaussian.sizes.scale] = 1.0
    else:
        n = gaussian.n_lobes * gaussian.sizes.colour
        all_lobes[len(x) - 3 * n :][:n] = 1.0
        one[len(x) - 3 * n :][: gaussian.sizes.colour] = 1.0
    assert deviation(keep @ all_lobes) < 0.3 * deviation(all_lobes)
    assert deviation(keep @ one) > 0.05 * deviation(one)


def test_a_mean_of_materials_is_one_of_functions(space):
    weights = np.zeros(len(NAMES))
    weights[[0, 2]] = 0.4, 0.6
    a, b = (space.process.unknowns[i] for i in (0, 2))
    gaussian, toward = space.gaussian(), panorama.directions(6, 12).reshape(-1, 3)
    wi = toward[toward[:, 2] > 0.3]
    wo = wi[::-1]
    values = [
        library.load(NAMES[0]).replace(lobes=search.raw_lobes(x, gaussian)).eval(wi, wo)
        for x in (a, b, unknown._mean(space, weights, b))
    ]
    np.testing.assert_allclose(
        scaled(values[2]), 0.4 * scaled(values[0]) + 0.6 * scaled(values[1]), atol=0.15
    )


def test_numbers_decided():
    candidates = np.random.default_rng(0).standard_normal((12, 30))
    even, one = np.full(12, 1.0 / 12.0), np.eye(12)[3]
    assert unknown._n_decided(candidates, even) == pytest.approx(0.0, abs=1e-12)
    # All components but the last few are kept, and one material alone leaves them no variance
    assert 7.5 < unknown._n_decided(candidates, one) < 11.5
    some = 0.5 * even + 0.5 * one
    assert 0.5 < unknown._n_decided(candidates, some) < unknown._n_decided(candidates, one)


def test_an_unknown_light_needs_one_picture_and_materials(space):
    image = np.ones((8, 8, 3))
    with pytest.raises(ValueError, match="found from one picture, got 2"):
        fit_image([image, image], "sphere", "unknown", prior=space)
    with pytest.raises(TypeError, match="needs materials to compare"):
        fit_image(image, "sphere", "unknown", prior=space.gaussian())
    with pytest.raises(ValueError, match=r"'light' must be a Light or 'unknown', got 'dark'"):
        fit_image(image, "sphere", "dark", prior=space)


def test_cells_near_where_a_mirror_looks_are_taken_apart(monkeypatch):
    """Few directions in a cell miss a lobe narrower than it, or count it several times."""
    seen = points("sphere", (32, 32), Camera()).middles
    seen = seen.take(np.arange(0, len(seen.pixel), 40))
    scene = unknown.Scene(seen, np.ones((len(seen.pixel), 3)), unknown.Grid(ROWS))
    lobes = library.load("chrome").lobes
    made = scene.transfer(lobes).sum(-1)
    for parts, least, most in ((((20, 180.0),), 0.0, 0.03), (((2, 180.0),), 0.2, np.inf)):
        monkeypatch.setattr(unknown, "PARTS", parts)
        other = dataclasses.replace(scene).transfer(lobes).sum(-1)
        off = np.sqrt((np.log(made / other) ** 2).mean())
        assert least <= off < most
