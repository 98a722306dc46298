"""Spaces from collections of models: of whole materials (Fig. 10), and of lobes by themselves (Fig. 9)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check, library
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.space.correspondence import lobe_slots, pad, two_class_border
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.settings import SpaceSettings, check_channels, check_convention, convention_of
from dsbrdf.space.variables import Sizes, Variables

__all__ = ["FIT", "build_space", "builtin", "lobe_fpca"]

#: Options of `dsbrdf.fit` that make the best models for a space: as many lobes in each.
FIT: dict[str, Any] = {"n_lobes": 5}


def build_space(
    models: Sequence[DSBRDF], *, correspondence: str = "rank", sizes: Sequence[int] | None = None
) -> MaterialSpace:
    """The space of a collection of models.

    Parameters
    ----------
    models : sequence of DSBRDF
        Of the same channels; with any number of lobes, better with the same.
    correspondence : {"rank", "border"}, optional
        Lobes correspond from the flattest on, or from the border of diffuse and specular ones (the paper).
    sizes : sequence of 5 int, optional
        Coefficients of the curves scale, gamma, beta, falloff and colour; by default those of `Sizes`.

    Returns
    -------
    MaterialSpace

    Raises
    ------
    ValueError
        If there are fewer than two models, or they differ in channels or convention; if an option is unknown.

    Examples
    --------
    >>> import dsbrdf
    >>> space = dsbrdf.space.build_space([dsbrdf.library.load(name) for name in ("nickel", "red-fabric", "delrin")])
    >>> space.names
    ('nickel', 'red-fabric', 'delrin')
    """
    models = list(models)
    for model in models:
        _check.instance(model, DSBRDF, "models")
    if len(models) < 2:
        raise ValueError(f"a space needs two models at least, got {len(models)}.")
    convention = next((c for c in map(convention_of, models) if c), "")
    channels = tuple(models[0].channels)
    for model in models:
        check_channels(model, channels)
        check_convention(model, convention)
    variables = Variables(Sizes() if sizes is None else Sizes(*sizes), len(channels))
    settings = SpaceSettings(variables.sizes, correspondence, convention)
    lobes = [variables.of(model.lobes) for model in models]
    sharpness = [variables.sharpness(rows) for rows in lobes]
    border = two_class_border(sharpness) if correspondence == "border" else float("-inf")
    n_diffuse = max(int((each < border).sum()) for each in sharpness)
    slots = [lobe_slots(each, border, n_diffuse) for each in sharpness]
    n_slots = 1 + max(int(slot.max()) for slot in slots)
    padded = [pad(rows, slot, n_slots, variables) for rows, slot in zip(lobes, slots, strict=True)]
    return MaterialSpace(
        settings,
        channels,
        tuple(model.name for model in models),
        tuple(str(model.source.to_json().get("sha256") or "") for model in models),
        np.stack([rows for rows, _ in padded]),
        np.stack([present for _, present in padded]),
        border,
        n_diffuse,
    )


def builtin(without: Iterable[str] = ()) -> MaterialSpace:
    """The space of the built-in library.

    Parameters
    ----------
    without : iterable of str, optional
        Names of materials that are left out, as for a test of what the space says about them.

    Returns
    -------
    MaterialSpace

    Raises
    ------
    ValueError
        If a name is not in the library.

    Examples
    --------
    >>> import dsbrdf
    >>> space = dsbrdf.space.builtin()
    >>> middle = space.blend(space.material("nickel"), space.material("red-fabric"), 0.5)
    """
    space = _of_library()
    for name in [without] if isinstance(without, str) else without:
        space = space.without(name)
    return space


@cache
def _of_library() -> MaterialSpace:
    return build_space([library.load(name) for name in library.names()])


def lobe_fpca(space: MaterialSpace) -> tuple[Fpca, NDArray[np.int_]]:
    """Analysis of all lobes of a space by themselves (Fig. 9).

    Returns
    -------
    fpca : Fpca
        A positive score is on the side of sharper lobes.
    lobes : (observation, 2) ndarray of int
        Material and slot of each; dark lobes that stand for missing ones are left out.

    Examples
    --------
    >>> import dsbrdf
    >>> fpca, lobes = dsbrdf.space.lobe_fpca(dsbrdf.space.builtin())
    >>> fpca.scores.shape[0] == len(lobes)
    True
    """
    variables = space.variables
    sharper = np.zeros(variables.n_numbers)
    variables.parts(sharper).gamma[:] = 1.0
    lobes = space.curves[space.present]
    metric = variables.metric(float(variables.sharpness(lobes).mean()))
    return fit_fpca(lobes, metric, sharper), np.argwhere(space.present)
