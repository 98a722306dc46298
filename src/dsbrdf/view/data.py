"""The numbers of materials for the page: packed in few bytes, with the loss stated."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.geometry import colour
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import SHARED

__all__ = ["Packed", "pack", "rgb_weights"]

#: Measured means are kept as logarithms in so many steps over so many decades; ROUNDING is the error relative to them.
DECADES, STEPS = 6, 2**14
ROUNDING = 0.5 * DECADES * np.log(10.0) / STEPS
#: Amplitudes over phi_d are kept as so many steps of the mean, so many means at most; at grazing angles they exceed it.
RATIO_STEPS, MAX_RATIO = 127, 8.0
#: Every theta_h of the measurement, or every second, ... or none, whichever comes first within the budget.
THINNING = (1, 2, 3, 0)
#: Digits of errors and of weights of colours.
DIGITS = 8


@dataclass(frozen=True)
class Packed:
    """Arrays of many materials as text, and what tells them apart.

    Parameters
    ----------
    materials : str
        Base64 of deflated JSON: "kinds", what many materials have in common (channels, sizes of curves, options of the
        fit), and "materials", an entry each: name, kind, errors, origin.
    floats, words : str
        Base64 of deflated float32 and uint16, bytes sorted by significance.
    thinning : int or None
        Which theta_h of the measurement are there: each, every second, ...; 0 is none, None that there were none.
    """

    materials: str
    floats: str
    words: str
    thinning: int | None

    @property
    def size(self) -> int:
        """Characters that all this takes."""
        return len(self.materials) + len(self.floats) + len(self.words)


def pack(models: Sequence[DSBRDF], budget: int, places: NDArray[np.float64] | None = None) -> Packed:
    """Pack models, and as much of what was measured as fits in `budget` characters.

    Rows of `places` (material, number) are put in front of the models' own numbers.
    """
    is_measured = any(model.profile is not None for model in models)
    for thinning in THINNING if is_measured else (None,):
        floats = [] if places is None else [_single(places)]
        words: list[NDArray[np.uint16]] = []
        kinds: dict[str, int] = {}
        entries = [_pack_material(model, thinning, kinds, floats, words) for model in models]
        text = f'{{"kinds":[{",".join(kinds)}],"materials":{_json(entries)}}}'
        packed = Packed(
            _deflate(text.encode()),
            _deflate_sorted(floats, np.float32),
            _deflate_sorted(words, np.uint16),
            thinning,
        )
        if packed.size <= budget:
            break
    return packed


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def _deflate(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")


def _deflate_sorted(arrays: Sequence[NDArray[Any]], dtype: type) -> str:
    numbers = np.concatenate([np.empty(0, dtype), *arrays])
    planes = numbers.astype(numbers.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, numbers.itemsize).T
    return _deflate(planes.tobytes())


def _pack_material(
    model: DSBRDF,
    thinning: int | None,
    kinds: dict[str, int],
    floats: list[NDArray[np.float32]],
    words: list[NDArray[np.uint16]],
) -> dict[str, Any]:
    lobes = model.lobes.numpy
    floats += [_single(part) for part in lobes.parts]
    kind = {
        "channels": list(model.channels),
        "lobes": model.n_lobes,
        "sizes": {name: getattr(lobes, name).shape[-1] for name in (*SHARED, "colour")},
        "fit": dict(model.fit_options),
        **_colours(model.channels),
    }
    entry: dict[str, Any] = {"name": model.name, "kind": kinds.setdefault(_json(kind), len(kinds))}
    if errors := {key: _rounded(value) for key, value in model.errors.items() if np.isfinite(value)}:
        entry["errors"] = errors
    entry["source"] = model.source.to_json()
    if thinning and model.profile is not None:
        entry["profile"] = _pack_profile(model.profile, thinning, floats, words)
    return entry


def rgb_weights(names: Sequence[str]) -> tuple[NDArray[np.float64], bool]:
    """Weights (3, channel) of red, green and blue, and whether these are the channels' own colours.

    Where their names tell no colour, three channels stand for red, green and blue; of others the last, the middle and
    the first one.
    """
    try:
        return colour.rgb_weights(names), True
    except ValueError:
        n = len(names)
        return np.eye(n)[range(3) if n == 3 else [n - 1, (n - 1) // 2, 0]], False


@lru_cache(maxsize=64)
def _colours(names: tuple[str, ...]) -> dict[str, Any]:
    weights, is_true = rgb_weights(names)
    return {"rgb": [[_rounded(value) for value in row] for row in weights], "falseColours": not is_true}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


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
