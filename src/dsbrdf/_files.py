"""Writing files so that nothing half-written is ever in place."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

__all__ = ["aside", "check_replaceable", "is_ours", "regular_size", "sha256"]

#: Files of ours say so within so many bytes of their beginning or end.
MARK, MARK_WITHIN = b"dsbrdf", 4096


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


def check_replaceable(
    path: str | Path,
    *,
    force: bool = False,
    sources: Iterable[str | Path] = (),
    source_sha256: str | None = None,
) -> None:
    """Refuse to replace a file that we did not write, or one that is being read.

    Parameters
    ----------
    path : str or Path
        The file that is to be written.
    force : bool, optional
        Allow files that we did not write; never sources.
    sources : iterable of str or Path, optional
        Files that are read; links are followed.
    source_sha256 : str, optional
        SHA-256 of a file that is never replaced, wherever it lies.

    Raises
    ------
    FileExistsError
        If the file may not be replaced.
    """
    path = Path(path)
    if not path.is_file():
        return
    read = any(Path(source).exists() and path.samefile(source) for source in sources)
    if read or (source_sha256 is not None and sha256(path) == source_sha256):
        raise FileExistsError(f"{path} is what this is made from, and is not replaced. Give another name.")
    if not force and not is_ours(path):
        raise FileExistsError(
            f"{path} is there already, and dsbrdf did not write it. Give another name, or add --force "
            "(in Python: force=True) to replace it."
        )


def is_ours(path: str | Path) -> bool:
    """Whether a file says that `dsbrdf` wrote it."""
    with Path(path).open("rb") as file:
        if MARK in file.read(MARK_WITHIN):
            return True
        file.seek(max(file.seek(0, os.SEEK_END) - MARK_WITHIN, 0))
        return MARK in file.read()


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
