"""`dsbrdf space` and its subcommands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dsbrdf import _files
from dsbrdf.cli._app import Force, State, app, check_folder, check_output, missing_plots, note, tell

if TYPE_CHECKING:
    from dsbrdf import batch
    from dsbrdf.model.dsbrdf import DSBRDF
    from dsbrdf.space import MaterialSpace

space = typer.Typer(no_args_is_help=True, help="The space of materials: build, search, blend, move and draw.")
app.add_typer(space, name="space")

SpaceFile = Annotated[
    str | None,
    typer.Option(
        "--space",
        "-s",
        metavar="library|SPACE",
        help="That of the built-in library, or a file that 'dsbrdf space build' wrote.",
        show_default="space.npz, or library where there is none",
    ),
]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Model file to write; default: NAME.json.")
]
MATERIAL = "A model file, or the name of a material of the space."
DEFAULT = Path("space.npz")
LIBRARY = "library"
#: Standard deviations beyond which there are no materials.
FAR = 4.0


class Correspondence(StrEnum):
    """Which lobe of one material is which of another."""

    rank = "rank"
    border = "border"


@space.command()
def build(
    context: typer.Context,
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL",
            help="Model files, measured files, folders of either, or names of the library or of built-in materials. "
            "What is measured is fitted with five lobes.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="SPACE", help="File to write.")] = DEFAULT,
    correspondence: Annotated[
        Correspondence,
        typer.Option(
            help="Lobes correspond from the flattest on, or from a border of diffuse and specular ones."
        ),
    ] = Correspondence.rank,
    view: Annotated[
        Path | None,
        typer.Option("--view", metavar="FILE", help="Write a web page of the models, laid out in the space."),
    ] = None,
    force: Force = False,
) -> None:
    """Build a space of materials."""
    from dsbrdf.cli import _report as report
    from dsbrdf.space import build_space
    from dsbrdf.view import view as write_page

    check_folder(out.parent)
    if out.suffix.lower() != ".npz":
        raise typer.BadParameter(f"a space is an .npz file, got {out}.", param_hint="'--out'")
    for path in (out, view):
        if path is not None:
            check_output(path, models, force=force)
    opened = _open(models, out, context.obj, force=force)
    made = build_space(opened, correspondence=correspondence.value)
    made.save(out)
    report.print_space(made, out)
    if view is not None:
        write_page(opened, view, space=made)
        tell(f"Page: {view}")
    context.obj.end()


@space.command()
def plot(
    path: SpaceFile = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the figures.")] = Path(
        "dsbrdf-space"
    ),
) -> None:
    """Write figures: maps of materials and lobes, their variance, the principal functions, blends and draws."""
    if missing := missing_plots():
        raise ModuleNotFoundError(missing)
    check_folder(out)
    made = _load(path)
    from dsbrdf.cli import _report as report
    from dsbrdf.plot import space as figures

    with report.progress(len(figures.FIGURES)) as step:
        written = figures.write_all(made, out, step)
    for file in written:
        tell(file)


@space.command()
def nearest(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MATERIAL)],
    path: SpaceFile = None,
    n: Annotated[int, typer.Option("-n", min=1, help="How many.")] = 5,
) -> None:
    """Print the materials of a space that are nearest to a model."""
    from dsbrdf.cli import _report as report

    made = _load(path)
    report.print_nearest(made.nearest(_material(made, model), n))


@space.command()
def blend(
    a: Annotated[str, typer.Argument(metavar="A", help=MATERIAL)],
    b: Annotated[str, typer.Argument(metavar="B", help=MATERIAL)],
    path: SpaceFile = None,
    t: Annotated[float, typer.Option(help="Share of B, 0 to 1.")] = 0.5,
    out: Out = None,
    force: Force = False,
) -> None:
    """Write the model part of the way from A to B."""
    made = _load(path)
    _write(made.blend(_material(made, a), _material(made, b), t), out, a, b, force=force)


@space.command()
def move(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MATERIAL)],
    path: SpaceFile = None,
    axis: Annotated[int, typer.Option(help="Principal function, from 1.")] = 1,
    by: Annotated[float, typer.Option(help="Standard deviations; negative for the other way.")] = 1.0,
    out: Out = None,
    force: Force = False,
) -> None:
    """Write a model moved along a principal function."""
    made = _load(path)
    if abs(by) > FAR:
        note(
            f"warning: {by:g} standard deviations are beyond all materials; run 'dsbrdf check' on what comes out."
        )
    _write(made.move(_material(made, model), axis, by), out, model, force=force)


@space.command()
def draw(
    path: SpaceFile = None,
    n: Annotated[int, typer.Option("-n", min=1, help="How many.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="The same seed draws the same materials.")] = 0,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the models.")] = Path(),
    force: Force = False,
) -> None:
    """Draw new materials; write draw-1.json and so on."""
    import numpy as np

    check_folder(out)
    for model in _load(path).draw(n, np.random.default_rng(seed)):
        _write(model, out / f"{_stem(model.name)}.json", force=force)


def _open(targets: list[str], out: Path, state: State, *, force: bool) -> list[DSBRDF]:
    """Models, in the order given; what is measured is fitted in the way that is best for spaces."""
    from dsbrdf import batch
    from dsbrdf.cli import _report as report
    from dsbrdf.library import model_named
    from dsbrdf.space import FIT
    from dsbrdf.view import collect

    names = collect.expand(targets)
    check_output(out, [*targets, *names], force=force)
    measured = [name for name in names if not _is_model(name)]
    with report.progress(len(measured)) as step:
        step("")
        strict = state.debug or len(names) == 1
        outcomes = batch.fit_many(measured, strict=strict, done=lambda outcome: step(outcome.target), **FIT)
    fitted = iter(outcomes)
    opened = []
    for name in names:
        state.begin(name)
        with state.passing_over(name, names):
            opened.append(model_named(name) if _is_model(name) else _model_of(next(fitted)))
    state.begin("")
    return [model for model in opened if model is not None]


def _model_of(outcome: batch.Outcome) -> DSBRDF:
    """The model of an outcome; raises what went wrong."""
    if outcome.model is None:
        raise outcome.error or ValueError(outcome.status)
    return outcome.model


def _is_model(name: str) -> bool:
    """Whether this is a model file, or a material of a library file or of the built-in library."""
    from dsbrdf.library import SUFFIX, names

    path = Path(name)
    is_built_in = not path.exists() and name in names()
    return is_built_in or path.suffix.lower() == ".json" or path.parent.suffix.lower() == SUFFIX


def _load(path: str | None) -> MaterialSpace:
    from dsbrdf.space import builtin, load_space

    path = path or (str(DEFAULT) if DEFAULT.exists() else LIBRARY)
    if path == LIBRARY:
        return builtin()
    if not Path(path).exists():
        raise FileNotFoundError(f"{path}: there is no space yet. Make one with 'dsbrdf space build'.")
    return load_space(path)


def _material(made: MaterialSpace, name: str) -> DSBRDF:
    from dsbrdf.model import file as model_file

    if name in made.names and not Path(name).exists():
        return made.material(name)
    if not Path(name).exists():
        raise FileNotFoundError(
            f"{name}: neither a file nor one of the {len(made.names)} materials of the space."
        )
    return model_file.load(name)


def _stem(name: str) -> str:
    return _files.file_name("-".join(name.replace("%", "").split()))


def _write(model: DSBRDF, out: Path | None, *inputs: str, force: bool) -> None:
    path = out or Path(f"{_stem(model.name)}.json")
    check_output(path, inputs, force=force)
    check_folder(path.parent)
    model.save(path)
    tell(path)
