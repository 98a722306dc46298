"""`dsbrdf view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import Force, State, app, check_folder, check_output, tell
from dsbrdf.cli._reading import takes_reading


@app.command()
@takes_reading
def view(
    context: typer.Context,
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL",
            help="Model files, folders of them, names of the library, or what fit takes, which is then fitted.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The page.")] = Path("view.html"),
    space: Annotated[
        Path | None,
        typer.Option("--space", metavar="FILE", help="Lay the materials out in this space."),
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    force: Force = False,
    *,
    reading: Any,
) -> None:
    """Write a web page that shows models; it opens from disk."""
    from dsbrdf.cli import _report as report
    from dsbrdf.view import collect
    from dsbrdf.view import view as write_page

    laid_out = None
    if space is not None:
        from dsbrdf.space import load_space

        laid_out = load_space(space)
    state: State = context.obj
    targets = collect.expand(models)
    check_output(out, [*models, *targets], force=force)
    check_folder(out.absolute().parent)
    with report.progress(len(targets)) as step:
        begin = state.announce(step)
        opened = []
        for target in targets:
            with state.passing_over(target, targets):
                opened.append(collect.open_model(target, begin, reading))
    state.begin("")
    if not opened:
        state.end()
    write_page(opened, out, space=laid_out)
    tell(out)
    if show:
        typer.launch(str(out))
    state.end()
