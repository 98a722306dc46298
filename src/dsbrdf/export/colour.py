"""Models of any channels as ones of red, green and blue: what most programs want."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import colour
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["Coloured", "in_colour", "lobes_in_colour", "take_channels", "wavelengths"]

Array = NDArray[np.float64]

RGB = ("r", "g", "b")
#: Cells of the table that a model of colours is fitted to, of one of wavelengths.
TABLE = (45, 30, 8)


class Coloured:
    """A reflectance of three channels whose values are sums of those of another.

    Parameters
    ----------
    model : DSBRDF
    weights : (3, channel) ndarray
    """

    n_channels = 3
    channels = RGB

    def __init__(self, model: DSBRDF, weights: Array) -> None:
        self.model, self.weights, self.name = model, weights, model.name

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., 3) in 1/sr, none below zero."""
        return np.maximum(np.asarray(self.model.eval(wi, wo)) @ self.weights.T, 0.0)


def wavelengths(channels: Sequence[str]) -> Array | None:
    """Wavelengths in nm that all channels are named after, as in 450nm or 450; None if they are not."""
    found = [colour.wavelength(name.strip()) for name in channels]
    values = np.array([nm for nm in found if nm is not None])
    return values if len(values) == len(found) and (values >= 100.0).all() else None


def take_channels(model: DSBRDF, names: Sequence[str]) -> DSBRDF:
    """The model of some channels, in the order of their names.

    Raises
    ------
    ValueError
        If there is no such channel.
    """
    channels = list(model.channels)
    for name in names:
        if name not in channels:
            raise ValueError(f"there is no channel {name!r}; the model has {', '.join(channels)}.")
    chosen = [channels.index(name) for name in names]
    return model.replace(lobes=model.lobes.replace(colour=model.lobes.numpy.colour[chosen]), channels=names)


def in_colour(model: DSBRDF) -> DSBRDF | Coloured:
    """A model in linear sRGB: grey of one channel, by CIE 1931 under D65 of wavelengths and of X, Y and Z.

    Three channels of other names are taken as red, green and blue.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    """
    names = list(model.channels)
    if model.n_channels == 1:
        lobes = model.lobes.numpy
        return model.replace(lobes=lobes.replace(colour=np.repeat(lobes.colour, 3, axis=0)), channels=RGB)
    if sorted(names) == sorted(RGB):
        return model if names == list(RGB) else take_channels(model, RGB)
    try:
        return Coloured(model, colour.rgb_weights(names))
    except ValueError:
        if model.n_channels == 3:
            return model
    raise ValueError(
        f"{model.name or 'the model'}: its {model.n_channels} channels ({', '.join(names)[:100]}) tell no "
        "colour. Choose one or three of them: --channels A,B,C, or dsbrdf.export.export(..., channels=...)."
    )


def lobes_in_colour(model: DSBRDF) -> DSBRDF:
    """`in_colour` as lobes: wavelengths are fitted anew in colour, with as many lobes.

    Raises
    ------
    ValueError
        If the channels tell no colour.
    """
    found = in_colour(model)
    if isinstance(found, DSBRDF):
        return found
    from dsbrdf.fitting import fit
    from dsbrdf.measured.table import tabulate

    return fit(tabulate(found.eval, model.name, shape=TABLE), model.n_lobes).model
