"""A fitted model in a Mitsuba scene: as a plugin where that runs, and as a file that stock Mitsuba loads.

    python examples/mitsuba_scene.py [FOLDER]

Writes rough-gold.json, rough-gold.bsdf and a picture from each to FOLDER, the current one by default. The second
picture needs nothing but Mitsuba and the .bsdf file.
"""

import sys
from pathlib import Path

import mitsuba as mi

import dsbrdf
from dsbrdf import render
from dsbrdf.export.rgl import write_rgl


def scene(bsdf):
    """A sphere under a constant light and a small one."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {
            "type": "perspective",
            "fov": 25.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 96, "height": 96},
        },
        "sky": {"type": "constant", "radiance": 0.3},
        "lamp": {
            "type": "sphere",
            "center": [-2.0, 3.0, 3.0],
            "radius": 0.5,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 20.0}},
        },
        "ball": {"type": "sphere", "bsdf": bsdf},
    }


def main():
    """Fit, write, render."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    model = dsbrdf.fit(dsbrdf.material("rough-gold"), n_lobes=3).model
    model.save(folder / "rough-gold.json")
    write_rgl(model, folder / "rough-gold.bsdf")

    if render.choose().startswith("llvm"):
        render.register()
        plugin = {"type": "dsbrdf", "filename": str(folder / "rough-gold.json")}
        image = mi.render(mi.load_dict(scene(plugin)), spp=64)
        mi.util.write_bitmap(str(folder / "plugin.png"), image, write_async=False)

    mi.set_variant("scalar_rgb")
    stock = {"type": "measured", "filename": str(folder / "rough-gold.bsdf")}
    image = mi.render(mi.load_dict(scene(stock)), spp=64)
    mi.util.write_bitmap(str(folder / "stock.png"), image, write_async=False)
    print(f"written to {folder}")


if __name__ == "__main__":
    main()
