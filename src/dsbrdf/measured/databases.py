"""Measured databases: what they may be used for, how to get them, and where they are on this machine."""

from __future__ import annotations

import difflib
import errno
import os
import re
import shutil
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsbrdf import _files, _lock
from dsbrdf.measured._download import Download
from dsbrdf.measured.formats.merl import N_BYTES

__all__ = ["DATABASES", "Archive", "Database", "fetch", "fetched", "folder"]

#: Names the folder, instead of the cache of the user.
FOLDER_VARIABLE = "DSBRDF_DATA"
MERL_NAMES = """
    alum-bronze alumina-oxide aluminium aventurnine beige-fabric black-fabric black-obsidian
    black-oxidized-steel black-phenolic black-soft-plastic blue-acrylic blue-fabric blue-metallic-paint
    blue-metallic-paint2 blue-rubber brass cherry-235 chrome-steel chrome colonial-maple-223
    color-changing-paint1 color-changing-paint2 color-changing-paint3 dark-blue-paint dark-red-paint
    dark-specular-fabric delrin fruitwood-241 gold-metallic-paint gold-metallic-paint2
    gold-metallic-paint3 gold-paint gray-plastic grease-covered-steel green-acrylic green-fabric
    green-latex green-metallic-paint green-metallic-paint2 green-plastic hematite ipswich-pine-221
    light-brown-fabric light-red-paint maroon-plastic natural-209 neoprene-rubber nickel nylon
    orange-paint pearl-paint pickled-oak-260 pink-fabric pink-fabric2 pink-felt pink-jasper pink-plastic
    polyethylene polyurethane-foam pure-rubber purple-paint pvc red-fabric red-fabric2 red-metallic-paint
    red-phenolic red-plastic red-specular-plastic silicon-nitrade silver-metallic-paint
    silver-metallic-paint2 silver-paint special-walnut-224 specular-black-phenolic specular-blue-phenolic
    specular-green-phenolic specular-maroon-phenolic specular-orange-phenolic specular-red-phenolic
    specular-violet-phenolic specular-white-phenolic specular-yellow-phenolic ss440 steel teflon
    tungsten-carbide two-layer-gold two-layer-silver violet-acrylic violet-rubber white-acrylic
    white-diffuse-bball white-fabric white-fabric2 white-marble white-paint yellow-matte-plastic
    yellow-paint yellow-phenolic yellow-plastic
""".split()  # noqa: SIM905
#: Keeps a second download of a database out of its folder.
LOCK = ".dsbrdf-download.lock"
#: Bytes of a chunk while a member is extracted.
BLOCK = 1 << 20


@dataclass(frozen=True)
class Archive:
    """A zip file that holds the whole of a database."""

    size: int
    md5: str
    #: Path of a material in it, with its name to be filled in.
    member: str


@dataclass(frozen=True)
class Database:
    """A published database of measured reflectances.

    Parameters
    ----------
    name, title, licence, page : str
    citation : str
        What its authors ask to be cited.
    url : str
        Of the archive, or of a material, with its name to be filled in.
    file : str
        Name of a material's file here.
    names : tuple of str
        Of its materials; empty if they are told on its page only.
    archive : Archive or None
    """

    name: str
    title: str
    licence: str
    page: str
    citation: str
    url: str
    file: str
    names: tuple[str, ...] = ()
    archive: Archive | None = None

    @property
    def url_variable(self) -> str:
        """Environment variable that names a mirror."""
        return f"DSBRDF_{self.name.upper()}_URL"


DATABASES = {
    database.name: database
    for database in (
        Database(
            name="merl",
            title="MERL BRDF database, 100 materials",
            licence="CC-BY-SA-4.0",
            page="https://zenodo.org/records/8101681",
            citation="W. Matusik, H. Pfister, M. Brand and L. McMillan, A Data-Driven Reflectance Model, "
            "ACM Transactions on Graphics 22(3), 759-769, 2003",
            url="https://zenodo.org/records/8101681/files/BRDFDatabase.zip?download=1",
            file="{}.binary",
            names=tuple(MERL_NAMES),
            archive=Archive(
                1_253_117_184, "7141af4c12b4c4feed299769260b3604", "BRDFDatabase/brdfs/{}.binary"
            ),
        ),
        Database(
            name="rgl",
            title="RGL material database, isotropic and anisotropic",
            licence="CC0-1.0",
            page="https://rgl.epfl.ch/materials",
            citation="J. Dupuy and W. Jakob, An Adaptive Parameterization for Efficient Material Acquisition and "
            "Rendering, ACM Transactions on Graphics 37(6), 274:1-274:14, 2018",
            url="https://rgl.s3.eu-central-1.amazonaws.com/media/materials/{0}/{0}_rgb.bsdf",
            file="{}_rgb.bsdf",
        ),
    )
}


