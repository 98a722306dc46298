"""The space of materials (Section 6.C): functional principal components of the lobes of a collection of models.

`build_space` makes one of fitted models; `load_space` reads one. A `MaterialSpace` finds, blends, moves and draws
materials, and is the prior of `dsbrdf.fit(samples, prior=space)`.
"""

from dsbrdf.space.build import FIT, build_space, lobe_fpca
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.settings import SpaceSettings
from dsbrdf.space.space_file import SpaceFormatError, load_space

__all__ = [
    "FIT",
    "Fpca",
    "MaterialSpace",
    "SpaceFormatError",
    "SpaceSettings",
    "build_space",
    "fit_fpca",
    "load_space",
    "lobe_fpca",
]
