"""Convert measured files and models from one format to another, and say what is lost."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.grids import SHAPE, cell_angles
from dsbrdf.measured import built_in
from dsbrdf.measured.formats.merl import write_merl
from dsbrdf.measured.formats.rgl import RGLReflectance, read_rgl
from dsbrdf.measured.formats.tensor_file import MAGIC
from dsbrdf.measured.names import column_names
from dsbrdf.measured.read import read
from dsbrdf.measured.samples import ReadWarning, Samples
from dsbrdf.measured.table import MeasuredBRDF, tabulate
from dsbrdf.model import file as model_file
from dsbrdf.model.dsbrdf import DSBRDF, channel_names

__all__ = ["KINDS", "Conversion", "convert", "write_csv"]

#: Kinds of files that can be written, and their suffixes.
KINDS = {"merl": ".binary", "rgl": ".bsdf", "npz": ".npz", "csv": ".csv", "tsv": ".tsv", "bird": ".brdf"}
#: Of a table.
ANGLES = ("theta_h", "theta_d", "phi_d")
Content: TypeAlias = MeasuredBRDF | Samples | DSBRDF
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conversion:
    """What a conversion made, and lost.

    Parameters
    ----------
    path : Path
        The file that was written.
    kind : str
        One of `KINDS`.
    rel_rms : float
        Relative RMS of the valid entries of the result against what was read, on the grid of the result; on the
        samples where samples became a table; against the file's own values, which are not quite reciprocal, of an RGL
        file. NaN if all are zero.
    coverage : float
        Share of the result's entries that are valid.
    """

    path: Path
    kind: str
    rel_rms: float
    coverage: float

    def __str__(self) -> str:
        return f"{self.path}: relative RMS {self.rel_rms:.2g}, {self.coverage:.1%} of the entries valid"


def convert(source: str | Path, target: str | Path, kind: str | None = None, **reading: Any) -> Conversion:
    """Convert a measured file, or a model, to another format.

    Parameters
    ----------
    source : str or Path
        A file that `dsbrdf.read` reads, a model file, or the name of a built-in material.
    target : str or Path
        Written aside and renamed.
    kind : {"merl", "rgl", "npz", "csv", "tsv", "bird"}, optional
        Told by the suffix of `target` by default: .binary, .bsdf, .npz, .csv, .tsv or .brdf.
    **reading
        Of `dsbrdf.read`, such as `columns`.

    Returns
    -------
    Conversion

    Raises
    ------
    ValueError
        If the format is unknown, or cannot carry the data; says what can.
    OSError
        If a file cannot be read or written.
    """
    target = Path(target)
    kind = _kind(target, kind)
    source = Path(source)
    before = _open(source, reading)
    # Written over itself, a file could not be compared any more
    truth = _as_measured(source, before)
    _WRITERS[kind](before, target)
    with warnings.catch_warnings():
        # What is doubtful was said as it was read
        warnings.simplefilter("ignore", ReadWarning)
        after = read(target)
    return Conversion(target, kind, _loss(truth, after), _coverage(after))


def _kind(target: Path, kind: str | None) -> str:
    if kind is None and target.suffix.lower() == ".json":
        raise ValueError(f"{target}: a model file comes of a fit. Use dsbrdf fit.")
    of_suffix = {suffix: name for name, suffix in KINDS.items()}
    kind = of_suffix.get(target.suffix.lower()) if kind is None else kind
    if kind not in KINDS:
        expected = ", ".join(f"{suffix} ({name})" for name, suffix in KINDS.items())
        raise ValueError(f"{target}: no format that can be written; expected {expected}.")
    return kind


def _open(path: Path, reading: Mapping[str, Any]) -> Content:
    if str(path) in built_in.names() and not path.exists():
        return built_in.material(str(path))
    if not reading and path.is_file():
        with path.open("rb") as file:
            if b'"dsbrdf model"' in file.read(4096):
                return model_file.load(path)
    return read(path, **reading)


def _as_measured(path: Path, content: Content) -> Content | RGLReflectance:
    """What the loss is counted from: of an RGL file its own values, not the reciprocal table that is read."""
    if isinstance(content, MeasuredBRDF) and path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return read_rgl(path).linear_srgb()
    return content


# Writers


def _write_merl(content: Content, path: Path) -> None:
    write_merl(_on_merl_grid(content, path), path)


def _write_rgl(content: Content, path: Path) -> None:
    from dsbrdf.export.rgl import write_rgl

    if isinstance(content, Samples):
        raise ValueError(
            f"{path}: scattered samples cannot become an RGL file. Fit them, and export the model."
        )
    _need_rgb(content, path)
    write_rgl(content, path)


def _write_npz(content: Content, path: Path) -> None:
    from dsbrdf.measured.formats.array_file import write_npz

    write_npz(_tabulated(content) if isinstance(content, DSBRDF) else content, path)


def _write_csv(content: Content, path: Path) -> None:
    write_csv(_tabulated(content) if isinstance(content, DSBRDF) else content, path, ",")


def _write_tsv(content: Content, path: Path) -> None:
    write_csv(_tabulated(content) if isinstance(content, DSBRDF) else content, path, "\t")


def _write_bird(content: Content, path: Path) -> None:
    from dsbrdf.measured.formats.bird import write_bird

    if not isinstance(content, Samples):
        raise ValueError(f"{path}: BiRD JSON holds scattered samples; use .npz or .csv for a table.")
    write_bird(content, path)


_WRITERS: dict[str, Callable[[Content, Path], None]] = {
    "merl": _write_merl,
    "rgl": _write_rgl,
    "npz": _write_npz,
    "csv": _write_csv,
    "tsv": _write_tsv,
    "bird": _write_bird,
}


def write_csv(measured: MeasuredBRDF | Samples, path: str | Path, delimiter: str = ",") -> None:
    """Write the valid values of a table, or samples, one pair of directions a line, with nine digits.

    The columns are `theta_i_rad`, `theta_o_rad` and `phi_o_rad`, counted from the azimuth of the light, then the
    channels in 1/sr, then `weight` where there is one. Channels have their names, after `value_` where these alone
    would
    not tell that they are channels, or numbers if one of them cannot be part of a header.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    channels = column_names(channel_names(measured.channels, measured.n_channels))
    weighted = isinstance(measured, Samples) and measured.weights is not None
    header = ["theta_i_rad", "theta_o_rad", "phi_o_rad", *channels, *(["weight"] if weighted else [])]
    with _files.aside(path) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write(delimiter.join(header) + "\n")
        for wi, wo, values in _pairs(measured):
            some = np.isfinite(values).any(-1) | isinstance(measured, Samples)
            theta_i, theta_o = (np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]) for w in (wi, wo))
            phi = np.arctan2(wo[:, 1], wo[:, 0]) - np.arctan2(wi[:, 1], wi[:, 0])
            rows = [theta_i, theta_o, phi % (2.0 * np.pi), *values.T]
            if isinstance(measured, Samples) and measured.weights is not None:
                rows.append(measured.weights)
            np.savetxt(file, np.stack(rows, axis=-1)[some], fmt="%.9g", delimiter=delimiter)


