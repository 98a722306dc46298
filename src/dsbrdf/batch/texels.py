"""Textures: many materials that were measured at the same directions, each a few lobes.

With some hundred values a texel the prior decides much, so that a texel is the most probable material given its values
and the materials of a space, by the least squares of `dsbrdf.fit`. The kernel (`crates/dsbrdf-core`: texels) does once
what is the same for all texels. Here values are handed to it block by block, and `TexelMaps` is what comes of it.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check, _core, _files, _json, library
from dsbrdf.fitting import observations
from dsbrdf.fitting.estimator import lobes_of
from dsbrdf.fitting.options import CURVES
from dsbrdf.geometry import directions, half_diff
from dsbrdf.measured.formats import image_file
from dsbrdf.measured.formats.array_file import read_npz_arrays
from dsbrdf.model.dsbrdf import DSBRDF, channel_names
from dsbrdf.model.lobes import MAX_LN_KAPPA, curve_design
from dsbrdf.space import Gaussian, MaterialSpace, Sizes, build_space

__all__ = ["TexelMaps", "fit_texels", "load_texels", "texel_space"]

Array = NDArray[np.float64]

#: Values that are read at a time.
BLOCK_BYTES = 64_000_000
#: More directions than this are averaged at so many places, half of them by theta_h.
MAX_POSITIONS = 1024
N_STRIPS, N_RINGS = 12, 36
ITERATIONS = 40
#: Where uncertainty is told: theta_i, and theta_o in the plane of incidence and across it.
REFERENCE = np.deg2rad([10.0, 35.0, 60.0])
CURVE_NAMES = ("scale", "gamma", "beta", "falloff")


class _Layout(NamedTuple):
    """Of unknowns, as the kernel takes it."""

    n_lobes: int
    n_channels: int
    sizes: tuple[int, int, int, int, int]


@cache
def texel_space(n_lobes: int = 2, n_channels: int = 3) -> MaterialSpace:
    """The space of the built-in materials as so few lobes, whose Gaussian is the prior "library" of `fit_texels`.

    The same 106 materials as those of `dsbrdf.library`, fitted with two lobes of compact curves.

    Raises
    ------
    ValueError
        If there is none of so many lobes or channels.

    Examples
    --------
    >>> from dsbrdf.batch.texels import texel_space
    >>> texel_space().without("nickel")
    MaterialSpace(105 materials, 3 channels, 2 lobes)
    """
    path = Path(__file__).with_name(f"lobes-{n_lobes}{library.SUFFIX}")
    if not path.exists() or n_channels not in (1, 3):
        raise ValueError(
            f"the built-in prior is of 2 lobes and 1 or 3 channels, got {n_lobes} and {n_channels}. Give a space of "
            "your own: dsbrdf.space.build_space(models, sizes=(3, 2, 2, 1, 1))."
        )
    opened = library.open(path)
    models = [opened.load(name) for name in opened.names]
    if n_channels == 1:
        green = [model.lobes.replace(colour=model.lobes.colour[1:2]) for model in models]
        models = [model.replace(lobes=lobes, channels=()) for model, lobes in zip(models, green, strict=True)]
    return build_space(models, sizes=CURVES["compact"])


@dataclass(frozen=True, eq=False)
class TexelMaps:
    """Models of texels.

    Parameters
    ----------
    unknowns : (texel..., unknown) ndarray of float32
        Of the estimator: for each lobe scale, gamma, beta and falloff, then for each channel, for each lobe, its
        colour. NaN where there is no model.
    residual : (texel...) ndarray of float32
        RMS of the differences of logarithms between values and model.
    uncertainty : (texel...) ndarray of float32
        Standard deviation of the logarithm of values, RMS over directions of the whole hemisphere.
    n_lobes : int
    sizes : Sizes
        Coefficients of the curves.
    channels : tuple of str
    """

    unknowns: NDArray[np.float32]
    residual: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    n_lobes: int
    sizes: Sizes
    channels: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the texels."""
        return tuple(self.residual.shape)

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return len(self.channels)

    @property
    def _layout(self) -> _Layout:
        return _Layout(self.n_lobes, self.n_channels, tuple(map(int, self.sizes)))  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.residual)

    def __getitem__(self, index: Any) -> DSBRDF | TexelMaps:
        """The model of a texel, or maps of several.

        Raises
        ------
        ValueError
            If the texel has no model.
        IndexError
            If there is no such texel.
        """
        residual = self.residual[index]
        if np.ndim(residual):
            parts = (self.unknowns[index], residual, self.uncertainty[index])
            return TexelMaps(*parts, self.n_lobes, self.sizes, self.channels)
        unknowns = self.unknowns[index].astype(np.float64)
        if np.isnan(unknowns).any():
            raise ValueError(f"texel {index}: no model: it had no value, or was left out by the mask.")
        return DSBRDF(
            lobes_of(unknowns, self._layout.sizes, self.n_lobes, self.n_channels),
            self.channels,
            name=f"texel {index}",
            errors={"log": float(residual)},
        )

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The curves as those of `Lobes`, with texels in front.

        Scale, gamma, beta and falloff are (texel..., lobe, coefficient), colour (texel..., channel, lobe, coefficient).
        Lobes are in the order of the prior, from flat to sharp, so that those of neighbours correspond.
        """
        *shared_sizes, n_colour = self.sizes
        n_shared = self.n_lobes * sum(shared_sizes)
        lobes = self.unknowns[..., :n_shared].reshape(*self.shape, self.n_lobes, -1)
        parts = np.split(lobes, np.cumsum(shared_sizes)[:-1], axis=-1)
        colour = np.zeros((*self.shape, self.n_channels, self.n_lobes, n_colour), dtype=np.float32)
        if self.n_channels > 1:
            colour = self.unknowns[..., n_shared:].reshape(colour.shape)
        return dict(zip((*CURVE_NAMES, "colour"), (*parts, colour), strict=True))

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Values (texel..., ..., channel) in 1/sr at pairs of directions (..., 3), the same for all texels.

        Raises
        ------
        ValueError
            If directions are not unit vectors.
        """
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        unknowns = np.ascontiguousarray(self.unknowns, dtype=np.float64).reshape(-1, self.unknowns.shape[-1])
        angles, _ = _angles(wi.reshape(-1, 3), wo.reshape(-1, 3))
        values = _core.eval_texels(self._layout, unknowns, angles)
        values = values.reshape(*self.shape, *wi.shape[:-1], self.n_channels)
        above = (wi[..., 2] >= 0.0) & (wo[..., 2] >= 0.0)
        return np.where(above[..., None], values, 0.0)

    def albedo(self, theta_i: float = np.deg2rad(30.0)) -> NDArray[np.float32]:
        """Directional albedo (texel..., channel) for light from `theta_i` in radians; see `DSBRDF.albedo`."""
        wi, wo, weight = directions.albedo_nodes(float(_check.angle(theta_i, "theta_i")), N_PHI)
        wi = np.broadcast_to(wi, wo.shape)
        found = np.empty((int(np.prod(self.shape)), self.n_channels), dtype=np.float32)
        flat = self._flat()
        step = max(1, BLOCK_BYTES // (8 * len(wo) * self.n_channels))
        for start in range(0, len(found), step):
            some = flat[start : start + step]
            assert isinstance(some, TexelMaps)
            found[start : start + step] = np.einsum("n,tnc->tc", weight, some.eval(wi, wo))
        return found.reshape(*self.shape, self.n_channels)

    def colour(self) -> NDArray[np.float32]:
        """Heights (texel..., lobe, channel) of the lobes at theta_h = theta_d = 0, in 1/sr."""
        height: NDArray[np.float32] = np.expm1(self._kappa())
        return height

    def width(self) -> NDArray[np.float32]:
        """Half widths (texel..., lobe) of the lobes at half height at theta_d = 0, in radians, channels averaged.

        They are those of the powers of the cosine that lobes are near their peaks, with exponents
        `gamma kappa e^kappa / (e^kappa - 1) + falloff`.
        """
        kappa = self._kappa().mean(-1)
        arrays = self.arrays()
        gamma, falloff = (arrays[name] @ _at_normal(arrays[name].shape[-1]) for name in ("gamma", "falloff"))
        exponent = np.exp(gamma) * kappa / -np.expm1(-np.maximum(kappa, 1e-20)) + falloff
        width: NDArray[np.float32] = np.arccos(np.exp2(-1.0 / np.maximum(exponent, 1e-3))).astype(np.float32)
        return width

    def _kappa(self) -> NDArray[np.float32]:
        """Of each lobe and channel (texel..., lobe, channel) at theta_d = 0."""
        arrays = self.arrays()
        scale, colour = (arrays[name] @ _at_normal(arrays[name].shape[-1]) for name in ("scale", "colour"))
        ln_kappa = scale[..., None] + np.moveaxis(colour, -2, -1)
        kappa: NDArray[np.float32] = np.exp(np.minimum(ln_kappa, MAX_LN_KAPPA)).astype(np.float32)
        return kappa

    def _flat(self) -> TexelMaps:
        return TexelMaps(
            self.unknowns.reshape(-1, self.unknowns.shape[-1]),
            self.residual.ravel(),
            self.uncertainty.ravel(),
            self.n_lobes,
            self.sizes,
            self.channels,
        )

    def to_exr(self, path: str | Path) -> None:
        """Write maps (row, column) as one OpenEXR file with a layer for each: albedo, width, uncertainty, residual, and
        the curves.

        Raises
        ------
        ValueError
            Unless there are two axes of texels.
        ModuleNotFoundError
            Without mitsuba, which writes the file.
        OSError
            If the file cannot be written.
        """
        if len(self.shape) != 2:
            raise ValueError(f"an image has rows and columns of texels, these have shape {self.shape}.")
        layers: dict[str, Any] = {"residual": self.residual, "uncertainty": self.uncertainty}
        named: dict[str, tuple[NDArray[np.float32], list[Any]]] = {
            "albedo": (self.albedo(), [self.channels]),
            "width": (self.width(), [range(self.n_lobes)]),
        }
        for name, array in self.arrays().items():
            lobes: list[Any] = [range(self.n_lobes), range(array.shape[-1])]
            named[name] = (array, [self.channels, *lobes] if name == "colour" else lobes)
        for name, (array, axes) in named.items():
            flat = array.reshape(*self.shape, -1)
            for i, place in enumerate(itertools.product(*axes)):
                layers[".".join([name, *map(str, place)])] = flat[..., i]
        stacked = np.stack(list(layers.values()), axis=-1).astype(np.float32)
        image_file.write_pixels(stacked, path, list(layers))

    def save(self, path: str | Path) -> None:
        """Write the maps as `.npz`, or as a Zarr group if `path` ends with `.zarr`; `load_texels` reads both.

        Raises
        ------
        ModuleNotFoundError
            Of a Zarr group, without zarr.
        OSError
            If it cannot be written, or the path of a group is that of something else.
        """
        about = {"format": FORMAT, "n_lobes": self.n_lobes, "sizes": list(map(int, self.sizes))}
        about["channels"] = list(self.channels)
        maps = {name: getattr(self, name) for name in MAPS}
        if Path(path).suffix != ".zarr":
            with _files.aside(path) as part, part.open("wb") as file:
                # Not compressed: what was left out would unpack to far more than the file, as only bombs do
                np.savez(file, about=np.array(json.dumps(about)), **maps)
            return
        _save_group(Path(path), about, maps)


FORMAT = "dsbrdf texels"
MAPS = ("unknowns", "residual", "uncertainty")
#: Bytes that a byte of a group may stand for: where texels are left out, there are many the same.
UNPACKED = 100
#: Ways of storing numbers that are read.
CODECS = frozenset(("bytes", "blosc", "gzip", "zstd"))
#: Azimuths of the quadrature of albedos.
N_PHI = 16


def load_texels(path: str | Path) -> TexelMaps:
    """Read what `TexelMaps.save` wrote.

    Raises
    ------
    ValueError
        If it is something else.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        if path.suffix == ".zarr":
            about, maps = _load_group(path)
        else:
            stored = read_npz_arrays(path)
            about = _json.parse(str(stored["about"]))
            maps = [stored[name] for name in MAPS]
        if about["format"] != FORMAT:
            raise ValueError(f"expected the format {FORMAT!r}.")
        unknowns, residual, uncertainty = (array.astype(np.float32) for array in maps)
        made = TexelMaps(
            unknowns,
            residual,
            uncertainty,
            int(about["n_lobes"]),
            Sizes(*about["sizes"]),
            tuple(about["channels"]),
        )
        *shared, colour = made.sizes
        n = made.n_lobes * (sum(shared) + (made.n_channels * colour if made.n_channels > 1 else 0))
        if unknowns.shape != (*residual.shape, n) or uncertainty.shape != residual.shape:
            raise ValueError(f"shapes {unknowns.shape} and {residual.shape} do not go together.")
    except OSError:
        raise
    except Exception as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error).removeprefix(f"{path}: ")
        raise ValueError(f"{path}: not maps of texels: {what}") from None
    return made


def _save_group(path: Path, about: dict[str, Any], maps: dict[str, Any]) -> None:
    """Write a group aside, and put it in the place of an earlier one."""
    if path.exists() or path.is_symlink():
        try:
            _zarr_about(path)
        except (OSError, ValueError):
            raise FileExistsError(
                errno.EEXIST, "is there already, and is no group of ours. Give another name", str(path)
            ) from None
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".dsbrdf-", dir=path.parent) as folder:
        part, earlier = Path(folder, "part"), Path(folder, "earlier")
        group = _zarr().open_group(str(part), mode="w")
        group.attrs.update(about)
        for name, array in maps.items():
            group.create_array(name, data=array)
        if path.exists():
            path.replace(earlier)
        part.replace(path)


def _load_group(path: Path) -> tuple[dict[str, Any], list[Any]]:
    """What a group says of itself, and its maps, if they take little more memory than it has bytes."""
    about = _zarr_about(path)
    group = _zarr().open_group(str(path), mode="r")
    arrays = [group[name] for name in MAPS]
    for name, array in zip(MAPS, arrays, strict=True):
        codecs = [codec.to_dict()["name"] for codec in getattr(array.metadata, "codecs", ())]
        # Of those that Zarr knows, one unpickles
        if array.metadata.zarr_format != 3 or not CODECS.issuperset(codecs):
            raise ValueError(
                f"{name} must be a Zarr 3 array of {', '.join(sorted(CODECS))}, got {codecs or 'version 2'}."
            )
        if int(np.prod(array.shape, dtype=float)) * 4 > _files.ROOM + UNPACKED * array.nbytes_stored():
            raise ValueError(f"{name} of shape {array.shape} takes far more memory than the group.")
    return about, [np.asarray(array[...]) for array in arrays]


def _zarr_about(path: Path) -> dict[str, Any]:
    """The attributes of a group of ours; raises ValueError or OSError if it is none."""
    if not path.is_dir():
        path.stat()
        raise ValueError("a Zarr group is a folder.")
    for file in path.rglob("*"):
        if not file.is_dir():
            _files.regular_size(file)
    try:
        about = dict(_zarr().open_group(str(path), mode="r").attrs)
    except ModuleNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"no group: {error}") from None
    if about.get("format") != FORMAT:
        raise ValueError(f"expected the format {FORMAT!r}.")
    return about


def _zarr() -> Any:
    try:
        import zarr
    except ModuleNotFoundError:
        raise ModuleNotFoundError("Zarr groups need zarr: pip install zarr") from None
    return zarr


def fit_texels(
    wi: ArrayLike,
    wo: ArrayLike,
    values: Any,
    *,
    n_lobes: int = 2,
    prior: str | MaterialSpace | Gaussian = "library",
    mask: ArrayLike | None = None,
    channels: Sequence[str] = (),
) -> TexelMaps:
    """Fit a model to each texel of a texture.

    Parameters
    ----------
    wi, wo : (direction, 3) array_like
        Unit vectors toward light and viewer in the frame of the texels, the same for all.
    values : (texel..., direction, channel) array_like, 1/sr
        NumPy, memory-mapped, Zarr, Dask or any array that can be sliced. It is read block by block; what is held in
        memory is a block and the result. NaN where nothing was measured.
    n_lobes : int, optional
        Of a texel, with prior "library".
    prior : "library", MaterialSpace or Gaussian, optional
        What materials are like: those of the built-in library, or of a space, which decides on lobes and curves.
    mask : (texel...) array_like of bool, optional
        False where texels are left out.
    channels : sequence of str, optional
        Names of the channels.

    Returns
    -------
    TexelMaps

    Raises
    ------
    ValueError
        If shapes disagree, directions are not unit vectors, or the prior is of other channels.

    Examples
    --------
    >>> import numpy as np
    >>> import dsbrdf
    >>> rng = np.random.default_rng(1)
    >>> w = np.abs(rng.normal(size=(2, 60, 3))) + 0.1
    >>> wi, wo = w / np.linalg.norm(w, axis=-1, keepdims=True)
    >>> value = dsbrdf.material("rough-gold").eval(wi, wo)
    >>> maps = dsbrdf.fit_texels(wi, wo, np.broadcast_to(value, (4, 5, 60, 3)))
    >>> maps.shape, maps[2, 3].n_lobes
    ((4, 5), 2)
    """
    wi, wo = (_check.unit_vectors(w, name) for w, name in ((wi, "wi"), (wo, "wo")))
    if not hasattr(values, "shape"):
        values = np.asarray(values)
    if wi.ndim != 2 or wi.shape != wo.shape:
        raise ValueError(f"'wi' and 'wo' must have shape (direction, 3), got {wi.shape} and {wo.shape}.")
    shape = tuple(values.shape)
    if len(shape) < 3 or shape[-2] != len(wi) or 0 in shape:
        raise ValueError(
            f"'values' must have shape (texel..., direction, channel) with {len(wi)} directions, got {shape}."
        )
    *texels, _, n_channels = shape
    wanted = None if mask is None else np.asarray(mask, dtype=bool)
    if wanted is not None and wanted.shape != tuple(texels):
        raise ValueError(f"'mask' must have shape {tuple(texels)}, got {wanted.shape}.")
    if isinstance(prior, str):
        if prior != "library":
            raise ValueError(f"'prior' must be 'library', a MaterialSpace or a Gaussian, got {prior!r}.")
        prior = texel_space(n_lobes, n_channels)
    gaussian = prior if isinstance(prior, Gaussian) else prior.gaussian()
    layout = _Layout(gaussian.n_lobes, n_channels, tuple(map(int, gaussian.sizes)))  # type: ignore[arg-type]
    plan = _plan(wi, wo, layout, prior, gaussian)
    maps = TexelMaps(
        np.full((*texels, len(gaussian.mean)), np.nan, dtype=np.float32),
        np.full(texels, np.nan, dtype=np.float32),
        np.full(texels, np.nan, dtype=np.float32),
        gaussian.n_lobes,
        Sizes(*gaussian.sizes),
        channel_names(channels, n_channels),
    )
    with _progress(int(np.prod(texels))) as advance:
        for block in _blocks(texels, len(wi) * n_channels):
            chosen = np.ones(maps.residual[block].shape, dtype=bool) if wanted is None else wanted[block]
            if chosen.any():
                _fit_block(plan, np.asarray(values[block]), chosen, block, maps)
            advance(chosen.size)
    return maps


def _fit_block(plan: Any, values: NDArray[Any], chosen: NDArray[np.bool_], at: Any, maps: TexelMaps) -> None:
    """Fit the chosen texels of a block of values, and put what is found into the maps."""
    kind = np.float32 if values.dtype in (np.float32, np.float16, np.uint8, np.uint16) else np.float64
    unknowns, squares, uncertainty, _ = plan.fit(np.ascontiguousarray(values[chosen], dtype=kind))
    n = len(squares)
    maps.unknowns[at][chosen] = unknowns.reshape(n, -1)
    maps.residual[at][chosen] = np.sqrt(squares)
    maps.uncertainty[at][chosen] = uncertainty


def _blocks(texels: Sequence[int], width: int) -> Iterator[tuple[slice, ...]]:
    """Blocks of texels of `width` values each that are small enough, along the first axes."""
    first, *rest = texels
    row = int(np.prod(rest)) * width * 8
    step = max(1, BLOCK_BYTES // row)
    if row <= BLOCK_BYTES or not rest:
        yield from ((slice(start, start + step),) for start in range(0, first, step))
        return
    for i in range(first):
        yield from ((slice(i, i + 1), *inner) for inner in _blocks(rest, width))


def _plan(
    wi: Array, wo: Array, layout: _Layout, prior: MaterialSpace | Gaussian, gaussian: Gaussian
) -> _core.TexelPlan:
    """What is the same for all texels."""
    if layout.n_channels != len(gaussian.channels):
        raise ValueError(
            f"'values' has {layout.n_channels} channels, the prior {len(gaussian.channels)}. Build a space of models "
            "with the same channels."
        )
    angles, cos_product = _angles(wi, wo)
    cell = _cells(*angles)
    if cell.max() + 1 < len(cell):
        count = np.bincount(cell)
        log_cos, x, azimuth = (np.bincount(cell, part) / count for part in angles)
        angles = (log_cos, x, azimuth)
        cos_product = np.bincount(cell, cos_product) / count
    starts = np.empty((0, len(gaussian.mean)))
    if isinstance(prior, MaterialSpace):
        starts = prior.variables.unknowns(prior.curves)
    return _core.TexelPlan(
        layout,
        angles,
        cell.tolist(),
        cos_product.tolist(),
        (
            observations.SHARES,
            observations.OFFSET,
            observations.NEGATIVE_QUANTILE,
            observations.EFFECTIVE,
        ),
        (gaussian.mean.tolist(), gaussian.precision.ravel().tolist()),
        np.ascontiguousarray(starts),
        _reference(),
        ITERATIONS,
    )


def _angles(wi: Array, wo: Array) -> tuple[tuple[Array, Array, Array], Array]:
    """`ln cos(theta_h)`, `cos(theta_d)` and the azimuth (direction,), and the product of the cosines."""
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
    parts = (half_diff.log_cos(theta_h), np.cos(theta_d), azimuth)
    log_cos, x, azimuth = (np.ascontiguousarray(part, dtype=np.float64) for part in parts)
    return (log_cos, x, azimuth), np.maximum(wi[:, 2] * wo[:, 2], 0.0)


def _reference() -> tuple[Array, Array, Array]:
    """Positions at which uncertainty is told: pairs of directions in the plane of incidence and across it."""
    signed = np.concatenate([-REFERENCE[::-1], REFERENCE])
    theta_i, theta_o, across = (
        part.ravel() for part in np.meshgrid(REFERENCE, signed, [False, True], indexing="ij")
    )
    zero = np.zeros_like(theta_o)
    wi = np.stack([np.sin(theta_i), zero, np.cos(theta_i)], axis=-1)
    sine = np.sin(theta_o)
    wo = np.stack([np.where(across, 0.0, sine), np.where(across, sine, 0.0), np.cos(theta_o)], axis=-1)
    return _angles(wi, wo)[0]


def _cells(log_cos: Array, x: Array, azimuth: Array) -> NDArray[np.uint32]:
    """Position (direction,) that each direction counts at: its own, or if there are many, that of its neighbours too.

    Cells have about as many directions each: strips of theta_d, in each rings of theta_h, in each parts by azimuth.
    """
    n = len(x)
    if n <= MAX_POSITIONS:
        return np.arange(n, dtype=np.uint32)
    cell = np.zeros(n, dtype=np.int64)
    for key, parts in ((x, N_STRIPS), (log_cos, N_RINGS), (azimuth, MAX_POSITIONS // (N_STRIPS * N_RINGS))):
        order = np.lexsort([key, cell])
        sizes = np.bincount(cell)
        sizes = sizes[sizes > 0]
        place = np.concatenate([np.arange(size) * parts // size for size in sizes])
        finer = np.empty(n, dtype=np.int64)
        finer[order] = np.repeat(np.arange(len(sizes)), sizes) * parts + place
        cell = np.unique(finer, return_inverse=True)[1].reshape(n)
    return cell.astype(np.uint32)


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Any]:
    """A bar on standard error if that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("texels"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda n: bar.advance(task, n)


def _at_normal(size: int) -> NDArray[np.float32]:
    """Functions (coefficient,) of a curve at theta_d = 0."""
    design: NDArray[np.float32] = curve_design(np.ones(1), size)[0].astype(np.float32)
    return design
