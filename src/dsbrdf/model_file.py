"""Models on disk: one JSON file a material, numbers at full precision, with a schema version."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.measured.brdf import Source
from dsbrdf.model import DSBRDF

__all__ = ["SCHEMA", "ModelFormatError", "load", "save"]

#: Version of the layout; every later version of the package reads it.
SCHEMA = 1
FORMAT = "dsbrdf model"
PARAMETERS = ("theta_d", "kappa", "gamma", "beta")
#: May be missing: there was none in the first files of schema 1.
SPIKE = "spike"
#: Larger files are no models of ours.
MAX_BYTES = 50_000_000


class ModelFormatError(ValueError):
    """A file is not a model file that this version can read."""


def save(model: DSBRDF, path: str | Path) -> None:
    """Write `model` to `path`; it is written aside and renamed.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    content: dict[str, Any] = {
        "format": FORMAT,
        "schema": SCHEMA,
        "name": model.name,
        "units": "radians; 1/sr without the cosine; arrays are (theta_d, channel, lobe), "
        "spike (theta_d, channel)",
        **{key: np.asarray(getattr(model, key), dtype=float).tolist() for key in (*PARAMETERS, SPIKE)},
        "source": model.source.to_json(),
        "fit": dict(model.fit_options),
        "errors": {key: value if np.isfinite(value) else None for key, value in model.errors.items()},
    }
    with _files.aside(path) as part:
        part.write_text(json.dumps(content, indent=1, default=_plain) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """A number or array of NumPy as one of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not fit into JSON")


def load(path: str | Path) -> DSBRDF:
    """Read a model file.

    Raises
    ------
    ModelFormatError
        If the content is not a model, or one of a later schema; says what was expected and found.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ModelFormatError(f"{path}: not a model file: {size:,} bytes are more than any model has.")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    # A ValueError also comes of a number with thousands of digits
    except (ValueError, RecursionError) as error:
        raise ModelFormatError(f"{path}: not a model file: not JSON ({error}).") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ModelFormatError(f'{path}: not a model file: expected "format": "{FORMAT}".')
    schema = content.get("schema")
    if not isinstance(schema, int) or not 1 <= schema <= SCHEMA:
        raise ModelFormatError(
            f"{path}: schema {schema!r} is not among those this version reads (1 to {SCHEMA}). Update dsbrdf."
        )
    source, options, errors = (content.get(key) or {} for key in ("source", "fit", "errors"))
    for key, value in (("source", source), ("fit", options), ("errors", errors)):
        if not isinstance(value, dict):
            raise ModelFormatError(
                f'{path}: not a sound model: "{key}" must be an object, got {value!r:.40}.'
            )
    try:
        return DSBRDF(
            **{key: np.array(content[key], dtype=np.float64) for key in PARAMETERS},
            spike=np.array(content[SPIKE], dtype=np.float64) if SPIKE in content else None,
            name=str(content.get("name") or ""),
            source=Source(description=str(source.get("description", "")), recorded=source),
            fit_options=options,
            errors={key: np.nan if value is None else float(value) for key, value in errors.items()},
        )
    except KeyError as error:
        raise ModelFormatError(f"{path}: not a whole model file: {error} is missing.") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelFormatError(f"{path}: not a sound model: {error}") from None
