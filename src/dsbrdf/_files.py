"""Writing files so that nothing half-written is ever in place."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["aside", "sha256"]


@contextlib.contextmanager
def aside(path: str | Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to, and rename it to `path` at the end; on an error, remove it.

    Raises
    ------
    OSError
        If the folder cannot be made or written to; names `path`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(path)) from error
    finally:
        part.unlink(missing_ok=True)


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
