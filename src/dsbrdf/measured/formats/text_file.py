"""Scattered samples as text: lines of numbers under a header, as laboratories and spreadsheets write them.

In stages: bytes to text (`encoding`), lines to the place of the table (`_find`: header, delimiter, decimal mark,
first line
of numbers), lines to numbers (`_numbers`), and numbers to samples (`samples_from_columns`). Whatever is not
understood is
refused with the line of the file, or left out and said.
"""

from __future__ import annotations

import codecs
import csv
import dataclasses
import itertools
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core, _files
from dsbrdf.measured.names import meaning, unit_of
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import SKIPPED, ReadWarning, Samples, samples_from_columns
from dsbrdf.measured.source import Source

Array: TypeAlias = NDArray[np.float64]
__all__ = ["encoding", "has_numbers", "is_text", "open_lines", "read_text"]

#: Longer lines are no table of samples.
MAX_LINE = 100_000
#: Lines in which the table must begin, and lines between a header and its first numbers.
HEAD, GAP = 2000, 20
#: Bytes that are read at a time.
_BLOCK = 1 << 20
_END = re.compile(rb"\r\n|\n|\r")
_MARKS = ("#", "%", "!", ";", "//", "*")
_DELIMITERS = ("\t", ";", ",", "|", None)
_NUMBER = re.compile(r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdDqQ][-+]?\d+|[-+]\d{2,3})?")
_MISSING = {"", "na", "n/a", "#n/a", "nan", "-nan", "nan(ind)", "-nan(ind)", "#nv", "null", "none", "nil", "-",
        "--", "---", ".", "*",
            "**", "***", "****", "?", "missing", "#div/0!", "#wert!", "#value!", "#num!", "#zahl!", "overload", "ovld",
            "1.#qnan", "1.#ind", "-1.#ind", "1.#snan", "-1.#qnan", "1.#qnan0", "-1.#ind00"}  # fmt: skip
_INFINITE = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf, "infinity": np.inf, "-infinity": -np.inf, "∞": np.inf,
             "-∞": -np.inf, "1.#inf": np.inf, "-1.#inf": -np.inf, "1.#inf00": np.inf, "-1.#inf00": -np.inf}  # fmt: skip
_SIGNS = str.maketrans(
    {"\u2212": "-", "\u2013": "-", "\u2010": "-", "\u2011": "-", "\xa0": " ", "\u202f": " ", "\u2009": " "}
)
_INLINE = re.compile(
    r"\s(?:#(?!N/A|NV|DIV|VALUE|WERT|NUM|ZAHL|REF|NAME)|!|//|%(?=\s*[^\s,;\d])).*$|(?<=[\d\"])#.*$"
)
_UNITS = {"", "deg", "degree", "degrees", "rad", "radian", "radians", "1/sr", "sr-1", "sr^-1", "sr^(-1)",
        "/sr", "°", "º", "-", "nm",
          "um", "%", "percent", "1", "sr⁻¹", "a.u.", "au"}  # fmt: skip
#: The line of ASTM E1392 and E2387 that names the columns; their angles are radians.
_VARS = re.compile(r"^(VARS)\s+(?=\S)", re.IGNORECASE)
_EXAMPLE = (
    "columns=['theta_i_deg', 'theta_o_deg', 'phi_o_deg', 'value'] "
    "(--columns theta_i_deg,theta_o_deg,phi_o_deg,value)"
)


# Bytes to text


