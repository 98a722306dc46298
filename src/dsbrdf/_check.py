"""Checks of arguments; the owner of the texts of argument errors.

Each message says which argument, what is required, what came and where, and what to do about it.
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _core

__all__ = [
    "angle",
    "finite",
    "generator",
    "index",
    "instance",
    "numbers",
    "require_rgb",
    "unit_vectors",
    "unit_vectors_any",
]

UNIT_TOLERANCE = 1e-4


#: What to do with what is often given in place of something else: kinds wanted, kind given, remedy.
_REMEDIES = (
    ("DSBRDF", "Fit", "The model of a fit is fit.model"),
    ("DSBRDF", "MeasuredBRDF Samples", "dsbrdf.fit(measured).model is one"),
    ("DSBRDF", "str Path PosixPath WindowsPath", "dsbrdf.load(path) reads a model file"),
    ("Fit", "DSBRDF", "dsbrdf.fit(measured) gives a fit, which knows its measurement"),
    ("Fit", "MeasuredBRDF Samples", "dsbrdf.fit(measured) gives one"),
    ("MeasuredBRDF Samples", "str Path PosixPath WindowsPath", "dsbrdf.read(path) reads a file"),
    ("MeasuredBRDF Samples", "Fit", "The measurement of a fit is fit.measured"),
    ("MeasuredBRDF", "DSBRDF", "dsbrdf.tabulate(model.eval, model.name) makes a table"),
    ("MeasuredBRDF", "Samples", "dsbrdf.fit(samples) fits scattered samples"),
)


def instance(value: Any, kinds: type | tuple[type, ...], name: str) -> None:
    """Refuse an argument of another kind.

    Raises
    ------
    TypeError
        Says which kind is expected and which came, and how to get from one to the other.
    """
    if isinstance(value, kinds):
        return
    wanted = [kind.__name__ for kind in (kinds if isinstance(kinds, tuple) else (kinds,))]
    got = type(value).__name__
    remedy = next(
        (f" {text}." for w, g, text in _REMEDIES if set(w.split()) & set(wanted) and got in g.split()), ""
    )
    raise TypeError(f"'{name}' must be a {' or '.join(wanted)}, got {got}.{remedy}")


def generator(rng: Any, name: str = "rng") -> None:
    """Refuse what draws no random numbers, such as a seed.

    Raises
    ------
    TypeError
        Unless it is a `numpy.random.Generator`.
    """
    if not isinstance(rng, np.random.Generator):
        raise TypeError(
            f"'{name}' must be a numpy.random.Generator, got {type(rng).__name__}. "
            "numpy.random.default_rng(1) is one with the seed 1."
        )


def index(value: Any, name: str) -> int:
    """Return an integer of any kind as an int.

    Raises
    ------
    TypeError
        If it is none.
    """
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"'{name}' must be an integer, got {value!r:.60}.") from None


def numbers(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` as float64.

    Raises
    ------
    TypeError
        If it is not made of numbers.
    """
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"'{name}' must be numbers, got {value!r:.60}.") from None


def _first(bad: NDArray[np.bool_]) -> str:
    """Index of the first offender as text, empty for a scalar."""
    if bad.ndim == 0:
        return ""
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    return f" at index {index[0] if len(index) == 1 else index}"


def finite(
    value: ArrayLike, name: str, *, low: float = -np.inf, high: float = np.inf, open_low: bool = False
) -> NDArray[np.float64]:
    """Return `value` as float64, all finite and within [`low`, `high`] (or above `low`).

    Raises
    ------
    ValueError
        If an entry is outside the range or not finite; names the first offender.
    """
    array = numbers(value, name)
    bad = ~np.isfinite(array) | (array < low) | (array > high)
    if open_low:
        bad |= array <= low
    if bad.any():
        limits = []
        if low > -np.inf:
            limits.append(f"{'>' if open_low else '>='} {low:g}")
        if high < np.inf:
            limits.append(f"<= {high:g}")
        need = " and ".join([*limits, "finite"])
        got = array[bad][0] if array.ndim else array[()]
        raise ValueError(f"'{name}' must be {need}, got {got:g}{_first(bad)}.")
    return array


def angle(value: ArrayLike, name: str, *, high: float = np.pi / 2) -> NDArray[np.float64]:
    """Return `value` as float64 radians in [0, `high`]; a rounding error beyond either end is clipped.

    Raises
    ------
    ValueError
        If an entry is outside; asks whether degrees were meant.
    """
    array = numbers(value, name)
    slack = 1e-6  # pi/2 in single precision is 4e-8 too large
    bad = ~((array >= -slack) & (array <= high + slack))
    if bad.any():
        upper = "pi/2" if high == np.pi / 2 else f"{high:g}"
        got = array[bad][0] if array.ndim else array[()]
        raise ValueError(
            f"'{name}' must lie in [0, {upper}] radians, got {got:g}{_first(bad)}. "
            "Degrees? Use numpy.deg2rad."
        )
    return np.clip(array, 0.0, high)


def unit_vectors(value: Any, name: str) -> NDArray[np.float64]:
    """Return `value` as float64 with unit vectors on the last axis, as given (not renormalised).

    Raises
    ------
    ValueError
        If the last axis is not of length 3, or a vector's norm differs from 1 by more than 1e-4.
    """
    array = numbers(value, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"'{name}' must have x, y, z on its last axis, got shape {array.shape}.")
    flat = np.ascontiguousarray(array).reshape(-1, 3)
    first = _core.first_not_unit(flat, UNIT_TOLERANCE)
    if first is not None:
        index = tuple(int(i) for i in np.unravel_index(first, array.shape[:-1]))
        raise _not_unit(name, math.hypot(*flat[first]), index)
    return array


def unit_vectors_any(xp: Any, array: Any, name: str) -> None:
    """Refuse vectors of any array library that are not unit; values that are not there yet (in `jax.jit`) pass.

    Raises
    ------
    ValueError
        As `unit_vectors`.
    """
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"'{name}' must have x, y, z on its last axis, got shape {tuple(array.shape)}.")
    norm = xp.sqrt(xp.sum(array * array, axis=-1))
    off = ~(xp.abs(norm - 1.0) <= UNIT_TOLERANCE)
    try:
        some = bool(xp.any(off))
    except Exception:  # each library has its own error for a value that is being traced
        return
    if some:
        flat = np.asarray(xp.reshape(norm, (-1,)).tolist())
        first = int(np.flatnonzero(~(np.abs(flat - 1.0) <= UNIT_TOLERANCE))[0])
        index = tuple(int(i) for i in np.unravel_index(first, tuple(array.shape[:-1])))
        raise _not_unit(name, float(flat[first]), index)


def _not_unit(name: str, norm: float, index: tuple[int, ...]) -> ValueError:
    place = "" if not index else f" at index {index[0] if len(index) == 1 else index}"
    return ValueError(
        f"'{name}' must be unit vectors on the last axis, got norm {norm:.6g}{place}. "
        f"Divide by numpy.linalg.norm({name}, axis=-1, keepdims=True)."
    )


def require_rgb(n_channels: int, what: str) -> None:
    """Refuse a model that a format of three colours cannot hold.

    Parameters
    ----------
    n_channels : int
        Of the model.
    what : str
        What wants three, as the subject of the sentence.

    Raises
    ------
    ValueError
        Unless there are three channels.
    """
    if n_channels != 3:
        raise ValueError(
            f"{what} has 3 channels, linear sRGB; the model has {n_channels}. Make a model of three: "
            "lobes = model.lobes.replace(colour=model.lobes.colour[[i, j, k]]), then "
            "model.replace(lobes=lobes, channels=())."
        )
