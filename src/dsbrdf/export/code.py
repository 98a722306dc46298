"""Write a model as source code with its numbers in it, to be put into any shader."""

from __future__ import annotations

from pathlib import Path

from dsbrdf import _files, shader
from dsbrdf.export import text
from dsbrdf.export.colour import lobes_in_colour
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write_code"]


def write_code(model: DSBRDF, path: str | Path, *, language: str) -> None:
    """Write `dsbrdf_eval`, `dsbrdf_pdf` and `dsbrdf_sample` of one model; see `dsbrdf.shader.baked`.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.
    """
    title = text.comment(model.name) or "material"
    source = f"// {title}, written by dsbrdf\n{shader.baked(lobes_in_colour(model), language)}"
    with _files.aside(path) as part:
        part.write_text(source, encoding="utf-8")
