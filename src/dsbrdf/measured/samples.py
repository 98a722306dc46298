"""Scattered samples of a reflectance: values at pairs of directions that need not lie on any grid."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured import directions
from dsbrdf.measured.names import Meaning, meaning, wavelength_name
from dsbrdf.measured.options import ReadOptions
from dsbrdf.measured.plausible import doubts
from dsbrdf.measured.source import Source

Array: TypeAlias = NDArray[np.float64]
__all__ = ["SKIPPED", "ReadWarning", "Samples", "samples_from_columns", "std_of_weights"]

#: Name of a column to leave out.
SKIPPED = "-"
#: Relative standard deviation below which samples count alike.
LEAST_ERROR = 0.02
#: Below the horizon by no more than rounding.
_ROUNDING = 1e-9


class ReadWarning(UserWarning):
    """Samples were left out, or their numbers do not look like a BRDF in 1/sr in the convention of the package."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one isotropic reflectance at pairs of directions, in 1/sr and without the cosine.

    Parameters
    ----------
    wi, wo : (n, 3) array_like
        Unit vectors toward the light and the viewer, normal +z; none below the horizon.
    values : (n, channel) array_like
        In 1/sr. Infinite ones become NaN: invalid; and so do negative ones, unless `weights` are given.
    name : str, optional
    weights : (n,) array_like, optional
        How much the relative error of each sample counts; alike by default.
    channels : sequence of str, optional
        Names of the channels; r, g, b for three by default.
    source : Source, optional
    remarks : sequence of str, optional
        What a reader understood and took for granted, a sentence each.

    Raises
    ------
    ValueError
        If shapes disagree, there is no sample, a vector is not of unit length or below the horizon, or a
        weight is negative or not finite.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.Samples([[0.0, 0.0, 1.0]], [[0.6, 0.0, 0.8]], [[0.1, 0.2, 0.3]], name="one")
    Samples('one', 1 pairs of directions, 3 channels)
    """

    wi: Array
    wo: Array
    values: Array
    _: KW_ONLY
    name: str = ""
    weights: Array | None = None
    channels: Sequence[str] = ()
    source: Source = field(default_factory=Source)
    remarks: Sequence[str] = ()

    def __post_init__(self) -> None:
        values = np.array(_check.numbers(self.values, "values"))
        if values.ndim != 2 or values.size == 0:
            raise ValueError(
                f"'values' must have shape (n, channel) with a sample at least, got {values.shape}."
            )
        least = 0.0 if self.weights is None else -np.inf
        values[~((values >= least) & np.isfinite(values))] = np.nan
        object.__setattr__(self, "values", values)
        for name in ("wi", "wo"):
            vectors = _check.unit_vectors(getattr(self, name), name)
            if vectors.shape != (len(values), 3):
                raise ValueError(f"'{name}' must have shape ({len(values)}, 3), got {vectors.shape}.")
            below = np.flatnonzero(vectors[:, 2] < 0.0)
            if below.size:
                raise ValueError(
                    f"'{name}' must not lie below the horizon, got z = {vectors[below[0], 2]:g} at index "
                    f"{below[0]}. Light that passes through is not part of the model: leave these samples out."
                )
            object.__setattr__(self, name, vectors)
        if self.weights is not None:
            weights = _check.finite(self.weights, "weights", low=0.0)
            if weights.shape != (len(values),):
                raise ValueError(f"'weights' must have shape ({len(values)},), got {weights.shape}.")
            object.__setattr__(self, "weights", weights)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.values.shape[1])

    def __repr__(self) -> str:
        weighted = ", weighted" if self.weights is not None else ""
        return (
            f"Samples({self.name!r}, {len(self)} pairs of directions, {self.n_channels} channels{weighted})"
        )


def samples_from_columns(
    columns: Mapping[str, Any],
    name: str,
    source: Source | None = None,
    options: ReadOptions | None = None,
    *,
    lines: NDArray[np.int64] | None = None,
    remarks: Sequence[str] = (),
) -> Samples:
    """Scattered samples from named columns.

    Parameters
    ----------
    columns : mapping of str to (n,) array_like
        Directions, channels in 1/sr, uncertainties and wavelengths, told apart by their names: see `names.meaning` and
        the page on formats. A column that is none of these is refused, not guessed.
    name : str
    source : Source, optional
        Its file, if there is one, is named by errors.
    options : ReadOptions, optional
        What the caller says about the columns.
    lines : (n,) ndarray of int, optional
        Of the file, for errors.
    remarks : sequence of str, optional
        What the reader has to say.

    Returns
    -------
    Samples
        Without those that are below the horizon, have no direction, or that the caller does not keep.

    Raises
    ------
    ValueError
        If columns are missing, of no known meaning or unit, or as `Samples`.

    Warns
    -----
    ReadWarning
        If samples are left out, or the numbers do not look like a BRDF in 1/sr in this convention.

    Examples
    --------
    >>> angles = {"theta_i_deg": [30, 30], "theta_o_deg": [-30, 0]}
    >>> samples_from_columns(angles | {"650nm": [1.2, 0.2], "450nm": [1.1, 0.1]}, "paint").channels
    ('450nm', '650nm')
    """
    source = source or Source()
    options = options or ReadOptions()
    try:
        table = _Columns(columns, options, lines)
        wi, wo, values, weights = table.resolved()
        names = table.channels
        said = (*remarks, *table.remarks)
        samples = Samples(
            wi, wo, values, name=name, weights=weights, channels=names, source=source, remarks=said
        )
    except ValueError as error:
        raise ValueError(f"{source.file or name}: {error}") from None
    doubtful = doubts(
        samples.wi,
        samples.wo,
        samples.values,
        names,
        azimuth_is_known=options.phi_offset is not None,
        scale_is_known=options.scale is not None or options.cosine,
    )
    for text in (*table.left_out, *doubtful):
        warnings.warn(f"{name}: {text}", ReadWarning, stacklevel=2)
    return samples


def std_of_weights(samples: Samples) -> Array:
    """Standard deviations (n,) in 1/sr that the weights of samples come of."""
    values = np.where(np.isfinite(samples.values), np.abs(samples.values), 0.0)
    bright = values.sum(1) / np.maximum(np.isfinite(samples.values).sum(1), 1)
    weights = np.ones(len(samples)) if samples.weights is None else samples.weights
    share = LEAST_ERROR * np.sqrt(np.maximum(1.0 / np.clip(weights, 1e-12, 1.0) - 1.0, 1e-12))
    std: Array = np.maximum(share * bright, np.finfo(float).tiny)
    return std


class _Columns:
    """Columns sorted by what they mean, and what becomes of them."""

    def __init__(
        self, columns: Mapping[str, Any], options: ReadOptions, lines: NDArray[np.int64] | None
    ) -> None:
        self.options = options
        self.lines = lines
        self.remarks: list[str] = []
        self.left_out: list[str] = []
        self.listed = f"the columns {', '.join(columns):.200}" if columns else "none"
        self.labels: dict[str, str] = {}
        self.angles: dict[str, Array] = {}
        self.units: dict[str, str] = {}
        self.vectors: dict[str, Array] = {}
        self.values: dict[str, Array] = {}
        self.spread: dict[str, tuple[Array, str]] = {}
        self.weight: Array | None = None
        self.wavelength: Array | None = None
        arrays = {label: np.asarray(column, float) for label, column in columns.items()}
        lengths = {len(array) for array in arrays.values()}
        if len(lengths) > 1:
            raise ValueError(f"columns must be of one length, got {', '.join(map(str, sorted(lengths)))}.")
        self.n = lengths.pop() if lengths else 0
        arrays = self._without(arrays)
        arrays |= {label: np.full(self.n, value) for label, value in options.set.items()}
        found = {label: self._meaning(label) for label in arrays}
        # f_r is the BRDF, unless f_g and f_b are there
        split = {f.key: f for f in found.values() if f.kind == "channel"}
        for label, means in found.items():
            if means.kind == "channel" and means.key in ("f_r", "fr") and {"g", "b"} <= set(split):
                found[label] = Meaning("channel", "r", means.unit)
        for label, means in found.items():
            self._sort(label, means, arrays[label])
        self._order_channels()

    def _without(self, arrays: dict[str, Array]) -> dict[str, Array]:
        """The columns that are not to be ignored."""
        folded = {label.strip().strip("\"'").lower(): label for label in arrays}
        for name in self.options.ignore:
            if (label := folded.get(name.strip().lower())) is None:
                raise ValueError(f"there is no column {name!r} to ignore; got {self.listed}.")
            arrays.pop(label, None)
        return {label: array for label, array in arrays.items() if label.strip() != SKIPPED}

    def _meaning(self, label: str) -> Meaning:
        means = meaning(label)
        if means.kind == "unknown" and self.options.columns is not None and label in self.options.columns:
            return Meaning("channel", label.strip())
        return means

    def _sort(self, label: str, means: Meaning, array: Array) -> None:
        match means.kind:
            case "angle":
                self._once(self.angles, means.key, label)
                self.angles[means.key], self.units[means.key] = array, means.unit
            case "vector":
                self._once(self.vectors, means.key, label)
                self.vectors[means.key] = array
            case "wavelength":
                self._once({} if self.wavelength is None else {"wavelength": 1}, "wavelength", label)
                self.wavelength = self._nanometres(array, means.unit, label)
            case "weight":
                self._once({} if self.weight is None else {"weight": 1}, "weight", label)
                self.weight = array
            case "std":
                self._once(self.spread, means.key, label, "std")
                self.spread[means.key] = (array, means.unit)
            case "channel" | "factor" | "cosine":
                self._check_unit(label, means)
                self._once(self.values, means.key, label, "value")
                self.values[means.key] = array
            case "index" if self._counts(array, label):
                if np.isfinite(array).any():
                    what = f"column {label!r}" if label.strip() else "a column without a name"
                    self.remarks.append(f"{what} counts the lines, and is left out")
            case _:
                self._refuse(label, means)

    def _once(self, there: Mapping[str, Any], key: str, label: str, what: str = "") -> None:
        name = f"{what} {key}".strip()
        if key in there:
            raise ValueError(
                f"column {label} is there twice: {self.labels.get(name, key)} means the same. Leave one out with "
                f"ignore=['{label}'] (--ignore {label}), or as '-' among columns=[...] (--columns)."
            )
        self.labels[name] = label

    def _counts(self, array: Array, label: str) -> bool:
        """Whether a column that may be an index is one, or holds nothing."""
        if np.isnan(array).all():
            return not label.strip() or label.startswith("Unnamed:")
        steps = np.diff(array)
        return bool(len(array) > 1 and array[0] in (0.0, 1.0) and (steps == 1.0).all())

    def _refuse(self, label: str, means: Meaning) -> None:
        name = label.strip() or "without a name"
        why = {
            "transmitted": "holds transmitted light, which is not part of the model",
            "index": "looks like a number of lines, not like a reflectance",
            "other": "is no reflectance",
        }.get(means.kind, "is of no known meaning")
        quoted = label.strip() or '""'
        remedy = f"ignore=['{label.strip()}'] (--ignore {quoted})"
        raise ValueError(
            f"column {name} {why}. Leave it out with {remedy}, or name all columns, with '-' for one to leave out, by "
            f"columns=[...] (--columns): any other name in it is a channel in 1/sr; got {self.listed}."
        )

    def _check_unit(self, label: str, means: Meaning) -> None:
        """Values that are not in 1/sr need a scale, or the cosine divided out."""
        if self.options.scale is not None:
            return
        if means.kind == "factor":
            raise ValueError(
                f"column {label} is not a BRDF in 1/sr by its name. A reflectance factor is pi times that: say "
                "scale=0.3183 (--scale 0.3183), or scale=1 if it is in 1/sr."
            )
        if means.kind == "cosine" and not self.options.cosine:
            raise ValueError(f"column {label} holds the cosine by its name: say cosine=True (--cosine).")
        if means.unit == "percent":
            raise ValueError(
                f"column {label} is in percent, not in 1/sr: for a reflectance factor say scale=0.003183 "
                f"(--scale 0.003183)."
            )
        if means.unit:
            raise ValueError(
                f"column {label} is in {means.unit:.30}, not in 1/sr: say by which factor it becomes so, "
                f"scale=... (--scale ...)."
            )

    def _nanometres(self, array: Array, unit: str, label: str) -> Array:
        nm = array * 1000.0 if unit == "um" or (not unit and np.nanmax(array, initial=0.0) < 20.0) else array
        bad = ~((nm >= 100.0) & (nm <= 20000.0)) & ~np.isnan(nm)
        if unit not in ("", "nm", "um") or bad.any():
            got = f"{array[bad][0]:g}" if bad.any() else f"the unit {unit}"
            raise ValueError(
                f"column {label} must hold wavelengths in nm or um, got {got}. Leave it out with ignore (--ignore)."
            )
        return nm

    def _order_channels(self) -> None:
        """Red, green, blue and X, Y, Z in this order, wavelengths ascending; no X or Z alone, which may be a place."""
        names = list(self.values)
        guessed = {key for key in names if len(self.labels[f"value {key}"].strip()) == 1}
        for group, what in ((("X", "Y", "Z"), "a tristimulus value"), (("r", "g", "b"), "a colour")):
            some = guessed & set(group)
            others = [key for key in names if key not in group]
            # Y alone is a luminance, and r alone a red; beside other values they may be places
            if some and not set(group) <= set(names) and (others or some & {"X", "Z"}):
                label = self.labels[f"value {min(some)}"]
                raise ValueError(
                    f"column {label} may be {what}, without the other two, or a place on the sample. Leave it out "
                    f"with ignore=['{label}'] (--ignore {label}), or call it value_{label}."
                )
        for order in (("r", "g", "b"), ("X", "Y", "Z")):
            if set(order) == set(names):
                names = list(order)
        if names and all(name.endswith("nm") and name[:-2].replace(".", "").isdigit() for name in names):
            names.sort(key=lambda name: float(name[:-2]))
        self.values = {name: self.values[name] for name in names}

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(self.values)

    def _at(self, index: int) -> str:
        """Where a sample stands."""
        return f"at index {index}" if self.lines is None else f"in line {self.lines[index]}"

    def resolved(self) -> tuple[Array, Array, Array, Array | None]:
        """Directions, values and weights."""
        if not self.values:
            raise ValueError(f"expected a column of values beside the directions; got {self.listed}.")
        wi, wo = self._directions()
        values = np.stack(list(self.values.values()), axis=-1)
        std = self._std(values)
        values, std = self._scaled(values, std, wo)
        weights = self._weights()
        rows = self._kept(wi, wo, values)
        waves = self.wavelength
        if not rows.all():
            wi, wo, values = wi[rows], wo[rows], values[rows]
            std, weights, waves = (None if x is None else x[rows] for x in (std, weights, waves))
        if waves is not None:
            wi, wo, values, std, weights = self._by_wavelength(wi, wo, values, std, weights, waves)
        if std is not None:
            # Relative variance, and no sample is better than the model can be
            seen = np.isfinite(values)
            bright = np.abs(np.where(seen, values, 0.0).sum(1)) / np.maximum(seen.sum(1), 1)
            weights = LEAST_ERROR**2 / ((std / np.maximum(bright, std)) ** 2 + LEAST_ERROR**2)
        return wi, wo, values, weights

    def _directions(self) -> tuple[Array, Array]:
        offset = self.options.phi_offset
        if self.vectors and not self.angles:
            wi, wo = directions.from_vectors(self.vectors)
        elif self.vectors:
            raise ValueError(
                "expected angles or vectors, got both. Leave one kind out with ignore=[...] (--ignore): "
                f"{', '.join(self.labels[key] for key in (*self.angles, *self.vectors))}."
            )
        else:
            angles, remark = directions.radians(self.angles, self.units, self.labels)
            self.remarks += [remark] if remark else []
            wi, wo, remark = directions.from_angles(angles, self.labels)
            self.remarks += [remark] if remark and not (offset and "azimuth" in remark) else []
        if offset:
            wo = directions.turned(wo, np.deg2rad(offset))
            self.remarks.append(f"the azimuth of the view is turned by {offset:g} degrees")
        wi, wo = np.broadcast_arrays(wi, wo)
        return wi, wo

    def _std(self, values: Array) -> Array | None:
        """Standard deviations (n,) over the channels of a sample."""
        if not self.spread:
            return None
        if self.weight is not None:
            raise ValueError(
                "expected a column weight or std, got both. Leave one out as '-', or with ignore (--ignore)."
            )
        squares = []
        for channel, (std, unit) in self.spread.items():
            label = self.labels[f"std {channel}".strip()]
            if channel and channel not in self.values:
                raise ValueError(
                    f"column {label} is the uncertainty of {channel}, which is not there; got {self.listed}."
                )
            # Where there is no value, none is needed
            std = np.where(np.isfinite(values).any(1) | np.isfinite(std), std, 1.0)
            bad = np.flatnonzero(~((std > 0.0) & np.isfinite(std)))
            if bad.size:
                raise ValueError(
                    f"'{label}' must be > 0 and finite, got {std[bad[0]]:g} {self._at(int(bad[0]))}. Leave the "
                    f"column out with "
                    f"ignore=['{label}'] (--ignore {label}), or the line."
                )
            if unit in ("percent", "relative"):
                column = [list(self.values).index(channel)] if channel else slice(None)
                share = std / (100.0 if unit == "percent" else 1.0)
                std = share * np.nanmean(
                    np.abs(np.where(np.isfinite(values), values, 0.0))[:, column], axis=1
                )
                std = np.maximum(std, np.finfo(float).tiny)
            elif unit and self.options.scale is None:
                raise ValueError(
                    f"column {label} is in {unit:.30}, neither in 1/sr nor in percent. Convert it first."
                )
            squares.append(std**2)
        mean: Array = np.sqrt(np.mean(squares, axis=0))
        return mean

    def _scaled(self, values: Array, std: Array | None, wo: Array) -> tuple[Array, Array | None]:
        factor = np.full(len(values), self.options.scale or 1.0)
        if self.options.cosine:
            factor = np.divide(factor, wo[:, 2], out=np.full(len(values), np.nan), where=wo[:, 2] > 1e-6)
            factor = np.where(wo[:, 2] > 1e-6, factor, np.nan)
        if self.options.scale is None and not self.options.cosine:
            return values, std
        return values * factor[:, None], None if std is None else np.where(
            np.isnan(factor), std, std * factor
        )

    def _weights(self) -> Array | None:
        if self.weight is None:
            return None
        bad = np.flatnonzero(~((self.weight >= 0.0) & np.isfinite(self.weight)))
        if bad.size:
            raise ValueError(
                f"'weights' must be >= 0 and finite, got {self.weight[bad[0]]:g} {self._at(int(bad[0]))}. Leave "
                f"the line out."
            )
        return self.weight

    def _kept(self, wi: Array, wo: Array, values: Array) -> NDArray[np.bool_]:
        """Which samples count; says how many do not, and why."""
        there = np.isfinite(wi).all(1) & np.isfinite(wo).all(1)
        if self.wavelength is not None:
            there &= np.isfinite(self.wavelength)
        below = there & ((wi[:, 2] < -_ROUNDING) | (wo[:, 2] < -_ROUNDING))
        rows = there & ~below
        for bad, what in ((~there, "without a direction"), (below, "below the horizon")):
            if bad.any():
                first = self._at(int(np.flatnonzero(bad)[0]))
                self.left_out.append(
                    f"{int(bad.sum())} of {self.n} samples are {what} and left out, the first {first}."
                )
        if not rows.any():
            bad = below if below.any() else ~there
            what = "below the horizon" if below.any() else "without a direction"
            index = int(np.flatnonzero(bad)[0]) if bad.any() else 0
            raise ValueError(
                f"no sample is left: all are {what}, the first {self._at(index)}. Both directions point away from the "
                "surface, angles count from its normal (90 is the horizon). Check the units and columns."
            )
        if not self.options.keep:
            return rows
        rows = rows & self._wanted(wi, wo, values)
        self.remarks.append(
            f"{int(rows.sum())} of {self.n} samples kept: {', '.join(map(str, self.options.conditions))}"
        )
        if not rows.any():
            raise ValueError(f"no sample satisfies keep={list(self.options.keep)} (--keep).")
        return rows

    def _wanted(self, wi: Array, wo: Array, values: Array) -> NDArray[np.bool_]:
        """Which samples satisfy the conditions of the caller."""
        wanted = np.ones(len(wi), dtype=bool)
        fine = np.isfinite(wi).all(1) & np.isfinite(wo).all(1)
        for condition in self.options.conditions:
            quantity = np.full(len(wi), np.nan)
            match condition.quantity:
                case "theta_i" | "theta_o":
                    w = (wi if condition.quantity == "theta_i" else wo)[fine]
                    quantity[fine] = np.rad2deg(np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]))
                case "phi":
                    turn = np.arctan2(wo[fine, 1], wo[fine, 0]) - np.arctan2(wi[fine, 1], wi[fine, 0])
                    quantity[fine] = np.rad2deg(turn) % 360.0
                case "value":
                    quantity = np.nanmax(np.where(np.isfinite(values), values, -np.inf), axis=1)
                case "wavelength":
                    if self.wavelength is None:
                        raise ValueError("keep: there is no column wavelength to compare.")
                    quantity = self.wavelength
                case key:
                    which = ("theta_h", "theta_d", "phi_d").index(key)
                    quantity[fine] = np.rad2deg(half_diff.from_directions(wi[fine], wo[fine])[which])
            # 85 degrees, as a sine and cosine, may be a bit more
            wanted &= condition.holds(np.round(quantity, 9))
        return wanted

    def _by_wavelength(
        self, wi: Array, wo: Array, values: Array, std: Array | None, weights: Array | None, waves: Array
    ) -> tuple[Array, Array, Array, Array | None, Array | None]:
        """Rows of one wavelength each to rows of all wavelengths; a pair measured twice is two rows."""
        if len(self.values) > 1:
            raise ValueError(
                f"a column of wavelengths goes with one column of values, got {', '.join(self.values)}. Leave "
                f"the others "
                "out with ignore=[...] (--ignore)."
            )
        unique, which = np.unique(np.round(waves, 6), return_inverse=True)
        pairs = np.round(np.concatenate([wi, wo], axis=1), 12) + 0.0
        _, pair = np.unique(pairs, axis=0, return_inverse=True)
        pair, which = pair.ravel(), which.ravel()
        cell = pair * len(unique) + which
        order = np.argsort(cell, kind="stable")
        starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
        turn = np.empty(len(cell), dtype=np.int64)
        turn[order] = np.arange(len(cell)) - np.repeat(starts, np.diff(starts, append=len(cell)))
        _, first, row = np.unique(turn * (pair.max() + 1) + pair, return_index=True, return_inverse=True)
        # In the order of the file
        rank = np.argsort(np.argsort(first))
        row, first = rank[row.ravel()], np.sort(first)
        table = np.full((len(first), len(unique)), np.nan)
        table[row, which] = values[:, 0]
        count = np.bincount(row)
        self.values = {wavelength_name(nm): table[:, i] for i, nm in enumerate(unique)}
        if std is not None:
            std = np.sqrt(np.bincount(row, std**2) / count)
        if weights is not None:
            weights = np.bincount(row, weights) / count
        return wi[first], wo[first], table, std, weights
