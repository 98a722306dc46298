"""Words and numbers of small text formats, with the lines that they stand in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.measured.formats.text_file import encoding, open_lines

Array: TypeAlias = NDArray[np.float64]
__all__ = ["Tokens", "first_words"]

#: Larger files are none of these.
MAX_BYTES = 500_000_000


def first_words(head: bytes, comment: str = "#") -> Iterator[str]:
    """First words of the lines in the head of a file, comments left out."""
    for line in head.decode("latin-1").splitlines():
        word = line.split(comment)[0].split()
        if word:
            yield word[0]


class Tokens:
    """The words of a text file one after the other.

    Parameters
    ----------
    path : Path
    comment : str, optional
        Where comments begin.
    """

    def __init__(self, path: Path, comment: str = "#") -> None:
        if _files.regular_size(path) > MAX_BYTES:
            raise ValueError(f"{path}: more than {MAX_BYTES:,} bytes.")
        self.path = path
        self.line = 0
        self._lines = open_lines(path, encoding(path))
        self._comment = comment
        self._waiting: list[str] = []

    def peek(self) -> str:
        """The next word, "" at the end."""
        while not self._waiting:
            number, text = next(self._lines, (0, None))
            if text is None:
                return ""
            self.line = number
            self._waiting = text.split(self._comment)[0].replace(",", " ").split()[::-1]
        return self._waiting[-1]

    def word(self) -> str:
        """Take the next word.

        Raises
        ------
        ValueError
            At the end of the file.
        """
        if not self.peek():
            raise ValueError(f"{self.path}: the file ends early, after line {self.line}. Fetch it again.")
        return self._waiting.pop()

    def rest(self) -> str:
        """Take what is left of the line."""
        words, self._waiting = self._waiting[::-1], []
        return " ".join(words)

    def number(self) -> float:
        """Take the next number.

        Raises
        ------
        ValueError
            If it is none; says in which line.
        """
        word = self.word()
        try:
            return float(word)
        except ValueError:
            raise ValueError(f"{self.path}: line {self.line}: expected a number, got {word!r:.40}.") from None

    def count(self, most: int = 1_000_000) -> int:
        """Take a number of things.

        Raises
        ------
        ValueError
            If it is no whole number from 1 to `most`.
        """
        value = self.number()
        if not 1 <= value <= most or value != int(value):
            raise ValueError(
                f"{self.path}: line {self.line}: expected a count from 1 to {most:,}, got {value:g}."
            )
        return int(value)

    def numbers(self, n: int) -> Array:
        """Take so many numbers.

        Raises
        ------
        ValueError
            If there are fewer, or a word between them.
        """
        found = [self.number() for _ in range(n)]
        return np.array(found, dtype=float)

    def fail(self, text: str) -> ValueError:
        """An error that names the file and line."""
        return ValueError(f"{self.path}: line {self.line}: {text}")
