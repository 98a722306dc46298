"""Short texts of values that hold arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

__all__ = ["Brief"]

#: Letters up to which a part is shown as it is.
LENGTH = 60


class Brief:
    """A dataclass with `repr=False` whose text is short: arrays, and what is long, are shown by shape or size."""

    def __repr__(self) -> str:
        parts = [
            f"{field.name}={_shown(getattr(self, field.name))}"
            for field in dataclasses.fields(self)  # type: ignore[arg-type]
            if field.repr
        ]
        return f"{type(self).__name__}({', '.join(parts)})"


def _shown(value: Any) -> str:
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"<{value.dtype} {tuple(value.shape)}>" if value.shape else repr(value)
    text = repr(value)
    if len(text) <= LENGTH or (isinstance(value, Brief) and "\n" not in text):
        return text
    if isinstance(value, Mapping | list | tuple | set):
        return f"<{type(value).__name__} of {len(value)}>"
    return f"<{type(value).__name__}>"
