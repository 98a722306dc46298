"""The paper's competitors, over the samples of slices, and one measure of error for them and any other model.

Each has the interface of `dsbrdf.baselines`, and a `fit_*` function that takes the samples that
`dsbrdf.paper.fit_slices` takes: 18 slices, theta_h of at least one degree, inside the perimeter mask. `errors` gives
the relative RMS of any of them, of `Slices` and of a `DSBRDF` over those samples. Lambert with two Torrance-Sparrow
lobes is Fig. 7's, `fit_ggx_pair` a fair form of it, interpolation Fig. 6's, and von Mises-Fisher lobes are what Section
3 sets out to improve on.
"""

from dsbrdf.paper.baselines._base import SliceOptions, errors
from dsbrdf.paper.baselines.ggx_pair import fit_ggx_pair
from dsbrdf.paper.baselines.interpolation import Interpolation, fit_interpolation
from dsbrdf.paper.baselines.lambert_torrance_sparrow import (
    LambertTorranceSparrow,
    fit_lambert_torrance_sparrow,
)
from dsbrdf.paper.baselines.von_mises_fisher import VonMisesFisher, fit_von_mises_fisher

__all__ = [
    "Interpolation",
    "LambertTorranceSparrow",
    "SliceOptions",
    "VonMisesFisher",
    "errors",
    "fit_ggx_pair",
    "fit_interpolation",
    "fit_lambert_torrance_sparrow",
    "fit_von_mises_fisher",
]
