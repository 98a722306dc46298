"""`dsbrdf data`: list, fetch, path."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Annotated

import typer

from dsbrdf.cli._app import app, tell

commands = typer.Typer(help="Get measured databases: their licences, their files, and where these are.")
app.add_typer(commands, name="data")


class DatabaseName(StrEnum):
    """Databases that can be fetched."""

    merl = "merl"
    rgl = "rgl"


@commands.command("list")
def list_(
    database: Annotated[
        DatabaseName | None, typer.Argument(help="Print the names of its materials.", show_default=False)
    ] = None,
) -> None:
    """Print what can be fetched, and what is here."""
    from dsbrdf.cli import _report as report
    from dsbrdf.measured import databases

    if database is None:
        report.print_databases(
            list(databases.DATABASES.values()),
            {name: databases.fetched(name) for name in databases.DATABASES},
        )
        return
    of = databases.DATABASES[database.value]
    here = {path.name for path in databases.fetched(of.name)}
    names = of.names or sorted(
        path.name.removesuffix(of.file.format("")) for path in databases.fetched(of.name)
    )
    for name in names:
        tell(f"{name} (here)" if of.file.format(name) in here else name)
    if not of.names:
        tell(f"All are listed at {of.page}")


@commands.command()
def fetch(
    database: Annotated[DatabaseName, typer.Argument(show_default=False)],
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Materials; of merl, all by default.", show_default=False),
    ] = None,
    url: Annotated[str | None, typer.Option(metavar="URL", help="Address of a mirror.")] = None,
) -> None:
    """Download materials, print their licence and where they are."""
    from dsbrdf.measured import databases

    of = databases.DATABASES[database.value]
    print(
        f"{of.title}\nLicence: {of.licence}\nSource: {of.page}\nPlease cite: {of.citation}", file=sys.stderr
    )
    with _progress() as told:
        paths = databases.fetch(of.name, names or (), url=url, told=told)
    for path in paths:
        tell(path)


@commands.command("path")
def path() -> None:
    """Print the folder of the databases."""
    from dsbrdf.measured import databases

    tell(databases.folder())


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """Function that shows how much has come, on standard error if that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn, TransferSpeedColumn

    columns = (BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda there, total: bar.update(task, completed=there, total=total or None)
