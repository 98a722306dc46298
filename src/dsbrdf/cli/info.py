"""`dsbrdf info`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dsbrdf.cli._app import State, app
from dsbrdf.cli._reading import takes_reading

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

#: Channels whose colours and albedos are told; of more, so many from the first to the last.
MOST_CHANNELS = 8
#: Incident angles in degrees at which albedos are told.
ALBEDO_ANGLES = (0, 45, 75)


@app.command()
@takes_reading
def info(
    context: typer.Context,
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL|FILE|NAME",
            help="A model file, a name of the library, or what is fitted first: a measured file, a built-in material.",
            show_default=False,
        ),
    ],
    *,
    reading: Any,
) -> None:
    """Print what a model holds."""
    from dsbrdf.cli._open import open_models

    state: State = context.obj
    for _, found in open_models([model], state, reading):
        print_model(found)


def print_model(model: DSBRDF) -> None:
    """Print what a model holds: where it comes from, what its lobes are, and its albedos."""
    from dsbrdf.cli._report import _console

    console = _console()
    for i, part in enumerate((_origin(model), _components(model), _albedos(model))):
        if i:
            console.print()
        console.print(part)


def _origin(model: DSBRDF) -> Any:
    from rich.table import Table

    source = model.source.to_json()
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column()
    table.add_column(overflow="fold")
    table.add_row("name", model.name or "-")
    for label, key in (("file", "file"), ("SHA-256", "sha256"), ("description", "description")):
        if source.get(key):
            table.add_row(label, str(source[key]))
    table.add_row("lobes", str(model.n_lobes))
    table.add_row("channels", f"{model.n_channels}: {', '.join(_some(model.channels))}")
    table.add_row("numbers", str(model.n_parameters))
    if model.fit_options:
        table.add_row("fit", ", ".join(_option(*item) for item in model.fit_options.items()))
    for key, value in model.errors.items():
        table.add_row(key.replace("_", " "), f"{value:.4f}" if math.isfinite(value) else "-")
    return table


def _option(name: str, value: Any) -> str:
    return f"{name} {'yes' if value is True else 'no' if value is False else value}"


def _some(values: Any) -> list[Any]:
    """The values, or some of many, from the first to the last."""
    n = min(len(values), MOST_CHANNELS)
    return [values[round(i * (len(values) - 1) / max(n - 1, 1))] for i in range(n)]


def _components(model: DSBRDF) -> Any:
    """What each lobe is, and why it is called that."""
    from dsbrdf.cli._report import _table
    from dsbrdf.model.components import components

    colours = f"colour\n{' '.join(f'{name:>4}' for name in _some(model.channels))}"
    table = _table(
        "lobe", "kind", "share\n0 deg %", "share\n45 deg %", "half width\ndegrees", colours, "because"
    )
    for column in (table.columns[1], table.columns[-1]):
        column.justify = "left"
    for part in components(model):
        table.add_row(
            str(part.lobe),
            part.label,
            f"{100 * part.share:.1f}",
            f"{100 * part.share_oblique:.1f}",
            f"{math.degrees(part.half_width):.2f}",
            " ".join(f"{value:>4.2f}" for value in _some(part.colour)),
            part.reason,
        )
    return table


def _albedos(model: DSBRDF) -> Any:
    from dsbrdf.cli._report import _table

    table = _table("albedo at", *_some(model.channels))
    for angle in ALBEDO_ANGLES:
        values = _some(model.albedo(math.radians(angle)))
        table.add_row(f"{angle} degrees", *(f"{value:.3f}" for value in values))
    return table
