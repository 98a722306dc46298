"""What the library is worth as a prior: errors from few noisy samples, with it and without, each material left out.

python benchmarks/prior.py FOLDER [--every N] [--counts 8 16 20 32 64] [--planned 8]

FOLDER holds MERL .binary files with the names of materials of the library. Each is left out of the library in turn.
Samples are pairs of directions, even over both hemispheres below 80 degrees from the normal, with 2 % of normal noise;
errors are over other such pairs: RMS of ln((g + 0.001/sr) / (f + 0.001/sr)), all channels. PSNR is that of a sphere
under two lights.
Bands are of 95 %. Planned samples are those of `dsbrdf.plan` for the rest of the library. CPU seconds, one thread if
OMP_NUM_THREADS and RAYON_NUM_THREADS are 1. About ten minutes for 100 files on one core.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.measured import Samples
from dsbrdf.model import sphere
from dsbrdf.space import builtin
from dsbrdf.space.process import Positions, unscaled

NOISE, OFFSET, N_TESTED, N_PIXELS = 0.02, 1e-3, 2000, 64


def pairs(rng, n, limit=80.0):
    """Pairs of directions even over both hemispheres up to `limit` degrees from the normal."""
    z, phi = rng.uniform(np.cos(np.deg2rad(limit)), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


def valid(measured, wi, wo, n):
    """The first `n` pairs of directions with values (n, channel) that are positive."""
    values = measured.eval(wi, wo)
    kept = np.flatnonzero((np.isfinite(values) & (values > 0.0)).all(1))[:n]
    return wi[kept], wo[kept], values[kept]


def noisy(pairs_and_values, rng, name):
    """Samples with noise."""
    wi, wo, values = pairs_and_values
    return Samples(
        wi, wo, np.maximum(values * (1.0 + NOISE * rng.standard_normal(values.shape)), 0.0), name=name
    )


def log_error(values, truth):
    return float(np.sqrt((np.log((values + OFFSET) / (truth + OFFSET)) ** 2).mean()))


def psnr(image, truth):
    """Of pictures whose 99 % brightest value is 1, gamma 2.2."""
    exposure = 1.0 / np.quantile(truth[truth > 0.0], 0.99)
    a, b = (np.clip(exposure * x, 0.0, 1.0) ** (1 / 2.2) for x in (image, truth))
    return float(-10.0 * np.log10(max(((a - b) ** 2).mean(), 1e-12)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--counts", type=int, nargs="*", default=[8, 16, 20, 32, 64])
    parser.add_argument("--planned", type=int, default=8)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: dict[object, list[list[float]]] = {}
    for i, file in enumerate(sorted(args.folder.glob("*.binary"))[:: args.every]):
        measured, name = dsbrdf.read(file), file.stem
        space = builtin(without=[name])
        space.process.at_support  # noqa: B018
        tested = valid(measured, *pairs(np.random.default_rng([i, 0]), 2 * N_TESTED), N_TESTED)
        wi, wo, truth = tested
        shown = sphere.shade(measured, N_PIXELS)
        sets = {}
        for n in args.counts:
            rng = np.random.default_rng([i, n])
            sets[n] = noisy(valid(measured, *pairs(rng, 4 * n + 50), n), rng, name)
        directions = dsbrdf.plan(args.planned, space=space).directions
        sets["planned"] = noisy(
            valid(measured, *directions, args.planned), np.random.default_rng([i, 1]), name
        )
        for key, samples in sets.items():
            start = time.process_time()
            found = dsbrdf.fit(samples, prior=space)
            seconds = time.process_time() - start
            plain = dsbrdf.fit(samples).model
            values = found.model.eval(wi, wo)
            low, high = found.band(wi, wo)
            nothing = unscaled(space.process.at(Positions.of_directions(wi, wo))[0])
            rows.setdefault(key, []).append(
                [
                    log_error(values, truth),
                    log_error(plain.eval(wi, wo), truth),
                    log_error(nothing, truth),
                    psnr(sphere.shade(found.model, N_PIXELS), shown),
                    psnr(sphere.shade(plain, N_PIXELS), shown),
                    float(((low <= truth) & (truth <= high)).mean()),
                    found.n_decided,
                    1000.0 * seconds,
                ]
            )
        print(
            f"{name:28s}",
            *(f"{key}: {of[-1][0]:.3f} / {of[-1][1]:.3f}" for key, of in rows.items()),
            flush=True,
        )
    print(
        "samples   log prior / plain / mean    ratio  nearer  worse by 5 %   PSNR prior / plain  covered  decided  ms"
    )
    for key, of in rows.items():
        prior, plain, mean, psnr_prior, psnr_plain, covered, decided, ms = np.array(of).T
        best = np.minimum(plain, mean)
        print(
            f"{key!s:8s}  {np.median(prior):.3f} / {np.median(plain):.3f} / {np.median(mean):.3f}  "
            f"{np.median(plain / prior):7.2f}  {(prior < plain).mean():6.0%}  {(prior > 1.05 * best).mean():8.0%}  "
            f"{np.median(psnr_prior):12.1f} / {np.median(psnr_plain):.1f}  {covered.mean():10.1%}  "
            f"{np.median(decided):6.1f}  {np.median(ms):.0f}"
        )


if __name__ == "__main__":
    main()
