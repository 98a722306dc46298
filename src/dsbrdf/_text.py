"""Texts that come from files, within others: one function for each kind of place they can stand in.

A name may hold anything: line breaks, escapes of a terminal, formulas of a spreadsheet, marks of a page. Code and XML
that is exported has `dsbrdf.export.text`.
"""

from __future__ import annotations

__all__ = ["csv_cell", "markdown_cell", "shown", "well_formed"]

#: What a spreadsheet takes for the beginning of a formula.
_FORMULA = ("=", "+", "-", "@")
#: What Markdown would make something of, and HTML within it.
_MARKDOWN = {ord(c): f"\\{c}" for c in "\\|`*[]~$"} | {ord("<"): "&lt;", ord("&"): "&amp;"}


def shown(text: object, keep: str = "") -> str:
    r"""A text for a terminal or a figure, what does not print as an escape of Python, but for the characters `keep`.

    Examples
    --------
    >>> shown("\x1b[2Jgold")
    '\\x1b[2Jgold'
    """
    return "".join(c if c.isprintable() or c in keep else ascii(c)[1:-1] for c in str(text))


def csv_cell(text: str) -> str:
    """A text in a table for spreadsheets: on one line, and never a formula."""
    text = shown(" ".join(text.split()))
    return f"'{text}" if text.startswith(_FORMULA) else text


def markdown_cell(text: str) -> str:
    """A text in a table of Markdown, where it is nothing but text."""
    return shown(" ".join(text.split())).translate(_MARKDOWN)


def well_formed(text: str) -> str:
    """A text that every file can hold: half a pair of UTF-16, as from names of files in no encoding, becomes U+FFFD."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
