"""A space as a Gaussian prior over the unknowns of the estimator (Section 6.C)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.space.variables import Sizes

if TYPE_CHECKING:
    from dsbrdf.space.material_space import MaterialSpace

__all__ = ["Gaussian", "of_space"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gaussian:
    sizes: Sizes
    n_lobes: int
    channels: tuple[str, ...]
    mean: Array
    precision: Array


def of_space(space: MaterialSpace) -> Gaussian:
    raise NotImplementedError
