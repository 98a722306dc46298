"""`dsbrdf library` and its subcommands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dsbrdf.cli._app import Force, app, check_folder, check_output, tell

if TYPE_CHECKING:
    from dsbrdf.library import Library

library = typer.Typer(
    no_args_is_help=True, help="Materials that come with the package, and libraries of your own."
)
app.add_typer(library, name="library")

File = Annotated[
    Path | None,
    typer.Option(
        "--file", "-f", metavar="FILE", help="A library of your own.", show_default="the built-in one"
    ),
]


@library.command("list")
def list_names(path: File = None) -> None:
    """Print the names of the materials, a line each."""
    for name in _open(path).names:
        tell(name)


@library.command()
def show(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A material of the library.")], path: File = None
) -> None:
    """Print what a material is, and where it comes from."""
    from dsbrdf.cli.info import print_model

    opened = _open(path)
    model = opened.load(name)
    print_model(model)
    about = opened.sources.get(model.source.description, {})
    for key, text in about.items():
        tell(f"{key}: {text}")


@library.command()
def write(
    models: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL", help="Model files, or folders of them.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The library.")],
    force: Force = False,
) -> None:
    """Write models into one file, a library."""
    from dsbrdf import library as libraries
    from dsbrdf.model import file as model_file

    if out.suffix != libraries.SUFFIX:
        raise typer.BadParameter(f"a library is a {libraries.SUFFIX} file, got {out}.", param_hint="'--out'")
    files = [file for path in models for file in (model_file.models_in(path) if path.is_dir() else [path])]
    check_output(out, files, force=force)
    check_folder(out.parent)
    libraries.write(out, map(model_file.load, files))
    tell(f"{out}: {len(files)} materials")


def _open(path: Path | None) -> Library:
    from dsbrdf import library as libraries

    return libraries.builtin() if path is None else libraries.open(path)
