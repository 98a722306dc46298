"""`read`: any measured file, its format found from its content; the one list of all formats."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from dsbrdf import _files
from dsbrdf.measured.formats import alta, bird, ddr, merl, pbrt, ssdd, utia, zemax
from dsbrdf.measured.formats.text_file import is_text
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["FORMATS", "Format", "format_of", "read", "read_samples"]

_HEAD = 4096
_KNOWN = (
    "a MERL .binary, RGL .bsdf, NumPy .npz or .npy, neural BRDF .h5, EXR or PNG file, a format of metrology "
    "such as BiRD "
    "JSON, or text with a header and columns"
)


@dataclass(frozen=True)
class Format:
    """A format that is read.

    Parameters
    ----------
    name : str
        What it is called.
    fits : callable
        Whether a file with this head and path is of this format.
    reader : str
        Module in `formats` and function; it takes a path.
    gives : str
        "samples", and takes `ReadOptions`; "table", and takes the convention; "either", and takes both.
    """

    name: str
    fits: Callable[[bytes, Path], bool]
    reader: str
    gives: str

    def open(self, path: Path, convention: str, options: ReadOptions) -> MeasuredBRDF | Samples:
        """Read a file."""
        module, function = self.reader.split(":")
        read_file = getattr(import_module(f"dsbrdf.measured.formats.{module}"), function)
        keywords = {} if self.gives == "samples" else {"convention": convention}
        content: MeasuredBRDF | Samples
        content = (
            read_file(path, **keywords) if self.gives == "table" else read_file(path, options, **keywords)
        )
        return content


def _starts(*starts: bytes) -> Callable[[bytes, Path], bool]:
    return lambda head, _: head.startswith(starts)


def _is_network(head: bytes, path: Path) -> bool:
    from dsbrdf.measured.formats import nbrdf

    return head.startswith(b"\x93NUMPY") and nbrdf.npy_set(path) is not None


#: In the order in which they are tried.
FORMATS = (
    Format("MERL table", lambda head, _: merl.is_merl(head), "merl:read_merl", "table"),
    Format("RGL tensor file", _starts(b"tensor_file\0"), "rgl:read_rgl_table", "table"),
    Format("NumPy arrays (.npz)", lambda head, path: head.startswith(b"PK\x03\x04") and not _office(path),
        "array_file:read_npz", "either"),
    Format("neural BRDF (.npy)", _is_network, "nbrdf:read_nbrdf", "table"),
    Format("NumPy array (.npy)", _starts(b"\x93NUMPY"), "array_file:read_npy", "table"),
    Format("HDF5 file", _starts(b"\x89HDF\r\n"), "hdf5_file:read_hdf5", "either"),
    Format("image", _starts(b"\x89PNG", b"\x76\x2f\x31\x01"), "image_file:read_image", "table"),
    Format("MATLAB file", _starts(b"MATLAB 5.0 MAT-file"), "matlab_file:read_matlab", "either"),
    Format("BiRD JSON file", lambda head, _: bird.is_bird(head), "bird:read_bird", "samples"),
    Format("ALTA data file", lambda head, _: alta.is_alta(head), "alta:read_alta", "samples"),
    Format("SSDD file", lambda head, _: ssdd.is_ssdd(head), "ssdd:read_ssdd", "samples"),
    Format("Zemax BSDF file", lambda head, _: zemax.is_zemax(head), "zemax:read_zemax", "samples"),
    Format("Integra DDR file", lambda head, _: ddr.is_ddr(head), "ddr:read_ddr", "samples"),
    Format("UTIA file", lambda head, path: utia.is_utia(head, path.stat().st_size), "utia:read_utia", "samples"),
    Format("pbrt-v2 measured BRDF", lambda head, _: pbrt.is_pbrt(head), "pbrt:read_pbrt", "samples"),
    Format("text", lambda head, _: is_text(head), "text_file:read_text", "samples"),
)  # fmt: skip
#: What else files may be, by how they begin, and what to do about it.
_STRANGERS = (
    ((b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf", b"\x28\xb5\x2f\xfd", b"Rar!"),
        "a compressed file. Unpack it first"),
    ((b"\xd0\xcf\x11\xe0",), "an old Office file, perhaps an Excel workbook (.xls): open it and save the sheet as CSV"),
    ((b"%PDF",), "a PDF document. The numbers are needed as text or CSV"),
    ((b"{\\rtf",), "a rich text document: save it as plain text"),
    ((b"PAR1",), "a Parquet file: read it with pandas, and give the frame to dsbrdf.read or write it as CSV"),
    ((b"SQLite format 3",), "an SQLite database: export the table as CSV"),
    ((b"SIMPLE  =",), "a FITS file: export its table as CSV"),
    ((b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05"), "a Python pickle, which is not read since it can run "
    "anything. Use numpy.savez"),
    ((b"\xff\xd8\xff", b"GIF8", b"II*\0", b"MM\0*", b"#?RADIANCE", b"#?RGBE", b"BM"), "an image, not a "
    "measurement of a BRDF; EXR and PNG images of theta_h x theta_d are read"),
    ((b"<!DOCTYPE html", b"<!doctype html", b"<html", b"<HTML"), "a web page. Download the file that it links to"),
    ((b"CDF\x01", b"CDF\x02"), "a netCDF-3 file: open it with xarray, and give the Dataset to dsbrdf.read"),
)  # fmt: skip


def read(
    path: str | Path | Any,
    *,
    convention: str = "centre",
    columns: Sequence[str] | None = None,
    ignore: Sequence[str] = (),
    set: Mapping[str, float] | None = None,
    scale: float | None = None,
    cosine: bool = False,
    phi_offset: float | None = None,
    keep: Sequence[str] | str = (),
) -> MeasuredBRDF | Samples:
    """Read a measured BRDF; the format is told from the content.

    Parameters
    ----------
    path : str, Path, or table of columns
        MERL, RGL, NumPy arrays, neural BRDF weights (a file, or a folder with one .npy set), EXR or PNG images of
        theta_h x theta_d, formats of metrology, or text with a line for each sample; the page on formats tells what
        each
        must hold. Or a pandas DataFrame, an xarray Dataset, or a mapping of names to columns.
    convention : {"centre", "edge"}, optional
        Which point of a table's cell its value belongs to.
    columns, ignore, set, scale, cosine, phi_offset, keep : optional
        What the file does not say, of scattered samples: see `ReadOptions`. Tables take `scale` alone.

    Returns
    -------
    MeasuredBRDF or Samples
        A table, or scattered samples.

    Raises
    ------
    ValueError
        If the content is of no known format, damaged, or not understood; says what was expected and found.
    ModuleNotFoundError
        If the format needs a package that is not installed.
    OSError
        If the file cannot be read.

    Warns
    -----
    ReadWarning
        If samples are left out, or the numbers do not look like a BRDF in 1/sr in the convention of the package.

    Examples
    --------
    >>> import dsbrdf
    >>> columns = {"theta_i_deg": [30, 30], "theta_o_deg": [-30, 0], "550nm": [1.5, 0.2]}
    >>> samples = dsbrdf.read(columns)  # or the path of a file
    >>> len(samples), samples.channels
    (2, ('550nm',))
    """
    options = ReadOptions(columns, ignore, set or {}, scale, cosine, phi_offset, keep)
    if not isinstance(path, str | Path):
        from dsbrdf.measured.formats.frames import read_frame

        return read_frame(path, options)
    path = Path(path)
    if path.is_dir():
        return _scaled(_read_folder(path, convention), options, path)
    found = format_of(path)
    if options.columns is not None and found.name == "pbrt-v2 measured BRDF":
        found = FORMATS[-1]
    if options.columns is not None and found.name != "text":
        raise ValueError(
            f"{path}: names of columns are for text; this is a {found.name}, which names its arrays itself."
        )
    return _scaled(found.open(path, convention, options), options, path)


def format_of(path: Path) -> Format:
    """Format of a file.

    Raises
    ------
    ValueError
        If it is none that is read; says what it is instead.
    OSError
        If the file cannot be read.
    """
    size = _files.regular_size(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    for found in FORMATS[:-1]:
        if found.fits(head, path):
            return found
    if path.suffix.lower() == ".binary":
        # It says what is wrong with it
        return FORMATS[0]
    if not size:
        raise ValueError(f"{path}: an empty file. Expected {_KNOWN}.")
    if what := _stranger(head, path):
        raise ValueError(f"{path}: {what}.")
    if FORMATS[-1].fits(head, path):
        return FORMATS[-1]
    raise ValueError(
        f"{path}: no known format: expected {_KNOWN}, got a file that begins with {head[:12]!r}."
    )


def _scaled(content: MeasuredBRDF | Samples, options: ReadOptions, path: Path) -> MeasuredBRDF | Samples:
    """A table takes no option but the scale."""
    if isinstance(content, Samples):
        return content
    if others := [name for name in options.given if name != "scale"]:
        raise ValueError(
            f"{path}: {', '.join(others)} (--{others[0].replace('_', '-')}) is for scattered samples; this is a table."
        )
    return (
        content
        if options.scale is None
        else dataclasses.replace(content, scale=options.scale * content.scale)
    )


def read_samples(path: str | Path, columns: Sequence[str] | None = None, **options: Any) -> Samples:
    """Read scattered samples, as `read` does, and refuse tables.

    Parameters
    ----------
    path : str or Path
    columns : sequence of str, optional
        Names of the columns of a text file, see `ReadOptions`.
    **options
        Of `read`.

    Returns
    -------
    Samples

    Raises
    ------
    ValueError
        If the file does not hold samples; says what was expected.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "scan.txt")
    ...     _ = path.write_text("30 -30 1.5")
    ...     samples = dsbrdf.read_samples(path, columns=["theta_i_deg", "theta_o_deg", "value"])
    >>> samples.values.ravel()
    array([1.5])
    """
    samples = read(path, columns=columns, **options)
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


def _office(path: Path) -> str:
    """What a zip file is, if it holds a document."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()[:1000]
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError):
        return ""
    for start, what in (
        ("xl/", "an Excel workbook"),
        ("word/", "a Word document"),
        ("ppt/", "a presentation"),
    ):
        if any(name.startswith(start) for name in names):
            return what
    if "content.xml" in names:
        return "an OpenDocument file"
    if names and not any(name.endswith(".npy") for name in names):
        return "a zip archive"
    return ""


def _stranger(head: bytes, path: Path) -> str:
    """What a file is that is not read, and what to do about it; empty if that is not known."""
    if head.startswith(b"PK\x03\x04"):
        what = _office(path)
        return f"{what}. Unpack it first" if what == "a zip archive" else f"{what}: save the sheet as CSV"
    for starts, what in _STRANGERS:
        if head.startswith(starts):
            return what
    if head.lstrip()[:1] in (b"{", b"["):
        return "JSON, not a measurement. A model file is read by dsbrdf.load"
    if head.lstrip()[:5] == b"<?xml":
        if b"WindowElement" in head or b"LayerSize" in head:
            return "a BSDF of WINDOW or Radiance (XML), which is not read. Sample it with Radiance's bsdfquery, as text"
        return "an XML file of no known kind"
    return ""
