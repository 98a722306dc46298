"""A leaderboard: this model, other models and models from elsewhere, judged by the same figures on the same materials.

`compare` is here and is read first. `merit` defines the figures, `sphere` the light of the one that is a picture;
`methods` are what is compared; `result` holds what was found and its tables, `figure` its pictures.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from pathlib import Path
from typing import Any

from dsbrdf import _files, _lock, batch
from dsbrdf.comparison.merit import FIGURES, Judge, Merit
from dsbrdf.comparison.methods import METHODS, Folder, Method, content_of, key_of, n_parameters
from dsbrdf.comparison.result import MAKER, Comparison, Row, Standing

__all__ = [
    "FIGURES",
    "FILES",
    "METHODS",
    "Comparison",
    "Folder",
    "Judge",
    "Merit",
    "Method",
    "Row",
    "Standing",
    "compare",
]

#: What is written: all rows, tables of medians and of materials, error against numbers, and spheres.
FILES = ("compare.csv", "compare.md", "compare.png", "worst.png")
#: Circles, and points of each, of spheres that are shown.
FINE = (40, 72)
LOCK = ".dsbrdf-compare.lock"
Peer = Method | Folder
Heard = tuple[str, type[Warning]]
Answer = tuple[list[Row], Sequence[Heard]]


def compare(
    targets: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    *,
    methods: Sequence[str] | None = None,
    neural: str | Path | None = None,
    add: Mapping[str, str | Path | Callable[[Any], Any]] | None = None,
    reading: Mapping[str, Any] | None = None,
    executor: Callable[[], Executor] | None = None,
    worst: int = 0,
    force: bool = False,
    done: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Fit methods to measured files and judge all by the same figures, those of `dsbrdf.comparison.merit`.

    Run again with the same `out`, it keeps what was found for files that are the same, by the same version of the
    package. Stopped at any time it leaves a whole table of the materials that were finished. What fails is a row that
    says why.

    Parameters
    ----------
    targets : str, Path, or sequence of them
        Measured files, folders of them, or names of built-in materials.
    out : str or Path, optional
        Folder for `compare.csv`, a line for each material and method; `compare.md`, tables; and, with matplotlib,
        `compare.png`, error against number of parameters.
    methods : sequence of str, optional
        Of "standard" and "compact" (`dsbrdf.fit`), "slices" (`dsbrdf.paper.fit_slices`), "ggx", "fresnel", "ggx-pair"
        and "bivariate" (`dsbrdf.baselines`). All by default.
    neural : str or Path, optional
        Folder of weights of neural BRDFs, named like the materials: NAME.h5, or NAME_fc1.npy to NAME_b3.npy. They are
        judged as tables on the grid of MERL.
    add : mapping, optional
        By the label it gets, a folder of models NAME.json, or of any model as a table NAME.binary; or a function of
        what was measured that gives something with `eval`.
    reading : mapping, optional
        Options of `dsbrdf.read`, for all files.
    executor : callable, optional
        Makes a pool of processes to work in, a material at a time, such as `concurrent.futures.ProcessPoolExecutor`;
        this process by default.
    worst : int, optional
        Write to `out` also `worst.png`, spheres of so many materials with the greatest cbrt by the first method; they
        are fitted again.
    force : bool, optional
        Fit again what could be kept, and replace files in `out` that others have made.
    done : callable, optional
        Called with the name of each material that is finished.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        If a method is unknown, two have the same label, there is no folder of models, or a folder in `targets` has no
        measured file.
    FileExistsError
        If a file in `out` was made by others.
    BusyError
        If another run is writing to `out`.
    OSError
        If a file in `out` cannot be written.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.compare("matte", methods=["compact", "ggx"])
    >>> found.standings[0].method
    'dsbrdf.fit, compact'
    """
    given = [targets] if isinstance(targets, str | Path) else list(targets)
    files, failures = batch.expand(given)
    peers = _peers(methods, neural, add or {})
    folder = None if out is None else Path(out)
    broken = [Row("", "", status=failure.status, file=failure.target) for failure in failures]
    if not files:
        nothing = "nothing to compare: give files or names of materials."
        raise ValueError(failures[0].status if failures else nothing)
    by_file: dict[int, list[Row]] = {}
    work = functools.partial(_judged, peers=peers, reading=dict(reading or {}))
    with _held(folder, force=force) as kept:
        for index, rows, heard in _worked(work, files, {} if force else kept, executor):
            for text, category in heard:
                warnings.warn(text, category, stacklevel=2)
            by_file[index] = rows
            found = Comparison([row for i in sorted(by_file) for row in by_file[i]] + broken)
            if folder is not None:
                found.save(folder / FILES[0])
            done(files[index])
        if folder is not None:
            _write(found, folder)
            cbrt = {
                i: next((r.cbrt for r in rows if r.method == peers[0].label), -1.0)
                for i, rows in by_file.items()
            }
            last = sorted((i for i in cbrt if cbrt[i] >= 0.0), key=lambda i: -cbrt[i])[:worst]
            if last:
                _draw_spheres([files[i] for i in last], peers, reading or {}, folder / FILES[3])
    for peer in peers:
        if isinstance(peer, Folder) and all(row.method != peer.label for row in found.rows):
            warnings.warn(f"{peer.folder}: no model in it is named like one of the materials.", stacklevel=2)
    return found


