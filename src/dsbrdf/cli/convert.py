"""`dsbrdf convert`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dsbrdf.cli._app import Force, State, app, check_output, note, say, tell
from dsbrdf.cli._reading import takes_reading

if TYPE_CHECKING:
    from dsbrdf.export.convert import Conversion


#: Share of valid entries below which a table is of little use.
SPARSE = 0.1


class Kind(StrEnum):
    """Formats that can be written."""

    merl = "merl"
    rgl = "rgl"
    npz = "npz"
    csv = "csv"
    tsv = "tsv"
    bird = "bird"


@app.command()
@takes_reading
def convert(
    context: typer.Context,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help="A measured file of any format, a model file, a folder of either, a built-in material, or - for text "
            "from standard input.",
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write; a folder if IN is one.")],
    kind: Annotated[
        Kind | None, typer.Option("--to", "-t", help="Format of OUT, if its suffix does not tell.")
    ] = None,
    force: Force = False,
    *,
    reading: Any,
) -> None:
    """Convert measured files to another format; print what it loses."""
    from dsbrdf import _files, batch
    from dsbrdf.cli import _report as report
    from dsbrdf.export.convert import KINDS
    from dsbrdf.export.convert import convert as convert_file
    from dsbrdf.measured.formats.nbrdf import npy_set

    state: State = context.obj
    inside = _inside(source) if source.is_dir() else []
    if not inside or (len(inside) == 1 and npy_set(source) is not None):
        check_output(target, [source], force=force)
        with report.progress(1) as step:
            step(source.name)
            done = convert_file(source, target, kind, **reading)
        _tell(done)
        return
    if kind is None:
        raise typer.BadParameter("a folder needs a format: add -t FORMAT.", param_hint="'--to'")
    failed = 0
    for file in inside:
        name = file.stem.removesuffix("_fc1")
        try:
            out = target / f"{name}{KINDS[kind]}"
            _files.check_replaceable(out, force=force, sources=[file])
            state.begin(str(file))
            _tell(convert_file(file, out, kind, **reading))
        except (OSError, ValueError, ImportError) as error:
            if state.debug:
                raise
            say(f"error: {batch.describe(error)}")
            failed += 1
    if failed:
        raise typer.Exit(1)


def _tell(done: Conversion) -> None:
    tell(done)
    if done.coverage < SPARSE:
        note(f"warning: {done.path} is nearly empty. Fit what was measured, and convert the model.")


def _inside(folder: Path) -> list[Path]:
    """The measured files of a folder, or else its model files."""
    from dsbrdf import batch
    from dsbrdf.model import file as model_file

    models = model_file.models_in(folder)
    measured, failures = batch.expand([folder])
    if failures and not models:
        raise ValueError(f"{folder}: no measured file and no model file (.json) in this folder.")
    return list(map(Path, measured)) or models
