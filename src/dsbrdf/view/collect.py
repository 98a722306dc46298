"""Models from what the command line names: model files, folders of them, names, measured files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dsbrdf import batch, library
from dsbrdf.fitting import fit
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.view.page import view

__all__ = ["PAGE", "expand", "open_model", "view_files"]

#: Name of the page that commands write beside their models.
PAGE = "view.html"


def expand(targets: Sequence[str | Path]) -> list[str]:
    """Files and names of materials, with libraries and folders replaced by their models, or else by measured files.

    Raises
    ------
    ValueError
        If a folder holds neither, or a library is not sound.
    OSError
        If a folder cannot be read.
    """
    expanded: list[str] = []
    for target in targets:
        path = Path(target)
        if path.suffix.lower() == library.SUFFIX and path.is_file():
            expanded += [f"{path}/{name}" for name in library.open(path).names]
            continue
        if not path.is_dir():
            expanded.append(str(target))
            continue
        inside = list(map(str, model_file.models_in(path)))
        if not inside:
            try:
                inside, _ = batch.expand([path], strict=True)
            except ValueError:
                raise ValueError(
                    f"{path}: no model file (.json) and no measured file in this folder."
                ) from None
        expanded += inside
    return expanded


def open_model(
    target: str, begin: Callable[[str], None] = lambda _: None, reading: Mapping[str, Any] | None = None
) -> DSBRDF:
    """The model in a file or in the library; a measured file, read with these options, or built-in material is fitted.

    Raises
    ------
    ValueError
        If it is none of these, or not sound.
    OSError
        If the file cannot be read.
    """
    begin(Path(target).stem)
    model = library.model_named(target)
    return fit(batch.open_target(target, reading)).model if model is None else model


def view_files(paths: Sequence[Path], folder: Path) -> Path:
    """Write the page of model files to their folder, and return its path.

    Raises
    ------
    OSError
        If a file cannot be read, or the page not be written.
    """
    page = folder / PAGE
    view([model_file.load(path) for path in paths], page)
    return page
