"""The delta term of Section 6: light within a degree of the mirror direction that no lobe describes.

Samples nearer to the pole than a degree are not fitted. Where the lobes fall short of them, a narrow cap of the half
vector is added, whose height is computed after the fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import MIN_THETA_H, SliceProfile, stack_profiles

__all__ = ["SIN2_WIDTH", "cap", "spike_heights"]

#: Square of the sine of the theta_h at which a spike ends.
SIN2_WIDTH = float(np.sin(MIN_THETA_H) ** 2)
#: A spike is kept if what lobes miss below a degree is at least this share of what was measured there ...
MIN_SHARE = 0.1
#: ... and if the spike removes at least this share of the squares that are left there.
MIN_GAIN = 0.5


def cap(sin2: ArrayLike) -> NDArray[np.float64]:
    """Shape of a spike at `sin(theta_h)^2`: 1 at the pole, falling in proportion to 0 at one degree."""
    return np.maximum(1.0 - np.asarray(sin2) / SIN2_WIDTH, 0.0)


def spike_heights(
    near_pole: Sequence[SliceProfile],
    kappa: NDArray[np.float64],
    gamma: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Heights (theta_d, channel) in 1/sr of the spikes that lobes leave; all zero where the data do not call for one.

    Parameters
    ----------
    near_pole : sequence of SliceProfile
        The slices with no lower cut of theta_h.
    kappa, gamma : (theta_d, channel, lobe) ndarray

    Notes
    -----
    Least squares of the mean over phi_d less the lobes, weighted by counts, over samples below one degree; never
    negative. One decision for the material: kept if the lobes miss a tenth of the light there (root mean square) and
    the spikes halve the squares.
    """
    theta_d, theta_h, moments = stack_profiles(near_pole)
    shape = cap(np.sin(theta_h) ** 2)[:, None]
    count = moments[..., 0] * (shape > 0.0)
    mean = np.divide(moments[..., 1], moments[..., 0], out=np.zeros_like(count), where=count > 0.0)
    lobes, _ = metrics.profile_model(theta_h, theta_d, kappa, gamma, np.zeros_like(kappa))
    missing = np.where(count > 0.0, mean - lobes, 0.0)
    weight = (count * shape**2).sum(-1)
    height = np.divide(
        (count * shape * missing).sum(-1), weight, out=np.zeros_like(weight), where=weight > 0.0
    )
    height = np.maximum(height, 0.0)

    before = float((count * missing**2).sum())
    after = float((count * (missing - height[..., None] * shape) ** 2).sum())
    energy = float((count * mean**2).sum())
    called_for = before > MIN_SHARE**2 * energy and after <= (1.0 - MIN_GAIN) * before
    return height if called_for else np.zeros_like(height)
