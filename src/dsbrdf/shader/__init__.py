"""The model as a shader: one GLSL source, whose numbers come from a texture (the page) or are baked in (exports).

`dsbrdf.glsl` holds eval, pdf and sample, named as in Python. It reads parameters through a few functions alone, so
that the web page and an exported file run the same text.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.export._channels import require_rgb
from dsbrdf.geometry import half_diff
from dsbrdf.model import hemi_epd, sampling
from dsbrdf.paper import spike

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["baked", "sources"]

#: Sources the page needs beside the constants.
PAGE_SOURCES = ("dsbrdf", "texture", "sphere", "show", "evaluate")


def sources() -> dict[str, str]:
    """GLSL ES 3.00 sources of the page by name, without `#version`; `constants` goes in front of the others."""
    return {"constants": _constants(), **{name: _read(name) for name in PAGE_SOURCES}}


def baked(model: DSBRDF) -> str:
    """GLSL of one model, its numbers as constant arrays.

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
    return f"{_constants()}\n{_numbers(model)}\n{_read('dsbrdf')}"


def _read(name: str) -> str:
    return resources.files(__package__).joinpath(f"{name}.glsl").read_text(encoding="utf-8")


def _constants() -> str:
    """Constants that belong to other modules."""
    constants = {
        "DSBRDF_AZIMUTHAL_WIDTH": half_diff.AZIMUTHAL_WIDTH,
        "DSBRDF_SIN2_WIDTH": spike.SIN2_WIDTH,
        "DSBRDF_COSINE_SHARE": sampling.COSINE_SHARE,
    }
    return "".join(f"const float {name} = {_number(value)};\n" for name, value in constants.items())


def _numbers(model: DSBRDF) -> str:
    """Arrays (slice, lobe) of numbers, and the functions that read them."""
    n_slices, n_lobes = len(model.theta_d), model.n_lobes
    kappa, gamma, beta, height = (
        np.asarray(values, dtype=np.float64) for values in (model.kappa, model.gamma, model.beta, model.spike)
    )
    mean_kappa = np.maximum(kappa.mean(1), sampling.MIN_KAPPA)
    mean_gamma = gamma.mean(1)
    integral = np.exp(-hemi_epd.log_normaliser(mean_kappa, mean_gamma))
    of_lobes = {"kappa": kappa, "gamma": gamma, "beta": beta}
    arrays = [
        f"const int DSBRDF_N_SLICES = {n_slices};\nconst int DSBRDF_N_LOBES = {n_lobes};\n",
        _array("float", "THETA_D", map(_number, model.theta_d)),
        *(_array("vec3", name.upper(), map(_vec3, _by_lobe(values))) for name, values in of_lobes.items()),
        _array("vec3", "SPIKE", map(_vec3, height)),
        _array(
            "vec3", "SAMPLING", map(_vec3, _by_lobe(np.stack([mean_kappa, mean_gamma, integral], axis=1)))
        ),
        "int dsbrdf_n_slices() { return DSBRDF_N_SLICES; }\nint dsbrdf_n_lobes() { return DSBRDF_N_LOBES; }\n",
        "float dsbrdf_theta_d(int slice) { return DSBRDF_THETA_D[slice]; }\n",
        "vec3 dsbrdf_spike(int slice) { return DSBRDF_SPIKE[slice]; }\n",
    ]
    arrays += [
        f"vec3 dsbrdf_{name}(int slice, int k) {{ return DSBRDF_{name.upper()}[slice * DSBRDF_N_LOBES + k]; }}\n"
        for name in (*of_lobes, "sampling")
    ]
    return "".join(arrays)


def _by_lobe(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Arrays (theta_d, channel, lobe) as rows (theta_d and lobe, channel)."""
    return values.swapaxes(1, 2).reshape(-1, values.shape[1])


def _array(kind: str, name: str, items: Iterable[str]) -> str:
    entries = list(items)
    return f"const {kind} DSBRDF_{name}[{len(entries)}] = {kind}[{len(entries)}](\n    " + (
        ",\n    ".join(entries) + ");\n"
    )


def _vec3(values: NDArray[np.float64]) -> str:
    return f"vec3({', '.join(_number(value) for value in values)})"


def _number(value: float) -> str:
    """Nine digits tell any two numbers of single precision apart; a float of GLSL has a point or an exponent."""
    text = f"{value:.9g}"
    return text if "." in text or "e" in text else f"{text}.0"
