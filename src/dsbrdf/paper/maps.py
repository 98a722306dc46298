"""Figs. 9 and 10: lobes and materials as spheres on their first principal functions. Needs the extra `[plot]`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf.paper.fit import fit_slices
from dsbrdf.paper.slice_fit import ConvergenceWarning
from dsbrdf.paper.slices import Slices
from dsbrdf.paper.space import PaperSpace, build_space
from dsbrdf.paper.tables import Tables
from dsbrdf.plot import space as drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["lobe_map", "material_map", "paper_space"]


def paper_space(tables: Tables, progress: Callable[[str], None]) -> PaperSpace:
    """The space of all materials, lobes along the border of diffuse and specular ones as in the paper.

    Of logarithms: of kappa and gamma as they are, the gamma of a few lobes that nobody sees makes most of the variance
    (decision record 0011). Lobes are followed over theta_d: curves of lobes that swap have no meaning.
    """
    models = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for name in tables.names:
            progress(name)
            models.append(fit_slices(tables.load(name)).model)
    return build_space(models)


def lobe_map(space: PaperSpace) -> Figure:
    """Each lobe of each channel as a sphere at the first two scores of the bivariate analysis (Fig. 9)."""
    fpca = space.lobes
    pictures = [
        _sphere(space.decode(space.curves[material, channel, slot][None, None]))
        for material, channel, slot in np.argwhere(space.present)
    ]
    title = f"{len(pictures)} lobes on the first two bivariate principal functions"
    return drawing._map(pictures, fpca.scores, fpca.explained, title)


def material_map(space: PaperSpace) -> Figure:
    """Each material as a sphere at its first two scores (Fig. 10)."""
    fpca = space.materials
    pictures = [_sphere(space.decode(curves)) for curves in space.curves]
    title = f"{len(pictures)} materials on the first two principal functions"
    return drawing._map(pictures, fpca.scores, fpca.explained, title, space.names)


def _sphere(model: Slices) -> NDArray[np.float64]:
    return drawing._picture(model)  # type: ignore[arg-type]
