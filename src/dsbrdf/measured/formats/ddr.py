"""Diffuse distributions of Integra (`.ddr`, text): reflection about the mirror direction.

As libbsdf reads them (R. Kimura, `DdrReader`): lists of incident azimuths `psi` and angles `sigma`, of azimuths
`phi` and
angles `theta` about the mirror direction, in degrees; then for each colour a factor `kbdf` for each incident
direction and the
values, pi times the BRDF over that factor. Comments begin with a semicolon.
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

__all__ = ["is_ddr", "read_ddr"]

_COLOURS = {"bw": "value", "red": "r", "gre": "g", "green": "g", "blu": "b", "blue": "b"}
_LISTS = ("psi", "sigma", "phi", "theta")


def is_ddr(head: bytes) -> bool:
    """Whether a file with this head may be one."""
    words = set(first_words(head, ";"))
    return {"TypeSym", "TypeData"} <= words or {"TypeSym", "sigma"} <= words


def read_ddr(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read such a file.

    Raises
    ------
    ValueError
        If its values are relative and no scale is given, or it is damaged.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    tokens = Tokens(path, ";")
    header: dict[str, str] = {}
    lists: dict[str, Any] = {"psi": np.zeros(1)}
    mirror = None
    while (word := tokens.peek()) not in (*_COLOURS, "wl"):
        tokens.word()
        if word in _LISTS:
            lists[word] = tokens.numbers(tokens.count())
        elif word == "sigmaT":
            mirror = tokens.numbers(len(lists.get("sigma", ())))
        else:
            header[word] = tokens.rest()
    if missing := [name for name in _LISTS if name not in lists]:
        raise tokens.fail(
            f"expected the lists {', '.join(_LISTS)} before the values, without {', '.join(missing)}."
        )
    is_relative = "relative" in header.get("TypeData", "").lower()
    if is_relative and (options is None or options.scale is None):
        raise tokens.fail(
            "its values are relative: say by which factor they become 1/sr, scale=... (--scale ...)."
        )
    psi, sigma, phi, theta = (lists[name] for name in _LISTS)
    shape = (len(psi), len(sigma), len(phi), len(theta))
    values: dict[str, Any] = {}
    while tokens.peek():
        word = tokens.word()
        name = f"{tokens.number():.10g} nm" if word == "wl" else _COLOURS.get(word, "")
        if not name:
            raise tokens.fail(f"expected the name of a colour, got {word:.40}.")
        values[name] = _block(tokens, shape, is_relative) / np.pi
    if header.get("TypeSym", "PlaneSymmetrical").lower().startswith("plane"):
        both = {name: mirrored_azimuths(phi, plane, 2) for name, plane in values.items()}
        phi, values = next(iter(both.values()))[0], {name: plane for name, (_, plane) in both.items()}
    p, s, a, r = (np.deg2rad(x) for x in np.meshgrid(psi, sigma, phi, theta, indexing="ij"))
    at = None if mirror is None else np.deg2rad(mirror)[:, None, None] + np.zeros_like(s)
    wi, wo = about_mirror(s, p, r, a, at)
    if "intensity" in header.get("TypeData", "").lower():
        with np.errstate(divide="ignore", invalid="ignore"):
            values = {
                name: np.where(wo[..., 2] > 1e-6, np.pi * v / wo[..., 2], np.nan)
                for name, v in values.items()
            }
    columns = from_vectors(wi, wo) | {name: plane.ravel() for name, plane in values.items()}
    return samples_from_columns(
        columns, path.stem, Source(path), options, remarks=("Integra DDR, about the mirror direction",)
    )


def _block(tokens: Tokens, shape: tuple[int, int, int, int], is_relative: bool) -> Any:
    """Values (psi, sigma, phi, theta) of a colour."""
    factor = np.ones(shape[:2])
    if tokens.peek() == "kbdf":
        tokens.word()
        factor = tokens.numbers(shape[0] * shape[1]).reshape(shape[:2])
    if tokens.peek() == "def":
        tokens.word()
    values = tokens.numbers(int(np.prod(shape))).reshape(shape)
    return values if is_relative else values * factor[:, :, None, None]
