"""`dsbrdf photo`, and the files it reads."""

import warnings

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf.cli import main
from dsbrdf.images import Light, PictureWarning, relight, sources, unknown
from dsbrdf.images import fit as image_fit
from dsbrdf.images.picture import Picture
from dsbrdf.measured.formats.image_file import read_pixels, write_pixels
from dsbrdf.space import build_space

SIZE = 24
DIRECTIONS = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8], [-0.36, -0.48, 0.8]])


@pytest.fixture(autouse=True)
def few_pixels(monkeypatch):
    monkeypatch.setattr(image_fit, "N_PIXELS", 150)


@pytest.fixture(scope="module")
def truth():
    return smooth_model(0)


@pytest.fixture
def folder(tmp_path, monkeypatch, truth):
    """A working folder with pictures of a sphere, their lights and a space."""
    monkeypatch.chdir(tmp_path)
    build_space([smooth_model(seed) for seed in range(1, 13)]).save("space.npz")
    for i, direction in enumerate(DIRECTIONS):
        write_pixels(relight(truth, "sphere", Light.distant(direction, 3.0), size=SIZE), f"{i}.exr")
    lines = [",".join(map(str, [*direction, 3, 3, 3])) for direction in DIRECTIONS]
    (tmp_path / "lights.csv").write_text("x,y,z,r,g,b\n" + "\n".join(lines) + "\n")
    return tmp_path


def write_png(path, pixels):
    """16 bits, linear."""
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    bitmap = mi.Bitmap(np.ascontiguousarray(np.uint16(np.round(65535.0 * pixels))))
    bitmap.set_srgb_gamma(False)
    bitmap.write(str(path))


def test_photo_writes_a_model_and_a_sheet(folder, capsys):
    arguments = ["photo", "0.exr", "1.exr", "2.exr", "--light", "lights.csv", "--prior", "space.npz"]
    assert main([*arguments, "-o", "found.json", "--compare", "c.png"]) == 0
    shown = capsys.readouterr().out
    assert "independent pixels" in shown
    assert dsbrdf.load(folder / "found.json").n_lobes == 3
    assert read_pixels(folder / "c.png").shape[2] == 3


def test_all_lights_of_a_list_shine_on_a_single_picture(folder, capsys):
    together = sum(read_pixels(folder / f"{i}.exr") for i in range(3))
    write_pixels(together, "all.exr")
    assert main(["photo", "all.exr", "--light", "lights.csv", "--prior", "space.npz"]) == 0
    found = dsbrdf.load(folder / "model.json")
    made = relight(found, "sphere", Light.distant(DIRECTIONS, 3.0), size=SIZE)
    inside = together > 0.0
    assert np.sqrt((np.log(made[inside] / together[inside]) ** 2).mean()) < 0.1
    capsys.readouterr()


def test_an_unknown_light_is_written(folder, monkeypatch, capsys):
    monkeypatch.setattr(unknown, "ROWS", 8)
    monkeypatch.setattr(unknown, "N_PIXELS", 30)
    arguments = ["photo", "0.exr", "--light", "unknown", "--prior", "space.npz", "--light-out", "env.exr"]
    with warnings.catch_warnings():
        # One lamp is not what a grid so coarse explains
        warnings.simplefilter("ignore", PictureWarning)
        assert main(arguments) == 0
    assert "up to a scale a channel" in " ".join(capsys.readouterr().out.split())
    assert read_pixels(folder / "env.exr").shape == (8, 16, 3)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["0.exr"], "give a map, a list of lights, or unknown"),
        (["0.exr", "--light", "none.hdr"], "none.hdr: No such file"),
        (["0.exr", "1.exr", "--light", "lights.csv"], "lights.csv holds 3 lights for 2 pictures"),
        (["0.exr", "--light", "lights.csv", "-o", "0.exr"], "0.exr is what this is made from"),
        (
            ["0.exr", "--light", "lights.csv", "--light-out", "e.exr"],
            "only an environment map can be written",
        ),
        (["space.npz", "--light", "lights.csv"], "space.npz: not a picture"),
    ],
)
def test_what_fails_is_told_in_a_line(folder, capsys, arguments, text):
    assert main(["photo", *arguments]) != 0
    told = capsys.readouterr().err
    assert text in told
    assert told.count("\n") == 1
    assert not (folder / "model.json").exists()