def _peers(
    methods: Sequence[str] | None,
    neural: str | Path | None,
    add: Mapping[str, str | Path | Callable[[Any], Any]],
) -> list[Peer]:
    names = list(METHODS) if methods is None else list(methods)
    if unknown := [name for name in names if name not in METHODS]:
        raise ValueError(f"unknown method {unknown[0]!r}: expected some of {', '.join(METHODS)}.")
    folders = {} if neural is None else {"neural BRDF": neural}
    peers: list[Peer] = [METHODS[name] for name in dict.fromkeys(names)]
    for label, what in {**folders, **add}.items():
        if callable(what):
            peers.append(Method(label, what))
            continue
        if not Path(what).is_dir():
            raise ValueError(f"{what}: no folder. Expected one of models that are named like the materials.")
        peers.append(Folder(label, Path(what)))
    labels = [peer.label for peer in peers]
    if not labels or len(set(labels)) < len(labels):
        raise ValueError(f"expected methods of different labels, got {', '.join(labels) or 'none'}.")
    return peers


@contextlib.contextmanager
def _held(folder: Path | None, *, force: bool) -> Iterator[dict[tuple[str, str], Row]]:
    """Keep other runs out of the folder; rows of an earlier run by key and method."""
    if folder is None:
        yield {}
        return
    for name in FILES:
        _files.check_replaceable(folder / name, force=force)
    with _lock.held(folder / LOCK):
        path = folder / FILES[0]
        rows = Comparison.load(path).rows if path.is_file() else ()
        yield {(row.key, row.method): row for row in rows if row.ok and row.key and row.version == _version()}


def _version() -> str:
    from dsbrdf import __version__

    return f"{MAKER} {__version__}"


