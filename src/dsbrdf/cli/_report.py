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

if TYPE_CHECKING:
    from dsbrdf.batch import Outcome
    from dsbrdf.cli._demo import DemoRow
    from dsbrdf.measured.databases import Database
    from dsbrdf.model.check import CheckReport
    from dsbrdf.model.dsbrdf import DSBRDF
    from dsbrdf.paper.selection import LobeSelection
    from dsbrdf.render.picture import Row
    from dsbrdf.space import MaterialSpace

__all__ = [
    "json_line",
    "print_check",
    "print_databases",
    "print_demo",
    "print_fits",
    "print_model",
    "print_nearest",
    "print_outcomes",
    "print_pictures",
    "print_space",
    "progress",
    "with_path",
]

#: What the columns of the tables of fits mean.
FLOORS = (
    "Errors are relative RMS in %. Floors, the least error possible: bivariate, of any function of "
    "(theta_h, theta_d); monotone, of one that falls with theta_h; azimuthal, with a cos(2 phi_d) term added."
)
#: Incident angles in degrees at which albedos are told.
ALBEDO_ANGLES = (0, 45, 75)
#: Columns of a table that goes to a file or a pipe.
PLAIN_WIDTH = 160


def _console() -> Console:
    """Writer to standard output; it takes text as it is, and wide lines where there is no terminal."""
    width = None if sys.stdout.isatty() else PLAIN_WIDTH
    return Console(width=width, markup=False, highlight=False, emoji=False)


def _table(*columns: str, gap: int = 2) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, gap - 1, 0, 0), pad_edge=False, show_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="right" if i else "left", overflow="fold")
    return table


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f}" if math.isfinite(value) else "-"


def _errors(numbers: Mapping[str, Any]) -> list[str]:
    keys = ("rel_rms", "bivariate_floor", "monotone_floor", "azimuthal_floor")
    return [_percent(numbers[key]) for key in keys]


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
    if not is_batch and outcomes and (selection := outcomes[0].selection) is not None:
        _console().print()
        _console().print(_selection(selection))


#: What each criterion of the choice of lobes is.
CRITERIA = {
    "williams": "ln(divergence)",
    "bic": "BIC",
    "held-out": "held-out error",
}


def _selection(selection: LobeSelection) -> Table:
    table = _table("lobes", CRITERIA[selection.criterion], "Williams", "critical", "verdict")
    table.columns[-1].justify = "left"
    numbers = zip(selection.values, selection.statistic, selection.critical, strict=True)
    for k, (value, statistic, critical) in enumerate(numbers, start=1):
        tested = [f"{x:.2f}" if math.isfinite(x) else "-" for x in (statistic, critical)]
        table.add_row(str(k), f"{value:.3f}", *tested, _verdict(selection, k, statistic > critical))
    return table


def _verdict(selection: LobeSelection, k: int, significant: bool) -> str:
    if selection.criterion != "williams":
        return "chosen: lowest" if k == selection.n_lobes else ""
    if significant:
        return f"loses against {selection.max_lobes}"
    if k == selection.n_lobes:
        lossless = "nothing less will do" if k == selection.max_lobes else "no significant loss"
        return f"chosen: {lossless}"
    return "more than needed" if k > selection.n_lobes else ""


def print_fits(summaries: Sequence[Mapping[str, Any]], written: str = "") -> None:
    """Print a table of fits, one line a `Fit.summary`, and what was written."""
    table = _table(
        "material",
        "lobes",
        "error\n%",
        "bivar.\nfloor",
        "monot.\nfloor",
        "azim.\nfloor",
        "log\nrms",
        "time\nms",
    )
    for row in summaries:
        rest = (f"{row['log_rms']:.3f}", f"{1e3 * row['seconds']:.0f}")
        table.add_row(row["name"], str(row["n_lobes"]), *_errors(row), *rest)
    _print_table(table, written, _remarks(summaries))


#: From this bivariate floor on, a material is named as one that is more than a function of two angles.
HIGH_FLOOR = 0.15


