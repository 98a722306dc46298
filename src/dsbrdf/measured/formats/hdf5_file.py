"""HDF5 files: weights of a neural BRDF, or arrays by name, as MATLAB (v7.3), h5py and netCDF-4 write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.formats.array_file import read_arrays
from dsbrdf.measured.formats.nbrdf import read_nbrdf
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["read_hdf5"]

#: Entries of a file.
_MOST = 2000


def read_hdf5(
    path: str | Path, options: ReadOptions | None = None, *, convention: str = "centre"
) -> MeasuredBRDF | Samples:
    """Read a neural BRDF, or arrays named as in a .npz file.

    Raises
    ------
    ValueError
        If the file holds neither.
    ModuleNotFoundError
        If h5py is not installed.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    arrays, others = _datasets(path)
    if any(name.split("/")[-1].split(":")[0] == "kernel" for name in others):
        return read_nbrdf(path, convention=convention)
    if not arrays:
        listed = ", ".join(others)
        raise ValueError(
            f"{path}: an HDF5 file without a neural BRDF, and without arrays at its top, but "
            f"{listed or 'nothing':.200}. Write "
            "the columns there, as theta_i_deg and so on, or as CSV."
        )
    return read_arrays(arrays, path, options or ReadOptions(), convention=convention)


def _datasets(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Numbers at the top of the file by name, and the names of all other entries."""
    try:
        import h5py
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "HDF5 files need h5py: pip install 'dsbrdf[hdf5]'", name=error.name
        ) from None
    size = _files.regular_size(path)
    arrays: dict[str, Any] = {}
    others: list[str] = []
    total, n_numbers = 0, 0
    try:
        with h5py.File(path, "r") as file:
            file.visit(lambda name: others.append(name) if "/" in name and len(others) < _MOST else None)
            for name in list(file)[:_MOST]:
                is_link = not isinstance(file.get(name, getlink=True), h5py.HardLink)
                entry = None if is_link else file.get(name)
                if not isinstance(entry, h5py.Dataset) or entry.dtype.kind not in "biuf":
                    others.append(name)
                    continue
                if entry.size is None:
                    raise ValueError(f"{name:.40} has no numbers")
                total, n_numbers = total + entry.size * entry.dtype.itemsize, n_numbers + entry.size
                _files.check_unpacked(size, total, n_numbers)
                # Numbers of other files are none of this one
                if entry.external or entry.is_virtual:
                    raise ValueError(f"{name:.40} lies in another file. Copy it into this one")
                array = np.asarray(entry[()])
                # MATLAB writes (n, 1), turned
                if array.ndim == 2 and "MATLAB_class" in entry.attrs:
                    array = array.T
                arrays[name] = array.ravel() if array.ndim == 2 and 1 in array.shape else array
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise ValueError(f"{path}: not a sound HDF5 file: {error}.".replace("\n", " ")) from None
    return arrays, others
