"""Textures: the same least squares as `fit`, whatever holds the values, and what the maps say."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import dsbrdf
from dsbrdf.batch import texels
from dsbrdf.batch.texels import TexelMaps, fit_texels, load_texels, texel_space
from dsbrdf.model.evaluation import evaluate_any


def pairs(n, rng):
    """Directions (n, 3) toward light and viewer, half of them near the mirror."""
    w = rng.normal(size=(2, n, 3))
    w[..., 2] = np.abs(w[..., 2]) + 0.3
    wi, wo = w / np.linalg.norm(w, axis=-1, keepdims=True)
    near = wi[: n // 2] * [-1.0, -1.0, 1.0] + 0.15 * rng.normal(size=(n // 2, 3))
    near[:, 2] = np.abs(near[:, 2])
    wo[: n // 2] = near / np.linalg.norm(near, axis=-1, keepdims=True)
    return wi, wo


@pytest.fixture(scope="module")
def scene():
    """Directions, and values (5, 4, 96, 3) of a blend of two materials of the library with 2 % noise."""
    rng = np.random.default_rng(17)
    wi, wo = pairs(96, rng)
    a, b = (dsbrdf.library.load(name).eval(wi, wo) for name in ("pink-plastic", "nylon"))
    t = np.linspace(0.0, 1.0, 20).reshape(5, 4, 1, 1)
    values = ((1.0 - t) * a + t * b) * (1.0 + 0.02 * rng.standard_normal((5, 4, 96, 3)))
    return wi, wo, values.astype(np.float32)


@pytest.fixture(scope="module")
def maps(scene):
    return fit_texels(*scene)


def same(one, other):
    for name in texels.MAPS:
        assert_array_equal(getattr(one, name), getattr(other, name))
    return one.channels == other.channels and one.sizes == other.sizes


def objective(gaussian, x, squares, n):
    away = x - gaussian.mean
    return n * np.log(squares) + away @ gaussian.precision @ away


@pytest.mark.filterwarnings("ignore::dsbrdf.fitting.PriorWarning", "ignore::dsbrdf.ConvergenceWarning")
def test_the_same_least_squares_as_fit(rng):
    """The other route is the estimator of single materials, from the mean of the prior: the same minimum."""
    wi, wo = pairs(96, rng)
    prior = texel_space().gaussian()
    for name in ("alum-bronze", "black-fabric", "brass", "purple-paint"):
        values = dsbrdf.library.load(name).eval(wi, wo) * (1.0 + 0.02 * rng.standard_normal((96, 3)))
        found = dsbrdf.fit(dsbrdf.Samples(wi, wo, values), prior=prior)
        maps = fit_texels(wi, wo, values[None])
        ours = objective(prior, maps.unknowns[0].astype(float), float(maps.residual[0]) ** 2, 96)
        assert abs(ours - found.objective) < 0.3, name
        assert_allclose(maps[0].eval(wi, wo), found.model.eval(wi, wo), rtol=0.1)


def test_materials_come_back(rng):
    """Of the family, without noise: other directions are right to a percent or two."""
    space = texel_space()
    names = ["pink-plastic", "nylon", "pink-felt"]
    wi, wo = pairs(300, rng)
    truth = [space.material(name) for name in names]
    found = fit_texels(wi, wo, np.stack([model.eval(wi, wo) for model in truth]), prior=space)
    there = pairs(500, rng)
    for i, model in enumerate(truth):
        ratio = found[i].eval(*there) / model.eval(*there)
        assert np.median(np.abs(np.log(ratio))) < 0.02, names[i]
    assert found.residual.max() < 0.01


def test_between_materials_and_left_out(scene, maps, rng):
    """Values of other directions, of materials that the prior does not know."""
    wi, wo, values = scene
    there = pairs(500, rng)
    ends = [dsbrdf.library.load(name) for name in ("pink-plastic", "nylon")]
    prior = texel_space().without("pink-plastic").without("nylon")
    found = fit_texels(wi, wo, values, prior=prior)
    for index, model in (((0, 0), ends[0]), ((4, 3), ends[1])):
        miss = np.log(found[index].eval(*there)) - np.log(model.eval(*there))
        assert np.sqrt(np.mean(miss**2)) < 0.25
    assert np.isfinite(maps.unknowns).all()


# Values come as they are


@pytest.mark.parametrize("kind", ["memmap", "zarr", "dask", "float64", "list"])
def test_any_array(scene, maps, tmp_path, kind):
    wi, wo, values = scene
    if kind == "memmap":
        np.save(tmp_path / "values.npy", values)
        given = np.load(tmp_path / "values.npy", mmap_mode="r")
    elif kind == "zarr":
        zarr = pytest.importorskip("zarr")
        given = zarr.create_array(tmp_path / "values.zarr", data=values, chunks=(2, 2, 96, 3))
    elif kind == "dask":
        given = pytest.importorskip("dask.array").from_array(values, chunks=(2, 3, 96, 3))
    else:
        given = values.astype(float) if kind == "float64" else values.tolist()
    assert same(fit_texels(wi, wo, given), maps)


@pytest.mark.parametrize("size", [1, 4, 9])
def test_memory_is_bounded(scene, maps, monkeypatch, size):
    """Blocks are no larger than they may be, also where a row is."""
    wi, wo, values = scene
    monkeypatch.setattr(texels, "BLOCK_BYTES", size * 8 * 96 * 3)

    class Stored:
        shape = values.shape
        largest = 0

        def __getitem__(self, index):
            taken = values[index]
            self.largest = max(self.largest, taken[..., 0, 0].size)
            return taken

    stored = Stored()
    assert same(fit_texels(wi, wo, stored), maps)
    assert 1 <= stored.largest <= size


def test_texels_do_not_depend_on_each_other(scene, maps, rng):
    wi, wo, values = scene
    order = rng.permutation(20)
    flat = fit_texels(wi, wo, values.reshape(20, 96, 3)[order])
    assert_array_equal(flat.unknowns, maps.unknowns.reshape(20, -1)[order])


def test_what_is_absent(scene, maps):
    wi, wo, values = scene
    mask = np.ones((5, 4), dtype=bool)
    mask[1] = False
    damaged = values.copy()
    damaged[2, 2] = np.nan
    damaged[3, 3, 10:] = np.nan
    found = fit_texels(wi, wo, damaged, mask=mask)
    absent = ~mask
    absent[2, 2] = True
    assert_array_equal(np.isnan(found.residual), absent)
    assert_array_equal(np.isnan(found.unknowns).any(-1), absent)
    whole = ~absent
    whole[3, 3] = False
    assert_array_equal(found.unknowns[whole], maps.unknowns[whole])
    # Ten directions say less than 96
    assert found.uncertainty[3, 3] > 1.3 * maps.uncertainty[3, 3]
    with pytest.raises(ValueError, match=r"texel \(2, 2\): no model: it had no value"):
        found[2, 2]


def test_one_channel(scene):
    wi, wo, values = scene
    found = fit_texels(wi, wo, values[0, :, :, 1:2])
    assert found.channels == ("value",)
    assert_allclose(found[0].eval(wi, wo)[:, 0], values[0, 0, :, 1], rtol=0.5)


def test_many_directions(rng):
    """Directions beyond some are averaged with their neighbours: hardly anything is lost."""
    wi, wo = pairs(6000, rng)
    model = dsbrdf.library.load("pink-felt")
    values = model.eval(wi, wo) * (1.0 + 0.02 * rng.standard_normal((6000, 3)))
    found = fit_texels(wi, wo, values[None])
    there = pairs(500, rng)
    miss = np.log(found[0].eval(*there)) - np.log(model.eval(*there))
    assert np.sqrt(np.mean(miss**2)) < 0.1
    cell = texels._cells(*texels._angles(wi, wo)[0])
    counts = np.bincount(cell)
    assert len(counts) <= texels.MAX_POSITIONS
    assert counts.min() >= 1
    assert counts.max() <= 3 * 6000 / len(counts)


# Maps


def test_a_texel_is_a_model(maps, rng):
    wi, wo = pairs(50, rng)
    every = maps.eval(wi, wo)
    assert every.shape == (5, 4, 50, 3)
    for index in ((0, 0), (3, 2)):
        model = maps[index]
        assert isinstance(model, dsbrdf.DSBRDF)
        assert_allclose(every[index], model.eval(wi, wo), rtol=1e-5)
        assert_allclose(every[index], evaluate_any(model.lobes, wi, wo), rtol=1e-5)
        assert_allclose(maps.albedo()[index], model.albedo(np.deg2rad(30.0)), rtol=0.01)
    part = maps[1:3]
    assert isinstance(part, TexelMaps)
    assert_array_equal(part.eval(wi, wo), every[1:3])
    assert len(maps) == 5
    below = -wo * [1.0, 1.0, 1.0]
    assert_array_equal(maps[0].eval(wi, below), 0.0)


def test_maps_of_lobes(maps):
    """Colour is the height of a lobe, width where it has fallen by half."""
    model = maps[2, 1]
    colour, width = maps.colour()[2, 1], maps.width()[2, 1]
    order = np.argsort(maps.arrays()["gamma"][2, 1].mean(-1), kind="stable")
    for k, slot in enumerate(order):
        lobe = model.lobe(k)
        peak = lobe.eval_angles(0.0, 0.0, 0.0)
        assert_allclose(colour[slot], peak, rtol=1e-4)
        half = lobe.eval_angles(width[slot], 0.0, 0.0).mean() / peak.mean()
        assert 0.4 < half < 0.62
    assert (maps.width() > 0.0).all()


def test_files(maps, tmp_path):
    pytest.importorskip("zarr")
    for name in ("maps.npz", "maps.zarr"):
        maps.save(tmp_path / name)
        assert same(load_texels(tmp_path / name), maps)
    (tmp_path / "other.npz").write_bytes(b"PK nonsense")
    np.savez(tmp_path / "none.npz", x=np.ones(3))
    for name in ("other.npz", "none.npz"):
        with pytest.raises(ValueError, match=f"{name}: not maps of texels"):
            load_texels(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        load_texels(tmp_path / "missing.npz")


def test_exr(maps, tmp_path):
    mi = pytest.importorskip("mitsuba")
    maps.to_exr(tmp_path / "maps.exr")
    bitmap = mi.Bitmap(str(tmp_path / "maps.exr"))
    names = [field.name for field in bitmap.struct_()]
    found = dict(zip(names, np.moveaxis(np.array(bitmap), -1, 0), strict=True))
    assert_allclose(found["uncertainty"], maps.uncertainty)
    assert_allclose(found["albedo.g"], maps.albedo()[..., 1])
    assert_allclose(found["gamma.1.0"], maps.arrays()["gamma"][..., 1, 0])
    assert_allclose(found["colour.b.0.0"], maps.arrays()["colour"][..., 2, 0, 0])
    assert [path.name for path in tmp_path.iterdir()] == ["maps.exr"]
    with pytest.raises(ValueError, match=r"rows and columns of texels, these have shape \(4,\)"):
        maps[0].to_exr(tmp_path / "row.exr")


# Errors


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"wi": np.ones((96, 3))}, "'wi' must be unit vectors"),
        (
            {"wo": np.array([[0.0, 0.0, 1.0]])},
            r"must have shape \(direction, 3\), got \(96, 3\) and \(1, 3\)",
        ),
        ({"values": np.ones((4, 95, 3))}, r"with 96 directions, got \(4, 95, 3\)"),
        ({"values": np.ones((96, 3))}, r"\(texel\.\.\., direction, channel\)"),
        ({"mask": np.ones(3, bool)}, r"'mask' must have shape \(5, 4\), got \(3,\)"),
        ({"prior": "none"}, "'prior' must be 'library', a MaterialSpace or a Gaussian, got 'none'"),
        ({"n_lobes": 7}, "the built-in prior is of 2 lobes and 1 or 3 channels, got 7 and 3"),
        ({"values": np.ones((4, 96, 2))}, "1 or 3 channels, got 2 and 2"),
        ({"values": np.ones((4, 96, 1)), "prior": texel_space()}, "has 1 channels, the prior 3"),
    ],
)
def test_bad_input(scene, change, text):
    given = dict(zip(("wi", "wo", "values"), scene, strict=True)) | change
    with pytest.raises(ValueError, match=text):
        fit_texels(given.pop("wi"), given.pop("wo"), given.pop("values"), **given)


def test_the_library_is_in_the_package():
    assert Path(texels.__file__).with_name("lobes-2.dsbrdf").stat().st_size < 100_000
    assert set(texel_space().names) == set(dsbrdf.library.names())
