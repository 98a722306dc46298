"""What pictures come with: lists of distant lights, masks, normals, and folders in the layout of DiLiGenT.

DiLiGenT (Shi et al., IEEE Trans. PAMI 41(2), 2019): pictures named in `filenames.txt`, 16 bits and linear, one distant
light each in `light_directions.txt` and `light_intensities.txt`, `mask.png`, and normals in `Normal_gt.mat` or
`normal.txt`; x to the right, y up, z toward the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.images.light import Light
from dsbrdf.measured.formats import image_file
from dsbrdf.measured.formats.image_file import LINEAR
from dsbrdf.measured.formats.matlab_file import read_matlab_arrays

__all__ = ["Stack", "read_lights", "read_mask", "read_normals", "read_stack"]

Array = NDArray[np.float64]

#: Numbers of a light: a direction, or a direction and three irradiances.
DIRECTION, COLOURED = 3, 6
#: Most bytes of a list, and most lights.
MAX_TEXT, MAX_LIGHTS = 200_000_000, 100_000


@dataclass(frozen=True, eq=False)
class Stack:
    """Pictures of one object, one distant light each, cut out around the object.

    Parameters
    ----------
    images : list of (height, width, 3) ndarray
    lights : list of Light
    normals : (height, width, 3) ndarray
    mask : (height, width) ndarray of bool
    """

    images: list[Array]
    lights: list[Light]
    normals: Array
    mask: NDArray[np.bool_]


def read_lights(path: str | Path) -> list[Light]:
    """Distant lights of a text file: x, y, z toward the light, and its irradiance in r, g, b if it is not 1.

    Lines may begin with one of names; values are separated by commas or spaces. Directions need not be of unit length.

    Raises
    ------
    ValueError
        If a line holds no light.
    OSError
        If the file cannot be read.
    """
    rows = _numbers(Path(path), header=True)
    if len(rows) > MAX_LIGHTS:
        raise ValueError(
            f"{path}: {len(rows):,} lights are more than {MAX_LIGHTS:,}. Give a map of the light."
        )
    return [_light(row, f"{path}, light {i + 1}") for i, row in enumerate(rows)]


def _light(row: list[float], where: str) -> Light:
    if len(row) not in (DIRECTION, COLOURED):
        raise ValueError(f"{where}: expected x y z, or x y z r g b, got {len(row)} numbers.")
    direction = np.array(row[:DIRECTION])
    length = math.hypot(*direction)
    if not (np.isfinite([*row, length]).all() and length > 0.0 and min([0.0, *row[DIRECTION:]]) >= 0.0):
        raise ValueError(f"{where}: expected a direction and irradiances that are not negative, got {row}.")
    return Light.distant(direction / length, np.array([row[DIRECTION:] or [1.0] * 3]))


def _text(path: Path) -> str:
    if _files.regular_size(path) > MAX_TEXT:
        raise ValueError(f"{path}: more than {MAX_TEXT:,} bytes are no list of lights or normals.")
    return path.read_text(encoding="utf-8-sig", errors="replace")


def _numbers(path: Path, *, header: bool = False) -> list[list[float]]:
    rows = []
    lines = _text(path).splitlines()
    for i, line in enumerate(lines):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            if header and not rows:
                continue
            raise ValueError(f"{path}, line {i + 1}: expected numbers, got {line.strip()[:60]!r}.") from None
    if not rows:
        raise ValueError(f"{path}: holds no numbers.")
    return rows


def read_mask(path: str | Path) -> NDArray[np.bool_]:
    """Mask (height, width) of an image: what is brighter than half.

    Raises
    ------
    ValueError, OSError
        If the file is damaged or cannot be read.
    """
    found = image_file.read_array(Path(path), decode=False)
    if found.ndim not in (2, 3) or 0 in found.shape:
        raise ValueError(f"{path}: a mask must be (height, width), got shape {found.shape}.")
    return np.asarray((found if found.ndim == 2 else found.mean(-1)) > 0.5)


def read_normals(path: str | Path) -> Array:
    """Normals (height, width, 3) of an EXR file or a NumPy array; PNG files hold (n + 1) / 2.

    What is shorter than a half, or not finite, is no normal, and zero.

    Raises
    ------
    ValueError, OSError
        If the file is damaged or cannot be read.
    """
    path = Path(path)
    found = image_file.read_array(path, decode=False)
    if path.suffix.lower() not in LINEAR:
        found = 2.0 * found - 1.0
    if found.ndim != 3 or found.shape[-1] != 3:
        raise ValueError(f"{path}: normals must be (height, width, 3), got shape {found.shape}.")
    return _unit(found)


def _unit(found: NDArray[Any]) -> Array:
    """Vectors of unit length; zero for what is shorter than a half, or not finite."""
    found = np.asarray(found, dtype=np.float64)
    found = np.where(np.isfinite(found).all(-1, keepdims=True), found, 0.0)
    # Squares of what is longer than one may be no numbers
    found /= np.maximum(np.abs(found).max(-1, keepdims=True), 1.0)
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    return np.asarray(np.divide(found, length, out=np.zeros_like(found), where=length > 0.5))


def read_stack(folder: str | Path) -> Stack:
    """Pictures, lights, normals and mask of a folder in the layout of DiLiGenT.

    Raises
    ------
    ValueError
        If files do not agree.
    OSError
        If a file is missing or cannot be read.
    """
    folder = Path(folder)
    names = [line.strip() for line in _text(folder / "filenames.txt").splitlines() if line.strip()]
    directions, intensities = (
        _numbers(folder / f"light_{what}.txt") for what in ("directions", "intensities")
    )
    if not len(names) == len(directions) == len(intensities):
        raise ValueError(
            f"{folder}: expected a direction and an intensity for each picture, got {len(names)} pictures, "
            f"{len(directions)} directions and {len(intensities)} intensities."
        )
    for name in names:
        if Path(name).name != name:
            raise ValueError(f"{folder}/filenames.txt: expected names of files in this folder, got {name!r}.")
    lights = [
        _light([*direction, *intensity], f"{folder}, light {i + 1}")
        for i, (direction, intensity) in enumerate(zip(directions, intensities, strict=True))
    ]
    mask = read_mask(folder / "mask.png")
    normals = _ground_truth(folder, mask.shape)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        raise ValueError(f"{folder}/mask.png: shows no object.")
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    images = []
    for name in names:
        pixels = image_file.read_pixels(folder / name, decode=False)
        if pixels.shape[:2] != mask.shape:
            raise ValueError(
                f"{folder / name}: expected the mask's size {mask.shape}, got {pixels.shape[:2]}."
            )
        images.append(pixels[box].astype(np.float64))
    return Stack(images, lights, normals[box], mask[box])


def _ground_truth(folder: Path, shape: tuple[int, ...]) -> Array:
    if (matlab := folder / "Normal_gt.mat").exists():
        arrays = read_matlab_arrays(matlab)
        if "Normal_gt" not in arrays:
            raise ValueError(
                f"{matlab}: expected an array Normal_gt, got {', '.join(arrays) or 'none':.100}."
            )
        found = arrays["Normal_gt"]
    else:
        found = np.array(_numbers(folder / "normal.txt"), dtype=np.float64)
        found = found.reshape(*shape, 3) if found.size == 3 * shape[0] * shape[1] else found
    if found.shape != (*shape, 3):
        raise ValueError(f"{folder}: expected normals of the mask's size {shape}, got shape {found.shape}.")
    return _unit(found)
