"""`Picture`: the pixels of a photograph, linear, and which of them are valid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf.measured.formats import image_file
from dsbrdf.measured.formats.image_file import LINEAR

__all__ = ["Picture"]

Array = NDArray[np.float64]

#: From this level, as a share of the greatest, an 8-bit pixel is clipped.
CLIPPED = 254.5 / 255.0
NOTE = (
    "8 bits, taken for sRGB: the curve is undone, clipped pixels are left out. Highlights are lost, and cameras change "
    "tones and colours: a linear picture (EXR, HDR) tells more"
)


@dataclass(frozen=True, eq=False)
class Picture:
    """Pixels of a photograph.

    Parameters
    ----------
    pixels : (height, width, channel) ndarray
        Linear; zero where not valid.
    valid : (height, width) ndarray of bool
    name : str
    note : str
        What is to be known about it; empty if nothing.
    """

    pixels: Array
    valid: NDArray[np.bool_]
    name: str
    note: str = ""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width, _ = self.pixels.shape
        return height, width

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.pixels.shape[2])

    @property
    def flat(self) -> Array:
        """Pixels (pixel, channel), rows after each other."""
        return self.pixels.reshape(-1, self.n_channels)

    @classmethod
    def of(cls, image: Any, name: str) -> Picture:
        """Of an array (height, width, channel), or of a file.

        Raises
        ------
        ValueError
            If it has another shape, or is black.
        OSError
            If the file cannot be read.
        """
        note, label = "", name
        if isinstance(image, str | Path):
            path = Path(image)
            name, label = path.stem, str(path)
            image = image_file.read_array(path)
            note = "" if path.suffix.lower() in LINEAR else NOTE
        array: NDArray[Any] = np.asarray(image)
        if array.dtype == np.uint8:
            array, note = _linear(np.asarray(array / 255.0, dtype=np.float64)), NOTE
        pixels = np.asarray(array, dtype=np.float64)
        if pixels.ndim != 3 or 0 in pixels.shape:
            raise ValueError(
                f"{label}: a picture must be (height, width, channel), got shape {pixels.shape}."
            )
        valid = np.asarray((np.isfinite(pixels) & (pixels >= 0.0)).all(-1))
        if note:
            valid &= (pixels < _linear(np.array(CLIPPED))).all(-1)
        if not pixels[valid].any():
            raise ValueError(f"{label}: the picture is black, or has no valid pixel.")
        return cls(np.where(valid[..., None], pixels, 0.0), valid, name, note)


def _linear(encoded: Array) -> Array:
    """The sRGB curve undone (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
