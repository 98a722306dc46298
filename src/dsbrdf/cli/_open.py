"""Models from what a command names: model files, materials of the library, and measurements, which are fitted first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dsbrdf.cli._app import State

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["open_models"]


def open_models(
    targets: Sequence[str], state: State, reading: Mapping[str, Any]
) -> Iterator[tuple[str, DSBRDF]]:
    """Each target and its model; `reading` are options of `dsbrdf.read`; a bar shows what is fitted.

    Raises
    ------
    ValueError
        If a target is none of these, or not sound.
    OSError
        If a file cannot be read.
    """
    from dsbrdf import batch
    from dsbrdf.cli import _report as report
    from dsbrdf.fitting import fit
    from dsbrdf.library import model_named, names

    fitted = [not target.lower().endswith(".json") and target not in names() for target in targets]
    with report.progress(len(targets), shown=any(fitted)) as step:
        begin = state.announce(step)
        for target in targets:
            begin(Path(target).stem)
            model = model_named(target)
            yield target, fit(batch.open_target(target, reading)).model if model is None else model
    state.begin("")
