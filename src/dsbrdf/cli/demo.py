"""`dsbrdf demo`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dsbrdf.cli._app import State, app, check_folder, missing_plots, note, tell

if TYPE_CHECKING:
    from dsbrdf.cli._demo import DemoRow

#: What the columns are.
ABOUT = (
    "Errors over the whole hemisphere: relative (rel), of the cube root (cbrt), of the logarithm (log), and of the "
    "albedo; floor: the least rel of any function of (theta_h, theta_d). Numbers: those of the model, and how many of "
    "the table stand behind each."
)
ERRORS = ("rel", "cbrt", "log", "albedo", "bivariate_floor")


@app.command()
def demo(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for models and plots.")
    ] = Path("dsbrdf-demo"),
    view: Annotated[
        bool, typer.Option("--view", help="Write a web page that shows the models, too.")
    ] = False,
) -> None:
    """Fit synthetic materials, formulas in place of measurements; write models and plots."""
    from dsbrdf.cli import _demo as demonstration
    from dsbrdf.cli import _report as report

    check_folder(out)
    missing = missing_plots()
    if missing:
        note(f"no plots: {missing}")
    state: State = context.obj
    with report.progress(len(demonstration.MATERIALS) + (not missing)) as step:
        rows = demonstration.run(out, plots=not missing, step=state.announce(step))
    written = "models" if missing else f"models and plots (all materials: {demonstration.OVERVIEW})"
    _print_rows(rows, f"{written} in {out}")
    if view:
        from dsbrdf.view import collect

        tell(f"Page: {collect.view_files([row.path for row in rows], out)}")


def _print_rows(rows: Sequence[DemoRow], written: str) -> None:
    """A line a material: errors, albedo, and the size of the model against that of the table."""
    from dsbrdf.cli._demo import MATERIALS
    from dsbrdf.cli._report import _console, _table

    table = _table(
        "material", "lobes", "rel", "cbrt", "log", "albedo\nerror", "floor", "albedo\n0 deg", "time\nms",
        "numbers", "table/\nnumbers",
    )  # fmt: skip
    for row in rows:
        summary, model = row.fit.summary(), row.fit.model
        table.add_row(
            summary["name"],
            str(model.n_lobes),
            *(f"{summary[key]:.3f}" for key in ERRORS),
            f"{row.albedo:.3f}",
            f"{1e3 * summary['seconds']:.0f}",
            str(model.n_parameters),
            f"{row.n_table / model.n_parameters:,.0f}",
        )
    console = _console()
    console.print(table)
    console.print()
    for row in rows:
        if row.fit.model.name in MATERIALS:
            console.print(f"{row.fit.model.name}: {MATERIALS[row.fit.model.name]}")
    console.print()
    console.print(ABOUT)
    console.print(f"Written: {written}", soft_wrap=True)
