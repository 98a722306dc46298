"""Small tables of known reflectances, and what a fit of slices should say about them by brute force."""

import warnings
from functools import lru_cache

import numpy as np

from dsbrdf import tabulate
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.measured import built_in as materials
from dsbrdf.paper import ConvergenceWarning, Slices, fit_slices
from dsbrdf.paper.collapse import slice_mask, slice_rows

# Lobes that can be told apart: kappa, gamma, beta
KNOWN = {
    1: ([0.8], [3.0], [0.3]),
    2: ([2.0, 0.3], [200.0, 1.0], [0.5, -0.4]),
    3: ([3.0, 1.0, 0.2], [1500.0, 40.0, 0.7], [-0.6, 0.4, 0.2]),
}
#: Options of a fit that leave out none of its six slices' samples, but for those near the pole
EVERY_SAMPLE = {"n_slices": 6, "perimeter_mask": False}


@lru_cache
def built_in(name, shape=(90, 18, 36)):
    return tabulate(materials.get(name).reflectance, name, shape=shape)


def of_model(model, n_slices, n_h=90, n_phi=36):
    """Table of `n_slices` rows of theta_d."""
    return tabulate(model.eval, "lobes", shape=(n_h, n_slices, n_phi))


def lobes(kappa, gamma, beta, n_slices=6, rise=0.3, tint=(1.0, 0.8, 1.2)):
    """Model whose kappa (lobe,) rises over the slices and differs between channels."""
    theta_d = np.pi / 2 * (np.arange(n_slices) + 0.5) / n_slices
    ramp = (1.0 + rise * theta_d)[:, None, None] * np.asarray(tint)[:, None]
    return Slices(theta_d, kappa * ramp, gamma * np.ones_like(ramp), beta * np.ones_like(ramp))


def quiet_fit(*arguments, **options):
    """`fit_slices` where running out of iterations is not the point."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return fit_slices(*arguments, **options)


def objectives(fitted):
    return np.array([report.objective for report in fitted.slices])


def slice_samples(fitted, index):
    """Samples of a slice, (channel, sample), and the model there, by the formula; NaN where invalid."""
    measured, model = fitted.measured, fitted.model
    rows = slice_rows(len(measured.theta_d), len(fitted.profiles))
    masks = [fitted.options[key] for key in ("min_theta_h", "perimeter_mask", "theta_h_step")]
    kept = slice_mask(measured, rows, *masks)[index]
    parameters = (values[index] for values in (model.kappa, model.gamma, model.beta))
    samples = measured.rows([int(rows[index])])[:, kept, 0]
    values = formula(measured.theta_h[kept, None], model.theta_d[index], measured.phi_d, *parameters)
    return samples.reshape(len(samples), -1), values.reshape(len(samples), -1)


def formula(theta_h, theta_d, phi_d, kappa, gamma, beta):
    """Eq. (6) with the azimuthal term but no spike, (channel, ...), for one slice's (channel, lobe)."""
    p, q = np.sin(theta_h) * np.sin(theta_d), AZIMUTHAL_WIDTH * np.cos(theta_h) * np.cos(theta_d)
    azimuth = p / np.hypot(p, q) * np.cos(2.0 * phi_d)
    shape = (*kappa.shape, *(1,) * azimuth.ndim)
    kappa, gamma, beta = (values.reshape(shape) for values in (kappa, gamma, beta))
    return (np.expm1(kappa * np.cos(theta_h) ** gamma) * (1.0 + beta * azimuth)).sum(1)


def sums_of_squares(fitted):
    """Sum of squares over all samples of each slice and channel, channel fastest, by brute force."""
    pairs = [slice_samples(fitted, index) for index in range(len(fitted.profiles))]
    return np.concatenate([np.nansum((samples - values) ** 2, axis=1) for samples, values in pairs])


def known(n_lobes, azimuthal):
    kappa, gamma, beta = map(np.array, KNOWN[n_lobes])
    return lobes(kappa, gamma, beta * azimuthal)