def is_text(head: bytes) -> bool:
    """Whether a file that begins with `head` may be a text file."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or _is_utf16(head):
        name = "utf-16" if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else _is_utf16(head)
        text = codecs.getincrementaldecoder(name or "utf-16")(errors="replace").decode(head)
        return (
            len(text) > 1
            and not any(ord(c) < 32 and c not in "\t\n\r\f\x1a" for c in text)
            and _mostly_ascii(text)
        )
    head = head.removeprefix(codecs.BOM_UTF8)
    control = set(head) - set(range(32, 256)) - set(b"\t\n\r\f\x0b\x1a")
    return bool(head) and not control and _mostly_ascii(head.decode("latin-1"))


def _mostly_ascii(text: str) -> bool:
    return sum(c.isascii() for c in text) >= 0.7 * len(text)


def _is_utf16(head: bytes) -> str:
    """Name of the encoding if every other byte is zero, as in UTF-16 without a mark."""
    head = head[: len(head) // 2 * 2]
    for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if len(head) >= 8 and zeros.count(0) > 0.9 * len(zeros):
            return name
    return ""


def encoding(path: Path) -> str:
    """Encoding of a text file: UTF-16 or UTF-8 where its bytes say so, else the one of Windows in western Europe.

    Raises
    ------
    ValueError
        If it is no text, or has a line of more than `MAX_LINE` bytes, so that memory is safe.
    OSError
        If the file cannot be read.
    """
    _files.regular_size(path)
    with path.open("rb") as file:
        head = file.read(4096)
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            name = "utf-16"
        else:
            name = _is_utf16(head) or "utf-8-sig"
        file.seek(0)
        decoder = codecs.getincrementaldecoder("utf-8")()
        since = 0
        while block := file.read(_BLOCK):
            data = np.frombuffer(block, np.uint8)
            ends = np.flatnonzero((data == 10) | (data == 13))
            gaps = np.diff(ends, prepend=-1 - since)
            since = len(block) - 1 - int(ends[-1]) if ends.size else since + len(block)
            if max(int(gaps.max(initial=0)), since) > MAX_LINE:
                raise ValueError(f"{path}: not a table of samples: a line has more than {MAX_LINE:,} bytes.")
            if name == "utf-8-sig":
                if b"\0" in block:
                    raise ValueError(f"{path}: not a table of samples: it holds a byte that is no text.")
                try:
                    decoder.decode(block)
                except UnicodeDecodeError:
                    name = "cp1252"
            elif name == "cp1252" and b"\0" in block:
                raise ValueError(f"{path}: not a table of samples: it holds a byte that is no text.")
    return name


def open_lines(path: Path, name: str) -> Iterator[tuple[int, str]]:
    """Lines of a text file in some encoding and with any line ends, and their numbers from 1."""
    with path.open(encoding=name, errors="replace", newline=None) as file:
        yield from enumerate((line.rstrip("\n") for line in file), start=1)


def has_numbers(path: Path) -> bool:
    """Whether a text file has a line of three numbers near its beginning, and may be a table."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(4096)
    try:
        lines = list(itertools.islice(open_lines(path, encoding(path)), HEAD)) if is_text(head) else []
    except ValueError:
        return False
    rows = (
        _cells(line.strip(), mark)
        for _, line in lines
        for mark in _DELIMITERS
        if mark is None or mark in line
    )
    try:
        return any(sum(map(_is_number, cells)) >= 3 for cells in rows)
    except csv.Error:
        return False


# Reading


