"""Models made by hand, for the tests of exports."""

import numpy as np

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import Lobes


def by_hand(kappa, gamma, beta, *, rise=0.3, tint=(1.0, 0.8, 1.2), **fields):
    """Lobes (lobe,) whose kappa rises toward grazing light by a share, and is tinted in each channel."""
    ln_kappa = np.log(kappa)[:, None] + np.log1p([rise * np.pi / 2, 0.0])
    column = np.ones((len(kappa), 1))
    colour = np.log(tint)[:, None, None] * column
    shapes = (np.log(gamma)[:, None], np.array(beta)[:, None] * column, 0.0 * column)
    return DSBRDF(Lobes(ln_kappa, *shapes, colour), **fields)
