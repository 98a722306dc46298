"""`dsbrdf check`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from dsbrdf.cli._app import State, app, say
from dsbrdf.cli._reading import takes_reading


@app.command()
@takes_reading
def check(
    context: typer.Context,
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL|FILE|NAME",
            help="Model files, names of the library, or what is fitted first: measured files, built-in materials, or "
            "- for text from standard input.",
            show_default=False,
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print a line of JSON for each model.")] = False,
    *,
    reading: Any,
) -> None:
    """Check that models are fit to render with: reciprocity, energy, sampling."""
    from dsbrdf.cli import _report as report
    from dsbrdf.cli._open import open_models
    from dsbrdf.model.check import check_model

    wrong = False
    state: State = context.obj
    for path, model in open_models(models, state, reading):
        result = check_model(model)
        if as_json:
            print(report.json_line(result.summary() | {"model": path}), flush=True)
        else:
            report.print_check(result)
        for problem in result.problems:
            say(f"{path}: {problem}")
        wrong |= not result.ok
    if wrong:
        raise typer.Exit(1)
