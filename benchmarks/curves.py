"""What the paper's curves in place of slices cost, and which basis they want: the tables of docs/curves.md.

    python benchmarks/curves.py DIR [--every N] [--part PART]      DIR holds MERL `.binary` files

For three lobes, with and without the azimuthal term:

- `basis`: leave-one-out cross-validation of the smoothing of slices, over knots, degree, logarithm and variable;
- `slices`: relative RMS on the 18 slices of free slices and of smoothed ones, and the roughness of their parameters
  above 70 degrees.

Half an hour on 100 files and a busy core; `--every 10` takes every tenth.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.paper import ConvergenceWarning, CurveBasis, Curves, Slices, curves, fit_slices, metrics
from dsbrdf.paper.slices import roughness

N_LOBES = 3
KINDS = {"plain": False, "azimuthal": True}
#: The middle of a second difference over three slices lies above 70 degrees.
STEEP = np.deg2rad(65.0)
SMOOTHED = [CurveBasis(), CurveBasis(variable="cosine")]


def label(basis: CurveBasis) -> str:
    return f"{basis.variable}, degree {basis.degree}, {basis.n_knots} knots, {basis.size} coefficients"


def leave_one_out(design, values, weights):
    """What smoothing of all other slices says about each slice, (theta_d, channel, lobe)."""
    predicted = np.empty_like(values)
    for i in range(len(values)):
        others = np.arange(len(values)) != i
        predicted[i] = curves.smooth(design[others], values[others], weights[others]) @ design[i]
    return predicted


def basis_table(models) -> None:
    print("leave-one-out: median over materials of the error of a left-out slice")
    print(
        "(relative RMS: all slices, median / first and last aside, pooled; weighted RMS of ln kappa, ln(gamma + 0.1))"
    )
    bases = itertools.product((True, False), curves.VARIABLES, (1, 2, 3), (3, 4, 5, 6, 7))
    for logarithmic, variable, degree, n_knots in bases:
        basis = CurveBasis(n_knots, degree, variable=variable)
        found = np.array([cross_validate(*model, basis, logarithmic) for model in models])
        numbers = "  ".join(f"{x:7.3f}" for x in np.median(found, axis=0))
        print(f"  {'ln ' if logarithmic else 'raw'} {label(basis):50s} {numbers}", flush=True)


def cross_validate(model, profiles, basis, logarithmic):
    weights, design = curves.sensitivity(model), basis.design(model.theta_d)
    kappa, gamma = curves.variables(model.kappa, model.gamma, logarithmic)
    found = (leave_one_out(design, values, weights) for values in (kappa, gamma, model.beta))
    kappa, gamma, beta = curves.parameters(*found, logarithmic)
    # What is thrown far out is as wrong as wrong can be
    with np.errstate(over="ignore", invalid="ignore"):
        errors = metrics.fit_errors(profiles, kappa, gamma, beta)
        squares = np.nan_to_num(errors.squares, nan=1e300).sum(1)
        energy = errors.energy.sum(1)
        each = np.median(np.sqrt(squares / energy))
        pooled = np.sqrt(squares[1:-1].sum() / energy[1:-1].sum())
    share = (weights / weights.sum(-1, keepdims=True))[1:-1]
    off = (np.log(kappa / model.kappa), np.log((gamma + 0.1) / (model.gamma + 0.1)))
    return each, pooled, *(np.sqrt(np.average(x[1:-1] ** 2, weights=share)) for x in off)


def steep_roughness(theta_d, parameters):
    steep = theta_d > STEEP
    rough = roughness(Slices(theta_d[steep], *(values[steep] for values in parameters)))
    return rough.kappa, rough.gamma


def slices_table(models) -> None:
    rows: dict[str, list] = {}
    for model, profiles in models:
        theta_d = model.theta_d
        kinds = {"slices": (model.kappa, model.gamma, model.beta)}
        kinds |= {f"smoothed, {label(basis)}": Curves.of(model, basis).at(theta_d) for basis in SMOOTHED}
        for name, parameters in kinds.items():
            with np.errstate(over="ignore"):
                error = metrics.fit_errors(profiles, *parameters).rel_rms
            rows.setdefault(name, []).append((error, *steep_roughness(theta_d, parameters)))
    show(rows, "relative RMS on 18 slices; squared second differences of ln kappa, ln gamma above 70 degrees")


def show(rows, title) -> None:
    print(f"{title}; medians, and the median of ratios of the first")
    first = np.array(next(iter(rows.values())))[:, 0]
    for name, values in rows.items():
        found = np.array(values)
        numbers = "  ".join(f"{x:9.5f}" for x in np.median(found, axis=0))
        print(f"  {name:62s} {numbers}   x {np.median(found[:, 0] / first):.3f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--part", choices=("basis", "slices", "all"), default="all")
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="all")
    args = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    files = sorted(args.folder.glob("*.binary"))[:: args.every]
    for kind, azimuthal in KINDS.items():
        if args.kind not in (kind, "all"):
            continue
        fits = (fit_slices(dsbrdf.read(f), N_LOBES, azimuthal=azimuthal, spike=False) for f in files)
        models = [(fit.model, fit.profiles) for fit in fits]
        print(f"\n{len(files)} materials, K = {N_LOBES}, {kind}")
        if args.part in ("basis", "all"):
            basis_table(models)
        if args.part in ("slices", "all"):
            slices_table(models)


if __name__ == "__main__":
    main()
