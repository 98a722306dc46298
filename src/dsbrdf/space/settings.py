"""How materials become points of a space, and which models go into one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.space.correspondence import CORRESPONDENCES
from dsbrdf.space.fpca import squared_norm
from dsbrdf.space.variables import Variables

__all__ = ["SpaceSettings", "check_channels", "check_convention", "convention_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpaceSettings:
    """How materials become points of a space; spaces of other settings do not mix.

    Parameters
    ----------
    variables : Variables, optional
    correspondence : {"rank", "border"}, optional
        See `dsbrdf.space.correspondence`.
    basis : CurveBasis, optional
    convention : str, optional
        Of the tables that were fitted (`dsbrdf.MeasuredBRDF.convention`); empty if unknown.

    Raises
    ------
    ValueError
        If an option is unknown.
    """

    variables: Variables = field(default_factory=Variables)
    correspondence: str = "rank"
    basis: CurveBasis = field(default_factory=CurveBasis)
    convention: str = ""

    def __post_init__(self) -> None:
        if self.correspondence not in CORRESPONDENCES:
            raise ValueError(
                f"'correspondence' must be {' or '.join(map(repr, CORRESPONDENCES))}, got {self.correspondence!r}."
            )

    def weights(self, mean: Array) -> Array:
        """Weights (function,) in the inner product of functions whose mean curves (function, coefficient) are given.

        Eq. (7) for kappa and gamma as they are. Logarithms are on one scale already, and their mean depends on a unit.
        """
        if self.variables.logarithmic:
            return np.ones(len(mean))
        norm = squared_norm(mean, self.basis)
        kind = np.arange(len(norm)) % min(len(norm), len(self.variables.names))
        # A slot that hardly any material has a lobe for must not outweigh all others
        typical = np.array([norm[kind == i].mean() for i in range(kind.max() + 1)])[kind]
        weights: Array = 1.0 / np.maximum(norm, np.maximum(1e-3 * typical, 1e-12))
        return weights


def convention_of(model: DSBRDF) -> str:
    """Convention of the table that a model was fitted to; empty if unknown."""
    fitted: Any = model.fit_options.get("convention")
    return str(fitted or "")


def check_channels(model: DSBRDF, n_channels: int) -> None:
    """Raise a ValueError unless a model has these channels."""
    if model.n_channels != n_channels:
        raise ValueError(
            f"{model.name or 'the model'}: {model.n_channels} channels, where the space has {n_channels}. "
            "Build a space of models with the same channels."
        )


def check_convention(model: DSBRDF, convention: str) -> None:
    """Raise a ValueError if a model was fitted with another convention; one that is unknown passes."""
    other = convention_of(model)
    if convention and other and other != convention:
        raise ValueError(
            f"{model.name or 'the model'}: fitted with the {other!r} convention of table cells, where the space has "
            f"{convention!r}: its peaks are shifted against the others'. Read and fit all tables with one convention."
        )
