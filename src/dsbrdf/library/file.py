"""Libraries on disk: one file of many models, of which only the list of names is read when it is opened.

All numbers are little-endian. The file is::

    8 bytes            b"dsbrdfL1"
    uint32, uint32     bytes of the header, number of materials n
    header             JSON: "names" (n of them), "sources" (what is known of each source of measurements, by name),
                       "azimuthal_width"
    (n + 1) uint64     where the records begin, from the beginning of the file; the last is where the file ends
    n records          uint16 bytes of text; JSON text: "channels", "source", "fit", "errors", "sizes" (lobes and
                       coefficients of scale, gamma, beta, falloff and colour); float32 numbers: scale, gamma, beta,
                       falloff (lobe, coefficient), colour (channel, lobe, coefficient)

A model of five lobes and three channels has 100 numbers and takes 0.7 kB.
"""

from __future__ import annotations

import difflib
import json
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check, _files, _json
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.measured.source import Source
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.file import records
from dsbrdf.model.lobes import FALLOFF, Lobes, check_stored

__all__ = ["SUFFIX", "Library", "LibraryFormatError", "open", "write"]

SUFFIX = ".dsbrdf"
MAGIC = b"dsbrdfL1"
COUNTS = struct.Struct("<II")
LENGTH = struct.Struct("<H")
#: Most bytes of names and sources, and of a material.
MAX_HEADER, MAX_RECORD = 100_000_000, 20_000_000
CURVES = ("scale", "gamma", "beta", "falloff", "colour")


class LibraryFormatError(ValueError):
    """A file is not a library that this version can read."""


@dataclass(frozen=True, eq=False)
class Library:
    """An open library. Models are read one by one, when they are asked for.

    Parameters
    ----------
    path : Path
    names : tuple of str
        Of the materials.
    sources : mapping
        What is known of each source of measurements (licence, citation), by the description that `model.source` has.
    starts : (n + 1,) ndarray of int
        Where the record of each material begins.

    Examples
    --------
    >>> import dsbrdf
    >>> materials = dsbrdf.library.builtin()
    >>> "nickel" in materials, materials.load("nickel").n_lobes
    (True, 5)
    """

    path: Path
    names: tuple[str, ...]
    sources: Mapping[str, Mapping[str, str]]
    starts: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def load(self, name: str) -> DSBRDF:
        """A material.

        Raises
        ------
        ValueError
            If there is no such material; says which names are near.
        LibraryFormatError
            If its record is damaged.
        OSError
            If the file cannot be read.
        """
        _check.instance(name, str, "name")
        at = self._places.get(name)
        if at is None:
            near = difflib.get_close_matches(name, self.names, n=3)
            hint = f" Near are {', '.join(near)}." if near else ""
            raise ValueError(
                f"{self.path.name}: no material {name!r:.60} among the {len(self)} of this library.{hint}"
            )
        start, end = map(int, self.starts[at : at + 2])
        with self.path.open("rb") as file:
            file.seek(start)
            record = file.read(end - start)
        try:
            return _model(name, record, end - start)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError, struct.error) as error:
            raise LibraryFormatError(
                f"{self.path}: the record of {name!r:.60} is not sound: {error}"
            ) from None

    def __repr__(self) -> str:
        return f"Library({self.path.name}, {len(self)} materials)"


