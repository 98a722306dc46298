"""The numbers of materials for the page: packed in few bytes, with the loss stated."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import colour
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import SHARED

__all__ = ["Packed", "pack", "rgb_channels"]

#: Measured means are kept as logarithms in so many steps over so many decades; ROUNDING is the error relative to them.
DECADES, STEPS = 6, 2**14
ROUNDING = 0.5 * DECADES * np.log(10.0) / STEPS
#: Amplitudes over phi_d are kept as so many steps of the mean, so many means at most; at grazing angles they exceed it.
RATIO_STEPS, MAX_RATIO = 127, 8.0
#: Every theta_h of the measurement, or every second, ... or none, whichever comes first within the budget.
THINNING = (1, 2, 3, 0)
#: Wavelengths in nm that look red, green and blue, and what names of channels are wavelengths.
RGB_NM = (610.0, 550.0, 460.0)
VISIBLE = (380.0, 780.0)


@dataclass(frozen=True)
class Packed:
    """Arrays of many materials as text, and what tells them apart.

    Parameters
    ----------
    materials : list of dict
        One entry a material for the page's JSON: its name, channels, sizes of curves, errors and origin.
    floats, words : str
        Base64 of deflated float32 and uint16, bytes sorted by significance.
    thinning : int
        Which theta_h of the measurement are there: each, every second, ...; 0 is none.
    """

    materials: list[dict[str, Any]]
    floats: str
    words: str
    thinning: int

    @property
    def size(self) -> int:
        """About the characters that all this takes."""
        return len(self.floats) + len(self.words) + len(json.dumps(self.materials, separators=(",", ":")))


def pack(models: Sequence[DSBRDF], budget: int) -> Packed:
    """Pack models, and as much of what was measured as fits in `budget` characters."""
    for thinning in THINNING:
        floats: list[NDArray[np.float32]] = []
        words: list[NDArray[np.uint16]] = []
        entries = [_pack_material(model, thinning, floats, words) for model in models]
        packed = Packed(entries, _deflate(floats, np.float32), _deflate(words, np.uint16), thinning)
        if packed.size <= budget:
            break
    return packed


def _deflate(arrays: Sequence[NDArray[Any]], dtype: type) -> str:
    numbers = np.concatenate([np.empty(0, dtype), *arrays])
    planes = numbers.astype(numbers.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, numbers.itemsize).T
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode("ascii")


def _pack_material(
    model: DSBRDF, thinning: int, floats: list[NDArray[np.float32]], words: list[NDArray[np.uint16]]
) -> dict[str, Any]:
    lobes = model.lobes.numpy
    floats += [_single(part) for part in lobes.parts]
    entry: dict[str, Any] = {
        "name": model.name,
        "channels": list(model.channels),
        "rgb": rgb_channels(model.channels),
        "lobes": model.n_lobes,
        "sizes": {name: getattr(lobes, name).shape[-1] for name in (*SHARED, "colour")},
        "errors": {key: value for key, value in model.errors.items() if np.isfinite(value)},
        "source": model.source.to_json(),
        "fit": dict(model.fit_options),
    }
    if thinning and model.profile is not None:
        entry["profile"] = _pack_profile(model.profile, thinning, floats, words)
    return entry


def rgb_channels(names: Sequence[str]) -> list[int]:
    """Which channels are shown as red, green and blue.

    Those three, where there are three; of wavelengths in nm those nearest to what looks so; else the last, the middle
    and the first one.
    """
    n = len(names)
    if n == len(RGB_NM):
        return list(range(n))
    wavelengths = np.array([colour.wavelength(name) or np.nan for name in names])
    # NaN, of a name that is no wavelength, is in no range
    if n > 1 and VISIBLE[0] < wavelengths.mean() < VISIBLE[1]:
        return [int(np.abs(wavelengths - nm).argmin()) for nm in RGB_NM]
    return [n - 1, (n - 1) // 2, 0]


def _single(values: Any) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32).ravel()


def _pack_profile(
    profile: MeasuredProfile, step: int, floats: list[NDArray[np.float32]], words: list[NDArray[np.uint16]]
) -> dict[str, Any]:
    theta_h, mean, amplitude = (a[..., ::step] for a in (profile.theta_h, profile.mean, profile.amplitude))
    theta_h = theta_h[:1] if (theta_h == theta_h[0]).all() else theta_h
    positive = mean > 0.0
    top = float(mean[positive].max()) if positive.any() else 1.0
    safe = np.where(positive, mean, top)
    share = 1.0 + np.log10(safe / top) / DECADES
    levels = np.where(positive, 1 + np.clip(np.rint(share * (STEPS - 1)), 0, STEPS - 1), 0)
    ratios = np.rint(RATIO_STEPS * np.clip(np.nan_to_num(amplitude / safe), -MAX_RATIO, MAX_RATIO))
    floats += [_single(profile.theta_d), _single(theta_h), _single([top])]
    words += [_differences(levels), _differences(ratios)]
    return {"shape": [len(profile.theta_d), theta_h.shape[1], len(theta_h)]}


def _differences(values: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Differences along the last axis modulo 2^16; those of smooth curves deflate well."""
    return np.diff(values.astype(np.int64), axis=-1, prepend=0).astype(np.uint16).ravel()
