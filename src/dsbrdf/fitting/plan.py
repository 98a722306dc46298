"""Where to measure next: pairs of directions that tell most of a material, given what materials are like.

Each pair is the one, of those that can be reached, that lowers the mean variance of the logarithm of reflectance over
all directions most, given all before it (a greedy A-optimal design). The variance is that of the process of a space
(`dsbrdf.space.process`), in which it does not depend on the values that will be measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.measured.names import column_names
from dsbrdf.measured.samples import Samples
from dsbrdf.space.process import Positions, support

if TYPE_CHECKING:
    from dsbrdf.space import MaterialSpace

__all__ = ["Plan", "plan"]

Array = NDArray[np.float64]

#: Distance of angles of candidates, degrees: what a goniometer is set to.
STEP, AZIMUTH_STEP = 5.0, 15.0


@dataclass(frozen=True, eq=False)
class Plan:
    """Pairs of directions to measure, in this order.

    Parameters
    ----------
    theta_i, theta_o, phi_o : (n,) ndarray, degrees
        The azimuth of the light is 0.
    deviation : (n + 1,) ndarray
        RMS over all directions of the standard deviation of the logarithm of reflectance, before and after each.
    channels : tuple of str
    """

    theta_i: Array
    theta_o: Array
    phi_o: Array
    deviation: Array
    channels: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.theta_i)

    @property
    def directions(self) -> tuple[Array, Array]:
        """Unit vectors (n, 3) toward the light and the viewer."""
        return _unit(self.theta_i, np.zeros(len(self))), _unit(self.theta_o, self.phi_o)

    def save(self, path: str | Path) -> None:
        """Write a CSV with a line for each pair and empty cells for the values; filled in, `dsbrdf.read` reads it.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        lines = [",".join(("theta_i_deg", "theta_o_deg", "phi_o_deg", *column_names(self.channels)))]
        for angles in zip(self.theta_i, self.theta_o, self.phi_o, strict=True):
            lines.append(",".join([*(f"{angle:g}" for angle in angles), *("" for _ in self.channels)]))
        with _files.aside(path) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plan(
    n_samples: int = 8,
    *,
    known: Samples | None = None,
    space: MaterialSpace | None = None,
    in_plane: bool = False,
    theta_max: float = 75.0,
    least_angle: float = 0.0,
) -> Plan:
    """Plan a measurement.

    Parameters
    ----------
    n_samples : int, optional
        Pairs of directions to measure.
    known : Samples, optional
        What was measured already.
    space : MaterialSpace, optional
        What materials are like; that of the built-in library by default.
    in_plane : bool, optional
        Only directions in the plane of the light and the normal.
    theta_max : float, optional, degrees
        Largest angle from the normal that can be reached.
    least_angle : float, optional, degrees
        Least angle between light and viewer: closer, one hides the other.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        If an option is out of range, nothing can be reached, or `known` has other channels than the space.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.plan(4, in_plane=True, least_angle=10)
    >>> len(found), bool(found.deviation[4] < 0.5 * found.deviation[0])
    (4, True)
    """
    if n_samples < 1:
        raise ValueError(f"'n_samples' must be at least 1, got {n_samples!r}.")
    if not 0.0 < theta_max < 90.0 or not 0.0 <= least_angle < 180.0:
        raise ValueError(
            "'theta_max' must be above 0 and below 90 degrees, 'least_angle' from 0 to 180, got "
            f"{theta_max!r} and {least_angle!r}."
        )
    if space is None:
        from dsbrdf.space import builtin

        space = builtin()
    process = space.process
    start = process.unmeasured
    if known is not None:
        from dsbrdf.fitting.fit import expectation
        from dsbrdf.fitting.observations import Observations

        observations = Observations.of(known)
        if observations.n_channels != len(space.channels):
            raise ValueError(
                f"{known.name or 'the samples'}: {observations.n_channels} channels, where the space has "
                f"{len(space.channels)}."
            )
        start = expectation(space, known, observations)
    theta_i, theta_o, phi_o = _candidates(in_plane, theta_max, least_angle)
    wi, wo = _unit(theta_i, np.zeros(len(theta_i))), _unit(theta_o, phi_o)
    _, added = process.at(Positions.of_directions(wi, wo))
    features = np.moveaxis(added, 0, -1)  # (candidate, channel, material)

    _, area = support()
    _, targets = process.at_support
    rows = (targets * np.sqrt(area / targets.shape[2])[:, None]).reshape(len(targets), -1)
    goal = rows @ rows.T
    noise = start.noise**2 * np.eye(features.shape[1])
    covariance = start.covariance
    chosen: list[int] = []
    deviation = [float(np.sqrt(np.vdot(goal, covariance)))]
    for _ in range(n_samples):
        reach = features @ covariance
        of_pair = reach @ features.swapaxes(1, 2) + noise
        lowered = np.linalg.solve(of_pair, reach @ goal @ reach.swapaxes(1, 2))
        best = int(np.trace(lowered, axis1=1, axis2=2).argmax())
        chosen.append(best)
        covariance = covariance - reach[best].T @ np.linalg.solve(of_pair[best], reach[best])
        deviation.append(float(np.sqrt(max(np.vdot(goal, covariance), 0.0))))
    return Plan(theta_i[chosen], theta_o[chosen], phi_o[chosen], np.array(deviation), space.channels)


def _unit(theta: Array, phi: Array) -> Array:
    """Unit vectors (n, 3) at angles (n,) in degrees."""
    theta, phi = np.deg2rad(theta), np.deg2rad(phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _candidates(in_plane: bool, theta_max: float, least_angle: float) -> tuple[Array, Array, Array]:
    """Angles (candidate,) in degrees, of a pair only one of its two orders."""
    theta = np.arange(0.0, theta_max + 1e-9, STEP)
    phi = np.arange(0.0, 180.0 + 1e-9, 180.0 if in_plane else AZIMUTH_STEP)
    grid = np.meshgrid(theta, theta, phi, indexing="ij")
    theta_i, theta_o, phi_o = (angles.ravel() for angles in grid)
    # With a direction along the normal there is no azimuth
    kept = (theta_o <= theta_i) & ((theta_o > 0.0) | (phi_o == 180.0))
    between = (_unit(theta_i, np.zeros(theta_i.size)) * _unit(theta_o, phi_o)).sum(-1)
    kept &= np.rad2deg(np.arccos(np.clip(between, -1.0, 1.0))) >= least_angle - 1e-6
    if not kept.any():
        raise ValueError(
            f"no pair of directions within {theta_max:g} degrees of the normal is {least_angle:g} degrees apart. "
            "Allow more of either."
        )
    return theta_i[kept], theta_o[kept], phi_o[kept]