def open(path: str | Path) -> Library:
    """Open a library: the names are read, the models when they are asked for.

    Raises
    ------
    LibraryFormatError
        If the content is no library; says what was expected and found.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "mine.dsbrdf")
    ...     dsbrdf.library.write(path, [dsbrdf.library.load("nickel")])
    ...     names = dsbrdf.library.open(path).names
    >>> names
    ('nickel',)
    """
    path = Path(path)
    size = _files.regular_size(path)
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise LibraryFormatError(
                f"{path}: not a library: it does not begin with {MAGIC!r}. 'dsbrdf.library.write' makes one."
            )
        try:
            n_header, n = COUNTS.unpack(file.read(COUNTS.size))
        except struct.error:
            raise LibraryFormatError(f"{path}: not a whole library: it ends after {size} bytes.") from None
        first = len(MAGIC) + COUNTS.size + n_header + 8 * (n + 1)
        if n_header > MAX_HEADER or first > size:
            raise LibraryFormatError(
                f"{path}: not a whole library: a header of {n_header:,} bytes and {n:,} materials do not go into "
                f"{size:,} bytes."
            )
        header, index = file.read(n_header), file.read(8 * (n + 1))
    starts = np.frombuffer(index, dtype="<u8").astype(np.int64)
    lengths = np.diff(starts)
    if (
        starts[0] != first
        or starts[-1] != size
        or (lengths < LENGTH.size).any()
        or (lengths > MAX_RECORD).any()
    ):
        raise LibraryFormatError(
            f"{path}: not a sound library: the records do not fill the file from byte {first:,} to its end at {size:,}."
        )
    try:
        content = _json.parse(header)
        width, names, sources = (content[key] for key in ("azimuthal_width", "names", "sources"))
        _check_names(names, n)
        if width != AZIMUTHAL_WIDTH:
            raise ValueError(
                f"an azimuthal width of {width!r:.40}, where this version has {AZIMUTHAL_WIDTH}. Fit the materials "
                "again."
            )
        sources = {str(key): {str(a): str(b) for a, b in about.items()} for key, about in sources.items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else error
        raise LibraryFormatError(f"{path}: not a sound library: {what}") from None
    return Library(path, tuple(names), sources, starts)


def write(
    path: str | Path, models: Iterable[DSBRDF], sources: Mapping[str, Mapping[str, str]] | None = None
) -> None:
    """Write a library; it is written aside and renamed.

    Parameters
    ----------
    path : str or Path
    models : iterable of DSBRDF
        With names of their own. Numbers are kept to single precision; profiles are left out.
    sources : mapping, optional
        What is known of each source (licence, citation), by the description that `model.source` has.

    Raises
    ------
    ValueError
        If a name is missing, strange or there twice, or a number is too large for single precision.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import dsbrdf
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "metals.dsbrdf")
    ...     dsbrdf.library.write(path, [dsbrdf.library.load(name) for name in ("nickel", "brass")])
    ...     dsbrdf.library.open(path)
    Library(metals.dsbrdf, 2 materials)
    """
    models = list(models)
    names = [model.name for model in models]
    _check_names(names, len(names))
    records = list(map(_record, models))
    header = json.dumps(
        {
            "names": names,
            "sources": {key: dict(about) for key, about in (sources or {}).items()},
            "azimuthal_width": AZIMUTHAL_WIDTH,
        }
    ).encode()
    first = len(MAGIC) + COUNTS.size + len(header) + 8 * (len(models) + 1)
    starts = first + np.cumsum([0, *map(len, records)])
    with _files.aside(path) as part, part.open("wb") as file:
        file.write(MAGIC + COUNTS.pack(len(header), len(models)) + header + starts.astype("<u8").tobytes())
        file.writelines(records)


def _check_names(names: Any, n: int) -> None:
    """Raise a ValueError unless these are `n` names, all different, that can be names of files."""
    if not isinstance(names, list) or len(names) != n:
        raise ValueError(f"{n:,} materials have no list of as many names.")
    seen: set[str] = set()
    for name in names:
        if type(name) is not str or not name or _files.file_name(name) != name:
            raise ValueError(
                f"{name!r:.60} is no name of a material: expected what can be the name of a file on any system, up to "
                "200 bytes of printable characters."
            )
        if (key := _files.file_key(name)) in seen:
            raise ValueError(
                f"the name {name!r:.60} is there twice: names must be different, not only in case."
            )
        seen.add(key)


def _record(model: DSBRDF) -> bytes:
    lobes = model.lobes.numpy
    text = json.dumps(
        {
            "channels": list(model.channels),
            "source": {key: value for key, value in model.source.to_json().items() if value},
            "fit": dict(model.fit_options),
            "errors": {
                key: float(f"{value:.4g}") for key, value in model.errors.items() if np.isfinite(value)
            },
            "sizes": [lobes.n_lobes, *(getattr(lobes, curve).shape[-1] for curve in CURVES)],
        },
        separators=(",", ":"),
    ).encode()
    numbers = np.concatenate([getattr(lobes, curve).ravel() for curve in CURVES])
    if np.abs(numbers).max() > np.finfo(np.float32).max or len(text) > 0xFFFF:
        raise ValueError(f"{model.name}: its numbers or its source are too large for a library.")
    return LENGTH.pack(len(text)) + text + numbers.astype("<f4").tobytes()


def _model(name: str, record: bytes, size: int) -> DSBRDF:
    if len(record) != size:
        raise ValueError("the file ends before it. It has changed since it was opened.")
    (n_text,) = LENGTH.unpack(record[: LENGTH.size])
    content = _json.parse(record[LENGTH.size : LENGTH.size + n_text])
    numbers = np.frombuffer(record[LENGTH.size + n_text :], dtype="<f4").astype(np.float64)
    channels, sizes = content["channels"], content["sizes"]
    if len(sizes) != 1 + len(CURVES) or any(type(n) is not int or not 1 <= n <= 10_000 for n in sizes):
        raise ValueError(f"sizes must be six counts, got {sizes!r:.60}.")
    n_lobes, *n_curve = sizes
    shapes = [(n_lobes, n) for n in n_curve[:-1]] + [(len(channels), n_lobes, n_curve[-1])]
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    if ends[-1] != len(numbers):
        raise ValueError(f"expected {ends[-1]} numbers, found {len(numbers)}.")
    parts = [part.reshape(shape) for part, shape in zip(np.split(numbers, ends[:-1]), shapes, strict=True)]
    # Single precision may have rounded the least falloff below its range
    parts[3] = np.clip(parts[3], *FALLOFF)
    lobes = Lobes(*parts)
    check_stored(lobes)
    source, options, errors = records(content)
    return DSBRDF(
        lobes,
        [str(channel) for channel in channels],
        name=name,
        source=Source(description=str(source.get("description", "")), recorded=source),
        fit_options=options,
        errors=errors,
    )
