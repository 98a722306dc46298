"""`dsbrdf info`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import app


@app.command()
def info(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A file that fit or demo wrote.")],
) -> None:
    """Print what a model file holds."""
    from dsbrdf.fitting import report
    from dsbrdf.model import file as model_file

    report.print_model(model_file.load(model))
