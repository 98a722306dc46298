"""How near the model and its peers are to tables, over the whole hemisphere, and with how many numbers.

    python benchmarks/accuracy.py OUT FILE... [--peers-every N] [--worst N]        MERL `.binary` or RGL `.bsdf` files

Writes to OUT `accuracy.md`, tables of medians and of each material; `accuracy.png`, error against numbers;
`lobes.png`, the lobes of the first file as slices fitted one by one and as one fit has them; `worst.png`, spheres of
the materials with the greatest errors. rel, cbrt and log (`dsbrdf.fitting.metrics`, but log adds 1e-4/sr) are over
pairs of directions uniform on both hemispheres below 80 degrees; of an RGL file, against the measurement itself, in
both orders, and not its table. The error of the albedo is the largest at 5, 30, 60 and 75 degrees. A material takes
about 4 s of one core, with peers 15 s.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import dsbrdf
from dsbrdf import paper, plot
from dsbrdf.baselines import fit_ggx_pair, fit_lambert_ggx
from dsbrdf.fitting import metrics
from dsbrdf.geometry import half_diff
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.render import comparison, picture
from dsbrdf.render.scene import View

N_PAIRS = 20_000
LIMIT = np.deg2rad(80.0)
#: Reflectances, 1/sr, below which a pair is left out, and what is added before the logarithm.
LEAST, OFFSET = 1e-6, 1e-4

FITS: dict[str, Callable[[Any], Any]] = {
    "dsbrdf.fit": lambda measured: dsbrdf.fit(measured).model,
    "the same, compact": lambda measured: dsbrdf.fit(measured, curves="compact").model,
    "the paper's slices": lambda measured: paper.fit_slices(measured).model,
}
PEERS: dict[str, Callable[[Any], Any]] = {
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


def draw(groups: dict[str, dict[str, np.ndarray]], path: Path) -> None:
    """Error against numbers: medians, and lines from the 10th to the 90th part of a hundred."""
    figure = Figure(figsize=(9.0, 0.6 + 3.4 * len(groups)), layout="constrained")
    for row, (title, rows) in zip(
        figure.subplots(len(groups), 2, squeeze=False), groups.items(), strict=True
    ):
        for axes, name in zip(row, ("cbrt", "log"), strict=True):
            for label, values in rows.items():
                low, middle, high = np.quantile(values[:, 1 + ERRORS.index(name)], (0.1, 0.5, 0.9))
                spread = [[middle - low], [high - middle]]
                axes.errorbar(np.median(values[:, 0]), middle, spread, fmt="o", capsize=3, label=label)
            axes.set(xscale="log", yscale="log", xlabel="numbers a material", ylabel=name, title=title)
    figure.legend(*axes.get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=len(rows))
    figure.savefig(path, dpi=110)


def draw_lobes(path: Path, out: Path) -> None:
    """Lobes of a material at theta_d = 30 degrees: slices, a channel at a time, beside one fit."""
    measured = dsbrdf.read(path)
    slices, model = paper.fit_slices(measured).model, dsbrdf.fit(measured).model
    theta_h = np.deg2rad(np.linspace(0.02, 60.0, 400))
    wi, wo = half_diff.to_directions(theta_h, np.deg2rad(30.0), np.pi / 2)
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    row = figure.subplots(1, 2, sharey=True)
    for axes, (title, found) in zip(row, {"slices": slices, "one fit": model}.items(), strict=True):
        for channel, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
            truth = np.asarray(measured.eval(wi, wo))[:, channel]
            axes.plot(np.rad2deg(theta_h), truth, color=colour, alpha=0.3, lw=5)
            for k in range(found.n_lobes):
                values = np.asarray(found.lobe(k).eval(wi, wo))[:, channel]
                axes.plot(np.rad2deg(theta_h), values, color=colour, lw=1)
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="theta_h, degrees",
            ylim=(1e-5 * truth.max(), 3.0 * truth.max()),
        )
        axes.set_title(f"{measured.name}: {title}, {found.n_parameters} numbers")
    row[0].set_ylabel("1/sr; wide: measured, thin: each lobe")
    figure.savefig(out, dpi=110)


def draw_worst(paths: list[Path], out: Path) -> None:
    """Spheres of tables and of their fits."""
    rows = []
    for path in paths:
        measured = dsbrdf.read(path)
        subjects = [
            comparison.Subject("measured", measured),
            *(comparison.Subject(label, FITS[label](measured)) for label in FITS),
        ]
        rows.append(comparison.render_row(path.stem, subjects, View("sphere", None, 160, 128)))
    plot.write_figure(picture.sheet(rows), out)


def medians(rows: dict[str, np.ndarray]) -> list[str]:
    """A table of medians."""
    lines = ["| | materials | numbers | rel | cbrt | log | albedo | worst cbrt |", "|---" * 8 + "|"]
    for label, row in rows.items():
        middle = " | ".join(f"{value:.3f}" for value in np.median(row[:, 1:], axis=0))
        lines.append(
            f"| {label} | {len(row)} | {np.median(row[:, 0]):.0f} | {middle} | {row[:, 2].max():.3f} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--peers-every", type=int, default=1, help="fit peers to every so many files")
    parser.add_argument("--worst", type=int, default=4, help="render so many of the worst")
    args = parser.parse_args()
    wi, wo = pairs(N_PAIRS)
    found: dict[Path, dict[str, list[float]]] = {}
    warnings.simplefilter("ignore")
    for number, path in enumerate(args.files):
        measured = dsbrdf.read(path)
        f = truth(path, measured, wi, wo)
        found[path] = {}
        for label, fit in (FITS if number % args.peers_every else FITS | PEERS).items():
            model = fit(measured)
            three = errors(np.asarray(model.eval(wi, wo)), f, wi[:, 2] * wo[:, 2])
            found[path][label] = [model.n_parameters, *three, metrics.errors(model, measured).albedo]
        print(path.stem, " ".join(f"{row[2]:.3f}" for row in found[path].values()), flush=True)
    groups = {}
    for title, suffix in (("real, RGL", ".bsdf"), ("NBRDF-decoded MERL", ".binary")):
        some = [rows for path, rows in found.items() if path.suffix == suffix]
        if some:
            with_peers = [rows for rows in some if set(PEERS) <= set(rows)]
            groups[title] = {label: np.array([rows[label] for rows in some]) for label in FITS}
            groups[title] |= {
                label: np.array([rows[label] for rows in with_peers]) for label in PEERS if with_peers
            }
    args.out.mkdir(parents=True, exist_ok=True)
    lines = []
    for title, rows in groups.items():
        lines += [f"## {title}", "", *medians(rows), ""]
    first, second = "dsbrdf.fit", "the paper's slices"
    lines += [f"## Each material: {second}, and {first}", ""]
    lines += [
        "| | slices: rel / cbrt / log | fit: rel / cbrt / log | numbers | albedo: slices, fit |",
        "|---" * 5 + "|",
    ]
    ordered = sorted(found, key=lambda path: (path.suffix == ".binary", -found[path][first][2]))
    for path in ordered:
        slices, fit = found[path][second], found[path][first]
        three = (" / ".join(f"{value:.3f}" for value in row[1:4]) for row in (slices, fit))
        lines.append(f"| {path.stem} | {' | '.join(three)} | {fit[0]:.0f} | {slices[4]:.3f}, {fit[4]:.3f} |")
    (args.out / "accuracy.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    draw(groups, args.out / "accuracy.png")
    draw_lobes(args.files[0], args.out / "lobes.png")
    draw_worst(sorted(found, key=lambda path: -found[path][first][2])[: args.worst], args.out / "worst.png")


if __name__ == "__main__":
    main()
