"""SSDD, surface scattering distribution data of libbsdf and BSDFProcessor: the reflection in it.

Described in *Surface scattering distribution data (SSDD) file format*, version 0.2, R. Kimura 2023 (libbsdf). A
header and
blocks of meta-data as text; values as text or little-endian doubles, in the order of parameters 0 (fastest) to 3;
degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.formats.grid import about_mirror, columns_of, from_vectors, mirrored_azimuths
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_ssdd", "read_ssdd"]

MAX_BYTES = 500_000_000
_LISTS = [f"PARAM{i}_LIST" for i in range(5)]
_HALF = ("theta_h_deg", "phi_h_deg", "theta_d_deg", "phi_d_deg")
_SPHERE = ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")


def is_ssdd(head: bytes) -> bool:
    """Whether a file with this head may be one."""
    return b"DATA_TYPE" in head and b"PARAM0_LIST" in head


def read_ssdd(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read the BRDF of such a file; transmission and mirror reflectance beside it are left out.

    Raises
    ------
    ValueError
        If there is no BRDF, or the file is damaged.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: not SSDD: more than {MAX_BYTES:,} bytes.")
    content = path.read_bytes()
    at = 0
    others: list[str] = []
    while True:
        meta, at = _meta(content, at, path)
        if not meta:
            raise ValueError(f"{path}: no BRDF in it, but {', '.join(others) or 'nothing'}.")
        values, at = _values(content, at, meta, path)
        if meta.get("DATA_TYPE") == "brdf":
            break
        others.append(meta.get("DATA_TYPE", "data of no type"))
    remarks = [f"SSDD, {meta.get('PARAM_TYPE', 'no parameters')}"]
    if others:
        remarks.append(f"{', '.join(others)} left out")
    return samples_from_columns(
        _columns(meta, values, path), path.stem, Source(path), options, remarks=remarks
    )


def _meta(content: bytes, at: int, path: Path) -> tuple[dict[str, str], int]:
    """Entries up to DATA, and where the values begin."""
    meta: dict[str, str] = {}
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        line = content[at:end].decode("utf-8", errors="replace").strip()
        at = end + 1
        if not line or line.startswith("#"):
            continue
        key, _, value = line.partition(" ")
        meta[key] = value.strip()
        if key == "DATA":
            return meta, at
    if "DATA_TYPE" in meta:
        raise ValueError(f"{path}: the file ends within its header. Fetch it again.")
    return {}, at


def _list(meta: dict[str, str], key: str, path: Path) -> Any:
    try:
        return np.array(meta.get(key, "0").split(), dtype=float)
    except ValueError:
        raise ValueError(f"{path}: {key} must hold numbers, got {meta[key]!r:.40}.") from None


def _values(content: bytes, at: int, meta: dict[str, str], path: Path) -> tuple[Any, int]:
    """Values (parameter 3, 2, 1, 0, channel), and where they end."""
    sizes = [len(_list(meta, key, path)) for key in _LISTS[:4]]
    waves = len(_list(meta, "WAVELENGTH_LIST", path))
    n_channels = {"monochrome": 1, "rgb": 3, "xyz": 3, "spectrum": waves}.get(meta.get("COLOR_MODEL", ""), 0)
    if not n_channels or 0 in sizes:
        raise ValueError(
            f"{path}: COLOR_MODEL must be monochrome, rgb, xyz or spectrum, got "
            f"{meta.get('COLOR_MODEL', '')!r:.40}."
        )
    n = int(np.prod(sizes)) * n_channels
    if meta["DATA"] == "binary":
        if len(content) - at < 8 * n:
            raise ValueError(
                f"{path}: expected {8 * n:,} bytes of values, got {len(content) - at:,}. Fetch it again."
            )
        flat, at = np.frombuffer(content, "<f8", n, at), at + 8 * n
    else:
        numbers: list[str] = []
        while len(numbers) < n and at < len(content):
            end = content.find(b"\n", at)
            end = len(content) if end < 0 else end
            numbers += content[at:end].split(b"#")[0].decode("ascii", errors="replace").split()
            at = end + 1
        try:
            flat = np.array(numbers, dtype=float)
        except ValueError as error:
            raise ValueError(f"{path}: a value is no number: {str(error)[:60]}.") from None
        if len(flat) != n:
            raise ValueError(f"{path}: expected {n:,} values, got {len(flat):,}. Fetch it again.")
    return flat.reshape(*sizes[::-1], n_channels), at


def _columns(meta: dict[str, str], values: Any, path: Path) -> dict[str, Any]:
    p0, p1, p2, p3, offsets = (_list(meta, key, path) for key in _LISTS)
    kind = meta.get("PARAM_TYPE", "")
    values = values.transpose(3, 2, 1, 0, 4)
    reductions = meta.get("REDUCTION_TYPE", "").split()
    if "bilateral_symmetry" in reductions and kind != "half_difference_coordinate_system":
        p3, values = mirrored_azimuths(p3, values, 3)
    names = {"rgb": ["r", "g", "b"], "xyz": ["X", "Y", "Z"], "monochrome": ["value"]}.get(meta["COLOR_MODEL"])
    names = names or [f"{nm:.10g} nm" for nm in _list(meta, "WAVELENGTH_LIST", path)]
    planes = {name: values[..., i] for i, name in enumerate(names)}
    if kind == "specular_coordinate_system":
        i, phi, radial, azimuth = (np.deg2rad(x) for x in np.meshgrid(p0, p1, p2, p3, indexing="ij"))
        at = i if len(offsets) != len(p0) else i + np.deg2rad(offsets)[:, None, None, None]
        return from_vectors(*about_mirror(i, phi, radial, azimuth, at)) | {
            n: v.ravel() for n, v in planes.items()
        }
    if kind not in ("spherical_coordinate_system", "half_difference_coordinate_system"):
        raise ValueError(f"{path}: PARAM_TYPE {kind!r:.40} is not one of SSDD 0.2.")
    angles = _HALF if kind.startswith("half") else _SPHERE
    return columns_of(dict(zip(angles, (p0, p1, p2, p3), strict=True)), planes)