def folder() -> Path:
    """Where databases are kept: `DSBRDF_DATA`, or the cache of the user.

    Raises
    ------
    ModuleNotFoundError
        If pooch is not installed and the variable is not set.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else Path(_pooch().os_cache("dsbrdf"))


def fetched(database: str) -> list[Path]:
    """Files of a database that are here, sorted."""
    return sorted((folder() / database).glob(_database(database).file.format("*")))


def fetch(
    database: str,
    names: Sequence[str] = (),
    *,
    url: str | None = None,
    told: Callable[[int, int], None] = lambda *_: None,
) -> list[Path]:
    """Get materials of a database, unless they are here.

    Parameters
    ----------
    database : {"merl", "rgl"}
    names : sequence of str, optional
        Materials; all of them by default, which "rgl" does not offer. For "merl" the whole archive of 1.25 GB is
        downloaded in any case; it is kept until all materials are extracted.
    url : str, optional
        Of a mirror: for "merl" of the archive, for "rgl" of a file with `{0}` in place of the material. By default
        the environment variable `DSBRDF_MERL_URL` or `DSBRDF_RGL_URL`, or else the address that the authors give.
    told : callable, optional
        Told the bytes that are here and those of the whole file (0 if not known), now and then.

    Returns
    -------
    list of Path

    Raises
    ------
    ValueError
        If there is no such database or material, or what comes is not what it should be.
    ConnectionError
        If it cannot be downloaded. What has come of an archive stays, and the next call goes on from there.
    OSError
        If the disk is full or cannot be written to.
    BusyError
        If another process is downloading this database.
    ModuleNotFoundError
        If pooch is not installed.
    """
    of = _database(database)
    names = list(dict.fromkeys(names)) or list(of.names)
    _check_names(of, names)
    url = url or os.environ.get(of.url_variable) or of.url
    if of.archive is None and "{" not in url:
        raise ValueError(f"{of.name}: the address needs {{0}} in place of the material, got {url}.")
    into = folder() / of.name
    with _lock.held(into / LOCK):
        if of.archive is not None:
            return _from_archive(of, of.archive, names, into, url, told)
        return [_single(of, name, into, url, told) for name in names]


def _database(name: str) -> Database:
    if name not in DATABASES:
        raise ValueError(f"no database {name!r}: there are {' and '.join(DATABASES)}.")
    return DATABASES[name]


def _check_names(of: Database, names: Sequence[str]) -> None:
    if not names:
        raise ValueError(f"{of.name}: name the materials; they are listed at {of.page}.")
    for name in names:
        if of.names and name not in of.names:
            near = difflib.get_close_matches(name, of.names, n=3)
            meant = f" Did you mean {', '.join(near)}?" if near else ""
            raise ValueError(
                f"{of.name}: no material {name!r}.{meant} All are listed by: dsbrdf data list {of.name}."
            )
        if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise ValueError(f"{of.name}: {name!r} is no name of a material; they are listed at {of.page}.")


def _pooch() -> Any:
    try:
        import pooch
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            f"databases need pooch: pip install 'dsbrdf[data]', or name a folder that holds them in {FOLDER_VARIABLE}."
        ) from None
    pooch.get_logger().setLevel("WARNING")
    return pooch


def _from_archive(
    of: Database,
    archive: Archive,
    names: Sequence[str],
    into: Path,
    url: str,
    told: Callable[[int, int], None],
) -> list[Path]:
    paths = {name: into / of.file.format(name) for name in names}
    missing = {name: path for name, path in paths.items() if not _is_whole(path)}
    if missing:
        zipped = into / f"{of.name}.zip"
        part = zipped.with_suffix(".zip.part")
        there = sum(path.stat().st_size for path in (zipped, part) if path.exists())
        _check_space(into, max(archive.size - there, 0) + N_BYTES * len(missing))
        download = Download(part, archive.size, hint=f"See {of.page}.", told=told)
        _pooch().retrieve(
            url, f"md5:{archive.md5}", fname=zipped.name, path=zipped.parent, downloader=download
        )
        _extract(zipped, archive, missing)
        if all(_is_whole(into / of.file.format(name)) for name in of.names):
            zipped.unlink()
    return list(paths.values())


def _is_whole(path: Path) -> bool:
    return path.is_file() and path.stat().st_size == N_BYTES


def _check_space(into: Path, needed: int) -> None:
    """Say before a long download that it will not fit."""
    existing = next(path for path in (into, *into.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if free < needed:
        text = f"{os.strerror(errno.ENOSPC)}: {needed:,} bytes are needed, {free:,} are free; set {FOLDER_VARIABLE}"
        raise OSError(errno.ENOSPC, text, str(into))


def _extract(zipped: Path, archive: Archive, paths: dict[str, Path]) -> None:
    """Extract materials to their `paths`: whatever else is in the archive, and wherever it wants to go, stays there."""
    try:
        with zipfile.ZipFile(zipped) as file:
            for name, path in paths.items():
                with _files.aside(path) as part:
                    _extract_one(file, archive.member.format(name), part)
    except (zipfile.BadZipFile, KeyError, EOFError, NotImplementedError, zlib.error) as error:
        reason = error.args[0] if error.args else type(error).__name__
        raise ValueError(
            f"{zipped}: not the archive it should be: {reason}. Remove it and fetch again."
        ) from None


def _extract_one(file: zipfile.ZipFile, member: str, part: Path) -> None:
    size = file.getinfo(member).file_size
    if size != N_BYTES:
        raise zipfile.BadZipFile(f"{member} should have {N_BYTES:,} bytes, and has {size:,}")
    with file.open(member) as source, part.open("wb") as target:
        shutil.copyfileobj(source, target, BLOCK)


def _single(of: Database, name: str, into: Path, url: str, told: Callable[[int, int], None]) -> Path:
    """A material that is a file of its own; it is known by its content."""
    from dsbrdf.measured.formats.tensor_file import read_tensor_file

    path = into / of.file.format(name)
    if path.is_file():
        return path
    part, received = (path.with_name(f".{path.name}.{end}") for end in ("part", "received"))
    hint = f"Is {name!r} listed at {of.page}?"
    try:
        Download(part, hint=hint, told=told)(url.format(name), received)
        read_tensor_file(received)
        received.replace(path)
    except ValueError as error:
        raise ValueError(str(error).replace(received.name, url.format(name))) from None
    finally:
        received.unlink(missing_ok=True)
    return path
