"""Write a model as a MERL `.binary` table."""

from __future__ import annotations

from pathlib import Path

from dsbrdf._check import require_rgb
from dsbrdf.measured import tabulate, write_merl
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write"]


def write(model: DSBRDF, path: str | Path) -> None:
    """Tabulate a model of three channels at the middles of the cells of a MERL file, and write that.

    Raises
    ------
    ValueError
        If the model has not three channels.
    OSError
        If the file cannot be written.
    """
    require_rgb(model.n_channels, "a MERL file")
    write_merl(tabulate(model.eval, model.name or "model"), path)
