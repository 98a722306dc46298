"""Pictures in distant lights, one each, as scattered samples.

A pixel shows one pair of directions, and its value is the reflectance times irradiance and cosine. So the material is
found as from any samples, by `dsbrdf.fit` and what a space expects of values where no picture looks: one light shows
one theta_d, half of its angle to the camera, and how much reflectance rises toward grazing angles is the space's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf.images.light import Light
from dsbrdf.images.picture import Picture
from dsbrdf.images.view import Points
from dsbrdf.measured.samples import Samples
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["Lit", "is_one_direction", "samples"]

Array = NDArray[np.float64]

#: Least cosine toward the light: next to the shadow a pixel is partly in it.
LEAST_COSINE = 0.2
#: Most that the mean over a pixel is of its middle, or the middle of the mean.
MOST_SPREAD = 2.0
#: Fits after the first, each of what pixels are at their middles by the one before.
ROUNDS = 3


def is_one_direction(light: Light) -> bool:
    """Whether a light comes from one direction."""
    return light.map is None and len(light.direction) == 1


@dataclass(frozen=True, eq=False)
class Lit:
    """Points of the lit pixels of a picture.

    Parameters
    ----------
    points : Points
    light : Light
        From one direction.
    """

    points: Points
    light: Light

    @classmethod
    def of(cls, points: Points, light: Light) -> Lit:
        """Those of all points of a picture."""
        cosine = points.middles.normal @ light.direction[0]
        return cls(points.take(np.flatnonzero(cosine > LEAST_COSINE)), light)

    @cached_property
    def middles(self) -> tuple[Array, Array]:
        """Directions (pixel, 3) toward the light and the camera, at the middles of the pixels."""
        return self.points.middles.pairs(self.light.direction[0])

    def values(self, picture: Picture) -> Array:
        """The reflectance (pixel, channel) of a surface that looks everywhere as its middle; NaN where no light is."""
        irradiance = self.light.flux[0] * self.middles[0][:, 2:]
        pixels = picture.flat[self.points.pixel]
        return np.where(irradiance > 0.0, pixels / np.maximum(irradiance, 1e-300), np.nan)

    def spread(self, model: DSBRDF) -> Array:
        """What a model makes of a pixel (pixel, channel), the mean over its points, as a share of its middle."""
        (wi, wo), (at, away) = self.points.pairs(self.light.direction[0]), self.middles
        lit = wi[:, 2] > 0.0
        cosine = np.where(lit, wi[:, 2], 0.0)[:, None]
        made = np.asarray(model.eval(np.where(lit[:, None], wi, wo), wo)) * cosine
        middle = np.asarray(model.eval(at, away)) * at[:, 2:]
        return np.clip(self.points.means(made) / np.maximum(middle, 1e-300), 1.0 / MOST_SPREAD, MOST_SPREAD)


def samples(
    pictures: Sequence[Picture], lit: Sequence[Lit], channels: tuple[str, ...], model: DSBRDF | None = None
) -> Samples:
    """Values of the reflectance at the middles of pixels.

    A pixel is the mean over its points. What that is of the value at its middle, a model tells.

    Raises
    ------
    ValueError
        If no pixel is lit.
    """
    values = [some.values(picture) for picture, some in zip(pictures, lit, strict=True)]
    if model is not None:
        values = [value / some.spread(model) for value, some in zip(values, lit, strict=True)]
    found = np.concatenate(values)
    if not np.isfinite(found).any():
        raise ValueError(f"{pictures[0].name}: no pixel is lit. Check the directions of the lights.")
    wi, wo = (np.concatenate(each) for each in zip(*(some.middles for some in lit), strict=True))
    return Samples(wi, wo, found, channels=channels, name=pictures[0].name)
