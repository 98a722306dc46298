"""The model as a shader: one GLSL source, whose numbers come from a texture (the page) or are baked in (exports).

`dsbrdf.glsl` holds eval, pdf and sample, named as in Python. It reads all numbers through `dsbrdf_texel`, so that the
web page and an exported file run the same text; `texels` makes them, `texture.glsl` says what they are.
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

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["baked", "sources", "texels"]

#: Sources the page needs beside the constants.
PAGE_SOURCES = ("dsbrdf", "texture", "sphere", "show", "evaluate")


def sources() -> dict[str, str]:
    """GLSL ES 3.00 sources of the page by name, without `#version`; `constants` goes in front of the others."""
    return {"constants": _constants(), **{name: _read(name) for name in PAGE_SOURCES}}


def texels(lobes: Lobes) -> NDArray[np.float64]:
    """All numbers of a shader, (lobe, column, 4); `texture.glsl` says which column holds what.

    Parameters
    ----------
    lobes : Lobes
        Of three channels.
    """
    lobes, tables = lobes.numpy, sampling.tables(lobes)
    sizes = [getattr(lobes, name).shape[1] for name in SHARED]
    most = max(*sizes, lobes.colour.shape[2])
    packed = np.zeros((lobes.n_lobes, 2 + 2 * most + 2 * sampling.N_ROWS, 4))
    packed[:, 0] = sizes
    packed[:, 1, 0] = lobes.colour.shape[2]
    for i, (name, size) in enumerate(zip(SHARED, sizes, strict=True)):
        packed[:, 2 : 2 + size, i] = getattr(lobes, name)
    packed[:, 2 + most : 2 + most + lobes.colour.shape[2], :3] = lobes.colour.transpose(1, 2, 0)
    of_rows = packed[:, 2 + 2 * most :].reshape(lobes.n_lobes, sampling.N_ROWS, 2, 4)
    of_rows[:, :, 0] = np.stack([tables.kappa, tables.gamma, tables.falloff, tables.normaliser], axis=-1).swapaxes(0, 1)
    of_rows[:, :, 1, 0] = tables.shares.T
    return packed


def baked(model: DSBRDF) -> str:
    """GLSL of one model, its numbers as a constant array.

    Parameters
    ----------
    model : DSBRDF
        Of three channels.

    Returns
    -------
    str
        `dsbrdf_eval`, `dsbrdf_pdf` and `dsbrdf_sample`, told at their top. Without `#version`; GLSL 1.30, 4.10,
        ES 3.00 and what lies between take it.

    Raises
    ------
    ValueError
        If the model has another number of channels.
    """
    require_rgb(model.n_channels, "a shader")
    return f"{_constants()}\n{_numbers(texels(model.lobes))}\n{_read('dsbrdf')}"


def _read(name: str) -> str:
    return resources.files(__package__).joinpath(f"{name}.glsl").read_text(encoding="utf-8")


def _constants() -> str:
    """Constants that belong to other modules."""
    return (
        f"const float DSBRDF_AZIMUTHAL_WIDTH = {_number(half_diff.AZIMUTHAL_WIDTH)};\n"
        f"const int DSBRDF_N_ROWS = {sampling.N_ROWS};\n"
    )


def _numbers(packed: NDArray[np.float64]) -> str:
    """Texels (lobe, column, 4) as an array, and the functions that read them, as `texture.glsl` has them."""
    n_lobes, n_columns = packed.shape[:2]
    entries = [f"vec4({', '.join(map(_number, texel))})" for texel in packed.reshape(-1, 4)]
    n = len(entries)
    return (
        f"const vec4 DSBRDF_TEXELS[{n}] = vec4[{n}](\n    " + ",\n    ".join(entries) + ");\n"
        f"int dsbrdf_n_lobes() {{ return {n_lobes}; }}\n"
        f"int dsbrdf_n_columns() {{ return {n_columns}; }}\n"
        f"vec4 dsbrdf_texel(int lobe, int column) {{ return DSBRDF_TEXELS[lobe * {n_columns} + column]; }}\n"
    )


def _number(value: float) -> str:
    """Nine digits tell any two numbers of single precision apart; a float of GLSL has a point or an exponent."""
    text = f"{value:.9g}"
    return text if "." in text or "e" in text else f"{text}.0"
