"""Render a model with stock Mitsuba 3: no plugin of ours, and no LLVM.

Fits a built-in material, writes it as an RGL `.bsdf` file, and renders a sphere of it in `scalar_rgb`, next to one of
the nearest `principled` material. Needs `pip install 'dsbrdf[render]'`.

    python examples/stock_mitsuba.py [OUT.png] [PIXELS] [SAMPLES]
"""

import json
import sys
import tempfile
from pathlib import Path

import mitsuba as mi

import dsbrdf
from dsbrdf.export import export

SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.15, 0.17, 0.2]}}
SUN = {
    "type": "directional",
    "direction": [0.6, -0.6, -0.6],
    "irradiance": {"type": "rgb", "value": [3.0, 2.9, 2.7]},
}


def scene(left: dict, right: dict, pixels: int) -> dict:
    """Two spheres side by side, seen from afar along -z."""
    camera = mi.ScalarTransform4f().look_at(origin=[0, 0, 20], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 2 * pixels, "height": pixels, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "perspective", "fov": 12.5, "to_world": camera, "film": film},
        "left": {"type": "sphere", "center": [-1.05, 0, 0], "bsdf": left},
        "right": {"type": "sphere", "center": [1.05, 0, 0], "bsdf": right},
        "sky": SKY,
        "sun": SUN,
    }


def main(out: str = "stock_mitsuba.png", pixels: str = "200", samples: str = "64") -> None:
    """Fit, export, render."""
    mi.set_variant("scalar_rgb")
    model = dsbrdf.fit(dsbrdf.material("rough-gold"), n_lobes=3).model
    with tempfile.TemporaryDirectory() as folder:
        measured, preview = Path(folder, "gold.bsdf"), Path(folder, "gold.json")
        export(model, measured, "rgl")
        print(export(model, preview, "principled"))
        left = {"type": "measured", "filename": str(measured)}
        spheres = scene(left, json.loads(preview.read_text()), int(pixels))
        image = mi.render(mi.load_dict(spheres), spp=int(samples))
    mi.util.write_bitmap(out, image)
    print(f"{out}: the exported model on the left, the principled preview on the right")


if __name__ == "__main__":
    main(*sys.argv[1:])
