"""The interface that the baselines share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff

__all__ = ["AbstractBaseline", "Array"]

Array = NDArray[np.float64]


class AbstractBaseline(ABC):
    """A reflectance with the interface of `dsbrdf.DSBRDF`.

    Parameters
    ----------
    name : str
        Of the material.
    label : str
        Of the model, for tables and figures.
    """

    name: str
    label: ClassVar[str]

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """How many numbers were fitted."""

    @abstractmethod
    def _values(self, wi: Array, wo: Array) -> Array:
        """Values (..., channel) of unit vectors (..., 3), finite below the horizon too."""

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Values for pairs of directions.

        Parameters
        ----------
        wi, wo : (..., 3) array_like
            Unit vectors toward the light and the viewer, normal +z; broadcast against each other.

        Returns
        -------
        (..., channel) ndarray, 1/sr, without the cosine
            Zero where a direction is below the horizon. The same to the last bit with `wi` and `wo`
            exchanged.

        Raises
        ------
        ValueError
            If a direction is not a unit vector.
        """
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        above = (wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0)
        return np.where(above[..., None], self._values(wi, wo), 0.0)

    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> Array:
        """Values (..., channel) in 1/sr at half and difference angles in radians, which broadcast.

        Zero where one of the two directions would be below the horizon.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        return self.eval(*half_diff.to_directions(theta_h, theta_d, phi_d))
