"""How precise exported RGL files are in stock Mitsuba; prints the table of docs/export.md.

python benchmarks/export.py [FILE ...]

The built-in materials, and MERL files if any are given. Takes three minutes. Needs Mitsuba with LLVM.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

import dsbrdf
from dsbrdf.export.rgl import write_rgl
from dsbrdf.measured import built_in
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import Lobes

#: Values below are hardly seen, 1/sr.
DARK = 1e-3
ANGLES, GRAZING = np.array([0.01, 8, 17, 25, 33, 42, 50, 58, 67, 75]), np.array([80.0, 84, 87])
N = 20_000


def toward(theta):
    return np.array([np.sin(theta), 0.0, np.cos(theta)])


def vectors(w):
    return mi.Vector3f(np.ascontiguousarray(w.T, dtype=np.float32))


def interaction(wi, n):
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.wi = vectors(np.broadcast_to(wi, (n, 3)))
    return si


def off(model, bsdf, degrees, limit, drawn, rng):
    """Differences of values relative to value + `DARK`, median and 95th percentile in %."""
    low, found = np.cos(np.deg2rad(limit)), []
    for theta in np.deg2rad(degrees):
        wi = toward(theta)
        if drawn:
            wo = model.sample(np.broadcast_to(wi, (N, 3)), rng)
        else:
            z, phi = rng.uniform(low, 1.0, N), 2.0 * np.pi * rng.random(N)
            s = np.sqrt(1.0 - z * z)
            wo = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
        wo = wo[wo[:, 2] > low]
        stock = np.array(bsdf.eval(mi.BSDFContext(), interaction(wi, len(wo)), vectors(wo))).T / wo[:, 2:]
        value = model.eval(wi, wo)
        found.append(np.abs(stock - value) / (value + DARK))
    return 100.0 * np.percentile(np.concatenate(found), [50, 95])


def weights(model, bsdf, degrees, rng):
    """Mean weight of samples minus the albedo, the largest channel, and its relative deviation."""
    wi, n = toward(np.deg2rad(degrees)), 10 * N
    numbers = rng.random((3, n), dtype=np.float32)
    _, weight = bsdf.sample(
        mi.BSDFContext(), interaction(wi, n), mi.Float(numbers[0]), mi.Point2f(numbers[1:])
    )
    weight = np.array(weight).T
    albedo = model.albedo(np.deg2rad(degrees))
    return np.abs(weight.mean(0) - albedo).max(), weight.mean(1).std() / weight.mean()


def models(files):
    """Names and models."""
    for name in built_in.names():
        yield name, dsbrdf.fit(dsbrdf.material(name)).model
    for file in files:
        yield f"{Path(file).stem} \\*", dsbrdf.fit(dsbrdf.read(file)).model
    column = np.zeros((1, 1))
    mirror = Lobes(column + np.log(5.0), column + np.log(2e4), column, column, np.zeros((3, 1, 1)))
    yield "near-mirror (kappa 5, gamma 20,000)", DSBRDF(mirror)


def main() -> None:
    warnings.simplefilter("ignore")
    mi.set_variant("llvm_ad_rgb")
    rng = np.random.default_rng(1)
    print("| material | drawn | even | grazing | albedo | std |\n|---|---|---|---|---|---|")
    for name, model in models(sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            write_rgl(model, Path(folder, "x.bsdf"))
            bsdf = mi.load_dict({"type": "measured", "filename": str(Path(folder, "x.bsdf"))})
        errors = [
            off(model, bsdf, ANGLES, 75.0, True, rng),
            off(model, bsdf, ANGLES, 75.0, False, rng),
            off(model, bsdf, GRAZING, 88.0, True, rng),
        ]
        light = [weights(model, bsdf, degrees, rng) for degrees in (0.01, 30.0, 60.0, 75.0, 85.0)]
        up_to_75, deviation = max(a for a, _ in light[:4]), [s for _, s in light]
        shown = " | ".join(f"{median:.2f}, {most:.1f}" for median, most in errors)
        print(
            f"| {name} | {shown} | {up_to_75:.4f}, {light[4][0]:.4f} | {min(deviation):.1g}-{max(deviation):.1g} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
