"""Numbers of spaces: variance, components, reconstruction, colours of blends, and whether what is made is valid.

python benchmarks/space.py FOLDER [--lobes 3 4 5] [--checked N]

FOLDER holds MERL .binary files. Each is fitted with so many lobes. Takes about two minutes for 100 files and a number
of lobes, on two cores.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.model.check import check_model
from dsbrdf.space import build_space

N_COMPONENTS = 20
#: Added before logarithms, 1/sr.
OFFSET = 1e-4
#: Blends that are looked at, and the ratio of channels beyond those of the ends that counts.
N_BLENDS, BEYOND = 60, 0.1


def pairs(n=4000, limit=80.0):
    """Pairs of directions even over both hemispheres up to `limit` degrees from the normal."""
    rng = np.random.default_rng(5)
    z, phi = rng.uniform(np.cos(np.deg2rad(limit)), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


def reconstruction(space, models, n):
    """Median RMS of the logarithm of materials from `n` components of the space of the others."""
    wi, wo = pairs()
    found = []
    for name, model in zip(space.names, models, strict=True):
        rest = space.without(name)
        again = rest.model(rest.scores(model)[:n], conserve=False)
        ratio = np.log((again.eval(wi, wo) + OFFSET) / (model.eval(wi, wo) + OFFSET))
        found.append(np.sqrt((ratio**2).mean()))
    return np.median(found)


def strange_colours(space, models):
    """Share of directions in which a blend has a ratio of channels that neither end comes near: median, 90 %."""
    rng, (wi, wo) = np.random.default_rng(0), pairs()
    share = []
    for _ in range(N_BLENDS):
        ends = [models[i] for i in rng.choice(len(models), 2, replace=False)]
        values = [model.eval(wi, wo) + OFFSET for model in (*ends, space.blend(*ends, 0.5))]
        a, b, mixed = (np.log(v[:, 1:] / v[:, :1]) for v in values)
        low, high = np.minimum(a, b) - BEYOND, np.maximum(a, b) + BEYOND
        share.append(((mixed < low) | (mixed > high)).any(1).mean())
    return np.quantile(share, [0.5, 0.9])


def check(space, models, n):
    """Share of blends, moves and draws that pass `dsbrdf check`."""
    rng = np.random.default_rng(0)
    made = space.draw(n, rng)
    for _ in range(n):
        a, b = rng.choice(len(models), 2, replace=False)
        made.append(space.blend(models[a], models[b], rng.uniform()))
        made.append(space.move(models[a], int(rng.integers(1, 5)), rng.uniform(-1.5, 1.5)))
    problems = [report.problems for report in map(check_model, made) if not report.ok]
    for problem in problems[:5]:
        print("   ", *problem)
    return 1.0 - len(problems) / len(made), len(made)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--lobes", type=int, nargs="*", default=[3, 4, 5])
    parser.add_argument("--checked", type=int, default=20)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print(
        f"90/95/99 %: components; log: reconstruction from {N_COMPONENTS} components, left out one at a time; colours: "
        f"share of directions in which a blend is off by {BEYOND:.0%}, median and 90 %"
    )
    print("lobes  correspondence  slots  first two  90/95/99 %      log  colours")
    files = sorted(args.folder.glob("*.binary"))
    for n_lobes in args.lobes:
        models = [dsbrdf.fit(dsbrdf.read(file), n_lobes).model for file in files]
        for correspondence in ("rank", "border"):
            start = time.perf_counter()
            space = build_space(models, correspondence=correspondence)
            fpca = space.fpca
            seconds = time.perf_counter() - start
            counts = "/".join(str(fpca.n_components(share)) for share in (0.9, 0.95, 0.99))
            median, most = strange_colours(space, models)
            log = reconstruction(space, models, N_COMPONENTS)
            print(
                f"{n_lobes:5d}  {correspondence:14s}  {space.n_slots:5d}  {fpca.explained[:2].sum():9.1%}  "
                f"{counts:12s} {log:6.3f}  {median:.1%}, {most:.0%}   built in {seconds:.2f} s",
                flush=True,
            )
            share, n = check(space, models, args.checked)
            print(f"       {share:.0%} of {n} draws, blends and moves pass dsbrdf check", flush=True)


if __name__ == "__main__":
    main()