def read_text(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read scattered samples from lines of text.

    Parameters
    ----------
    path : str or Path
        One sample a line, under a header that names the columns; the page on formats says what is understood.
    options : ReadOptions, optional
        What the caller says about it.

    Returns
    -------
    Samples

    Raises
    ------
    ValueError
        If there is no header, a cell is no number, or a column is not understood; says which line of the file.
    OSError
        If the file cannot be read.

    Warns
    -----
    ReadWarning
        As `samples_from_columns`.
    """
    path, options = Path(path), options or ReadOptions()
    name = encoding(path)
    try:
        table = _find(list(itertools.islice(open_lines(path, name), HEAD)), options, path)
        numbers, numbered = _numbers(path, name, table)
    except csv.Error as error:
        raise ValueError(f"{path}: not a table of samples: {error}.") from None
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    used = [table.names[i] for i in table.used]
    if _VARS.match(table.header) and not any(meaning(name).unit for name in used):
        numbers, used = _astm(numbers, used, table)
    if twice := [name for name in used if used.count(name) > 1]:
        raise ValueError(
            f"{path}: column {twice[0]} is there twice. Name all columns with columns=[...] (--columns), "
            f"'{SKIPPED}' for one to "
            "leave out."
        )
    columns = dict(zip(used, numbers.T, strict=True))
    # Left out already, if it is there
    options = dataclasses.replace(options, ignore=[x for x in options.ignore if not _has(table.names, x)])
    samples = samples_from_columns(
        columns, path.stem, Source(path), options, lines=numbered, remarks=table.remarks
    )
    for text in table.left_out:
        warnings.warn(f"{path.stem}: {text}", ReadWarning, stacklevel=2)
    return samples


def _astm(numbers: Array, names: list[str], table: _Table) -> tuple[Array, list[str]]:
    """Columns of ASTM E1392 and E2387 with their unit."""
    angles = [i for i, name in enumerate(names) if meaning(name).kind == "angle"]
    unit = "deg" if np.nanmax(np.abs(numbers[:, angles]), initial=0.0) > 2.0 * np.pi + 0.01 else "rad"
    table.remarks.append(
        f"ASTM E1392 / E2387: angles in {'degrees' if unit == 'deg' else 'radians'}, azimuths taken as they stand"
    )
    return numbers, [f"{name} [{unit}]" if i in angles else name for i, name in enumerate(names)]


def _has(names: Sequence[str], name: str) -> bool:
    return any(x.strip().lower() == name.strip().lower() for x in names if name.strip())


@dataclass
class _Table:
    """Where the table is, and how its lines are to be read."""

    names: list[str]
    used: list[int]
    delimiter: str | None
    header: str
    rest: list[tuple[int, str]]
    remarks: list[str]
    directions: list[int]
    comma: bool = False
    left_out: list[str] = field(default_factory=list)

    @property
    def n(self) -> int:
        """Number of columns."""
        return len(self.names)

    @property
    def first(self) -> int:
        """Number of the first line of numbers."""
        return self.rest[0][0]


# Lines to the place of the table


def _find(head: list[tuple[int, str]], options: ReadOptions, path: Path) -> _Table:
    """The table: under the last header before its first numbers, or where the caller's columns fit."""
    forced: tuple[str | None, ...] = _DELIMITERS
    if head and (match := re.fullmatch(r"\ufeff?sep=(.)", head[0][1].strip(), re.IGNORECASE)):
        forced, head = (match[1],), head[1:]
    if options.columns is not None:
        return _find_given(head, options.columns, forced, path)
    best: tuple[int, list[str]] | None = None
    found: _Table | None = None
    for at, (number, line) in enumerate(head):
        if found is not None and number >= found.first:
            break
        for names in _headers(line, forced):
            table = _under(names, line, head[at + 1 :], forced, options)
            if table is not None:
                found = table
                break
            best = best or (at, names)
    if found is None:
        raise ValueError(f"{path}: {_why_not(head, best, forced)}")
    found.comma = _has_decimal_comma(found)
    return found


def _headers(line: str, forced: Sequence[str | None]) -> list[list[str]]:
    """Names that a line may be the header of, the most telling first; none if it names no direction."""
    text = line.strip().translate(_SIGNS)
    while text.startswith(_MARKS):
        text = text[2:].lstrip() if text.startswith("//") else text[1:].lstrip()
    text = re.sub(r"^(VARIABLES\s*=|columns?:)\s*", "", _VARS.sub("", text), flags=re.IGNORECASE)
    if not text or len(text) > 20_000:
        return []
    scored = []
    for delimiter in (*forced, "  "):
        if delimiter == "  ":
            names = re.split(r"\s{2,}|\t", text)
        elif delimiter is None:
            # A unit in brackets belongs to the name before it
            names = [name for name in re.split(r"\s+(?![\[(])", text) if name != "="]
        elif delimiter in text:
            names = _cells(text, delimiter)
        else:
            continue
        names = [name.strip().strip("\"'").strip() for name in names]
        keys = [(m.kind, m.key) for m in map(meaning, names) if m.kind in ("angle", "vector")]
        if keys and len(names) > 1 and not any(map(_is_decimal, names)):
            known = sum(meaning(name).kind != "unknown" for name in names)
            scored.append((len(set(keys)), known - len(names), names))
    scored.sort(key=lambda item: item[:2], reverse=True)
    return [names for _, _, names in scored]


def _is_decimal(name: str) -> bool:
    """Whether a name is a number that is no wavelength."""
    return _is_number(name) and meaning(name).kind != "channel"


def _under(
    names: list[str],
    header: str,
    rest: list[tuple[int, str]],
    forced: Sequence[str | None],
    options: ReadOptions,
) -> _Table | None:
    """The table under a header, if numbers in as many columns follow."""
    units: list[str] | None = None
    gap = 0
    for at, (_, line) in enumerate(rest):
        text = line.strip().translate(_SIGNS)
        if not text:
            continue
        cut = _bare(text)
        for delimiter in forced:
            if not cut or (delimiter is not None and delimiter not in cut):
                continue
            cells = _cells(cut, delimiter)
            if (fitted := _fitted(names, cells)) is None:
                continue
            directions = _directions(fitted, options)
            told = all(_is_number(cells[i]) or _is_missing(cells[i]) for i in directions)
            if told and any(map(_is_number, cells)):
                named, remarks = _with_units(fitted, units)
                used = [i for i in range(len(named)) if not _ignored(named[i], options)]
                return _Table(named, used, delimiter, header.strip(), rest[at:], remarks, directions)
            if units is None and all(cell.lower().strip("[]() ") in _UNITS for cell in cells):
                units = cells
        gap += 1
        if gap > GAP:
            return None
    return None


def _fitted(names: list[str], cells: list[str]) -> list[str] | None:
    """Names for as many cells: both may end with a delimiter."""
    if len(cells) > len(names) and not any(cells[len(names) :]):
        return names + [""] * (len(cells) - len(names))
    while len(names) > len(cells) and not names[-1]:
        names = names[:-1]
    return list(names) if len(names) == len(cells) else None


def _with_units(names: list[str], units: list[str] | None) -> tuple[list[str], list[str]]:
    """Names with the units of a line of their own, where they say none."""
    remarks: list[str] = []
    empty = [i for i, name in enumerate(names) if not name]
    # Names must differ; a second one without a name is left out later, if it holds nothing
    for k, i in enumerate(empty[1:], start=2):
        names[i] = f"Unnamed: {k}"
    if units is None:
        return names, remarks
    named = []
    for name, unit in zip(names, units + [""] * len(names), strict=False):
        unit = unit.strip("[]() ")
        means = meaning(name)
        if means.kind == "angle" and means.unit and unit not in ("", "-") and unit_of(unit) != means.unit:
            raise ValueError(f"column {name}: the line below says {unit}. Correct one of them.")
        wanted = unit not in ("", "-", "1") and not means.unit and means.kind not in ("index", "unknown")
        named.append(f"{name} [{unit}]" if wanted else name)
    return named, ["a line of units was read"]


def _ignored(name: str, options: ReadOptions) -> bool:
    folded = {x.strip().lower() for x in options.ignore}
    return name.strip() == SKIPPED or bool(name.strip() and name.strip().lower() in folded)


def _directions(names: Sequence[str], options: ReadOptions) -> list[int]:
    """Columns that hold directions, which must be numbers."""
    return [
        i for i, x in enumerate(names) if meaning(x).kind in ("angle", "vector") and not _ignored(x, options)
    ]


def _find_given(
    head: list[tuple[int, str]], columns: Sequence[str], forced: Sequence[str | None], path: Path
) -> _Table:
    """The table whose first line has numbers in all of the columns that the caller names."""
    names = [name.strip() for name in columns]
    used = [i for i, name in enumerate(names) if name != SKIPPED]
    folded = [names[i].lower() for i in used]
    if twice := [name for name in folded if folded.count(name) > 1]:
        raise ValueError(f"{path}: column {twice[0]} is there twice. Leave one out as '{SKIPPED}'.")
    directions = [i for i in used if meaning(names[i]).kind in ("angle", "vector")]
    near: tuple[int, int, str] | None = None
    for at, (number, line) in enumerate(head):
        text = _bare(line.strip().translate(_SIGNS))
        for delimiter in forced:
            if not text or (delimiter is not None and delimiter not in text):
                continue
            cells = _cells(text, delimiter)
            if len(cells) > len(names) and not any(cells[len(names) :]):
                cells = cells[: len(names)]
            numeric = sum(map(_is_number, cells))
            fits = len(cells) == len(names) and all(
                _is_number(cells[i]) or _is_missing(cells[i]) for i in used
            )
            if fits and any(_is_number(cells[i]) for i in used):
                table = _Table(names, used, delimiter, "", head[at:], [], directions)
                table.comma = _has_decimal_comma(table)
                return table
            if numeric > len(cells) // 2 and (
                near is None or abs(len(cells) - len(names)) < abs(near[0] - len(names))
            ):
                near = (len(cells), number, line)
    if near is None:
        raise ValueError(
            f"{path}: no samples: expected lines of {len(names)} numbers, as named by columns (--columns)."
        )
    raise ValueError(
        f"{path}: {len(names)} names of columns, but {near[0]} columns in line {near[1]}: {_shown(near[2])}. "
        f"Name each of "
        f"them, '{SKIPPED}' for one to leave out."
    )


