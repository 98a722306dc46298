"""What curves in place of slices cost, and which basis they want: the tables of docs/curves.md.

    python benchmarks/curves.py DIR [--every N] [--part PART]      DIR holds MERL `.binary` files

For three lobes, with and without the azimuthal term:

- `basis`: leave-one-out cross-validation of the smoothing of slices, over knots, degree, logarithm and variable;
- `slices`: relative RMS on the 18 slices of free slices, of smoothed ones and of curves fitted directly, and the
  roughness of their parameters above 70 degrees;
- `table`: relative RMS on all rows of the table, of slices whose values are blended and of curves fitted to all rows.

An hour on 100 files and a busy core; `--every 10` takes every tenth.
"""

from __future__ import annotations

import argparse
import itertools
import time
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf import DSBRDF
from dsbrdf.fitting.fit_splines import fit_curves
from dsbrdf.model.components import roughness
from dsbrdf.paper import curves, metrics
from dsbrdf.paper.collapse import stack_profiles
from dsbrdf.paper.curves import CurveBasis, Curves
from dsbrdf.paper.fit_measured import fit_profiles

N_LOBES = 3
KINDS = {"plain": False, "azimuthal": True}
#: The middle of a second difference over three slices lies above 70 degrees.
STEEP = np.deg2rad(65.0)
DIRECT = [
    *(CurveBasis(n) for n in (4, 5, 6, 7, 9)),
    *(CurveBasis(n, variable="cosine") for n in (4, 5, 6)),
]
TABLE = [CurveBasis(), CurveBasis(7), CurveBasis(variable="cosine")]


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
    rough = roughness(DSBRDF(theta_d[steep], *(values[steep] for values in parameters)))
    return rough.kappa, rough.gamma


def slices_table(models) -> None:
    rows: dict[str, list] = {}
    for model, profiles in models:
        theta_d = model.theta_d
        free = (model.kappa, model.gamma, model.beta)

        def note(name, parameters, seconds=0.0, theta_d=theta_d, profiles=profiles):
            with np.errstate(over="ignore"):
                error = metrics.fit_errors(profiles, *parameters).rel_rms
            rows.setdefault(name, []).append((error, *steep_roughness(theta_d, parameters), seconds))

        note("slices", free)
        note("smoothed, " + label(CurveBasis()), Curves.of(model).at(theta_d))
        for basis in DIRECT:
            start = time.perf_counter()
            fitted, _ = fit_curves(profiles, model, basis)
            note("direct, " + label(basis), fitted.at(theta_d), time.perf_counter() - start)
    show(
        rows,
        "relative RMS on 18 slices; squared second differences of ln kappa, ln gamma above 70 degrees; s",
    )


def table_table(models, whole) -> None:
    rows: dict[str, list] = {}
    for (model, profiles), all_rows in zip(models, whole, strict=True):
        theta_d = stack_profiles(all_rows)[0]
        rows.setdefault("18 slices, values blended", []).append(blended_error(model, all_rows))
        free, _ = fit_profiles(all_rows, N_LOBES, azimuthal=bool(model.beta.any()))
        rows.setdefault("90 slices", []).append(metrics.fit_errors(all_rows, *free).rel_rms)
        for basis, (where, fitted_to) in itertools.product(TABLE, {"18": profiles, "90": all_rows}.items()):
            fitted, _ = fit_curves(fitted_to, model, basis)
            error = metrics.fit_errors(all_rows, *fitted.at(theta_d)).rel_rms
            rows.setdefault(f"direct to {where} rows, {label(basis)}", []).append(error)
    show({name: [(x,) for x in values] for name, values in rows.items()}, "relative RMS on all 90 rows")


def blended_error(model, profiles) -> float:
    """Relative RMS of a model of slices on all rows, values between slices blended."""
    theta_d, theta_h, moments = stack_profiles(profiles)
    n, f, ff, c, cc, fc = np.moveaxis(moments, -1, 0)
    looked_at = np.where(n.any(1), theta_h, np.pi / 2)
    low = np.clip(np.searchsorted(model.theta_d, theta_d, side="right") - 1, 0, len(model.theta_d) - 2)
    step = model.theta_d[low + 1] - model.theta_d[low]
    weight = np.clip((theta_d - model.theta_d[low]) / step, 0.0, 1.0)[:, None, None]
    # At slices the factor of the row itself: it belongs to the direction, not to the slice
    (a0, b0), (a1, b1) = (
        metrics.profile_model(looked_at, theta_d, model.kappa[i], model.gamma[i], model.beta[i])
        for i in (low, low + 1)
    )
    a, b = (1.0 - weight) * a0 + weight * a1, (1.0 - weight) * b0 + weight * b1
    squares = ff - 2 * a * f - 2 * b * fc + n * a**2 + 2 * a * b * c + cc * b**2
    return float(np.sqrt(squares.sum() / ff.sum()))


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
    parser.add_argument("--part", choices=("basis", "slices", "table", "all"), default="all")
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="all")
    args = parser.parse_args()
    warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
    files = sorted(args.folder.glob("*.binary"))[:: args.every]
    measured = [dsbrdf.read(file) for file in files]
    whole = [dsbrdf.slice_profiles(table, n_slices=len(table.theta_d)) for table in measured]
    for kind, azimuthal in KINDS.items():
        if args.kind not in (kind, "all"):
            continue
        fits = (dsbrdf.fit(table, N_LOBES, azimuthal=azimuthal, spike=False) for table in measured)
        models = [(fit.model, fit.profiles) for fit in fits]
        print(f"\n{len(files)} materials, K = {N_LOBES}, {kind}")
        if args.part in ("basis", "all"):
            basis_table(models)
        if args.part in ("slices", "all"):
            slices_table(models)
        if args.part in ("table", "all"):
            table_table(models, whole)


if __name__ == "__main__":
    main()
