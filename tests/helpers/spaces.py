"""Made-up materials of a small space, for the tests of spaces."""

import numpy as np

from dsbrdf import DSBRDF
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.space.variables import Variables

BASIS = CurveBasis()


def smooth_model(seed, n_lobes=3, n_channels=3, theta_d=None, beta=False, **fields):
    """A model whose logarithms are splines: diffuse, then sharper and sharper lobes."""
    rng = np.random.default_rng(seed)
    theta_d = np.linspace(0.0, np.pi / 2, 19) if theta_d is None else theta_d
    level = np.array([[-3.5, 1.8], [-2.5, 3.8], [-1.0, 5.5], [0.0, 7.0]])[:n_lobes, :, None]
    # Channels are alike
    common, own = rng.normal(size=(1, n_lobes, 2, 1)), rng.normal(size=(n_channels, n_lobes, 2, BASIS.size))
    values = np.einsum("tc,klfc->tklf", BASIS.design(theta_d), level + 0.3 * common + 0.2 * own)
    kappa, gamma, _ = Variables().parameters(values)
    wave = rng.uniform(-0.9, 0.9, (n_channels, n_lobes)) * np.ones((len(theta_d), 1, 1))
    order = rng.permutation(n_lobes)
    parts = (x[:, :, order] for x in (kappa, gamma, wave if beta else np.zeros_like(kappa)))
    return DSBRDF(theta_d, *parts, name=fields.pop("name", f"material-{seed}"), **fields)
