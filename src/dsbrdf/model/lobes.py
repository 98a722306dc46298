"""`Lobes`: the numbers of a model, and the curves over theta_d that they stand for.

A curve of m coefficients over x = cos(theta_d) is a constant, a line or a parabola for m = 1, 2, 3; more make a
quadratic B-spline with m - 2 equal spans. Its functions are not negative and add up to one, so that a curve stays
between its least and its greatest coefficient.
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief

__all__ = [
    "FALLOFF",
    "MAX_BETA",
    "MAX_LN_KAPPA",
    "Lobes",
    "Parameters",
    "check_stored",
    "curve_design",
    "curve_places",
]

#: Greatest logarithm of kappa: the most that `expm1` holds.
MAX_LN_KAPPA = 6.5
#: What rounding may add to it in a file.
KAPPA_SLACK = 1e-3
#: Least and greatest falloff; above -1 a lobe's energy is finite.
FALLOFF = (-0.9, 20.0)
#: Greatest beta of a fit, either way.
MAX_BETA = 2.0
#: Least and greatest coefficients that a file may hold: wider than those of any fit, and narrow enough that no value
#: overflows.
LIMITS = {
    "scale": (-1e3, 1e2),
    "gamma": (-30.0, 30.0),
    "beta": (-20.0, 20.0),
    "falloff": FALLOFF,
    "colour": (-1e2, 1e2),
}
#: Most lobes, channels and coefficients of a curve in a file.
MAX_COUNTS = {"lobes": 100, "channels": 20_000, "coefficients": 100}
#: Curves that all channels share.
SHARED = ("scale", "gamma", "beta", "falloff")


class Parameters(NamedTuple):
    """Parameters of lobes at some theta_d.

    Parameters
    ----------
    kappa : (theta_d, channel, lobe) ndarray
    gamma, beta, falloff : (theta_d, lobe) ndarray
    """

    kappa: NDArray[np.float64]
    gamma: NDArray[np.float64]
    beta: NDArray[np.float64]
    falloff: NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Lobes(Brief):
    """Coefficients of the curves of a model's lobes.

    The reflectance is, with x = cos(theta_d) and g of `dsbrdf.half_diff.azimuthal_factor`,
    `f_c = sum_k expm1(kappa_kc(x) cos(theta_h)^gamma_k(x)) cos(theta_h)^falloff_k(x) exp(beta_k(x) g cos(2 phi_d))`.
    Shapes (gamma, beta, falloff) belong to a lobe, colours to its height.

    Parameters
    ----------
    scale : (lobe, coefficient) array
        Of `ln(kappa)`, common to the channels.
    gamma : (lobe, coefficient) array
        Of `ln(gamma)`.
    beta : (lobe, coefficient) array
    falloff : (lobe, coefficient) array
        Above -1.
    colour : (channel, lobe, coefficient) array
        What a channel adds to `ln(kappa)`.

    Raises
    ------
    ValueError
        If shapes disagree or a coefficient of a NumPy array is out of range.

    Examples
    --------
    >>> import dsbrdf
    >>> lobes = dsbrdf.library.load("nickel").lobes
    >>> lobes.n_lobes, lobes.n_parameters
    (5, 90)
    >>> lobes.at([0.0]).gamma.round().astype(int)
    array([[  0,   0,  64, 217, 806]])
    """

    scale: Any
    gamma: Any
    beta: Any
    falloff: Any
    colour: Any

    def __post_init__(self) -> None:
        n_lobes = None
        for name in (*SHARED, "colour"):
            value = getattr(self, name)
            shape = tuple(value.shape) if hasattr(value, "shape") else np.shape(value)
            axes = 3 if name == "colour" else 2
            n_lobes = shape[0] if name == "scale" and shape else n_lobes
            if len(shape) != axes or 0 in shape or shape[axes - 2] != n_lobes:
                need = "(channel, lobe, coefficient)" if axes == 3 else "(lobe, coefficient)"
                raise ValueError(
                    f"'{name}' must have shape {need} with a coefficient at least and as many lobes as 'scale', "
                    f"got {shape}."
                )
            if isinstance(value, np.ndarray | list | tuple):
                low, high = FALLOFF if name == "falloff" else (-np.inf, np.inf)
                array = np.ascontiguousarray(_check.finite(value, name, low=low, high=high))
                object.__setattr__(self, name, array)
        register_with_jax()

    @property
    def n_lobes(self) -> int:
        """Number of lobes."""
        return int(self.scale.shape[0])

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.colour.shape[0])

    @property
    def n_parameters(self) -> int:
        """Numbers that describe the reflectance: what all channels share of a colour is part of the scale."""
        shared = sum(int(getattr(self, name).shape[1]) for name in SHARED)
        return self.n_lobes * (shared + (self.n_channels - 1) * int(self.colour.shape[2]))

    @property
    def numpy(self) -> Lobes:
        """The same with NumPy arrays of double precision.

        Raises
        ------
        TypeError
            If an array has no values yet, as inside `jax.jit` and `jax.grad`, or needs `detach` first.
        """
        try:
            return Lobes(*(np.asarray(part, dtype=np.float64) for part in self.parts))
        except ValueError:
            raise
        except Exception as error:
            raise TypeError(
                "this needs the values of the parameters, which carry gradients here. Call it outside of jax.jit and "
                f"jax.grad, or on a model of detached tensors. ({type(error).__name__})"
            ) from None

    @property
    def parts(self) -> tuple[Any, ...]:
        """The five arrays, in the order of the parameters of this class."""
        return (self.scale, self.gamma, self.beta, self.falloff, self.colour)

    def at(self, theta_d: ArrayLike) -> Parameters:
        """Parameters at angles (theta_d,) in radians.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        lobes = self.numpy
        x = np.cos(_check.angle(theta_d, "theta_d"))
        scale, gamma, beta, falloff = (
            curve_design(x, getattr(lobes, name).shape[1]) @ getattr(lobes, name).T for name in SHARED
        )
        colour = np.einsum("tj,clj->tcl", curve_design(x, lobes.colour.shape[2]), lobes.colour)
        ln_kappa = np.minimum(scale[:, None] + colour, MAX_LN_KAPPA)
        return Parameters(np.exp(ln_kappa), np.exp(gamma), beta, falloff)

    def take(self, lobes: Any) -> Lobes:
        """Some of the lobes: `lobes` is an index, a slice or a list of indices."""
        # An array, as JAX takes no list
        index = lobes if isinstance(lobes, slice) else np.atleast_1d(np.asarray(lobes))
        return Lobes(
            self.scale[index], self.gamma[index], self.beta[index], self.falloff[index], self.colour[:, index]
        )

    def replace(self, **changes: Any) -> Lobes:
        """Return a copy with some arrays changed."""
        return dataclasses.replace(self, **changes)


