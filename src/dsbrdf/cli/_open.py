"""Models from what a command names: model files, measured files and built-in materials, which are fitted first."""

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
    from dsbrdf.model import file as model_file

    stored = [target.lower().endswith(".json") for target in targets]
    with report.progress(len(targets), shown=not all(stored)) as step:
        begin = state.announce(step)
        for target, is_model in zip(targets, stored, strict=True):
            begin(Path(target).stem)
            yield (
                target,
                model_file.load(target) if is_model else fit(batch.open_target(target, reading)).model,
            )
    state.begin("")
