"""`dsbrdf info`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dsbrdf.cli._app import Force, State, app, tell
from dsbrdf.cli._reading import takes_reading

if TYPE_CHECKING:
    from dsbrdf.measured import MeasuredBRDF, Samples
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
            help="A model file, a name of the library, or what is fitted first: a measured file, a built-in material, "
            "or - for text from standard input.",
            show_default=False,
        ),
    ],
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Also draw a measured file.", show_default=False),
    ] = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Also print how certain the fit of a measurement is.")
    ] = False,
    force: Force = False,
    *,
    reading: Any,
) -> None:
    """Print what a measured file holds, and what a model or a fit of it does."""
    from dsbrdf.cli._open import open_models

    state: State = context.obj
    if Path(model).exists() and not model.lower().endswith(".json"):
        state.begin(model)
        print_measured(Path(model), reading, plot, force=force)
        state.begin("")
    elif plot is not None:
        raise typer.BadParameter("draws measured files; 'dsbrdf view' shows a model.", param_hint="'--plot'")
    with warnings.catch_warnings():
        if plot is not None or Path(model).exists():
            # Said above
            warnings.simplefilter("ignore", UserWarning)
        if uncertainty:
            print_fit(model, reading)
            return
        for _, found in open_models([model], state, reading):
            print_model(found)


def print_fit(target: str, reading: Mapping[str, Any]) -> None:
    """Print what a fit of a measurement holds, and how certain its curves are."""
    from dsbrdf import batch
    from dsbrdf.cli import _report as report
    from dsbrdf.cli._report import _console
    from dsbrdf.fitting import fit
    from dsbrdf.library import model_named

    if model_named(target) is not None:
        raise typer.BadParameter(
            f"{target} is a model, without its measurement. Name what was measured.",
            param_hint="'--uncertainty'",
        )
    with report.progress(1) as step:
        step(Path(target).stem)
        found = fit(batch.open_target(target, reading))
    print_model(found.model)
    _console().print()
    _console().print(repr(found.standard_errors()), soft_wrap=True)


def print_measured(
    path: Path, reading: Mapping[str, Any], figure: Path | None = None, *, force: bool = False
) -> None:
    """Print what a measured file holds, and draw it if a figure is wanted."""
    from dsbrdf.cli._app import check_output, missing_plots
    from dsbrdf.cli._report import _console, _Table
    from dsbrdf.measured import Samples, read
    from dsbrdf.measured.read import format_of

    if figure is not None:
        check_output(figure, [path], force=force)
        if missing := missing_plots():
            raise ModuleNotFoundError(missing)
    measured = read(path, **reading)
    table = _Table.grid(padding=(0, 2, 0, 0))
    table.add_column()
    table.add_column(overflow="fold")
    table.add_row("file", str(path))
    table.add_row("format", "neural BRDF (.npy)" if path.is_dir() else format_of(path).name)
    holds = f"{len(measured)} pairs of directions" if isinstance(measured, Samples) else repr(measured)
    table.add_row("holds", holds)
    names = measured.channels or [str(i + 1) for i in range(measured.n_channels)]
    table.add_row("channels", f"{measured.n_channels}: {', '.join(map(str, _some(names)))}")
    for name, low, high in _ranges(measured):
        table.add_row(name, f"{low:.4g} to {high:.4g}")
    if isinstance(measured, Samples) and measured.weights is not None:
        table.add_row("weights", "yes")
    for remark in getattr(measured, "remarks", ()):
        table.add_row("", f"{remark}.")
    console = _console()
    console.print(table)
    console.print()
    if figure is not None:
        from dsbrdf import plot

        if not isinstance(measured, Samples):
            raise ValueError(f"{path}: a table; 'dsbrdf fit --plot' draws it with its fit.")
        plot.write_figure(plot.samples_figure(measured), figure)
        tell(figure)


def _ranges(measured: Samples | MeasuredBRDF) -> list[tuple[str, float, float]]:
    """Names, least and greatest of the angles in degrees, and of the values."""
    import numpy as np

    from dsbrdf.geometry import half_diff
    from dsbrdf.measured import Samples

    if isinstance(measured, Samples):
        h, d, _ = half_diff.from_directions(measured.wi, measured.wo)
        i, o = (np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]) for w in (measured.wi, measured.wo))
        angles = {"theta_i": i, "theta_o": o, "theta_h": h, "theta_d": d}
    else:
        seen = np.asarray(measured.valid.any((2, 3)))
        angles = {
            "theta_h": measured.theta_h[seen.any(axis=1)],
            "theta_d": measured.theta_d[seen.any(axis=0)],
        }
    found = [(f"{n}, degrees", *np.rad2deg([a.min(), a.max()]).tolist()) for n, a in angles.items() if len(a)]
    values = measured.values[np.isfinite(measured.values)]
    return [*found, ("values, 1/sr", float(values.min()), float(values.max()))] if values.size else found


def print_model(model: DSBRDF) -> None:
    """Print what a model holds: where it comes from, what its lobes are, and its albedos."""
    from dsbrdf.cli._report import _console

    console = _console()
    for i, part in enumerate((_origin(model), _components(model), _albedos(model))):
        if i:
            console.print()
        console.print(part)


def _origin(model: DSBRDF) -> Any:
    from dsbrdf.cli._report import _Table

    source = model.source.to_json()
    table = _Table.grid(padding=(0, 2, 0, 0))
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
