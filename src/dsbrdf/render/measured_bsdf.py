"""The plugin `dsbrdf_measured` for Mitsuba 3: a measured table as a bsdf.

Values are those of `MeasuredBRDF.eval`. Directions are drawn as those of a model, by tables of `dsbrdf.model.sampling`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsbrdf.geometry.grids import CONVENTIONS, cell_angles
from dsbrdf.measured import read
from dsbrdf.measured.lookup import evaluate, fill_invalid
from dsbrdf.measured.table import MeasuredBRDF, tabulate
from dsbrdf.model import sampling
from dsbrdf.render import drjit_math
from dsbrdf.render.half_vector_bsdf import base_class
from dsbrdf.render.variants import import_mitsuba, once_a_variant

__all__ = ["PLUGIN", "measured_class", "to_dict"]

#: Name of the plugin in scenes.
PLUGIN = "dsbrdf_measured"


def to_dict(measured: MeasuredBRDF) -> dict[str, Any]:
    """The bsdf of a table in memory, for `mitsuba.load_dict`.

    Parameters
    ----------
    measured : MeasuredBRDF
        On other cells than even ones it is put on those of a MERL file, by `MeasuredBRDF.eval`.
    """
    mi = import_mitsuba()

    measured = _on_cells(measured)
    values = mi.TensorXf(measured.values.astype(np.float32))
    return {"type": PLUGIN, "values": values, "convention": measured.convention}


def _on_cells(measured: MeasuredBRDF) -> MeasuredBRDF:
    """The table, on even cells in `sqrt(theta_h)`, theta_d and phi_d."""
    convention = measured.convention if measured.convention in CONVENTIONS else "centre"
    angles = cell_angles(convention, measured.planes.shape[1:])
    given = (measured.theta_h, measured.theta_d, measured.phi_d)
    if all(np.allclose(a, b, atol=1e-6) for a, b in zip(angles, given, strict=True)):
        return measured
    return tabulate(measured.eval, measured.name, source=measured.source)


def _table_of(props: Any) -> MeasuredBRDF:
    """The table that a scene gives, by file or by values."""
    mi = import_mitsuba()

    convention = props.get("convention", "centre")
    if "filename" in props:
        path = str(mi.file_resolver().resolve(props["filename"]))
        measured = read(path, convention=convention)
        if not isinstance(measured, MeasuredBRDF):
            raise ValueError(
                f"bsdf {PLUGIN!r}: {path} holds scattered samples; a table is needed. Fit them instead."
            )
        return _on_cells(measured)
    if "values" not in props:
        raise ValueError(
            f"bsdf {PLUGIN!r}: 'filename' of a table, or 'values' (theta_h, theta_d, phi_d, channel)."
        )
    values = np.array(props["values"], dtype=np.float64)
    if values.ndim != 4:
        raise ValueError(
            f"bsdf {PLUGIN!r}: 'values' must be (theta_h, theta_d, phi_d, channel), got shape {values.shape}."
        )
    planes = np.where(np.isfinite(values), values, -1.0)
    angles = cell_angles(convention, values.shape[:3])
    return MeasuredBRDF(
        props.id(), np.moveaxis(planes, -1, 0), np.ones(values.shape[-1]), *angles, convention
    )


@once_a_variant
def measured_class() -> type[Any]:
    """Class of the plugin, bound to the variant that is set."""
    import drjit as dr

    mi = import_mitsuba()

    class MeasuredTable(base_class()):  # type: ignore[misc]
        """The plugin."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            measured = _table_of(props)
            if measured.n_channels not in (1, 3):
                raise ValueError(
                    f"bsdf {PLUGIN!r}: an rgb variant needs 1 or 3 channels, the table has {measured.n_channels}."
                )
            self._name = measured.name
            filled = fill_invalid(measured)
            coloured = np.broadcast_to(filled, (*filled.shape[:3], 3))
            # Both ends of phi_d, which a turn by pi brings back
            around = np.concatenate([coloured[:, :, -1:], coloured, coloured[:, :, :1]], axis=2)
            self._texture = mi.Texture3f(mi.TensorXf(around.astype(np.float32)), use_accel=False)
            self._cells = measured.planes.shape[1:]
            self._offset = 0.0 if measured.convention == "centre" else 0.5
            self.set_tables(sampling.tables_for(lambda wi, wo: evaluate(measured, filled, wi, wo)))

        def _value(self, _si: Any, pair: drjit_math.Pair, active: Any) -> Any:
            n_h, n_d, n_phi = self._cells
            right = 2.0 / np.pi
            h = dr.sqrt(pair.theta_h() * right) + self._offset / n_h
            d = pair.theta_d() * right + self._offset / n_d
            phi = (pair.phi_d() / np.pi * n_phi + self._offset + 1.0) / (n_phi + 2)
            return mi.Color3f(self._texture.eval(mi.Point3f(phi, d, h), active))

        def to_string(self) -> str:
            return f"MeasuredTable[\n  name = {self._name!r},\n  cells = {self._cells}\n]"

        __repr__ = to_string

    return MeasuredTable
