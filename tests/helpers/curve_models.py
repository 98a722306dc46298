"""Models of curves over theta_d with random coefficients."""

import numpy as np

from dsbrdf.paper import CurveBasis, Curves, Slices
from dsbrdf.paper.collapse import N_SLICES, slice_rows
from dsbrdf.paper.curves import tabulated_theta_d

SLICES = tabulated_theta_d()[slice_rows(90, N_SLICES)]


def random_curves(rng, basis=None, n_channels=3, n_lobes=2, logarithmic=True):
    basis = basis or CurveBasis()
    shape = (n_channels, n_lobes, basis.size)
    kappa, gamma = rng.uniform(-3.0, 1.0, shape), rng.uniform(-2.0, 5.0, shape)
    if not logarithmic:
        kappa, gamma = np.exp(kappa), np.exp(gamma)
    beta, spike = rng.uniform(-0.9, 0.9, shape), rng.uniform(0.0, 9.0, (n_channels, basis.size))
    return Curves(basis, kappa, gamma, beta, logarithmic, spike)


def sliced(curves, theta_d=SLICES):
    return Slices(theta_d, *curves.at(theta_d), curves.spike_at(theta_d))
