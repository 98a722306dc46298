"""Write a model as a MERL `.binary` table."""

from __future__ import annotations

from pathlib import Path

from dsbrdf.export.colour import in_colour
from dsbrdf.measured import tabulate, write_merl
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write_merl_table"]


def write_merl_table(model: DSBRDF, path: str | Path) -> None:
    """Tabulate a model in colour at the middles of the cells of a MERL file, and write that.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.
    """
    write_merl(tabulate(in_colour(model).eval, model.name or "model"), path)
