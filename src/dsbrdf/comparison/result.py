"""What a comparison found: a row for each material and method, medians, and the files it is kept in."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files, _text
from dsbrdf.comparison.merit import FIGURES

__all__ = ["MAKER", "Comparison", "Row", "Standing"]

#: Heads of tables, and digits after the point.
HEADS = {"rel": 3, "cbrt": 3, "log": 3, "albedo": 3, "ciede2000": 2}
#: Methods that a printed result has room for.
SHOWN = 10
#: In the column of the version; by which a later run knows that it may replace the file.
MAKER = "dsbrdf"


@dataclass(frozen=True)
class Row:
    """One material by one method.

    Parameters
    ----------
    material : str
    method : str
        Label of the method; empty if the material could not be read.
    n_parameters : float
        Numbers of the model.
    seconds : float
        Processor time of the fit, without reading; NaN of models that were only judged.
    rel, cbrt, log, albedo, ciede2000 : float
        See `dsbrdf.comparison.merit`.
    status : str
        "ok", or why there are no figures.
    file : str
        Name of the measured file, without its folder, or what else was given.
    key : str
        Stands for the content of the file, the options of reading and, where it came from elsewhere, the model; empty
        if there is no file.
    version : str
        Of the package.

    Examples
    --------
    >>> from dsbrdf.comparison import Row
    >>> Row("nickel", "mine", n_parameters=5, cbrt=0.02).ok
    True
    """

    material: str
    method: str
    n_parameters: float = math.nan
    seconds: float = math.nan
    rel: float = math.nan
    cbrt: float = math.nan
    log: float = math.nan
    albedo: float = math.nan
    ciede2000: float = math.nan
    status: str = "ok"
    file: str = ""
    key: str = ""
    version: str = ""

    @property
    def ok(self) -> bool:
        """Whether there are figures."""
        return self.status == "ok"


@dataclass(frozen=True)
class Standing:
    """Medians of one method.

    Parameters
    ----------
    method : str
    n_materials : int
    n_parameters, seconds, rel, cbrt, log, albedo, ciede2000 : float
        Medians over the materials that have one.
    worst : float
        The greatest cbrt.

    Examples
    --------
    >>> from dsbrdf.comparison import Comparison, Row
    >>> rows = [Row(name, "mine", cbrt=cbrt) for name, cbrt in (("nickel", 0.02), ("brass", 0.04))]
    >>> (standing,) = Comparison(rows).standings
    >>> standing.n_materials, standing.cbrt, standing.worst
    (2, 0.03, 0.04)
    """

    method: str
    n_materials: int
    n_parameters: float
    seconds: float
    rel: float
    cbrt: float
    log: float
    albedo: float
    ciede2000: float
    worst: float


@dataclass(frozen=True, repr=False)
class Comparison:
    """Methods judged by the same figures on the same materials.

    Parameters
    ----------
    rows : sequence of Row
        Materials in the order they were given, each by all methods; also what failed.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.compare(["rough-gold"], methods=["ggx", "bivariate"])
    >>> [standing.method for standing in found.standings]  # the best first
    ['Lambert + GGX', 'bivariate table']
    """

    rows: Sequence[Row]

    @property
    def standings(self) -> list[Standing]:
        """Medians of each method, the least cbrt first."""
        found = []
        for method in dict.fromkeys(row.method for row in self.rows if row.ok):
            rows = [row for row in self.rows if row.ok and row.method == method]
            medians = {name: _median(getattr(row, name) for row in rows) for name in _NUMBERS}
            found.append(Standing(method, len(rows), **medians, worst=max(row.cbrt for row in rows)))
        return sorted(found, key=lambda standing: (not standing.cbrt >= 0.0, standing.cbrt))

    @property
    def failures(self) -> list[Row]:
        """Rows without figures."""
        return [row for row in self.rows if not row.ok]

    @property
    def is_even(self) -> bool:
        """Whether all medians are over the same materials."""
        return len({standing.n_materials for standing in self.standings}) <= 1

    def values(self, name: str) -> dict[str, NDArray[np.float64]]:
        """A column of `rows`, such as "cbrt", of each method, the best method first."""
        return {
            standing.method: np.array(
                [getattr(row, name) for row in self.rows if row.ok and row.method == standing.method]
            )
            for standing in self.standings
        }

    def __repr__(self) -> str:
        standings = self.standings
        n = len({(row.file, row.material) for row in self.rows if row.ok})
        width = max([len("method"), *(len(_text.shown(s.method)[:32]) for s in standings)])
        lines = [f"Comparison of {len(standings)} methods on {n} materials; medians, the least cbrt first:"]
        lines.append(f"{'method':{width}}  numbers  " + "  ".join(f"{head:>6.6}" for head in HEADS))
        for s in standings[:SHOWN]:
            cells = "  ".join(f"{number(getattr(s, head), digits):>6}" for head, digits in HEADS.items())
            lines.append(f"{_text.shown(s.method)[:32]:{width}}  {number(s.n_parameters, 0):>7}  {cells}")
        if len(standings) > SHOWN:
            lines.append(f"... {len(standings) - SHOWN} more")
        if self.failures:
            lines.append(f"{len(self.failures)} without figures: see failures")
        return "\n".join(lines)

    def to_csv(self) -> str:
        """All rows as CSV, a column a field; names are made harmless to spreadsheets."""
        text = io.StringIO()
        writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        for row in self.rows:
            cells = asdict(row)
            writer.writerow({k: _text.csv_cell(v) if isinstance(v, str) else v for k, v in cells.items()})
        return text.getvalue()

    def save(self, path: str | Path) -> None:
        """Write all rows as CSV; aside first, so that the file is whole at any time.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        with _files.aside(path) as part:
            part.write_text(self.to_csv(), encoding="utf-8", newline="\n")

    @classmethod
    def load(cls, path: str | Path) -> Comparison:
        """Read what `save` has written; lines that are none of its rows are passed over.

        Raises
        ------
        ValueError
            If it is a device or a pipe.
        OSError
            If the file cannot be read.
        """
        _files.regular_size(path)
        text = Path(path).read_text(encoding="utf-8", errors="replace")
        rows = []
        try:
            for line in csv.DictReader(io.StringIO(text)):
                row = _row(line)
                if row is not None:
                    rows.append(row)
        except csv.Error:
            pass
        return cls(rows)

    def to_markdown(self) -> str:
        """Medians, and the cbrt of each material by each method, the worst first by the best method."""
        standings = self.standings
        head = ["", "materials", "numbers", "seconds", *HEADS, "worst cbrt"]
        lines = [_line(head), "|---" * len(head) + "|"]
        for s in standings:
            cells = [_text.markdown_cell(s.method), str(s.n_materials)]
            cells += [number(s.n_parameters, 0), number(s.seconds, 2)]
            cells += [number(getattr(s, name), digits) for name, digits in HEADS.items()]
            lines.append(_line([*cells, number(s.worst, 3)]))
        methods = [s.method for s in standings]
        lines += ["", _line(["cbrt", *map(_text.markdown_cell, methods)]), "|---" * (1 + len(methods)) + "|"]
        by_material: dict[tuple[str, str], dict[str, float]] = {}
        for row in self.rows:
            if row.ok:
                by_material.setdefault((row.material, row.file), {})[row.method] = row.cbrt
        order = sorted(by_material, key=lambda key: -by_material[key].get(methods[0], math.inf))
        for key in order:
            cells = [number(by_material[key].get(method, math.nan), 3) for method in methods]
            lines.append(_line([_text.markdown_cell(key[0]), *cells]))
        return "\n".join(lines) + "\n"


_NUMBERS = ("n_parameters", "seconds", *FIGURES)


def number(value: float, digits: int) -> str:
    """A number in a table."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _median(values: Iterable[float]) -> float:
    some = [value for value in values if math.isfinite(value)]
    return float(np.median(some)) if some else math.nan


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _row(line: dict[str, Any]) -> Row | None:
    """A row of a line of CSV, None if it is none."""
    names = [field.name for field in fields(Row)]
    if any(not isinstance(line.get(name), str) for name in names):
        return None
    try:
        numbers = {name: float(line[name]) for name in _NUMBERS}
    except ValueError:
        return None
    return Row(**{name: line[name] for name in names} | numbers)