def test_a_folder_in_the_layout_of_diligent_is_read(folder, truth, capsys):
    stack = folder / "ball"
    stack.mkdir()
    names = [f"{i:03d}.png" for i in range(1, 4)]
    (stack / "filenames.txt").write_text("\n".join(names) + "\n")
    np.savetxt(stack / "light_directions.txt", DIRECTIONS)
    np.savetxt(stack / "light_intensities.txt", np.full((3, 3), 3.0))
    y, x = np.mgrid[SIZE - 1 : -SIZE : -2, -SIZE + 1 : SIZE : 2] / SIZE
    inside = x**2 + y**2 < 0.95
    normals = np.stack([x, y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=-1) * inside[..., None]
    pictures = [relight(truth, normals, Light.distant(direction, 3.0)) for direction in DIRECTIONS]
    most = max(picture.max() for picture in pictures)
    for name, picture in zip(names, pictures, strict=True):
        write_png(stack / name, picture / most)
    write_png(stack / "mask.png", np.repeat(inside[..., None], 3, axis=-1).astype(float))
    np.savetxt(stack / "normal.txt", normals.reshape(-1, 3))

    read = sources.read_stack(stack)
    assert read.mask.shape == read.images[0].shape[:2] == read.normals.shape[:2]
    rows, columns = (np.flatnonzero(inside.any(axis)) for axis in (1, 0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    np.testing.assert_allclose(read.images[1], pictures[1][box] / most, atol=1e-4)

    assert main(["photo", "ball", "--prior", "space.npz"]) == 0
    assert "up to a scale a channel" in " ".join(capsys.readouterr().out.split())
    found = dsbrdf.load(folder / "model.json")
    made = relight(found, normals, Light.distant(DIRECTIONS[0], 3.0))
    lit = inside & (pictures[0].min(-1) > 0.05 * pictures[0].mean())
    ratio = np.log(made[lit] / pictures[0][lit])
    assert np.std(ratio, axis=0).max() < 0.1

    (stack / "filenames.txt").write_text("../secret.png\n" * 3)
    with pytest.raises(ValueError, match="expected names of files in this folder"):
        sources.read_stack(stack)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 1 2\n", "expected x y z, or x y z r g b, got 4 numbers"),
        ("0 0 0\n", "expected a direction"),
        ("0 0 1\nup up up\n", "line 2: expected numbers"),
        ("x,y,z\n", "holds no numbers"),
    ],
)
def test_bad_lists_of_lights(tmp_path, text, message):
    (tmp_path / "l.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        sources.read_lights(tmp_path / "l.csv")


def test_pictures_and_maps_may_be_arrays(tmp_path):
    rng = np.random.default_rng(0)
    pixels = rng.random((4, 8, 3))
    np.save(tmp_path / "a.npy", pixels)
    np.testing.assert_array_equal(Picture.of(tmp_path / "a.npy", "").pixels, pixels)
    np.testing.assert_array_equal(Light.from_map(tmp_path / "a.npy").map, pixels)
    # Bytes are sRGB, and clipped ones are no values
    np.save(tmp_path / "b.npy", np.array([[[188, 188, 188], [255, 10, 10]]], dtype=np.uint8))
    encoded = Picture.of(tmp_path / "b.npy", "")
    np.testing.assert_allclose(encoded.pixels[0, 0], 0.503, atol=1e-3)
    assert encoded.valid.tolist() == [[True, False]]
    np.save(tmp_path / "c.npy", np.ones(3))
    with pytest.raises(
        ValueError, match=r"c\.npy: a picture must be \(height, width, channel\), got shape \(3,\)"
    ):
        Picture.of(tmp_path / "c.npy", "")


@pytest.mark.parametrize("value", [1e200, 1e308, np.inf, np.nan])
def test_normals_and_lights_without_a_length(tmp_path, value):
    """Squares that are no numbers: a normal keeps its direction, or is none; a light is refused or has one."""
    normals = np.zeros((2, 2, 3))
    normals[..., 2] = 1.0
    normals[0, 0, 0] = value
    np.save(tmp_path / "n.npy", normals)
    found = sources.read_normals(tmp_path / "n.npy")
    np.testing.assert_array_equal(found[1, 1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(found[0, 0], [float(np.isfinite(value)), 0.0, 0.0], atol=1e-100)
    (tmp_path / "lights.csv").write_text(f"x,y,z\n{value},0,1\n")
    if np.isfinite(value):
        (light,) = sources.read_lights(tmp_path / "lights.csv")
        assert light.map is None
    else:
        with pytest.raises(ValueError, match="light 1"):
            sources.read_lights(tmp_path / "lights.csv")


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.float64])
def test_a_mask_may_be_an_array(dtype, tmp_path):
    mask = np.arange(12).reshape(3, 4) > 5
    np.save(tmp_path / "mask.npy", mask.astype(dtype))
    np.testing.assert_array_equal(sources.read_mask(tmp_path / "mask.npy"), mask)
    np.save(tmp_path / "mask.npy", np.zeros(5, dtype))
    with pytest.raises(ValueError, match=r"a mask must be \(height, width\), got shape \(5,\)"):
        sources.read_mask(tmp_path / "mask.npy")
