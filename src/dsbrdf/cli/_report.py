"""What the command line shows: tables of fits and models, lines of JSON, progress."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from dsbrdf import _text

if TYPE_CHECKING:
    from dsbrdf.batch import Outcome
    from dsbrdf.comparison import Comparison
    from dsbrdf.fitting.plan import Plan
    from dsbrdf.measured.databases import Database
    from dsbrdf.model.check import CheckReport
    from dsbrdf.render.picture import Row
    from dsbrdf.space import MaterialSpace

__all__ = [
    "json_line",
    "print_check",
    "print_comparison",
    "print_databases",
    "print_fits",
    "print_nearest",
    "print_outcomes",
    "print_pictures",
    "print_plan",
    "print_space",
    "progress",
    "with_path",
]

#: Columns of errors of the tables of fits: head, key of the summary, and what it means.
ERRORS = (
    ("rel", "rel", "rel: relative RMS over directions"),
    ("cbrt", "cbrt", "cbrt: the same of the cube root of f cos cos"),
    ("log", "log", "log: RMS of the logarithm over entries"),
    ("albedo", "albedo", "albedo: largest relative error, 5 to 75 degrees"),
    ("floor", "bivariate_floor", "floor: no function of (theta_h, theta_d) has a lower rel"),
)
#: What the columns of a comparison mean.
MERIT = (
    "Medians over materials, against the measurement, 80 degrees about the normal; the least cbrt first. rel: relative "
    "RMS over directions; cbrt: the same of the cube root of f cos cos; log: RMS of the logarithm; albedo: largest "
    "relative error, 5 to 75 degrees; CIEDE2000: mean colour difference of a sphere."
)
HEADS = tuple(head for head, _, _ in ERRORS)
#: Columns of a table that goes to a file or a pipe.
PLAIN_WIDTH = 160


def _console() -> Console:
    """Writer to standard output; it takes text as it is, and wide lines where there is no terminal."""
    width = None if sys.stdout.isatty() else PLAIN_WIDTH
    return _Console(width=width, markup=False, highlight=False, emoji=False)


class _Console(Console):
    """One that shows what would drive a terminal."""

    def print(self, *parts: Any, **options: Any) -> None:
        super().print(*(_printable(part) for part in parts), **options)


class _Table(Table):
    """The same in cells and heads."""

    def add_column(self, header: Any = "", *rest: Any, **options: Any) -> None:
        super().add_column(_printable(header), *rest, **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        super().add_row(*(_printable(cell) for cell in cells), **options)


def _printable(part: Any) -> Any:
    from dsbrdf.cli._app import called

    return _text.shown(called(part), keep="\n") if isinstance(part, str) else part


def _table(*columns: str, gap: int = 2) -> Table:
    table: Table = _Table(box=SIMPLE_HEAD, padding=(0, gap - 1, 0, 0), pad_edge=False, show_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="right" if i else "left", overflow="fold")
    return table


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f}" if math.isfinite(value) else "-"


def _number(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, int | float) and math.isfinite(value) else "-"


def with_path(outcome: Outcome) -> dict[str, Any]:
    """The summary of a fit and where its model is."""
    return {**(outcome.summary or {}), "model": None if outcome.path is None else str(outcome.path)}


def print_outcomes(outcomes: Sequence[Outcome], out: Path | None = None, *, is_batch: bool = False) -> None:
    """Print a table of fits, where their models are and, of a single one, why it has so many lobes."""
    written = "" if out is None else f"models in {out}"
    if written and is_batch:
        from dsbrdf.batch import TABLES

        written += f", tables {' and '.join(TABLES)}"
        if kept := sum(outcome.kept for outcome in outcomes):
            written += f"; {kept} of {len(outcomes)} kept from an earlier run, --force fits them again"
    print_fits([outcome.summary for outcome in outcomes if outcome.summary is not None], written)
    if not is_batch and outcomes and (criteria := (outcomes[0].summary or {}).get("criteria")):
        _console().print()
        _console().print(_choice(criteria))


def _choice(criteria: Sequence[float]) -> Table:
    """Why there are so many lobes."""
    table = _table("lobes", "BIC", "")
    table.columns[-1].justify = "left"
    least = min(criteria)
    for k, value in enumerate(criteria, start=1):
        if math.isinf(value):
            table.add_row(str(k), "-", "more numbers than so few values tell")
        else:
            table.add_row(str(k), f"{value:.0f}", "chosen: lowest" if value == least else "")
    return table


def print_fits(summaries: Sequence[Mapping[str, Any]], written: str = "") -> None:
    """Print a table of fits, one line a `Fit.summary`, and what was written."""
    errors = [column for column in ERRORS if any(_number(row.get(column[1])) != "-" for row in summaries)]
    remarks = [_remarks(row) for row in summaries]
    # Of many materials each note is told once, and has a number
    numbers = {text: str(i) for i, text in enumerate(dict.fromkeys(itertools.chain(*remarks)), 1)}
    with_notes = len(summaries) > 1 and bool(numbers)
    heads = [head for head, _, _ in errors]
    table = _table("material", "lobes", "numbers", *heads, "time\nms", *(["notes"] if with_notes else []))
    for row, about in zip(summaries, remarks, strict=True):
        table.add_row(
            row["name"],
            str(row["n_lobes"]),
            str(row["n_parameters"]),
            *(_number(row.get(key)) for _, key, _ in errors),
            f"{1e3 * row['seconds']:.0f}",
            *([" ".join(numbers[text] for text in about)] if with_notes else []),
        )
    console = _console()
    console.print(table)
    console.print()
    if errors:
        meanings = "; ".join(meaning for _, _, meaning in errors)
        console.print(f"Errors over all that was measured, the whole hemisphere. {meanings}.")
    for text, number in numbers.items():
        console.print(f"{number if with_notes else summaries[0]['name']}: {text}.")
    if written:
        console.print(f"Written: {written}", soft_wrap=True)


def _remarks(row: Mapping[str, Any]) -> list[str]:
    """What a line of a table of fits does not say: channels other than r, g, b, what was read of samples, what is
    not covered.
    """
    channels = list(row.get("channels", ()))
    lines = []
    if "remarks" in row or channels not in (["r", "g", "b"], []):
        shown = ", ".join(channels[:8]) + (f", ... {len(channels)} in all" if len(channels) > 8 else "")
        lines.append(f"channels {shown}")
    lines += row.get("remarks", ())
    return [*lines, row["coverage"]] if row.get("coverage") else lines


def print_pictures(rows: Sequence[Row]) -> None:
    """Print how the pictures differ from the first of their row, if some were compared."""
    table = _table("material", "picture", "CIEDE2000\nmean", "99th\npercentile", "SSIM")
    table.columns[1].justify = "left"
    for row in rows:
        for tile in row.tiles:
            if (found := tile.difference) is not None:
                numbers = (f"{found.mean:.2f}", f"{found.worst:.2f}", f"{found.ssim:.4f}")
                table.add_row(row.title, tile.title, *numbers)
    if table.row_count:
        _console().print(table)


def _albedo_table(theta_i: Any, albedo: Any) -> Table:
    names: Sequence[str] = ("red", "green", "blue")
    if albedo.shape[1] != len(names):
        names = [f"channel {i}" for i in range(albedo.shape[1])]
    table = _table("albedo at", *names)
    for theta, values in zip(theta_i, albedo, strict=True):
        table.add_row(f"{math.degrees(theta):.0f} degrees", *(f"{value:.3f}" for value in values))
    return table


def print_check(result: CheckReport) -> None:
    """Print the numbers of a check of a model."""
    albedos = _albedo_table(result.theta_i, result.albedo)
    sampler = _table("sampler at", "chi-square\np-value", "weight\nstd", "cosine\nstd")
    for theta, *row in zip(result.theta_o, result.p_value, result.weight_std, result.cosine_std, strict=True):
        sampler.add_row(f"{math.degrees(theta):.0f} degrees", *(f"{value:.2f}" for value in row))
    console = _console()
    for part in (albedos, "", sampler, ""):
        console.print(part)
    console.print(
        f"Exchanged directions differ by {result.reciprocity:g}; the least value is {result.minimum:.3g}/sr."
    )


def print_databases(databases: Sequence[Database], here: Mapping[str, Sequence[Path]]) -> None:
    """Print what can be fetched, under which licence, and how much of it is here."""
    table = _table("database", "what", "licence", "here", "page")
    for column in table.columns:
        column.justify = "left"
    for of in databases:
        count = f"{len(here[of.name])} of {len(of.names)}" if of.names else str(len(here[of.name]))
        table.add_row(of.name, of.title, of.licence, count, of.page)
    _console().print(table)


def print_space(space: MaterialSpace, written: Path) -> None:
    """Print what a space holds and where it was written."""
    explained = space.fpca.explained
    table = _table("variance", "components")
    for share in (0.9, 0.95, 0.99):
        table.add_row(f"{share:.0%}", str(space.fpca.n_components(share)))
    console = _console()
    console.print(f"{space!r} in {written}")
    console.print(f"first two components: {explained[:2].sum():.1%} of the variance")
    console.print(table)


def print_nearest(nearest: Sequence[tuple[str, float]]) -> None:
    """Print names of materials and their distances."""
    table = _table("material", "distance")
    for name, distance in nearest:
        table.add_row(name, f"{distance:.3f}")
    _console().print(table)


def print_comparison(found: Comparison, out: Path | None) -> None:
    """Print medians of methods, and what was written."""
    table = _table("method", "materials", "numbers", "seconds", *HEADS[:4], "CIEDE\n2000", "worst\ncbrt")
    for s in found.standings:
        seconds = f"{s.seconds:.2f}" if math.isfinite(s.seconds) else "-"
        numbers = f"{s.n_parameters:.0f}" if math.isfinite(s.n_parameters) else "-"
        errors = map(_number, (s.rel, s.cbrt, s.log, s.albedo, s.ciede2000, s.worst))
        table.add_row(s.method, str(s.n_materials), numbers, seconds, *errors)
    console = _console()
    console.print(table)
    console.print()
    console.print(MERIT)
    if not found.is_even:
        console.print("Not all methods have the same materials: their medians are not of the same.")
    if out is not None:
        from dsbrdf.comparison import FILES

        names = [name for name in FILES if (out / name).exists()]
        console.print(f"Written: {', '.join(names)} in {out}", soft_wrap=True)


def json_line(summary: Mapping[str, Any]) -> str:
    """One line of JSON, with null for what is not a number."""
    return json.dumps({key: _finite(value) for key, value in summary.items()})


def _finite(value: Any) -> Any:
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextlib.contextmanager
def progress(total: int, *, shown: bool = True) -> Iterator[Callable[[str], None]]:
    """Function that announces each of `total` pieces of work, on standard error if that is a terminal."""
    from dsbrdf.cli._app import is_quiet, is_verbose, trace

    if is_verbose() or not (shown and total and sys.stderr.isatty()) or is_quiet():
        yield lambda about: trace(about) if about else None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn

    about = TextColumn("{task.description}", markup=False)
    columns = (BarColumn(), MofNCompleteColumn(), about) if total > 1 else (SpinnerColumn(), about)
    # Standard output may be going elsewhere: leave it alone
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task, done = bar.add_task("", total=total), itertools.count()
        yield lambda about: bar.update(task, description=_text.shown(about), completed=next(done))


def print_plan(found: Plan) -> None:
    """Print the pairs of a plan, and how uncertain reflectance is after each."""
    table = _table("pair", "theta_i\ndegrees", "theta_o\ndegrees", "phi_o\ndegrees", "deviation\nof ln f")
    table.add_row("", "", "", "", f"{found.deviation[0]:.2f}")
    rows = zip(found.theta_i, found.theta_o, found.phi_o, found.deviation[1:], strict=True)
    for i, (theta_i, theta_o, phi_o, deviation) in enumerate(rows, 1):
        table.add_row(str(i), f"{theta_i:g}", f"{theta_o:g}", f"{phi_o:g}", f"{deviation:.2f}")
    _console().print(table)