def _why_not(
    head: list[tuple[int, str]], best: tuple[int, list[str]] | None, forced: Sequence[str | None]
) -> str:
    """Why there is no table."""
    start = 0 if best is None else best[0] + 1
    for number, line in head[start:]:
        text = _bare(line.strip().translate(_SIGNS))
        for delimiter in forced:
            if not text or (delimiter is not None and delimiter not in text):
                continue
            cells = _cells(text, delimiter)
            numeric = sum(map(_is_number, cells))
            if numeric < 2 or numeric <= len(cells) // 2:
                continue
            if best is not None:
                where = f"in line {number}: {_shown(line)}"
                if len(cells) != len(best[1]):
                    counts = f"{len(best[1])} names of columns, but {len(cells)} columns"
                    return f"{counts} {where}.{_hints(head)} Name the columns with {_EXAMPLE}."
                bad = next((c for c in cells if not _is_number(c)), "")
                remedy = "Leave the line out, or the column with ignore=[...] (--ignore)."
                return f"not a table of numbers: {bad!r:.40} {where}. {remedy}"
            previous = next((x.strip() for n, x in reversed(head) if n < number and x.strip()), "")
            other = (
                f"; line above the numbers: {_shown(previous)}"
                if previous and not _is_number(previous[:1])
                else ""
            )
            hint = _hints(head)
            return (
                f"no header that names a direction before the numbers in line {number}: {_shown(line)}{other}. "
                f"Name the "
                f"columns, as in {_EXAMPLE}.{hint} Expected {_expected()}."
            )
    return "no samples: expected lines of numbers after a header and comments, or another format."


