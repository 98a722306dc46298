"""Many files: fit after fit, here or on other machines; what fails is noted, what is done already is kept.

`fit_many` is here, in the package itself, and is read first. `jobs` is what a worker does, `dispatch` sends jobs to the
workers of an executor. `record` remembers what a folder of models was made of, so that a later run keeps what is still
good, and writes its tables; `_lock` keeps a second run out of the folder.
"""

from __future__ import annotations

import contextlib
import lzma
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from dsbrdf import _check, _files
from dsbrdf._lock import BusyError
from dsbrdf.batch.dispatch import ExecutorLostError, Executors, WorkerDiedError, dispatched
from dsbrdf.batch.jobs import FIGURES, Answer, Job, Order, Target, label_of, open_target
from dsbrdf.batch.record import RECORD, TABLES, Book, figure_path
from dsbrdf.measured.formats.nbrdf import npy_set
from dsbrdf.measured.formats.text_file import has_numbers
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = [
    "RECORD",
    "TABLES",
    "BusyError",
    "ExecutorLostError",
    "Executors",
    "Outcome",
    "Target",
    "WorkerDiedError",
    "describe",
    "expand",
    "fit_many",
    "open_target",
]

#: Files of a folder that are measured ones; an image in it may be anything, and is given by itself.
SUFFIXES = (".binary", ".bsdf", ".h5", ".hdf5", ".npz", ".npy", ".csv", ".tsv", ".txt", ".dat", ".asc")


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

    Examples
    --------
    >>> import dsbrdf
    >>> (outcome,) = dsbrdf.fit_many(["matte"], n_lobes=1)
    >>> outcome.status, outcome.model.n_lobes
    ('ok', 1)
    """

    target: str
    summary: dict[str, Any] | None = None
    path: Path | None = None
    status: str = "ok"
    kept: bool = False
    error: Exception | None = None
    # The text of the file, compressed, if there is none
    _text: bytes = field(default=b"", repr=False)

    @cached_property
    def model(self) -> DSBRDF | None:
        """The model, read from its file if it has one; None if the fit failed."""
        if self._text:
            return model_file.loads(lzma.decompress(self._text).decode(), self.target)
        return None if self.path is None or self.error is not None else model_file.load(self.path)


def describe(error: BaseException) -> str:
    """What an error says, in a sentence for who uses the command."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'standard output'}: {error.strerror}."
    if isinstance(
        error, OSError | ValueError | ImportError | BusyError | ExecutorLostError | WorkerDiedError
    ):
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

    Examples
    --------
    >>> from dsbrdf import batch
    >>> batch.expand(["matte"])
    (['matte'], [])
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


def _failure(target: str, error: Exception) -> str:
    text = describe(error)
    return text if target in text else f"{target}: {text}"


