"""Tables of columns in memory: pandas and polars frames, xarray datasets, mappings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.samples import Samples, samples_from_columns

__all__ = ["read_frame"]


def read_frame(table: Any, options: ReadOptions | None = None) -> Samples:
    """Samples of a table in memory.

    Parameters
    ----------
    table : mapping, pandas or polars DataFrame, xarray Dataset or DataArray
        Columns named as in text. The coordinates of a Dataset are columns too, and its variables go over all of them; a
        DataArray without a name is called `value`.
    options : ReadOptions, optional

    Returns
    -------
    Samples

    Raises
    ------
    TypeError
        If it is none of these.
    ValueError
        As `samples_from_columns`.
    """
    name = str(getattr(table, "attrs", {}).get("name", "") or "")
    if hasattr(table, "to_dataframe"):
        if not hasattr(table, "data_vars"):
            table = table.to_dataset(name=table.name or "value")
        table = table.to_dataframe().reset_index()
    if hasattr(table, "columns") and hasattr(table, "to_dict"):
        columns = {str(key): np.asarray(table[key]) for key in table.columns}
    elif isinstance(table, Mapping):
        columns = {str(key): np.asarray(value) for key, value in table.items()}
    else:
        raise TypeError(
            f"expected a path, a DataFrame, an xarray Dataset or a mapping of columns, got {type(table).__name__}."
        )
    ignored = {key.strip().lower() for key in (options or ReadOptions()).ignore}
    for key, column in columns.items():
        if column.dtype.kind not in "biufO" or column.ndim != 1:
            if key.strip().lower() in ignored:
                columns[key] = np.full(len(column), np.nan)
                continue
            raise ValueError(
                f"{name or 'table'}: column {key} must be numbers (n,), got {column.dtype} {column.shape}."
            )
    try:
        numbers = {key: np.asarray(column, dtype=float) for key, column in columns.items()}
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name or 'table'}: not numbers: {error}.") from None
    return samples_from_columns(numbers, name, options=options)
