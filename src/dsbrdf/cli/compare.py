"""`dsbrdf compare`."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import State, app, check_folder, missing_plots, note, say
from dsbrdf.cli._reading import takes_reading
from dsbrdf.cli._workers import processes


@app.command()
@takes_reading
def compare(
    context: typer.Context,
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="Measured files, folders of them, or names of built-in materials.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Write compare.csv, compare.md and compare.png.",
            show_default=False,
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Methods to fit: some of standard,compact,slices,ggx,fresnel,ggx-pair,bivariate; all by default.",
            show_default=False,
        ),
    ] = None,
    neural: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Weights of neural BRDFs, named like the materials (NAME.h5, or NAME_fc1.npy ...): judged, not "
            "fitted.",
            show_default=False,
        ),
    ] = None,
    add: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Models of your own, named like the materials: NAME.json, or NAME.binary of any model.",
            show_default=False,
        ),
    ] = None,
    worst: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="Write also worst.png: spheres of the N materials with the greatest cbrt by the first method.",
        ),
    ] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Fit also what is there already; replace files of others.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Fit in N processes, by default in this one.", show_default=False
        ),
    ] = None,
    *,
    reading: Any,
) -> None:
    """Compare this model with others on measured files, by five figures of merit."""
    from dsbrdf import batch, comparison
    from dsbrdf.cli import _report as report

    if worst and (out is None or missing_plots()):
        raise typer.BadParameter(missing_plots() or "needs a folder: add -o DIR.", param_hint="'--worst'")
    if out is not None:
        check_folder(out)
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    state: State = context.obj
    with report.progress(len(batch.expand(files)[0])) as step:
        step("")
        found = comparison.compare(
            files,
            out,
            methods=names,
            neural=neural,
            add={path.name or str(path): path for path in add or ()},
            reading=reading,
            executor=None if workers is None else functools.partial(processes, workers),
            worst=worst,
            force=force,
            done=state.announce(step),
        )
    state.begin("")
    report.print_comparison(found, out)
    if out is not None and (missing := missing_plots()):
        note(f"no compare.png: {missing}")
    for row in found.failures:
        where = f"{row.file}, {row.method}: " if row.method else f"{row.file}: "
        say(f"error: {row.status if row.status.startswith(where) else where + row.status}")
    if found.failures:
        raise typer.Exit(1)
