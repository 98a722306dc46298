"""Write a model as source code with its numbers in it."""

from __future__ import annotations

from pathlib import Path

from dsbrdf import _files, shader
from dsbrdf.export import text
from dsbrdf.export.colour import lobes_in_colour
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write_glsl"]


def write_glsl(model: DSBRDF, path: str | Path) -> None:
    """Write `dsbrdf_eval`, `dsbrdf_pdf` and `dsbrdf_sample` of one model as GLSL; see `dsbrdf.shader.baked`.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.
    """
    title = f"// {text.comment(model.name)}\n" if model.name.strip() else ""
    source = title + shader.baked(lobes_in_colour(model))
    with _files.aside(path) as part:
        part.write_text(source, encoding="utf-8")
