"""Tables of theta_h x theta_d alone: arrays and images, their axes, and their fit."""

import struct
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import dsbrdf
from dsbrdf import read
from dsbrdf.measured.formats.image_file import MAX_SIDE, read_image


@pytest.fixture
def pixels(rng):
    """Rows from the top (theta_d of 90 degrees) down, columns of theta_h."""
    return rng.uniform(0.0, 4.0, (5, 7, 3)).astype(np.float32)


def write_image(path, pixels):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.Bitmap(pixels).write(str(path))
    return path


def test_an_array_has_theta_h_first(tmp_path):
    values = np.arange(20.0).reshape(4, 5)
    np.save(tmp_path / "a.npy", values)
    measured = read(tmp_path / "a.npy")
    assert_array_equal(measured.values[:, :, 0, 0], values)
    assert_allclose(np.rad2deg(measured.theta_h), 90 * ((np.arange(4) + 0.5) / 4) ** 2)
    assert_allclose(np.rad2deg(measured.theta_d), 90 * (np.arange(5) + 0.5) / 5)
    assert_allclose(np.cos(2 * measured.phi_d), [0.0], atol=1e-15)


def test_a_last_axis_is_of_channels(tmp_path):
    values = np.arange(40.0).reshape(4, 5, 2)
    values[0, 0] = [-1.0, np.nan]
    np.savez(
        tmp_path / "a.npz", values=values, theta_h=[0.0, 0.1, 0.2, 0.3], theta_d=[0.0, 0.1, 0.2, 0.3, 0.5]
    )
    measured = read(tmp_path / "a.npz", convention="edge")
    assert_array_equal(measured.theta_d, [0.0, 0.1, 0.2, 0.3, 0.5])
    assert measured.convention == "edge"
    assert not measured.valid[0, 0].any()
    assert_array_equal(measured.values[1:, 1:, 0], values[1:, 1:])


def test_an_exr_image_has_theta_d_upward(tmp_path, pixels):
    measured = read(write_image(tmp_path / "a.exr", pixels))
    assert_array_equal(measured.values[:, :, 0], pixels[::-1].swapaxes(0, 1))
    assert measured.planes.shape == (3, 7, 5, 1)


def test_a_grey_image_has_three_channels(tmp_path, pixels):
    measured = read(write_image(tmp_path / "a.exr", pixels[..., :1]))
    assert_allclose(
        measured.values[:, :, 0], np.repeat(pixels[::-1, :, :1].swapaxes(0, 1), 3, axis=-1), rtol=1e-6
    )


def test_a_png_image_is_decoded_from_srgb(tmp_path):
    codes = np.array([[[0, 10, 128], [255, 200, 64]]], np.uint8)
    measured = read(write_image(tmp_path / "a.png", codes))
    v = codes / 255
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    assert_allclose(measured.values[:, 0, 0], linear[0], rtol=1e-5)


def test_it_is_fitted_without_azimuthal_term(tmp_path):
    theta_h = np.deg2rad(90 * ((np.arange(60) + 0.5) / 60) ** 2)
    profile = np.expm1(3.0 * np.cos(theta_h) ** 80) + np.expm1(0.2 * np.cos(theta_h))
    np.save(tmp_path / "a.npy", np.repeat(profile[:, None], 30, axis=1))
    fit = dsbrdf.fit(read(tmp_path / "a.npy"), 2)
    assert not fit.coverage.azimuth
    assert fit.errors.rel < 1e-2
    assert np.abs(fit.model.lobes.beta).max() < 1e-3


@pytest.mark.parametrize("size", [(MAX_SIDE + 1, 1), (0, 4), (2**31 - 1, 2**31 - 1)])
def test_images_of_another_size_are_refused_before_they_are_decoded(tmp_path, pixels, size):
    png = tmp_path / "a.png"
    png.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">2I", *size))
    exr = write_image(tmp_path / "a.exr", pixels)
    content = bytearray(exr.read_bytes())
    for name in (b"dataWindow", b"displayWindow"):
        at = content.index(name) + len(name) + 11
        content[at : at + 16] = struct.pack("<4i", 0, 0, size[0] - 1, size[1] - 1)
    exr.write_bytes(content)
    for path in (png, exr):
        need = f"an EXR, HDR or PNG file of 1 to {MAX_SIDE} pixels on a side"
        text = f"{path}: not an image slice: expected {need}, got {size[0]} x {size[1]}."
        with pytest.raises(ValueError, match=text):
            read(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"dataWindow", b"dataWindaw"),
        (b"string\0\x15\0\0\0", b"string\0\x15\0\0\x70"),
        (b"displayWindow\0box2i\0\x10\0\0\0\0", b"displayWindow\0box2i\0\x10\0\0\0\1"),
        (b"channels", b"\0hannels"),
    ],
)
def test_an_image_with_a_strange_header_is_refused(tmp_path, pixels, old, new):
    path = write_image(tmp_path / "a.exr", pixels)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))
    with pytest.raises(ValueError, match="got 0 x 0"):
        read(path)


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_a_cut_image_is_refused(tmp_path, pixels, suffix):
    path = write_image(
        tmp_path / f"a.{suffix}", pixels if suffix == "exr" else (pixels * 60).astype(np.uint8)
    )
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(ValueError, match="not a sound image: "):
        read(path)


def test_mitsuba_is_named_where_it_is_missing(tmp_path, pixels, monkeypatch):
    path = write_image(tmp_path / "a.exr", pixels)
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(ModuleNotFoundError, match=r"images need Mitsuba: pip install 'dsbrdf\[render\]'"):
        read_image(path)
