"""The model as a shader: one source, whose numbers come from a texture (the page) or are baked in (exports).

`dsbrdf.glsl` holds eval, pdf and sample, named as in Python; `languages` turns it into WGSL, HLSL and Slang. It reads
all numbers through `dsbrdf_texel`, so that the web page and an exported file run the same text; `texels` makes them,
`texture.glsl` says what they are.
"""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf._check import require_rgb
from dsbrdf.geometry import half_diff
from dsbrdf.model import sampling
from dsbrdf.model.lobes import SHARED, Lobes
from dsbrdf.shader.languages import LANGUAGES, texel_block, translate

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["LANGUAGES", "baked", "sources", "texels"]

#: Sources the page needs beside the constants.
PAGE_SOURCES = ("dsbrdf", "texture", "sphere", "show", "evaluate")


def sources() -> dict[str, str]:
    """GLSL ES 3.00 sources of the page by name, without `#version`; `constants` goes in front of the others.

    Examples
    --------
    >>> import dsbrdf
    >>> sorted(dsbrdf.shader.sources())[:2]
    ['constants', 'dsbrdf']
    """
    return {"constants": _constants(), **{name: _read(name) for name in PAGE_SOURCES}}


def texels(lobes: Lobes) -> NDArray[np.float64]:
    """All numbers of a shader, (texel, 4); `texture.glsl` says what they are.

    Parameters
    ----------
    lobes : Lobes
        Of three channels.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.shader.texels(dsbrdf.library.load("nickel").lobes).shape[1]
    4
    """
    tables, lobes = sampling.tables(lobes), lobes.numpy
    sizes = [getattr(lobes, name).shape[1] for name in SHARED]
    of_colour = lobes.colour.shape[2]
    most = max(*sizes, of_colour)
    header = [sizes, [of_colour, most, lobes.n_lobes, 0]]
    curves = np.zeros((lobes.n_lobes, 2 * most, 4))
    for i, (name, size) in enumerate(zip(SHARED, sizes, strict=True)):
        curves[:, :size, i] = getattr(lobes, name)
    curves[:, most : most + of_colour, :3] = lobes.colour.transpose(1, 2, 0)
    shares = np.column_stack([tables.shares, tables.cosine])
    return np.concatenate([header, curves.reshape(-1, 4), shares.reshape(-1, 4)])


def baked(model: DSBRDF, language: str = "glsl") -> str:
    """Source code of one model, its numbers as one constant array.

    Parameters
    ----------
    model : DSBRDF
        Of three channels.
    language : {"glsl", "wgsl", "hlsl", "slang"}, optional

    Returns
    -------
    str
        `dsbrdf_eval`, `dsbrdf_pdf` and `dsbrdf_sample`, explained at their top. GLSL is without `#version`; 1.30, 4.10,
        ES 3.00 and what lies between take it. HLSL needs shader model 4; Slang differentiates it.

    Raises
    ------
    ValueError
        If the model has another number of channels, or there is no such language.

    Examples
    --------
    >>> import dsbrdf
    >>> "vec3" in dsbrdf.shader.baked(dsbrdf.library.load("nickel"))
    True
    """
    if language not in LANGUAGES:
        raise ValueError(f"'language' must be one of {', '.join(LANGUAGES)}, got {language!r}.")
    require_rgb(model.n_channels, "a shader")
    rows = [", ".join(f"{value:.7g}" for value in texel) for texel in texels(model.lobes)]
    constants, code = (translate(text, language) for text in (_constants(), _read("dsbrdf")))
    return f"{constants}\n{texel_block(rows, language)}\n{code}"


def _read(name: str) -> str:
    return resources.files(__package__).joinpath(f"{name}.glsl").read_text(encoding="utf-8")


def _constants() -> str:
    """Constants that belong to other modules."""
    return (
        f"const float DSBRDF_AZIMUTHAL_WIDTH = {half_diff.AZIMUTHAL_WIDTH:#.9g};\n"
        f"const int DSBRDF_N_ROWS = {sampling.N_ROWS};\n"
    )
