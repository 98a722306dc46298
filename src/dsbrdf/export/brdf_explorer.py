"""Write a model for Disney's BRDF Explorer, https://github.com/wdas/brdf: a `.brdf` file with the shader in it."""

from __future__ import annotations

from pathlib import Path

from dsbrdf import _files, shader
from dsbrdf.export import text
from dsbrdf.export.colour import lobes_in_colour
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["write_brdf_explorer"]

BRDF = """
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y) {
    vec3 wi = vec3(dot(L, X), dot(L, Y), dot(L, N));
    vec3 wo = vec3(dot(V, X), dot(V, Y), dot(V, N));
    return dsbrdf_eval(wi, wo);
}
"""


def write_brdf_explorer(model: DSBRDF, path: str | Path) -> None:
    """Write a model as an analytic `.brdf` file with its numbers in the shader.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    OSError
        If the file cannot be written.

    Notes
    -----
    The program puts the text into shaders of GLSL 1.30 and 4.10. It drops lines that start with `#` as comments of
    its own, and has a uniform named `gamma`: hence no preprocessor, and a prefix on every name.
    """
    title = text.comment(model.name) or "material"
    content = (
        f"analytic\n\n# {title}, written by dsbrdf\n\n::begin parameters\n::end parameters\n\n"
        f"::begin shader\n\n{shader.baked(lobes_in_colour(model))}{BRDF}\n::end shader\n"
    )
    with _files.aside(path) as part:
        part.write_text(content, encoding="utf-8")
