"""Scattered samples as text: comma, semicolon, tab or blank between columns that a header or the caller names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.samples import SKIPPED, Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_text", "read_text"]

#: Longer lines are no table of samples.
MAX_LINE = 100_000
_BLOCK = 1 << 20


def is_text(head: bytes) -> bool:
    """Whether a file that begins with `head` may be a text file."""
    control = set(head) - set(range(32, 256)) - set(b"\t\n\r\f")
    return (bool(head) and not control and head[:3].isascii()) or head[:3] == b"\xef\xbb\xbf"


def read_text(path: str | Path, columns: Sequence[str] | None = None) -> Samples:
    """Read scattered samples from CSV, TSV or columns of text.

    Parameters
    ----------
    path : str or Path
        One sample a line. Lines that begin with # are comments; the last before the numbers may be the header.
    columns : sequence of str, optional
        Names of the columns, instead of the header's; "-" leaves one out. See `samples_from_columns` for the
        names.

    Returns
    -------
    Samples

    Raises
    ------
    ValueError
        If there is no header, a column is not a number, or a direction is missing; says which.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    _check_lines(path)
    layout = _layout(path, columns)
    if not layout.names:
        raise ValueError(
            f"{path}: no header. Name the columns, as in columns=['theta_i_deg', 'theta_o_deg', 'phi_o_deg', 'value']."
        )
    if len(layout.names) != layout.n_columns:
        raise ValueError(
            f"{path}: {len(layout.names)} names of columns, but {layout.n_columns} columns in line {layout.first + 1}."
        )
    used = _used(layout.names)
    folded = [layout.names[i].strip().lower() for i in used]
    twice = [name for name in folded if folded.count(name) > 1]
    if twice:
        raise ValueError(f"{path}: column {twice[0]} is there twice. Leave one out as '{SKIPPED}'.")
    options: dict[str, Any] = {"delimiter": layout.delimiter, "skiprows": layout.first, "usecols": used}
    try:
        table = np.loadtxt(path, **options, ndmin=2, encoding="utf-8-sig")
    except ValueError as error:
        raise ValueError(f"{path}: not a table of numbers from line {layout.first + 1} on: {error}") from None
    by_name = {layout.names[i]: table[:, k] for k, i in enumerate(used)}
    return samples_from_columns(by_name, path.stem, Source(path))


def _check_lines(path: Path) -> None:
    """Refuse a file without lines before it is parsed."""
    _files.regular_size(path)
    since = 0
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            ends = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n"))
            gaps = np.diff(ends, prepend=-1 - since)
            since = len(block) - 1 - int(ends[-1]) if ends.size else since + len(block)
            longest = max(int(gaps.max(initial=0)), since)
            if longest > MAX_LINE:
                raise ValueError(f"{path}: not a table of samples: a line has more than {MAX_LINE:,} bytes.")
            if b"\0" in block:
                raise ValueError(f"{path}: not a table of samples: it holds a byte that is no text.")


class _Layout(NamedTuple):
    """How the lines of a file are to be read."""

    names: list[str]
    delimiter: str | None
    first: int  # line of numbers, from 0
    n_columns: int  # in it


def _layout(path: Path, columns: Sequence[str] | None) -> _Layout:
    """Names are those given, or of the line before the numbers, or of the comment before them."""
    comment, header = "", None
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for index, line in enumerate(file):
            text = line.split("#")[0].strip()
            if not text:
                comment = line.strip("# \t\r\n") or comment
                continue
            delimiter = next((mark for mark in "\t;," if mark in text), None)
            cells = _split(text, delimiter)
            used = range(len(cells)) if columns is None else _used(columns)
            if header is None and not all(_is_number(cells[i]) for i in used if i < len(cells)):
                header = cells
                continue
            named = _split(comment, delimiter)
            if len(named) != len(cells) or any(map(_is_number, named)):
                named = []
            names = list(columns) if columns is not None else header or named
            return _Layout(names, delimiter, index, len(cells))
    raise ValueError(
        f"{path}: no samples: expected lines of numbers after a header and comments, or another format."
    )


def _used(names: Sequence[str]) -> list[int]:
    return [i for i, name in enumerate(names) if name.strip() != SKIPPED]


def _split(text: str, delimiter: str | None) -> list[str]:
    return [cell.strip() for cell in text.split(delimiter)]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
