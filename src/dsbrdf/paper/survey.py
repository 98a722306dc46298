"""Numbers of every material: lobes, errors, floors, competitors, time."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from dsbrdf import _files, _text
from dsbrdf.baselines import fit_ggx_pair
from dsbrdf.fitting import ConvergenceWarning, metrics
from dsbrdf.fitting.fit import fit
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper import baselines
from dsbrdf.paper.tables import Tables, paper_fit

__all__ = ["Row", "Shapes", "compare_shapes", "markdown", "measure", "median", "survey", "write_csv"]

#: Materials on which lobes of two shapes are compared, and their numbers of lobes.
N_SAMPLE, SAMPLE_LOBES = 12, (1, 2, 3)


@dataclass(frozen=True)
class Row:
    """Numbers of one material; errors are relative RMS over the samples of the slices, but for those called cbrt.

    Parameters
    ----------
    name : str
    n_lobes : int
        By Williams' test.
    rel_rms, with_term, em : float
        The paper's model, the same with the azimuthal term, and the paper's by EM alone.
    bivariate_floor, monotone_floor, azimuthal_floor : float
    torrance_sparrow, ggx_pair : float
        Lambert and two Torrance-Sparrow lobes, as the paper has them, and in the form of today's renderers, with
        Fresnel terms.
    fit : float
        The model of `dsbrdf.fit`, fitted to the whole hemisphere.
    cbrt, ggx_pair_cbrt, fit_cbrt : float
        Error of the cube root over the whole hemisphere (`dsbrdf.fitting.metrics`), of the paper's model, of Lambert
        with two GGX lobes fitted to the whole hemisphere (`dsbrdf.baselines.fit_ggx_pair`), and of the model of
        `dsbrdf.fit`.
    unconverged : int
        Slices of the paper's model that ran out of iterations.
    seconds : float
        Choice of lobes and fit of the paper's model.
    """

    name: str
    n_lobes: int
    rel_rms: float
    with_term: float
    bivariate_floor: float
    monotone_floor: float
    azimuthal_floor: float
    torrance_sparrow: float
    ggx_pair: float
    fit: float
    em: float
    cbrt: float
    ggx_pair_cbrt: float
    fit_cbrt: float
    unconverged: int
    seconds: float


def measure(measured: MeasuredBRDF, name: str) -> Row:
    """Numbers of one material."""
    paper = paper_fit(measured)
    n_lobes, errors = paper.model.n_lobes, paper.errors
    other = baselines.fit_lambert_torrance_sparrow(measured)
    pair = baselines.fit_ggx_pair(measured)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        new = fit(measured)
    return Row(
        name=name,
        n_lobes=n_lobes,
        rel_rms=errors.rel_rms,
        with_term=paper_fit(measured, n_lobes, azimuthal=True).errors.rel_rms,
        bivariate_floor=errors.bivariate_floor,
        monotone_floor=errors.monotone_floor,
        azimuthal_floor=errors.azimuthal_floor,
        torrance_sparrow=baselines.errors(other, measured).rel_rms,
        ggx_pair=baselines.errors(pair, measured).rel_rms,
        fit=baselines.errors(new.model, measured).rel_rms,
        em=paper_fit(measured, n_lobes, method="em").errors.rel_rms,
        cbrt=metrics.errors(paper.model, measured).cbrt,
        ggx_pair_cbrt=metrics.errors(fit_ggx_pair(measured), measured).cbrt,
        fit_cbrt=new.errors.cbrt,
        unconverged=sum(not report.status.ok for report in paper.slices),
        seconds=paper.seconds,
    )


def survey(tables: Tables, progress: Callable[[str], None]) -> list[Row]:
    """Numbers of all materials."""
    rows = []
    for name in tables.names:
        progress(name)
        rows.append(measure(tables.load(name), name))
    return rows


def median(rows: Sequence[Row], key: str) -> float:
    """Median of a column."""
    return float(np.median([getattr(row, key) for row in rows]))


@dataclass(frozen=True)
class Shapes:
    """Relative RMS (material, number of lobes) of von Mises-Fisher and of hemi-EPD lobes on a sample.

    Parameters
    ----------
    names : sequence of str
    n_lobes : sequence of int
    von_mises_fisher, hemi_epd, floor : list
        The floor has no column of lobes.
    """

    names: Sequence[str]
    n_lobes: Sequence[int]
    von_mises_fisher: list[list[float]]
    hemi_epd: list[list[float]]
    floor: list[float]


def compare_shapes(
    tables: Tables,
    progress: Callable[[str], None],
    *,
    n: int = N_SAMPLE,
    n_lobes: Sequence[int] = SAMPLE_LOBES,
) -> Shapes:
    """Fit both shapes of lobes to an even sample of the materials."""
    result = Shapes(tables.sample(n), n_lobes, [], [], [])
    for name in result.names:
        progress(f"{name}, von Mises-Fisher")
        measured = tables.load(name)
        others = [baselines.fit_von_mises_fisher(measured, k) for k in n_lobes]
        fits = [paper_fit(measured, k) for k in n_lobes]
        result.von_mises_fisher.append([baselines.errors(other, measured).rel_rms for other in others])
        result.hemi_epd.append([each.errors.rel_rms for each in fits])
        result.floor.append(fits[0].errors.bivariate_floor)
    return result


_HEADINGS = {
    "name": "material",
    "n_lobes": "lobes",
    "rel_rms": "paper's model",
    "with_term": "with azimuthal term",
    "bivariate_floor": "bivariate floor",
    "monotone_floor": "monotone floor",
    "azimuthal_floor": "azimuthal floor",
    "torrance_sparrow": "Lambert + 2 Torrance-Sparrow",
    "ggx_pair": "Lambert + 2 GGX",
    "fit": "dsbrdf.fit",
    "em": "by EM alone",
    "cbrt": "paper's model, cbrt",
    "ggx_pair_cbrt": "Lambert + 2 GGX, cbrt",
    "fit_cbrt": "dsbrdf.fit, cbrt",
    "unconverged": "slices out of iterations",
    "seconds": "seconds",
}


def markdown(rows: Sequence[Row]) -> str:
    """All rows as a table, their medians first."""
    names = [field.name for field in fields(Row)]
    lines = [f"| {' | '.join(_HEADINGS[name] for name in names)} |", "|---" * len(names) + "|"]
    medians = {name: median(rows, name) for name in names[1:]}
    named = ({**asdict(row), "name": _text.markdown_cell(row.name)} for row in rows)
    for values in ({"name": "**median**", **medians}, *named):
        cells = [values["name"], *(_cell(name, values[name]) for name in names[1:])]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cell(name: str, value: float) -> str:
    if name in ("n_lobes", "unconverged"):
        return f"{value:g}"
    return f"{value:.2f}" if name == "seconds" else f"{value:.4f}"


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """All rows, one column a field."""
    with _files.aside(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows({**asdict(row), "name": _text.csv_cell(row.name)} for row in rows)
