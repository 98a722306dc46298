"""Measured BRDFs of Cornell University as pbrt-v2 has them: wavelengths, then lines of four angles and a spectrum.

The form is that of the reader in pbrt-v2 (`src/materials/measured.cpp`, M. Pharr and G. Humphreys): a count of
wavelengths,
these in nm, then `theta_i phi_i theta_o phi_o` in radians and a value for each wavelength. Comments begin with #.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dsbrdf.measured.formats.tokens import Tokens
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_pbrt", "read_pbrt"]

#: Bytes that are looked at, at most.
HEAD = 4096
#: Wavelengths in nm.
_RANGE = (200.0, 3000.0)
_ANGLES = ("theta_i_rad", "phi_i_rad", "theta_o_rad", "phi_o_rad")


def is_pbrt(head: bytes) -> bool:
    """Whether a file with this head may be one: nothing but numbers, a count first and so many wavelengths then."""
    lines = head.splitlines()
    # The last line of a longer file is cut
    lines = lines[:-1] if len(head) >= HEAD else lines
    words = [found for line in lines if (found := line.split(b"#")[0].split())]
    if len(words) < 3 or len(words[0]) != 1 or not words[0][0].isdigit() or len(words[0][0]) > 5:
        return False
    try:
        numbers = [float(word) for line in words for word in line]
    except ValueError:
        return False
    n = int(numbers[0])
    waves = np.array(numbers[1 : n + 1])
    return bool(
        n
        and len(waves)
        and (waves >= _RANGE[0]).all()
        and (waves <= _RANGE[1]).all()
        and (np.diff(waves) > 0).all()
    )


def read_pbrt(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read such a file.

    Raises
    ------
    ValueError
        If it is none, or ends within a line.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    tokens = Tokens(path)
    n = tokens.count(10_000)
    waves = tokens.numbers(n)
    rows = []
    while tokens.peek():
        rows.append(tokens.numbers(len(_ANGLES) + n))
    if not rows:
        raise tokens.fail("expected lines of four angles and a spectrum, got none.")
    table = np.stack(rows).T
    names = [*_ANGLES, *(f"{wave:.10g} nm" for wave in waves)]
    columns = dict(zip(names, table, strict=True))
    return samples_from_columns(
        columns, path.stem, Source(path), options, remarks=("pbrt-v2 measured BRDF, radians",)
    )
