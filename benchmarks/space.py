"""Numbers of spaces: variance, components, glossiness, reconstruction, time, and whether what is made is valid.

python benchmarks/space.py FOLDER [--checked N]

FOLDER holds MERL .binary files. "paper" models have as many lobes as Williams' test accepts, by least squares; "log"
models have three, by the logarithmic loss over the whole table. Takes three minutes for 100 files.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

import dsbrdf
from dsbrdf.model.check import check_model
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.space import build_space, lobe_fpca
from dsbrdf.space.correspondence import gamma_norm

FITS = {
    "paper": {"azimuthal": False},
    "log": {"n_lobes": 3, "loss": "log", "azimuthal": False, "perimeter_mask": False, "min_theta_h": 0.0},
    "log, beta": {"n_lobes": 3, "loss": "log", "perimeter_mask": False, "min_theta_h": 0.0},
}
N_COMPONENTS = 22


def half_width(kappa, gamma):
    """Median over theta_d of the theta_h at which a lobe is at half its height, radians; kappa (theta_d, ...)."""
    at_half = np.log1p(0.5 * np.expm1(kappa)) / kappa
    return np.median(np.arccos(at_half ** (1.0 / np.maximum(gamma, 1e-3))), axis=0)


def glossiness(space, models):
    """Spearman correlation of the first bivariate score of lobes with minus their width at half height."""
    fpca, lobes = lobe_fpca(space)
    widths = []
    for model in models:
        settings = space.settings
        order = np.argsort(
            gamma_norm(settings.variables.smooth(model, settings.basis), settings.basis), axis=1
        )
        widths.append(np.take_along_axis(half_width(model.kappa, model.gamma), order, axis=1))
    first = space.present.argmax(2)
    width = [widths[m][c, slot - first[m, c]] for m, c, slot in lobes]
    return spearmanr(fpca.scores[:, 0], -np.array(width)).statistic, fpca.explained[:2].sum()


def reconstruction(space, models, n):
    """Median relative and logarithmic RMS of materials from `n` components of the space of the others."""
    theta_h = np.pi / 2 * (np.arange(1, 90, 2) / 90.0) ** 2
    theta_d, phi_d = np.deg2rad(np.arange(2, 88, 5)), np.deg2rad([15, 45, 75])
    theta_h, theta_d, phi_d = np.meshgrid(theta_h, theta_d, phi_d, indexing="ij")
    inside = theta_h + theta_d < np.pi / 2
    angles = theta_h[inside], theta_d[inside], phi_d[inside]
    rows = []
    for name, model in zip(space.names, models, strict=True):
        rest = space.without(name)
        again = rest.model(rest.scores(model)[:n], conserve=False)
        f, g = model.replace(spike=None).eval_angles(*angles), again.eval_angles(*angles)
        log = np.log((g + LOG_OFFSET) / (f + LOG_OFFSET))
        rows.append((((g - f) ** 2).sum() / (f**2).sum(), (log**2).mean()))
    return np.median(np.sqrt(rows), axis=0)


def check(space, models, n):
    """Share of blends, moves and draws that pass `dsbrdf check`."""
    rng = np.random.default_rng(0)
    made = space.sample(n, rng)
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
    parser.add_argument("--checked", type=int, default=20)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    tables = [dsbrdf.read(file) for file in sorted(args.folder.glob("*.binary"))]
    print(
        "first two: share of the variance; 90/95/99 %: components; Spearman and two: of the bivariate analysis;"
    )
    print(f"rel, log: error of reconstruction from {N_COMPONENTS} components, left out one at a time")
    print(
        "models       variables  lobes    slots  first two  90/95/99 %   Spearman      two           rel    log"
    )
    for kind, options in FITS.items():
        models = [dsbrdf.fit(table, **options).model for table in tables]
        for logarithmic in (False, True):
            for correspondence in ("border", "rank"):
                start = time.perf_counter()
                space = build_space(
                    models, logarithmic=logarithmic, correspondence=correspondence, azimuthal="beta" in kind
                )
                fpca = space.fpca
                seconds = time.perf_counter() - start
                counts = "/".join(str(fpca.n_components(share)) for share in (0.9, 0.95, 0.99))
                correlation, two = glossiness(space, models)
                relative, log = reconstruction(space, models, N_COMPONENTS)
                print(
                    f"{kind:12s} {'log' if logarithmic else 'raw':10s} {correspondence:8s} {space.n_slots:4d} "
                    f"{fpca.explained[:2].sum():10.1%}  {counts:12s} {correlation:10.3f} {two:10.1%} "
                    f"{relative:14.3f} {log:6.3f}   built in {seconds:.2f} s",
                    flush=True,
                )
        if kind == "log":
            share, n = check(space, models, args.checked)
            print(f"{share:.0%} of {n} draws, blends and moves of the last pass dsbrdf check")


if __name__ == "__main__":
    main()
