"""Writing files so that nothing half-written is ever in place."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

__all__ = ["aside", "regular_size", "sha256"]


@contextlib.contextmanager
def aside(path: str | Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to, and rename it to `path` at the end; on an error, remove it.

    Raises
    ------
    OSError
        If the folder cannot be made, or `path` in it not be written; names the one it is.
    """
    path = Path(path)
    if not path.name:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        # NumPy tells of a full disk without a number
        reason = error.strerror or str(error)
        raise type(error)(error.errno or errno.EIO, reason, str(path)) from error
    finally:
        part.unlink(missing_ok=True)


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def regular_size(path: str | Path) -> int:
    """Size in bytes of a regular file; anything else could be read without end, or wait for ever.

    Raises
    ------
    OSError
        If there is no such file, or it is a folder.
    ValueError
        If it is a device, a pipe or a socket.
    """
    status = Path(path).stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"{path}: not a regular file. Copy what it gives to a file first.")
    return status.st_size
