"""The report: claims beside numbers, figures, and where the rest is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dsbrdf import _files, _text
from dsbrdf.paper.claims import Claim, Status
from dsbrdf.paper.subsampling import Curve
from dsbrdf.paper.survey import Row, markdown, median
from dsbrdf.paper.tables import Tables

__all__ = ["CAPTIONS", "summary", "write_report", "write_table"]

#: Of the figures, by the stem of their file.
CAPTIONS = {
    "fig1": "Profiles of (a) von Mises-Fisher and (b) hemi-EPD distributions. One kappa a colour; in (b) three "
    "gamma for each. Shaded: below the horizon, where a von Mises-Fisher distribution has mass too.",
    "fig2": "Three lobes fitted to the slice theta_d = 0 (error: relative RMS of the slice): (a) all channels, "
    "spikes within a degree cut off; (b) the lobes of the brightest, logarithmic.",
    "fig3": "Three lobes fitted to slices at theta_d of about 10, 40 and 70 degrees of two materials.",
    "fig5": "Relative RMS error of every material, sorted, with the number of lobes from Williams' test.",
    "fig4": "Spheres, measured and with one to five lobes; below, maps of CIEDE2000 from the measured one.",
    "spheres": "Fig. 5: spheres with the lobes that Williams' test chooses, and measured; numbers: mean CIEDE2000.",
    "fig7": "Spheres: measured, Lambert with two Torrance-Sparrow lobes, the same in the form of today's renderers "
    "(GGX, with Fresnel terms), three lobes, and each of these alone.",
    "fig8": "Spheres, profiles at theta_d = 0 and lobes of one material with three lobes.",
    "fig9": "Lobes of all materials on the first two bivariate principal functions of their curves, as spheres.",
    "fig10": "Materials on the first two principal functions of all their curves, as spheres.",
    "fig6": "Relative RMS error over all samples against the factor by which theta_h was subsampled: the model "
    "with lobes chosen on what is left (solid), linear interpolation of means over phi_d (dashed). Each point is "
    "a mean over up to four first samples. Noise is in the fitted samples only.",
}
_INTRODUCTION = (
    "Claims of Nishino and Lombardi (JOSA A 28(1), 8-18, 2011) beside our numbers. Errors are relative RMS over "
    "all samples of 18 slices with theta_h of at least one degree, inside the perimeter mask. The paper's model "
    "has no azimuthal term and lobes in the order of kappa; its lobes are counted by Williams' test at 1 %. "
    "`dsbrdf.fit` is fitted to the whole hemisphere, by logarithms, and so is Lambert + 2 GGX where the error is that "
    "of the cube root (cbrt) there; elsewhere that is fitted to the slices by least squares, as the paper's models are."
)


def summary(rows: Sequence[Row]) -> str:
    """Medians and quartiles of the errors."""
    import numpy as np

    names = {
        "rel_rms": "the paper's model, lobes chosen",
        "with_term": "the same with the azimuthal term",
        "em": "the paper's model by EM alone",
        "torrance_sparrow": "Lambert + 2 Torrance-Sparrow, 15 numbers",
        "ggx_pair": "Lambert + 2 GGX with Fresnel terms, 13 numbers",
        "fit": "`dsbrdf.fit`, fitted to the whole hemisphere",
        "bivariate_floor": "bivariate floor",
        "monotone_floor": "monotone floor",
        "azimuthal_floor": "azimuthal floor",
        "cbrt": "cube root, whole hemisphere: the paper's model",
        "ggx_pair_cbrt": "cube root, whole hemisphere: Lambert + 2 GGX, fitted to it",
        "fit_cbrt": "cube root, whole hemisphere: `dsbrdf.fit`",
    }
    lines = [
        "| error | median | lower quartile | upper quartile | largest |",
        "|---|---|---|---|---|",
    ]
    for key, name in names.items():
        values = [getattr(row, key) for row in rows]
        low, middle, high = np.percentile(values, [25, 50, 75])
        lines.append(f"| {name} | {middle:.4f} | {low:.4f} | {high:.4f} | {max(values):.4f} |")
    counts = ", ".join(
        f"{sum(row.n_lobes == k for row in rows)} with {k}" for k in sorted({row.n_lobes for row in rows})
    )
    lines += [
        "",
        f"{len(rows)} materials by lobes: {counts}. Choice and fit take {median(rows, 'seconds'):.2f} s in",
    ]
    lines[-1] += f" the median, {sum(row.seconds for row in rows):.0f} s in all."
    return "\n".join(lines) + "\n"


def claim_table(claims: Sequence[Claim]) -> str:
    """Every claim with its status."""
    lines = ["| where | claim | status | here |", "|---|---|---|---|"]
    for claim in claims:
        told, why = (_text.markdown_cell(text) for text in (claim.ours, claim.why))
        ours = f"{told}. *{why[0].upper()}{why[1:]}.*" if why else f"{told}."
        lines.append(f"| {claim.where} | {claim.claim} | **{claim.status}** | {ours} |")
    return "\n".join(lines) + "\n"


def curve_table(curves: Sequence[Curve]) -> str:
    """Errors of Fig. 6."""
    factors = curves[0].factors
    lines = [f"| material | noise | | {' | '.join(map(str, factors))} |", "|---" * (3 + len(factors)) + "|"]
    for curve in curves:
        for name, values in (("model", curve.model), ("interpolation", curve.interpolation)):
            cells = " | ".join(f"{value:.3f}" for value in values)
            lines.append(
                f"| {_text.markdown_cell(curve.name)} | {100 * curve.noise:g} % | {name} | {cells} |"
            )
    return "\n".join(lines) + "\n"


def write_table(rows: Sequence[Row], path: Path, title: str) -> None:
    """All rows in Markdown."""
    with _files.aside(path) as part:
        part.write_text(
            f"# All materials: {_text.markdown_cell(title)}\n\nErrors are relative RMS.\n\n{markdown(rows)}",
            encoding="utf-8",
        )


def write_report(
    path: Path,
    tables: Tables,
    rows: Sequence[Row],
    curves: Sequence[Curve],
    claims: Sequence[Claim],
    figures: Sequence[Path],
) -> None:
    """The report of everything."""
    tally = ", ".join(f"{sum(claim.status is status for claim in claims)} {status}" for status in Status)
    parts = [f"# The paper's claims: {_text.markdown_cell(tables.title)}", _INTRODUCTION]
    parts += ["## Claims", f"{len(claims)} claims: {tally}.", claim_table(claims)]
    parts += ["## Errors", summary(rows), "All materials: [table.md](table.md), [table.csv](table.csv)."]
    parts += ["## Figures"]
    parts += [f"![{figure.stem}]({figure.name})\n\n*{CAPTIONS[figure.stem]}*" for figure in figures]
    parts += ["## Errors of Fig. 6", curve_table(curves)]
    if tables.skipped:
        parts += ["## Files left out", "\n".join(f"- {_text.markdown_cell(line)}" for line in tables.skipped)]
    with _files.aside(path) as part:
        part.write_text("\n\n".join(text.rstrip() for text in parts) + "\n", encoding="utf-8")
