"""Binary files of the UTIA BRDF database (J. Filip and R. Vavra, Computer Graphics Forum 33, 2014).

1,990,656 bytes: float64 over colour, theta_i, phi_i, theta_v, phi_v (fastest), theta every 15 degrees from 0 to 75,
phi every
7.5 degrees. The samples are anisotropic; they go in as they are, turned with the sample.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.formats.grid import columns_of
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["N_BYTES", "is_utia", "read_utia"]

N_THETA, N_PHI = 6, 48
N_BYTES = 8 * 3 * (N_THETA * N_PHI) ** 2


def is_utia(head: bytes, size: int) -> bool:
    """Whether a file of this size and head may be one."""
    if size != N_BYTES or len(head) < 800:
        return False
    numbers = np.frombuffer(head[:800], "<f8")
    return bool(np.isfinite(numbers).all() and (np.abs(numbers) < 1e4).all() and (numbers != 0.0).any())


def read_utia(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read such a file.

    Raises
    ------
    ValueError
        If it has another size.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    size = _files.regular_size(path)
    if size != N_BYTES:
        raise ValueError(f"{path}: a file of the UTIA database has {N_BYTES:,} bytes, got {size:,}.")
    values = np.fromfile(path, "<f8").reshape(3, N_THETA, N_PHI, N_THETA, N_PHI)
    theta, phi = 15.0 * np.arange(N_THETA), 7.5 * np.arange(N_PHI)
    angles = {"theta_i_deg": theta, "phi_i_deg": phi, "theta_o_deg": theta, "phi_o_deg": phi}
    columns = columns_of(angles, dict(zip("rgb", values, strict=True)))
    return samples_from_columns(columns, path.stem, Source(path), options, remarks=("UTIA BRDF database",))
