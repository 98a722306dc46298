"""Pairs of directions from what laboratories write: angles of several kinds, half and difference angles, or vectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import half_diff

Array: TypeAlias = NDArray[np.float64]
__all__ = ["EXPECTED", "from_angles", "from_vectors", "radians", "turned"]

#: What a file must tell.
EXPECTED = (
    "theta_i and theta_o with phi_o, or signed angles in one plane without it, each in degrees or radians "
    "(theta_i_deg or "
    "theta_i_rad, and so on); or theta_h, theta_d and phi_d likewise; or wi_x, wi_y, wi_z, wo_x, wo_y, wo_z"
)
#: 90 degrees may be printed as 1.571 or 1.57.
_PRINTED_ANGLE = 1.0e-3
#: A component printed with three digits is this far off; the vectors are made unit again.
_PRINTED = 2e-3
#: Azimuths, which have no range.
_AZIMUTHS = ("phi", "phi_i", "phi_o", "phi_d", "phi_h")
_POLAR = ("theta_i", "theta_o", "theta_h", "theta_d")


def radians(
    angles: Mapping[str, Array], units: Mapping[str, str], labels: Mapping[str, str]
) -> tuple[dict[str, Array], str]:
    """Angles in radians, and a remark where a unit was found from the numbers.

    Parameters
    ----------
    angles : mapping of str to (n,) ndarray
    units : mapping of str to str
        "deg", "rad", or "" where the file does not say; then angles from the normal beyond pi are degrees, and others
        refused.
    labels : mapping of str to str
        Names of the columns, for errors.

    Raises
    ------
    ValueError
        If a unit is unknown, or missing and not clear.
    """
    remark, known = "", {key: unit for key, unit in units.items() if unit}
    for key, unit in known.items():
        if unit not in ("deg", "rad"):
            raise ValueError(f"column {labels[key]}: unit {unit!r} is neither deg nor rad. Convert it first.")
    unknown = [key for key in angles if key not in known]
    if unknown:
        widest = max(
            (float(np.nanmax(np.abs(angles[k]), initial=0.0)) for k in unknown if k not in _AZIMUTHS),
            default=0.0,
        )
        around = max(
            (float(np.nanmax(np.abs(angles[k]), initial=0.0)) for k in unknown if k in _AZIMUTHS), default=0.0
        )
        if widest <= np.pi + _PRINTED_ANGLE and around <= 4.0 * np.pi:
            key = unknown[0]
            base = labels[key].strip() or key
            raise ValueError(
                f"column {base} must say its unit: call it {base}_deg or {base}_rad, in the header or with "
                f"columns=[...] "
                "(--columns)."
            )
        turning = [
            k for k in unknown if k in _AZIMUTHS and 0.0 < np.nanmax(np.abs(angles[k]), initial=0.0) < 6.3
        ]
        if turning:
            base = labels[turning[0]].strip()
            raise ValueError(
                f"column {base} must say its unit: its angles may be degrees or radians. Call it {base}_deg "
                f"or {base}_rad."
            )
        known |= dict.fromkeys(unknown, "deg")
        remark = f"{', '.join(labels[key] for key in unknown)} taken as degrees: they go beyond what radians can be"
    result = {
        key: np.deg2rad(a) if known[key] == "deg" else np.asarray(a, float) for key, a in angles.items()
    }
    for key in _POLAR:
        if key in result and known[key] == "rad":
            widest = float(np.nanmax(np.abs(result[key]), initial=0.0))
            if widest > np.pi + _PRINTED_ANGLE:
                raise ValueError(
                    f"column {labels[key]} must lie within 1.570796 on either side of the normal, got "
                    f"{widest:.6g}. Are "
                    f"these degrees? Call it {key}_deg, in the header or with columns=[...] (--columns)."
                )
    return result, remark


def from_angles(angles: Mapping[str, Array], labels: Mapping[str, str]) -> tuple[Array, Array, str]:
    """Unit vectors toward light and view, some perhaps below the horizon, and what was taken for granted.

    Parameters
    ----------
    angles : mapping of str to (n,) ndarray, radians
        `theta_i` and `theta_o` (negative: on the far side of the normal) with `phi_o` and `phi_i`, or with `phi`, the
        azimuth of the view from that of the light, or with neither where the signs say on which side a direction is;
        `theta_i` and `aspecular`, the angle of the view from the mirror direction, positive toward the light; or
        `theta_h`, `theta_d`, `phi_d` and perhaps `phi_h`.
    labels : mapping of str to str
        Names of the columns, for errors.

    Raises
    ------
    ValueError
        If the angles do not make directions; says which are missing.
    """
    there = set(angles)
    remark = ""
    if there & {"theta_h", "theta_d", "phi_d", "phi_h"}:
        if not {"theta_h", "theta_d", "phi_d"} <= there <= {"theta_h", "theta_d", "phi_d", "phi_h"}:
            raise ValueError(f"expected columns {EXPECTED}; got the angles {_named(labels, there)}.")
        wi, wo = half_diff.to_directions(*(angles[key] for key in ("theta_h", "theta_d", "phi_d")))
        if "phi_h" in angles:
            wi, wo = (turned(w, angles["phi_h"]) for w in (wi, wo))
        return wi, wo, remark
    missing = {"theta_i"} - there or ({"theta_o"} - there if "aspecular" not in there else set())
    if missing:
        key = missing.pop()
        got = f"the angles {_named(labels, there)}" if there else "no angles"
        raise ValueError(
            f"expected columns {EXPECTED}; got {got}, without {key}. If it is one angle throughout, say it: "
            f"set={{'{key}_deg': ...}} (--set {key}_deg=...)."
        )
    theta_i = angles["theta_i"]
    if "aspecular" in there:
        if there - {"theta_i", "aspecular"}:
            raise ValueError(
                f"expected theta_i and an aspecular angle alone, in the plane of incidence; got "
                f"{_named(labels, there)}. "
                "Leave the others out with ignore=[...] (--ignore)."
            )
        return (
            _direction(theta_i, 0.0),
            _direction(theta_i - angles["aspecular"], np.pi),
            ("aspecular angles are from the mirror direction, positive toward the light"),
        )
    theta_o = angles["theta_o"]
    if "phi" in there:
        if "phi_o" in there:
            raise ValueError(
                f"expected one azimuth of the view, got {_named(labels, {'phi', 'phi_o'})}. Leave one out."
            )
        phi_i = angles.get("phi_i", np.zeros(1))
        return (
            _direction(theta_i, phi_i),
            _direction(theta_o, phi_i + angles["phi"]),
            (f"{labels['phi']} is the azimuth of the view from that of the light (180 degrees: mirror side)"),
        )
    if "phi_o" in there:
        return (
            _direction(theta_i, angles.get("phi_i", np.zeros(1))),
            _direction(theta_o, angles["phi_o"]),
            remark,
        )
    if "phi_i" in there:
        raise ValueError(
            f"expected an azimuth phi_o beside {labels['phi_i']}. Set it: set={{'phi_o_deg': 0}} (--set phi_o_deg=0)."
        )
    if (
        not ((theta_o < 0.0).any() or (theta_i < 0.0).any())
        and (theta_i > 1e-9).any()
        and (theta_o > 1e-9).any()
    ):
        raise ValueError(
            f"no azimuth, and {labels['theta_o']} has no negative angle that would tell the two sides of "
            f"the normal apart. "
            "Say on which side the view is: set={'phi_o_deg': 180} (--set phi_o_deg=180) for that of the "
            "mirror direction, "
            "0 for that of the light."
        )
    remark = "no azimuth: all in one plane, the mirror direction of theta_i is at theta_o = -theta_i"
    return _direction(theta_i, 0.0), _direction(theta_o, 0.0), remark


def from_vectors(components: Mapping[str, Array]) -> tuple[Array, Array]:
    """Unit vectors from six components, made unit where only their printing is to blame.

    Raises
    ------
    ValueError
        If components are missing, or the vectors not of unit length.
    """
    need = [f"{w}_{axis}" for w in ("wi", "wo") for axis in "xyz"]
    if missing := [key for key in need if key not in components]:
        raise ValueError(f"expected columns {EXPECTED}; got vectors without {', '.join(missing)}.")
    wi, wo = (_unit(np.stack([components[key] for key in keys], axis=-1)) for keys in (need[:3], need[3:]))
    return wi, wo


def _named(labels: Mapping[str, str], keys: set[str]) -> str:
    return ", ".join(labels[key] for key in sorted(keys))


def _direction(theta: Array, phi: Array | float) -> Array:
    theta, phi = np.broadcast_arrays(theta, phi)
    # A printed right angle is one
    grazing = np.abs(np.abs(theta) - np.pi / 2) <= _PRINTED_ANGLE
    theta = np.where(grazing & (np.abs(theta) > np.pi / 2), np.copysign(np.pi / 2, theta), theta)
    # Infinite angles give no direction
    with np.errstate(invalid="ignore"):
        sin = np.sin(theta)
        z = np.where(np.abs(theta) == np.pi / 2, 0.0, np.cos(theta))
        return np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=-1)


def turned(vectors: Array, phi: Array | float) -> Array:
    """Vectors turned about the normal."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([x * np.cos(phi) - y * np.sin(phi), x * np.sin(phi) + y * np.cos(phi), z], axis=-1)


def _unit(vectors: Array) -> Array:
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    bad = np.flatnonzero(np.abs(norm - 1.0) > _PRINTED)
    if bad.size:
        raise ValueError(
            f"the directions must be unit vectors, got norm {norm.flat[bad[0]]:g} at index {bad[0]}."
        )
    unit: Array = vectors / norm
    return unit
