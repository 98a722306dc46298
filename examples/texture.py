"""A spatially varying material, measured, fitted texel by texel, and rendered beside the truth.

    python examples/texture.py [FOLDER] [SIZE]

Two materials of the built-in library are blended by a mask of SIZE x 2 SIZE texels (64 by default), "measured" at 193
and at 96 directions with 2 % noise, and fitted with the prior of all the other materials. Writes texture.png, and
texture.npz for Mitsuba, to FOLDER, the current one by default.
"""

import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

import dsbrdf
from dsbrdf import plot, render
from dsbrdf.batch.texels import texel_space
from dsbrdf.render import lighting, picture, quality

MATERIALS = ("blue-rubber", "gold-paint")
COUNTS = (193, 96)
NOISE = 0.02


def mask(size, rng):
    """Share (size, 2 size) of the second material: spots with soft edges, which close around a sphere."""
    u = 2.0 * np.pi * (np.arange(2 * size) + 0.5) / (2 * size)
    v = np.pi * (np.arange(size)[:, None] + 0.5) / size
    waves = zip(
        rng.integers(1, 7, 40), rng.integers(1, 7, 40), rng.uniform(0.0, 2.0 * np.pi, (40, 2)), strict=True
    )
    height = sum(np.cos(k * u + a) * np.cos(m * v + b) for k, m, (a, b) in waves)
    return np.clip(0.5 + 0.35 * height / height.std(), 0.0, 1.0)


def directions(n, rng):
    """Pairs of directions (n, 3), half of them with a half vector within 25 degrees of the normal."""
    found = []
    while len(found) < n:
        wi = even(rng, 75.0)
        if len(found) % 2:
            half = even(rng, 25.0)
            wo = 2.0 * (wi @ half) * half - wi
        else:
            wo = even(rng, 75.0)
        if wo[2] > 0.2:
            found.append((wi, wo))
    return np.array(found).swapaxes(0, 1)


def even(rng, degrees):
    """A direction, even over what is within some degrees of the normal."""
    z = rng.uniform(np.cos(np.deg2rad(degrees)), 1.0)
    phi = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z])


def shown(bsdf, size, spp):
    """A picture (size, size, 4) of a ball."""
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], -90).rotate([0, 0, 1], 60)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4, "hide_emitters": True},
        "sensor": {
            "type": "perspective",
            "fov": 22.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 5.4], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgba"},
        },
        "light": {"type": "envmap", "bitmap": mi.Bitmap(lighting.studio().astype(np.float32))},
        "ball": {"type": "sphere", "to_world": upright, "bsdf": {"type": "twosided", "bsdf": bsdf}},
    }
    return np.array(mi.render(mi.load_dict(scene), spp=spp), dtype=float)


def main():
    """Make the material, fit it, and draw it."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    size = int(sys.argv[2]) if len(sys.argv) > 2 else 64
    rng = np.random.default_rng(2)
    share = mask(size, rng)
    ends = [dsbrdf.library.load(name) for name in MATERIALS]
    prior = texel_space()
    for name in MATERIALS:
        prior = prior.without(name)

    render.choose("llvm_ad_rgb")
    render.register()
    view = max(2 * size, 32), 4 * size
    bitmap = {"type": "bitmap", "data": mi.TensorXf(share[..., None].astype(np.float32)), "raw": True}
    truth = {
        "type": "blendbsdf",
        "weight": bitmap,
        "a": render.to_dict(ends[0]),
        "b": render.to_dict(ends[1]),
    }
    reference = shown(truth, *view)
    tiles = [picture.Tile("truth", reference)]
    for n in COUNTS:
        wi, wo = directions(n, rng)
        a, b = (model.eval(wi, wo) for model in ends)
        values = (1.0 - share[..., None, None]) * a + share[..., None, None] * b
        values *= 1.0 + NOISE * rng.standard_normal(values.shape)
        maps = dsbrdf.fit_texels(wi, wo, values.astype(np.float32), prior=prior)
        image = shown(render.to_dict(maps), *view)
        difference = quality.compare(image, reference, picture.exposure_of(reference))
        tiles.append(picture.Tile(f"fitted, {n} directions", image, difference))
        print(f"{n} directions: mean CIEDE2000 {difference.mean:.2f}, SSIM {difference.ssim:.3f}")
    maps.save(folder / "texture.npz")
    title = f"{MATERIALS[0]} and {MATERIALS[1]}"
    plot.write_figure(picture.sheet([picture.Row(title, tiles)]), folder / "texture.png")


if __name__ == "__main__":
    main()
