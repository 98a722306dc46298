"""What a worker does: open what was measured, fit it, and send back the model as text, with its summary.

It runs in a thread beside the one that asked, in another process or on another machine. Files are read there; what
comes back is 20 kB at most a material, but for figures.
"""

from __future__ import annotations

import contextlib
import lzma
import pickle
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dsbrdf.fitting.fit import Fit, fit
from dsbrdf.measured import MeasuredBRDF, Samples, built_in, read
from dsbrdf.model import file as model_file

__all__ = ["Answer", "Job", "Target", "label_of", "open_target", "work"]

#: A file, a URL, the name of a built-in material, or what was measured.
Target = str | Path | MeasuredBRDF | Samples
#: A worker hands back what it has after this many seconds, and what it has not begun goes elsewhere.
LONGEST = 10.0
#: Of figures, the ending of the file's name.
FIGURES = ("", "-parameters")
#: matplotlib draws one figure at a time.
_drawing = threading.Lock()


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be fitted.

    Parameters
    ----------
    index : int
        Its place among the targets.
    target : str, MeasuredBRDF or Samples
    known : mapping or None
        What tells the file of an earlier fit that is still good from others, see `source_of`.
    """

    index: int
    target: str | MeasuredBRDF | Samples
    known: Mapping[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of a job; `model` is the text of the model file, compressed, or empty if there is none."""

    name: str
    source: dict[str, Any] | None = None
    summary: dict[str, Any] | None = None
    model: bytes = b""
    kept: bool = False
    figures: Mapping[str, bytes] = field(default_factory=dict)
    warnings: Sequence[tuple[str, type[Warning]]] = ()
    error: Exception | None = None


@dataclass(frozen=True)
class Order:
    """How jobs are to be done: options of `fit` and of `read`, whether files are told apart, figures."""

    options: Mapping[str, Any]
    reading: Mapping[str, Any]
    record: bool
    figures: bool


def label_of(target: Target) -> str:
    """The name of what was measured, or where it is."""
    return target.name if isinstance(target, MeasuredBRDF | Samples) else str(target)


def work(jobs: Sequence[Job], order: Order) -> tuple[list[Answer], float]:
    """Do jobs, until there are no more or some time is over: their answers, and the seconds that a fit took."""
    answers: list[Answer] = []
    start = time.perf_counter()
    while len(answers) < len(jobs) and time.perf_counter() - start < LONGEST:
        answers.append(_answer(jobs[len(answers)], order))
    fitted = sum(not answer.kept for answer in answers)
    return answers, (time.perf_counter() - start) / max(fitted, 1) if fitted else 0.0


def _answer(job: Job, order: Order) -> Answer:
    label = label_of(job.target)
    name = Path(label).stem
    with _heard() as heard:
        try:
            with _opened(job.target, order.reading) as (measured, stamp):
                name = measured.name
                answer = _done(job, order, measured, stamp)
        except Exception as error:
            answer = Answer(name, error=_portable(error))
    told = []
    for warning in heard:
        text = str(warning.message)
        told.append((text if text.startswith(f"{name}: ") else f"{label}: {text}", warning.category))
    return Answer(**{**vars(answer), "warnings": told})


def _done(job: Job, order: Order, measured: MeasuredBRDF | Samples, stamp: Any) -> Answer:
    source = _source_of(measured, stamp) if order.record else None
    if source is not None and job.known is not None and _is_same(measured, source, job.known):
        return Answer(measured.name, {**source, "sha256": job.known["sha256"]}, kept=True)
    result = fit(measured, **order.options)
    summary = result.summary()
    if result.estimate.criteria.size:
        summary["criteria"] = result.estimate.criteria.tolist()
    figures = _figures(result) if order.figures else {}
    if source is not None:
        source["sha256"] = measured.source.sha256
    text = lzma.compress(model_file.dumps(result.model).encode())
    return Answer(measured.name, source, summary, text, figures=figures)


def _source_of(measured: MeasuredBRDF | Samples, stamp: Any) -> dict[str, Any] | None:
    """What tells a file from others without reading it; None for built-in materials and arrays."""
    file = measured.source.file
    if file is None:
        return None
    stat = file.stat()
    is_table = isinstance(measured, MeasuredBRDF)
    return {
        "file": file.name,
        "size": stat.st_size,
        "stamp": stamp or stat.st_mtime_ns,
        "is_table": is_table,
    }


def _is_same(measured: MeasuredBRDF | Samples, source: Mapping[str, Any], known: Mapping[str, Any]) -> bool:
    if (source["file"], source["size"]) != (known.get("file"), known.get("size")):
        return False
    return bool(source["stamp"] == known.get("stamp") or measured.source.sha256 == known.get("sha256"))


def _figures(result: Fit) -> dict[str, bytes]:
    from dsbrdf import plot

    drawn = {}
    with _drawing, tempfile.TemporaryDirectory() as folder:
        for ending, figure in zip(FIGURES, (result.plot(), plot.parameter_figure(result.model)), strict=True):
            path = Path(folder, f"figure{ending}.png")
            plot.write_figure(figure, path)
            drawn[ending] = path.read_bytes()
    return drawn


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


@contextlib.contextmanager
def _opened(
    target: str | MeasuredBRDF | Samples, reading: Mapping[str, Any]
) -> Iterator[tuple[MeasuredBRDF | Samples, Any]]:
    """What was measured, and what tells its state where that is not the time of change of a file."""
    if not isinstance(target, str):
        yield target, None
    elif "://" in target:
        with _fetched(target) as (path, stamp):
            yield read(path, **reading), stamp
    else:
        yield open_target(target, reading), None


@contextlib.contextmanager
def _fetched(url: str) -> Iterator[tuple[Path, str]]:
    """A copy of the file at a URL, and the mark by which its host tells one state of it from another."""
    try:
        import fsspec
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            f'{url}: files at a URL need fsspec: pip install "dsbrdf[cluster]"', name="fsspec"
        ) from None
    system, inside = fsspec.core.url_to_fs(url)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, Path(inside).name)
        system.get_file(inside, str(path))
        yield path, str(system.ukey(inside))


_hearing = threading.local()
_hook = threading.Lock()
_hooked: list[Any] = []


@contextlib.contextmanager
def _heard() -> Iterator[list[warnings.WarningMessage]]:
    """Warnings of this thread, which are not shown; `warnings.catch_warnings` mixes up those of threads."""
    with _hook:
        if not _hooked:
            _hooked.append(warnings.showwarning)
            warnings.showwarning = _hear  # type: ignore[assignment]
        _hooked.append(None)
    _hearing.messages = []
    try:
        yield _hearing.messages
    finally:
        del _hearing.messages
        with _hook:
            _hooked.pop()
            if len(_hooked) == 1:
                if warnings.showwarning is _hear:
                    warnings.showwarning = _hooked[0]
                _hooked.clear()


def _hear(message: Any, category: Any, filename: str, lineno: int, *rest: Any) -> None:
    messages = getattr(_hearing, "messages", None)
    if messages is None:
        _hooked[0](message, category, filename, lineno, *rest)
    else:
        messages.append(warnings.WarningMessage(message, category, filename, lineno))


def _portable(error: Exception) -> Exception:
    """The error, or one of its text if it cannot be sent."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
