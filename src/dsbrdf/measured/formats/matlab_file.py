"""MATLAB files (version 5 to 7.2): arrays by name, as in a .npz file; later ones are HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.formats.array_file import read_arrays
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["read_matlab"]

MAX_BYTES = 200_000_000


def read_matlab(
    path: str | Path, options: ReadOptions | None = None, *, convention: str = "centre"
) -> MeasuredBRDF | Samples:
    """Read arrays named as in a .npz file; structures, cells and text are left out.

    Raises
    ------
    ValueError
        If the file is damaged, or its arrays are those of no reflectance.
    OSError
        If it cannot be read.
    """
    from scipy.io import loadmat

    path = Path(path)
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: more than {MAX_BYTES:,} bytes. Save it with -v7.3, or as CSV.")
    try:
        content: dict[str, Any] = loadmat(str(path))
    except Exception as error:
        # The error of zlib has no public base
        raise ValueError(f"{path}: not a sound MATLAB file: {type(error).__name__}. Save it again.") from None
    arrays: dict[str, Any] = {}
    for name, array in content.items():
        if name.startswith("__") or not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
            continue
        arrays[name] = array.ravel() if array.ndim == 2 and 1 in array.shape else array
    if not arrays:
        raise ValueError(
            f"{path}: a MATLAB file without arrays of numbers. Save the columns as theta_i_deg and "
            f"so on, or as CSV."
        )
    return read_arrays(arrays, path, options or ReadOptions(), convention=convention)
