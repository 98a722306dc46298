"""Lambert and two GGX lobes with Fresnel terms, fitted in the paper's measure: a fair form of Fig. 7's competitor."""

from __future__ import annotations

from typing import Unpack

import numpy as np

from dsbrdf.baselines.microfacet import GGXPair, Problem, solve
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.baselines._base import SliceOptions, ratio
from dsbrdf.paper.baselines._samples import gather_samples

__all__ = ["fit_ggx_pair"]

#: Azimuths that are looked at; neighbours are alike.
N_PHI = 15
#: Widths that the searches start from; least squares have more local minima than logarithms.
STARTS = ((0.02, 0.15), (0.1, 0.4), (0.005, 0.05), (0.03, 0.5))


def fit_ggx_pair(measured: MeasuredBRDF, **options: Unpack[SliceOptions]) -> GGXPair:
    """Fit Lambert and two GGX lobes by least squares over the samples of the slices, at 15 azimuths.

    `dsbrdf.baselines.fit_ggx_pair` fits the same 13 numbers to the whole hemisphere, by logarithms.

    Parameters
    ----------
    measured : MeasuredBRDF
    n_slices, min_theta_h, perimeter_mask, theta_h_step : optional
        Which samples are fitted; see `dsbrdf.paper.collapse.slice_profiles`.

    Returns
    -------
    GGXPair
        The narrower lobe first.

    Raises
    ------
    ValueError
        If an option is out of range, or no slice has a valid sample.
    """
    samples = gather_samples(measured, **options)
    n_phi = samples.wi.shape[1]
    looked_at = np.unique((np.arange(N_PHI) + 0.5) * n_phi // N_PHI).astype(int)
    wi, wo, count, total = (x[:, looked_at] for x in (samples.wi, samples.wo, samples.count, samples.total))
    some = (count > 0.0).any(-1) & (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
    count, total = count[some], total[some]
    mean = ratio(total, count)
    # Squares in units of what there is, so that the search knows when to stop
    energy = max(float((count * mean**2).sum()), 1e-300)
    problem = Problem(wi[some], wo[some], mean, np.sqrt(count / energy), None)
    return GGXPair(*solve(problem, STARTS), name=measured.name)
