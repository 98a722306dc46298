"""`read`: any measured file, its format found from its content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dsbrdf import _files
from dsbrdf.measured.formats import merl
from dsbrdf.measured.formats.text_file import is_text
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["read", "read_samples"]

_HEAD = 4096
_KNOWN = (
    "a MERL .binary, RGL .bsdf, NumPy .npz or .npy, neural BRDF .h5, EXR or PNG file, or text with a header and "
    "columns"
)


def read(
    path: str | Path, *, convention: str = "centre", columns: Sequence[str] | None = None
) -> MeasuredBRDF | Samples:
    """Read a measured BRDF; the format is told from the content.

    Parameters
    ----------
    path : str or Path
        MERL, RGL, NumPy arrays, neural BRDF weights (a file, or a folder with one .npy set), EXR or PNG images of
        theta_h x theta_d, or text with a line for each sample. The page on formats tells what each must hold.
    convention : {"centre", "edge"}, optional
        Which point of a table's cell its value belongs to.
    columns : sequence of str, optional
        Names of the columns of text, see `read_samples`.

    Returns
    -------
    MeasuredBRDF or Samples
        A table, or scattered samples from text and from .npz files that hold such.

    Raises
    ------
    ValueError
        If the content is of no known format, or damaged; says what was expected and found.
    ModuleNotFoundError
        If the format needs a package that is not installed.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    if columns is not None:
        return read_samples(path, columns)
    if path.is_dir():
        return _read_folder(path, convention)
    size = _files.regular_size(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if merl.is_merl(head):
        return merl.read_merl(path, convention=convention)
    if head.startswith(b"tensor_file\0"):
        from dsbrdf.measured.formats.rgl import read_rgl_table

        return read_rgl_table(path, convention=convention)
    if head.startswith(b"PK\x03\x04"):
        from dsbrdf.measured.formats.array_file import read_npz

        return read_npz(path, convention=convention)
    if head.startswith(b"\x93NUMPY"):
        from dsbrdf.measured.formats import array_file, nbrdf

        is_network = nbrdf.npy_set(path) is not None
        return (nbrdf.read_nbrdf if is_network else array_file.read_npy)(path, convention=convention)
    if head.startswith(b"\x89HDF\r\n"):
        from dsbrdf.measured.formats.nbrdf import read_nbrdf

        return read_nbrdf(path, convention=convention)
    if head.startswith((b"\x89PNG", b"\x76\x2f\x31\x01")):
        from dsbrdf.measured.formats.image_file import read_image

        return read_image(path, convention=convention)
    return _read_rest(path, head, size)


def read_samples(path: str | Path, columns: Sequence[str] | None = None) -> Samples:
    """Read scattered samples from text or from a .npz file.

    Parameters
    ----------
    path : str or Path
    columns : sequence of str, optional
        Names of the columns of a text file, instead of its header's: angles such as `theta_i_deg`, vectors, `weight`
        or `std`, channels of any other name, and "-" for one to leave out.

    Returns
    -------
    Samples

    Raises
    ------
    ValueError
        If the file does not hold samples; says what was expected.
    OSError
        If the file cannot be read.
    """
    from dsbrdf.measured.formats.text_file import read_text

    path = Path(path)
    _files.regular_size(path)
    with path.open("rb") as file:
        is_zip = file.read(4) == b"PK\x03\x04"
    if not is_zip:
        return read_text(path, columns)
    if columns is not None:
        raise ValueError(f"{path}: names of columns are for text; a .npz file names its arrays itself.")
    from dsbrdf.measured.formats.array_file import read_npz

    samples = read_npz(path)
    if not isinstance(samples, Samples):
        raise ValueError(f"{path}: expected scattered samples, got a table. Use dsbrdf.read.")
    return samples


def _read_folder(path: Path, convention: str) -> MeasuredBRDF:
    from dsbrdf.measured.formats import nbrdf

    if nbrdf.npy_set(path) is None:
        raise ValueError(
            f"{path}: a folder without a neural BRDF (NAME_fc1.npy to NAME_b3.npy). Give a file in it."
        )
    return nbrdf.read_nbrdf(path, convention=convention)


def _read_rest(path: Path, head: bytes, size: int) -> MeasuredBRDF | Samples:
    """Text; or say what else it is."""
    if path.suffix.lower() == ".binary":
        return merl.read_merl(path)
    if not size:
        raise ValueError(f"{path}: an empty file. Expected {_KNOWN}.")
    if head.startswith((b"\x1f\x8b", b"BZh", b"\xfd7zXZ")):
        raise ValueError(f"{path}: a compressed file. Unpack it first.")
    if head.lstrip()[:1] in (b"{", b"["):
        raise ValueError(f"{path}: JSON, not a measurement. A model file is read by dsbrdf.load.")
    if is_text(head):
        from dsbrdf.measured.formats.text_file import read_text

        return read_text(path)
    raise ValueError(
        f"{path}: no known format: expected {_KNOWN}, got a file that begins with {head[:12]!r}."
    )
