"""`dsbrdf plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import State, app, check_folder, check_output, missing_plots, tell
from dsbrdf.cli._reading import takes_reading


@app.command()
@takes_reading
def plan(
    context: typer.Context,
    samples: Annotated[int, typer.Option("--samples", "-n", min=1, help="Pairs of directions.")] = 8,
    known: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Samples that were measured already.", show_default=False),
    ] = None,
    in_plane: Annotated[
        bool, typer.Option("--in-plane", help="Only in the plane of the light and the normal.")
    ] = False,
    theta_max: Annotated[
        float, typer.Option(help="Largest angle from the normal that can be reached, degrees.")
    ] = 75.0,
    least_angle: Annotated[float, typer.Option(help="Least angle between light and viewer, degrees.")] = 0.0,
    space: Annotated[
        str,
        typer.Option(
            "--space",
            "-s",
            metavar="library|SPACE",
            help="What materials are like: those of the built-in library, or of a file of 'dsbrdf space build'.",
        ),
    ] = "library",
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="A .csv to fill in; 'dsbrdf fit' reads it.")
    ] = Path("plan.csv"),
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also draw the directions, a .png.", show_default=False),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files, also a plan that was filled in.")
    ] = False,
    *,
    reading: Any,
) -> None:
    """Propose where to measure next, given what materials are like."""
    from dsbrdf.cli import _report as report
    from dsbrdf.fitting.plan import plan as find
    from dsbrdf.measured import Samples, read
    from dsbrdf.space import builtin, load_space

    for path in (out, picture):
        if path is not None:
            check_output(path, [known] if known else [], force=force or path == out)
            check_folder(path.parent)
    if out.exists() and not force:
        raise typer.BadParameter(
            f"{out} is there already, and may have been filled in. Give another name, or add --force.",
            param_hint="'--out'",
        )
    if picture is not None and (missing := missing_plots()):
        raise ModuleNotFoundError(missing)
    state: State = context.obj
    state.begin("" if known is None else str(known))
    measured = None if known is None else read(known, **reading)
    if measured is not None and not isinstance(measured, Samples):
        raise typer.BadParameter(
            f"{known} holds a table: there is nothing left to plan.", param_hint="'--known'"
        )
    with report.progress(1) as step:
        step("planning")
        found = find(
            samples,
            known=measured,
            space=builtin() if space == "library" else load_space(space),
            in_plane=in_plane,
            theta_max=theta_max,
            least_angle=least_angle,
        )
    found.save(out)
    report.print_plan(found)
    tell(out)
    if picture is not None:
        from dsbrdf import plot
        from dsbrdf.plot.plan import plan_figure

        plot.write_figure(plan_figure(found), picture)
        tell(picture)
