"""How far a model is from what was measured, over the whole hemisphere, and how near any such model could come.

- `rel`: relative RMS over pairs of directions, `sqrt(sum (model - f)^2 / sum f^2)`;
- `cbrt`: the same of the cube root of `f cos_i cos_o`, near to what the eye sees;
- `log`: RMS of `ln((model + 1e-6) / (f + 1e-6))` over all entries that are not zero, as iBRDF (Chen et al. 2020) and
  FMBRDF have it;
- `albedo`: the largest relative error of the light reflected to within 80 degrees of the normal from 5, 30, 60 and 75
  degrees, of the mean over channels.

The entries of a table are weighted by the solid angle of their cells, but for `log`; samples count alike. Floors of
`rel`: bivariate, what no function of (theta_h, theta_d) goes below, and azimuthal, the same with a cos(2 phi_d) term.
"""

from __future__ import annotations

import dataclasses
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dsbrdf.fitting.observations import cell_area
from dsbrdf.geometry import directions, half_diff
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["ALBEDO_ANGLES", "LOG_OFFSET", "FitErrors", "errors"]

Array = NDArray[np.float64]

#: Added to reflectances in 1/sr before their logarithm.
LOG_OFFSET = 1e-6
#: Incident angles, radians, of the error of the albedo.
ALBEDO_ANGLES = np.deg2rad([5.0, 30.0, 60.0, 75.0])
ALBEDO_N_PHI = 16
#: Directions within ten degrees of the horizon are left out of it: few instruments measure there.
ALBEDO_LEAST_COSINE = float(np.cos(np.deg2rad(80.0)))
#: Azimuths of a table that are looked at: every so many; neighbours are alike.
PHI_STEP = 12


class Reflectance(Protocol):
    """Anything with `eval`."""

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., channel) at pairs of directions."""


@dataclass(frozen=True)
class FitErrors:
    """Errors over the whole hemisphere; see `dsbrdf.fitting.metrics`. NaN where it cannot be told.

    Parameters
    ----------
    rel, cbrt, log : float
    albedo : float
        NaN for scattered samples.
    bivariate_floor, azimuthal_floor : float
        Of `rel`; NaN for scattered samples.
    """

    rel: float
    cbrt: float
    log: float
    albedo: float = float("nan")
    bivariate_floor: float = float("nan")
    azimuthal_floor: float = float("nan")

    def summary(self) -> dict[str, float]:
        """All by name."""
        return asdict(self)

    def __repr__(self) -> str:
        floors = {"bivariate floor": self.bivariate_floor, "azimuthal floor": self.azimuthal_floor}
        told = [f"{name} {value:.3f}" for name, value in floors.items() if np.isfinite(value)]
        return f"FitErrors({', '.join([str(self), *told])})"

    def __str__(self) -> str:
        parts = [f"rel {self.rel:.3f}", f"cbrt {self.cbrt:.3f}", f"log {self.log:.3f}"]
        if np.isfinite(self.albedo):
            parts.append(f"albedo {self.albedo:.3f}")
        return ", ".join(parts)


def errors(model: Reflectance, measured: MeasuredBRDF | Samples) -> FitErrors:
    """Errors of a model, or of anything with `eval`, over all that was measured."""
    if isinstance(measured, Samples):
        valid = np.isfinite(measured.values)
        predicted = np.asarray(model.eval(measured.wi, measured.wo))
        cosines = measured.wi[:, 2] * measured.wo[:, 2]
        return FitErrors(*_three(predicted, measured.values, np.ones(len(measured)), cosines, valid))
    theta_h, theta_d = measured.theta_h, measured.theta_d
    which = np.arange(len(measured.phi_d))[PHI_STEP // 2 :: PHI_STEP]
    if not which.size:
        which = np.arange(len(measured.phi_d))
    wi, wo = half_diff.to_directions(theta_h[:, None, None], theta_d[:, None], measured.phi_d[which])
    values = np.moveaxis(measured.planes[..., which] * measured.scale[:, None, None, None], 0, -1)
    valid = np.moveaxis(measured.planes[..., which] >= 0.0, 0, -1) & np.isfinite(values)
    valid &= ((wi[..., 2] > 0.0) & (wo[..., 2] > 0.0))[..., None]
    some = valid.any(-1)
    area = np.broadcast_to(cell_area(theta_h, theta_d).T[..., None], some.shape)
    predicted = np.asarray(model.eval(wi[some], wo[some]))
    three = _three(predicted, values[some], area[some], (wi[..., 2] * wo[..., 2])[some], valid[some])
    return FitErrors(*three, _albedo_error(model, measured), *_floors(measured))


def _three(
    model: Array, values: Array, area: Array, cos_product: Array, valid: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """`rel`, `cbrt` and `log` of values (n, channel)."""
    f = np.where(valid, values, 0.0)
    model = np.where(valid, model, 0.0)
    area = area[:, None] * valid
    root = np.cbrt(cos_product)[:, None]
    off, of = np.cbrt(model) - np.cbrt(f), np.cbrt(f)
    # Zero is what is below the instrument, or outside of the colours of a display: it has no logarithm
    seen = valid & (f > 0.0)
    ratio = np.log((model + LOG_OFFSET) / (np.maximum(f, 0.0) + LOG_OFFSET))
    return (
        _relative((area * (model - f) ** 2).sum(), (area * f**2).sum()),
        _relative((area * (root * off) ** 2).sum(), (area * (root * of) ** 2).sum()),
        _relative((seen * ratio**2).sum(), float(seen.sum())),
    )


def _relative(squares: float, energy: float) -> float:
    return float(np.sqrt(squares / energy)) if energy > 0.0 else float("nan")


def _albedo_error(model: Reflectance, measured: MeasuredBRDF) -> float:
    # Fewer azimuths take less time to fill where they are invalid
    some = np.arange(0, len(measured.phi_d), max(1, len(measured.phi_d) // ALBEDO_N_PHI))
    measured = dataclasses.replace(measured, planes=measured.planes[..., some], phi_d=measured.phi_d[some])
    worst = 0.0
    for theta in ALBEDO_ANGLES:
        wi, wo, weight = directions.albedo_nodes(float(theta), ALBEDO_N_PHI)
        seen = wo[:, 2] > ALBEDO_LEAST_COSINE
        wo, weight = wo[seen], weight[seen]
        try:
            truth = weight @ np.asarray(measured.eval(wi, wo))
        except ValueError:  # a channel without a valid entry
            return float("nan")
        found = weight @ np.asarray(model.eval(wi, wo))
        worst = max(worst, abs(float(found.mean() / max(float(truth.mean()), 1e-300)) - 1.0))
    return worst


def _floors(measured: MeasuredBRDF) -> tuple[float, float]:
    """The bivariate and the azimuthal floor."""
    moments = measured.moments(range(len(measured.theta_d)))
    n, f, ff, c, cc, fc = np.moveaxis(moments, -1, 0)
    count = np.maximum(n, 1.0)
    var_f = np.maximum(ff - f * f / count, 0.0)
    var_c = np.maximum(cc - c * c / count, 0.0)
    cov = fc - f * c / count
    slope = np.divide(cov, var_c, out=np.zeros_like(cov), where=var_c > 1e-12 * count)
    area = cell_area(measured.theta_h, measured.theta_d)[:, None]
    energy = float((area * ff).sum())
    rest = np.maximum(var_f - slope * cov, 0.0)
    return _relative(float((area * var_f).sum()), energy), _relative(float((area * rest).sum()), energy)
