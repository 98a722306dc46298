"""A picture as a linear function of the reflectance, `picture = weights values`.

The reflectance stands for its values at nodes of theta_h, theta_d and of the azimuthal factor times cos(2 phi_d);
between them it is cubic, cubic and quadratic. The weights are made once for normals, directions of view and light, by
the kernel (`crates/dsbrdf-core/src/picture.rs`), and serve any reflectance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.fitting.uncertainty import value_jacobian
from dsbrdf.geometry import half_diff
from dsbrdf.images.light import Light
from dsbrdf.images.view import Points
from dsbrdf.model.lobes import MAX_LN_KAPPA, SHARED, Lobes, curve_design

__all__ = ["NODES", "Nodes", "rendered", "weights"]

Array = NDArray[np.float64]

#: Pixels handled together where a picture is rendered.
CHUNK = 512
#: Beyond this 1 - cos(theta_h) the value there holds: a lobe's falloff may have no end on the horizon.
MOST_DEPTH = 1.0 - float(np.cos(np.deg2rad(89.0)))
#: Azimuths of a node, as in the kernel.
AZIMUTHS = np.sqrt(0.75) * np.array([-1.0, 0.0, 1.0])


@dataclass(frozen=True)
class Nodes:
    """Nodes of a reflectance.

    Parameters
    ----------
    n_h, n_d : int
        Along theta_h and theta_d, even in the coordinates of the kernel.
    """

    n_h: int = 40
    n_d: int = 16

    @cached_property
    def positions(self) -> tuple[Array, Array]:
        """`ln cos(theta_h)` and `cos(theta_d)` (position,)."""
        u = np.arange(self.n_h) / (self.n_h - 1)
        v = np.arange(self.n_d) / (self.n_d - 1)
        log_cos, x = np.meshgrid(np.log1p(-np.minimum(u**4, MOST_DEPTH)), 1.0 - v**2, indexing="ij")
        return log_cos.ravel(), x.ravel()

    def values(self, lobes: Lobes) -> Array:
        """Values (node, channel)."""
        log_cos, x = self.positions
        curves = {
            name: curve_design(x, getattr(lobes, name).shape[1]) @ getattr(lobes, name).T for name in SHARED
        }
        colour = np.einsum("nj,ckj->nck", curve_design(x, lobes.colour.shape[2]), lobes.colour)
        power = curves["scale"] + np.exp(curves["gamma"]) * log_cos[:, None]
        height = np.expm1(np.exp(np.minimum(power[:, None] + colour, MAX_LN_KAPPA)))
        falloff = (curves["falloff"] * log_cos[:, None])[:, None]
        factor = np.exp(curves["beta"][:, None] * AZIMUTHS[:, None] + falloff)
        return np.asarray(np.einsum("nck,nak->nac", height, factor).reshape(-1, lobes.n_channels))

    def linearise(self, lobes: Lobes) -> tuple[Array, Array]:
        """Values (node, channel), and derivatives (node, channel, unknown)."""
        log_cos, x = self.positions
        azimuth = np.broadcast_to(AZIMUTHS, (len(x), len(AZIMUTHS)))
        value, jacobian = value_jacobian(lobes, log_cos, x, azimuth)
        return value.reshape(-1, value.shape[-1]), jacobian.reshape(-1, *jacobian.shape[2:])


NODES = Nodes()


def weights(points: Points, light: Light, nodes: Nodes = NODES) -> Array:
    """Weights (channel, pixel, node) of values at nodes in a picture, a view."""
    found = _core.picture_weights(
        points.normal,
        points.view,
        points.start.tolist(),
        light.direction,
        light.flux,
        light.radius,
        light.parts,
        light.n_roots,
        (nodes.n_h, nodes.n_d),
        half_diff.AZIMUTHAL_WIDTH,
    )
    return np.moveaxis(found.reshape(len(found), -1, light.n_channels), -1, 0)


def rendered(
    lobes: Lobes, points: Points, light: Light, step: Callable[[int], None] = lambda _: None
) -> Array:
    """Radiance (pixel, channel) of what has these lobes."""
    values = NODES.values(lobes)
    pixels = np.empty((len(points.pixel), lobes.n_channels))
    for start in range(0, len(points.pixel), CHUNK):
        some = np.arange(start, min(start + CHUNK, len(points.pixel)))
        made = weights(points.take(some), light)
        pixels[some] = np.stack([w @ value for w, value in zip(made, values.T, strict=True)], axis=1)
        step(len(some))
    return pixels
