"""Names of materials in files of other programs: one function for each kind of place a name can stand in.

A name comes from a file, and may hold anything: line breaks, quotes, the end of a comment.
"""

from __future__ import annotations

import re
from xml.sax.saxutils import quoteattr

__all__ = ["attribute", "comment", "identifier", "quoted"]

#: What a name is cut to.
MAX_LENGTH = 200


def comment(name: str) -> str:
    """A name within a comment of one line: printable, without what would end the comment or continue the line."""
    shown = "".join(c if c.isprintable() else " " for c in name)
    shown = " ".join(shown.replace("*/", "* /").replace("/*", "/ *").split())
    # A backslash at the end of a line continues it; `??/` is one in old C
    return shown[:MAX_LENGTH].rstrip("\\/ ")


def identifier(name: str, default: str = "material") -> str:
    """A name of letters of ASCII, digits and underscores that begins with a letter."""
    cleaned = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:MAX_LENGTH]
    if not cleaned:
        return default
    return cleaned if cleaned[0].isalpha() else f"m_{cleaned}"


def attribute(name: str) -> str:
    """A name as an attribute of XML, with its quotes; characters that XML has no place for are left out."""
    allowed = "".join(c for c in name if c.isprintable() and not 0xD800 <= ord(c) <= 0xDFFF)
    return quoteattr(allowed[:MAX_LENGTH])


def quoted(name: str) -> str:
    """A name as a string of USD, with its quotes."""
    allowed = "".join(c for c in name if c.isprintable())[:MAX_LENGTH]
    return '"' + allowed.replace("\\", "\\\\").replace('"', '\\"') + '"'
