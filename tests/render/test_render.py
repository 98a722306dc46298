"""Pictures: of the plugin against a stock renderer's, tone mapping, differences, sheets, and `dsbrdf render`."""

import dataclasses
import json
import runpy
from pathlib import Path

import mitsuba as mi
import mitsuba_tools as tools
import numpy as np
import pytest
from by_hand import by_hand
from scipy import stats
from tables import built_in
from typer.testing import CliRunner

from dsbrdf import baselines, cli
from dsbrdf.export.rgl import write_rgl
from dsbrdf.geometry import lighting
from dsbrdf.measured.formats.array_file import write_npz
from dsbrdf.render import comparison, picture, quality, scene, variants
from dsbrdf.render.scene import View, render

SMALL = View(size=16, spp=16)
MODELS = {
    "matte": by_hand([0.1], [0.1], [0.0], name="matte"),
    "rough-gold": by_hand([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3], tint=(1.2, 0.9, 0.4), name="rough-gold"),
    "glossy-plastic": by_hand([1.0, 0.15], [300.0, 0.3], [0.3, -0.2], name="glossy-plastic"),
}

# L, a, b of pairs, and their difference: Sharma, Wu and Dalal (2005), Table 1
SHARMA = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0009), 7.1792),
    ((50.0, -0.001, 2.49), (50.0, 0.0009, -2.49), 4.8045),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((50.0, 2.5, 0.0), (56.0, -27.0, -3.0), 31.9030),
    ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.fixture(autouse=True)
def variant():
    tools.compiled()


@pytest.mark.parametrize(("first", "second", "expected"), SHARMA)
def test_ciede2000(first, second, expected):
    for pair in ((first, second), (second, first)):
        assert quality.ciede2000(*map(np.array, pair)) == pytest.approx(expected, abs=1e-4)


