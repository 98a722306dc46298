"""A space as a Gaussian prior over the unknowns of the estimator (Section 6.C).

The unknowns of a material are its logarithms of kappa and gamma, beta, falloff and colours, as `Variables.unknowns`
lays them out. Their covariance over the materials of a space has fewer ranks than there are materials: taken as it is,
it would forbid whatever no material does. So the principal components of the standardised unknowns that hold most of
the variance are kept, and what these leave out of each unknown stays as a variance of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf._brief import Brief
from dsbrdf.space.variables import Sizes

if TYPE_CHECKING:
    from dsbrdf.space.material_space import MaterialSpace

__all__ = ["Gaussian", "of_space"]

Array = NDArray[np.float64]

#: Share of the variance that the components kept hold.
KEPT_SHARE = 0.9
#: Least standard deviation of an unknown, and least share of its variance that the components leave to itself.
LEAST_DEVIATION, LEAST_SHARE = 0.03, 0.03


@dataclass(frozen=True, eq=False, repr=False)
class Gaussian(Brief):
    """What materials are like, as the estimator takes it.

    Parameters
    ----------
    sizes : Sizes
        Coefficients of the curves of a lobe.
    n_lobes : int
    mean : (unknown,) ndarray
        For each lobe scale, gamma, beta and falloff; then for each channel, for each lobe, its colour. One channel has
        no colours.
    precision : (unknown, unknown) ndarray
        Inverse of the covariance.
    channels : tuple of str

    Examples
    --------
    >>> import dsbrdf
    >>> gaussian = dsbrdf.space.builtin().gaussian()
    >>> gaussian.mean.shape
    (100,)
    """

    sizes: Sizes
    n_lobes: int
    mean: Array
    precision: Array
    channels: tuple[str, ...]


def of_space(space: MaterialSpace) -> Gaussian:
    """The Gaussian of the materials of a space."""
    unknowns = space.variables.unknowns(space.curves)
    n = len(unknowns)
    mean = unknowns.mean(0)
    deviation = np.sqrt(unknowns.var(0, ddof=1) + LEAST_DEVIATION**2)
    _, singular, functions = np.linalg.svd((unknowns - mean) / deviation, full_matrices=False)
    variances = singular**2 / (n - 1)
    kept = np.cumsum(variances) < KEPT_SHARE * variances.sum()
    # The one that reaches the share is kept too
    kept = np.r_[True, kept[:-1]]
    correlation = (functions[kept].T * variances[kept]) @ functions[kept]
    correlation += np.diag(np.maximum(1.0 - np.diag(correlation), LEAST_SHARE))
    # The mean of so many materials is known that well
    covariance = (1.0 + 1.0 / n) * correlation * np.outer(deviation, deviation)
    precision = np.linalg.inv(covariance)
    return Gaussian(
        space.settings.sizes, space.n_slots, mean, 0.5 * (precision + precision.T), space.channels
    )
