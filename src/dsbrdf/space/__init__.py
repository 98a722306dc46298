"""The space of materials (Section 6.C): functional principal components of the lobes of a collection of models.

`variables` says what the numbers of a lobe are, `correspondence` which lobe of one material is which of another, `fpca`
is the analysis. `build_space` puts them together; `builtin` is the space of the
built-in library, `load_space` reads one from a file. A `MaterialSpace` finds,
blends, moves and draws materials, and its `Gaussian` is the prior of `dsbrdf.fit(samples, prior=space)`.
"""

from dsbrdf.space.build import FIT, build_space, builtin, lobe_fpca
from dsbrdf.space.differentiable import from_scores
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.prior import Gaussian
from dsbrdf.space.settings import SpaceSettings
from dsbrdf.space.space_file import SpaceFormatError, load_space
from dsbrdf.space.variables import Sizes

__all__ = [
    "FIT",
    "Fpca",
    "Gaussian",
    "MaterialSpace",
    "Sizes",
    "SpaceFormatError",
    "SpaceSettings",
    "build_space",
    "builtin",
    "fit_fpca",
    "from_scores",
    "load_space",
    "lobe_fpca",
]
