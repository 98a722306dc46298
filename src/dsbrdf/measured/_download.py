"""A download that goes on where it was interrupted."""

from __future__ import annotations

import errno
import http.client
import os
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["Download"]

#: Bytes read at a time.
BLOCK = 1 << 20
#: Seconds without a byte after which a connection is given up.
TIMEOUT = 60.0
#: Connections in a row that may break without a byte gained.
FRUITLESS = 2


class Download:
    """What pooch calls to download a file: keeps what has come so far beside it, and goes on from there.

    Parameters
    ----------
    part : Path
        What has come so far; stays after an interruption.
    size : int, optional
        Bytes of the whole file; without it, a download begins anew each time.
    hint : str, optional
        What to tell where the server refuses.
    told : callable, optional
        Told the bytes that are there and those of the whole file (0 if that is not known), now and then.
    """

    def __init__(
        self,
        part: Path,
        size: int | None = None,
        *,
        hint: str = "",
        told: Callable[[int, int], None] = lambda *_: None,
    ) -> None:
        self.part, self.size, self.hint, self.told = part, size, hint, told

    def __call__(self, url: str, output_file: Any, pooch: Any = None) -> None:  # noqa: ARG002
        """Download `url` to the path `output_file`.

        Raises
        ------
        ConnectionError
            If there is no connection, it breaks, or the server refuses; says what is there and what to do.
        OSError
            If the disk is full or the file cannot be written.
        """
        if self.size is None or self._there() > self.size:
            self.part.unlink(missing_ok=True)
        fruitless, most = 0, self._there()
        while self.size is None or self._there() < self.size:
            try:
                self._receive(url, self._there())
                if self.size is None:
                    break
                why = "it ended early"
            except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
                if isinstance(error, urllib.error.HTTPError):
                    raise ConnectionError(
                        f"{url}: the server says {error.code} {error.reason}. {self.hint}"
                    ) from None
                why = str(getattr(error, "reason", error)) or type(error).__name__
            fruitless = 0 if self._there() > most else fruitless + 1
            most = max(most, self._there())
            if self.size is None or fruitless > FRUITLESS:
                raise ConnectionError(f"{url}: {why}. {self._remedy()}")
        self.part.replace(str(output_file))

    def _remedy(self) -> str:
        if self.size is None or not self._there():
            return "Is this machine online? Try again later, or set the address of a mirror."
        return f"{self._there():,} of {self.size:,} bytes are here: run it again to go on from there."

    def _there(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _receive(self, url: str, start: int) -> None:
        """Append what comes of one request."""
        self.part.parent.mkdir(parents=True, exist_ok=True)
        headers = {"User-Agent": "dsbrdf", "Accept-Encoding": "identity"}
        if start:
            headers["Range"] = f"bytes={start}-"
        request = urllib.request.Request(url, headers=headers)
        with urllib.request.urlopen(request, timeout=TIMEOUT) as response:
            goes_on = response.status == http.client.PARTIAL_CONTENT
            if goes_on and _first_byte(response) != start:
                self.part.unlink(missing_ok=True)
                raise ConnectionError("the server sent another part than was asked for")
            there = start if goes_on else 0
            total = self.size or there + int(response.headers.get("Content-Length") or 0)
            with self.part.open("ab" if goes_on else "wb") as file:
                while block := response.read(BLOCK):
                    self._write(file, block)
                    there += len(block)
                    self.told(there, total)
        if self.size is None and there < total:
            raise ConnectionError(f"it ended after {there:,} of {total:,} bytes")

    def _write(self, file: Any, block: bytes) -> None:
        try:
            file.write(block)
            file.flush()
        except OSError as error:
            reason = error.strerror or os.strerror(errno.EIO)
            raise OSError(
                error.errno or errno.EIO, f"{reason}; what has come stays", str(self.part)
            ) from None


def _first_byte(response: Any) -> int:
    """Where the bytes of a partial answer begin."""
    text = str(response.headers.get("Content-Range", ""))
    number = text.removeprefix("bytes").strip().split("-")[0]
    return int(number) if number.isdecimal() else -1
