"""What a folder of models remembers of the runs that made it, and the tables made from that."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dsbrdf import _files, _lock, _text

__all__ = ["LOCK", "RECORD", "TABLES", "Book", "figure_path"]

#: In the folder of models: what was fitted, how, from which file; and, while it is being written to, by whom.
RECORD = ".dsbrdf-batch.jsonl"
LOCK = ".dsbrdf-batch.lock"
#: In the folder of models: one line a material.
TABLES = ("fits.csv", "fits.md")
FORMAT = "dsbrdf batch"
SCHEMA = 1
#: Numbers of a summary that tables show: the head in the one for people, and digits after the point.
HEADS = {
    "n_lobes": ("lobes", 0),
    "n_parameters": ("numbers", 0),
    "rel": ("rel", 3),
    "cbrt": ("cbrt", 3),
    "log": ("log", 3),
    "albedo": ("albedo", 3),
    "bivariate_floor": ("bivariate floor", 3),
    "azimuthal_floor": ("azimuthal floor", 3),
    "seconds": ("seconds", 2),
}
COLUMNS = ("name", *HEADS, "status")


def figure_path(path: Path, ending: str) -> Path:
    """Where a figure of the model at `path` lies."""
    return path.with_name(f"{path.stem}{ending}.png")


class Book:
    """The record of a folder of models, and the tables made from it.

    The record is a line of JSON for each model, written when the model is there; of two for the same name the later
    one holds, and a last line that is not whole is none.
    """

    def __init__(self, folder: Path | None, options: Mapping[str, Any], *, force: bool) -> None:
        from dsbrdf import __version__

        self.folder = folder
        # As they come back from a file
        self.options: dict[str, Any] = json.loads(
            json.dumps({**options, "version": __version__}, default=_told, sort_keys=True)
        )
        self.entries = {} if folder is None else _read_record(folder / RECORD)
        self.earlier = {} if force else dict(self.entries)
        # Names by that of the file
        self._names = {
            entry["source"]["file"]: name
            for name, entry in self.earlier.items()
            if isinstance(entry["source"], dict) and isinstance(entry["source"].get("file"), str)
        }

    def known(self, file: str, *, figures: bool) -> Mapping[str, Any] | None:
        """What tells the file of an earlier fit, which need not be repeated if it is the same, from others."""
        name = self._names.get(file)
        if name is None:
            return None
        entry = self.earlier[name]
        if entry["options"] != self.options or not self._is_intact(name, entry):
            return None
        source: Mapping[str, Any] = entry["source"]
        if figures and source.get("is_table") and not self._has_figures(name):
            return None
        return source if isinstance(source.get("sha256"), str) else None

    def _path(self, name: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{_files.file_name(name)}.json"

    def forget(self, path: Path | None, *, but: Path) -> None:
        """Remove a model whose name another one has, unless `but`, the other's file, replaces it."""
        if path is None or path == but:
            return
        path.unlink(missing_ok=True)
        self.entries = {
            name: entry for name, entry in self.entries.items() if self.folder and self._path(name) != path
        }

    def _is_intact(self, name: str, entry: Mapping[str, Any]) -> bool:
        assert self.folder is not None
        try:
            hashed = _files.sha256(self._path(name))
        except OSError:
            return False
        return bool(hashed == entry["model_sha256"])

    def _has_figures(self, name: str) -> bool:
        assert self.folder is not None
        path = self._path(name)
        return all(figure_path(path, ending).exists() for ending in ("", "-parameters"))

    def add(self, name: str, entry: dict[str, Any]) -> None:
        """Note a model."""
        assert self.folder is not None
        if self.entries.get(name) == entry:
            return
        self.entries[name] = entry
        with (self.folder / RECORD).open("a", encoding="utf-8", newline="\n") as file:
            file.write(json.dumps({"name": name, **entry}) + "\n")

    def _compact(self) -> None:
        """Write the record anew, a line a model, and without the rest of a line that was cut off."""
        assert self.folder is not None
        head = {"format": FORMAT, "schema": SCHEMA}
        rows = [head, *({"name": name, **entry} for name, entry in self.entries.items())]
        with (
            _files.aside(self.folder / RECORD) as part,
            part.open("w", encoding="utf-8", newline="\n") as file,
        ):
            file.writelines(json.dumps(row) + "\n" for row in rows)

    @contextlib.contextmanager
    def kept(self, failures: Sequence[tuple[str, str]]) -> Iterator[None]:
        """Keep record and tables of a run, however it ends; `failures` are names and what was wrong.

        Raises
        ------
        BusyError
            If another run is writing to the folder.
        """
        if self.folder is None:
            yield
            return
        with _lock.held(self.folder / LOCK):
            self._compact()
            try:
                yield
            except BaseException:
                # That is what is to be told, not that a table cannot be written either
                with contextlib.suppress(OSError):
                    self._write_tables(failures)
                raise
            self._write_tables(failures)

    def _write_tables(self, failures: Sequence[tuple[str, str]]) -> None:
        assert self.folder is not None
        if not self.entries and not failures:
            (self.folder / RECORD).unlink(missing_ok=True)
            return
        self._compact()
        rows = self._rows(failures)
        for name, text in zip(TABLES, (_csv(rows), _markdown(rows, self.options)), strict=True):
            with _files.aside(self.folder / name) as part:
                part.write_text(text, encoding="utf-8", newline="\n")

    def _rows(self, failures: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
        """Of every model in the folder that was fitted with these options, and of what failed, by name."""
        rows = [
            _row(name, entry["summary"], entry["status"])
            for name, entry in self.entries.items()
            if entry["options"] == self.options and self._is_intact(name, entry)
        ]
        rows += [_row(name, {}, f"failed: {text}") for name, text in failures]
        return sorted(rows, key=lambda row: str(row["name"]))


def _told(option: Any) -> str:
    """An option in words; of a space, what tells it from others."""
    from dsbrdf.space import MaterialSpace

    if not isinstance(option, MaterialSpace):
        return str(option)
    content = repr((option.settings, option.channels, option.border, option.n_diffuse)).encode()
    content += option.curves.tobytes()
    return f"{len(option.names)} materials, SHA-256 {hashlib.sha256(content).hexdigest()}"


def _read_record(path: Path) -> dict[str, dict[str, Any]]:
    """Entries of a record; those that are not sound, or all if it is none, are as if they had never been."""
    try:
        _files.regular_size(path)
        head, *lines = map(_parsed, path.read_text(encoding="utf-8", errors="replace").splitlines())
    except (OSError, ValueError):
        return {}
    if (head.get("format"), head.get("schema")) != (FORMAT, SCHEMA):
        return {}
    return {line.pop("name"): line for line in lines if _is_sound(line)}


def _parsed(line: str) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _is_sound(entry: Mapping[str, Any]) -> bool:
    kinds = {"name": str, "options": dict, "summary": dict, "status": str, "model_sha256": str}
    if not all(isinstance(entry.get(key), kind) for key, kind in kinds.items()):
        return False
    return "source" in entry and {"name", *HEADS} <= set(entry["summary"])


def _row(name: str, summary: Mapping[str, Any], status: str) -> dict[str, Any]:
    numbers = {key: summary.get(key) for key in HEADS}
    return {"name": name, **numbers, "status": status}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {key: _text.csv_cell(cell) if isinstance(cell, str) else cell for key, cell in row.items()}
        for row in rows
    )
    return text.getvalue()


def _markdown(rows: Sequence[Mapping[str, Any]], options: Mapping[str, Any]) -> str:
    heads = ["material", *(head for head, _ in HEADS.values()), "status"]
    told = _text.markdown_cell(", ".join(f"{key} {value}" for key, value in options.items()))
    lines = [
        f"Fits with {told}. Errors over the whole hemisphere: relative RMS of values (rel) and of cube roots "
        "of f cos cos (cbrt), RMS of logarithms (log), "
        "relative error of the albedo; floors of rel.",
        "",
        "| " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(HEADS) + "---|",
    ]
    for row in rows:
        numbers = [_number(row[key], digits) for key, (_, digits) in HEADS.items()]
        cells = [_text.markdown_cell(row["name"]), *numbers, _text.markdown_cell(row["status"])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _number(value: float | None, digits: int) -> str:
    return f"{value:.{digits}f}" if value is not None and math.isfinite(value) else "-"
