"""The `dsbrdf` command: parse, call, print.

What fails is told in one line on standard error, `dsbrdf: error: ...`, with exit status 1, or 2 for a command
that cannot be understood. Numeric modules are imported where they are used, so that help comes at once.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["app", "main"]

INTERRUPTED = 130

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Loss(StrEnum):
    """Losses of a fit."""

    l2 = "l2"
    log = "log"


@dataclass
class _State:
    """What all commands share: whether to show tracebacks, and what is being worked on, for warnings."""

    debug: bool = False
    # Threads work on different files
    work: threading.local = field(default_factory=threading.local)

    def begin(self, about: str) -> None:
        """Note what this thread is working on."""
        self.work.about = about

    def announce(self, step: Callable[[str], None]) -> Callable[[str], None]:
        """`step`, and a note of what is being worked on."""

        def both(about: str) -> None:
            self.begin(about)
            step(about)

        return both

    def show_warning(self, message: Warning | str, *_: Any, **__: Any) -> None:
        about = getattr(self.work, "about", "")
        _say(f"warning: {about}{': ' if about else ''}{message}")


def _say(text: str) -> None:
    """One line to standard error."""
    print("dsbrdf:", " ".join(text.split("\n")), file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    # Wherever it stands, --debug holds
    state = _State(debug="--debug" in arguments)
    arguments = [argument for argument in arguments if argument != "--debug"] or ["--help"]
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("always", UserWarning)
        warnings.showwarning = state.show_warning
        try:
            status = _invoke(arguments, state)
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_output()
            return 1
        except (KeyboardInterrupt, Exception) as error:
            if state.debug:
                raise
            _discard_output()
            return _report(error)
    return status


def _invoke(arguments: list[str], state: _State) -> int:
    command = typer.main.get_command(app)
    try:
        with command.make_context("dsbrdf", arguments, obj=state) as context:
            command.invoke(context)
    except typer.Exit as end:
        return int(end.exit_code)
    return 0


def _report(error: BaseException) -> int:
    """Tell of an error in one line, and return the exit status."""
    if isinstance(error, KeyboardInterrupt):
        _say("interrupted")
        return INTERRUPTED
    usage = getattr(error, "format_message", None)
    if usage is not None:
        context = getattr(error, "ctx", None)
        _say(f"error: {usage().rstrip('.')}. Try '{context.command_path if context else 'dsbrdf'} --help'.")
        return int(getattr(error, "exit_code", 2))
    from dsbrdf import batch

    _say(f"error: {batch.describe(error)}")
    return 1


def _discard_output() -> None:
    """Send what is left in the buffer of a broken standard output nowhere, so that Python ends quietly."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError), open(os.devnull, "w") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _version(wanted: bool) -> None:
    if wanted:
        from dsbrdf import __version__

        print(f"dsbrdf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    _wanted: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    _debug: Annotated[bool, typer.Option("--debug", help="Show a traceback where something fails.")] = False,
) -> None:
    """Directional statistics BRDF model: measured reflectance to a few lobes, and back."""
    context.ensure_object(_State)


@app.command()
def demo(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for models and plots.")
    ] = Path("dsbrdf-demo"),
) -> None:
    """Fit the built-in materials; write models and plots."""
    from dsbrdf import demo as demonstration
    from dsbrdf import materials, report

    _check_folder(out)
    missing = _missing_plots()
    if missing:
        _say(f"note: no plots: {missing}")
    state: _State = context.obj
    with report.progress(len(materials.names()) + (not missing)) as step:
        rows = demonstration.run(out, plots=not missing, step=state.announce(step))
    written = "models" if missing else f"models and plots (all materials: {demonstration.OVERVIEW})"
    report.print_demo(rows, f"{written} in {out}")


@app.command()
def fit(
    context: typer.Context,
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="MERL .binary files, folders of them, or names of built-in materials.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Write each model to DIR/<name>.json.")
    ] = None,
    lobes: Annotated[
        str, typer.Option(metavar="N", help="Lobes in each slice and channel; auto: as few as will do.")
    ] = "auto",
    paper: Annotated[
        bool, typer.Option("--paper", help="The paper's model: no azimuthal term, lobes ordered by kappa.")
    ] = False,
    loss: Annotated[
        Loss, typer.Option(help="Squared differences (the paper), or of logarithms, for the tails.")
    ] = Loss.l2,
    slices: Annotated[int, typer.Option(min=1, help="Slices in theta_d; 18 is every 5 degrees.")] = 18,
    as_json: Annotated[bool, typer.Option("--json", help="Print a line of JSON for each material.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write figures of each fit beside its model.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Of many files, fit also those whose model is there already.")
    ] = False,
) -> None:
    """Fit measured BRDFs; print how good the fits are."""
    from dsbrdf import batch, report

    if plot and out is None:
        raise typer.BadParameter("plots need a folder: add -o DIR.", param_hint="'--plot'")
    if plot and (missing := _missing_plots()):
        raise ModuleNotFoundError(missing)
    if out is not None:
        _check_folder(out)
    options: dict[str, Any] = {"n_lobes": _lobe_count(lobes), "loss": loss.value, "n_slices": slices}
    if paper:
        options |= {"azimuthal": False, "order": "kappa"}
    state: _State = context.obj
    targets, failures = batch.expand(files, strict=state.debug)
    is_batch = len(files) > 1 or targets != files
    results: list[batch.Outcome] = []

    def done(outcome: batch.Outcome) -> None:
        (failures if outcome.summary is None else results).append(outcome)
        if as_json and outcome.summary is not None:
            print(report.json_line(report.with_path(outcome)), flush=True)

    try:
        with report.progress(len(targets), shown=not (as_json and sys.stdout.isatty())) as step:
            batch.fit_many(
                targets,
                out,
                record=is_batch,
                force=force,
                strict=state.debug,
                plots=plot,
                step=step,
                begin=state.begin,
                done=done,
                **options,
            )
    finally:
        if results and not as_json:
            report.print_outcomes(results, out, is_batch=is_batch)
        for failure in failures:
            _say(f"error: {failure.status}")
    if failures:
        raise typer.Exit(1)


@app.command()
def info(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A file that fit or demo wrote.")],
) -> None:
    """Print what a model file holds."""
    from dsbrdf import model_file, report

    report.print_model(model_file.load(model))


@app.command(name="paper")
def paper_figures(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="WHAT", help="all, fig1, fig2, fig3, fig5, fig6 or table.")
    ] = "all",
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of MERL .binary files, not the built-in materials."),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for figures, tables and report.")
    ] = Path("dsbrdf-paper"),
) -> None:
    """Make the figures of Nishino and Lombardi (2011), and put their claims beside our numbers."""
    from dsbrdf import paper, report

    _check_folder(out)
    state: _State = context.obj
    with report.progress(paper.n_steps(what, data)) as step:
        for path in paper.run(what, data, out, state.announce(step)):
            typer.echo(path)


def _lobe_count(text: str) -> int | str:
    from dsbrdf.fit import MAX_LOBES

    if text == "auto":
        return text
    if not text.isdecimal() or not 1 <= int(text) <= MAX_LOBES:
        raise typer.BadParameter(
            f"expected a number from 1 to {MAX_LOBES}, or auto, got {text!r}.", param_hint="'--lobes'"
        )
    return int(text)


def _check_folder(folder: Path) -> None:
    """Fail before the work is done if `folder` is none, or cannot be made or written to."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(existing))
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(existing))


def _missing_plots() -> str:
    """Why there can be no plots, empty if there can."""
    try:
        from dsbrdf import plot  # noqa: F401
    except ModuleNotFoundError as error:
        return str(error)
    return ""
