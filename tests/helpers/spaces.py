"""Made-up materials of a small space, for the tests of spaces."""

import numpy as np

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import Lobes
from dsbrdf.space.variables import Sizes

#: Logarithms of kappa and gamma of lobes from flat to sharp.
LEVELS = np.array([[-3.5, 0.5], [-2.5, 2.5], [-1.0, 4.5], [0.0, 6.5]])


def smooth_model(seed, n_lobes=3, n_channels=3, sizes=None, **fields):
    """A model whose curves vary a little, its lobes in any order."""
    rng = np.random.default_rng(seed)
    sizes = sizes or Sizes()
    scale, gamma, beta, falloff = (
        0.3 * rng.normal(size=(n_lobes, 1)) + 0.2 * rng.normal(size=(n_lobes, size)) for size in sizes[:4]
    )
    colour = 0.3 * rng.normal(size=(n_channels, n_lobes, sizes[4]))
    lobes = Lobes(
        LEVELS[:n_lobes, :1] + scale,
        LEVELS[:n_lobes, 1:] + gamma,
        beta,
        0.3 * falloff,
        colour - colour.mean(0),
    ).take(rng.permutation(n_lobes))
    return DSBRDF(lobes, name=fields.pop("name", f"material-{seed}"), **fields)
