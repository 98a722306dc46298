"""`dsbrdf fit`."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dsbrdf.cli._app import State, app, check_folder, missing_plots, note, say, tell
from dsbrdf.cli._reading import takes_reading
from dsbrdf.cli._workers import processes

if TYPE_CHECKING:
    from dsbrdf.batch import Executors

#: Seconds that a scheduler has to answer.
CONNECTING = 10


class Loss(StrEnum):
    """Losses of a fit."""

    log = "log"
    gamma = "gamma"
    l2 = "l2"


class Curves(StrEnum):
    """How many coefficients the curves over theta_d have."""

    standard = "standard"
    compact = "compact"


@app.command()
@takes_reading
def fit(
    context: typer.Context,
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="Measured files (MERL, RGL, samples as text, ...), folders of them, names of built-in materials, or "
            "- for text from standard input.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Write each model to DIR/<name>.json.")
    ] = None,
    lobes: Annotated[
        str, typer.Option(metavar="N", help="Lobes; auto: as few as the data call for.")
    ] = "auto",
    loss: Annotated[
        Loss, typer.Option(help="Squares of the logarithm, the gamma deviance, or squares of values.")
    ] = Loss.log,
    curves: Annotated[
        Curves,
        typer.Option(help="Numbers of the curves over theta_d; compact: 60 or less for three channels."),
    ] = Curves.standard,
    as_json: Annotated[bool, typer.Option("--json", help="Print a line of JSON for each material.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write figures of each fit beside its model.")] = False,
    view: Annotated[
        bool, typer.Option("--view", help="Write a web page that shows the models, beside them.")
    ] = False,
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="library|SPACE",
            help="What materials are like, for few samples: those of the built-in library, or of a file of "
            "'dsbrdf space build'.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Fit also what is fitted already; replace files of others.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Fit in N processes, by default in this one.", show_default=False
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Fit on the workers of a Dask scheduler, as in tcp://host:8786.",
            show_default=False,
        ),
    ] = None,
    *,
    reading: Any,
) -> None:
    """Fit measured BRDFs; print how good the fits are."""
    from dsbrdf import batch
    from dsbrdf.cli import _report as report
    from dsbrdf.model import energy

    if plot and out is None:
        raise typer.BadParameter("plots need a folder: add -o DIR.", param_hint="'--plot'")
    if view and out is None:
        raise typer.BadParameter("the page needs a folder: add -o DIR.", param_hint="'--view'")
    if plot and (missing := missing_plots()):
        raise ModuleNotFoundError(missing)
    if out is not None:
        check_folder(out)
    options: dict[str, Any] = {"n_lobes": _lobe_count(lobes), "loss": loss.value, "curves": curves.value}
    if prior is not None:
        if lobes != "auto" or curves is not Curves.standard:
            raise typer.BadParameter(
                "the space decides on lobes and curves: leave out --lobes and --curves.",
                param_hint="'--prior'",
            )
        from dsbrdf.space import builtin, load_space

        options["prior"] = builtin() if prior == "library" else load_space(prior)
    state: State = context.obj
    targets, failures = batch.expand(files, strict=state.debug)
    is_batch = len(files) > 1 or targets != files
    results: list[batch.Outcome] = []

    def done(outcome: batch.Outcome) -> None:
        step(outcome.target)
        (failures if outcome.summary is None else results).append(outcome)
        if as_json and outcome.summary is not None:
            print(report.json_line(report.with_path(outcome)), flush=True)

    try:
        with (
            report.progress(len(targets), shown=not (as_json and sys.stdout.isatty())) as step,
            _executor(workers, scheduler) as executor,
        ):
            step("")
            batch.fit_many(
                targets,
                out,
                reading=reading,
                record=is_batch,
                force=force,
                strict=state.debug,
                plots=plot,
                executor=executor,
                done=done,
                **options,
            )
    finally:
        if results and not as_json:
            report.print_outcomes(results, out, is_batch=is_batch)
        if bright := energy.warning(
            result.model for result in results if result.model is not None and not result.kept
        ):
            note(bright)
        for failure in failures:
            say(f"error: {failure.status}")
    if view and results and out is not None:
        from dsbrdf.view import collect

        page = collect.view_files([outcome.path for outcome in results if outcome.path], out)
        tell(f"Page: {page}", error=as_json)
    if failures:
        raise typer.Exit(1)


@contextlib.contextmanager
def _executor(workers: int | None, scheduler: str | None) -> Iterator[Executors | None]:
    """Where fits run."""
    if scheduler is None:
        yield None if workers is None else functools.partial(processes, workers)
        return
    if workers is not None:
        raise typer.BadParameter(
            "the scheduler has its workers: leave out --workers.", param_hint="'--scheduler'"
        )
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            '--scheduler needs Dask: pip install "dsbrdf[cluster]"', name="distributed"
        ) from None
    with Client(scheduler, timeout=CONNECTING) as client:  # type: ignore[no-untyped-call]
        yield client.get_executor()


def _lobe_count(text: str) -> int | str:
    from dsbrdf.fitting.options import MAX_LOBES

    if text == "auto":
        return text
    if not text.isdecimal() or not 1 <= int(text) <= MAX_LOBES:
        raise typer.BadParameter(
            f"expected a number from 1 to {MAX_LOBES}, or auto, got {text!r}.", param_hint="'--lobes'"
        )
    return int(text)
