"""Directional statistics BRDF model: measured reflectance to a few lobes, and back.

A measured isotropic BRDF becomes a sum of lobes of the half angle, after Nishino & Lombardi (JOSA A 28(1), 2011), with
shapes shared by the channels and smooth over the difference angle (`Lobes` has the formula).

The way of the data
    `read` or `material` gives a measured table (`MeasuredBRDF`) or `Samples`; `fit` a `Fit`: a model and how good it
    is; the model (`DSBRDF`) has `eval`, `sample`, `pdf`, `albedo`, `lobe`, `save`. `load` reads it back.
How good, how certain
    `Fit.errors`, `Fit.coverage`, `Fit.band`, `Fit.standard_errors`; `check_model` before rendering.
Many files
    `fit_many`; `compare` with other models.
Ready-made materials, and what is like what
    `dsbrdf.library`, `dsbrdf.space`.
Elsewhere
    `dsbrdf.export` (other programs), `dsbrdf.render` (Mitsuba 3), `dsbrdf.view` (a web page), `dsbrdf.plot` (figures),
    `dsbrdf.images` (reflectance from pictures), `dsbrdf.baselines` (other models), `dsbrdf.paper` (the paper's
    experiment).

At the command line, `dsbrdf --help`.

Examples
--------
>>> import dsbrdf
>>> fit = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
>>> fit.model.eval([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]).shape
(3,)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dsbrdf.batch import Outcome, fit_many
    from dsbrdf.batch.texels import TexelMaps, fit_texels, load_texels
    from dsbrdf.comparison import Comparison, compare
    from dsbrdf.fitting.fit import ConvergenceWarning, Fit, fit
    from dsbrdf.fitting.options import FitOptions
    from dsbrdf.fitting.plan import plan
    from dsbrdf.geometry import half_diff
    from dsbrdf.measured import (
        MeasuredBRDF,
        MerlFormatError,
        Samples,
        read_merl,
        read_samples,
        tabulate,
        write_merl,
    )
    from dsbrdf.measured.built_in import material
    from dsbrdf.measured.read import read
    from dsbrdf.model import hemi_epd
    from dsbrdf.model.check import CheckReport, check_model
    from dsbrdf.model.dsbrdf import DSBRDF
    from dsbrdf.model.file import ModelFormatError, load
    from dsbrdf.model.lobes import Lobes

__version__ = "0.1.0"

__all__ = [
    "DSBRDF",
    "CheckReport",
    "Comparison",
    "ConvergenceWarning",
    "Fit",
    "FitOptions",
    "Lobes",
    "MeasuredBRDF",
    "MerlFormatError",
    "ModelFormatError",
    "Outcome",
    "Samples",
    "TexelMaps",
    "check_model",
    "compare",
    "fit",
    "fit_many",
    "fit_texels",
    "half_diff",
    "hemi_epd",
    "load",
    "load_texels",
    "material",
    "plan",
    "read",
    "read_merl",
    "read_samples",
    "tabulate",
    "write_merl",
]

#: Module of each name, imported when the name is first used, so that `import dsbrdf` and help come at once.
_OWNERS = {
    "CheckReport": "dsbrdf.model.check",
    "Comparison": "dsbrdf.comparison",
    "ConvergenceWarning": "dsbrdf.fitting",
    "DSBRDF": "dsbrdf.model.dsbrdf",
    "Fit": "dsbrdf.fitting",
    "FitOptions": "dsbrdf.fitting",
    "Lobes": "dsbrdf.model.lobes",
    "MeasuredBRDF": "dsbrdf.measured",
    "MerlFormatError": "dsbrdf.measured",
    "ModelFormatError": "dsbrdf.model.file",
    "Outcome": "dsbrdf.batch",
    "Samples": "dsbrdf.measured",
    "check_model": "dsbrdf.model.check",
    "compare": "dsbrdf.comparison",
    "fit": "dsbrdf.fitting",
    "TexelMaps": "dsbrdf.batch.texels",
    "fit_many": "dsbrdf.batch",
    "fit_texels": "dsbrdf.batch.texels",
    "load": "dsbrdf.model.file",
    "load_texels": "dsbrdf.batch.texels",
    "material": "dsbrdf.measured.built_in",
    "plan": "dsbrdf.fitting.plan",
    "read": "dsbrdf.measured.read",
    "read_merl": "dsbrdf.measured",
    "read_samples": "dsbrdf.measured",
    "tabulate": "dsbrdf.measured",
    "write_merl": "dsbrdf.measured",
}
#: Package of each module that is reached as `dsbrdf.NAME`.
_MODULES = {"half_diff": "dsbrdf.geometry", "hemi_epd": "dsbrdf.model"}


def __getattr__(name: str) -> Any:
    if name in _OWNERS:
        value = globals()[name] = getattr(import_module(_OWNERS[name]), name)
        return value
    if name in _MODULES:
        value = globals()[name] = import_module(f"{_MODULES[name]}.{name}")
        return value
    try:
        return import_module(f"dsbrdf.{name}")
    except ModuleNotFoundError as error:
        if error.name != f"dsbrdf.{name}":
            raise
        raise AttributeError(f"module 'dsbrdf' has no attribute {name!r}") from None


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
