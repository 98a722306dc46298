"""Data files of the ALTA library, text and binary.

Described in its documentation (page *Data File Formats*, L. Belcour, R. Pacanowski and others, Inria): a header of
`#DIM`,
`#PARAM_IN`, `#PARAM_OUT`, `#VS`, then a line for each sample, or doubles between `#BEGIN_STREAM` and `#END_STREAM`.
Radians.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_alta", "read_alta"]

MAX_BYTES = 500_000_000
#: Names of columns of the parametrisations that are pairs of directions.
_INPUTS = {
    "RUSIN_TH_TD_PD": ("theta_h_rad", "theta_d_rad", "phi_d_rad"),
    "RUSIN_TH_PH_TD_PD": ("theta_h_rad", "phi_h_rad", "theta_d_rad", "phi_d_rad"),
    "ISOTROPIC_TV_TL_DPHI": ("theta_o_rad", "theta_i_rad", "phi_rad"),
    "SPHERICAL_TL_PL_TV_PV": ("theta_i_rad", "phi_i_rad", "theta_o_rad", "phi_o_rad"),
    "CARTESIAN": ("wo_x", "wo_y", "wo_z", "wi_x", "wi_y", "wi_z"),
    # A plane of half and difference angles stands for all azimuths; the azimuthal term vanishes in the middle
    "RUSIN_TH_TD": ("theta_h_rad", "theta_d_rad"),
}
_OUTPUTS = {"RGB_COLOR": ("r", "g", "b"), "XYZ_COLOR": ("X", "Y", "Z")}


def is_alta(head: bytes) -> bool:
    """Whether a file with this head may be one."""
    return b"#DIM" in head and b"#PARAM_IN" in head


def read_alta(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read such a file.

    Raises
    ------
    ValueError
        If its parametrisation does not tell pairs of directions, or it is damaged.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: not ALTA data: more than {MAX_BYTES:,} bytes.")
    content = path.read_bytes()
    header, start = _header(content)
    try:
        n_x, n_y = (int(word) for word in header["DIM"].split()[:2])
        marks = [int(word) for word in header.get("VS", "0").split()]
        n_samples = int(header.get("SAMPLE_COUNT", "0"))
    except (KeyError, ValueError):
        raise ValueError(
            f"{path}: not sound ALTA data: expected #DIM with two numbers, and numbers in #VS."
        ) from None
    kind = header.get("PARAM_IN", "")
    names = _INPUTS.get(kind)
    if names is None or len(names) != n_x or not 1 <= n_y <= 10_000:
        known = ", ".join(_INPUTS)
        raise ValueError(
            f"{path}: parametrisation {kind!r:.40} of {n_x} numbers does not tell pairs of "
            f"directions; expected {known}."
        )
    if header.get("FORMAT") == "binary":
        table = _binary(content, start, header, n_samples, n_x + n_y, path)
    else:
        widths = {0: 0, 1: n_y, 2: 2 * n_y}
        table = _text(content, n_x + n_y + widths.get(marks[0] if marks else 0, 0), path)
    columns: dict[str, Any] = dict(zip(names, table.T[:n_x], strict=True))
    if kind == "RUSIN_TH_TD":
        columns["phi_d_rad"] = np.full(len(table), np.pi / 4)
    out = header.get("PARAM_OUT", "")
    labels = _OUTPUTS.get(out, ("value",) if n_y == 1 else tuple(f"value:{i}" for i in range(n_y)))
    if len(labels) != n_y:
        raise ValueError(f"{path}: #PARAM_OUT {out:.40} has {len(labels)} values, #DIM says {n_y}.")
    if out.endswith("COS_FACTOR") and (options is None or not options.cosine):
        raise ValueError(
            f"{path}: the values hold the cosine (#PARAM_OUT {out}): say cosine=True (--cosine)."
        )
    columns |= dict(zip(labels, table.T[n_x : n_x + n_y], strict=True))
    return samples_from_columns(columns, path.stem, Source(path), options, remarks=(f"ALTA data, {kind}",))


def _header(content: bytes) -> tuple[dict[str, str], int]:
    """Entries, and where a stream begins."""
    header: dict[str, str] = {}
    at = 0
    while at < len(content) and content[at : at + 1] in (b"#", b"\n", b"\r"):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        key, _, value = content[at:end].decode("latin-1").strip().removeprefix("#").partition(" ")
        at = end + 1
        if key == "BEGIN_STREAM":
            break
        header.setdefault(key, value.strip())
    return header, at


def _binary(content: bytes, start: int, header: dict[str, str], n: int, width: int, path: Path) -> Any:
    precision, order = header.get("PRECISION", "ieee754-double"), header.get("ENDIAN", "little")
    if precision != "ieee754-double" or order not in ("little", "big"):
        raise ValueError(f"{path}: expected doubles, little or big endian, got {precision:.40} {order:.40}.")
    if n < 1 or len(content) - start < 8 * n * width:
        raise ValueError(
            f"{path}: expected {8 * max(n, 1) * width:,} bytes of samples, got "
            f"{len(content) - start:,}. Fetch it again."
        )
    kind = ">f8" if order == "big" else "<f8"
    return np.frombuffer(content, kind, n * width, start).reshape(n, width)


def _text(content: bytes, width: int, path: Path) -> Any:
    rows = []
    for number, line in enumerate(content.decode("latin-1").splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        if len(words) != width:
            raise ValueError(f"{path}: line {number} has {len(words)} numbers, not {width}.")
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            raise ValueError(f"{path}: line {number}: not numbers: {line!r:.60}.") from None
    if not rows:
        raise ValueError(f"{path}: no sample after the header.")
    return np.array(rows)
