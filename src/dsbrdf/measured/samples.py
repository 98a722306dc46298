"""Scattered samples of a reflectance: values at pairs of directions that need not lie on any grid."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured.source import Source

Array: TypeAlias = NDArray[np.float64]
__all__ = ["SKIPPED", "Samples", "samples_from_columns"]

#: Name of a column to leave out.
SKIPPED = "-"
#: Relative standard deviation below which samples count alike.
LEAST_ERROR = 0.02
#: A component printed with three digits is this far off; the vectors are made unit again.
_PRINTED = 2e-3
_ANGLE = re.compile(r"(theta_i|phi_i|theta_o|phi_o|theta_h|theta_d|phi_d)[ _\[(]*(deg|rad)?[\])]*")
_VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
_DIRECTIONS = (
    "theta_i and theta_o in degrees or radians (theta_i_deg or theta_i_rad, and so on) with phi_o and, if it is "
    "not 0, phi_i; or theta_h, theta_d and phi_d likewise; or wi_x, wi_y, wi_z, wo_x, wo_y, wo_z"
)


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one isotropic reflectance at pairs of directions, in 1/sr and without the cosine.

    Parameters
    ----------
    wi, wo : (n, 3) array_like
        Unit vectors toward the light and the viewer, normal +z; none below the horizon.
    values : (n, channel) array_like
        In 1/sr. Infinite ones become NaN: invalid; and so do negative ones, unless `weights` are given.
    name : str, optional
    weights : (n,) array_like, optional
        How much the relative error of each sample counts; alike by default.
    channels : sequence of str, optional
        Names of the channels; r, g, b for three by default.
    source : Source, optional

    Raises
    ------
    ValueError
        If shapes disagree, there is no sample, a vector is not of unit length or below the horizon, or a
        weight is negative or not finite.
    """

    wi: Array
    wo: Array
    values: Array
    _: KW_ONLY
    name: str = ""
    weights: Array | None = None
    channels: Sequence[str] = ()
    source: Source = field(default_factory=Source)

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64)
        if values.ndim != 2 or values.size == 0:
            raise ValueError(
                f"'values' must have shape (n, channel) with a sample at least, got {values.shape}."
            )
        least = 0.0 if self.weights is None else -np.inf
        values[~((values >= least) & np.isfinite(values))] = np.nan
        object.__setattr__(self, "values", values)
        for name in ("wi", "wo"):
            vectors = _check.unit_vectors(getattr(self, name), name)
            if vectors.shape != (len(values), 3):
                raise ValueError(f"'{name}' must have shape ({len(values)}, 3), got {vectors.shape}.")
            below = np.flatnonzero(vectors[:, 2] < 0.0)
            if below.size:
                raise ValueError(
                    f"'{name}' must not lie below the horizon, got z = {vectors[below[0], 2]:g} at index "
                    f"{below[0]}. Light that passes through is not part of the model: leave these samples out."
                )
            object.__setattr__(self, name, vectors)
        if self.weights is not None:
            weights = _check.finite(self.weights, "weights", low=0.0)
            if weights.shape != (len(values),):
                raise ValueError(f"'weights' must have shape ({len(values)},), got {weights.shape}.")
            object.__setattr__(self, "weights", weights)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.values.shape[1])

    def __repr__(self) -> str:
        weighted = ", weighted" if self.weights is not None else ""
        return (
            f"Samples({self.name!r}, {len(self)} pairs of directions, {self.n_channels} channels{weighted})"
        )


def samples_from_columns(columns: Mapping[str, Any], name: str, source: Source | None = None) -> Samples:
    """Scattered samples from named columns.

    Parameters
    ----------
    columns : mapping of str to (n,) array_like
        Directions as angles `theta_i`, `phi_i`, `theta_o`, `phi_o` or `theta_h`, `theta_d`, `phi_d`, each with its unit
        `_deg` or `_rad` (`phi_i` may be missing and is 0 then, `theta_o` may be negative, on the far side of the
        normal), or as unit vectors `wi_x` to `wo_z`; `weight`, or `std`, the standard deviation of the values in
        1/sr, where it is known; all others are channels, in 1/sr. Case does not matter.
    name : str
    source : Source, optional
        Its file, if there is one, is named by errors.

    Returns
    -------
    Samples

    Raises
    ------
    ValueError
        If columns are missing, an angle has no unit or is out of range, or as `Samples`.
    """
    source = source or Source()
    try:
        wi, wo, values, weights, channels = _parts(columns)
        return Samples(wi, wo, values, name=name, weights=weights, channels=channels, source=source)
    except ValueError as error:
        raise ValueError(f"{source.file or name}: {error}") from None


