"""MATLAB files of version 5 to 7.2: arrays of numbers by name, as in a .npz file; later ones are HDF5.

Read after MathWorks, *MAT-File Format*: a header of 128 bytes, then data elements, each a tag of type and size; one of
a matrix holds its flags, dimensions, name and numbers. Structures, cells, text and complex numbers are left out. (The
reader of SciPy can crash on damaged files.)
"""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.formats.array_file import read_arrays
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["read_matlab", "read_matlab_arrays"]

MAX_BYTES = 500_000_000
_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
#: Types of numbers as they are stored; those of matrices by class, from double on.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = range(6, 16)


def read_matlab(
    path: str | Path, options: ReadOptions | None = None, *, convention: str = "centre"
) -> MeasuredBRDF | Samples:
    """Read arrays named as in a .npz file.

    Raises
    ------
    ValueError
        If the file is damaged, or its arrays are those of no reflectance.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    arrays = read_matlab_arrays(path)
    if not arrays:
        raise ValueError(
            f"{path}: a MATLAB file without arrays of numbers. Save the columns as theta_i_deg and so on, or as CSV."
        )
    return read_arrays(arrays, path, options or ReadOptions(), convention=convention)


def read_matlab_arrays(path: Path) -> dict[str, Any]:
    """All arrays of numbers of a file; vectors have one axis.

    Raises
    ------
    ValueError
        If the file is damaged, or would take far more memory than it has bytes.
    OSError
        If it cannot be read.
    """
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: more than {MAX_BYTES:,} bytes. Save it with -v7.3.")
    content = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise ValueError(f"{path}: not a sound MATLAB file: no mark of its byte order. Save it again.")
    arrays: dict[str, Any] = {}
    n_bytes, n_numbers = 0, 0
    try:
        for kind, data in _elements(content[_HEADER:], order):
            if kind == _COMPRESSED:
                room = len(content) + _files.ROOM - n_bytes
                plain = zlib.decompressobj().decompress(data, room + 1)
                n_bytes += len(plain)
                _files.check_unpacked(len(content), n_bytes, n_numbers)
                kind, data = next(_elements(plain, order), (0, b""))
            if kind == _MATRIX and (found := _matrix(data, order)) is not None:
                name, array = found
                n_numbers += array.size
                _files.check_unpacked(len(content), n_bytes, n_numbers)
                arrays[name] = array.ravel() if array.ndim == 2 and 1 in array.shape else array
    except (zlib.error, ValueError, TypeError, OverflowError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{path}: not a sound MATLAB file: {str(error).rstrip('.'):.100}. Save it again."
        ) from None
    return arrays


def _elements(data: bytes, order: str) -> Any:
    """Types and contents of the elements one after the other."""
    at = 0
    while at + 8 <= len(data):
        first, size = (int(x) for x in np.frombuffer(data, f"{order}u4", 2, at))
        if first >> 16:
            # Four bytes or less stand within the tag
            kind, size, start, end = first & 0xFFFF, first >> 16, at + 4, at + 8
        else:
            kind, start = first, at + 8
            end = start + size + (-size % 8 if kind != _COMPRESSED else 0)
        if size > len(data) - start or (start == at + 4 and size > 4):
            raise ValueError("an element ends beyond the file")
        yield kind, data[start : start + size]
        at = end


def _matrix(data: bytes, order: str) -> tuple[str, Any] | None:
    """Name and numbers of a matrix, None if it holds none."""
    parts = list(_elements(data, order))
    if len(parts) < 4 or len(parts[0][1]) < 8:
        return None
    flags = int(np.frombuffer(parts[0][1], f"{order}u4", 1)[0])
    shape = tuple(int(n) for n in np.frombuffer(parts[1][1], f"{order}i4"))
    kind, numbers = parts[3]
    if flags & 0xFF not in _CLASSES or flags & 0x800 or kind not in _TYPES:
        return None
    array = np.frombuffer(numbers, f"{order}{_TYPES[kind]}")
    if any(n < 0 for n in shape) or not 1 <= len(shape) <= 32 or array.size != math.prod(shape):
        raise ValueError(f"a matrix of shape {shape} holds {array.size} numbers")
    return parts[2][1].decode("ascii"), array.reshape(shape, order="F").astype(float)
