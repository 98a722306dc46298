"""Write a model as GLSL source with its numbers baked in."""

from __future__ import annotations

from pathlib import Path

from dsbrdf import _files, shader
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write_glsl"]


def write_glsl(model: DSBRDF, path: str | Path) -> None:
    """Write `dsbrdf_eval`, `dsbrdf_pdf` and `dsbrdf_sample` of one model as GLSL; see `dsbrdf.shader.baked`.

    Raises
    ------
    ValueError
        If the model does not have three channels.
    OSError
        If the file cannot be written.
    """
    # A line break in a name would end the comment
    name = " ".join(model.name.split())
    title = f"// {name}\n" if name else ""
    text = title + shader.baked(model)
    with _files.aside(path) as part:
        part.write_text(text, encoding="utf-8")
