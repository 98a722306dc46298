"""Many models in one file, and the file that comes with the package: 106 materials to begin with.

`names` and `load` are of the built-in library, fitted to 100 NBRDF-decoded MERL materials and six files of the RGL
database; `write` and `open` make and read files of your own, of any number of materials. `file` says how they are laid
out, `tools/library.py` in the repository made the built-in one.
"""

from functools import cache, lru_cache
from pathlib import Path

from dsbrdf.library.file import SUFFIX, Library, LibraryFormatError, open, write
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF

__all__ = [
    "SUFFIX",
    "Library",
    "LibraryFormatError",
    "builtin",
    "load",
    "model_named",
    "names",
    "open",
    "write",
]


@cache
def builtin() -> Library:
    """The library that comes with the package.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.library.builtin()
    Library(materials.dsbrdf, 106 materials)
    """
    return open(Path(__file__).with_name(f"materials{SUFFIX}"))


def names() -> tuple[str, ...]:
    """Names of the materials of the built-in library.

    Examples
    --------
    >>> import dsbrdf
    >>> "nickel" in dsbrdf.library.names()
    True
    """
    return builtin().names


def load(name: str) -> DSBRDF:
    """A material of the built-in library.

    Raises
    ------
    ValueError
        If there is no such material; says which names are near.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.library.load("nickel").channels
    ('r', 'g', 'b')
    """
    return builtin().load(name)


def model_named(target: str | Path) -> DSBRDF | None:
    """The model that a word of the command line stands for, None if it has to be measured or fitted first.

    A file comes first: a model file (.json) is read, any other file holds no model. Where there is no file of this
    name, a material of the built-in library may have it; and `FILE.dsbrdf/NAME` is a material of another library.

    Raises
    ------
    ValueError
        If a model file is not sound.
    OSError
        If it cannot be read.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.library.model_named("nickel").n_channels
    3
    >>> dsbrdf.library.model_named("scan.csv") is None
    True
    """
    path = Path(target)
    if path.suffix.lower() == ".json":
        return model_file.load(path)
    if path.parent.suffix.lower() == SUFFIX and path.parent.is_file():
        return _opened(path.parent, path.parent.stat().st_mtime_ns).load(path.name)
    return load(str(target)) if not path.exists() and str(target) in names() else None


@lru_cache(maxsize=4)
def _opened(path: Path, _changed: int) -> Library:
    """A library, opened once for all its materials."""
    return open(path)
