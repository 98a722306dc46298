"""Texels: accuracy on materials that the prior has not seen, and speed.

python benchmarks/texels.py accuracy FOLDER [N]    tables of materials of the library, by name; N of them
python benchmarks/texels.py speed                  texels a second and core, 96 and 22,801 directions

Values have 2 % noise. Directions are half of them even over the hemisphere, half with half vectors within 25 degrees of
the normal; the error is told over 2,000 other pairs of directions, even over the hemisphere, below 80 degrees.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.batch.texels import texel_space

NOISE = 0.02


def pairs(n, rng, *, near=0.5):
    """Directions (n, 3) toward light and viewer, a share of them with half vectors near the normal."""
    wi, wo = [], []
    while len(wi) < n:
        a = even(rng)
        if len(wi) < near * n:
            h = even(rng, 25.0)
            b = 2.0 * (a @ h) * h - a
        else:
            b = even(rng)
        if b[2] > np.cos(np.deg2rad(80.0)):
            wi.append(a)
            wo.append(b)
    return np.array(wi), np.array(wo)


def even(rng, degrees=80.0):
    z = rng.uniform(np.cos(np.deg2rad(degrees)), 1.0)
    phi = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z])


def accuracy(folder, n, counts=(20, 96, 193, 1000)):
    rng = np.random.default_rng(1)
    test = pairs(2000, rng, near=0.0)
    space = texel_space()
    paths = [p for p in sorted(Path(folder).iterdir()) if p.stem in space.names]
    paths = paths[:: max(1, len(paths) // n)]
    errors = {count: [] for count in counts}
    told = {count: [] for count in counts}
    best = []
    for path in paths:
        table = dsbrdf.read(path)
        truth = np.maximum(table.eval(*test), 0.0)
        prior = space.without(path.stem)
        for count in counts:
            wi, wo = pairs(count, np.random.default_rng(count))
            clean = table.eval(wi, wo)
            values = clean * (1.0 + NOISE * rng.standard_normal((4, *clean.shape)))
            maps = dsbrdf.fit_texels(wi, wo, values, prior=prior)
            errors[count].append(np.median([log_error(model, truth) for model in maps.eval(*test)]))
            told[count].append(float(np.median(maps.uncertainty)))
        best.append(log_error(space.material(path.stem).eval(*test), truth))
        print(path.stem, f"{best[-1]:.3f}", *(f"{errors[c][-1]:.3f}" for c in counts), flush=True)
    print(
        f"{len(paths)} materials, median (90th percentile); own two lobes of all values {np.median(best):.3f}"
    )
    for count in counts:
        e, u = np.array(errors[count]), np.array(told[count])
        print(
            f"{count} directions: log {np.median(e):.3f} ({np.quantile(e, 0.9):.3f}), "
            f"told {np.median(u):.3f}, correlation of their ranks {rank(e, u):.2f}"
        )


def log_error(model, truth):
    return float(np.sqrt(np.nanmean((np.log(model + 1e-6) - np.log(truth + 1e-6)) ** 2)))


def rank(a, b):
    return float(np.corrcoef(a.argsort().argsort(), b.argsort().argsort())[0, 1])


def speed(counts=((96, 8000), (193, 4000), (22_801, 400))):
    names = texel_space().names
    rng = np.random.default_rng(2)
    for n, n_texels in counts:
        wi, wo = pairs(n, rng)
        some = [dsbrdf.library.load(names[i]).eval(wi, wo) for i in range(0, len(names), 5)]
        values = np.array([some[i % len(some)] for i in range(n_texels)], dtype=np.float32)
        values *= 1.0 + NOISE * rng.standard_normal(values.shape, dtype=np.float32)
        dsbrdf.fit_texels(wi, wo, values[:8])
        wall, cpu = time.perf_counter(), time.process_time()
        dsbrdf.fit_texels(wi, wo, values)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        minutes = 160_000 / (n_texels / cpu) / 2 / 60
        print(
            f"{n} directions: {n_texels / cpu:.0f} texels a second and core (processor time), "
            f"{n_texels / wall:.0f} a second on {os.cpu_count()} cores; 400 x 400 texels: "
            f"{minutes:.1f} min on two, {values.nbytes / 1e6:.0f} MB",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1] == "accuracy":
        accuracy(sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 1000)
    else:
        speed()
