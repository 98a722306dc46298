"""Spaces from collections of models: of whole materials (Fig. 10), and of lobes by themselves (Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.space.correspondence import gamma_norm, lobe_slots, pad, two_class_border
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.settings import SpaceSettings, check_channels, check_convention, convention_of
from dsbrdf.space.variables import Variables

__all__ = ["FIT", "build_space", "lobe_fpca"]

#: Options of `dsbrdf.fit` that make the best models for a space: as many lobes in each, tails weighed as peaks.
FIT: dict[str, Any] = {"n_lobes": 3, "loss": "log", "perimeter_mask": False, "min_theta_h": 0.0}


def build_space(
    models: Sequence[DSBRDF],
    *,
    logarithmic: bool = True,
    correspondence: str = "rank",
    azimuthal: bool = False,
    n_knots: int = CurveBasis().n_knots,
) -> MaterialSpace:
    """The space of a collection of models.

    Parameters
    ----------
    models : sequence of DSBRDF
        Of the same channels; with any number of lobes, better with the same.
    logarithmic : bool, optional
        Curves of logarithms; otherwise kappa and gamma as they are (the paper).
    correspondence : {"rank", "border"}, optional
        Lobes correspond from the flattest on, or from the border of diffuse and specular ones (the paper).
    azimuthal : bool, optional
        Take beta into the space too.
    n_knots : int, optional
        Of the splines over theta_d.

    Returns
    -------
    MaterialSpace

    Raises
    ------
    ValueError
        If there are fewer than two models, or they differ in channels or convention; if an option is unknown.
    """
    models = list(models)
    if len(models) < 2:
        raise ValueError(f"a space needs two models at least, got {len(models)}.")
    convention = next((c for c in map(convention_of, models) if c), "")
    for model in models:
        check_channels(model, models[0].n_channels)
        check_convention(model, convention)
    settings = SpaceSettings(
        Variables(logarithmic, azimuthal), correspondence, CurveBasis(n_knots), convention
    )
    lobes = [settings.variables.smooth(model, settings.basis) for model in models]
    norms = [gamma_norm(curves, settings.basis) for curves in lobes]
    border = two_class_border(norms, logarithmic) if correspondence == "border" else float("-inf")
    n_diffuse = max(int((norm < border).sum(1).max()) for norm in norms)
    slots = [lobe_slots(norm, border, n_diffuse) for norm in norms]
    n_slots = 1 + max(int(slot.max()) for slot in slots)
    padded = [pad(c, s, n_slots, settings.variables.flat) for c, s in zip(lobes, slots, strict=True)]
    return MaterialSpace(
        settings,
        tuple(model.name for model in models),
        tuple(str(model.source.to_json().get("sha256") or "") for model in models),
        np.stack([curves for curves, _ in padded]),
        np.stack([present for _, present in padded]),
        border,
        n_diffuse,
    )


def lobe_fpca(space: MaterialSpace) -> tuple[Fpca, NDArray[np.int_]]:
    """Analysis of all lobes of a space by themselves, of two functions each: the bivariate one of Fig. 9.

    Returns
    -------
    fpca : Fpca
        A positive score is on the side of sharper lobes.
    lobes : (observation, 3) ndarray of int
        Material, channel and slot of each; flat lobes that stand for missing ones are left out.
    """
    curves = space.curves[space.present][:, :2]
    sharper = np.zeros(curves.shape[1:])
    sharper[1] = 1.0
    weights = space.settings.weights(curves.mean(0))
    return fit_fpca(curves, space.settings.basis, weights, sharper), np.argwhere(space.present)
