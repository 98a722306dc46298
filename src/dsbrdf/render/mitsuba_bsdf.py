"""The plugin `dsbrdf` for Mitsuba 3: a fitted model as a bsdf, differentiable in its parameters.

`dsbrdf.render.register` makes it known; `docs/mitsuba.md` describes it for the author of a scene. Values come from the
curves: the functions of a curve over x = cos(theta_d) are computed once for all lobes, and coefficients are the same
for all rays, so that nothing is looked up by x; one power serves all channels of a lobe. Of a texture, coefficients are
those of each ray's texel, interpolated between neighbours.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dsbrdf.batch.texels import TexelMaps, load_texels
from dsbrdf.model import evaluation, sampling
from dsbrdf.model import file as model_file
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
#: Texels that the sampler of a texture is made for.
N_SAMPLED = 64
#: Least `ln(kappa)`, where a texture has no model.
ABSENT = -40.0


def to_dict(model: DSBRDF | TexelMaps) -> dict[str, Any]:
    """The bsdf of a model or of the maps of a texture in memory, for `mitsuba.load_dict`.

    Parameters
    ----------
    model : DSBRDF or TexelMaps

    Returns
    -------
    dict
        Of the plugin `dsbrdf`, with the arrays of its lobes as tensors of the variant that is set.

    Raises
    ------
    ValueError
        If the maps have no rows and columns.
    """
    mi = import_mitsuba()

    arrays = _arrays_of(model)
    # Mitsuba tries to make a colour of a tensor whose first axis is 3 long, and complains: put one more axis in front
    return {"type": PLUGIN} | {name: mi.TensorXf(array[None]) for name, array in arrays.items()}


def _arrays_of(model: DSBRDF | TexelMaps) -> dict[str, Any]:
    """The arrays of lobes in single precision, of maps with row and column in front."""
    if isinstance(model, DSBRDF):
        lobes = model.lobes.numpy
        return {name: getattr(lobes, name).astype(np.float32) for name in ARRAYS}
    if len(model.shape) != 2:
        raise ValueError(f"a texture has rows and columns of texels, these have shape {model.shape}.")
    return model.arrays()


class _Given(NamedTuple):
    """What a scene gives: arrays of `Lobes`, with row and column in front if they are textures, and a name."""

    arrays: dict[str, Any]
    name: str


def _given(props: Any) -> _Given:
    """The arrays that a scene gives, by file or by themselves."""
    mi = import_mitsuba()

    given = [name for name in ARRAYS if name in props]
    if "filename" in props:
        if given:
            raise ValueError(
                f"bsdf {PLUGIN!r}: give either 'filename' or arrays, got 'filename' and {given[0]!r}."
            )
        path = Path(str(mi.file_resolver().resolve(props["filename"])))
        model = load_texels(path) if path.suffix in (".npz", ".zarr") else model_file.load(path)
        return _Given(_arrays_of(model), model.name if isinstance(model, DSBRDF) else path.stem)
    for name in ARRAYS[:2]:
        if name not in given:
            raise ValueError(
                f"bsdf {PLUGIN!r}: 'filename' of a model or of maps, or the arrays 'scale' and 'gamma' are needed; "
                f"{name!r} is missing."
            )
    arrays: dict[str, Any] = {}
    for name in given:
        array = np.array(props[name], dtype=np.float64)
        # Those of `to_dict` have one more axis in front
        is_wrapped = array.ndim in ((4, 6) if name == "colour" else (3, 5)) and len(array) == 1
        arrays[name] = array[0] if is_wrapped else array
    *texels, n_lobes, _ = arrays["scale"].shape
    for name, shape in (("beta", (n_lobes, 1)), ("falloff", (n_lobes, 1)), ("colour", (1, n_lobes, 1))):
        arrays.setdefault(name, np.zeros((*texels, *shape)))
    return _Given(arrays, props.id())


def _checked(given: _Given) -> _Given:
    """The arrays in single precision, sound, with a lobe that adds nothing where a texture has no model."""
    arrays = dict(given.arrays)
    texels = arrays["scale"].shape[:-2]
    if not texels:
        lobes = Lobes(**arrays)
        return _Given({name: getattr(lobes, name).astype(np.float32) for name in ARRAYS}, given.name)
    for name, array in arrays.items():
        if array.shape[: len(texels)] != texels or len(texels) != 2:
            raise ValueError(
                f"bsdf {PLUGIN!r}: textures must have row and column in front, the same for all, got {name!r} of shape "
                f"{array.shape} and 'scale' of {arrays['scale'].shape}."
            )
    absent = np.isnan(arrays["scale"]).any((-1, -2))
    for name, array in arrays.items():
        arrays[name] = array.astype(np.float32)
        arrays[name][absent] = ABSENT if name == "scale" else 0.0
    # Shapes and ranges are those of any texel
    Lobes(**{name: array[0, 0].astype(np.float64) for name, array in arrays.items()})
    return _Given(arrays, given.name)


@once_a_variant
def dsbrdf_class() -> type[Any]:
    """Class of the plugin, bound to the variant that is set."""
    import drjit as dr

    mi = import_mitsuba()

    class Curves:
        """Curves over x that share a size."""

        def __init__(self, numbers: list[Any], size: int, scale: float, shift: float, some: bool) -> None:
            """Of coefficients one after another, times `scale`, plus `shift`; `some` if not all are zero."""
            self.size, self.any = size, some or shift != 0.0
            self.constant: list[Any] = []
            self.rises: list[list[Any]] = []
            for first in range(0, len(numbers), size):
                of_curve = numbers[first : first + size]
                self.constant.append(dr.fma(of_curve[0], scale, shift))
                self.rises.append([(b - a) * scale for a, b in itertools.pairwise(of_curve)])

        def at(self, curve: int, functions: dict[int, list[Any]]) -> Any:
            """Value of a curve where the functions have these values."""
            total = self.constant[curve]
            for rise, function in zip(self.rises[curve], functions[self.size], strict=True):
                total = dr.fma(rise, function, total)
            return total

    def numbers_of(tensor: Any, fixed: bool) -> list[Any]:
        """The numbers of a tensor, through which gradients reach it; `fixed` puts them into the kernel."""
        if fixed and not dr.grad_enabled(tensor):
            return [mi.Float(x) for x in np.array(tensor).ravel().tolist()]
        return [dr.gather(mi.Float, tensor.array, mi.UInt32(i)) for i in range(math.prod(tensor.shape))]

    # Everything to the base 2: kappa is that of exp2m1
    scales = {name: (1.0 if name == "falloff" else LOG2_E, 0.0) for name in ARRAYS}
    scales["scale"] = (LOG2_E, math.log2(LOG2_E))

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
            arrays, self._name = _checked(_given(props))
            *texels, self._n_channels, self._n, _ = arrays["colour"].shape
            if self._n_channels not in (1, 3):
                raise ValueError(
                    f"bsdf {PLUGIN!r}: an rgb variant needs 1 or 3 channels, the model has {self._n_channels}."
                )
            self._texels = tuple(texels)
            self._fixed = bool(props.get("fixed", False))
            self._filter = str(props.get("filter_type", "bilinear"))
            if self._filter not in ("bilinear", "nearest"):
                raise ValueError(
                    f"bsdf {PLUGIN!r}: 'filter_type' must be 'bilinear' or 'nearest', got {self._filter!r}."
                )
            for name in ARRAYS:
                setattr(self, name, mi.TensorXf(arrays[name]))
            self.parameters_changed([])

        def traverse(self, callback: Any) -> None:
            for name in ARRAYS:
                callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

        def parameters_changed(self, _keys: Any) -> None:
            tensors = {name: getattr(self, name) for name in ARRAYS}
            # What is zero, and stays it, costs nothing
            self._some = {
                name: dr.grad_enabled(tensor) or bool(np.any(np.array(dr.detach(tensor))))
                for name, tensor in tensors.items()
            }
            self._sizes = {tensor.shape[-1] for tensor in tensors.values()}
            if self._texels:
                self._textures = {name: self._texture(tensor) for name, tensor in tensors.items()}
            else:
                self._curves = self._made({name: numbers_of(t, self._fixed) for name, t in tensors.items()})
                self._tint = self._tinted(self._curves)
                if not self._fixed:
                    every = self._curves.values()
                    dr.eval([curves.constant for curves in every], [curves.rises for curves in every])
                    dr.eval(self._tint)
            # Exact with any tables: an optimiser's steps need not pay for new ones
            if not dr.grad_enabled(*tensors.values()):
                self.set_tables(self._tables({name: np.array(t, np.float64) for name, t in tensors.items()}))

        def _made(self, numbers: dict[str, list[Any]]) -> dict[str, Curves]:
            return {
                name: Curves(numbers[name], getattr(self, name).shape[-1], *scales[name], self._some[name])
                for name in ARRAYS
            }

        def _tinted(self, curves: dict[str, Curves]) -> list[Any]:
            """Factors of kappa, for each channel and lobe, if colours are the same at all theta_d."""
            colour = curves["colour"]
            return [drjit_math.exp2(c) for c in colour.constant] if colour.size == 1 else []

        def _texture(self, tensor: Any) -> Any:
            flat = mi.TensorXf(tensor.array, (*self._texels, math.prod(tensor.shape[2:])))
            mode = dr.FilterMode.Nearest if self._filter == "nearest" else dr.FilterMode.Linear
            return mi.Texture2f(flat, use_accel=False, filter_mode=mode)

        def _tables(self, arrays: dict[str, Any]) -> sampling.SamplingTables:
            """Of the model; of a texture those of the mean of some of its texels."""
            if not self._texels:
                return sampling.tables(Lobes(**arrays))
            n = math.prod(self._texels)
            flat = {name: array.reshape(n, *array.shape[2:]) for name, array in arrays.items()}
            places = np.unique(np.linspace(0, n - 1, N_SAMPLED).astype(int))
            lobes = [Lobes(**{name: array[i] for name, array in flat.items()}) for i in places]
            return sampling.tables_for(
                lambda wi, wo: np.mean([evaluation.evaluate_numpy(each, wi, wo) for each in lobes], axis=0)
            )

        def _value(self, si: Any, pair: drjit_math.Pair, active: Any) -> Any:
            if self._texels:
                at = {name: texture.eval(si.uv, active) for name, texture in self._textures.items()}
                curves = self._made(at)
                tint = self._tinted(curves)
            else:
                curves, tint = self._curves, self._tint
            functions = {size: functions_of(pair.cos_d, size) for size in self._sizes}
            azimuth = pair.azimuth() if curves["beta"].any else None
            channels = [mi.Float(0.0) for _ in range(self._n_channels)]
            for k in range(self._n):
                gamma = drjit_math.exp2(dr.minimum(curves["gamma"].at(k, functions), MAX_FACTOR))
                power = dr.fma(gamma, pair.log2_u, curves["scale"].at(k, functions))
                factor = self._factor(curves, k, functions, pair.log2_u, azimuth)
                for c, exponent in enumerate(self._exponents(curves["colour"], tint, k, functions, power)):
                    lobe = drjit_math.exp2m1(exponent)
                    channels[c] = channels[c] + lobe if factor is None else dr.fma(lobe, factor, channels[c])
            return mi.Color3f(*channels)

        def _factor(
            self,
            curves: dict[str, Curves],
            k: int,
            functions: dict[int, list[Any]],
            log2_u: Any,
            azimuth: Any,
        ) -> Any:
            """What falloff and beta make of a lobe; None if nothing."""
            exponent = None
            if curves["falloff"].any:
                exponent = curves["falloff"].at(k, functions) * log2_u
            if azimuth is not None:
                of_azimuth = curves["beta"].at(k, functions) * azimuth
                exponent = of_azimuth if exponent is None else exponent + of_azimuth
            return None if exponent is None else drjit_math.exp2(dr.minimum(exponent, MAX_FACTOR))

        def _exponents(
            self, colour: Curves, tint: list[Any], k: int, functions: dict[int, list[Any]], power: Any
        ) -> list[Any]:
            """`kappa u^gamma` of each channel, to the base 2."""
            of_lobe = [c * self._n + k for c in range(self._n_channels)]
            if not tint:
                powers = [power + colour.at(i, functions) for i in of_lobe]
                return [drjit_math.exp2(dr.minimum(p, MAX_LOG2)) for p in powers]
            common = drjit_math.exp2(dr.minimum(power, MAX_FACTOR))
            return [dr.minimum(common * tint[i], MAX_LOBE) for i in of_lobe]

        def to_string(self) -> str:
            size = f"  texels = {self._texels},\n" if self._texels else ""
            return (
                f"DSBRDF[\n  name = {self._name!r},\n{size}  lobes = {self._n},\n  channels = {self._n_channels},\n"
                f"  azimuthal = {self._some['beta']}\n]"
            )

        __repr__ = to_string

    return DSBRDFBSDF
