"""Arrays on disk (.npy, .npz): tables, theta_h x theta_d images and scattered samples; nothing is unpickled.

A .npz file of ours holds a table as `values` (theta_h, theta_d, phi_d, channel) in 1/sr, NaN where invalid, with
the angles `theta_h`, `theta_d` and `phi_d` in radians, or samples as `wi`, `wo` (n, 3), `values` (n, channel) and
`weights` (n,). Both may have a `name` and names of `channels`, a table a `convention`.
"""

from __future__ import annotations

import dataclasses
import math
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.geometry.grids import CONVENTIONS, cell_angles
from dsbrdf.measured.names import meaning
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF

__all__ = [
    "MEAN_PHI_D",
    "bivariate",
    "read_arrays",
    "read_npy",
    "read_npy_array",
    "read_npz",
    "read_npz_arrays",
    "write_npz",
]

MAGIC = b"\x93NUMPY"
#: As NumPy and others write it: no objects, no records.
_HEADER = re.compile(
    rb"\{\s*'descr':\s*'([<>|=]?[biufU]\d{1,8})',\s*'fortran_order':\s*(True|False),\s*"
    rb"'shape':\s*\(([\d, ]{0,200})\),?\s*\}\s*"
)
#: Where cos(2 phi_d) is zero: the one phi_d of a table that knows none.
MEAN_PHI_D = np.pi / 4


def read_npy(path: str | Path, *, convention: str = "centre") -> MeasuredBRDF:
    """Read a table (theta_h, theta_d), (theta_h, theta_d, channel) or (theta_h, theta_d, phi_d, channel) from .npy.

    Its cells are those of `dsbrdf.geometry.grids.cell_angles`. Values are in 1/sr; see `bivariate`.

    Raises
    ------
    ValueError
        If it is no such array.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    values = read_npy_array(path)
    if values.ndim == 4 and values.size and values.dtype.kind != "U":
        return _table({"values": values}, path, convention)
    return bivariate(values, path.stem, convention=convention, source=Source(path))


def read_npy_array(path: Path) -> NDArray[Any]:
    """The array of a .npy file."""
    size = _files.regular_size(path)
    with path.open("rb") as file:
        return _array(file, size, str(path))


def bivariate(
    values: NDArray[Any],
    name: str,
    *,
    theta_h: NDArray[np.float64] | None = None,
    theta_d: NDArray[np.float64] | None = None,
    convention: str = "centre",
    source: Source | None = None,
) -> MeasuredBRDF:
    """Table of values over theta_h and theta_d alone.

    Parameters
    ----------
    values : (theta_h, theta_d) or (theta_h, theta_d, channel) ndarray
        In 1/sr; negative, NaN or infinite where invalid.
    name : str
    theta_h, theta_d : ndarray, radians, optional
        Of the entries; those of the cells by default, as in a MERL table: `theta_h` grows with the square of the index.
    convention : {"centre", "edge"}, optional
    source : Source, optional

    Returns
    -------
    MeasuredBRDF
        With one phi_d, where the azimuthal term of a model vanishes.

    Raises
    ------
    ValueError
        If `values` is not such an array.
    """
    source = source or Source()
    label = str(source.file or name)
    if values.ndim not in (2, 3) or values.size == 0 or values.dtype.kind not in "biuf":
        raise ValueError(
            f"{label}: expected numbers (theta_h, theta_d) or (theta_h, theta_d, channel), got {values.dtype} of "
            f"shape {values.shape}."
        )
    shape = (values.shape[0], values.shape[1], 1)
    cells = cell_angles(convention, shape)
    planes = np.moveaxis(values.reshape(*shape, -1), -1, 0)
    h, d = (
        cell if given is None else _ascending(given, key, np.pi / 2, label)
        for key, given, cell in (("theta_h", theta_h, cells[0]), ("theta_d", theta_d, cells[1]))
    )
    phi_d = np.array([MEAN_PHI_D])
    return MeasuredBRDF(name, planes, np.ones(len(planes)), h, d, phi_d, convention, source)


def read_npz(
    path: str | Path, options: ReadOptions | None = None, *, convention: str = "centre"
) -> MeasuredBRDF | Samples:
    """Read a table, a theta_h x theta_d image or scattered samples from .npz.

    Parameters
    ----------
    path : str or Path
        As `read_arrays` takes its arrays.
    options : ReadOptions, optional
        What the caller says about samples.
    convention : {"centre", "edge"}, optional
        Of a table whose file does not tell.

    Raises
    ------
    ValueError
        If the arrays are not those of a reflectance, or would take far more memory than the file.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    return read_arrays(read_npz_arrays(path), path, options or ReadOptions(), convention=convention)


