"""`dsbrdf paper`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import State, app, check_folder, tell


@app.command(name="paper")
def paper_figures(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="WHAT", help="all, fig1 to fig10, spheres (of fig5) or table.")
    ] = "all",
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of MERL .binary files, not the built-in materials."),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for figures, tables and report.")
    ] = Path("dsbrdf-paper"),
) -> None:
    """Make the figures of Nishino and Lombardi (2011), and put their claims beside our numbers."""
    from dsbrdf import paper
    from dsbrdf.cli import _report as report

    check_folder(out)
    state: State = context.obj
    with report.progress(paper.n_steps(what, data)) as step:
        for path in paper.run(what, data, out, state.announce(step)):
            tell(path)
