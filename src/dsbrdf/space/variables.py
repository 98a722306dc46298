"""What the curves of a space are of: kappa and gamma as they are (the paper), or logarithms; and beta.

The logarithms are those of the height of a lobe, `ln(expm1(kappa) + e)`, e = `dsbrdf.paper.metrics.LOG_OFFSET`, and
`ln(1 + gamma)`. They are finite for a lobe that is not there, and nearly constant where a change cannot be seen: below
0.001/sr, and about gamma = 0. Equal differences of the first are equal ratios of reflectance, dark or bright; of kappa
itself, or of its logarithm, they are not, so that a highlight would take on a colour where channels are truncated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper.curves import CurveBasis, sensitivity
from dsbrdf.paper.metrics import LOG_OFFSET

__all__ = ["FLAT", "Variables"]

Array = NDArray[np.float64]

#: The kappa of a lobe that is not there, and the greatest of any, `expm1` of which is 1e13/sr.
FLAT, MAX_KAPPA = 1e-12, 30.0
#: Beyond a lobe is a mirror.
MAX_GAMMA = 1e6
#: Slices count in smoothing by what they say of the lobe, at least this share of the slice that says most.
LEAST_WEIGHT = 0.1


@dataclass(frozen=True)
class Variables:
    """Functions of a lobe, in this order: kappa, gamma and, where wanted, beta.

    Parameters
    ----------
    logarithmic : bool
    azimuthal : bool
        Whether beta is among them; never a logarithm.
    """

    logarithmic: bool = True
    azimuthal: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of the functions."""
        return ("kappa", "gamma", "beta") if self.azimuthal else ("kappa", "gamma")

    @property
    def flat(self) -> float:
        """The first function of a lobe that is not there."""
        return float(np.log(LOG_OFFSET)) if self.logarithmic else 0.0

    def of(self, model: DSBRDF) -> Array:
        """Variables (theta_d, channel, lobe, function) of a model's lobes."""
        kappa, gamma, beta = (np.asarray(getattr(model, n), dtype=float) for n in ("kappa", "gamma", "beta"))
        kappa, gamma = np.minimum(kappa, MAX_KAPPA), np.minimum(gamma, MAX_GAMMA)
        if self.logarithmic:
            kappa, gamma = np.log(np.expm1(kappa) + LOG_OFFSET), np.log1p(gamma)
        return np.stack([kappa, gamma, beta][: len(self.names)], axis=-1)

    def parameters(self, values: Array) -> tuple[Array, Array, Array]:
        """kappa, gamma and beta (...) of variables (..., function), all within their ranges."""
        kappa, gamma = values[..., 0], values[..., 1]
        if self.logarithmic:
            kappa = np.log1p(np.maximum(np.exp(np.minimum(kappa, MAX_KAPPA)) - LOG_OFFSET, 0.0))
            gamma = np.expm1(np.minimum(gamma, np.log1p(MAX_GAMMA)))
        beta = np.clip(values[..., 2], -1.0, 1.0) if self.azimuthal else np.zeros_like(kappa)
        return np.clip(kappa, FLAT, MAX_KAPPA), np.clip(gamma, 0.0, MAX_GAMMA), beta

    def slopes(self, kappa: Array, gamma: Array) -> tuple[Array, Array]:
        """Derivatives of kappa and gamma by their variables; they go on below zero, so that a search finds back."""
        if self.logarithmic:
            height = np.expm1(kappa)
            return (height + LOG_OFFSET) / (height + 1.0), gamma + 1.0
        return np.ones_like(kappa), np.ones_like(gamma)

    def smooth(self, model: DSBRDF, basis: CurveBasis) -> Array:
        """Coefficients (channel, lobe, function, coefficient) of curves through a model's slices.

        Least squares weighted by `dsbrdf.paper.curves.sensitivity`: a slice on which a lobe is dark says little of it.
        """
        weights = sensitivity(model)
        peak = weights.max(0)
        weights = np.divide(weights, peak, out=np.ones_like(weights), where=peak > 0.0)
        weights = np.maximum(weights, LEAST_WEIGHT)
        design = basis.design(model.theta_d)
        normal = np.einsum("tcl,ti,tj->clij", weights, design, design)
        right = np.einsum("tcl,ti,tclf->clif", weights, design, self.of(model))
        # Few slices leave some coefficients open: of those, the least
        coefficients: Array = np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ right
        return coefficients.swapaxes(-1, -2)