def _tabulated(model: DSBRDF) -> MeasuredBRDF:
    """A model at the middles of the cells of a MERL table."""
    return dataclasses.replace(tabulate(model.eval, model.name), channels=model.channels)


def _on_merl_grid(content: Content, path: Path) -> MeasuredBRDF:
    """The content as a table that a MERL file holds."""
    _need_rgb(content, path)
    if isinstance(content, DSBRDF):
        return _tabulated(content)
    if isinstance(content, Samples):
        return _gather(content)
    on_grid = _same_angles([getattr(content, name) for name in ANGLES], cell_angles(content.convention))
    return content if on_grid else tabulate(_where_valid(content), content.name)


def _need_rgb(content: Content, path: Path) -> None:
    if content.n_channels != 3:
        raise ValueError(
            f"{path}: this format holds three channels, red, green and blue, got {content.n_channels}. Use .npz."
        )


def _where_valid(measured: MeasuredBRDF) -> Callable[[Array, Array], Array]:
    """Values of a table between its entries, NaN where the nearest entry is invalid."""
    nodes = (np.sqrt(measured.theta_h), measured.theta_d, measured.phi_d)

    def values(wi: Array, wo: Array) -> Array:
        h, d, phi = half_diff.from_directions(wi, wo)
        at = [
            np.rint(np.interp(x, node, np.arange(len(node)))).astype(int)
            for x, node in zip((np.sqrt(h), d, phi % np.pi), nodes, strict=True)
        ]
        result: Array = np.where(measured.valid[tuple(at)], measured.eval(wi, wo), np.nan)
        return result

    return values