def read_arrays(
    arrays: dict[str, NDArray[Any]], path: Path, options: ReadOptions, *, convention: str = "centre"
) -> MeasuredBRDF | Samples:
    """A table, a theta_h x theta_d image or scattered samples from arrays with names.

    Parameters
    ----------
    arrays : dict of str to ndarray
        `values` alone or with the angles of a table, or columns of samples as `samples_from_columns` names them, where
        `wi`, `wo` and `values` may be whole arrays.
    path : Path
        Where they come from.
    options : ReadOptions
    convention : {"centre", "edge"}, optional

    Raises
    ------
    ValueError
        If the arrays are not those of a reflectance.
    """
    if "values" in arrays and not _has_directions(arrays):
        return _table(arrays, path, convention)
    name = str(arrays.pop("name", path.stem))
    labels = arrays.pop("channels", np.empty(0, "U1")).ravel().tolist()
    columns: dict[str, Any] = {}
    ignored = {label.strip().lower() for label in options.ignore}
    for key, array in arrays.items():
        whole = key in ("wi", "wo", "values")
        if key.lower() in ignored and not whole:
            columns[key] = None
            continue
        if array.dtype.kind not in "biuf" or not (array.ndim == 1 or (array.ndim == 2 and whole)):
            raise ValueError(
                f"{path}: array {key} must be numbers of shape (n,), got {array.dtype} {array.shape}. Leave it "
                f"out with "
                f"ignore=['{key}'] (--ignore {key})."
            )
        parts = [array] if array.ndim == 1 else list(array.T)
        if key in ("wi", "wo"):
            columns |= {f"{key}_{axis}": part for axis, part in zip("xyz", parts, strict=False)}
        elif key == "values":
            numbered = ["values"] if len(parts) == 1 else _default_names(len(parts))
            names = labels if len(set(labels)) == len(parts) else numbered
            # Channels by the word of the file, whatever they are called
            columns |= {f"value:{label}": part for label, part in zip(names, parts, strict=True)}
        else:
            columns["weight" if key == "weights" else key] = array
    there = {key: column for key, column in columns.items() if column is not None}
    if len({len(column) for column in there.values()}) > 1:
        lengths = ", ".join(f"{key} {len(array)}" for key, array in arrays.items())
        raise ValueError(f"{path}: arrays of samples must be of one length, got {lengths}.")
    kept = [label for label in options.ignore if columns.get(label, ()) is not None]
    return samples_from_columns(there, name, Source(path), dataclasses.replace(options, ignore=kept))


def _default_names(n: int) -> list[str]:
    """Names of channels that have none."""
    return ["r", "g", "b"] if n == 3 else [f"channel {i}" for i in range(n)]


def _has_directions(arrays: Mapping[str, NDArray[Any]]) -> bool:
    """Whether there are directions of scattered samples, not the angles of a table."""
    if "wi" in arrays or "wo" in arrays:
        return True
    kinds = {key: meaning(key) for key in arrays if key not in ("theta_h", "theta_d", "phi_d", "values")}
    return any(found.kind in ("angle", "vector") for found in kinds.values())


def _table(arrays: Mapping[str, NDArray[Any]], path: Path, convention: str) -> MeasuredBRDF:
    values = arrays["values"]
    told = str(arrays.get("convention", convention))
    if told not in CONVENTIONS:
        raise ValueError(f"{path}: the convention must be 'centre' or 'edge', got {told!r:.40}.")
    name, source = str(arrays.get("name", path.stem)), Source(path)
    theta_h, theta_d = (arrays.get(key) for key in ("theta_h", "theta_d"))
    if values.ndim != 4:
        flat = bivariate(values, name, theta_h=theta_h, theta_d=theta_d, convention=told, source=source)
        return dataclasses.replace(flat, channels=_labels(arrays, flat.n_channels, path))
    if values.size == 0 or values.dtype.kind not in "biuf":
        raise ValueError(
            f"{path}: expected numbers (theta_h, theta_d, phi_d, channel), got {values.dtype} {values.shape}."
        )
    cells = cell_angles(told, values.shape[:3])
    limits = {"theta_h": np.pi / 2, "theta_d": np.pi / 2, "phi_d": np.pi}
    h, d, phi = (
        _ascending(arrays[key], key, high, str(path)) if key in arrays else cell
        for (key, high), cell in zip(limits.items(), cells, strict=True)
    )
    planes = np.moveaxis(values, -1, 0)
    labels = _labels(arrays, len(planes), path)
    return MeasuredBRDF(name, planes, np.ones(len(planes)), h, d, phi, told, source, channels=labels)


