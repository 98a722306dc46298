"""One HTML file from models: a template, its style, its script, shaders and numbers."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dsbrdf import _check, _files, shader
from dsbrdf.geometry import half_diff
from dsbrdf.model import components, evaluation, lobes, sampling, sphere
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.space import variables
from dsbrdf.view import data, layout
from dsbrdf.view.script import minified

if TYPE_CHECKING:
    from dsbrdf.space import MaterialSpace

__all__ = ["constants", "frame", "page", "view"]

#: A page of a hundred materials is to stay below; what was measured gives way.
MAX_BYTES = 1_000_000
#: Places in the template.
_MARK = re.compile(r"(?:/\*|<!--)\{(\w+)\}(?:\*/|-->)")
#: For what is not counted before: a few constants.
RESERVE = 5_000
#: Shaders that the page also offers as a download.
KEPT = ("constants", "dsbrdf")


def view(models: DSBRDF | Sequence[DSBRDF], path: str | Path, *, space: MaterialSpace | None = None) -> None:
    """Write a page that shows models; it opens from disk, without a network.

    Parameters
    ----------
    models : DSBRDF or sequence of DSBRDF
        With any number of channels; three are shown as red, green and blue.
    path : str or Path
        The HTML file.
    space : MaterialSpace, optional
        Where materials lie on the map; by default by the likeness of their reflectance.

    Raises
    ------
    ValueError
        If there is no model, or one does not go into `space`.
    OSError
        If the file cannot be written; then nothing is left of it.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "page.html")
    ...     dsbrdf.view.view(dsbrdf.library.load("nickel"), path)
    ...     path.read_text(encoding="utf-8")[:15]
    '<!doctype html>'
    """
    text = page(models, space=space)
    with _files.aside(path) as part:
        part.write_text(text, encoding="utf-8")


def page(models: DSBRDF | Sequence[DSBRDF], *, space: MaterialSpace | None = None) -> str:
    """The text of the page; see `view`.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.view.page(dsbrdf.library.load("nickel"))[:15]
    '<!doctype html>'
    """
    models = [models] if not isinstance(models, Iterable) or isinstance(models, str) else list(models)
    for model in models:
        _check.instance(model, DSBRDF, "models")
    models = _named(models)
    if not models:
        raise ValueError("'models' must hold at least one model, got none.")
    # Marks and what comes between them, so that nothing that is put in is searched for marks
    pieces = _MARK.split(_read("template.html"))
    parts = {"style": _read("style.css"), "script": minified(), "shaders": _json(_shaders())}
    fixed = sum(len(part.encode()) for part in (*pieces[::2], *parts.values()))
    places = layout.place(models, space)
    numbers = None if places is None else np.hstack([places.at, places.coordinates])
    packed = data.pack(models, MAX_BYTES - RESERVE - fixed, numbers)
    parts |= {
        "meta": _json(_meta(places, space is not None)),
        "materials": packed.materials,
        "floats": packed.floats,
        "words": packed.words,
        "about": html.escape(_about(packed)),
    }
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))


def frame(models: DSBRDF | Sequence[DSBRDF], *, space: MaterialSpace | None = None, height: int = 860) -> str:
    """The page inside a frame of some height in pixels, as HTML for a notebook; see `view`.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.view.frame(dsbrdf.library.load("nickel"), height=400)[:7]
    '<iframe'
    """
    return (
        f'<iframe srcdoc="{html.escape(page(models, space=space))}" title="dsbrdf" allow="clipboard-write" '
        f'style="width: 100%; height: {height}px; border: 0"></iframe>'
    )


def _named(models: Sequence[DSBRDF]) -> list[DSBRDF]:
    """Models with a name each, no two alike."""
    seen: dict[str, int] = {}
    named = []
    for model in models:
        name = model.name or "unnamed"
        seen[name] = seen.get(name, 0) + 1
        named.append(model.replace(name=name if seen[name] == 1 else f"{name} ({seen[name]})"))
    return named


def _shaders() -> dict[str, str]:
    """Sources of the shaders; what is offered as a download keeps its comments."""
    import rjsmin

    return {name: text if name in KEPT else rjsmin.jsmin(text) for name, text in shader.sources().items()}


def _meta(places: layout.Places | None, in_space: bool) -> dict[str, Any]:
    return {
        "map": places
        and {
            "coordinates": places.coordinates.shape[1],
            "about": places.about,
            "distance": places.distance,
            "scores": in_space,
        },
        "constants": constants(),
        "quantised": {"decades": data.DECADES, "steps": data.STEPS, "ratioSteps": data.RATIO_STEPS},
        "lights": sphere.LIGHTS,
        "file": {
            "format": model_file.FORMAT,
            "schema": model_file.SCHEMA,
            model_file.WIDTH: half_diff.AZIMUTHAL_WIDTH,
        },
    }


def constants() -> dict[str, Any]:
    """What the scripts need of the package's constants."""
    return {
        "azimuthalWidth": half_diff.AZIMUTHAL_WIDTH,
        "maxLnKappa": lobes.MAX_LN_KAPPA,
        "maxFactor": evaluation.MAX_FACTOR,
        "dark": variables.DARK,
        "heights": variables.HEIGHT,
        "nRows": sampling.N_ROWS,
        "minCosineShare": sampling.MIN_COSINE_SHARE,
        "powers": sampling.POWERS.tolist(),
        "emSteps": sampling.EM_STEPS,
        "emPower": sampling.EM_POWER,
        "widths": {
            "spike": components.SPIKE_WIDTH,
            "specular": components.SPECULAR_WIDTH,
            "glossy": components.BODY_WIDTH,
        },
    }


def _about(packed: data.Packed) -> str:
    """What the page is, and what the numbers in it have lost."""
    from dsbrdf import __version__

    rounding = f"rounded to {100 * data.ROUNDING:.2f} %"
    measured = {
        None: "",
        0: "Measured points are left out, to keep the page small.",
        1: f"Measured points are {rounding}.",
    }.get(packed.thinning, f"Of the measured points, one in {packed.thinning} is here, {rounding}.")
    return f"Written by dsbrdf {__version__}. Parameters are in single precision. {measured}".rstrip()


def _read(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _json(value: Any) -> str:
    """JSON that may stand inside a script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
