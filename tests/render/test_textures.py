"""The plugin `dsbrdf` with textures of parameters: values, gradients, files, errors."""

import drjit as dr
import mitsuba as mi
import mitsuba_tools as tools
import numpy as np
import pytest
from models import upper

from dsbrdf import render
from dsbrdf.batch.texels import TexelMaps, texel_space
from dsbrdf.model.sampling import tables_for

NAMES = ("pink-plastic", "green-latex", "nylon", "teflon", "pink-felt", "brass")


@pytest.fixture(autouse=True)
def variant():
    tools.compiled()


@pytest.fixture(scope="module")
def maps():
    """Two rows of three materials of two lobes; they have no values, only curves."""
    space = texel_space()
    index = [space.names.index(name) for name in NAMES]
    unknowns = space.variables.unknowns(space.curves[index]).astype(np.float32)
    known = np.ones((2, 3), dtype=np.float32)
    return TexelMaps(unknowns.reshape(2, 3, -1), known, known, 2, space.settings.sizes, space.channels)


def at(bsdf, uv, wi, wo):
    """Values (n, 3) without the cosine and densities (n,) at a place of a texture."""
    si = tools.interaction(wi)
    si.uv = mi.Point2f(*uv)
    value, density = bsdf.eval_pdf(mi.BSDFContext(), si, tools.vectors(wo))
    return np.array(value).T / wo[:, 2:], np.array(density)


def centre(row, column):
    return (column + 0.5) / 3.0, (row + 0.5) / 2.0


@pytest.mark.parametrize("filter_type", ["bilinear", "nearest"])
def test_values_are_those_of_texels(maps, rng, filter_type):
    """In the middle of each; rows and columns are those of Mitsuba's bitmaps."""
    wi, wo = upper(rng, 200), upper(rng, 200)
    bsdf = mi.load_dict(render.to_dict(maps) | {"filter_type": filter_type})
    place = np.arange(6, dtype=np.float32).reshape(2, 3, 1)
    bitmap = mi.load_dict(
        {"type": "bitmap", "data": mi.TensorXf(place), "raw": True, "filter_type": filter_type}
    )
    for row in range(2):
        for column in range(3):
            value, _ = at(bsdf, centre(row, column), wi, wo)
            np.testing.assert_allclose(value, maps[row, column].eval(wi, wo), rtol=2e-4)
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.uv = mi.Point2f(*centre(row, column))
            np.testing.assert_allclose(np.array(bitmap.eval_1(si)), place[row, column], atol=1e-5)
    # A quarter of a texel from the middle
    value, _ = at(bsdf, (0.25 / 3.0 + 0.5 / 3.0, 0.25), wi, wo)
    between = maps.unknowns[0, 0] + 0.25 * (maps.unknowns[0, 1] - maps.unknowns[0, 0])
    if filter_type == "nearest":
        between = maps.unknowns[0, 0]
    mixed = TexelMaps(between[None], maps.residual[0, :1], maps.residual[0, :1], 2, maps.sizes, maps.channels)
    np.testing.assert_allclose(value, mixed[0].eval(wi, wo), rtol=5e-3)


def test_sampling(maps, rng):
    """The density is that of the tables of the mean texel, and samples follow it, whatever the texel."""
    bsdf = mi.load_dict(render.to_dict(maps))
    made = tables_for(lambda wi, wo: maps.eval(wi, wo).mean((0, 1)))
    np.testing.assert_allclose(np.array(bsdf._weights)[0], made.shares[0, 0] * 3.0 / (4.0 * np.pi), rtol=1e-4)
    n = 40_000
    wi = np.array([np.sin(0.6), 0.0, np.cos(0.6)])
    for place in ((0, 0), (1, 2)):
        si = tools.interaction(np.broadcast_to(wi, (n, 3)))
        si.uv = mi.Point2f(*centre(*place))
        numbers = rng.random((3, n), dtype=np.float32)
        _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(numbers[0]), mi.Point2f(numbers[1:]))
        weight = np.array(weight).T
        error = weight.std(0) / np.sqrt(n)
        expected = maps[place].albedo(0.6)
        assert (np.abs(weight.mean(0) - expected) < 4.5 * error + 1e-3 * expected).all()


def test_gradients_reach_the_texel(maps):
    """Of the value at a place with respect to the texture: differences, and zero elsewhere."""
    bsdf = mi.load_dict(render.to_dict(maps))
    params = mi.traverse(bsdf)
    wi, wo = np.array([[0.3, 0.1, 0.0]]), np.array([[-0.2, 0.2, 0.0]])
    wi[:, 2], wo[:, 2] = np.sqrt(1.0 - (wi**2).sum(1)), np.sqrt(1.0 - (wo**2).sum(1))

    def value():
        si = tools.interaction(wi)
        si.uv = mi.Point2f(*centre(1, 0))
        return dr.sum(bsdf.eval(mi.BSDFContext(), si, tools.vectors(wo)))

    for key in ("scale", "gamma", "beta", "falloff", "colour"):
        given = np.array(params[key])
        tensor = mi.TensorXf(given)
        dr.enable_grad(tensor)
        params[key] = tensor
        params.update()
        dr.backward(value())
        gradient = np.array(dr.grad(params[key]))
        of_texel = np.abs(gradient).reshape(2, 3, -1).max(-1)
        assert np.count_nonzero(of_texel > 1e-5 * of_texel.max()) == 1
        index = np.unravel_index(np.abs(gradient).argmax(), gradient.shape)
        assert index[:2] == (1, 0)
        step = np.zeros_like(given)
        step[index] = 0.02
        found = []
        for sign in (1.0, -1.0):
            params[key] = mi.TensorXf(given + sign * step)
            params.update()
            found.append(float(value()[0]))
        assert np.isclose((found[0] - found[1]) / 0.04, gradient[index], rtol=0.02), key
        params[key] = mi.TensorXf(given)
        params.update()


def test_files_and_what_is_absent(maps, tmp_path, rng):
    wi, wo = upper(rng, 50), upper(rng, 50)
    damaged = TexelMaps(maps.unknowns.copy(), maps.residual, maps.uncertainty, 2, maps.sizes, maps.channels)
    damaged.unknowns[0, 1] = np.nan
    damaged.save(tmp_path / "maps.npz")
    bsdf = mi.load_dict({"type": "dsbrdf", "filename": str(tmp_path / "maps.npz"), "filter_type": "nearest"})
    assert "texels = (2, 3)" in str(bsdf)
    assert np.abs(at(bsdf, centre(0, 1), wi, wo)[0]).max() < 1e-12
    np.testing.assert_allclose(at(bsdf, centre(1, 1), wi, wo)[0], maps[1, 1].eval(wi, wo), rtol=2e-4)


def test_errors(maps):
    with pytest.raises(
        ValueError, match=r"a texture has rows and columns of texels, these have shape \(3,\)"
    ):
        render.to_dict(maps[0])
    arrays = {name: mi.TensorXf(array[None]) for name, array in maps.arrays().items()}
    arrays["beta"] = mi.TensorXf(maps.arrays()["beta"][None, :, :2])
    with pytest.raises(Exception, match="textures must have row and column in front, the same for all"):
        mi.load_dict({"type": "dsbrdf"} | arrays)
    with pytest.raises(Exception, match="'filter_type' must be 'bilinear' or 'nearest', got 'cubic'"):
        mi.load_dict(render.to_dict(maps) | {"filter_type": "cubic"})