def _labels(arrays: Mapping[str, NDArray[Any]], n: int, path: Path) -> tuple[str, ...]:
    """Names of the channels of a table, if there are any."""
    if "channels" not in arrays:
        return ()
    labels = tuple(map(str, arrays["channels"].ravel().tolist()))
    if len(set(labels)) != n:
        raise ValueError(f"{path}: expected {n} names of channels, got {labels!s:.100}.")
    return labels


def _ascending(value: NDArray[Any], key: str, high: float, label: str) -> NDArray[np.float64]:
    array = np.asarray(value, float) if value.dtype.kind in "biuf" else np.full(1, np.nan)
    if (
        array.ndim != 1
        or not ((array >= 0.0) & (array <= high + 1e-9)).all()
        or (np.diff(array) <= 0.0).any()
    ):
        raise ValueError(f"{label}: {key} must be ascending angles from 0 to {high:.6g} radians.")
    return array


def write_npz(measured: MeasuredBRDF | Samples, path: str | Path) -> None:
    """Write a table or samples, as `read_npz` reads them.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    arrays: dict[str, Any] = {"name": np.array(measured.name), "values": measured.values}
    if len(measured.channels):
        arrays["channels"] = np.array(list(measured.channels))
    if isinstance(measured, Samples):
        arrays |= {"wi": measured.wi, "wo": measured.wo}
        if measured.weights is not None:
            arrays["weights"] = measured.weights
    else:
        arrays |= {key: getattr(measured, key) for key in ("theta_h", "theta_d", "phi_d")}
        arrays["convention"] = np.array(measured.convention)
    with _files.aside(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_npz_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a .npz file, if they take little more memory than it has bytes; nothing is unpickled.

    Raises
    ------
    ValueError
        If it is no such file, or would take far more memory.
    OSError
        If the file cannot be read.
    """
    size = _files.regular_size(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            total = sum(member.file_size for member in members)
            _check_unpacked(path, size, total, 0)
            arrays: dict[str, NDArray[Any]] = {}
            n_numbers = 0
            for member in members:
                name = member.filename.removesuffix(".npy")
                if name in arrays:
                    raise ValueError(f"{path}: the array {name:.40} is there twice. Write it again.")
                with archive.open(member) as file:
                    arrays[name] = _array(file, member.file_size, f"{path}: {member.filename:.40}")
                n_numbers += arrays[name].size
                _check_unpacked(path, size, total, n_numbers)
            return arrays
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(
            f"{path}: not a sound .npz file: {error}. Write it again with numpy.savez."
        ) from None


def _check_unpacked(path: Path, size: int, n_bytes: int, n_numbers: int) -> None:
    try:
        _files.check_unpacked(size, n_bytes, n_numbers)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _array(file: IO[bytes], size: int, label: str) -> NDArray[Any]:
    """The array of a .npy stream of so many bytes; its header is held against them first."""
    start = file.read(8)
    if start[:6] != MAGIC or len(start) < 8 or start[6] not in (1, 2, 3):
        raise ValueError(f"{label}: not a .npy array. Write it with numpy.save.")
    n_length = 2 if start[6] == 1 else 4
    length = int.from_bytes(file.read(n_length), "little")
    match = _HEADER.fullmatch(file.read(length)) if length <= 10_000 else None
    if not match:
        raise ValueError(f"{label}: not an array of numbers. Write it with numpy.save, without objects.")
    try:
        dtype = np.dtype(match[1].decode())
        shape = tuple(int(n) for n in match[3].decode().split(",") if n.strip())
    except (TypeError, ValueError):
        raise ValueError(f"{label}: an array of type {match[1].decode()}. Convert it to float64.") from None
    need = 8 + n_length + length + dtype.itemsize * math.prod(shape)
    if need != size:
        raise ValueError(
            f"{label}: an array of shape {shape} needs {need:,} bytes, got {size:,}. Write it again."
        )
    data = file.read()
    if len(data) != dtype.itemsize * math.prod(shape) or not dtype.itemsize:
        raise ValueError(f"{label}: the file ends early. Write it again.")
    flat = np.frombuffer(data, dtype)
    return flat.reshape(shape, order="F" if match[2] == b"True" else "C")
