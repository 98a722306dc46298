"""Render time of the plugins beside stock ones: a sphere under an environment map, 256 x 256, 64 samples a pixel.

    python benchmarks/rendering.py [ENVMAP]

Without a map, our own lighting. Processor seconds of the whole process, which suffer less from neighbours than wall
time; renders alternate, after one that compiles, and ratios are medians of those of neighbours in time. Also the time
to load each material, and the standard deviation of sample weights against cosine sampling. Takes about two minutes on
two cores.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

import dsbrdf
from dsbrdf import render
from dsbrdf.export.rgl import write_rgl
from dsbrdf.measured import built_in
from dsbrdf.render import scene

ROUNDS = 9
THETA = np.deg2rad([0.0, 30.0, 60.0, 80.0])


def bsdfs(folder):
    """What is rendered, by name."""
    table = dsbrdf.material("paint-two-lobe")
    models = {k: dsbrdf.fit(table, k).model for k in (1, 4, 6)}
    write_rgl(models[4], folder / "exported.bsdf")
    ours = {f"dsbrdf, {k} lobes": render.to_dict(model) for k, model in models.items()}
    return {
        "diffuse": {"type": "diffuse"},
        "roughplastic": {"type": "roughplastic"},
        "principled": {"type": "principled", "roughness": 0.3, "metallic": 0.5, "specular": 0.5},
        "measured": {"type": "measured", "filename": str(folder / "exported.bsdf")},
        **ours,
        "dsbrdf, 4 lobes, fixed": render.to_dict(models[4]) | {"fixed": True},
        "dsbrdf_measured": render.to_dict(table),
    }


def seconds(function):
    start = time.process_time()
    function()
    dr.sync_thread()
    return time.process_time() - start


def times(envmap, folder):
    view = scene.View(envmap=envmap, size=256, spp=64)
    worlds, loading = {}, {}
    for name, bsdf in bsdfs(folder).items():
        start = time.process_time()
        worlds[name] = scene.world(bsdf, view)
        loading[name] = time.process_time() - start
    spent = {name: [] for name in worlds}
    for i in range(ROUNDS + 1):
        for name, world in worlds.items():
            spent[name].append(
                seconds(lambda world=world, i=i: dr.eval(mi.render(world, spp=view.spp, seed=i)))
            )
    for name, values in spent.items():
        ratios = [
            statistics.median(a / b for a, b in zip(values[1:], spent[other][1:], strict=True))
            for other in ("principled", "measured")
        ]
        print(
            f"{name:22s} {statistics.median(values[1:]):.3f} s, {ratios[0]:.2f} of principled, {ratios[1]:.2f} of "
            f"measured; loading {loading[name]:.2f} s",
            flush=True,
        )


def spread(rng, n=100_000):
    """Standard deviation of weights in units of the albedo, mean over channels, against cosine sampling."""
    print("std of weights at 0, 30, 60, 80 degrees / that of cosine sampling")
    for name in built_in.names():
        model = dsbrdf.fit(dsbrdf.material(name)).model
        bsdf = mi.load_dict(render.to_dict(model))
        cells = []
        for theta in THETA:
            wi = np.array([np.sin(theta), 0.0, np.cos(theta)])
            si = dr.zeros(mi.SurfaceInteraction3f, n)
            si.wi = mi.Vector3f(*map(float, wi))
            numbers = rng.random((3, n), dtype=np.float32)
            _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(numbers[0]), mi.Point2f(numbers[1:]))
            ours = np.array(weight).mean(0)
            radius2, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
            x, y = np.sqrt(radius2) * np.cos(phi), np.sqrt(radius2) * np.sin(phi)
            cosine = np.pi * model.eval(wi, np.stack([x, y, np.sqrt(1.0 - radius2)], axis=-1)).mean(-1)
            cells.append(f"{ours.std() / ours.mean():.2f}/{cosine.std() / ours.mean():.2f}")
        print(f"{name:18s} {'  '.join(cells)}", flush=True)


def main():
    render.choose("llvm_ad_rgb")
    render.register()
    with tempfile.TemporaryDirectory() as folder:
        times(sys.argv[1] if len(sys.argv) > 1 else None, Path(folder))
    spread(np.random.default_rng(1))


if __name__ == "__main__":
    main()
