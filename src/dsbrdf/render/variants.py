"""Which variant of Mitsuba to render with, and whether its compiler works.

The plugins need Dr.Jit's compiled backends. On a processor that means LLVM 17 or newer: Dr.Jit takes versions 15 and
16 without a word, and the process dies at the first kernel. So the version is looked at before anything is compiled.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any

__all__ = ["PLUGIN_VARIANTS", "RenderError", "choose", "import_mitsuba", "missing_plugin", "once_a_variant"]

#: Where the plugins run.
PLUGIN_VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")
#: Where files for stock renderers do, on any machine.
STOCK_VARIANT = "scalar_rgb"
#: Older ones abort the process.
MIN_LLVM = 17
REMEDY = (
    "install LLVM 17 or newer (on Debian and Ubuntu: apt install libllvm19) "
    "or set DRJIT_LIBLLVM_PATH to its library"
)


class RenderError(RuntimeError):
    """A plugin cannot run in this variant of Mitsuba, or on this machine."""


def import_mitsuba() -> Any:
    """The module `mitsuba`.

    Raises
    ------
    ModuleNotFoundError
        If it is not installed; says how to.
    """
    try:
        import mitsuba
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "dsbrdf.render needs Mitsuba 3: pip install 'dsbrdf[render]'", name="mitsuba"
        ) from error
    return mitsuba


def once_a_variant(make: Callable[[], type[Any]]) -> Callable[[], type[Any]]:
    """Keep what `make` gives for each variant of Mitsuba that is set: its classes are bound to one."""
    made: dict[str, type[Any]] = {}

    @wraps(make)
    def of_the_variant() -> type[Any]:
        variant = str(import_mitsuba().variant())
        if variant not in made:
            made[variant] = make()
        return made[variant]

    return of_the_variant


def missing_plugin() -> str:
    """Why the plugins cannot run in the variant that is set; empty if they can."""
    mi = import_mitsuba()
    variant = mi.variant()
    if variant is None:
        return "no variant of Mitsuba is set: call mitsuba.set_variant('llvm_ad_rgb') first"
    if variant not in PLUGIN_VARIANTS:
        return (
            f"the plugin runs in {' or '.join(PLUGIN_VARIANTS)}, not in {variant}: set one of these, or load a file "
            "written by dsbrdf export with the stock plugin 'measured'"
        )
    return _bad_llvm() if variant.startswith("llvm") else ""


def _bad_llvm() -> str:
    import drjit

    version = drjit.detail.llvm_version()
    if version[0] >= MIN_LLVM:
        return ""
    return f"Dr.Jit found LLVM {'.'.join(map(str, version))}, with which it aborts the process: {REMEDY}"


def choose(variant: str | None = None) -> str:
    """Set a variant to render with, and return its name.

    Parameters
    ----------
    variant : str, optional
        Set this one. By default the one that is set stays; if there is none, "llvm_ad_rgb" is taken where it works,
        else, with a warning, "scalar_rgb".

    Raises
    ------
    RenderError
        If `variant` is given and cannot be set, or is a compiled one without a working LLVM.
    ModuleNotFoundError
        If Mitsuba is not installed.
    """
    mi = import_mitsuba()
    if variant is None and mi.variant() is not None and not (mi.variant().startswith("llvm") and _bad_llvm()):
        return str(mi.variant())
    problem = _set(mi, variant or PLUGIN_VARIANTS[0])
    if problem and variant is not None:
        raise RenderError(f"cannot render in {variant}: {problem}.")
    if problem:
        warnings.warn(f"rendering in {STOCK_VARIANT}, which is slow: {problem}.", UserWarning, stacklevel=2)
        mi.set_variant(STOCK_VARIANT)
    return str(mi.variant())


def _set(mi: Any, variant: str) -> str:
    """Set a variant; why it does not work, empty if it does."""
    try:
        mi.set_variant(variant)
    except (ImportError, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        return f"{reason}: {REMEDY}" if variant.startswith("llvm") else reason
    return _bad_llvm() if variant.startswith("llvm") else ""
