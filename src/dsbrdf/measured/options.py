"""How a caller wants a measured file read, where the file alone does not say enough."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check

__all__ = ["Condition", "ReadOptions"]

_COMPARE = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
#: What can be compared.
QUANTITIES = ("theta_i", "theta_o", "theta_h", "theta_d", "phi", "phi_d", "value", "wavelength")
_CONDITION = re.compile(r"\s*([a-z_]+?)(_deg)?\s*(<=|>=|<|>)\s*([-+\d.eE]+)\s*")


@dataclass(frozen=True)
class Condition:
    """A comparison that samples must satisfy, as in ``theta_o<=85``; angles in degrees."""

    quantity: str
    comparison: str
    limit: float

    @classmethod
    def parse(cls, text: str) -> Condition:
        """From text.

        Raises
        ------
        ValueError
            If it is no comparison of a known quantity with a number.
        """
        match = _CONDITION.fullmatch(text)
        try:
            if match is None or match[1] not in QUANTITIES:
                raise ValueError
            limit = float(match[4])
        except ValueError:
            raise ValueError(
                f"'keep' must be comparisons such as 'theta_o<=85' of {', '.join(QUANTITIES)} (angles in "
                f"degrees) with a "
                f"number, got {text!r:.60}."
            ) from None
        return cls(match[1], match[3], limit)

    def holds(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which values satisfy it."""
        result: NDArray[np.bool_] = _COMPARE[self.comparison](values, self.limit)
        return result

    def __str__(self) -> str:
        return f"{self.quantity}{self.comparison}{self.limit:g}"


@dataclass(frozen=True)
class ReadOptions:
    """What the caller says about a measured file.

    Parameters
    ----------
    columns : sequence of str, optional
        Names of all columns, instead of those in the file; "-" leaves one out, an unknown name is that of a channel.
    ignore : sequence of str, optional
        Columns of the file to leave out, by their names.
    set : mapping of str to float, optional
        Columns with one number for all samples, as ``{"phi_o_deg": 180}``.
    scale : float, optional
        Factor of the values: 0.3183 (1 / pi) for reflectance factors, 0.003183 for those in percent. Says also that the
        values are in 1/sr after it.
    cosine : bool, optional
        The values hold the cosine of theta_o, and are divided by it.
    phi_offset : float, degrees, optional
        Added to the azimuth of the view: 180 where the mirror direction is at phi = 0.
    keep : str or sequence of str, optional
        Comparisons of `QUANTITIES` that samples must satisfy, as ``"theta_o<=85"``; angles in degrees.
    """

    columns: Sequence[str] | None = None
    ignore: Sequence[str] = ()
    set: Mapping[str, float] = field(default_factory=dict)
    scale: float | None = None
    cosine: bool = False
    phi_offset: float | None = None
    keep: Sequence[str] | str = ()

    def __post_init__(self) -> None:
        for name in ("columns", "ignore", "keep"):
            value = getattr(self, name)
            if isinstance(value, str):
                value = [part for part in re.split(r"\s*,\s*", value.strip()) if part]
            if value is not None:
                object.__setattr__(self, name, tuple(map(str, value)))
        object.__setattr__(self, "set", {str(k): float(v) for k, v in dict(self.set).items()})
        if not all(map(math.isfinite, self.set.values())):
            raise ValueError("'set' must hold finite numbers.")
        if self.scale is not None:
            _check.finite(self.scale, "scale", low=0.0, open_low=True)
        if self.phi_offset is not None:
            _check.finite(self.phi_offset, "phi_offset")
        _ = self.conditions

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The comparisons of `keep`."""
        return tuple(Condition.parse(text) for text in self.keep)

    @property
    def given(self) -> dict[str, Any]:
        """Those that differ from the default, as keyword arguments."""
        default = ReadOptions.__dataclass_fields__
        values = {name: getattr(self, name) for name in default}
        return {
            name: dict(value) if name == "set" else value
            for name, value in values.items()
            if value not in (None, (), False) and value != {}
        }
