"""Known models, closed forms and pairs of directions, for the tests of fits."""

import numpy as np
from models import upper

from dsbrdf import DSBRDF, half_diff, tabulate
from dsbrdf.measured import built_in as materials
from dsbrdf.model.lobes import Lobes

#: Cells of a table that is fitted in a tenth of a second.
SMALL = (30, 24, 24)


def known(beta=True):
    """A rough base and a coloured highlight, with curves of the sizes of a standard fit."""
    stretch = np.array([[0.1, 0.05, 0.0], [-0.3, -0.1, 0.0]]) if beta else np.zeros((2, 3))
    return DSBRDF(
        Lobes(
            [[-1.5, -1.4, -1.6, -1.8, -2.0, -2.1], [1.2, 0.8, 0.5, 0.4, 0.3, 0.3]],
            [[-0.2, -0.1, 0.1, 0.2], [3.5, 4.0, 4.2, 4.3]],
            stretch,
            [[0.2], [0.0]],
            [[[0.3, 0.2], [0.1, 0.0]], [[0.0, 0.0], [0.0, 0.0]], [[-0.3, -0.2], [-0.1, 0.0]]],
        )
    )


def pairs(rng, n, within=80.0):
    """Pairs (n, 3) of directions uniform on both hemispheres, within so many degrees of the normal."""
    found = upper(rng, 4 * n + 40)
    found = found[found[:, 2] > np.cos(np.deg2rad(within))]
    return found[:n], found[n : 2 * n]


def built_in(name):
    return tabulate(materials.get(name).reflectance, name, shape=SMALL)


def white_plastic(wi, wo):
    """Like delrin: a bright base under a surface of Beckmann facets, without masking; values (n, 3)."""
    theta_h, theta_d, _ = half_diff.from_directions(wi, wo)
    facets = np.exp(-(np.tan(theta_h) ** 2) / 0.04) / (0.04 * np.cos(theta_h) ** 4)
    fresnel = 0.04 + 0.96 * (1.0 - np.cos(theta_d)) ** 5
    through = 1.0 - 0.5 * ((1.0 - wi[:, 2]) ** 5 + (1.0 - wo[:, 2]) ** 5)
    return (0.3 * facets * fresnel)[:, None] + [0.28, 0.28, 0.26] * through[:, None]
