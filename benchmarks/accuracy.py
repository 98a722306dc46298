"""How near the model and its peers are to tables, over the whole hemisphere, and with how many numbers.

    python benchmarks/accuracy.py DIR OUT [--every N]        DIR holds MERL `.binary` or RGL `.bsdf` files

Writes to OUT `accuracy.md`, a table of medians over materials and the worst, and `accuracy.png`, error against numbers.
rel, cbrt and log (`dsbrdf.fitting.metrics`, but log adds 1e-4/sr) are over pairs of directions uniform on both
hemispheres below 80 degrees; of an RGL file, against the measurement itself, in both orders, and not its table. The
error of the albedo is the largest at 5, 30, 60 and 75 degrees. A material takes about 10 s on two cores.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import dsbrdf
from dsbrdf import paper
from dsbrdf.baselines import fit_ggx_pair, fit_lambert_ggx
from dsbrdf.fitting import metrics
from dsbrdf.measured.formats.rgl import read_rgl

N_PAIRS = 20_000
LIMIT = np.deg2rad(80.0)
#: Reflectances, 1/sr, below which a pair is left out, and what is added before the logarithm.
LEAST, OFFSET = 1e-6, 1e-4

FITS: dict[str, Callable[[Any], Any]] = {
    "dsbrdf.fit": lambda measured: dsbrdf.fit(measured).model,
    "the same, compact": lambda measured: dsbrdf.fit(measured, curves="compact").model,
    "the paper's slices": lambda measured: paper.fit_slices(measured).model,
    "Lambert + GGX": fit_lambert_ggx,
    "Lambert + two GGX": fit_ggx_pair,
}
ERRORS = ("rel", "cbrt", "log", "albedo")


def pairs(n: int, limit: float = LIMIT) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directions (n, 3), uniform in solid angle within an angle of the normal."""
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(np.cos(limit), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    wi, wo = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)
    return wi, wo


def truth(path: Path, measured: Any, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Values (n, channel) of a file."""
    if path.suffix == ".bsdf":
        raw = read_rgl(path)
        return 0.5 * (np.asarray(raw.eval(wi, wo)) + np.asarray(raw.eval(wo, wi)))
    return np.asarray(measured.eval(wi, wo))


def errors(found: np.ndarray, f: np.ndarray, cos_product: np.ndarray) -> tuple[float, float, float]:
    """rel, cbrt and log of values (n, channel)."""
    good = np.isfinite(f).all(1) & (f > LEAST).all(1)
    found, f, root = found[good], f[good], np.cbrt(cos_product[good])[:, None]
    rel = np.sqrt(((found - f) ** 2).sum() / (f**2).sum())
    off = root * (np.cbrt(found) - np.cbrt(f))
    cbrt = np.sqrt((off**2).sum() / ((root * np.cbrt(f)) ** 2).sum())
    log = np.sqrt(np.mean(np.log((found + OFFSET) / (f + OFFSET)) ** 2))
    return float(rel), float(cbrt), float(log)


def draw(rows: dict[str, np.ndarray], path: Path) -> None:
    """Error against numbers: medians, and lines from the 10th to the 90th part of a hundred."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("cbrt", "log"), strict=True):
        for label, row in rows.items():
            error = row[:, 1 + ERRORS.index(name)]
            low, middle, high = np.quantile(error, (0.1, 0.5, 0.9))
            spread = [[middle - low], [high - middle]]
            axes.errorbar(np.median(row[:, 0]), middle, spread, fmt="o", capsize=3, label=label)
        axes.set(xscale="log", yscale="log", xlabel="numbers a material", ylabel=name)
    figure.legend(*axes.get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=len(rows))
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every so many files")
    args = parser.parse_args()
    files = sorted(p for p in args.folder.iterdir() if p.suffix in (".binary", ".bsdf"))[:: args.every]
    wi, wo = pairs(N_PAIRS)
    found: dict[str, list[list[float]]] = {label: [] for label in FITS}
    warnings.simplefilter("ignore")
    for path in files:
        measured = dsbrdf.read(path)
        f = truth(path, measured, wi, wo)
        for label, fit in FITS.items():
            model = fit(measured)
            three = errors(np.asarray(model.eval(wi, wo)), f, wi[:, 2] * wo[:, 2])
            found[label].append([model.n_parameters, *three, metrics.errors(model, measured).albedo])
        print(path.stem, " ".join(f"{found[label][-1][2]:.3f}" for label in FITS), flush=True)
    rows = {label: np.array(values) for label, values in found.items()}
    args.out.mkdir(parents=True, exist_ok=True)
    lines = [f"| {len(files)} files | numbers | rel | cbrt | log | albedo | worst cbrt |", "|---" * 7 + "|"]
    for label, row in rows.items():
        middle = " | ".join(f"{value:.3f}" for value in np.median(row[:, 1:], axis=0))
        lines.append(f"| {label} | {np.median(row[:, 0]):.0f} | {middle} | {row[:, 2].max():.3f} |")
    (args.out / "accuracy.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    draw(rows, args.out / "accuracy.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
