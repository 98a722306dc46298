"""Models on disk: one JSON file a material, numbers at full precision, with a schema version."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files, _json
from dsbrdf.geometry.half_diff import AZIMUTHAL_WIDTH
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.source import Source
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.lobes import Lobes, check_stored

__all__ = ["SCHEMA", "ModelFormatError", "dumps", "load", "loads", "models_in", "records", "save"]

#: Version of the layout; every later version of the package reads it.
SCHEMA = 1
FORMAT = "dsbrdf model"
LOBES = ("scale", "gamma", "beta", "falloff", "colour")
WIDTH = "azimuthal_width"
PROFILE = ("theta_d", "theta_h", "mean", "amplitude")
#: Digits of angles and of values of the profile, which is there for plots.
PROFILE_DIGITS = {"theta_d": 5, "theta_h": 5, "mean": 3, "amplitude": 2}
#: Greatest number of a profile: pages hold single precision.
MAX_PROFILE = 1e30
#: Larger files are no models of ours.
MAX_BYTES = 50_000_000
#: A longer name would stop every table and figure that shows it.
MAX_LETTERS = 1000


class ModelFormatError(ValueError):
    """A file is not a model file that this version can read."""


def save(model: DSBRDF, path: str | Path) -> None:
    """Write `model` to `path`; it is written aside and renamed.

    Raises
    ------
    OSError
        If the file cannot be written.
    TypeError
        If the parameters carry gradients and have no values.
    """
    with _files.aside(path) as part:
        part.write_text(dumps(model), encoding="utf-8")


def dumps(model: DSBRDF) -> str:
    """The text of a model file; errors as `save`."""
    lobes = model.lobes.numpy
    content: dict[str, Any] = {
        "format": FORMAT,
        "schema": SCHEMA,
        "name": model.name,
        "units": "radians; 1/sr without the cosine",
        "formula": "sum over lobes of expm1(kappa cos(theta_h)^gamma) cos(theta_h)^falloff exp(beta g cos(2 phi_d)); "
        "ln(kappa) = scale + colour, ln(gamma), beta and falloff are curves over cos(theta_d)",
        WIDTH: AZIMUTHAL_WIDTH,
        "channels": list(model.channels),
        "lobes": {key: getattr(lobes, key).tolist() for key in LOBES},
        "source": model.source.to_json(),
        "fit": dict(model.fit_options),
        "errors": {key: value if np.isfinite(value) else None for key, value in model.errors.items()},
    }
    if model.profile is not None:
        content["profile"] = _profile_to_json(model.profile)
    return _to_text(content) + "\n"


def _to_text(content: dict[str, Any]) -> str:
    """JSON with a line for each row of an array."""
    entries = []
    for key, value in content.items():
        if isinstance(value, list):
            text = "[\n  " + ",\n  ".join(json.dumps(row, default=_plain) for row in value) + "\n ]"
        elif isinstance(value, dict):
            text = _to_text(value).replace("\n", "\n ") if value else "{}"
        else:
            text = json.dumps(value, default=_plain)
        entries.append(f"\n {json.dumps(key)}: {text}")
    return "{" + ",".join(entries) + "\n}"


def _profile_to_json(profile: MeasuredProfile) -> dict[str, Any]:
    """Rounded numbers, None for NaN; the amplitude only where there is one, theta_h once if all slices share it."""
    theta_h = profile.theta_h
    arrays = {
        "theta_d": profile.theta_d,
        "theta_h": theta_h[:1] if (theta_h == theta_h[0]).all() else theta_h,
        "mean": profile.mean,
        "amplitude": profile.amplitude,
    }
    return {key: _rounded(array.tolist(), PROFILE_DIGITS[key]) for key, array in arrays.items()}


def _rounded(values: Any, digits: int) -> Any:
    if isinstance(values, list):
        return [_rounded(value, digits) for value in values]
    return float(f"{values:.{digits}g}") if math.isfinite(values) else None


def _profile_from_json(content: dict[str, Any]) -> MeasuredProfile:
    arrays = {name: _numbers(content, name) for name in PROFILE}
    theta_h = np.broadcast_to(arrays["theta_h"], (len(arrays["theta_d"]), arrays["theta_h"].shape[-1]))
    for name, array in arrays.items():
        if (np.abs(array) > MAX_PROFILE).any():
            raise ValueError(
                f"'{name}' of the profile must be within {MAX_PROFILE:g}, got {np.nanmax(np.abs(array)):g}."
            )
    return MeasuredProfile(**(arrays | {"theta_h": theta_h}))


def _plain(value: Any) -> Any:
    """A number or array of NumPy as one of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not fit into JSON")