def _expected() -> str:
    from dsbrdf.measured.directions import EXPECTED

    return f"columns {EXPECTED}"


def _hints(head: list[tuple[int, str]]) -> str:
    """Angles that stand above the table, as settings."""
    found = []
    for _, line in head[:200]:
        match = re.fullmatch(
            r"\W*([A-Za-z_ ]{3,30}?(?:\s*[\[(][^\])]*[\])])?)\s*[:=,;\t]\s*([-+\d.]+)\s*(deg|rad|°)?\W*",
            line.strip(),
        )
        if match and meaning(match[1]).kind == "angle" and _is_number(match[2]):
            found.append(f"--set {meaning(match[1]).key}_{meaning(match[1]).unit or 'deg'}={match[2]}")
    return f" Above the table stand angles, which you can add by {' '.join(found[:3])}." if found else ""


def _shown(line: str) -> str:
    text = "".join(c if c.isprintable() else " " for c in line.strip())
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")


def _has_decimal_comma(table: _Table) -> bool:
    """Whether numbers have a decimal comma; says so where it may part thousands instead."""
    found = []
    for _, line in table.rest:
        if "," not in line or (table.delimiter == "," and '"' not in line):
            continue
        cells = _cells(_bare(line.strip().translate(_SIGNS)), table.delimiter)
        if len(cells) == table.n:
            found += [cells[i] for i in table.used if "," in cells[i] and _is_number(cells[i])]
    if found and all(map(_THOUSANDS.fullmatch, found)):
        table.left_out.append(
            f"numbers such as {found[0]!r} are read with a decimal comma. If it parts thousands, remove it."
        )
    return bool(found)


