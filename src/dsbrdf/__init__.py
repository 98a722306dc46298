"""Directional statistics BRDF model: measured reflectance to a few lobes, and back.

Nishino & Lombardi (JOSA A 28(1), 2011) describe each slice of a measured isotropic BRDF as a sum of hemi-EPD lobes,
`expm1(kappa cos(theta_h)^gamma)`. The way of the data is: `read` or `material` gives a measured table, `fit` a model,
the model's `eval`, `sample`, `lobe` and `save` its use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dsbrdf import half_diff, hemi_epd
    from dsbrdf.batch import Outcome, fit_many
    from dsbrdf.check import CheckReport, check_model
    from dsbrdf.curves import CurveBasis, Curves
    from dsbrdf.fit_measured import ConvergenceWarning, Fit, FitStatus, fit
    from dsbrdf.fit_splines import fit_curves
    from dsbrdf.materials import material
    from dsbrdf.measured import (
        MeasuredBRDF,
        MerlFormatError,
        Samples,
        read_merl,
        read_samples,
        tabulate,
        write_merl,
    )
    from dsbrdf.measured.read import read
    from dsbrdf.model import DSBRDF
    from dsbrdf.model_file import ModelFormatError, load
    from dsbrdf.slices import SliceProfile, slice_profiles

__version__ = "0.1.0"

__all__ = [
    "DSBRDF",
    "CheckReport",
    "ConvergenceWarning",
    "CurveBasis",
    "Curves",
    "Fit",
    "FitStatus",
    "MeasuredBRDF",
    "MerlFormatError",
    "ModelFormatError",
    "Outcome",
    "Samples",
    "SliceProfile",
    "check_model",
    "fit",
    "fit_curves",
    "fit_many",
    "half_diff",
    "hemi_epd",
    "load",
    "material",
    "read",
    "read_merl",
    "read_samples",
    "slice_profiles",
    "tabulate",
    "write_merl",
]

#: Module of each name, imported when the name is first used, so that `import dsbrdf` and help come at once.
_OWNERS = {
    "CheckReport": "dsbrdf.check",
    "ConvergenceWarning": "dsbrdf.fit_measured",
    "CurveBasis": "dsbrdf.curves",
    "Curves": "dsbrdf.curves",
    "DSBRDF": "dsbrdf.model",
    "Fit": "dsbrdf.fit_measured",
    "FitStatus": "dsbrdf.fit_measured",
    "MeasuredBRDF": "dsbrdf.measured",
    "MerlFormatError": "dsbrdf.measured",
    "ModelFormatError": "dsbrdf.model_file",
    "Outcome": "dsbrdf.batch",
    "Samples": "dsbrdf.measured",
    "SliceProfile": "dsbrdf.slices",
    "check_model": "dsbrdf.check",
    "fit": "dsbrdf.fit_measured",
    "fit_curves": "dsbrdf.fit_splines",
    "fit_many": "dsbrdf.batch",
    "load": "dsbrdf.model_file",
    "material": "dsbrdf.materials",
    "read": "dsbrdf.measured.read",
    "read_merl": "dsbrdf.measured",
    "read_samples": "dsbrdf.measured",
    "slice_profiles": "dsbrdf.slices",
    "tabulate": "dsbrdf.measured",
    "write_merl": "dsbrdf.measured",
}


def __getattr__(name: str) -> Any:
    if name in _OWNERS:
        value = globals()[name] = getattr(import_module(_OWNERS[name]), name)
        return value
    try:
        return import_module(f"dsbrdf.{name}")
    except ModuleNotFoundError as error:
        if error.name != f"dsbrdf.{name}":
            raise
        raise AttributeError(f"module 'dsbrdf' has no attribute {name!r}") from None


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
