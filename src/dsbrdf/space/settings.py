"""How materials become points of a space, and which models go into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.space.correspondence import CORRESPONDENCES
from dsbrdf.space.variables import Sizes

__all__ = ["SpaceSettings", "check_channels", "check_convention", "convention_of"]


@dataclass(frozen=True)
class SpaceSettings:
    """How materials become points of a space; spaces of other settings do not mix.

    Parameters
    ----------
    sizes : Sizes, optional
        Coefficients of the curves of a lobe.
    correspondence : {"rank", "border"}, optional
        See `dsbrdf.space.correspondence`.
    convention : str, optional
        Of the tables that were fitted (`dsbrdf.MeasuredBRDF.convention`); empty if unknown.

    Raises
    ------
    ValueError
        If an option is unknown.

    Examples
    --------
    >>> from dsbrdf.space import SpaceSettings
    >>> SpaceSettings(correspondence="border").sizes.scale
    6
    """

    sizes: Sizes = field(default_factory=Sizes)
    correspondence: str = "rank"
    convention: str = ""

    def __post_init__(self) -> None:
        if self.correspondence not in CORRESPONDENCES:
            raise ValueError(
                f"'correspondence' must be {' or '.join(map(repr, CORRESPONDENCES))}, got {self.correspondence!r}."
            )


def convention_of(model: DSBRDF) -> str:
    """Convention of the table that a model was fitted to; empty if unknown."""
    fitted: Any = model.fit_options.get("convention")
    return str(fitted or "")


def check_channels(model: DSBRDF, channels: Sequence[str]) -> None:
    """Raise a ValueError unless a model has these channels."""
    if tuple(model.channels) != tuple(channels):
        raise ValueError(
            f"{model.name or 'the model'}: channels {_shown(model.channels)}, where the space has {_shown(channels)}. "
            "Build a space of models with the same channels."
        )


def _shown(channels: Sequence[str]) -> str:
    return (
        ", ".join(channels) if len(channels) <= 6 else f"{channels[0]} ... {channels[-1]} ({len(channels)})"
    )


def check_convention(model: DSBRDF, convention: str) -> None:
    """Raise a ValueError if a model was fitted with another convention; one that is unknown passes."""
    other = convention_of(model)
    if convention and other and other != convention:
        raise ValueError(
            f"{model.name or 'the model'}: fitted with the {other!r} convention of table cells, where the space has "
            f"{convention!r}: its peaks are shifted against the others'. Read and fit all tables with one convention."
        )
