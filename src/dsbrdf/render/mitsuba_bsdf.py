"""The plugin `dsbrdf` for Mitsuba 3: a fitted model as a bsdf, differentiable in its parameters.

`dsbrdf.render.register` makes it known; `docs/mitsuba.md` describes it for the author of a scene.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsbrdf.model import evaluation
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.paper.spike import SIN2_WIDTH
from dsbrdf.render import drjit_math
from dsbrdf.render.half_vector_bsdf import base_class
from dsbrdf.render.sampling_tables import sampling_tables
from dsbrdf.render.variants import import_mitsuba, once_a_variant

__all__ = ["PLUGIN", "dsbrdf_class", "to_dict"]

#: Name of the plugin in scenes.
PLUGIN = "dsbrdf"
ARRAYS = ("theta_d", "kappa", "gamma", "beta", "spike")
#: Gammas below this are Lambertian to single precision, and have a logarithm.
MIN_GAMMA = 1e-6
#: Largest kappa whose lobe is a number in single precision.
MAX_KAPPA = drjit_math.MAX_EXPONENT / drjit_math.LOG2_E


def to_dict(model: DSBRDF) -> dict[str, Any]:
    """The bsdf of a model in memory, for `mitsuba.load_dict`.

    Parameters
    ----------
    model : DSBRDF

    Returns
    -------
    dict
        Of the plugin `dsbrdf`, with the arrays as tensors of the variant that is set.
    """
    mi = import_mitsuba()

    return {"type": PLUGIN} | {
        name: mi.TensorXf(np.asarray(getattr(model, name), dtype=np.float32)) for name in ARRAYS
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
    for name in ARRAYS[:3]:
        if name not in given:
            raise ValueError(
                f"bsdf {PLUGIN!r}: 'filename' of a model, or the arrays 'theta_d', 'kappa' and 'gamma' are needed; "
                f"{name!r} is missing."
            )
    arrays: dict[str, Any] = {name: np.array(props[name], dtype=np.float64) for name in given}
    arrays.setdefault("beta", np.zeros_like(arrays["kappa"]))
    return DSBRDF(**arrays, name=props.id())


def _checked(model: DSBRDF) -> DSBRDF:
    """The model with three channels.

    Raises
    ------
    ValueError
        If it has another number than one or three, or is out of the range of single precision.
    """
    if model.n_channels not in (1, 3):
        raise ValueError(
            f"bsdf {PLUGIN!r}: an rgb variant needs 1 or 3 channels, the model has {model.n_channels}."
        )
    if (largest := float(model.kappa.max())) > MAX_KAPPA:
        raise ValueError(
            f"bsdf {PLUGIN!r}: 'kappa' must be at most {MAX_KAPPA:.0f} in single precision, got {largest:g}."
        )
    if model.n_channels == 3:
        return model
    parts = {name: np.repeat(getattr(model, name), 3, axis=1) for name in ARRAYS[1:]}
    return model.replace(**parts)


@once_a_variant
def dsbrdf_class() -> type[Any]:
    """Class of the plugin, bound to the variant that is set."""
    import drjit as dr

    mi = import_mitsuba()

    def flat_packets(tensor: Any) -> Any:
        """A tensor (theta_d, channel, ...) as packets of four channels, gradients kept."""
        shape = tensor.shape
        channel = np.arange(4) % 3
        order = np.moveaxis(np.arange(np.prod(shape)).reshape(shape)[:, channel], 1, -1)
        return dr.gather(mi.Float, tensor.array, mi.UInt32(order.ravel().astype(np.uint32)))

    class DSBRDFBSDF(base_class()):  # type: ignore[misc]
        """The plugin."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            model = _checked(_model_of(props))
            self._name = model.name
            self._theta_d = model.theta_d
            self._n_slices, _, self._n = model.kappa.shape
            gaps = np.diff(model.theta_d)
            self._even = self._n_slices > 1 and bool(np.ptp(gaps) < 1e-6)
            self._theta = mi.Float(model.theta_d)
            self.log_kappa = mi.TensorXf(np.log(model.kappa).astype(np.float32))
            self.log_gamma = mi.TensorXf(np.log(np.maximum(model.gamma, MIN_GAMMA)).astype(np.float32))
            self.beta = mi.TensorXf(model.beta.astype(np.float32))
            self.spike = mi.TensorXf(model.spike.astype(np.float32))
            self.parameters_changed([])

        def traverse(self, callback: Any) -> None:
            for name in ("log_kappa", "log_gamma", "beta", "spike"):
                callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

        def parameters_changed(self, _keys: Any) -> None:
            scale = dr.minimum(dr.exp(self.log_kappa.array) * drjit_math.LOG2_E, drjit_math.MAX_EXPONENT)
            self._kappa = flat_packets(mi.TensorXf(scale, self.log_kappa.shape))
            self._gamma = flat_packets(mi.TensorXf(dr.exp(self.log_gamma.array), self.log_gamma.shape))
            self._beta, self._spike = flat_packets(self.beta), flat_packets(self.spike)
            # What is zero, and stays it, costs nothing
            self._with_beta, self._with_height = (
                dr.grad_enabled(x) or bool(np.any(np.array(dr.detach(x)))) for x in (self.beta, self.spike)
            )
            # Exact with any tables: an optimiser's steps need not pay for new ones
            if dr.grad_enabled(self.log_kappa, self.log_gamma, self.beta, self.spike):
                return
            kappa, gamma, beta, spike = (
                np.array(x, dtype=np.float64)
                for x in (dr.exp(self.log_kappa), dr.exp(self.log_gamma), self.beta, self.spike)
            )
            self.set_tables(
                sampling_tables(
                    lambda wi, wo: evaluation.evaluate(wi, wo, self._theta_d, kappa, gamma, beta, spike),
                    self._theta_d, kappa, gamma, spike,
                )
            )  # fmt: skip

        def _slice(self, theta_d: Any, active: Any) -> tuple[Any, Any]:
            """Index of the slice below and the weight of the one above."""
            if self._n_slices == 1:
                return mi.UInt32(0), mi.Float(0.0)
            last = self._n_slices - 2
            if self._even:
                low, high = self._theta_d[[0, -1]]
                place = (theta_d - low) * ((last + 1) / (high - low))
                index = mi.UInt32(dr.clip(place, 0.0, last))
                return index, dr.clip(place - mi.Float(index), 0.0, 1.0)
            index = dr.binary_search(  # type: ignore[no-untyped-call]
                0, last, lambda i: dr.gather(mi.Float, self._theta, i + 1, active) <= theta_d
            )
            low, high = (dr.gather(mi.Float, self._theta, index + i, active) for i in (0, 1))
            return index, dr.clip((theta_d - low) / (high - low), 0.0, 1.0)

        def _value(self, pair: drjit_math.Pair, active: Any) -> Any:
            index, weight = self._slice(pair.theta_d, active)
            azimuth = pair.azimuth() if self._with_beta else None
            cap = dr.maximum(1.0 - pair.sin2 / SIN2_WIDTH, 0.0) if self._with_height else None
            low = self._at_slice(index, pair.log2_u, azimuth, cap, active)
            if self._n_slices == 1:
                return low
            return dr.lerp(low, self._at_slice(index + 1, pair.log2_u, azimuth, cap, active), weight)

        def _at_slice(self, index: Any, log2_u: Any, azimuth: Any, cap: Any, active: Any) -> Any:
            """The sum over lobes, and the spike, of a slice."""
            total = mi.Color3f(0.0)
            for k in range(self._n):
                at = index * self._n + k
                kappa = dr.gather(mi.Vector4f, self._kappa, at, active)
                gamma = dr.gather(mi.Vector4f, self._gamma, at, active)
                beta = dr.gather(mi.Vector4f, self._beta, at, active) if azimuth is not None else None
                for c in range(3):
                    lobe = drjit_math.exp2m1(kappa[c] * drjit_math.exp2(gamma[c] * log2_u))
                    total[c] += lobe if beta is None else lobe * dr.fma(beta[c], azimuth, 1.0)
            if cap is not None:
                height = dr.gather(mi.Vector4f, self._spike, index, active)
                total += mi.Color3f(height.x, height.y, height.z) * cap
            return total

        def to_string(self) -> str:
            return (
                f"DSBRDF[\n  name = {self._name!r},\n  lobes = {self._n},\n  slices = {self._n_slices},\n"
                f"  azimuthal = {self._with_beta},\n  spike = {self._with_height}\n]"
            )

        __repr__ = to_string

    return DSBRDFBSDF
