"""What `dsbrdf render` shows of a material: the table, fits with 1, 2, ... lobes, each lobe, other models."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dsbrdf import baselines, batch
from dsbrdf.fitting import ConvergenceWarning, fit
from dsbrdf.library import model_named
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.render import picture, quality
from dsbrdf.render.picture import Row, Tile
from dsbrdf.render.scene import Reflectance, View, check_channels, render

__all__ = [
    "Subject",
    "competitors",
    "fits",
    "model_subjects",
    "open_subjects",
    "quiet_fit",
    "render_row",
    "table_subjects",
]


@dataclass(frozen=True, eq=False)
class Subject:
    """A reflectance to be rendered.

    Parameters
    ----------
    title : str
    reflectance : Reflectance
        Anything with `eval`.
    whole : bool
        Whether it stands for the whole material, so that it is compared with the first of its row.
    """

    title: str
    reflectance: Reflectance
    whole: bool = True


def open_subjects(target: str, *, loss: str, lobes: bool, compare: bool) -> tuple[str, list[Subject]]:
    """Name and subjects of a model file, a material of the library, a measured file or a built-in material.

    Raises
    ------
    ValueError
        If it is none of these, or scattered samples, or has other channels than one or three.
    OSError
        If the file cannot be read.
    """
    model = model_named(target)
    if model is not None:
        check_channels(model, target)
        return model.name or Path(target).stem, model_subjects(model, lobes=lobes)
    measured = batch.open_target(target)
    if not isinstance(measured, MeasuredBRDF):
        raise ValueError(f"{target}: scattered samples cannot be rendered. Fit them, and render the model.")
    check_channels(measured, target)
    return measured.name, table_subjects(measured, loss=loss, lobes=lobes, compare=compare)


def quiet_fit(measured: MeasuredBRDF, n_lobes: int | str, loss: str) -> DSBRDF:
    """Model of a table; that the search runs out of iterations is not told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return fit(measured, n_lobes, loss=loss).model


def fits(measured: MeasuredBRDF, n_lobes: int, loss: str) -> list[Subject]:
    """The fits with 1 to `n_lobes` lobes."""
    return [Subject(_count(k), quiet_fit(measured, k, loss)) for k in range(1, n_lobes + 1)]


def model_subjects(model: DSBRDF, *, lobes: bool) -> list[Subject]:
    """A model, and each of its lobes."""
    parts = range(model.n_lobes) if lobes and model.n_lobes > 1 else ()
    return [Subject(_count(model.n_lobes), model)] + [
        Subject(f"lobe {k} alone", model.lobe(k), whole=False) for k in parts
    ]


def table_subjects(
    measured: MeasuredBRDF, n_lobes: int | str = "auto", *, loss: str = "log", lobes: bool, compare: bool
) -> list[Subject]:
    """A table and its fit; with `lobes` also fits with fewer, and each lobe; with `compare` other models."""
    model = quiet_fit(measured, n_lobes, loss)
    fewer = fits(measured, model.n_lobes - 1, loss) if lobes else []
    others = competitors(measured) if compare else []
    return [Subject("measured", measured), *fewer, *model_subjects(model, lobes=lobes), *others]


def competitors(measured: MeasuredBRDF) -> list[Subject]:
    """The bivariate table, and Lambert with two and with one GGX lobe."""
    fits = (baselines.fit_bivariate, baselines.fit_ggx_pair, baselines.fit_lambert_ggx)
    return [Subject(model.label, model) for model in (fit_one(measured) for fit_one in fits)]


def render_row(
    title: str, subjects: list[Subject], view: View, step: Callable[[str], None] = lambda _: None
) -> Row:
    """Render the subjects, and compare each whole one with the first.

    Parameters
    ----------
    title : str
        Name of the material.
    subjects : list of Subject
    view : View
    step : callable, optional
        Told what comes next, once a subject.
    """
    tiles: list[Tile] = []
    for subject in subjects:
        step(f"{title}, {subject.title}")
        # One seed: the same noise in all, so that differences are of the reflectance
        image = render(subject.reflectance, view)
        if tiles and subject.whole:
            reference = tiles[0].image
            difference = quality.compare(image, reference, picture.exposure_of(reference))
            tiles.append(Tile(subject.title, image, difference))
        else:
            tiles.append(Tile(subject.title, image))
    return Row(title, tiles)


def _count(n_lobes: int) -> str:
    return f"{n_lobes} lobe{'s' * (n_lobes > 1)}"
