"""BiRD JSON, the format that the European metrology project BiRD agreed on, read and written.

`data` holds a column for each variable: an object with its `unit` and `values` (schema 1.0), or, in older files, a
list of
`variables` and `values` line by line. The schema is at https://github.com/BiRD-project/BiRD_view. Azimuths are of both
directions, as everywhere here.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files, _json
from dsbrdf.measured.names import meaning
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns
from dsbrdf.measured.source import Source

__all__ = ["is_bird", "read_bird", "write_bird"]

MAX_BYTES = 200_000_000
#: Numbers of all columns; one with a single value is repeated.
MAX_NUMBERS = 50_000_000
#: Commas and brackets, those of rows of few values too.
MAX_MARKS = 3 * MAX_NUMBERS
_POLARISATION = ("polarization", "polarisation")


def is_bird(head: bytes) -> bool:
    """Whether a file with this head may be BiRD JSON."""
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    return (
        text.startswith(b"{")
        and b'"dsbrdf' not in head
        and any(word in head for word in (b'"BRDF"', b'"theta_i"', b'"variables"', b'"data"', b'"metadata"'))
    )


def read_bird(path: str | Path, options: ReadOptions | None = None) -> Samples:
    """Read a BiRD JSON file.

    Parameters
    ----------
    path : str or Path
    options : ReadOptions, optional

    Returns
    -------
    Samples
        Wavelengths are channels; uncertainties are weights.

    Raises
    ------
    ValueError
        If it is no such file.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: not BiRD JSON: more than {MAX_BYTES:,} bytes.")
    try:
        content = _json.parse(path.read_text(encoding="utf-8-sig", errors="strict"), most=MAX_MARKS)
    except ValueError as error:
        raise ValueError(f"{path}: not sound JSON: {str(error)[:100]}.") from None
    data = content.get("data") if isinstance(content, dict) else None
    if not isinstance(data, dict):
        raise ValueError(
            f"{path}: not BiRD JSON: expected an object 'data' of columns. A model file is read by "
            f"dsbrdf.load."
        )
    try:
        columns, remarks = _rows(data) if isinstance(data.get("variables"), list) else _columns(data)
    except (TypeError, KeyError, AttributeError, IndexError, OverflowError) as error:
        raise ValueError(f"{path}: not sound BiRD JSON: {type(error).__name__} {str(error)[:80]}.") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return samples_from_columns(columns, path.stem, Source(path), options, remarks=("BiRD JSON", *remarks))


def _rows(data: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Columns of older files, with values line by line."""
    named: dict[str, Any] = {}
    table = data["values"]
    for i, variable in enumerate(data["variables"]):
        values = [row[i] for row in table]
        named[str(variable["name"])] = {"unit": variable.get("unit", ""), "values": values}
    return _columns(named)


def _columns(data: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    columns: dict[str, Any] = {}
    remarks: list[str] = []
    n = max(
        (
            len(v["values"])
            for v in data.values()
            if isinstance(v, dict) and isinstance(v.get("values"), list)
        ),
        default=0,
    )
    if not n:
        raise ValueError(f"not BiRD JSON: no column with values, got {', '.join(map(str, data)):.100}.")
    if n * len(data) > MAX_NUMBERS:
        raise ValueError(
            f"not BiRD JSON: {len(data):,} columns of {n:,} values are more than any measurement has."
        )
    waves = [name for name in data if str(name).lower().startswith("wavelength")]
    for name, variable in data.items():
        if not isinstance(variable, dict) or not isinstance(variable.get("values"), list):
            continue
        values = variable["values"]
        if str(name).lower().startswith(_POLARISATION):
            states = sorted({json.dumps(state) for state in values})
            if len(states) > 1:
                raise ValueError(
                    f"{name}: {len(states)} states of polarisation, {', '.join(states):.80}. Split "
                    f"the file by them."
                )
            remarks.append(f"{name} {', '.join(states)} throughout")
            continue
        if name in waves[1:] and values == data[waves[0]]["values"]:
            continue
        if len(values) == 1 and n > 1:
            values = values * n
        label = "wavelength" if name in waves else str(name)
        unit = str(variable.get("unit", ""))
        column = np.array([np.nan if value is None else value for value in values], dtype=float)
        columns[f"{label} [{unit}]" if unit else label] = column
        spread = variable.get("uncertainty")
        if meaning(str(name)).kind == "channel" and isinstance(spread, dict) and spread.get("value"):
            columns[f"std [{spread.get('unit', '')}]"] = np.full(n, float(spread["value"]))
    if len({len(column) for column in columns.values()}) > 1:
        raise ValueError(
            f"not sound BiRD JSON: columns of {sorted({len(c) for c in columns.values()})} values."
        )
    return columns, remarks


def write_bird(samples: Samples, path: str | Path) -> None:
    """Write samples as BiRD JSON, one wavelength after the other.

    Parameters
    ----------
    samples : Samples
        Of one channel, or of wavelengths. Weights are written as the uncertainties that they come of.
    path : str or Path

    Raises
    ------
    ValueError
        If there are several channels that are no wavelengths, which this format does not know.
    OSError
        If the file cannot be written.
    """
    from dsbrdf.geometry.colour import wavelength
    from dsbrdf.measured.samples import std_of_weights

    names = list(samples.channels) or [""] * samples.n_channels
    waves = [wavelength(name) for name in names]
    if len(names) > 1 and None in waves:
        raise ValueError(
            f"{path}: BiRD JSON holds one channel or wavelengths, got {', '.join(names):.100}. Use .csv or .npz."
        )
    n, k = samples.values.shape
    angles = {
        name: np.tile(angle, k)
        for side, w in (("i", samples.wi), ("r", samples.wo))
        for name, angle in (
            (f"theta_{side}", np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])),
            (f"phi_{side}", np.arctan2(w[:, 1], w[:, 0]) % (2.0 * np.pi)),
        )
    }
    valid = np.isfinite(samples.values).T.ravel()
    data: dict[str, Any] = {
        name: {"unit": "rad", "values": angle[valid].tolist()} for name, angle in angles.items()
    }
    data["BRDF"] = {"unit": "1/sr", "values": samples.values.T.ravel()[valid].tolist()}
    if samples.weights is not None:
        std = np.tile(std_of_weights(samples), k)
        data["uBRDF"] = {"unit": "1/sr", "values": std[valid].tolist()}
    if waves[0] is not None:
        nm = np.repeat(np.array(waves, dtype=float), n)
        data["wavelength_i"] = {"unit": "nm", "values": nm[valid].tolist()}
    metadata = {"type": "measured", "sample": {"name": samples.name}}
    with _files.aside(path) as part:
        part.write_text(json.dumps({"metadata": metadata, "data": data}), encoding="utf-8")
