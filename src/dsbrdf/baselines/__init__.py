"""Other models of a measured BRDF, to compare with: their fits, and one measure of error for all (Section 6).

Each has `eval`, `eval_angles`, `name`, `label` and `n_parameters`, and a `fit_*` function that takes the
samples that `dsbrdf.fit` takes: 18 slices, theta_h of at least one degree, inside the perimeter mask.
`errors` gives the relative RMS of any of them, and of a `DSBRDF`, over those samples.
"""

from dsbrdf.baselines._base import AbstractBaseline, SliceOptions, errors
from dsbrdf.baselines.bivariate import Bivariate, fit_bivariate
from dsbrdf.baselines.interpolation import Interpolation, fit_interpolation
from dsbrdf.baselines.lambert_ggx import LambertGGX, fit_lambert_ggx
from dsbrdf.baselines.lambert_torrance_sparrow import LambertTorranceSparrow, fit_lambert_torrance_sparrow
from dsbrdf.baselines.von_mises_fisher import VonMisesFisher, fit_von_mises_fisher

__all__ = [
    "AbstractBaseline",
    "Bivariate",
    "Interpolation",
    "LambertGGX",
    "LambertTorranceSparrow",
    "SliceOptions",
    "VonMisesFisher",
    "errors",
    "fit_bivariate",
    "fit_interpolation",
    "fit_lambert_ggx",
    "fit_lambert_torrance_sparrow",
    "fit_von_mises_fisher",
]
