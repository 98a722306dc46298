"""Material and light of a picture when neither is known: the material first, with the light integrated out.

The best material and light together explain a picture by too sharp a material in too flat a light (the known failure of joint
estimates in blind deconvolution). So the light is a Gaussian process on the sphere, of unknown mean and contrast, its
channels alike but for a part of each, and what is maximised over materials is the probability of the picture under all such
lights, times the prior of the space. The light follows as the mean of its posterior under the material found.

With A the radiance of each pixel per radiance of each cell of the light, K the kernel and N the noise, the pixels of all
channels are normal with mean `mu A 1` and covariance `mu^2 s^2 A K A' + N`. `mu`, a channel's mean radiance, is the ratio of the
sums of `pixels` and of `A 1`: nothing here depends on a factor a channel of the material.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf.geometry import half_diff, panorama
from dsbrdf.images.linear import NODES
from dsbrdf.images.search import raw_lobes
from dsbrdf.images.view import Points
from dsbrdf.model.lobes import Lobes
from dsbrdf.space import Gaussian

__all__ = ["Grid", "Scene", "search_material"]

Array = NDArray[np.float64]

#: Angle, radians, over which the light's correlation falls to 1 / e.
REACH = 0.35
#: Share of the light's variance that its channels have in common.
COMMON = 0.9
#: Noise of a pixel: relative, and as a share of the mean of its channel. It stands for what the cells are too coarse for too.
RELATIVE, FLOOR = 0.05, 0.03
#: Standard deviations of the light over its mean that are tried.
CONTRASTS = (0.5, 1.0, 2.0, 4.0, 8.0)
#: Directions along a side of a cell.
SUB = 2


@dataclass(frozen=True)
class Grid:
    """Cells of an unknown light.

    Parameters
    ----------
    rows : int
        Twice as many columns.
    """

    rows: int

    @cached_property
    def directions(self) -> Array:
        """Toward the middles (cell, 3)."""
        return panorama.directions(self.rows, 2 * self.rows).reshape(-1, 3)

    @cached_property
    def parts(self) -> tuple[Array, Array]:
        """Directions (cell, part, 3) and solid angles (cell, part) of the parts of the cells."""
        n = SUB * self.rows
        fine = panorama.directions(n, 2 * n).reshape(self.rows, SUB, 2 * self.rows, SUB, 3)
        angles = np.broadcast_to(panorama.solid_angles(n, 2 * n), (n, 2 * n))
        angles = angles.reshape(self.rows, SUB, 2 * self.rows, SUB)
        cells = 2 * self.rows**2
        return (
            np.ascontiguousarray(fine.swapaxes(1, 2)).reshape(cells, -1, 3),
            np.ascontiguousarray(angles.swapaxes(1, 2)).reshape(cells, -1),
        )

    @cached_property
    def kernel(self) -> Array:
        """Correlation (cell, cell) of the light."""
        return kernel(self.directions, self.directions)


def kernel(a: Array, b: Array) -> Array:
    """Correlation (n, m) of the light in directions (n, 3) and (m, 3)."""
    return np.asarray(np.exp(-np.arccos(np.clip(a @ b.T, -1.0, 1.0)) / REACH))


@dataclass(frozen=True, eq=False)
class Scene:
    """Some pixels of a picture, and the cells of its light.

    Parameters
    ----------
    points : Points
        One a pixel.
    pixels : (pixel, channel) ndarray
    grid : Grid
    """

    points: Points
    pixels: Array
    grid: Grid

    @cached_property
    def _frames(self) -> tuple[Array, Array]:
        """Rotations (pixel, 3, 3) to frames with the normal as +z, and the view (pixel, 3) in them."""
        normal = self.points.normal
        helper = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        across = np.cross(normal, helper)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        rotation = np.stack([across, np.cross(normal, across), normal], axis=1)
        return rotation, np.einsum("pij,pj->pi", rotation, self.points.view)

    def transfer(self, lobes: Lobes) -> Array:
        """Radiance (channel, pixel, cell) of pixels per radiance of cells."""
        directions, angles = self.grid.parts
        n_cells, n_parts = angles.shape
        rotation, view = self._frames
        found = np.empty((lobes.n_channels, len(self.pixels), n_cells))
        flat = directions.reshape(-1, 3)
        for i, (turn, wo) in enumerate(zip(rotation, view, strict=True)):
            wi = flat @ turn.T
            up = wi[:, 2] > 0.0
            shown = np.zeros((len(flat), lobes.n_channels))
            toward = np.ascontiguousarray(wi[up])
            values = _core.eval(
                toward,
                np.ascontiguousarray(np.broadcast_to(wo, toward.shape)),
                *(np.ascontiguousarray(part) for part in lobes.parts),
                half_diff.AZIMUTHAL_WIDTH,
            )
            shown[up] = values * (wi[up, 2] * angles.ravel()[up])[:, None]
            found[:, i] = shown.reshape(n_cells, n_parts, -1).sum(1).T
        return found

    def by_nodes(self, slope: Array) -> Array:
        """Derivatives (node, channel) by the values at nodes, of those (channel, pixel, cell) by the transfer."""
        directions, angles = self.grid.parts
        flat = np.ascontiguousarray(directions.reshape(-1, 3))
        n_parts = angles.shape[1]
        none, still = np.full((len(flat), 4), -1, dtype=np.int32), np.zeros(len(flat))
        total = np.zeros((NODES.n_h * NODES.n_d * 3, slope.shape[0]))
        for i in range(len(self.pixels)):
            flux = np.repeat(slope[:, i].T, n_parts, axis=0) * angles.reshape(-1, 1)
            total += _core.picture_weights(
                self.points.normal[i : i + 1],
                self.points.view[i : i + 1],
                [0, 1],
                flat,
                np.ascontiguousarray(flux),
                still,
                none,
                len(flat),
                (NODES.n_h, NODES.n_d),
                half_diff.AZIMUTHAL_WIDTH,
            ).reshape(total.shape)
        return total

    def evidence(self, transfer: Array, contrast: float, *, slope: bool = False) -> tuple[float, Array | None]:
        """Negative logarithm of the probability of the pixels, and its derivatives (channel, pixel, cell) if asked for."""
        y = self.pixels.T
        white = transfer.sum(-1)
        sums = np.maximum(white.sum(1), 1e-300)
        mean = y.sum(1) / sums
        n_channels, n = y.shape
        share = COMMON + (1.0 - COMMON) * np.eye(n_channels)
        factor = contrast**2 * share * np.outer(mean, mean)
        spread = transfer @ self.grid.kernel
        blocks = np.einsum("cpl,dql->cpdq", transfer, spread, optimize=True)
        covariance = factor[:, None, :, None] * blocks
        noise = (RELATIVE * y) ** 2 + (FLOOR * y.mean(1, keepdims=True)) ** 2
        matrix = covariance.reshape(n_channels * n, -1) + np.diag(noise.ravel())
        off = (y - mean[:, None] * white).ravel()
        lower = np.linalg.cholesky(0.5 * (matrix + matrix.T))
        inverse = np.linalg.inv(lower)
        weighted = inverse.T @ (inverse @ off)
        value = 0.5 * float(off @ weighted) + float(np.log(np.diag(lower)).sum())
        if not slope:
            return value, None
        q = 0.5 * (inverse.T @ inverse - np.outer(weighted, weighted)).reshape(n_channels, n, n_channels, n)
        by_transfer = 2.0 * np.einsum("cd,cpdq,dql->cpl", factor, q, spread, optimize=True)
        alpha = weighted.reshape(n_channels, n)
        by_transfer -= (mean[:, None] * alpha)[..., None]
        by_mean = 2.0 * np.einsum("cpdq,cpdq->c", q, covariance) / np.maximum(mean, 1e-300) - (alpha * white).sum(1)
        by_transfer -= (by_mean * mean / sums)[:, None, None]
        return value, by_transfer

    def light(self, transfer: Array, contrast: float, directions: Array) -> Array:
        """The mean of the posterior of the light (direction, channel) in some directions, not below zero."""
        y = self.pixels.T
        white = transfer.sum(-1)
        mean = y.sum(1) / np.maximum(white.sum(1), 1e-300)
        n_channels, n = y.shape
        factor = contrast**2 * (COMMON + (1.0 - COMMON) * np.eye(n_channels)) * np.outer(mean, mean)
        blocks = np.einsum("cpl,dql->cpdq", transfer, transfer @ self.grid.kernel, optimize=True)
        noise = (RELATIVE * y) ** 2 + (FLOOR * y.mean(1, keepdims=True)) ** 2
        matrix = (factor[:, None, :, None] * blocks).reshape(n_channels * n, -1) + np.diag(noise.ravel())
        alpha = np.linalg.solve(matrix, (y - mean[:, None] * white).ravel()).reshape(n_channels, n)
        pulled = np.einsum("cd,dpl,dp->cl", factor, transfer, alpha, optimize=True)
        found = mean + kernel(directions, self.grid.directions) @ pulled.T
        return np.maximum(found, 0.0)


def search_material(scene: Scene, gaussian: Gaussian, starts: Array, iterations: int) -> tuple[Array, float, float]:
    """Unknowns of the most probable material, what was minimised, and the contrast of the light."""
    from scipy.optimize import minimize

    root = np.linalg.inv(np.linalg.cholesky(gaussian.precision)).T

    def lobes(z: Array) -> Lobes:
        return raw_lobes(gaussian.mean + root @ z, gaussian)

    def best_contrast(z: Array) -> tuple[float, float]:
        transfer = scene.transfer(lobes(z))
        return min((scene.evidence(transfer, contrast)[0], contrast) for contrast in CONTRASTS)

    to_z = np.linalg.inv(root)
    begun = []
    for x in starts:
        z = to_z @ (x - gaussian.mean)
        value, contrast = best_contrast(z)
        begun.append((value + 0.5 * float(z @ z), contrast, z))
    _, contrast, z = min(begun, key=lambda each: each[0])

    def objective(z: Array) -> tuple[float, Array]:
        made = lobes(z)
        value, by_transfer = scene.evidence(scene.transfer(made), contrast, slope=True)
        assert by_transfer is not None
        by_node = scene.by_nodes(by_transfer)
        _, jacobian = NODES.linearise(made)
        slope = np.einsum("nc,ncp->p", by_node, jacobian, optimize=True)
        return value + 0.5 * float(z @ z), root.T @ slope + z

    found = minimize(objective, z, jac=True, method="L-BFGS-B", options={"maxiter": iterations})
    _, contrast = best_contrast(found.x)
    return gaussian.mean + root @ found.x, float(found.fun), contrast
