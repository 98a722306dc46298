"""Directional statistics BRDF model: measured reflectance to a few lobes, and back.

Nishino & Lombardi (JOSA A 28(1), 2011) describe each slice of a measured isotropic BRDF as a sum of hemi-EPD lobes,
`expm1(kappa cos(theta_h)^gamma)`. The way of the data is: `read` or `material` gives a measured table, `fit` a model,
the model's `eval`, `sample`, `lobe` and `save` its use.
"""

from dsbrdf import half_diff, hemi_epd
from dsbrdf.batch import Outcome, fit_many
from dsbrdf.check import CheckReport, check_model
from dsbrdf.curves import CurveBasis, Curves
from dsbrdf.fit import ConvergenceWarning, Fit, FitStatus, fit
from dsbrdf.fit_curves import fit_curves
from dsbrdf.materials import material
from dsbrdf.measured import (
    MeasuredBRDF,
    MerlFormatError,
    Samples,
    read,
    read_merl,
    read_samples,
    tabulate,
    write_merl,
)
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
