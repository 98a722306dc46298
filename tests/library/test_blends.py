"""Blends of materials of the library keep to the colours and the widths of their ends."""

import itertools

import numpy as np

from dsbrdf.space import builtin

MATERIALS = (
    "nickel",
    "chrome",
    "gold-metallic-paint",
    "pink-fabric",
    "red-fabric",
    "blue-acrylic",
    "green-plastic",
    "yellow-matte-plastic",
    "white-paint",
    "black-phenolic",
    "specular-violet-phenolic",
    "vch_silk_blue_rgb",
)
ANGLES = np.deg2rad([10.0, 45.0, 70.0])


def colour(model):
    """Logarithms of ratios of channels of the albedo."""
    albedo = model.albedo(ANGLES)
    return np.log(albedo[:, [0, 2]] / albedo[:, [1]])


def test_half_way_blends_of_all_pairs_of_twelve():
    space = builtin()
    models = {name: space.material(name) for name in MATERIALS}
    colours = {name: colour(model) for name, model in models.items()}
    sharpness = {name: space.variables.sharpness(space.encode(model)) for name, model in models.items()}
    for pair in itertools.combinations(MATERIALS, 2):
        half = space.blend(*(models[name] for name in pair), 0.5)
        ends = np.array([colours[name] for name in pair])
        found = colour(half)
        assert (found > ends.min(0) - 0.02).all(), pair
        assert (found < ends.max(0) + 0.02).all(), pair
        ends = np.array([sharpness[name] for name in pair])
        found = space.variables.sharpness(space.encode(half))
        assert (found > ends.min(0) - 1e-3).all(), pair
        assert (found < ends.max(0) + 1e-3).all(), pair


def test_a_blend_at_its_ends_is_the_end():
    space = builtin()
    a, b = space.material("pink-fabric"), space.material("chrome")
    wi, wo = np.array([0.6, 0.0, 0.8]), np.array([-0.48, 0.36, 0.8])
    for t, end in ((0.0, a), (1.0, b)):
        np.testing.assert_allclose(space.blend(a, b, t).eval(wi, wo), end.eval(wi, wo), rtol=0.02)
