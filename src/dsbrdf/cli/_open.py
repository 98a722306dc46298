"""Models from what a command names: model files, measured files and built-in materials, which are fitted first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dsbrdf.cli._app import State

if TYPE_CHECKING:
    from dsbrdf.model.dsbrdf import DSBRDF

__all__ = ["open_models"]


def open_models(targets: Sequence[str], state: State) -> Iterator[tuple[str, DSBRDF]]:
    """Each target and its model; a bar shows what is fitted.

    Raises
    ------
    ValueError
        If a target is none of these, or not sound.
    OSError
        If a file cannot be read.
    """
    from dsbrdf.cli import _report as report
    from dsbrdf.view import collect

    fits = sum(not target.lower().endswith(".json") for target in targets)
    with report.progress(len(targets), shown=fits > 0) as step:
        begin = state.announce(step)
        for target in targets:
            yield target, collect.open_model(target, begin)
    state.begin("")
