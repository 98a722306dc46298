"""The plugin `dsbrdf` for Mitsuba 3: a fitted model as a bsdf, differentiable in its parameters.

`dsbrdf.render.register` makes it known; `docs/mitsuba.md` describes it for the author of a scene. Values come from the
curves: the functions of a curve over x = cos(theta_d) are computed once for all lobes, and coefficients are the same
for all rays, so that nothing is looked up by x; one power serves all channels of a lobe.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from dsbrdf.model import file as model_file
from dsbrdf.model import sampling
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import Lobes
from dsbrdf.render import drjit_math
from dsbrdf.render.drjit_math import LOG2_E
from dsbrdf.render.half_vector_bsdf import base_class
from dsbrdf.render.variants import import_mitsuba, once_a_variant

__all__ = ["PLUGIN", "dsbrdf_class", "to_dict"]

#: Name of the plugin in scenes.
PLUGIN = "dsbrdf"
ARRAYS = tuple(field.name for field in dataclasses.fields(Lobes))
#: Largest powers of two of a lobe and of its factor: their product is a number in single precision. What is higher, a
#: kappa above 43, counts as that.
MAX_LOBE, MAX_FACTOR = 63.0, 60.0
MAX_LOG2 = math.log2(MAX_LOBE)


def to_dict(model: DSBRDF) -> dict[str, Any]:
    """The bsdf of a model in memory, for `mitsuba.load_dict`.

    Parameters
    ----------
    model : DSBRDF

    Returns
    -------
    dict
        Of the plugin `dsbrdf`, with the arrays of its lobes as tensors of the variant that is set.
    """
    mi = import_mitsuba()

    lobes = model.lobes.numpy
    # Mitsuba tries to make a colour of a tensor whose first axis is 3 long, and complains: put one more axis in front
    return {"type": PLUGIN} | {
        name: mi.TensorXf(getattr(lobes, name).astype(np.float32)[None]) for name in ARRAYS
    }


def _model_of(props: Any) -> DSBRDF:
    """The model that a scene gives, by file or by arrays."""
    mi = import_mitsuba()

    given = [name for name in ARRAYS if name in props]
    if "filename" in props:
        if given:
            raise ValueError(
                f"bsdf {PLUGIN!r}: give either 'filename' or arrays, got 'filename' and {given[0]!r}."
            )
        return model_file.load(str(mi.file_resolver().resolve(props["filename"])))
    for name in ARRAYS[:2]:
        if name not in given:
            raise ValueError(
                f"bsdf {PLUGIN!r}: 'filename' of a model, or the arrays 'scale' and 'gamma' are needed; "
                f"{name!r} is missing."
            )
    arrays: dict[str, Any] = {}
    for name in given:
        array = np.array(props[name], dtype=np.float64)
        arrays[name] = array[0] if array.ndim == (4 if name == "colour" else 3) and len(array) == 1 else array
    n_lobes = len(arrays["scale"])
    for name, shape in (("beta", (n_lobes, 1)), ("falloff", (n_lobes, 1)), ("colour", (1, n_lobes, 1))):
        arrays.setdefault(name, np.zeros(shape))
    return DSBRDF(Lobes(**arrays), name=props.id())


@once_a_variant
def dsbrdf_class() -> type[Any]:
    """Class of the plugin, bound to the variant that is set."""
    import drjit as dr

    mi = import_mitsuba()

    class Curves:
        """Curves over x that share a size; gradients reach the tensor they come from."""

        def __init__(self, tensor: Any, fixed: bool, scale: float = 1.0, shift: float = 0.0) -> None:
            """Of a tensor (..., coefficient), times `scale`, plus `shift`; `fixed` puts them into the kernel."""
            self.size = tensor.shape[-1]
            self.constant: list[Any] = []
            self.rises: list[list[Any]] = []
            size = math.prod(tensor.shape)
            if fixed and not dr.grad_enabled(tensor):
                every = [mi.Float(x) for x in np.array(tensor).ravel().tolist()]
            else:
                every = [dr.gather(mi.Float, tensor.array, mi.UInt32(i)) for i in range(size)]
            for first in range(0, size, self.size):
                numbers = every[first : first + self.size]
                self.constant.append(dr.fma(numbers[0], scale, shift))
                self.rises.append([(b - a) * scale for a, b in itertools.pairwise(numbers)])
            if not fixed:
                dr.eval(self.constant, self.rises)
            # What is zero, and stays it, costs nothing
            self.any = shift != 0.0 or dr.grad_enabled(tensor) or bool(np.any(np.array(dr.detach(tensor))))

        def at(self, curve: int, functions: dict[int, list[Any]]) -> Any:
            """Value of a curve where the functions have these values."""
            total = self.constant[curve]
            for rise, function in zip(self.rises[curve], functions[self.size], strict=True):
                total = dr.fma(rise, function, total)
            return total

    def functions_of(x: Any, size: int) -> list[Any]:
        """Functions that rise from 0 to 1 over x: a curve is its first coefficient and what it rises by times these.

        They are the sums of the functions of `dsbrdf.model.lobes.curve_design` from the second, third, ... on.
        """
        if size < 3:
            return [x] * (size - 1)
        spans = size - 2
        places = [dr.clip(dr.fma(x, float(spans), -float(i)), 0.0, 1.0) for i in range(spans)]
        begin = [1.0 - dr.square(1.0 - u) for u in places]
        end = [dr.square(u) for u in places]
        inner = [0.5 * (end[i] + begin[i + 1]) for i in range(spans - 1)]
        return [begin[0], *inner, end[-1]]

    class DSBRDFBSDF(base_class()):  # type: ignore[misc]
        """The plugin."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            model = _model_of(props)
            if model.n_channels not in (1, 3):
                raise ValueError(
                    f"bsdf {PLUGIN!r}: an rgb variant needs 1 or 3 channels, the model has {model.n_channels}."
                )
            self._name = model.name
            self._fixed = bool(props.get("fixed", False))
            self._n, self._n_channels = model.n_lobes, model.n_channels
            for name in ARRAYS:
                setattr(self, name, mi.TensorXf(getattr(model.lobes, name).astype(np.float32)))
            self.parameters_changed([])

        def traverse(self, callback: Any) -> None:
            for name in ARRAYS:
                callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

        def parameters_changed(self, _keys: Any) -> None:
            # Everything to the base 2: kappa is that of exp2m1
            self._scale = Curves(self.scale, self._fixed, LOG2_E, math.log2(LOG2_E))
            self._gamma = Curves(self.gamma, self._fixed, LOG2_E)
            self._beta = Curves(self.beta, self._fixed, LOG2_E)
            self._falloff = Curves(self.falloff, self._fixed)
            self._colour = Curves(self.colour, self._fixed, LOG2_E)
            if self._colour.size == 1:
                self._tint = [drjit_math.exp2(c) for c in self._colour.constant]
                if not self._fixed:
                    dr.eval(self._tint)
            self._sizes = {
                c.size for c in (self._scale, self._gamma, self._beta, self._falloff, self._colour)
            }
            # Exact with any tables: an optimiser's steps need not pay for new ones
            tensors = [getattr(self, name) for name in ARRAYS]
            if not dr.grad_enabled(*tensors):
                self.set_tables(sampling.tables(Lobes(*(np.array(t, dtype=np.float64) for t in tensors))))

        def _value(self, pair: drjit_math.Pair, _active: Any) -> Any:
            functions = {size: functions_of(pair.cos_d, size) for size in self._sizes}
            azimuth = pair.azimuth() if self._beta.any else None
            channels = [mi.Float(0.0) for _ in range(self._n_channels)]
            for k in range(self._n):
                gamma = drjit_math.exp2(dr.minimum(self._gamma.at(k, functions), MAX_FACTOR))
                power = dr.fma(gamma, pair.log2_u, self._scale.at(k, functions))
                factor = self._factor(k, functions, pair.log2_u, azimuth)
                for c, exponent in enumerate(self._exponents(k, functions, power)):
                    lobe = drjit_math.exp2m1(exponent)
                    channels[c] = channels[c] + lobe if factor is None else dr.fma(lobe, factor, channels[c])
            return mi.Color3f(*channels)

        def _factor(self, k: int, functions: dict[int, list[Any]], log2_u: Any, azimuth: Any) -> Any:
            """What falloff and beta make of a lobe; None if nothing."""
            exponent = None
            if self._falloff.any:
                exponent = self._falloff.at(k, functions) * log2_u
            if azimuth is not None:
                of_azimuth = self._beta.at(k, functions) * azimuth
                exponent = of_azimuth if exponent is None else exponent + of_azimuth
            return None if exponent is None else drjit_math.exp2(dr.minimum(exponent, MAX_FACTOR))

        def _exponents(self, k: int, functions: dict[int, list[Any]], power: Any) -> list[Any]:
            """`kappa u^gamma` of each channel, to the base 2."""
            of_lobe = [c * self._n + k for c in range(self._n_channels)]
            if self._colour.size > 1:
                powers = [power + self._colour.at(i, functions) for i in of_lobe]
                return [drjit_math.exp2(dr.minimum(p, MAX_LOG2)) for p in powers]
            common = drjit_math.exp2(dr.minimum(power, MAX_FACTOR))
            return [dr.minimum(common * self._tint[i], MAX_LOBE) for i in of_lobe]

        def to_string(self) -> str:
            return (
                f"DSBRDF[\n  name = {self._name!r},\n  lobes = {self._n},\n  channels = {self._n_channels},\n"
                f"  azimuthal = {self._beta.any}\n]"
            )

        __repr__ = to_string

    return DSBRDFBSDF