# Lines to cells, cells to numbers


def _bare(text: str) -> str:
    """A line without comments."""
    if text.startswith(_MARKS) and not text.startswith("*,"):
        return ""
    return _INLINE.sub("", text).strip(" ") if any(mark in text for mark in "#%!/") else text


def _cells(text: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return text.replace('"', " ").split()
    if '"' in text:
        text = next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])  # type: ignore[assignment]
        return [cell.strip() for cell in text]
    return [cell.strip() for cell in text.split(delimiter)]


def _is_missing(cell: str) -> bool:
    return cell.lower() in _MISSING


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell.removesuffix("°").strip()) is not None or cell.lower() in _INFINITE


def _number(cell: str, comma: bool) -> float | None:
    """The number of a cell, NaN if it is missing, None if it is neither."""
    if comma and "." in cell and _NUMBER.fullmatch(cell):
        return None
    try:
        if "_" not in cell and cell.isascii():
            return float(cell)
    except ValueError:
        pass
    if _is_missing(cell):
        return np.nan
    cell = cell.removesuffix("°").strip().strip("'")
    if cell.lower() in _INFINITE:
        return _INFINITE[cell.lower()]
    if not _NUMBER.fullmatch(cell) or ("," in cell) > comma or ("." in cell and comma):
        return None
    text = re.sub(r"[dDqQ]", "e", cell.replace(",", "."))
    # An exponent of three digits may lack its letter in Fortran
    return float(re.sub(r"(?<=[\d.])([-+]\d{2,3})$", r"e\1", text))


def _numbers(path: Path, name: str, table: _Table) -> tuple[Array, NDArray[np.int64]]:
    """Numbers (line, column) of the table in a file of some encoding, and the numbers of their lines."""
    parts: list[Array] = []
    numbered: list[NDArray[np.int64]] = []
    careful = _Careful(table, path)
    mark = None if table.delimiter is None else ord(table.delimiter)
    for first, block in _blocks(path, name, table.first):
        plain = None
        if not careful.waiting and (mark is None or mark < 128):
            plain = _core.plain_numbers(block, mark, table.n, table.used, table.comma)
        if plain is not None:
            at = np.arange(first, first + len(plain))
        else:
            text = block.decode("cp1252" if name == "cp1252" else "utf-8", errors="replace")
            rows, lines = careful.rows(enumerate(re.split(r"\r\n|\n|\r", text), start=first))
            plain = np.array(rows, dtype=float).reshape(len(rows), len(table.used))
            at = np.array(lines, dtype=np.int64)
        parts.append(plain)
        numbered.append(at)
    careful.end()
    return np.concatenate(parts), np.concatenate(numbered)


