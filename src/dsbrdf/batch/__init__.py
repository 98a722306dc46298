"""Many files: fit after fit, two at a time; what fails is noted, what is done already is kept, one table of all.

`fit_many` is here, in the package itself, and is read first. `record` remembers what a folder of models was made of, so
that a later run keeps what is still good, and writes its tables. `worker` runs fits in processes of their own.
"""

from __future__ import annotations

import contextlib
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dsbrdf import _files
from dsbrdf.batch.record import RECORD, TABLES, Book, figure_path, source_of
from dsbrdf.fitting.fit import Fit, fit
from dsbrdf.measured import MeasuredBRDF, Samples, built_in, read
from dsbrdf.measured.formats.nbrdf import npy_set
from dsbrdf.measured.formats.text_file import has_numbers
from dsbrdf.model.dsbrdf import DSBRDF

if TYPE_CHECKING:
    from dsbrdf.batch.worker import Workers

__all__ = [
    "RECORD",
    "TABLES",
    "Outcome",
    "Target",
    "WorkerDiedError",
    "describe",
    "expand",
    "fit_many",
    "open_target",
]

#: A file, the name of a built-in material, or what was measured.
Target = str | Path | MeasuredBRDF | Samples

#: One fit uses all cores for most of its time; a second fills in while the first reads.
WORKERS = 2
#: Begun beyond those that are worked on, before the first is handed on: bounds what is held in memory.
AHEAD = 1
#: Files of a folder that are measured ones; an image in it may be anything, and is given by itself.
SUFFIXES = (".binary", ".bsdf", ".h5", ".hdf5", ".npz", ".npy", ".csv", ".tsv", ".txt", ".dat", ".asc")


class WorkerDiedError(RuntimeError):
    """The process of a fit ended before the fit did."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one file.

    Parameters
    ----------
    target : str
        The file, the built-in material, or the name of what was given.
    summary : dict or None
        `Fit.summary`, with "criteria", what chose the number of lobes, for 1, 2, ... lobes, where it was chosen; None
        if the fit failed.
    path : Path or None
        The model file.
    status : str
        "ok", or what was wrong.
    kept : bool
        Whether the model is that of an earlier run.
    error : Exception or None
        Why there is no model.
    model : DSBRDF or None
        The model, if it was fitted in this run.
    """

    target: str
    summary: dict[str, Any] | None = None
    path: Path | None = None
    status: str = "ok"
    kept: bool = False
    error: Exception | None = None
    model: DSBRDF | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class _Work:
    """What a thread hands back: a fit, or the entry of an earlier run, or why there is neither."""

    name: str
    source: dict[str, Any] | None = None
    result: Fit | None = None
    summary: dict[str, Any] | None = None
    entry: dict[str, Any] | None = None
    error: Exception | None = None