def test_lab_of_known_colours():
    white, black, red = quality.lab(np.array([[1.0, 1, 1], [0, 0, 0], [1, 0, 0]]))
    np.testing.assert_allclose(white, [100.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(black, 0.0, atol=1e-9)
    np.testing.assert_allclose(red, [53.24, 80.09, 67.20], atol=0.05)


def test_ssim(rng):
    image = rng.random((32, 32))
    np.testing.assert_allclose(quality.ssim(image, image), 1.0)
    assert quality.ssim(image, rng.random((32, 32))).mean() < 0.2
    # A change of brightness alone: the first factor
    one, two = np.full((32, 32), 0.4), np.full((32, 32), 0.6)
    np.testing.assert_allclose(quality.ssim(one, two), (2 * 0.24 + 1e-4) / (0.52 + 1e-4))


def test_tone_mapping():
    np.testing.assert_allclose(
        picture.encode(np.array([0.0, 0.0031308, 0.214041, 1.0])), [0, 0.04045, 0.5, 1], atol=1e-5
    )
    image = np.zeros((2, 2, 4))
    image[0] = 0.5, 0.5, 0.5, 1.0
    exposure = picture.exposure_of(image)
    assert exposure == pytest.approx(picture.MEAN_LUMINANCE / 0.5)
    shown = picture.tone_map(image, 100.0)
    # Clipped, and white where there is nothing
    np.testing.assert_allclose(shown, 1.0)
    assert picture.exposure_of(np.zeros((2, 2, 4))) == 1.0


def test_lighting():
    room = lighting.studio(64)
    assert room.shape == (64, 128, 3)
    assert room.min() > 0.0
    # The lamp is above on the right in front, the brightest of all
    row, column = np.unravel_index(room.sum(-1).argmax(), room.shape[:2])
    assert row < 32
    assert 32 < column < 64


def test_a_mirror_shows_the_lights_where_they_are():
    """The wide key light on the left, its highlight on the left half of the sphere; black off the sphere."""
    image = render(by_hand([4.0], [2000.0], [0.0]), View(size=32, spp=64))
    assert image.shape == (32, 32, 4)
    assert (image[0, 0] == 0.0).all()
    assert image[16, 16, 3] == pytest.approx(1.0, abs=1e-3)
    luminance = image[..., :3].sum(-1)
    inner = luminance[6:16, 4:28]
    assert inner[:, :12].sum() > 1.5 * inner[:, 12:].sum()


@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic"])
def test_plugin_and_stock_measured_agree(tmp_path, name):
    """z-test of each pixel between the plugin and Mitsuba's `measured` with the exported file."""
    model = MODELS[name]
    write_rgl(model, tmp_path / "file.bsdf")
    stock = {"type": "measured", "filename": str(tmp_path / "file.bsdf")}
    view, n = View(size=20, spp=64), 12
    images = []
    for i, bsdf in enumerate((tools.render.to_dict(model), stock)):
        world = scene.world(bsdf, view)
        pictures = [mi.render(world, spp=view.spp, seed=i * n + k) for k in range(n)]
        images.append(np.array([np.array(image)[..., :3].mean(-1) for image in pictures]))
    ours, theirs = (x.mean(0) for x in images)
    spread = np.sqrt(sum(x.var(0, ddof=1) for x in images) / n)
    inside = ours > 0.0
    z = (ours - theirs)[inside] / spread[inside]
    # A table is not the model: a bias of half a per cent passes
    p = 2.0 * stats.norm.sf(np.maximum(np.abs(z) - 0.005 * theirs[inside] / spread[inside], 0.0))
    assert (p < 0.001).mean() < 0.02
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)


def test_stock_renderer_without_compiler():
    """The same call in scalar_rgb, from a file of the RGL database."""
    model = MODELS["glossy-plastic"]
    compiled = render(model, View(size=12, spp=64))
    try:
        mi.set_variant("scalar_rgb")
        scalar = render(model, View(size=12, spp=64))
    finally:
        mi.set_variant(tools.VARIANT)
    np.testing.assert_allclose(scalar.mean((0, 1)), compiled.mean((0, 1)), rtol=0.06)


def test_example(tmp_path, monkeypatch):
    """It ends in scalar_rgb, with a picture from each path."""
    monkeypatch.setattr("sys.argv", ["mitsuba_scene.py", str(tmp_path)])
    runpy.run_path(str(Path(__file__).parents[2] / "examples" / "mitsuba_scene.py"), run_name="__main__")
    plugin, stock = (
        np.array(mi.Bitmap(str(tmp_path / f"{name}.png")), dtype=float) for name in ("plugin", "stock")
    )
    assert mi.variant() == "scalar_rgb"
    assert stock.mean() == pytest.approx(plugin.mean(), rel=0.02)


def test_baselines_are_rendered_as_tables(monkeypatch):
    monkeypatch.setattr(scene, "TABLE", (45, 30, 36))
    table = built_in("rough-copper")
    bivariate = baselines.fit_bivariate(table)
    a, b = render(table, SMALL), render(bivariate, SMALL)
    assert quality.compare(b, a, picture.exposure_of(a)).mean < 3.0


def test_environment_map_and_mesh(tmp_path):
    model = MODELS["matte"]
    mi.Bitmap(np.full((4, 8, 3), 2.0, np.float32)).write(str(tmp_path / "even.exr"))
    even = render(model, View(envmap=tmp_path / "even.exr", size=16, spp=64))
    # A furnace: the middle of the sphere shows the albedo
    np.testing.assert_allclose(even[8, 8, :3], 2.0 * model.albedo(0.15), rtol=0.05)

    (tmp_path / "square.obj").write_text("v -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\nf 1 2 3\nf 1 3 4\n")
    flat = render(
        model, View(shape=str(tmp_path / "square.obj"), envmap=tmp_path / "even.exr", size=16, spp=64)
    )
    np.testing.assert_allclose(flat[8, 8, :3], 2.0 * model.albedo(0.0), rtol=0.05)
    assert (flat[0] == 0.0).all()


def test_views_that_cannot_be():
    with pytest.raises(ValueError, match="'size' and 'spp' must be at least 1"):
        View(size=0)
    with pytest.raises(ValueError, match=r"teapot: not a shape: expected 'sphere' or a file \.ply"):
        View(shape="teapot")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.hdr"):
        View(envmap="nowhere.hdr")


def test_what_is_shown_of_a_table(monkeypatch):
    """Fewer lobes and each lobe with `lobes`, other models with `compare`; lone lobes are not compared."""
    monkeypatch.setattr(scene, "TABLE", (45, 30, 36))
    subjects = comparison.table_subjects(built_in("rough-copper"), 2, lobes=True, compare=True)
    titles = [subject.title for subject in subjects]
    assert titles[:5] == ["measured", "1 lobe", "2 lobes", "lobe 0 alone", "lobe 1 alone"]
    assert len(titles) == 8
    assert [subject.whole for subject in subjects[3:5]] == [False, False]
    row = comparison.render_row("copper", subjects[:4], SMALL)
    assert [tile.difference is not None for tile in row.tiles] == [False, True, True, False]
    assert row.tiles[2].difference.mean < row.tiles[1].difference.mean


def run(*arguments):
    return CliRunner().invoke(cli.app, ["render", *map(str, arguments)], catch_exceptions=False)


def test_command_writes_a_sheet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run("matte", "--size", 8, "--spp", 1)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "matte.png").stat().st_size > 5000
    assert "CIEDE2000" in done.stdout
    assert "matte.png" in done.stdout


