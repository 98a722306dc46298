"""JSON that may come from anyone: what it takes is bounded, and it says one thing to every program that reads it."""

from __future__ import annotations

import json
import math
from typing import Any

__all__ = ["check_plain", "parse"]

#: Commas and brackets, as each may stand for 30 bytes of memory or more.
MAX_MARKS = 2_400_000
#: Levels of objects and lists that are kept as they are, and written again.
MAX_DEPTH = 8
#: Greatest whole number that every program holds.
MAX_WHOLE = 2**63


def parse(text: str | bytes, *, most: int = MAX_MARKS) -> Any:
    """The content of a text of JSON, with at most so many commas and brackets.

    Raises
    ------
    ValueError
        If it is no JSON, too long or too deep, or if an object has a name twice, of which programs take either.
    """
    if isinstance(text, bytes):
        try:
            text = text.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"not JSON ({error})") from None
    if text.count(",") + 2 * text.count("[") + 8 * text.count("{") > most:
        raise ValueError("more values than any such file has")
    try:
        return json.loads(text, object_pairs_hook=_object)
    # A ValueError also comes of a number with thousands of digits
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not JSON ({error})") from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise ValueError(f"the name {twice!r:.60} is there twice in an object")
    return content


def check_plain(value: Any, key: str, depth: int = MAX_DEPTH) -> None:
    """Refuse what the page and other programs would stumble on, in the entry `key` of a file that is kept as it is.

    Raises
    ------
    ValueError
        If a number is not finite or too large for other programs, or there are too many levels.
    """
    if isinstance(value, dict | list):
        if not depth:
            raise ValueError(f'"{key}" must have at most {MAX_DEPTH} levels.')
        for item in value.values() if isinstance(value, dict) else value:
            check_plain(item, key, depth - 1)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f'"{key}" must hold finite numbers, got {value:g}.')
    elif type(value) is int and abs(value) > MAX_WHOLE:
        raise ValueError(f'"{key}" must hold numbers of 64 bits, got one of {value.bit_length()}.')
