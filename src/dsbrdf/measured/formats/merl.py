"""Reader and writer of MERL `.binary` files (Matusik et al. 2003).

Three little-endian int32 (90, 90, 180), then the planes red, green and blue of float64 over theta_h, theta_d
and phi_d (fastest). Entries times the scale of their channel are reflectances in 1/sr without the cosine;
negative entries are invalid. The layout of the cells is told in `cell_angles`.
"""

from __future__ import annotations

import stat
from pathlib import Path

import numpy as np

from dsbrdf import _files
from dsbrdf.geometry.grids import SHAPE, cell_angles
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["SCALE", "MerlFormatError", "is_merl", "read_merl", "write_merl"]

#: Factor from stored numbers to 1/sr, per channel.
SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
HEADER = np.dtype("<i4")
N_CHANNELS = 3
N_BYTES = 3 * HEADER.itemsize + N_CHANNELS * SHAPE[0] * SHAPE[1] * SHAPE[2] * 8
#: What an entry that is not valid holds in a file.
INVALID = -1.0


class MerlFormatError(ValueError):
    """A file is not a MERL `.binary` file."""


def is_merl(head: bytes) -> bool:
    """Whether a file that begins with `head` claims to be a MERL file."""
    return head[:12] == np.array(SHAPE, HEADER).tobytes()


def read_merl(path: str | Path, *, convention: str = "centre", name: str | None = None) -> MeasuredBRDF:
    """Map a MERL `.binary` file.

    Parameters
    ----------
    path : str or Path
    convention : {"centre", "edge"}, optional
        Which point of its cell a value belongs to.
    name : str, optional
        Name of the material; the file's name without its ending by default.

    Returns
    -------
    MeasuredBRDF
        Its numbers stay in the file until they are used.

    Raises
    ------
    MerlFormatError
        If the size of the file is not what its header says, or the header is not that of a MERL file.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "matte.binary")
    ...     dsbrdf.write_merl(dsbrdf.material("matte"), path)
    ...     table = dsbrdf.read_merl(path)
    >>> table
    MeasuredBRDF('matte', 90 theta_h x 90 theta_d x 180 phi_d, 3 channels, centre convention)
    """
    path = Path(path)
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise MerlFormatError(f"{path}: not a MERL file: it is not a regular file.")
    with path.open("rb") as file:
        shape = np.frombuffer(file.read(12), HEADER) if status.st_size >= 12 else None
    if shape is None:
        raise MerlFormatError(
            f"{path}: not a MERL file: expected {N_BYTES:,} bytes, the file has {status.st_size:,}."
        )
    if tuple(shape) != SHAPE:
        raise MerlFormatError(
            f"{path}: not a MERL file: expected a header of 90 x 90 x 180, got "
            f"{' x '.join(str(int(n)) for n in shape)}. Is it another format?"
        )
    if status.st_size != N_BYTES:
        raise MerlFormatError(
            f"{path}: not a whole MERL file: the header says 90 x 90 x 180 ({N_BYTES:,} bytes), the file has "
            f"{status.st_size:,} bytes. Fetch it again."
        )
    # float64 behind a header of 12 bytes is unaligned: map bytes, and view them
    data = np.memmap(path, dtype=np.uint8, mode="r", offset=12)
    planes = data.view("<f8").reshape(N_CHANNELS, *SHAPE)
    return MeasuredBRDF(name or path.stem, planes, SCALE, *cell_angles(convention), convention, Source(path))


def write_merl(measured: MeasuredBRDF, path: str | Path) -> None:
    """Write a table as a MERL `.binary` file.

    What `read_merl` gives is written back bit by bit on valid entries; invalid entries are written as -1.

    Raises
    ------
    ValueError
        If the table is not 90 x 90 x 180 with three channels.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "matte.binary")
    ...     dsbrdf.write_merl(dsbrdf.material("matte"), path)
    ...     path.stat().st_size
    34992012
    """
    if measured.planes.shape != (N_CHANNELS, *SHAPE):
        raise ValueError(
            f"{path}: a MERL file holds 3 channels of 90 x 90 x 180, got {measured.planes.shape}. "
            "Tabulate the reflectance on that grid first."
        )
    with _files.aside(path) as part, part.open("wb") as file:
        np.array(SHAPE, HEADER).tofile(file)
        for plane, scale, merl_scale in zip(measured.planes, measured.scale, SCALE, strict=True):
            valid = (plane >= 0.0) & (plane < np.inf)
            # A quotient rounded to nearest means the value itself again wherever any number does
            stored = plane if scale == merl_scale else plane * scale / merl_scale
            np.where(valid, stored, INVALID).astype("<f8").tofile(file)