def check_stored(lobes: Lobes) -> None:
    """Refuse what no fit gives and no later step could use; for lobes that come from a file.

    Raises
    ------
    ValueError
        If there are absurdly many lobes, channels or coefficients, or one is outside `LIMITS`, or kappa is beyond what
        `expm1` holds.
    """
    counts = (lobes.n_lobes, lobes.n_channels, max(part.shape[-1] for part in lobes.parts))
    for (what, most), count in zip(MAX_COUNTS.items(), counts, strict=True):
        if count > most:
            raise ValueError(f"{count:,} {what} are more than any model has ({most:,}).")
    for name, (low, high) in LIMITS.items():
        _check.finite(getattr(lobes, name), name, low=low, high=high)
    x = np.linspace(0.0, 1.0, 33)
    scale, colour = (
        curve_design(x, part.shape[-1]) @ np.moveaxis(part, -1, 0).reshape(part.shape[-1], -1)
        for part in (lobes.scale, lobes.colour)
    )
    top = float((scale[:, None] + colour.reshape(len(x), lobes.n_channels, -1)).max())
    if top > MAX_LN_KAPPA + KAPPA_SLACK:
        raise ValueError(f"ln(kappa) reaches {top:.4g}, beyond {MAX_LN_KAPPA:g}, the most that expm1 holds.")


def curve_places(x: NDArray[np.float64], size: int) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
    """Span (...) of each x in [0, 1] among those of a curve of `size` coefficients, and the place in it, 0 to 1."""
    spans = max(size, 3) - 2
    at = np.asarray(x, dtype=np.float64) * spans
    span = np.clip(at.astype(int), 0, spans - 1)
    return span, at - span


def curve_design(x: ArrayLike, size: int) -> NDArray[np.float64]:
    """Values (x, coefficient) of the functions of a curve of `size` coefficients at x = cos(theta_d) (x,)."""
    x = np.asarray(x, dtype=np.float64)
    if size == 1:
        return np.ones((len(x), 1))
    if size == 2:
        return np.stack([1.0 - x, x], axis=-1)
    span, u = curve_places(x, size)
    low = (1.0 - u) ** 2 * np.where(span == 0, 1.0, 0.5)
    high = u**2 * np.where(span == size - 3, 1.0, 0.5)
    design = np.zeros((len(x), size))
    row = np.arange(len(x))
    for offset, values in enumerate((low, 1.0 - low - high, high)):
        design[row, span + offset] = values
    return design


def register_with_jax() -> None:
    """Make `Lobes` and `DSBRDF` known to JAX as containers of arrays, once JAX is imported."""
    jax = sys.modules.get("jax")
    if jax is None or not hasattr(jax, "tree_util") or _registered:
        return
    from dsbrdf.model.dsbrdf import DSBRDF

    _registered.append(True)
    jax.tree_util.register_pytree_node(Lobes, lambda lobes: (lobes.parts, None), _rebuilt_lobes)
    jax.tree_util.register_pytree_node(DSBRDF, _parts_of_model, _rebuilt_model)


_registered: list[bool] = []


def _rebuilt_lobes(_: Any, parts: Any) -> Lobes:
    """Lobes of what JAX put in place of the arrays, which need not be arrays."""
    lobes = object.__new__(Lobes)
    for field, part in zip(dataclasses.fields(Lobes), parts, strict=True):
        object.__setattr__(lobes, field.name, part)
    return lobes


class _Rest:
    """All of a model but its lobes; equal by identity, so that JAX compiles once for a model and its copies."""

    def __init__(self, model: Any) -> None:
        self.fields = {f.name: getattr(model, f.name) for f in dataclasses.fields(model) if f.name != "lobes"}

    def __hash__(self) -> int:
        return hash((self.fields["channels"], self.fields["name"]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Rest) and all(
            value is other.fields[key] or (isinstance(value, str | tuple) and value == other.fields[key])
            for key, value in self.fields.items()
        )


def _parts_of_model(model: Any) -> tuple[tuple[Lobes], _Rest]:
    return (model.lobes,), _Rest(model)


def _rebuilt_model(rest: _Rest, parts: Any) -> Any:
    from dsbrdf.model.dsbrdf import DSBRDF

    model = object.__new__(DSBRDF)
    for name, value in {**rest.fields, "lobes": parts[0]}.items():
        object.__setattr__(model, name, value)
    return model