def _gather(samples: Samples) -> MeasuredBRDF:
    """The weighted mean of the samples in each cell of a MERL table; the other cells are invalid."""
    theta_h, theta_d, phi_d = half_diff.from_directions(samples.wi, samples.wo)
    places = (np.sqrt(theta_h * 2.0 / np.pi), theta_d * 2.0 / np.pi, phi_d % np.pi / np.pi)
    cells = [np.minimum((x * n).astype(int), n - 1) for x, n in zip(places, SHAPE, strict=True)]
    index = np.ravel_multi_index(cells, SHAPE)
    weights = np.ones(len(samples)) if samples.weights is None else samples.weights
    planes = np.full((samples.n_channels, int(np.prod(SHAPE))), -1.0)
    for plane, values in zip(planes, samples.values.T, strict=True):
        valid = np.isfinite(values) & (weights > 0.0)
        total, weight = (
            np.bincount(index[valid], x[valid], minlength=plane.size) for x in (weights * values, weights)
        )
        np.divide(total, weight, out=plane, where=weight > 0.0)
    shaped = planes.reshape(-1, *SHAPE)
    return MeasuredBRDF(samples.name, shaped, np.ones(len(planes)), *cell_angles(), source=samples.source)


# Loss


def _pairs(measured: MeasuredBRDF | Samples) -> Iterator[tuple[Array, Array, Array]]:
    """Directions (n, 3) and values (n, channel), NaN where invalid, in parts that take little memory."""
    if isinstance(measured, Samples):
        yield measured.wi, measured.wo, measured.values
        return
    for i, theta_h in enumerate(measured.theta_h):
        wi, wo = half_diff.to_directions(theta_h, measured.theta_d[:, None], measured.phi_d)
        plane = measured.planes[:, i]
        valid = (plane >= 0.0) & (plane < np.inf) & (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
        values = np.where(valid, plane, np.nan) * measured.scale[:, None, None]
        yield wi.reshape(-1, 3), wo.reshape(-1, 3), values.reshape(len(plane), -1).T


def _loss(before: Content | RGLReflectance, after: MeasuredBRDF | Samples) -> float:
    """Relative RMS of the result against what was read."""
    squares = energy = 0.0
    for old, new in _compared(before, after):
        both = np.isfinite(old) & np.isfinite(new)
        squares += float(((new - old)[both] ** 2).sum())
        energy += float((old[both] ** 2).sum())
    return float(np.sqrt(squares / energy)) if energy > 0.0 else float("nan")


def _compared(
    before: Content | RGLReflectance, after: MeasuredBRDF | Samples
) -> Iterator[tuple[Array, Array]]:
    """Values (n, channel) before and after at the same pairs of directions, in parts."""
    if isinstance(before, Samples):
        if not isinstance(after, Samples):
            yield before.values, after.eval(before.wi, before.wo)
            return
        # Some formats hold no sample without a value
        some = np.isfinite(before.values).any(-1) | (len(after) == len(before))
        if some.sum() == len(after):
            yield before.values[some], after.values
    elif (
        isinstance(before, MeasuredBRDF)
        and isinstance(after, MeasuredBRDF)
        and _same_angles(*([getattr(table, name) for name in ANGLES] for table in (before, after)))
    ):
        for (_, _, old), (_, _, new) in zip(_pairs(before), _pairs(after), strict=True):
            yield old, new
    else:
        for wi, wo, new in _pairs(after):
            some = np.isfinite(new).any(-1)
            yield np.asarray(before.eval(wi[some], wo[some])), new[some]


def _same_angles(mine: Sequence[Array], others: Sequence[Array]) -> bool:
    return all(
        a.shape == b.shape and np.allclose(a, b, rtol=0.0, atol=1e-9)
        for a, b in zip(mine, others, strict=True)
    )


def _coverage(after: MeasuredBRDF | Samples) -> float:
    values = after.values
    return float(np.isfinite(values).mean())
