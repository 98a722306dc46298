"""Figures of merit of a reflectance against a measurement, the same for every method.

- `rel`: relative RMS, `sqrt(sum (g - f)^2 / sum f^2)`. The brightest few directions decide.
- `cbrt`: the same of the cube root of `f cos_i cos_o`, near to what the eye sees.
- `log`: RMS of `ln((g + 1e-4/sr) / (f + 1e-4/sr))`. Dark directions count as much as bright ones.
- `albedo`: the largest relative error, of the mean over channels, of the light reflected to within 80 degrees of the
  normal from 5, 30, 60 and 75 degrees.
- `ciede2000`: mean colour difference of a sphere in the light of `dsbrdf.comparison.sphere`.

The first three are over 20,000 pairs of directions, each direction uniform in solid angle within 80 degrees of the
normal, without those where a channel is below 1e-6/sr; sums are over pairs and channels. Of an RGL file f is the
measurement itself, the mean of both orders of the two directions, and not the table that is fitted. Of scattered
samples the first three are over the samples, and the others unknown.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dsbrdf.comparison import sphere
from dsbrdf.fitting.metrics import ALBEDO_ANGLES
from dsbrdf.geometry import directions
from dsbrdf.geometry.colour import rgb_weights
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["FIGURES", "Judge", "Merit", "pairs", "truth_of"]

Array = NDArray[np.float64]

N_PAIRS = 20_000
#: Cosine of the greatest angle of a direction to the normal: beyond, few instruments measure well.
LEAST_COSINE = float(np.cos(np.deg2rad(80.0)))
#: Reflectances, 1/sr, below which a pair is left out, and what is added before the logarithm.
LEAST, OFFSET = 1e-6, 1e-4
ALBEDO_N_PHI = 16
#: Begins RGL files.
TENSOR_FILE = b"tensor_file\0"
FIGURES = ("rel", "cbrt", "log", "albedo", "ciede2000")


class Reflectance(Protocol):
    """Anything with `eval`."""

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values (..., channel) at pairs of directions."""


@dataclass(frozen=True)
class Merit:
    """Figures of merit, see `dsbrdf.comparison.merit`; NaN where one cannot be told.

    Parameters
    ----------
    rel, cbrt, log, albedo, ciede2000 : float

    Examples
    --------
    >>> from dsbrdf.comparison import Merit
    >>> Merit(rel=0.1, cbrt=0.03, log=0.1, albedo=0.02, ciede2000=0.5).summary()["cbrt"]
    0.03
    """

    rel: float
    cbrt: float
    log: float
    albedo: float
    ciede2000: float

    def summary(self) -> dict[str, float]:
        """All by name."""
        return asdict(self)


def pairs(n: int = N_PAIRS) -> tuple[Array, Array]:
    """Pairs of directions (n, 3), uniform in solid angle within 80 degrees of the normal; always the same."""
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(LEAST_COSINE, 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    wi, wo = directions.polar(np.sqrt(1.0 - z * z), z, phi)
    return wi, wo


class _BothOrders:
    """The measurement of an RGL file, the mean of both orders of the two directions."""

    def __init__(self, reflectance: Reflectance) -> None:
        self._reflectance = reflectance

    def eval(self, wi: Array, wo: Array) -> Array:
        first, second = self._reflectance.eval(wi, wo), self._reflectance.eval(wo, wi)
        mean: Array = 0.5 * (np.asarray(first) + np.asarray(second))
        return mean


def truth_of(measured: MeasuredBRDF) -> Reflectance:
    """What a table is a table of: the measurement in an RGL file, or else the table itself."""
    file = measured.source.file
    if file is None or file.suffix.lower() != ".bsdf":
        return measured
    with file.open("rb") as opened:
        if opened.read(len(TENSOR_FILE)) != TENSOR_FILE:
            return measured
    return _BothOrders(read_rgl(file).linear_srgb())


class Judge:
    """Judges reflectances by one measurement.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples

    Raises
    ------
    ValueError
        If the measurement has no valid value.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf.comparison import Judge
    >>> judge = Judge(dsbrdf.material("matte"))
    >>> judge.merit(dsbrdf.material("rough-gold")).ciede2000 > 10.0  # looks quite different
    True
    """

    def __init__(self, measured: MeasuredBRDF | Samples) -> None:
        self.is_table = isinstance(measured, MeasuredBRDF)
        if isinstance(measured, Samples):
            self._wi, self._wo, f = measured.wi, measured.wo, measured.values
        else:
            self.truth = truth_of(measured)
            self._wi, self._wo = pairs()
            f = np.asarray(self.truth.eval(self._wi, self._wo))
        # Comparisons with NaN are false
        good = (f > LEAST).all(-1) & (f < np.inf).all(-1)
        if not good.any():
            raise ValueError(
                f"{measured.name or 'the measurement'}: nothing to compare with: no value above zero is valid."
            )
        self._wi, self._wo, self._f = self._wi[good], self._wo[good], f[good]
        self._root = np.cbrt(self._wi[:, 2] * self._wo[:, 2])[:, None]
        if isinstance(measured, MeasuredBRDF):
            self._albedos = _albedos(self.truth)
            self._weights = _colour(measured.channels, f.shape[-1])
            self.sphere = self.look(self.truth)

    def merit(self, reflectance: Reflectance) -> Merit:
        """Figures of merit of anything with `eval`."""
        f, found = self._f, np.asarray(reflectance.eval(self._wi, self._wo), dtype=np.float64)
        rel = np.sqrt(((found - f) ** 2).sum() / (f**2).sum())
        off, of = (self._root * x for x in (np.cbrt(found) - np.cbrt(f), np.cbrt(f)))
        cbrt = np.sqrt((off**2).sum() / (of**2).sum())
        ratio = (np.maximum(found, 0.0) + OFFSET) / (f + OFFSET)
        log = np.sqrt((np.log(ratio) ** 2).mean())
        albedo = ciede2000 = float("nan")
        if self.is_table:
            albedo = float(np.abs(_albedos(reflectance) / np.maximum(self._albedos, 1e-300) - 1.0).max())
            ciede2000 = sphere.difference(self.look(reflectance), self.sphere)
        return Merit(float(rel), float(cbrt), float(log), albedo, ciede2000)

    def look(self, reflectance: Reflectance, size: tuple[int, int] = sphere.SIZE) -> Array:
        """The sphere (radius, azimuth, rgb) of a reflectance of the channels of the measurement."""
        return np.asarray(np.maximum(sphere.radiance(reflectance, size) @ self._weights.T, 0.0))


def _albedos(reflectance: Reflectance) -> Array:
    """Albedos (angle,), of the mean over channels, of light reflected to within 80 degrees."""
    found = []
    for theta in ALBEDO_ANGLES:
        wi, wo, weight = directions.albedo_nodes(float(theta), ALBEDO_N_PHI)
        seen = wo[:, 2] > LEAST_COSINE
        found.append(float((weight[seen] @ np.asarray(reflectance.eval(wi, wo[seen]))).mean()))
    return np.array(found)


def _colour(channels: Any, n: int) -> Array:
    """Weights (3, channel) of colours; those of channels that tell none are grey."""
    try:
        return rgb_weights(channels or (("r", "g", "b") if n == 3 else ("value",) * n))
    except ValueError:
        return np.full((3, n), 1.0 / n)
