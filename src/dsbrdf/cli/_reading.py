"""Options of the commands that read measured files: what a file does not say, as `dsbrdf.read` takes it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import STANDARD_INPUT, standard_input

__all__ = ["takes_reading"]

#: Parameters of commands that name what is read.
TARGETS = ("files", "models", "model", "source")

_OPTIONS: dict[str, tuple[Any, Any]] = {
    "columns": (
        Annotated[
            str | None,
            typer.Option(
                "--columns",
                metavar="NAMES",
                help="Names of all columns of text, as in theta_i_deg,theta_o_deg,phi_o_deg,r,g,b; '-' leaves one out.",
                show_default=False,
            ),
        ],
        None,
    ),
    "ignore": (
        Annotated[
            list[str] | None,
            typer.Option("--ignore", metavar="NAMES", help="Columns to leave out.", show_default=False),
        ],
        None,
    ),
    "constants": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--set",
                metavar="NAME=NUMBER",
                help="A column with one number throughout, as in phi_o_deg=180.",
                show_default=False,
            ),
        ],
        None,
    ),
    "scale": (
        Annotated[
            float | None,
            typer.Option(
                "--scale",
                help="Factor of the values: 0.3183 for reflectance factors, 0.003183 for those in percent.",
                show_default=False,
            ),
        ],
        None,
    ),
    "cosine": (
        Annotated[
            bool, typer.Option("--cosine", help="The values hold the cosine of theta_o: divide by it.")
        ],
        False,
    ),
    "phi_offset": (
        Annotated[
            float | None,
            typer.Option(
                "--phi-offset",
                metavar="DEGREES",
                help="Added to the azimuth of the view; 180 where the mirror direction is at phi = 0.",
                show_default=False,
            ),
        ],
        None,
    ),
    "keep": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--keep",
                metavar="COMPARISON",
                help="Samples to keep, as in 'theta_o<=85'.",
                show_default=False,
            ),
        ],
        None,
    ),
}


def takes_reading(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of reading; its parameter `reading` gets those given, as keywords of `dsbrdf.read`.

    What it reads may be '-', for text from standard input.
    """
    signature = inspect.signature(command, eval_str=True)
    own = [parameter for parameter in signature.parameters.values() if parameter.name != "reading"]
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (annotation, default) in _OPTIONS.items()
    ]

    @functools.wraps(command)
    def wrapped(**arguments: Any) -> Any:
        reading = _keywords({name: arguments.pop(name) for name in _OPTIONS})
        if not any(_is_piped(arguments.get(name)) for name in TARGETS):
            return command(**arguments, reading=reading)
        with standard_input() as path:
            return command(
                **{name: _with(value, path, name) for name, value in arguments.items()}, reading=reading
            )

    wrapped.__signature__ = signature.replace(parameters=[*own, *added])  # type: ignore[attr-defined]
    wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *added)}
    del wrapped.__wrapped__
    return wrapped


def _is_piped(value: Any) -> bool:
    """Whether a target, or one of several, is standard input."""
    return STANDARD_INPUT in map(str, value if isinstance(value, list) else [value])


def _with(value: Any, path: Path, name: str) -> Any:
    """A target with the file of what was piped in for its sign."""
    if name not in TARGETS or not _is_piped(value):
        return value
    if isinstance(value, list):
        return [str(path) if each == STANDARD_INPUT else each for each in value]
    return type(path)(path) if isinstance(value, Path) else str(path)


def _keywords(given: dict[str, Any]) -> dict[str, Any]:
    """Keywords of `dsbrdf.read`; what cannot be understood is refused here, before anything is read."""
    from dsbrdf.measured.options import ReadOptions

    constants = {}
    for text in given.pop("constants") or ():
        name, sign, number = text.partition("=")
        try:
            constants[name.strip()] = float(number)
        except ValueError:
            sign = ""
        if not sign or not name.strip():
            raise typer.BadParameter(
                f"expected NAME=NUMBER, as phi_o_deg=180, got {text!r}.", param_hint="'--set'"
            )
    lists: dict[str, Any] = {
        name: [part.strip() for text in given.pop(name) or () for part in text.split(",")]
        for name in ("ignore", "keep")
    }
    columns = given.pop("columns")
    names = None if columns is None else [name.strip() for name in columns.split(",")]
    try:
        return ReadOptions(**given, **lists, columns=names, set=constants).given
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