def _parts(columns: Mapping[str, Any]) -> tuple[Array, Array, Array, Array | None, tuple[str, ...]]:
    """Directions, values, weights and names of channels from named columns."""
    rest = {key.strip().strip("\"'").lower(): value for key, value in columns.items()}
    angles: dict[str, Array] = {}
    for key in list(rest):
        match = _ANGLE.fullmatch(key)
        if match:
            angles[match[1]] = _radians(rest.pop(key), key, match[2])
    vectors = [np.asarray(rest.pop(key), float) for key in _VECTORS if key in rest]
    if len(vectors) == len(_VECTORS) and not angles:
        wi, wo = (_unit(np.stack(w, axis=-1)) for w in (vectors[:3], vectors[3:]))
    elif {"theta_i", "theta_o", "phi_o"} <= set(angles) <= {"theta_i", "theta_o", "phi_i", "phi_o"}:
        wi = _direction(angles["theta_i"], angles.get("phi_i", np.zeros(1)))
        wo = _direction(angles["theta_o"], angles["phi_o"])
    elif set(angles) == {"theta_h", "theta_d", "phi_d"}:
        wi, wo = half_diff.to_directions(*(angles[key] for key in ("theta_h", "theta_d", "phi_d")))
    else:
        raise ValueError(f"expected columns {_DIRECTIONS}; got {_listed(columns)}.")

    weights = rest.pop("weight", None)
    std = None
    if "std" in rest:
        if weights is not None:
            raise ValueError("expected a column weight or std, got both. Leave one out as '-'.")
        std = _check.finite(rest.pop("std"), "std", low=0.0, open_low=True)
    channels = {key: value for key, value in rest.items() if key != SKIPPED}
    if not channels:
        raise ValueError(f"expected a column of values beside the directions; got {_listed(columns)}.")
    values = np.stack([np.asarray(value, float) for value in channels.values()], axis=-1)
    if std is not None:
        # Relative variance, and no sample is better than the model can be
        seen = np.isfinite(values)
        bright = np.abs(np.where(seen, values, 0.0).sum(1)) / np.maximum(seen.sum(1), 1)
        weights = LEAST_ERROR**2 / ((std / np.maximum(bright, std)) ** 2 + LEAST_ERROR**2)
    return wi, wo, values, weights, tuple(channels)


def _listed(columns: Mapping[str, Any]) -> str:
    text = ", ".join(columns)
    return f"the columns {text:.200}" if text else "none"


def _radians(value: Any, key: str, unit: str | None) -> Array:
    if unit is None:
        raise ValueError(f"column {key} must say its unit: call it {key}_deg or {key}_rad.")
    angle = np.asarray(value, float) if key.startswith("theta") else _check.finite(value, key)
    if key.startswith("theta"):
        limit = 90.0 if unit == "deg" else np.pi / 2
        bad = np.flatnonzero(~(np.abs(angle) <= limit * (1.0 + 1e-6)))
        if bad.size:
            raise ValueError(
                f"column {key} must lie within {limit:.7g} on either side of the normal, got "
                f"{angle.flat[bad[0]]:g} at index {bad[0]}. Check its unit, or leave the sample out."
            )
        angle = np.clip(angle, -limit, limit)
    return np.deg2rad(angle) if unit == "deg" else angle


def _direction(theta: Array, phi: Array) -> Array:
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _unit(vectors: Array) -> Array:
    """Vectors made unit where only their printing is to blame."""
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    bad = np.flatnonzero(~(np.abs(norm - 1.0) <= _PRINTED))
    if bad.size:
        raise ValueError(
            f"the directions must be unit vectors, got norm {norm.flat[bad[0]]:g} at index {bad[0]}."
        )
    unit: Array = vectors / norm
    return unit
