"""What a prior is worth: errors over the whole hemisphere from few noisy samples, with a space and without.

python benchmarks/prior.py FOLDER [--left-out N] [--lobes K]

FOLDER holds MERL .binary files. All are fitted with K lobes; every material that is asked for is left out of the
space in turn. Samples are pairs of directions, even over both hemispheres below 80 degrees, and the values of the
table there; noise is normal and relative. Errors are over other such pairs: relative RMS, that of the cube root of
f cos cos, and RMS of ln(f + 1e-4). About four minutes for 100 files and 20 left out, on two cores.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.measured import Samples
from dsbrdf.space import FIT, build_space

COUNTS, NOISE = (5, 20, 100, 500), (0.02, 0.1)
N_TESTED = 10_000
OFFSET = 1e-4


def pairs(rng, n, limit=80.0):
    """Pairs of directions even over both hemispheres up to `limit` degrees from the normal."""
    z, phi = rng.uniform(np.cos(np.deg2rad(limit)), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


def valid_pairs(measured, rng, n):
    """Pairs of directions with values (n, channel) that are positive."""
    wi, wo = pairs(rng, 2 * n + 100)
    values = measured.eval(wi, wo)
    kept = np.flatnonzero((np.isfinite(values) & (values > 0.0)).all(1))[:n]
    return wi[kept], wo[kept], values[kept]


def errors(model, wi, wo, f):
    """rel, cbrt and log."""
    g, cosines = model.eval(wi, wo), (wi[:, 2] * wo[:, 2])[:, None]
    a, b = np.cbrt(g * cosines), np.cbrt(f * cosines)
    log = np.log((g + OFFSET) / (f + OFFSET))
    return (
        np.sqrt(((g - f) ** 2).sum() / (f**2).sum()),
        np.sqrt(((a - b) ** 2).sum() / (b**2).sum()),
        np.sqrt((log**2).mean()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--left-out", type=int, default=20)
    parser.add_argument("--lobes", type=int, default=FIT["n_lobes"])
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    files = sorted(args.folder.glob("*.binary"))
    space = build_space([dsbrdf.fit(dsbrdf.read(file), args.lobes).model for file in files])
    step = max(len(files) // args.left_out, 1)
    chosen = files[step // 2 :: step][: args.left_out]
    results = {(n, noise): [] for n in COUNTS for noise in NOISE}
    for i, file in enumerate(chosen):
        measured, rest = dsbrdf.read(file), space.without(file.stem)
        tested = valid_pairs(measured, np.random.default_rng([i, 0]), N_TESTED)
        for n, noise in results:
            rng = np.random.default_rng([i, n, int(1000 * noise)])
            wi, wo, values = valid_pairs(measured, rng, n)
            values = np.maximum(values * (1.0 + noise * rng.standard_normal(values.shape)), 0.0)
            samples = Samples(wi, wo, values, name=file.stem)
            fits = [dsbrdf.fit(samples, prior=rest), dsbrdf.fit(samples)]
            results[n, noise].append([errors(fit.model, *tested) for fit in fits])
    print(f"{space}; {len(chosen)} left out in turn; medians of rel, cbrt and log, and the mean of log")
    print("                 with the prior                     without                   better in")
    for (n, noise), rows in results.items():
        found = np.array(rows)
        shown = [
            "  ".join(f"{value:6.3f}" for value in (*np.median(of, axis=0), of[:, 2].mean()))
            for of in (found[:, 0], found[:, 1])
        ]
        better = (found[:, 0, 2] < found[:, 1, 2]).mean()
        print(f"{n:4d} at {noise:4.0%}     {shown[0]}     {shown[1]}     {better:.0%}", flush=True)


if __name__ == "__main__":
    main()
