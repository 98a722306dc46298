r"""Reader and writer of RGL tensor files: named arrays in one little-endian file.

The container of the RGL material database (Dupuy and Jakob, ACM Trans. Graph. 37(6), 2018), which Mitsuba 3
and pbrt read too. `read_tensor_file` gives the arrays; what they mean is the business of
`dsbrdf.measured.formats.rgl`.

Notes
-----
Layout, with no padding between the parts of the header:

    "tensor_file\0"  u8 1, u8 0 (version 1.0)  u32 number of fields
    per field: u16 length of the name, name (UTF-8), u16 ndim, u8 type, u64 offset, u64 shape[ndim]

An offset counts from the start of the file, and the array there is in C order. The reader holds every number
of the header against the size of the file before it allocates, so a damaged file costs no more memory than it
has bytes.
"""

from __future__ import annotations

import math
import os
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _files

__all__ = ["Fields", "read_tensor_file", "write_tensor_file"]

MAGIC = b"tensor_file\0"
VERSION = (1, 0)
_TYPES = ("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
DTYPES = {code: np.dtype(name) for code, name in enumerate(_TYPES, start=1)}

_ALIGNMENT = 8
_MAX_NDIM = 32
# A field with an empty name and no axis.
_MIN_FIELD_BYTES = 13
_LARGEST = float(np.finfo(np.float32).max)
_GET_ANOTHER = "download the file again, or give another."


class _Field(NamedTuple):
    """Where one array lies in the file."""

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    offset: int
    end: int


class Fields(Mapping[str, NDArray[Any]]):
    """Named arrays, with a check of what a reader needs of each.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        As in the file.
    name : str
        The file, as errors call it.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]], name: str = "fields") -> None:
        self.name = name
        self._arrays = dict(arrays)

    def __getitem__(self, key: str) -> NDArray[Any]:
        return self._arrays[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def refuse(self, expected: str, got: str) -> NoReturn:
        """Raise ValueError: the arrays are not those of a measured BRDF."""
        raise ValueError(
            f"{self.name}: not an RGL measured BRDF: expected {expected}, got {got}; {_GET_ANOTHER}"
        )

    def numbers(self, key: str, shape: tuple[int | None, ...], low: float = -_LARGEST) -> NDArray[np.float64]:
        """Array `key` as float64, known to have this shape (None: any length but 0) and no entry below `low`.

        Raises
        ------
        ValueError
            If there is no such array, or it is not so; also if an entry is not finite in single precision.
        """
        if key not in self:
            self.refuse(f"a field {key!r}", f"the fields {', '.join(map(repr, self)) or '(none)'}")
        array = self[key]
        fits = array.ndim == len(shape) and array.size > 0
        if not (fits and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))):
            axes = ", ".join("any" if n is None else str(n) for n in shape)
            self.refuse(f"field {key!r} of shape ({axes})", f"shape {array.shape}")
        array = array.astype(np.float64)
        bad = ~((array >= low) & (array <= _LARGEST))
        if bad.any():
            at = tuple(int(k) for k in np.argwhere(bad)[0])
            limit = "" if low == -_LARGEST else f" >= {low:g}"
            self.refuse(f"finite numbers{limit} in field {key!r}", f"{array[at]:g} at index {at}")
        return array


def read_tensor_file(path: str | os.PathLike[str]) -> Fields:
    """Arrays of an RGL tensor file.

    Parameters
    ----------
    path : path-like
        The file, for example ``chm_orange_rgb.bsdf``.

    Returns
    -------
    Fields
        A mapping of names to arrays, in the order of the file and with its types.

    Raises
    ------
    ValueError
        If the file is not an RGL tensor file of version 1.0, or damaged; says what was expected, and where.
    """
    path = Path(path)
    size = _files.regular_size(path)
    with path.open("rb") as file:
        arrays = {}
        for field in _Header(file, path.name, size).read():
            file.seek(field.offset)
            flat = np.fromfile(file, dtype=field.dtype, count=math.prod(field.shape))
            arrays[field.name] = flat.reshape(field.shape)
    return Fields(arrays, path.name)


def write_tensor_file(path: str | os.PathLike[str], fields: Mapping[str, ArrayLike]) -> None:
    """Write arrays to an RGL tensor file.

    Parameters
    ----------
    path : path-like
        The file, replaced if it exists.
    fields : mapping of str to array_like
        Integers or floating-point numbers, written in this order and with their own types.

    Raises
    ------
    ValueError
        If a name or an array does not fit the format.
    """
    codes = {dtype: code for code, dtype in DTYPES.items()}
    arrays: dict[bytes, NDArray[Any]] = {}
    for name, value in fields.items():
        array = np.asarray(value)
        array = np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")
        if array.dtype not in codes:
            raise ValueError(
                f"field {name!r} must hold integers of 8 to 64 bits or floats of 16 to 64 bits, "
                f"got {array.dtype}. Convert it with .astype."
            )
        encoded = name.encode()
        if len(encoded) > 0xFFFF or array.ndim > _MAX_NDIM:
            raise ValueError(
                f"field {name[:40]!r} must have a name of at most 65535 bytes and at most {_MAX_NDIM} axes, "
                f"got {len(encoded)} bytes and {array.ndim} axes. Shorten the name or reshape the array."
            )
        arrays[encoded] = array

    header = [MAGIC, struct.pack("<BBI", *VERSION, len(arrays))]
    header_bytes = sum(_MIN_FIELD_BYTES + len(name) + 8 * array.ndim for name, array in arrays.items())
    position = sum(map(len, header)) + header_bytes
    body = []
    for encoded, array in arrays.items():
        padding = -position % _ALIGNMENT
        layout = f"<H{len(encoded)}sHBQ{array.ndim}Q"
        place = array.ndim, codes[array.dtype], position + padding
        header.append(struct.pack(layout, len(encoded), encoded, *place, *array.shape))
        body += [bytes(padding), array.tobytes()]
        position += padding + array.nbytes
    with _files.aside(path) as part:
        part.write_bytes(b"".join(header + body))


class _Header:
    """Reads the header of an open file; no read goes past the end."""

    def __init__(self, file: BinaryIO, name: str, size: int) -> None:
        self.file, self.name, self.size = file, name, size

    def refuse(self, expected: str, got: str, remedy: str = _GET_ANOTHER) -> NoReturn:
        raise ValueError(f"{self.name}: not an RGL tensor file: expected {expected}, got {got}; {remedy}")

    def take(self, count: int, what: str) -> bytes:
        """The next `count` bytes."""
        start = self.file.tell()
        if start + count > self.size:
            self.refuse(f"{what} at bytes {start:,} to {start + count:,}", f"a file of {self.size:,} bytes")
        return self.file.read(count)

    def unpack(self, layout: str, what: str) -> tuple[int, ...]:
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout), what))

    def read(self) -> list[_Field]:
        """All fields, checked one by one and against one another."""
        magic = self.take(min(len(MAGIC), self.size), "the first bytes")
        if magic != MAGIC:
            remedy = "give a .bsdf file of the RGL material database."
            self.refuse(f"the first bytes {MAGIC!r}", repr(magic), remedy)
        version = self.unpack("BB", "the version")
        if version != VERSION:
            remedy = "convert the file to version 1.0."
            self.refuse("version 1.0", "version {}.{}".format(*version), remedy)
        (count,) = self.unpack("I", "the number of fields")
        room = (self.size - self.file.tell()) // _MIN_FIELD_BYTES
        if count > room:
            self.refuse(f"at most {room:,} fields in {self.size:,} bytes", f"{count:,} fields")

        fields = [self.read_field(index) for index in range(count)]
        names = Counter(field.name for field in fields)
        for name, times in names.items():
            if times > 1:
                self.refuse("fields of different names", f"{name!r} {times} times")
        self.check_places(fields)
        return fields

    def read_field(self, index: int) -> _Field:
        """One field, whose array is known to lie in the file."""
        (length,) = self.unpack("H", f"the length of the name of field {index}")
        raw = self.take(length, f"the name of field {index}")
        try:
            name = raw.decode()
        except UnicodeDecodeError:
            self.refuse(f"the name of field {index} in UTF-8", repr(raw[:40]))
        ndim, code, offset = self.unpack("HBQ", f"the type of field {name!r}")
        if code not in DTYPES:
            self.refuse(f"a type of 1 to {max(DTYPES)} for field {name!r}", f"type {code}")
        if ndim > _MAX_NDIM:
            self.refuse(f"at most {_MAX_NDIM} axes of field {name!r}", f"{ndim}")
        shape = self.unpack(f"{ndim}Q", f"the shape of field {name!r}")

        # An axis of length 0 must not hide one that is absurd.
        itemsize = DTYPES[code].itemsize
        extent = itemsize * math.prod(max(length, 1) for length in shape)
        end = offset + (extent if all(shape) else 0)
        if max(extent, end) > self.size:
            need = f"field {name!r} of shape {shape} ({extent:,} bytes at byte {offset:,}) in the file"
            self.refuse(need, f"a file of {self.size:,} bytes")
        return _Field(name, DTYPES[code], shape, offset, end)

    def check_places(self, fields: list[_Field]) -> None:
        """Refuse arrays that overlap one another or the header."""
        last, end = "the header", self.file.tell()
        for field in sorted(fields, key=lambda field: (field.offset, field.end)):
            if field.offset < end:
                need = f"field {field.name!r} at byte {end:,} or later, where {last} ends"
                self.refuse(need, f"byte {field.offset:,}")
            last, end = f"field {field.name!r}", field.end
