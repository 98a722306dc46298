"""Pictures in distant lights, one each, as scattered samples.

A pixel shows one pair of directions, and its value is the reflectance times irradiance and cosine. So the material is
found as from any samples, by `dsbrdf.fit` and what a space expects of values where no picture looks: one light shows
one theta_d, half of its angle to the camera, and how much reflectance rises toward grazing angles is the space's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsbrdf.images.light import Light
from dsbrdf.images.picture import Picture
from dsbrdf.images.view import Points
from dsbrdf.measured.samples import Samples

__all__ = ["is_one_direction", "samples"]

#: Least cosine toward the light: next to the shadow a pixel is partly in it.
LEAST_COSINE = 0.2


def is_one_direction(light: Light) -> bool:
    """Whether a light comes from one direction."""
    return light.map is None and len(light.direction) == 1


def samples(
    pictures: Sequence[Picture],
    of_points: Sequence[Points],
    lights: Sequence[Light],
    channels: tuple[str, ...],
) -> Samples:
    """Values of the reflectance at the middles of pixels.

    Raises
    ------
    ValueError
        If no pixel is lit.
    """
    wi, wo, values = [], [], []
    for picture, seen, light in zip(pictures, of_points, lights, strict=True):
        middles = seen.middles
        frame = middles.frames
        toward, view = frame @ light.direction[0], (frame @ middles.view[..., None])[..., 0]
        lit = toward[:, 2] > LEAST_COSINE
        wi.append(toward[lit])
        wo.append(view[lit])
        irradiance = light.flux[0] * toward[lit, 2:]
        pixels = picture.flat[middles.pixel[lit]]
        values.append(np.where(irradiance > 0.0, pixels / np.maximum(irradiance, 1e-300), np.nan))
    found = np.concatenate(values)
    if not np.isfinite(found).any():
        raise ValueError(f"{pictures[0].name}: no pixel is lit. Check the directions of the lights.")
    return Samples(np.concatenate(wi), np.concatenate(wo), found, channels=channels, name=pictures[0].name)
