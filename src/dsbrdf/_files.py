"""Writing files so that nothing half-written is ever in place, under names that no material can choose freely."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import secrets
import stat
import unicodedata
from collections.abc import Iterable, Iterator
from pathlib import Path

__all__ = [
    "aside",
    "check_replaceable",
    "check_unpacked",
    "file_key",
    "file_name",
    "is_ours",
    "regular_size",
    "sha256",
]

#: Files of ours say so within so many bytes of their beginning or end.
MARK, MARK_WITHIN = b"dsbrdf", 4096
#: Most bytes of a material's name in that of a file, which leaves room for endings.
MAX_NAME = 200
#: Larger files are not read: most of one may be a hole that takes no room on the disk.
MAX_BYTES = 4_000_000_000
#: Bytes, and numbers, that what is compressed may hold beyond the bytes of the file: a MERL table, and some.
ROOM, ROOM_NUMBERS = 40_000_000, 5_000_000
#: Characters of ASCII that some system has no place for in a name.
_SPECIAL = frozenset('<>:"/\\|?*')
#: Names of devices on Windows, with any ending.
_DEVICES = frozenset(
    [
        "con",
        "prn",
        "aux",
        "nul",
        "conin$",
        "conout$",
        *(f"{port}{n}" for port in ("com", "lpt") for n in "0123456789¹²³"),
    ]
)


def file_name(name: str) -> str:
    """A material's name as that of a file, without ending: whatever the name, the file lies in the folder it is for.

    Characters that a system gives a meaning to, or that do not show, become %XX, their bytes in UTF-8, as do a point,
    minus or blank in front and a point or blank at the end; a long name is cut, and ends in a number of its own.

    Examples
    --------
    >>> file_name("../victim/package")
    '%2E.%2Fvictim%2Fpackage'
    >>> file_name("gold, brushed")
    'gold, brushed'
    """
    last = len(name) - 1
    inside = "".join(
        _encoded(c)
        if c in _SPECIAL or not c.isprintable() or (i == 0 and c in ".- ~") or (i == last and c in ". ")
        else c
        for i, c in enumerate(name)
    )
    if inside.split(".")[0].rstrip().casefold() in _DEVICES:
        inside = _encoded(inside[0]) + inside[1:]
    if len(inside.encode()) > MAX_NAME:
        mark = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:16]
        inside = f"{inside.encode()[: MAX_NAME - 17].decode(errors='ignore').rstrip('. ')}-{mark}"
    return inside or "unnamed"


def file_key(path: str | Path) -> str:
    """What two paths have in common that are the same file on some system: those that differ only in case."""
    return unicodedata.normalize("NFC", str(path)).casefold()


def _encoded(character: str) -> str:
    return "".join(f"%{byte:02X}" for byte in character.encode("utf-8", "surrogatepass"))


@contextlib.contextmanager
def aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path beside `path` to write to, and rename it to `path` at the end; on an error, remove it.

    Raises
    ------
    OSError
        If the folder cannot be made, or `path` in it not be written; names the one it is. Also if `path` is no regular
        file, such as a device, which would be replaced. A link is replaced, not what it leads to.
    """
    path = Path(path)
    if not path.name or path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "not a regular file, and is not replaced", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name that nobody can have put a link at
    part = path.with_name(f".dsbrdf-{secrets.token_hex(8)}.part")
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
        If it is a device, a pipe or a socket, or has more than 4 GB.
    """
    status = Path(path).stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"{path}: not a regular file. Copy what it gives to a file first.")
    if status.st_size > MAX_BYTES:
        raise ValueError(
            f"{path}: {status.st_size:,} bytes are more than the {MAX_BYTES:,} that are read. Give a part of it."
        )
    return status.st_size


def check_unpacked(size: int, n_bytes: int, n_numbers: int) -> None:
    """Refuse what a file of `size` bytes unpacks to, before memory is taken for it.

    Raises
    ------
    ValueError
        If it is far more than the file: small numbers count too, as each will be one of 64 bits.
    """
    for n, room, what in ((n_bytes, ROOM, "bytes of arrays"), (n_numbers, ROOM_NUMBERS, "numbers")):
        if n > size + room:
            raise ValueError(f"{n:,} {what} in a file of {size:,} bytes. Store it without compression.")
