"""Slices of fits across the plane of incidence, for Figs. 2, 3 and 8. Needs the extra `[plot]`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from dsbrdf.paper.fit_report import SliceFit
from dsbrdf.plot import model as drawing
from dsbrdf.plot.style import PALE

__all__ = ["channels", "plane_of", "shade_unfitted", "shown_rows"]


def channels(fit: SliceFit) -> list[tuple[int, str, Any]]:
    """Number, name and colour of each channel that is shown."""
    return drawing._channels(fit.model)  # type: ignore[arg-type]


def plane_of(fit: SliceFit, row: int) -> Any:
    """What `dsbrdf.plot` draws of a row of the table: points, the fitted curve, the lobes, and the delta term."""
    # Anything with a table and a model of lobes will do
    plane = drawing._plane(fit, row)  # type: ignore[arg-type]
    if fit.model.spike.any():
        plane.parts["delta"] = np.maximum(plane.curves - sum(plane.parts.values()), 0.0)
    return plane


def shown_rows(fit: SliceFit, theta_d: Iterable[float]) -> list[int]:
    """The table's rows of the fitted slices nearest to `theta_d` in radians, each once."""
    angles = fit.model.theta_d
    nearest = [angles[np.abs(angles - angle).argmin()] for angle in theta_d]
    return list(dict.fromkeys(int(np.abs(fit.measured.theta_d - angle).argmin()) for angle in nearest))


def shade_unfitted(axes: Any, fit: SliceFit, theta_d: float) -> None:
    """Shade the theta_h that the masks leave out at `theta_d` in radians."""
    low = float(np.rad2deg(fit.options["min_theta_h"]))
    axes.axvspan(-low, low, color=PALE, lw=0, zorder=0)
    if fit.options["perimeter_mask"]:
        limit = 90.0 - float(np.rad2deg(theta_d))
        for side in (-1, 1):
            axes.axvspan(side * limit, side * 90.0, color=PALE, lw=0, zorder=0)
