"""Directional statistics BRDF model: measured reflectance to a few lobes, and back.

A measured isotropic BRDF becomes a sum of lobes of the half angle, after Nishino & Lombardi (JOSA A 28(1), 2011), with
shapes shared by the channels and smooth over the difference angle (`Lobes` has the formula). The way of the data is:
`read` or `material` gives a measured table or `Samples`, `fit` a model and how good it is, the model's `eval`,
`sample`, `lobe` and `save` its use. `dsbrdf.paper` holds the paper's own experiment.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dsbrdf.batch import Outcome, fit_many
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
    "ConvergenceWarning",
    "Fit",
    "FitOptions",
    "Lobes",
    "MeasuredBRDF",
    "MerlFormatError",
    "ModelFormatError",
    "Outcome",
    "Samples",
    "check_model",
    "fit",
    "fit_many",
    "half_diff",
    "hemi_epd",
    "load",
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
    "fit": "dsbrdf.fitting",
    "fit_many": "dsbrdf.batch",
    "load": "dsbrdf.model.file",
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
