"""What a prior is worth: errors on a whole table from few noisy samples of it, by four methods.

python benchmarks/prior.py FOLDER [--left-out N] [--draw directions|cells] [--azimuthal]

FOLDER holds MERL .binary files. All are fitted with three lobes by the logarithmic loss over the whole table; every
material that is asked for is left out of the space in turn. Samples are cells of its table, drawn either as pairs of
directions that are uniform over the hemisphere, or uniformly among cells, which are denser near the peak; noise is
normal and relative. Errors are over all valid cells of every third theta_d and sixth phi_d: RMS of the logarithm
(`dsbrdf.paper.metrics.log_rms`), there and within the masks of a fit, and relative RMS. Ten minutes for 100 files and
20 left out.
"""

from __future__ import annotations

import argparse
import dataclasses
import warnings
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

import dsbrdf
from dsbrdf import half_diff
from dsbrdf.baselines import fit_lambert_ggx
from dsbrdf.measured import Samples
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.space import build_space

COUNTS, NOISE = (5, 20, 100, 500), (0.02, 0.1)
FITTED = {"n_lobes": 3, "loss": "log", "perimeter_mask": False, "min_theta_h": 0.0}
METHODS = ("prior", "plain fit", "interpolation", "Lambert + GGX")


def draw_cells(measured, n, rng, how):
    """Indices (3, n) of valid cells with both directions above the horizon."""
    drawn = []
    while len(drawn) < n:
        if how == "directions":
            w = rng.normal(size=(2, 3))
            w[:, 2] = np.abs(w[:, 2])
            h, d, phi = half_diff.from_directions(*(w / np.linalg.norm(w, axis=1, keepdims=True)))
            i = int(min(np.sqrt(h / (np.pi / 2)) * 90, 89))
            cell = (i, int(min(d / (np.pi / 2) * 90, 89)), int(phi % np.pi / np.pi * 180) % 180)
        else:
            cell = tuple(rng.integers(measured.planes.shape[1:]))
        wi, wo = half_diff.to_directions(*angles_of(measured, cell))
        if (measured.planes[:, *cell] >= 0.0).all() and min(wi[2], wo[2]) > 0.0:
            drawn.append(cell)
    return np.array(drawn).T


def angles_of(measured, cell):
    return measured.theta_h[cell[0]], measured.theta_d[cell[1]], measured.phi_d[cell[2]]


def interpolate(theta_h, theta_d, values):
    """Linear in (sqrt theta_h, theta_d) between samples, the nearest one's value outside."""
    points = np.stack([np.sqrt(theta_h), theta_d], axis=-1)
    nearest, linear = NearestNDInterpolator(points, values), LinearNDInterpolator(points, values)

    def at(h, d, phi):
        h, d, _ = np.broadcast_arrays(h, d, phi)
        inside = linear(np.sqrt(h[..., 0]), d[..., 0])
        value = np.where(np.isfinite(inside), inside, nearest(np.sqrt(h[..., 0]), d[..., 0]))
        return np.broadcast_to(value[:, :, None], (*h.shape, values.shape[1]))

    return at


def errors(measured, eval_angles):
    """RMS of the logarithm, the same within the masks of a fit, relative RMS."""
    rows, phis = slice(None, None, 3), slice(None, None, 6)
    h, d = measured.theta_h[:, None, None], measured.theta_d[rows][:, None]
    f = np.moveaxis(measured._channel_first(rows)[..., phis], 0, -1)
    valid = np.isfinite(f)
    model = np.where(valid, eval_angles(h, d, measured.phi_d[phis]), 0.0)
    f = np.where(valid, f, 0.0)
    log = np.log((model + LOG_OFFSET) / (f + LOG_OFFSET)) ** 2
    inside = valid & ((h >= np.deg2rad(1.0)) & (h < np.pi / 2 - d))[..., None]
    relative = ((model - f) ** 2).sum() / (f**2).sum()
    return np.sqrt([log[valid].mean(), log[inside].mean(), relative])


def compare(measured, space, n, noise, rng, how):
    """Errors (method, 3) from `n` samples."""
    cell = draw_cells(measured, n, rng, how)
    exact = measured.planes[:, *cell].T * measured.scale
    values = np.maximum(exact * (1.0 + noise * rng.standard_normal(exact.shape)), 0.0)
    theta_h, theta_d, phi_d = angles_of(measured, cell)
    samples = Samples(measured.name, *half_diff.to_directions(theta_h, theta_d, phi_d), values)
    planes = np.full_like(measured.planes, -1.0)
    planes[:, *cell] = values.T / measured.scale[:, None]
    table = dataclasses.replace(measured, planes=planes)
    masks = {"min_theta_h": 0.0, "perimeter_mask": False}
    found = [
        dsbrdf.fit(samples, prior=space, **masks).model.eval_angles,
        dsbrdf.fit(samples, loss="log", **masks).model.eval_angles,
        interpolate(theta_h, theta_d, values),
        fit_lambert_ggx(table, n_slices=90, **masks).eval_angles,
    ]
    return [errors(measured, eval_angles) for eval_angles in found]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--left-out", type=int, default=20)
    parser.add_argument("--draw", choices=("directions", "cells"), default="directions")
    parser.add_argument("--azimuthal", action="store_true", help="take beta into the space")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    files = sorted(args.folder.glob("*.binary"))
    models = [dsbrdf.fit(dsbrdf.read(f), azimuthal=args.azimuthal, **FITTED).model for f in files]
    space = build_space(models, azimuthal=args.azimuthal)
    step = len(files) // args.left_out
    chosen = files[step // 2 :: step][: args.left_out]
    results = {(n, noise): [] for n in COUNTS for noise in NOISE}
    for i, file in enumerate(chosen):
        measured, rest = dsbrdf.read(file), space.without(file.stem)
        for n, noise in results:
            rng = np.random.default_rng([i, n, int(1000 * noise)])
            results[n, noise].append(compare(measured, rest, n, noise, rng, args.draw))
    print(f"{space}; {len(chosen)} left out in turn; cells drawn by {args.draw}; medians")
    names = ("log RMS", "log RMS in masks", "relative RMS")
    for k, name in enumerate(names):
        print(f"\n{name:17s} " + " ".join(f"{method:>14s}" for method in METHODS))
        for (n, noise), rows in results.items():
            medians = np.median(np.array(rows)[:, :, k], axis=0)
            print(
                f"{n:4d} at {noise:4.0%}      " + " ".join(f"{value:14.3f}" for value in medians), flush=True
            )


if __name__ == "__main__":
    main()
