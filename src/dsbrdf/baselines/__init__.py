"""Other models of a measured BRDF, to compare with, over the whole hemisphere.

Each has `eval`, `eval_angles`, `name`, `label` and `n_parameters`, and a `fit_*` function. `bivariate` is a table
without phi_d; `microfacet` has what renderers of today have: Lambert and one GGX lobe (7 numbers), and Lambert and two
with a Fresnel term each (13 numbers); `fresnel` one lobe with Fresnel's equations (10 numbers). `dsbrdf.compare` judges
them all.
"""

from dsbrdf.baselines._base import AbstractBaseline
from dsbrdf.baselines.bivariate import Bivariate, fit_bivariate
from dsbrdf.baselines.fresnel import FresnelGGX, fit_fresnel_ggx
from dsbrdf.baselines.microfacet import GGXPair, LambertGGX, fit_ggx_pair, fit_lambert_ggx

__all__ = [
    "AbstractBaseline",
    "Bivariate",
    "FresnelGGX",
    "GGXPair",
    "LambertGGX",
    "fit_bivariate",
    "fit_fresnel_ggx",
    "fit_ggx_pair",
    "fit_lambert_ggx",
]
