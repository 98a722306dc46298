"""Image slices (EXR, PNG): theta_h from left to right, theta_d from bottom to top, both from 0 to 90 degrees.

Pixels are the cells of a table, so that theta_h grows with the square of the column. An EXR image holds values in 1/sr;
a PNG image is decoded from sRGB to numbers from 0 to 1, taken as 1/sr, so that anything above is lost. EXR images are
read if they have one part, whose data window is the display window. Pictures and environment maps are read and
written here too, as pixels.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.measured.formats.array_file import bivariate, read_npy_array
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["EXR_MAGIC", "LINEAR", "PNG_MAGIC", "read_array", "read_image", "read_pixels", "write_pixels"]

#: Endings of files whose values are linear, and may be of any size.
LINEAR = (".exr", ".hdr", ".npy")

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
EXR_MAGIC = b"\x76\x2f\x31\x01"
#: Name, type and size of an attribute in the header of an EXR file.
_ATTRIBUTE = re.compile(rb"([^\0]{1,255})\0([^\0]{1,255})\0(.{4})", re.DOTALL)
#: Rows and columns in the header of an HDR file.
_RADIANCE_SIZE = re.compile(rb"\n-Y (\d{1,9}) \+X (\d{1,9})\n")
#: Pixels on a side of a picture, and of a whole one; and how many may stand behind each byte of a file beyond what a
#: mask of one colour needs.
MAX_PICTURE, MAX_PIXELS, FREE_PIXELS, PIXELS_A_BYTE = 16_384, 2**27, 2**23, 16
#: Pixels on a side; a larger image is no slice.
MAX_SIDE = 1024
#: Bytes that hold the header of an image.
_HEAD = 65_536
_logging = threading.Lock()


def read_image(path: str | Path, *, convention: str = "centre") -> MeasuredBRDF:
    """Read a theta_h x theta_d image of values.

    Parameters
    ----------
    path : str or Path
        An EXR or PNG file, at most 1024 pixels on a side.
    convention : {"centre", "edge"}, optional

    Returns
    -------
    MeasuredBRDF
        Three channels and one phi_d; see `dsbrdf.measured.formats.array_file.bivariate`.

    Raises
    ------
    ValueError
        If the file is damaged or too large.
    ModuleNotFoundError
        If Mitsuba, which reads the images, is not installed.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    pixels = read_pixels(path, MAX_SIDE, "an image slice")[::-1].swapaxes(0, 1)
    return bivariate(pixels, path.stem, convention=convention, source=Source(path))


def read_pixels(
    path: str | Path, max_side: int = MAX_PICTURE, what: str = "a picture", *, decode: bool = True
) -> NDArray[np.float32]:
    """Linear pixels (row, column, 3) of an EXR, HDR or PNG file; the sRGB curve of a PNG image is undone.

    Without `decode`, a PNG image is taken for linear, 0 to 1.

    Raises
    ------
    ValueError
        If the file is damaged, or has more than `max_side` pixels on a side.
    ModuleNotFoundError
        If Mitsuba, which reads the images, is not installed.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    n_bytes = _files.regular_size(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    width, height = _size(head, n_bytes)
    if not (1 <= width <= max_side and 1 <= height <= max_side):
        raise ValueError(
            f"{path}: not {what}: expected an EXR, HDR or PNG file of 1 to {max_side} pixels on a side, "
            f"got {width} x {height}."
        )
    if width * height > min(MAX_PIXELS, FREE_PIXELS + PIXELS_A_BYTE * n_bytes):
        raise ValueError(
            f"{path}: not {what}: {width} x {height} pixels are more than {MAX_PIXELS:,}, or than {n_bytes:,} bytes "
            "hold of any picture. Make it smaller."
        )
    mi = _mitsuba()
    try:
        with _named(path) as name, _silent(mi):
            bitmap = mi.Bitmap(name)
        if not decode:
            bitmap.set_srgb_gamma(False)
        bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    except RuntimeError as error:
        raise ValueError(f"{path}: not a sound image: {error}") from None
    return np.array(bitmap)


def read_array(path: Path, *, decode: bool = True) -> NDArray[Any]:
    """Values of an image as `read_pixels` has them, or the array of a .npy file as it is.

    Raises
    ------
    ValueError, OSError
        If the file is damaged or cannot be read.
    """
    return read_npy_array(path) if path.suffix.lower() == ".npy" else read_pixels(path, decode=decode)


def write_pixels(pixels: NDArray[Any], path: str | Path, names: Sequence[str] = ()) -> None:
    """Write linear pixels (row, column, channel) as OpenEXR in single precision.

    Parameters
    ----------
    pixels : (row, column, channel) ndarray
    path : str or Path
    names : sequence of str, optional
        Of the channels.

    Raises
    ------
    OSError
        If the file cannot be written.
    ModuleNotFoundError
        If Mitsuba, which writes the images, is not installed.
    """
    mi = _mitsuba()
    array = np.ascontiguousarray(pixels, dtype=np.float32)
    bitmap = mi.Bitmap(array, mi.Bitmap.PixelFormat.MultiChannel, list(names)) if names else mi.Bitmap(array)
    # By which a later run knows that it may be replaced
    bitmap.metadata()["software"] = "dsbrdf"
    # To memory first: the library says nothing of a file that it could not write, or not whole
    stream = mi.MemoryStream()
    bitmap.write(stream, mi.Bitmap.FileFormat.OpenEXR)
    with _files.aside(path) as part:
        part.write_bytes(stream.raw_buffer())


@contextlib.contextmanager
def _named(path: Path) -> Iterator[str]:
    """The name of a file, or of a copy if it is in no encoding: from memory, the library crashes on damaged images."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        with tempfile.TemporaryDirectory() as folder:
            yield str(shutil.copyfile(path, Path(folder, "image")))
        return
    yield str(path)


@contextlib.contextmanager
def _silent(mi: Any) -> Iterator[None]:
    """Keep from the terminal what the library says of damaged images."""
    # Of all threads
    with _logging:
        logger = mi.logger()
        level = logger.log_level()
        logger.set_log_level(mi.LogLevel.Error)
        try:
            yield
        finally:
            logger.set_log_level(level)


def _mitsuba() -> Any:
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "images need Mitsuba: pip install 'dsbrdf[render]'", name=error.name
        ) from None
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    return mi


def _size(head: bytes, n_bytes: int) -> tuple[int, int]:
    """Width and height that the first bytes of an image of `n_bytes` tell; zero if they do not."""
    if head.startswith(PNG_MAGIC):
        return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    if head.startswith(b"#?") and (found := _RADIANCE_SIZE.search(head)):
        return int(found[2]), int(found[1])
    windows = {}
    place = len(EXR_MAGIC) + 4
    # What reads images would believe any size of an attribute
    while match := _ATTRIBUTE.match(head, place):
        length = int.from_bytes(match[3], "little")
        place = match.end() + length
        if place > min(n_bytes, len(head)):
            return 0, 0
        if match[2] == b"box2i" and length == 16:
            windows[match[1]] = np.frombuffer(head[match.end() : place], "<i4").astype(int)
    if not {b"dataWindow", b"displayWindow"} <= windows.keys() or head[place : place + 1] != b"\0":
        return 0, 0
    (width, height), *_ = sizes = [tuple(box[2:] - box[:2] + 1) for box in windows.values()]
    return (width, height) if all(size == (width, height) for size in sizes) else (0, 0)
