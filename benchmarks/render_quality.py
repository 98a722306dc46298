"""How a fitted sphere differs from the measured one: CIEDE2000 and SSIM over a folder of measured files.

    python benchmarks/render_quality.py FOLDER [--pattern '*.binary'] [--envmap HDR] [--size 96] [--spp 144] [--every 1]

Spheres under our own lighting or an environment map, in one exposure a material, which brings the mean luminance of
the measured one to the value in `dsbrdf.render.picture`. Lobes are chosen by the fit. All have the same seed, and so
much the same noise. "Noise" is the measured sphere under another seed, for every tenth material: what noise alone would
make. About 5 s a material on two cores.
"""

import argparse
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.render import picture, quality
from dsbrdf.render.comparison import quiet_fit
from dsbrdf.render.scene import View, render

LOSSES = ("log", "l2")


def of_material(path, view, *, noise):
    """Differences by what is rendered, and the number of lobes by loss."""
    measured = dsbrdf.read(path)
    reference = render(measured, view)
    exposure = picture.exposure_of(reference)
    found, lobes = {}, {}
    for loss in LOSSES:
        model = quiet_fit(measured, "auto", loss)
        lobes[loss] = model.n_lobes
        found[loss] = quality.compare(render(model, view), reference, exposure)
    if noise:
        found["noise"] = quality.compare(render(measured, view, seed=1), reference, exposure)
    return found, lobes


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pattern", default="*.binary")
    parser.add_argument("--envmap", type=Path)
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--spp", type=int, default=144)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    view = View(envmap=options.envmap, size=options.size, spp=options.spp)
    table = {kind: [] for kind in (*LOSSES, "noise")}
    for i, path in enumerate(sorted(options.folder.glob(options.pattern))[:: options.every]):
        found, lobes = of_material(path, view, noise=i % 10 == 0)
        for kind, d in found.items():
            table[kind].append((d.mean, d.worst, d.ssim))
        text = "  ".join(f"{kind} {d.mean:6.2f} {d.worst:6.2f} {d.ssim:.4f}" for kind, d in found.items())
        print(f"{path.stem:28s} K {' '.join(map(str, lobes.values()))}  {text}", flush=True)
    for kind, values in table.items():
        mean, _, ssim = np.array(values).T
        print(
            f"{kind}: CIEDE2000 mean {mean.mean():.2f}, median {np.median(mean):.2f}, worst {mean.max():.2f}; "
            f"SSIM mean {ssim.mean():.4f}, worst {ssim.min():.4f}; {len(mean)} materials"
        )
    log, l2 = (np.array(table[loss])[:, 0] for loss in LOSSES)
    print(f"log below l2 in CIEDE2000 on {(log < l2).sum()} of {len(l2)}")


if __name__ == "__main__":
    main()