def describe(error: BaseException) -> str:
    """What an error says, in a sentence for who uses the command."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'standard output'}: {error.strerror}."
    if isinstance(error, OSError | ValueError | ImportError | WorkerDiedError):
        return str(error)
    if isinstance(error, MemoryError):
        return "out of memory."
    return f"unexpected {type(error).__name__}: {error}. Please report it, with what --debug prints."


def expand(paths: Sequence[str | Path], *, strict: bool = False) -> tuple[list[str], list[Outcome]]:
    """Files and names of materials, with folders replaced by the measured files in them.

    Returns
    -------
    targets : list of str
    failures : list of Outcome
        Folders that cannot be read or hold no such file; raised with `strict`.
    """
    targets: list[str] = []
    failures: list[Outcome] = []
    for path in paths:
        try:
            targets += _inside(Path(path)) if Path(path).is_dir() else [str(path)]
        except (OSError, ValueError) as error:
            if strict:
                raise
            failures.append(Outcome(str(path), status=_failure(str(path), error), error=error))
    return targets, failures


def _inside(folder: Path) -> list[str]:
    inside = sorted(str(entry) for entry in folder.iterdir() if _is_measured(entry))
    if not inside:
        raise ValueError(f"{folder}: no measured file ({', '.join(SUFFIXES)}) in this folder.")
    return inside


def _is_measured(entry: Path) -> bool:
    """Whether a file of a folder is one to fit; of the six of a neural BRDF, the first."""
    suffix = entry.suffix.lower()
    if suffix not in SUFFIXES or entry.name in TABLES or entry.is_dir():
        return False
    if suffix in (".txt", ".dat", ".asc") and not has_numbers(entry):
        return False
    network = npy_set(entry)
    return network is None or network["fc1"] == entry


def _label(target: Target) -> str:
    return target.name if isinstance(target, MeasuredBRDF | Samples) else str(target)


def _failure(target: str, error: Exception) -> str:
    text = describe(error)
    return text if target in text else f"{target}: {text}"


def open_target(target: str, reading: Mapping[str, Any] | None = None) -> MeasuredBRDF | Samples:
    """The measured file, read with these options of `dsbrdf.read`, or else the built-in material, of this name.

    Raises
    ------
    ValueError
        If there is neither, or the file is of no known format.
    OSError
        If the file cannot be read.
    """
    if Path(target).exists():
        return read(target, **(reading or {}))
    if target in built_in.names():
        return built_in.material(target)
    if Path(target).suffix or Path(target).name != target:
        raise ValueError(f"{target}: no such file.")
    try:
        return built_in.material(target)
    except ValueError as error:
        raise ValueError(f"{target}: no such file; {error}") from None


def fit_many(
    targets: str | Path | Iterable[Target],
    out: str | Path | None = None,
    *,
    reading: Mapping[str, Any] | None = None,
    processes: int = 0,
    record: bool = True,
    force: bool = False,
    strict: bool = False,
    plots: bool = False,
    step: Callable[[str], None] = lambda _: None,
    begin: Callable[[str], None] = lambda _: None,
    done: Callable[[Outcome], None] = lambda _: None,
    **options: Any,
) -> list[Outcome]:
    """Fit many measured BRDFs, and go on after one that cannot be read or fitted.

    Run again, it keeps the models of files that are the same as then (name and size, and the time of change or else
    the hash), were fitted with the same options by the same version, and that nobody has changed since. Built-in
    materials are fitted again. Stopped at any time, it leaves whole models and a record of them.

    Parameters
    ----------
    targets : str, Path, or iterable of str, Path, MeasuredBRDF or Samples
        Files, names of built-in materials and measurements; or a folder of files. An iterable is taken from as the
        work goes on, so that measurements can be made one by one.
    out : str or Path, optional
        Folder for models `<name>.json`; none are written by default.
    reading : mapping, optional
        Options of `dsbrdf.read`, such as `columns`, for all files.
    processes : int, optional
        Fit in so many processes of their own: a fit that crashes or is killed is tried once more, and then noted as
        failed while the others go on. By default two threads of this process, which are as fast.
    record : bool, optional
        Keep models of an earlier run, and write `fits.csv`, `fits.md` and a record for the next run, in `out`.
    force : bool, optional
        Fit again what could be kept.
    strict : bool, optional
        Raise instead of going on.
    plots : bool, optional
        Write figures beside the models, which needs matplotlib; of scattered samples there are none, with a
        warning.
    step : callable, optional
        Told in order what is waited for.
    begin : callable, optional
        Told what is begun, in the thread that does it.
    done : callable, optional
        Told in order what became of each, as it comes.
    **options
        Of `dsbrdf.fit`.

    Returns
    -------
    list of Outcome
        In the order of `targets`.

    Raises
    ------
    OSError
        If a file in `out` cannot be written.
    """
    if isinstance(targets, str | Path):
        targets, _ = expand([targets], strict=True)
    if processes < 0:
        raise ValueError(f"'processes' must be at least 0, got {processes}.")
    folder = None if out is None else Path(out)
    workers = None
    if processes:
        from dsbrdf.batch.worker import Workers

        workers = Workers(processes)
    said = {"reading": dict(reading)} if reading else {}
    book = Book(folder if record else None, options | said, force=force)
    taken: dict[Path, str] = {}
    outcomes: list[Outcome] = []
    failures: list[tuple[str, str]] = []

    def work(target: Target) -> _Work:
        begin(_label(target))
        return _work(target, reading, options, book, plots, workers)

    def finish(target: str, of_thread: _Work) -> Outcome:
        error = of_thread.error
        path = None if folder is None else folder / f"{of_thread.name}.json"
        if error is None and path in taken:
            error = ValueError(f"{path} is already the model of {taken[path]}. Give it another folder.")
        if error is not None:
            if strict:
                raise error
            failures.append((Path(target).stem, _failure(target, error)))
            return Outcome(target, status=failures[-1][1], error=error)
        if path is not None:
            taken[path] = target
        return _finish(target, of_thread, path, book, plots)

    with contextlib.ExitStack() as stack:
        stack.enter_context(book.tables(failures))
        results = stack.enter_context(contextlib.closing(_ahead(work, targets, processes or WORKERS)))
        if workers is not None:
            # Before the threads that wait for them
            stack.callback(workers.close)
        for target, waited_for in results:
            step(target)
            outcomes.append(finish(target, waited_for.result()))
            done(outcomes[-1])
    return outcomes


def _ahead(
    work: Callable[[Target], _Work], targets: Iterable[Target], n_threads: int
) -> Generator[tuple[str, Future[_Work]], None, None]:
    """Targets in order, and what will come of them; a few are begun before they are asked for."""
    pool = ThreadPoolExecutor(n_threads)
    begun: deque[tuple[str, Future[_Work]]] = deque()
    try:
        for target in targets:
            begun.append((_label(target), pool.submit(work, target)))
            if len(begun) == n_threads + AHEAD:
                yield begun.popleft()
        while begun:
            yield begun.popleft()
    finally:
        pool.shutdown(cancel_futures=True)


def _work(
    target: Target,
    reading: Mapping[str, Any] | None,
    options: Mapping[str, Any],
    book: Book,
    plots: bool,
    workers: Workers | None,
) -> _Work:
    name = Path(_label(target)).stem
    try:
        target = str(target) if isinstance(target, Path) else target
        measured = open_target(target, reading) if isinstance(target, str) else target
        name = measured.name
        source = source_of(measured) if book.folder is not None else None
        entry = book.still_good(name, measured, source, plots and isinstance(measured, MeasuredBRDF))
        if entry is not None:
            return _Work(name, source, entry=entry)
        if workers is not None:
            result, summary = workers.fit(target, reading, measured, options, book.folder is not None)
        else:
            result = fit(measured, **options)
            if book.folder is not None:
                # Hashed here, while the other thread fits
                _ = measured.source.sha256
            summary = result.summary()
        if result.estimate.criteria.size:
            summary["criteria"] = result.estimate.criteria.tolist()
        return _Work(name, source, result, summary)
    except Exception as error:
        return _Work(name, error=error)


def _finish(target: str, work: _Work, path: Path | None, book: Book, plots: bool) -> Outcome:
    """Write the model, then its figures, then the record: what the record tells of is there."""
    result = work.result
    if result is None:
        assert work.entry is not None
        book.add(work.name, {**work.entry, "source": work.source})
        return Outcome(target, dict(work.entry["summary"]), path, work.entry["status"], kept=True)
    if path is not None:
        result.model.save(path)
        if plots:
            _write_figures(result, path)
    status = "ok" if result.converged else "out of iterations"
    if path is not None and book.folder is not None:
        source = work.source and {**work.source, "sha256": result.measured.source.sha256}
        hashed = _files.sha256(path)
        entry = {"source": source, "model_sha256": hashed, "summary": work.summary, "status": status}
        book.add(work.name, {**entry, "options": book.options})
        book.save()
    return Outcome(target, work.summary, path, status, model=result.model)


def _write_figures(result: Fit, path: Path) -> None:
    if isinstance(result.measured, Samples):
        warnings.warn(
            f"{result.model.name}: no figures: they show a measured table, and these are {len(result.measured)} "
            "scattered samples. See the model with 'dsbrdf view'.",
            UserWarning,
            stacklevel=2,
        )
        return
    from dsbrdf import plot

    plot.write_figure(plot.fit_figure(result), figure_path(path, ""))
    plot.write_figure(plot.parameter_figure(result.model), figure_path(path, "-parameters"))