def test_command_writes_linear_pictures(tmp_path):
    model = MODELS["rough-gold"]
    model.save(tmp_path / "gold.json")
    done = run(tmp_path / "gold.json", "--lobes", "--size", 8, "--spp", 4, "-o", tmp_path / "gold.exr")
    assert done.exit_code == 0, done.output
    pixels = np.array(mi.Bitmap(str(tmp_path / "gold.exr")))
    # The model, and each of its lobes
    assert pixels.shape == (8, 24, 4)
    whole, *parts = np.split(pixels, 3, axis=1)
    np.testing.assert_allclose(whole[..., :3].mean(), sum(part[..., :3].mean() for part in parts), rtol=0.1)
    assert [path.name for path in tmp_path.iterdir()].count("gold.exr") == 1
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["matte", "-o", "matte.jpg"], "expected a name that ends in .png or .exr"),
        (["matte", "--envmap", "nowhere.hdr"], "nowhere.hdr: No such file"),
        (["matte", "--shape", "cube"], "cube: not a shape"),
        (["gravel"], "gravel: no such file; unknown built-in material"),
        (["broken.json"], "broken.json: not a model file"),
    ],
)
def test_command_says_what_is_wrong(tmp_path, monkeypatch, capsys, arguments, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json").write_text(json.dumps({"a": 1}))
    monkeypatch.setattr("sys.argv", ["dsbrdf", "render", *arguments])
    assert cli.main() in (1, 2)
    assert text in capsys.readouterr().err
    assert not list(tmp_path.glob("*.png"))


def test_only_one_or_three_channels(tmp_path, monkeypatch, capsys):
    """Refused before Mitsuba is asked for anything, by the command and by the function."""
    monkeypatch.setattr(variants, "import_mitsuba", None)
    monkeypatch.chdir(tmp_path)
    model, table = by_hand([1.0, 1.0], [5.0, 5.0], [0.0, 0.0], tint=(1.0, 0.5)), built_in("matte")
    table = dataclasses.replace(table, planes=table.planes[:2], scale=table.scale[:2])
    model.save(tmp_path / "two.json")
    write_npz(table, tmp_path / "table.npz")
    told = {}
    for file in ("two.json", "table.npz"):
        assert cli.main(["render", file]) == 1
        told[file] = capsys.readouterr().err
    text = "rendering needs one or three channels, the"
    assert f"error: two.json: {text} model has 2. Keep one of them, or three" in told["two.json"]
    assert f"error: {table.name}: {text} table has 2. Keep one of them, or three" in told["table.npz"]
    for reflectance, kind in ((model, "model"), (table, "table")):
        with pytest.raises(ValueError, match=f"{text} {kind} has 2\\. Keep one .* index of "):
            render(reflectance, SMALL)