def models_in(folder: Path) -> list[Path]:
    """The model files of a folder, by name, without records of batches, whose names begin with a point."""
    return sorted(folder.glob("[!.]*.json"))


def load(path: str | Path) -> DSBRDF:
    """Read a model file.

    Raises
    ------
    ModelFormatError
        If the content is not a model, or one of a later schema; says what was expected and found.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import dsbrdf, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "nickel.json")
    ...     dsbrdf.library.load("nickel").save(path)
    ...     model = dsbrdf.load(path)
    >>> model.name
    'nickel'
    """
    path = Path(path)
    size = _files.regular_size(path)
    if size > MAX_BYTES:
        raise ModelFormatError(f"{path}: not a model file: {size:,} bytes are more than any model has.")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ModelFormatError(f"{path}: not a model file: not JSON ({error}).") from None
    return loads(text, str(path))


def loads(text: str, path: str = "model") -> DSBRDF:
    """The model of a text that is, or would be, at `path`; errors as `load`."""
    try:
        content = _json.parse(text)
    except ValueError as error:
        raise ModelFormatError(f"{path}: not a model file: {error}.") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ModelFormatError(f'{path}: not a model file: expected "format": "{FORMAT}".')
    schema = content.get("schema")
    if type(schema) is not int or schema != SCHEMA:
        raise ModelFormatError(
            f"{path}: schema {schema!r:.40} is not among those this version reads ({SCHEMA}). Update dsbrdf."
        )
    if content.get(WIDTH, AZIMUTHAL_WIDTH) != AZIMUTHAL_WIDTH:
        raise ModelFormatError(
            f"{path}: an azimuthal width of {content[WIDTH]!r:.40}, where this version has {AZIMUTHAL_WIDTH}. "
            "Fit the material again."
        )
    try:
        source, options, errors = records(content)
        name, channels = str(content.get("name") or ""), [str(name) for name in content["channels"]]
        if (longest := max(map(len, [name, *channels]))) > MAX_LETTERS:
            raise ValueError(f"a name has {longest:,} letters, expected at most {MAX_LETTERS:,}.")
        lobes = Lobes(**{key: _numbers(content["lobes"], key) for key in LOBES})
        check_stored(lobes)
        return DSBRDF(
            lobes,
            channels,
            name=name,
            source=Source(description=str(source.get("description", "")), recorded=source),
            fit_options=options,
            errors=errors,
            profile=_profile_from_json(content["profile"]) if content.get("profile") else None,
        )
    except KeyError as error:
        raise ModelFormatError(f"{path}: not a whole model file: {error} is missing.") from None
    except (TypeError, ValueError, IndexError, OverflowError, RecursionError) as error:
        raise ModelFormatError(f"{path}: not a sound model: {error}") from None


def records(content: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any], dict[str, float]]:
    """What a file says of the source of a model, the options of its fit, and its errors.

    Raises
    ------
    TypeError, ValueError
        If it is no object, or holds what later commands would stumble on.
    """
    source, options, errors = (content.get(key) or {} for key in ("source", "fit", "errors"))
    for key, value in (("source", source), ("fit", options), ("errors", errors)):
        if not isinstance(value, dict):
            raise TypeError(f'"{key}" must be an object, got {value!r:.40}.')
        _json.check_plain(value, key)
    return source, options, {key: np.nan if value is None else float(value) for key, value in errors.items()}


def _numbers(content: dict[str, Any], key: str) -> NDArray[np.float64]:
    """Array of an entry; NumPy alone would take text and booleans for numbers."""
    array = np.array(content[key], dtype=np.float64)
    _refuse_other_than_numbers(content[key], key)
    return array


def _refuse_other_than_numbers(value: Any, key: str) -> None:
    for item in value if isinstance(value, list) else [value]:
        if isinstance(item, list):
            _refuse_other_than_numbers(item, key)
        elif item is not None and type(item) not in (int, float):
            raise TypeError(f"'{key}' must hold numbers, got {item!r:.40}.")
