"""`dsbrdf demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import State, app, check_folder, missing_plots, say


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
    """Fit the built-in materials; write models and plots."""
    from dsbrdf.cli import _demo as demonstration
    from dsbrdf.fitting import report
    from dsbrdf.measured import built_in

    check_folder(out)
    missing = missing_plots()
    if missing:
        say(f"note: no plots: {missing}")
    state: State = context.obj
    with report.progress(len(built_in.names()) + (not missing)) as step:
        rows = demonstration.run(out, plots=not missing, step=state.announce(step))
    written = "models" if missing else f"models and plots (all materials: {demonstration.OVERVIEW})"
    report.print_demo(rows, f"{written} in {out}")
    if view:
        from dsbrdf.view import collect

        typer.echo(f"Page: {collect.view_files([row.path for row in rows], out)}")
