"""BSDF data interchange files of Zemax and Radiant (`.bsdf`, text), which LightTools takes too: reflection.

Described by R. Rykowski, *BSDF Data Interchange File Format Specification* (Zemax knowledge base, 2008): lists of
sample
rotations, angles of incidence, and azimuths and radial angles about the mirror direction, in degrees, then for each
angle of
incidence the total scatter and a line of values for each azimuth. Azimuth 0 points from the mirror direction to the
normal.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf.measured.formats.grid import about_mirror, from_vectors, mirrored_azimuths
from dsbrdf.measured.formats.tokens import Tokens, first_words
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_zemax", "read_zemax"]

_LISTS = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
_BLOCKS = {"Monochrome": "value", "TristimulusX": "X", "TristimulusY": "Y", "TristimulusZ": "Z"}


def is_zemax(head: bytes) -> bool:
    """Whether a file with this head may be one."""
    words = set(first_words(head))
    return {"ScatterType", "AngleOfIncidence"} <= words or {"Source", "Symmetry", "SpectralContent"} <= words


def read_zemax(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read such a file.

    Raises
    ------
    ValueError
        If it holds transmission, or is damaged.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    tokens = Tokens(path)
    header: dict[str, str] = {}
    lists: dict[str, Any] = {}
    while (word := tokens.word()) not in _BLOCKS:
        if word in _LISTS:
            lists[word] = tokens.numbers(tokens.count())
        else:
            header[word] = tokens.rest()
    if missing := [name for name in _LISTS[1:] if name not in lists]:
        raise tokens.fail(f"expected {', '.join(_LISTS)} before the data, without {', '.join(missing)}.")
    if header.get("ScatterType", "BRDF").upper() != "BRDF":
        raise tokens.fail(f"holds {header['ScatterType']:.20}: transmitted light is not part of the model.")
    rotation, incidence, azimuth, radial = (lists.get(name, np.zeros(1)) for name in _LISTS)
    shape = (len(rotation), len(incidence), len(azimuth), len(radial))
    values: dict[str, Any] = {}
    while word:
        if word not in _BLOCKS:
            raise tokens.fail(f"expected {', '.join(_BLOCKS)}, got {word:.40}.")
        values[_BLOCKS[word]] = _block(tokens, shape)
        word = tokens.word() if tokens.peek() else ""
    if header.get("Symmetry", "").lower().startswith("plane"):
        planes = {name: mirrored_azimuths(azimuth, plane, 2) for name, plane in values.items()}
        azimuth, values = next(iter(planes.values()))[0], {name: plane for name, (_, plane) in planes.items()}
    r, i, a, s = (np.deg2rad(x) for x in np.meshgrid(rotation, incidence, azimuth, radial, indexing="ij"))
    columns = from_vectors(*about_mirror(i, r, s, a))
    columns |= {name: plane.ravel() for name, plane in values.items()}
    return samples_from_columns(
        columns,
        path.stem,
        Source(path),
        options,
        remarks=("Zemax / Radiant BSDF, about the mirror direction",),
    )


def _block(tokens: Tokens, shape: tuple[int, int, int, int]) -> Any:
    """Values (rotation, incidence, azimuth, radial) of a block."""
    if tokens.word() != "DataBegin":
        raise tokens.fail("expected DataBegin.")
    planes = []
    for _ in range(shape[0] * shape[1]):
        if tokens.word() != "TIS":
            raise tokens.fail(
                "expected TIS and the total scatter before the values of an angle of incidence."
            )
        tokens.number()
        planes.append(tokens.numbers(shape[2] * shape[3]))
    if tokens.word() != "DataEnd":
        raise tokens.fail("expected DataEnd.")
    return np.stack(planes).reshape(shape)