def _remarks(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    """What a table of fits does not say: where floors are high, and how far samples tell."""
    lines = []
    for row in summaries:
        floor, error = row["bivariate_floor"], row["rel_rms"]
        if math.isfinite(floor) and floor >= HIGH_FLOOR:
            # Below the bivariate floor only the azimuthal term leads
            least = floor if error >= floor else row["azimuthal_floor"]
            lines.append(
                f"{row['name']}: high bivariate floor, {_percent(floor)} %: it depends on more than theta_h and "
                f"theta_d. Of the {_percent(error)} % error, {100 * least / error:.0f} % no model of this kind can "
                "remove."
            )
        if "samples" in row:
            lines.append(_samples_remark(row))
    return lines


def _samples_remark(row: Mapping[str, Any]) -> str:
    left = ", ".join(f"{count} {reason}" for reason, count in row["left_out"].items())
    text = f"{row['name']}: {row['samples_used']} of {row['samples']} samples in {row['slices']} slices"
    text += f" (left out: {left})" if left else ""
    if row["slices_without_data"]:
        text += f", {row['slices_without_data']} of them without a sample and filled from others"
    held_out = row["held_out_log_rms"]
    if math.isfinite(held_out):
        text += (
            f". Samples held out are missed by a factor of {math.exp(held_out):.2f} (log rms {held_out:.3f}); "
            f"directions unlike those measured may be missed by more"
        )
    return f"{text}."


def _print_table(table: Table, written: str, remarks: Sequence[str] = ()) -> None:
    console = _console()
    console.print(table)
    console.print()
    console.print(FLOORS)
    for remark in remarks:
        console.print(remark)
    if written:
        console.print(f"Written: {written}", soft_wrap=True)


def print_demo(rows: Sequence[DemoRow], written: str) -> None:
    """Print a table of built-in materials, with albedos and the size of models against tables."""
    table = _table(
        "material", "lobes", "error\n%", "bivar.\nfloor", "monot.\nfloor", "azim.\nfloor",
        "albedo\n0 deg", "time\nms", "numbers\nkB", "table/\nnumbers", gap=1,
    )  # fmt: skip
    for row in rows:
        summary = row.fit.summary()
        table.add_row(
            summary["name"],
            str(summary["n_lobes"]),
            *_errors(summary),
            f"{row.albedo:.3f}",
            f"{1e3 * summary['seconds']:.0f}",
            f"{row.model_bytes / 1e3:.1f}",
            f"{row.table_bytes / row.model_bytes:,.0f}",
        )
    _print_table(table, written)


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


def print_model(model: DSBRDF) -> None:
    """Print what a model holds: where it comes from, its lobes and its albedos."""
    console = _console()
    parts: list[Any] = [_origin(model), _lobes(model), *_components(model), _albedos(model)]
    for i, part in enumerate(parts):
        if i:
            console.print()
        console.print(part)


def _origin(model: DSBRDF) -> Table:
    import numpy as np

    source = model.source.to_json()
    low, high = np.rad2deg(model.theta_d[[0, -1]])
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column()
    table.add_column(overflow="fold")
    table.add_row("name", model.name or "-")
    for label, key in (("file", "file"), ("SHA-256", "sha256"), ("description", "description")):
        if source.get(key):
            table.add_row(label, str(source[key]))
    table.add_row(
        "lobes", f"{model.n_lobes} in each of {model.n_channels} channels and {len(model.theta_d)} slices"
    )
    table.add_row("theta_d", f"{low:.1f} to {high:.1f} degrees")
    if model.fit_options:
        table.add_row("fit", ", ".join(_option(*item) for item in model.fit_options.items()))
    for key, value in model.errors.items():
        number = isinstance(value, int | float)
        table.add_row(key.replace("_", " "), f"{_percent(value)} %" if number else str(value))
    return table


def _option(name: str, value: Any) -> str:
    if name == "min_theta_h" and isinstance(value, int | float):
        return f"{name} {math.degrees(value):g} degrees"
    return f"{name} {'yes' if value is True else 'no' if value is False else value}"


def _lobes(model: DSBRDF) -> Table:
    table = _table(
        "lobe", *(f"{symbol}{end}" for symbol in ("kappa", "gamma", "beta") for end in (" from", " to"))
    )
    for k in range(model.n_lobes):
        parts = [getattr(model, symbol)[..., k] for symbol in ("kappa", "gamma", "beta")]
        table.add_row(str(k), *(f"{x:.4g}" for part in parts for x in (part.min(), part.max())))
    return table


def _components(model: DSBRDF) -> list[Table]:
    """What each lobe is, and why it is called that."""
    import numpy as np

    from dsbrdf.model.components import components

    colours = "colour" if model.n_channels == 3 else "colour (channels)"
    table = _table(
        "lobe", "kind", "share\n0 deg %", "share\n45 deg %", "half width\ndegrees", colours, "because"
    )
    for column in (table.columns[1], table.columns[-1]):
        column.justify = "left"
    for part in components(model):
        table.add_row(
            "delta" if part.lobe is None else str(part.lobe),
            part.label,
            f"{100 * part.share:.1f}",
            f"{100 * part.share_oblique:.1f}",
            f"{np.rad2deg(part.half_width):.2f}",
            " ".join(f"{value:.2f}" for value in part.colour),
            part.reason,
        )
    return [table]


def _albedos(model: DSBRDF) -> Table:
    import numpy as np

    return _albedo_table(np.deg2rad(ALBEDO_ANGLES), model.albedo(np.deg2rad(ALBEDO_ANGLES)))


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
    if not (shown and total > 1 and sys.stderr.isatty()):
        yield lambda _: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}", markup=False))
    # Standard output may be going elsewhere: leave it alone
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task, done = bar.add_task("", total=total), itertools.count()
        yield lambda about: bar.update(task, description=about, completed=next(done))
