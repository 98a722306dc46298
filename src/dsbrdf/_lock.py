"""One run at a time in a folder.

The file of the lock names process and host, for people. What counts is the lock that the system holds on it, which
ends with the process however that ends, so that no file of a dead run is in the way.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

__all__ = ["BusyError", "held"]


class BusyError(RuntimeError):
    """Another run is at work in the same folder."""


@contextlib.contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock at `path`.

    Raises
    ------
    BusyError
        If another process or thread holds it; says who.
    OSError
        If the file cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    file = _locked(path)
    try:
        file.seek(0)
        file.truncate()
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        yield
    finally:
        # Removed before it is let go of: who opened it in between finds out in `_locked`
        with contextlib.suppress(OSError):
            path.unlink()
        file.close()


def _locked(path: Path) -> IO[str]:
    while True:
        # A link would have what it leads to emptied
        flags = (
            os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        )
        file = os.fdopen(os.open(path, flags, 0o666), "a+", encoding="utf-8")
        try:
            _lock(file)
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                # A file system without locks
                return file
            who = ""
            with file, contextlib.suppress(OSError):
                file.seek(0)
                who = file.read(200)
            raise BusyError(
                f"{path.parent}: {who or 'another process'} is writing to this folder. Wait for it, or give "
                "another folder."
            ) from None
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        # It was removed in between
        file.close()


def _lock(file: IO[str]) -> None:
    if sys.platform == "win32":
        import msvcrt

        file.seek(0)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
