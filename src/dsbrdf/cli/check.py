"""`dsbrdf check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import app, say


@app.command()
def check(
    models: Annotated[list[Path], typer.Argument(metavar="MODEL", help="Files that fit or demo wrote.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print a line of JSON for each model.")] = False,
) -> None:
    """Check that models are fit to render with: reciprocity, energy, sampling."""
    from dsbrdf.cli import _report as report
    from dsbrdf.model import file as model_file
    from dsbrdf.model.check import check_model

    wrong = False
    for path in models:
        result = check_model(model_file.load(path))
        if as_json:
            print(report.json_line(result.summary() | {"model": str(path)}), flush=True)
        else:
            report.print_check(result)
        for problem in result.problems:
            say(f"{path}: {problem}")
        wrong |= not result.ok
    if wrong:
        raise typer.Exit(1)
