"""The environments of the sphere, made by us or read from images, and how evenly they light it."""

import json
import struct

import numpy as np
import pytest
from sphere_page import environment_pixels, inside, picture


@pytest.mark.parametrize("environment", ["soft-boxes", "sky", "window", "gradient", "dark-room"])
def test_no_fireflies(show_sphere, environment):
    """After few samples no pixel stands out from its neighbours."""
    from scipy.ndimage import maximum_filter

    page = show_sphere("satin-plastic", "polished-chrome", "rough-gold", size=64)
    for k in range(3):
        page.evaluate(
            "([k, name]) => { sphere.setMaterials(materials[k]); sphere.setEnvironment(name); }"
            if environment != "dark-room"
            else "([k, name]) => { sphere.setMaterials(materials[k]); sphere.setLighting(name); }",
            [k, environment],
        )
        image = picture(page, 16, size=64).mean(-1)
        ring = np.ones((5, 5), dtype=bool)
        ring[2, 2] = False
        within = inside(64, margin=4.0)
        assert np.all(image[within] < 3.0 * maximum_filter(image, footprint=ring)[within])


def test_environments(show_sphere):
    """Each has the mean radiance it says, and a table whose density is that of its light."""
    page = show_sphere("rough-gold")
    for name, mean in {
        "soft-boxes": 0.5,
        "sky": 0.5,
        "window": 0.5,
        "gradient": 0.5,
        "dark-room": 0.25,
    }.items():
        page.evaluate(
            "(name) => (name === 'dark-room' ? sphere.setLighting(name) : sphere.setEnvironment(name))", name
        )
        pixels = environment_pixels(page)
        height, width = pixels.shape[:2]
        sine = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]
        luminance = pixels @ [0.2126, 0.7152, 0.0722]
        assert (luminance * sine).sum() / (sine.sum() * width) == pytest.approx(mean, rel=1e-4)
        # As text: the driver hands over a list number by number
        table = page.evaluate("""async () => {
            const { samplingTable } = await import("/environment.js");
            return JSON.stringify(Array.from(samplingTable(sphere.environmentPixels())));
        }""")
        density = np.reshape(json.loads(table), (height, width, 4))[..., 2]
        assert density.mean() == pytest.approx(1.0, rel=1e-5)
        assert np.all(density[luminance > 0.0] > 0.0)
        blurred = np.corrcoef(density.ravel(), (luminance * sine).ravel())[0, 1]
        assert blurred > 0.8


def hdr_bytes(rgb, packed):
    """A Radiance picture of (height, width, 3) values, rows packed by run lengths or not."""
    mantissa, exponent = np.frexp(rgb.max(-1))
    scale = np.where(mantissa > 0.0, mantissa * 256.0 / np.maximum(rgb.max(-1), 1e-30), 0.0)
    rgbe = np.concatenate([rgb * scale[..., None], exponent[..., None] + 128.0], axis=-1).astype(np.uint8)
    height, width = rgb.shape[:2]
    body = b""
    for row in rgbe:
        if packed:
            body += struct.pack(">BBH", 2, 2, width)
            for component in row.T:
                # One run, and the rest one by one
                body += bytes([128 + 3, component[0]]) + bytes([width - 3]) + component[3:].tobytes()
        else:
            body += row.tobytes()
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + body


READ = """
async ([name, bytes]) => {
    const { readEnvironment } = await import("/environment.js");
    const image = await readEnvironment(new File([new Uint8Array(bytes)], name));
    sphere.setEnvironmentImage(image);
}
"""


@pytest.mark.parametrize("packed", [True, False])
def test_radiance_image(show_sphere, rng, packed):
    page = show_sphere("rough-gold")
    rgb = rng.uniform(0.1, 4.0, (8, 16, 3))
    rgb[:, :3] = rgb[:, :1]
    page.evaluate(READ, ["a.hdr", list(hdr_bytes(rgb, packed))])
    pixels = environment_pixels(page)
    assert pixels.shape == rgb.shape
    factor = pixels.sum() / rgb.sum()
    np.testing.assert_allclose(pixels, factor * rgb, atol=0.01 * factor * rgb.max())


def test_large_image_is_averaged(show_sphere, rng):
    page = show_sphere("rough-gold")
    rgb = rng.uniform(0.1, 1.0, (1024, 64, 3))
    page.evaluate(
        "([height, width, data]) => sphere.setEnvironmentImage({ height, width, data: new Float32Array(data) })",
        [1024, 64, rgb.ravel().tolist()],
    )
    pixels = environment_pixels(page)
    averaged = rgb.reshape(512, 2, 32, 2, 3).mean((1, 3))
    np.testing.assert_allclose(pixels, averaged * (pixels.sum() / averaged.sum()), rtol=1e-4)


def test_png_image(show_sphere, tmp_path):
    """Red above, half as bright a blue below in linear light."""
    import matplotlib.image

    page = show_sphere("rough-gold")
    image = np.zeros((4, 8, 3))
    image[:2, :, 0] = 1.0
    image[2:, :, 2] = 1.055 * 0.5 ** (1 / 2.4) - 0.055
    matplotlib.image.imsave(tmp_path / "a.png", image)
    page.evaluate(READ, ["a.png", list((tmp_path / "a.png").read_bytes())])
    pixels = environment_pixels(page)
    assert pixels[0, 0, 1] == 0.0
    assert pixels[3, 0, 2] / pixels[0, 0, 0] == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.txt", b"no image", "a.txt: not an image this browser reads. Take a jpg, png, webp or hdr file."),
        ("a.hdr", b"no image", "a.hdr: not a Radiance picture: it does not begin with '#\\?'."),
        (
            "a.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 2 +X 8\n",
            "a.hdr: only the format 32-bit_rle_rgbe is read.",
        ),
        (
            "a.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 8 -Y 2\n",
            "a.hdr: expected a size like '-Y 512 \\+X 1024', got '\\+X 8 -Y 2'.",
        ),
        ("a.hdr", hdr_bytes(np.ones((4, 16, 3)), False)[:-20], "a.hdr: the file is cut short."),
        ("a.hdr", hdr_bytes(np.ones((4, 16, 3)), True)[:-20], "a.hdr: the file is damaged or cut short."),
        ("a.hdr", hdr_bytes(np.zeros((4, 16, 3)), False), "The image is black: it gives no light."),
    ],
)
def test_images_that_cannot_be_used(show_sphere, name, content, text):
    page = show_sphere("rough-gold")
    with pytest.raises(Exception, match=text):
        page.evaluate(READ, [name, list(content)])
    assert page.evaluate("errors") == []
