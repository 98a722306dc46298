"""`Source`: where a measurement came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dsbrdf import _files

__all__ = ["Source"]


@dataclass(frozen=True)
class Source:
    """Where a measurement came from.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.material("matte").source.description.startswith("built-in material")
    True
    """

    file: Path | None = None
    description: str = ""
    recorded: Mapping[str, Any] | None = None

    @cached_property
    def sha256(self) -> str | None:
        """SHA-256 of the file, None if there is none, or none any more."""
        try:
            return None if self.file is None else _files.sha256(self.file)
        except FileNotFoundError:
            return None

    def to_json(self) -> dict[str, Any]:
        """Name and hash of the file, without its folder; what was recorded, if it comes from a model file."""
        if self.recorded is not None:
            return dict(self.recorded)
        return {
            "file": None if self.file is None else self.file.name,
            "sha256": self.sha256,
            "description": self.description,
        }