def _worked(
    work: Callable[..., Answer],
    files: Sequence[str],
    kept: Mapping[tuple[str, str], Row],
    executor: Callable[[], Executor] | None,
) -> Iterator[tuple[int, list[Row], Sequence[Heard]]]:
    """Rows of each file and what was warned of, as they come."""
    if executor is None:
        for index, file in enumerate(files):
            yield index, *work(file, kept)
        return
    with executor() as pool:
        try:
            futures = {pool.submit(work, file, kept): index for index, file in enumerate(files)}
            for future in as_completed(futures):
                index = futures[future]
                try:
                    yield index, *future.result()
                except BrokenExecutor as error:
                    path = Path(files[index])
                    yield index, [Row(path.stem, "", status=f"a process ended: {error}", file=path.name)], ()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _judged(
    target: str, kept: Mapping[tuple[str, str], Row], *, peers: Sequence[Peer], reading: Mapping[str, Any]
) -> Answer:
    """Rows of one file, and what was warned of when it was read."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        rows = _rows(target, kept, peers, reading)
    return rows, [(str(warning.message), warning.category) for warning in heard]


def _rows(
    target: str, kept: Mapping[tuple[str, str], Row], peers: Sequence[Peer], reading: Mapping[str, Any]
) -> list[Row]:
    """Rows of one file: fits and judges what is not kept, by the methods that have a model of it."""
    path = Path(target)
    plain = path.name if path.exists() else target
    try:
        content = content_of(path) if path.is_file() else ""
        if not any(isinstance(peer, Folder) for peer in peers):
            keys = [(key, label) for label, (_, key) in _wanted(content, peers, "", reading).items()]
            if set(keys) <= set(kept):
                return [kept[key] for key in keys]
        # What there is in a folder of models depends on the name
        measured = batch.open_target(target, reading)
        wanted = _wanted(content, peers, measured.name, reading)
        judge = None if {(key, label) for label, (_, key) in wanted.items()} <= set(kept) else Judge(measured)
    except Exception as error:
        return [Row(path.stem, "", status=_reason(error), file=plain)]
    rows = []
    for label, (peer, key) in wanted.items():
        if judge is None or (key, label) in kept:
            rows.append(dataclasses.replace(kept[key, label], material=measured.name, file=plain))
            continue
        row = Row(measured.name, label, file=plain, version=_version())
        try:
            start = time.process_time()
            model = peer.model(measured)
            seconds = time.process_time() - start if isinstance(peer, Method) else math.nan
            figures: dict[str, Any] = judge.merit(model).summary()
            row = dataclasses.replace(
                row, key=key, n_parameters=n_parameters(model), seconds=seconds, **figures
            )
        except Exception as error:
            row = dataclasses.replace(row, status=_reason(error))
        rows.append(row)
    return rows


def _wanted(
    content: str, peers: Sequence[Peer], name: str, reading: Mapping[str, Any]
) -> dict[str, tuple[Peer, str]]:
    """By label, the methods that have a model of a material, and what their rows are known by: empty without a file."""
    keys = {peer.label: (peer, peer.key(name)) for peer in peers}
    return {
        label: (peer, key_of([content, of_peer], reading) if content else "")
        for label, (peer, of_peer) in keys.items()
        if of_peer is not None
    }


def _reason(error: Exception) -> str:
    return " ".join(batch.describe(error).split())


def _write(found: Comparison, folder: Path) -> None:
    with _files.aside(folder / FILES[1]) as part:
        heading = f"Comparison by {_version()}; the figures are defined in dsbrdf.comparison.merit.\n\n"
        part.write_text(heading + found.to_markdown(), encoding="utf-8", newline="\n")
    with contextlib.suppress(ModuleNotFoundError):
        from dsbrdf import plot
        from dsbrdf.comparison.figure import draw

        plot.write_figure(draw(found), folder / FILES[2])


def _draw_spheres(
    files: Sequence[str], peers: Sequence[Peer], reading: Mapping[str, Any], path: Path
) -> None:
    """Spheres of measurements and of all methods that have a model of them."""
    from dsbrdf import plot
    from dsbrdf.comparison.figure import draw_spheres

    rows = []
    for file in files:
        measured = batch.open_target(file, reading)
        judge = Judge(measured)
        if judge.is_table:
            tiles = [("measured", judge.look(judge.truth, FINE))]
            for peer, _ in _wanted("", peers, measured.name, reading).values():
                tiles.append((peer.label, judge.look(peer.model(measured), FINE)))
            rows.append((measured.name, tiles))
    plot.write_figure(draw_spheres(rows), path)
