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

from dsbrdf import _files
from dsbrdf.measured import MeasuredBRDF, Samples

__all__ = ["RECORD", "TABLES", "Book", "figure_path", "source_of"]

#: In the folder of models: what was fitted, how, from which file.
RECORD = ".dsbrdf-batch.json"
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


def source_of(measured: MeasuredBRDF | Samples) -> dict[str, Any] | None:
    """What tells a file from others without reading it; None for built-in materials."""
    file = measured.source.file
    if file is None:
        return None
    stat = file.stat()
    return {"file": file.name, "size": stat.st_size, "mtime_ns": stat.st_mtime_ns}


class Book:
    """The record of a folder of models, and the tables made from it."""

    def __init__(self, folder: Path | None, options: Mapping[str, Any], *, force: bool) -> None:
        from dsbrdf import __version__

        self.folder = folder
        # As they come back from a file
        self.options: dict[str, Any] = json.loads(
            json.dumps({**options, "version": __version__}, default=_told, sort_keys=True)
        )
        self.entries = {} if folder is None else _read_record(folder / RECORD)
        self.earlier = {} if force else dict(self.entries)

    def still_good(
        self, name: str, measured: MeasuredBRDF | Samples, source: dict[str, Any] | None, plots: bool
    ) -> dict[str, Any] | None:
        """The entry of an earlier run that need not be repeated; completes `source` by its hash."""
        entry = self.earlier.get(name)
        if self.folder is None or source is None or entry is None or not isinstance(entry["source"], dict):
            return None
        then = entry["source"]
        if entry["options"] != self.options or (source["file"], source["size"]) != (
            then.get("file"),
            then.get("size"),
        ):
            return None
        if not self._is_intact(name, entry) or (plots and not self._has_figures(name)):
            return None
        if source["mtime_ns"] != then.get("mtime_ns") and measured.source.sha256 != then.get("sha256"):
            return None
        source["sha256"] = then.get("sha256")
        return entry

    def _is_intact(self, name: str, entry: Mapping[str, Any]) -> bool:
        assert self.folder is not None
        try:
            hashed = _files.sha256(self.folder / f"{name}.json")
        except OSError:
            return False
        return bool(hashed == entry["model_sha256"])

    def _has_figures(self, name: str) -> bool:
        assert self.folder is not None
        path = self.folder / f"{name}.json"
        return all(figure_path(path, ending).exists() for ending in ("", "-parameters"))

    def add(self, name: str, entry: dict[str, Any]) -> None:
        """Note a model; `save` writes it down."""
        self.entries[name] = entry

    def save(self) -> None:
        """Write the record aside and rename it."""
        assert self.folder is not None
        content = {"format": FORMAT, "schema": SCHEMA, "fits": self.entries}
        with _files.aside(self.folder / RECORD) as part:
            part.write_text(json.dumps(content) + "\n", encoding="utf-8")

    @contextlib.contextmanager
    def tables(self, failures: Sequence[tuple[str, str]]) -> Iterator[None]:
        """Write record and tables at the end, however it comes; `failures` are names and what was wrong."""
        if self.folder is None:
            yield
            return
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
            return
        self.save()
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
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(content, dict) or (content.get("format"), content.get("schema")) != (FORMAT, SCHEMA):
        return {}
    fits = content.get("fits")
    return {name: entry for name, entry in fits.items() if _is_sound(entry)} if isinstance(fits, dict) else {}


def _is_sound(entry: Any) -> bool:
    kinds = {"options": dict, "summary": dict, "status": str, "model_sha256": str}
    if not isinstance(entry, dict) or not all(
        isinstance(entry.get(key), kind) for key, kind in kinds.items()
    ):
        return False
    return "source" in entry and {"name", *HEADS} <= set(entry["summary"])


def _row(name: str, summary: Mapping[str, Any], status: str) -> dict[str, Any]:
    numbers = {key: summary.get(key) for key in HEADS}
    return {"name": name, **numbers, "status": " ".join(status.split())}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _markdown(rows: Sequence[Mapping[str, Any]], options: Mapping[str, Any]) -> str:
    heads = ["material", *(head for head, _ in HEADS.values()), "status"]
    lines = [
        f"Fits with {', '.join(f'{key} {value}' for key, value in options.items())}. Errors over the whole "
        "hemisphere: relative RMS of values (rel) and of cube roots of f cos cos (cbrt), RMS of logarithms (log), "
        "relative error of the albedo; floors of rel.",
        "",
        "| " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(HEADS) + "---|",
    ]
    for row in rows:
        numbers = [_number(row[key], digits) for key, (_, digits) in HEADS.items()]
        cells = [row["name"], *numbers, row["status"]]
        lines.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _number(value: float | None, digits: int) -> str:
    return f"{value:.{digits}f}" if value is not None and math.isfinite(value) else "-"