def fit_many(
    targets: str | Path | Iterable[Target],
    out: str | Path | None = None,
    executor: Executors | None = None,
    *,
    reading: Mapping[str, Any] | None = None,
    record: bool = True,
    force: bool = False,
    strict: bool = False,
    plots: bool = False,
    pending: int | None = None,
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
        Files, URLs of fsspec, names of built-in materials and measurements; or a folder of files. An iterable is taken
        from as the work goes on, so that measurements can be made one by one. Files are read where the worker is.
    out : str or Path, optional
        Folder for models `<name>.json`; none are written by default.
    executor : concurrent.futures.Executor, or callable that makes one, optional
        Where fits run: processes of loky, `client.get_executor()` of Dask, mpi4py.futures. By default two threads of
        this process: a fit lets go of the interpreter and uses all cores. A pool whose worker dies takes no more work:
        give the function that makes it (`loky.get_reusable_executor`), and what was lost is fitted with another one.
    reading : mapping, optional
        Options of `dsbrdf.read`, such as `columns`, for all files.
    record : bool, optional
        Keep models of an earlier run, and write `fits.csv`, `fits.md` and a record for the next run, in `out`.
    force : bool, optional
        Fit again what could be kept.
    strict : bool, optional
        Raise instead of going on.
    plots : bool, optional
        Write figures beside the models, which needs matplotlib where the workers are; of scattered samples there are
        none, with a warning.
    pending : int, optional
        Most chunks of work that are sent before the first comes back. By default two for each worker, or 1000 if the
        executor does not say how many it has.
    done : callable, optional
        Called in order with what became of each.
    **options
        Of `dsbrdf.fit`.

    Returns
    -------
    list of Outcome
        In the order of `targets`.

    Raises
    ------
    BusyError
        If another run is writing to `out`.
    ExecutorLostError
        If the executor takes no more work, and there is no function to make another one.
    OSError
        If a file in `out` cannot be written.

    Examples
    --------
    >>> import dsbrdf
    >>> outcomes = dsbrdf.fit_many(["matte", "grey-primer"], n_lobes=1)
    >>> [outcome.model.name for outcome in outcomes]
    ['matte', 'grey-primer']
    """
    if isinstance(targets, str | Path):
        targets, _ = expand([targets], strict=True)
    folder = None if out is None else Path(out)
    said = {"reading": dict(reading)} if reading else {}
    book = Book(folder if record else None, options | said, force=force)
    order = Order(options, reading or {}, book.folder is not None, plots)
    taken: dict[str, tuple[int, str]] = {}
    outcomes: dict[int, Outcome] = {}
    failures: list[tuple[str, str]] = []
    told = 0

    def fail(label: str, error: Exception) -> Outcome:
        if strict:
            raise error
        failures.append((Path(label).stem, _failure(label, error)))
        return Outcome(label, status=failures[-1][1], error=error)

    def claim(path: Path, index: int, label: str) -> None:
        """Of two materials of one file, also on a system that tells no case, the first among the targets gets it."""
        for file in (path, *((figure_path(path, ending) for ending in FIGURES) if plots else ())):
            key = _files.file_key(file)
            first, second = sorted([taken.get(key, (index, label)), (index, label)])
            taken[key] = first
            if first == second:
                continue
            error = ValueError(f"{file} is already the file of {first[1]}. Give it another folder.")
            if second[0] == index:
                raise _FailedError(error)
            book.forget(outcomes[second[0]].path, but=path)
            outcomes[second[0]] = fail(second[1], error)

    with (
        book.kept(failures),
        contextlib.closing(dispatched(executor, _jobs(targets, book, plots), order, pending)) as answers,
    ):
        for job, answer in answers:
            label = label_of(job.target)
            for text, category in answer.warnings:
                warnings.warn(text, category, stacklevel=2)
            try:
                if answer.error is not None:
                    raise _FailedError(answer.error)
                path = None if folder is None else folder / f"{_files.file_name(answer.name)}.json"
                if path is not None:
                    claim(path, job.index, label)
                    if not answer.kept:
                        _check_strangers(path, answer, force=force)
                outcomes[job.index] = _finished(label, answer, path, book)
            except _FailedError as failed:
                outcomes[job.index] = fail(label, failed.error)
            while told in outcomes:
                done(outcomes[told])
                told += 1
    return [outcomes[i] for i in range(len(outcomes))]


class _FailedError(Exception):
    """There is no model, for reasons of the measurement."""

    def __init__(self, error: Exception) -> None:
        super().__init__(error)
        self.error = error


def _jobs(targets: Iterable[Target], book: Book, figures: bool) -> Iterator[Job]:
    for index, given in enumerate(targets):
        _check.instance(given, (str, Path, MeasuredBRDF, Samples), "targets")
        target = str(given) if isinstance(given, Path) else given
        file = Path(target) if isinstance(target, str) else target.source.file
        known = None if file is None else book.known(file.name, figures=figures)
        yield Job(index, target, known)


def _check_strangers(path: Path, answer: Answer, *, force: bool) -> None:
    """Fail a material whose name is that of a file, in the folder, that is no model or figure of ours."""
    try:
        for file in (path, *(figure_path(path, ending) for ending in answer.figures)):
            _files.check_replaceable(file, force=force)
    except FileExistsError as error:
        raise _FailedError(error) from None


def _finished(label: str, answer: Answer, path: Path | None, book: Book) -> Outcome:
    """Write the model, then its figures, then the record: what the record tells of is there."""
    if answer.kept:
        entry = {**book.earlier[answer.name], "source": answer.source}
        book.add(answer.name, entry)
        return Outcome(label, dict(entry["summary"]), path, entry["status"], kept=True)
    assert answer.summary is not None
    status = "ok" if answer.summary["converged"] else "out of iterations"
    if path is None:
        return Outcome(label, answer.summary, status=status, _text=answer.model)
    with _files.aside(path) as part:
        part.write_text(lzma.decompress(answer.model).decode(), encoding="utf-8")
    for ending, figure in answer.figures.items():
        with _files.aside(figure_path(path, ending)) as part:
            part.write_bytes(figure)
    if book.folder is not None:
        entry = {"source": answer.source, "model_sha256": _files.sha256(path)}
        entry |= {"summary": answer.summary, "status": status, "options": book.options}
        book.add(answer.name, entry)
    return Outcome(label, answer.summary, path, status)
