"""`dsbrdf export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import Force, State, app, check_output, note, tell
from dsbrdf.cli._reading import takes_reading
from dsbrdf.export import FORMATS

HELP = "\n\n".join(f"{name}: {entry.description}." for name, entry in FORMATS.items())


@app.command(help=f"Write a material as a file for another program.\n\n{HELP}")
@takes_reading
def export(
    context: typer.Context,
    material: Annotated[
        str,
        typer.Argument(
            metavar="MODEL|FILE|NAME",
            help="A model file, a name of the library, or what is fitted first: a measured file, a built-in material.",
            show_default=False,
        ),
    ],
    to: Annotated[
        str, typer.Option("--to", "-t", metavar="FORMAT", help="What to write.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Beside the model, with the format's ending, by default."
        ),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(
            metavar="A[,B,C]", help="Channels to take: one is shown grey, three as red, green, blue."
        ),
    ] = None,
    force: Force = False,
    *,
    reading: Any,
) -> None:
    """Parse, call, print."""
    from dsbrdf.cli._open import open_models
    from dsbrdf.export import export as write

    if to not in FORMATS:
        raise typer.BadParameter(f"expected one of {', '.join(FORMATS)}, got {to!r}.", param_hint="'--to'")
    source = Path(material)
    path = source.with_name(f"{source.stem}.{FORMATS[to].suffix}") if out is None else out
    check_output(path, [source], force=force)
    state: State = context.obj
    for _, model in open_models([material], state, reading):
        chosen = None if channels is None else channels.split(",")
        lost = write(model, path, to, channels=chosen, force=force)
    tell(f"Written: {path}")
    if lost:
        note(lost)
