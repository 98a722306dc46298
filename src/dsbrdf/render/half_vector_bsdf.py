"""What the two plugins share: sampling through the half vector, and Mitsuba's interface around a reflectance."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from dsbrdf.model.sampling import COSINE, N_ROWS, POWERS, SamplingTables
from dsbrdf.render import drjit_math
from dsbrdf.render.variants import import_mitsuba, once_a_variant

__all__ = ["base_class"]

#: A power of the cosine that is not made from the one before it: squaring doubles errors.
ANEW = 4.0**5


@once_a_variant
def base_class() -> type[Any]:
    """Class of a bsdf with a `_value` of its own, bound to the variant that is set."""
    import drjit as dr

    mi = import_mitsuba()

    base: Any = mi.BSDF

    class HalfVectorBSDF(base):  # type: ignore[misc]
        """A glossy, one-sided bsdf; `mi.Float` and its like are those of the variant."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide]
            self.m_flags = self.m_components[0]

        @abstractmethod
        def _value(self, si: Any, pair: drjit_math.Pair, active: Any) -> Any:
            """Reflectance in 1/sr, without the cosine, as a colour."""

        def set_tables(self, tables: SamplingTables) -> None:
            """Sample from these tables."""
            weight = tables.shares * (POWERS + 2.0) / (4.0 * np.pi)
            weight = np.column_stack([weight, tables.cosine / np.pi])
            self._weights = drjit_math.packets(weight.reshape(N_ROWS, -1, 4))
            self._n_packets = weight.shape[1] // 4
            self._n_entries = tables.alias.shape[1]
            self._alias = drjit_math.packets(tables.alias)

        def _row(self, cos_i: Any) -> Any:
            """Row of an angle. Always in range, so that look-ups need no mask, and are shared where `cos_i` is."""
            row = mi.UInt32(dr.fma(dr.safe_acos(cos_i), (N_ROWS - 1) / (0.5 * np.pi), 0.5))
            return dr.minimum(row, N_ROWS - 1)

        def _density(self, pair: drjit_math.Pair, wi: Any, wo: Any) -> Any:
            """Density of `_draw` over solid angle of directions."""
            first = self._row(wi.z) * self._n_packets
            *weights, of_cosine = (
                weight
                for i in range(self._n_packets)
                for weight in dr.gather(mi.Vector4f, self._weights, first + i)
            )
            power, half = pair.half_z, mi.Float(0.0)
            for exponent, weight in zip(POWERS.tolist(), weights, strict=True):
                if exponent == ANEW:
                    power = drjit_math.exp2(exponent * pair.log2_u)
                elif exponent > 1.0:
                    power = dr.square(dr.square(power))
                half = dr.fma(weight, power, half)
            image = dr.maximum(2.0 * pair.half_z * wi.z - pair.cos_d, 0.0)
            return dr.fma(of_cosine, wo.z, pair.half_z * half / (pair.cos_d + image))

        def _draw(self, wi: Any, sample1: Any, sample2: Any) -> Any:
            """A direction for `wi`."""
            place = sample1 * self._n_entries
            entry = dr.minimum(mi.UInt32(place), self._n_entries - 1)
            packet = dr.gather(mi.Vector4f, self._alias, self._row(wi.z) * self._n_entries + entry)
            rest = place - mi.Float(entry)
            stay = rest < packet.x
            exponent = dr.select(stay, packet.y, packet.z)
            # What is left of the number decides between a half vector and its image
            rest = dr.select(stay, rest / packet.x, (rest - packet.x) / (1.0 - packet.x))

            # sin^2 = 1 - xi^(2 / exponent), precise near the pole
            log2_xi = dr.log2(1.0 - sample2.x)
            sin2 = -_minus_one(2.0 * log2_xi / dr.abs(exponent))
            sin_phi, cos_phi = dr.sincos(2.0 * dr.pi * sample2.y)
            sin_theta = dr.safe_sqrt(sin2)
            m = mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, dr.safe_sqrt(1.0 - sin2))

            toward = dr.dot(wi, m)
            image = 2.0 * m.z * wi.z - toward
            keep = rest * (dr.maximum(toward, 0.0) + dr.maximum(image, 0.0)) < toward
            h = mi.Vector3f(dr.select(keep, m.x, -m.x), dr.select(keep, m.y, -m.y), m.z)
            mirrored = dr.fma(2.0 * dr.select(keep, toward, image), h, -wi)
            return dr.select(exponent == COSINE, m, dr.normalize(mirrored))

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            active &= self._seen(ctx, si.wi, wo)
            pair = drjit_math.pair(si.wi, wo)
            value = self._value(si, pair, active) * wo.z
            return dr.select(active, value, 0.0), dr.select(active, self._density(pair, si.wi, wo), 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            active &= self._seen(ctx, si.wi, wo)
            return dr.select(active, self._value(si, drjit_math.pair(si.wi, wo), active) * wo.z, 0.0)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            active &= self._seen(ctx, si.wi, wo)
            pair = drjit_math.pair(si.wi, wo)
            return dr.select(active, self._density(pair, si.wi, wo), 0.0)

        def sample(
            self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> tuple[Any, Any]:
            active &= self._seen(ctx, si.wi, si.wi)
            record = mi.BSDFSample3f()
            record.wo = self._draw(si.wi, sample1, sample2)
            record.eta = 1.0
            record.sampled_component = 0
            record.sampled_type = +mi.BSDFFlags.GlossyReflection
            value, record.pdf = self.eval_pdf(ctx, si, record.wo, active)
            active &= record.pdf > 0.0
            return record, dr.select(active, value / dr.maximum(record.pdf, 1e-30), 0.0)

        def _seen(self, ctx: Any, wi: Any, wo: Any) -> Any:
            """Whether both directions are above the horizon; false if this component is not asked for."""
            return (wi.z > 0.0) & (wo.z > 0.0) & ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0)

    def _minus_one(x: Any) -> Any:
        """`2^x - 1` for x of at most 0."""
        return drjit_math.exp2m1(dr.maximum(x, -drjit_math.MAX_EXPONENT))

    return HalfVectorBSDF
