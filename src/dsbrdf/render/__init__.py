"""Fitted models and measured tables in Mitsuba 3.

`register` makes the plugins `dsbrdf` and `dsbrdf_measured` known to the variant that is set; `to_dict` puts a model
into a scene.
"""

from __future__ import annotations

from typing import Any

from dsbrdf import _check
from dsbrdf.batch.texels import TexelMaps
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.render import measured_bsdf, mitsuba_bsdf
from dsbrdf.render.variants import RenderError, choose, import_mitsuba, missing_plugin

__all__ = ["RenderError", "choose", "register", "to_dict"]


def register() -> None:
    """Make the plugins known to the variant of Mitsuba that is set; once a variant, more often does no harm.

    Raises
    ------
    RenderError
        If they cannot run: no variant is set, it is not llvm_ad_rgb or cuda_ad_rgb, or LLVM is too old.
    ModuleNotFoundError
        If Mitsuba is not installed.
    """
    mi = import_mitsuba()
    if problem := missing_plugin():
        raise RenderError(f"{problem}.")
    mi.register_bsdf(mitsuba_bsdf.PLUGIN, lambda props: mitsuba_bsdf.dsbrdf_class()(props))
    mi.register_bsdf(measured_bsdf.PLUGIN, lambda props: measured_bsdf.measured_class()(props))


def to_dict(reflectance: DSBRDF | TexelMaps | MeasuredBRDF) -> dict[str, Any]:
    """The bsdf of a model, of maps of texels or of a table, for `mitsuba.load_dict`, in the variant that is set.

    Parameters
    ----------
    reflectance : DSBRDF, TexelMaps or MeasuredBRDF

    Raises
    ------
    ValueError
        If a channel of a table has no valid entry, or maps have no rows and columns.
    """
    _check.instance(reflectance, (DSBRDF, TexelMaps, MeasuredBRDF), "reflectance")
    if isinstance(reflectance, DSBRDF | TexelMaps):
        return mitsuba_bsdf.to_dict(reflectance)
    return measured_bsdf.to_dict(reflectance)
