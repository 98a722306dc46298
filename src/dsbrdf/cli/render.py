"""`dsbrdf render`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import Force, State, app, check_folder, check_output, missing_plots, tell


class Loss(StrEnum):
    """Losses of a fit."""

    log = "log"
    gamma = "gamma"
    l2 = "l2"


@app.command()
def render(
    context: typer.Context,
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL|FILE|NAME",
            help="Model files, measured files, or names of the library or of built-in materials; each is a row.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="A .png sheet, or linear pictures in one .exr; default: NAME.png.",
        ),
    ] = None,
    lobes: Annotated[
        bool, typer.Option("--lobes", help="Also fits with fewer lobes, and each lobe alone.")
    ] = False,
    compare: Annotated[
        bool, typer.Option("--compare", help="Also other models of measured materials.")
    ] = False,
    envmap: Annotated[
        Path | None, typer.Option(metavar="HDR", help="Environment map, instead of our own lighting.")
    ] = None,
    shape: Annotated[
        str, typer.Option(metavar="sphere|MESH", help="What to render: a sphere, or a .ply or .obj file.")
    ] = "sphere",
    spp: Annotated[int, typer.Option(min=1, help="Samples a pixel; with 256 noise is hardly seen.")] = 256,
    size: Annotated[int, typer.Option(min=1, max=8192, help="Pixels along a side of each picture.")] = 256,
    loss: Annotated[Loss, typer.Option(help="Of the fits, as in 'dsbrdf fit'.")] = Loss.log,
    force: Force = False,
) -> None:
    """Render materials: measured, fitted, by lobe, beside other models; with maps of the difference."""
    from dsbrdf.cli import _report as report
    from dsbrdf.render import comparison, picture
    from dsbrdf.render.scene import View

    path = out or Path(f"{Path(what[0]).stem}.png")
    if path.suffix.lower() not in (".png", ".exr"):
        raise typer.BadParameter(
            f"expected a name that ends in .png or .exr, got '{path}'.", param_hint="'--out'"
        )
    if path.suffix.lower() == ".png" and (missing := missing_plots()):
        raise ModuleNotFoundError(missing)
    check_output(path, [*what, *([envmap] if envmap else [])], force=force)
    check_folder(path.parent)
    view = View(shape, envmap, size, spp)
    state: State = context.obj
    subjects = []
    with report.progress(len(what)) as step:
        begin = state.announce(step)
        for target in what:
            begin(target)
            subjects.append(comparison.open_subjects(target, loss=loss.value, lobes=lobes, compare=compare))
    state.begin("")
    with report.progress(sum(len(row) for _, row in subjects)) as step:
        rows = [comparison.render_row(title, row, view, state.announce(step)) for title, row in subjects]
    if path.suffix.lower() == ".exr":
        picture.write_exr(rows, path)
    else:
        from dsbrdf import plot

        plot.write_figure(picture.sheet(rows), path)
    report.print_pictures(rows)
    tell(path)
