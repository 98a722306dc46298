"""`dsbrdf space` and its subcommands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dsbrdf.cli._app import State, app, check_folder, missing_plots

if TYPE_CHECKING:
    from dsbrdf.model import DSBRDF
    from dsbrdf.space import MaterialSpace

space = typer.Typer(no_args_is_help=True, help="The space of materials: build, search, blend, move and draw.")
app.add_typer(space, name="space")

SpaceFile = Annotated[
    Path, typer.Option("--space", "-s", metavar="SPACE", help="A file that 'dsbrdf space build' wrote.")
]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Model file to write; default: NAME.json.")
]
MATERIAL = "A model file, or the name of a material of the space."
DEFAULT = Path("space.npz")


class Correspondence(StrEnum):
    """Which lobe of one material is which of another."""

    rank = "rank"
    border = "border"


@space.command()
def build(
    context: typer.Context,
    models: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL", help="Model files, or folders of them.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="SPACE", help="File to write.")] = DEFAULT,
    raw: Annotated[
        bool, typer.Option("--raw", help="Kappa and gamma as they are (the paper), not logarithms.")
    ] = False,
    correspondence: Annotated[
        Correspondence,
        typer.Option(
            help="Lobes correspond from the flattest on, or from a border of diffuse and specular ones."
        ),
    ] = Correspondence.rank,
    azimuthal: Annotated[
        bool, typer.Option("--azimuthal", help="Take the azimuthal term into the space.")
    ] = False,
) -> None:
    """Build a space of fitted models."""
    from dsbrdf import model_file, report
    from dsbrdf.space import build_space

    check_folder(out.parent)
    state: State = context.obj
    loaded = []
    for path in _files(models):
        state.begin(str(path))
        loaded.append(model_file.load(path))
    state.begin("")
    made = build_space(loaded, logarithmic=not raw, correspondence=correspondence.value, azimuthal=azimuthal)
    made.save(out)
    report.print_space(made, out)


@space.command()
def plot(
    path: SpaceFile = DEFAULT,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the figures.")] = Path(
        "dsbrdf-space"
    ),
) -> None:
    """Draw a map of the materials, their variance, the principal functions, and a blend."""
    from dsbrdf.space import load_space

    if missing := missing_plots():
        raise ModuleNotFoundError(missing)
    check_folder(out)
    made = load_space(path)
    from dsbrdf.space import plot as figures

    for file in figures.write_all(made, out):
        typer.echo(file)


@space.command()
def nearest(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MATERIAL)],
    path: SpaceFile = DEFAULT,
    n: Annotated[int, typer.Option("-n", min=1, help="How many.")] = 5,
) -> None:
    """Print the materials of a space that are nearest to a model."""
    from dsbrdf import report

    made = _load(path)
    report.print_nearest(made.nearest(_material(made, model), n))


@space.command()
def blend(
    a: Annotated[str, typer.Argument(metavar="A", help=MATERIAL)],
    b: Annotated[str, typer.Argument(metavar="B", help=MATERIAL)],
    path: SpaceFile = DEFAULT,
    t: Annotated[float, typer.Option(help="Share of B, 0 to 1.")] = 0.5,
    out: Out = None,
) -> None:
    """Write the model part of the way from A to B."""
    made = _load(path)
    _write(made.blend(_material(made, a), _material(made, b), t), out)


@space.command()
def move(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MATERIAL)],
    path: SpaceFile = DEFAULT,
    axis: Annotated[int, typer.Option(help="Principal function, from 1.")] = 1,
    by: Annotated[float, typer.Option(help="Standard deviations; negative for the other way.")] = 1.0,
    out: Out = None,
) -> None:
    """Write a model moved along a principal function."""
    made = _load(path)
    _write(made.move(_material(made, model), axis, by), out)


@space.command()
def sample(
    path: SpaceFile = DEFAULT,
    n: Annotated[int, typer.Option("-n", min=1, help="How many.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="The same seed draws the same materials.")] = 0,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the models.")] = Path(),
) -> None:
    """Draw new materials; write sample-1.json and so on."""
    import numpy as np

    check_folder(out)
    for model in _load(path).sample(n, np.random.default_rng(seed)):
        _write(model, out / f"{_stem(model.name)}.json")


def _files(paths: list[Path]) -> list[Path]:
    """Files, with folders replaced by the .json files in them."""
    found = []
    for path in paths:
        inside = sorted(path.glob("*.json")) if path.is_dir() else [path]
        if not inside:
            raise FileNotFoundError(f"{path}: no model files (.json) in it.")
        found += inside
    return found


def _load(path: Path) -> MaterialSpace:
    from dsbrdf.space import load_space

    return load_space(path)


def _material(made: MaterialSpace, name: str) -> DSBRDF:
    from dsbrdf import model_file

    if name in made.names and not Path(name).exists():
        return made.material(name)
    if not Path(name).exists():
        raise FileNotFoundError(
            f"{name}: neither a file nor one of the {len(made.names)} materials of the space."
        )
    return model_file.load(name)


def _stem(name: str) -> str:
    return "-".join(name.replace("%", "").split())


def _write(model: DSBRDF, out: Path | None) -> None:
    path = out or Path(f"{_stem(model.name)}.json")
    check_folder(path.parent)
    model.save(path)
    typer.echo(path)
