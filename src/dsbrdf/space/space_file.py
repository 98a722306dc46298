"""Spaces on disk: one .npz without pickled objects; the analysis is made anew from the curves when it is read."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files, _json
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.measured.formats.array_file import read_npz_arrays
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.settings import SpaceSettings
from dsbrdf.space.variables import DARK, Rows, Sizes, Variables

__all__ = ["SpaceFormatError", "load_space", "save"]

FORMAT, SCHEMA = "dsbrdf space", 1
#: Greatest of the curves: logarithms, and shapes of lobes.
MAX_NUMBER = 1e4
ARRAYS = ("header", "curves", "present")


class SpaceFormatError(ValueError):
    """A file is not a space that this version can read."""


def _constants() -> dict[str, float]:
    """Numbers that a space depends on and that are the same in all spaces of a version."""
    return {"dark": DARK, "azimuthal_width": AZIMUTHAL_WIDTH}


def save(space: MaterialSpace, path: str | Path) -> None:
    """Write `space` to `path`; it is written aside and renamed.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    settings = space.settings
    header: dict[str, Any] = {
        "format": FORMAT,
        "schema": SCHEMA,
        "axes": "curves (material, slot, number), present (material, slot)",
        "numbers": list(Rows._fields),
        "sizes": settings.sizes._asdict(),
        "channels": list(space.channels),
        "correspondence": settings.correspondence,
        "convention": settings.convention,
        "border": space.border if np.isfinite(space.border) else None,
        "n_diffuse": space.n_diffuse,
        **_constants(),
        "materials": [
            {"name": name, "sha256": sha256} for name, sha256 in zip(space.names, space.sources, strict=True)
        ],
    }
    with _files.aside(path) as part, part.open("w+b") as file:
        np.savez_compressed(
            file, header=np.array(json.dumps(header)), curves=space.curves, present=space.present
        )
        # By which a later run knows that it may be replaced
        with zipfile.ZipFile(file, "a") as archive:
            archive.comment = _files.MARK


def load_space(path: str | Path) -> MaterialSpace:
    """Read a space.

    Raises
    ------
    SpaceFormatError
        If the content is not a space, or one of a later schema or of other constants; says what was expected and found.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "space.npz")
    ...     dsbrdf.space.builtin().save(path)
    ...     space = dsbrdf.space.load_space(path)
    >>> space
    MaterialSpace(106 materials, 3 channels, 5 lobes)
    """
    path = Path(path)
    arrays = _read_arrays(path)
    try:
        header = _json.parse(str(arrays["header"][()]))
    except ValueError as error:
        raise SpaceFormatError(f"{path}: not a space: its header is {error}.") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise SpaceFormatError(f'{path}: not a space: expected a header with "format": "{FORMAT}".')
    schema = header.get("schema")
    if schema != SCHEMA:
        raise SpaceFormatError(
            f"{path}: schema {schema!r:.40} is not the one this version reads ({SCHEMA}). Update dsbrdf."
        )
    for name, value in _constants().items():
        if header.get(name) != value:
            raise SpaceFormatError(
                f"{path}: built with {name} = {header.get(name)!r:.40}, where this version has {value!r}. "
                "Build the space again."
            )
    try:
        return _space(header, arrays["curves"], arrays["present"])
    except KeyError as error:
        raise SpaceFormatError(f"{path}: not a whole space: {error} is missing.") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise SpaceFormatError(f"{path}: not a sound space: {error}") from None


def _read_arrays(path: Path) -> dict[str, Any]:
    """Arrays of a .npz by name; nothing is unpacked before its size is known, and nothing unpickled."""
    try:
        arrays = read_npz_arrays(path)
    except ValueError as error:
        reason = str(error).removeprefix(f"{path}: ").removeprefix("not a sound .npz file: ")
        raise SpaceFormatError(f"{path}: not a space: not a sound .npz file ({reason})") from None
    if missing := [name for name in ARRAYS if name not in arrays]:
        raise SpaceFormatError(f"{path}: not a space: no array {missing[0]!r} in it.")
    return arrays


def _space(header: dict[str, Any], curves: Any, present: Any) -> MaterialSpace:
    channels = tuple(map(str, header["channels"]))
    variables = Variables(Sizes(**header["sizes"]), len(channels))
    settings = SpaceSettings(variables.sizes, header["correspondence"], str(header["convention"]))
    names = tuple(str(material["name"]) for material in header["materials"])
    n_materials, n_slots = present.shape
    n_diffuse = int(header["n_diffuse"])
    shape = (n_materials, n_slots, variables.n_numbers)
    if (
        curves.shape != shape
        or len(names) != n_materials
        or not 0 <= n_diffuse <= n_slots
        or not present.size
    ):
        raise ValueError(
            f"curves {curves.shape}, present {present.shape}, {len(names)} names and {n_diffuse} diffuse slots do not "
            f"go together; expected curves {shape}."
        )
    if curves.dtype != np.float64 or present.dtype != np.bool_ or not (np.abs(curves) <= MAX_NUMBER).all():
        raise ValueError(
            f"curves must be finite float64 numbers within {MAX_NUMBER:g}, present must be bool."
        )
    border = header["border"]
    return MaterialSpace(
        settings,
        channels,
        names,
        tuple(str(material["sha256"]) for material in header["materials"]),
        curves,
        present,
        float("-inf") if border is None else float(border),
        n_diffuse,
    )