def _blocks(path: Path, name: str, first: int) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole lines from the `first` on, not in UTF-16, and the numbers of their first lines."""
    decoder = codecs.getincrementaldecoder(name)(errors="replace") if name.startswith("utf-16") else None
    number, pending = 1, b""
    with path.open("rb") as file:
        while raw := file.read(_BLOCK):
            data = pending + (raw if decoder is None else decoder.decode(raw).encode())
            # A carriage return at the end may have its line feed in the next block
            cut = data.rfind(b"\n") + 1 or data.rfind(b"\r", 0, -1) + 1
            block, pending = data[:cut], data[cut:]
            while number < first and (end := _END.search(block)) is not None:
                block, number = block[end.end() :], number + 1
            if block:
                yield number, block
                number += _count(block)
    if pending and number >= first:
        yield number, pending


def _count(block: bytes) -> int:
    n_returns = block.count(b"\r")
    return block.count(b"\n") + (n_returns - block.count(b"\r\n") if n_returns else 0)


class _Careful:
    """Lines one by one: comments, missing cells, numbers of all kinds, and what ends the table."""

    def __init__(self, table: _Table, path: Path) -> None:
        self.table = table
        self.path = path
        #: Lines of text since the last numbers.
        self.waiting: list[tuple[int, str]] = []

    def rows(self, block: Iterable[tuple[int, str]]) -> tuple[list[list[float]], list[int]]:
        """Numbers of some lines, and the numbers of these lines."""
        rows, numbered = [], []
        for number, line in block:
            text = _bare(line.strip().translate(_SIGNS).strip("\x1a"))
            if not text or text == self.table.header.translate(_SIGNS):
                continue
            cells = _cells(text, self.table.delimiter)
            if (row := self._row(number, line, cells)) is not None:
                rows.append(row)
                numbered.append(number)
        return rows, numbered

    def _row(self, number: int, line: str, cells: list[str]) -> list[float] | None:
        table = self.table
        if len(cells) > table.n and not any(cells[table.n :]):
            cells = cells[: table.n]
        numeric = sum(_is_number(cell) for cell in cells)
        words = len(cells) - numeric - sum(map(_is_missing, cells))
        fits = len(cells) == table.n
        is_row = (
            fits
            and numeric > 0
            and all(_is_number(cells[i]) or _is_missing(cells[i]) for i in table.directions)
        )
        if not is_row and words and 2 * numeric <= len(cells):
            self.waiting.append((number, line))
            return None
        if not fits and not any(cells):
            return None
        if self.waiting and numeric:
            at, text = self.waiting[0]
            raise ValueError(
                f"{self.path}: line {at} stands between lines of numbers: {_shown(text)}. Remove it, begin it "
                f"with #, or split "
                "the file there."
            )
        if not fits:
            raise ValueError(
                f"{self.path}: line {number} has {len(cells)} cells, not {table.n} as the others: "
                f"{_shown(line)}. Is it cut off? "
                "Complete or remove it."
            )
        row = []
        for i in table.used:
            value = _number(cells[i], table.comma)
            if value is None:
                raise ValueError(
                    f"{self.path}: line {number}, column {table.names[i]}: {self._trouble(cells[i])} {_shown(line)}."
                )
            row.append(value)
        return row

    def _trouble(self, cell: str) -> str:
        if _is_number(cell) and ("," in cell or "." in cell):
            return f"{cell!r:.40} has another decimal mark than the numbers before. Use one throughout."
        if cell.endswith("%"):
            return f"{cell!r:.40} is in percent. Write plain numbers, and say scale=... (--scale)."
        return (
            f"{cell!r:.40} is not a number. Correct it, write NaN for no value, or leave the column out with "
            f"ignore=[...] "
            "(--ignore):"
        )

    def end(self) -> None:
        """Say what was left out after the table."""
        if self.waiting:
            number, text = self.waiting[0]
            many = "line" if len(self.waiting) == 1 else f"{len(self.waiting)} lines"
            self.table.left_out.append(
                f"{many} after the table left out, from line {number}: {_shown(text)}."
            )
