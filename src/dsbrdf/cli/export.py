"""`dsbrdf export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dsbrdf.cli._app import app, check_output, say
from dsbrdf.export import FORMATS

HELP = "\n\n".join(f"{name}: {entry.description}." for name, entry in FORMATS.items())


@app.command(help=f"Write a model as a file for another program.\n\n{HELP}")
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A file that fit or demo wrote.")],
    to: Annotated[
        str, typer.Option("--to", "-t", metavar="FORMAT", help="What to write.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Beside the model, with the format's ending, by default."
        ),
    ] = None,
) -> None:
    """Parse, call, print."""
    from dsbrdf.export import export as write
    from dsbrdf.model import file as model_file

    if to not in FORMATS:
        raise typer.BadParameter(f"expected one of {', '.join(FORMATS)}, got {to!r}.", param_hint="'--to'")
    path = model.with_suffix("." + FORMATS[to].suffix) if out is None else out
    check_output(path, [model])
    lost = write(model_file.load(model), path, to)
    print(f"Written: {path}")
    if lost:
        say(lost)
