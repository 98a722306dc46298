"""`read`: any measured file to a `MeasuredBRDF`, the format found from its content."""

from __future__ import annotations

from pathlib import Path

from dsbrdf.measured.brdf import MeasuredBRDF
from dsbrdf.measured.merl import read_merl

__all__ = ["read"]


def read(path: str | Path, *, convention: str = "centre") -> MeasuredBRDF:
    """Read a measured BRDF.

    Parameters
    ----------
    path : str or Path
        A MERL `.binary` file.
    convention : {"centre", "edge"}, optional
        Which point of a table's cell its value belongs to.

    Returns
    -------
    MeasuredBRDF

    Raises
    ------
    ValueError
        If the content is of no known format; says what was expected and found.
    OSError
        If the file cannot be read.
    """
    return read_merl(path, convention=convention)
