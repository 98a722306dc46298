"""Neural BRDFs: small networks that their authors trained on measured tables.

Sztrajman, Rainer, Ritschel and Weyrich, *Neural BRDF Representation and Importance Sampling*, Comput. Graph. Forum
40(6), 2021. The weights are published as Keras .h5 files, and as sets of six arrays `NAME_fc1.npy`, `_b1`, `_fc2`,
`_b2`, `_fc3` and `_b3`: two layers with ReLU and one with `expm1`, from the half and the difference vector to three
values.

Notes
-----
The networks learned from entry (i, j, k) of a MERL table at the lower edge of its cell. Evaluated there they give the
table's own entries back, whichever convention is then used for these.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _files
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.grids import SHAPE, cell_angles
from dsbrdf.measured.formats.array_file import read_npy_array
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF

__all__ = ["npy_set", "read_nbrdf", "read_weights"]

Array = NDArray[np.float64]
#: Ends of the names of a set of arrays, layer by layer.
PARTS = ("fc1", "b1", "fc2", "b2", "fc3", "b3")
#: Published networks have layers of 21; wider ones than this are no such files.
MAX_WIDTH = 64
MAX_BYTES = 10_000_000
N_INPUTS, N_CHANNELS = 6, 3


def npy_set(path: Path) -> dict[str, Path] | None:
    """The six files of a set: of a folder with one of them, or with `path` among them; None if it is neither."""
    if path.is_dir():
        first = sorted(path.glob("*_fc1.npy"))
        if len(first) > 1:
            raise ValueError(
                f"{path}: {len(first)} neural BRDFs in this folder. Give one, such as {first[0]}."
            )
        return npy_set(first[0]) if first else None
    stem, _, part = path.name.removesuffix(".npy").rpartition("_")
    if part not in PARTS:
        return None
    files = {name: path.with_name(f"{stem}_{name}.npy") for name in PARTS}
    return files if all(file.exists() for file in files.values()) else None


def read_nbrdf(path: str | Path, *, convention: str = "centre") -> MeasuredBRDF:
    """Read the weights of a neural BRDF, and tabulate it over half and difference angles.

    Parameters
    ----------
    path : str or Path
        A Keras .h5 file (needs h5py), a file of a set of .npy arrays, or a folder with one set.
    convention : {"centre", "edge"}, optional
        Which point of a table's cell its value belongs to.

    Returns
    -------
    MeasuredBRDF
        On the grid of MERL; each entry is the mean of both orders of its two directions, as the networks are
        reciprocal only nearly. Stand-ins for the measurements they learned from: peaks come out low.

    Raises
    ------
    ValueError
        If the weights are not those of such a network.
    ModuleNotFoundError
        If h5py is not installed, and needed.
    OSError
        If a file cannot be read.
    """
    path = Path(path)
    name, weights = read_weights(path)
    source = Source(path if path.is_file() else None, "decoded from a neural BRDF (Sztrajman et al. 2021)")
    planes = _decode(weights)
    return MeasuredBRDF(name, planes, np.ones(N_CHANNELS), *cell_angles(convention), convention, source)


def read_weights(path: Path) -> tuple[str, list[Array]]:
    """Name of a network, and its six arrays as float64, known to fit each other; raises as `read_nbrdf`."""
    files = npy_set(path)
    if files is None:
        return path.stem, _checked(_keras_layers(path), path)
    name = files["fc1"].name.removesuffix("_fc1.npy")
    return name, _checked([read_npy_array(file) for file in files.values()], path)


def _keras_layers(path: Path) -> list[Array]:
    """Matrices and offsets in the order of the layers, which the shapes of the matrices tell."""
    if _files.regular_size(path) > MAX_BYTES:
        raise ValueError(f"{path}: not a neural BRDF: more than {MAX_BYTES:,} bytes.")
    try:
        import h5py
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "Keras files need h5py: pip install 'dsbrdf[hdf5]'", name=error.name
        ) from None
    layers: dict[str, dict[str, Array]] = {}

    def visit(name: str, item: object) -> None:
        group, _, last = name.rpartition("/")
        kind = last.split(":")[0]
        if isinstance(item, h5py.Dataset) and kind in ("kernel", "bias") and "optimizer" not in name:
            if item.dtype.kind != "f" or item.size is None or item.size > MAX_WIDTH**2 or item.external:
                raise ValueError(f"array {name} of {item.dtype} {item.shape}")
            layers.setdefault(group, {})[kind] = np.asarray(item[()])

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise ValueError(f"{path}: not a sound Keras file of a neural BRDF: {error}") from None
    whole = [layer for layer in layers.values() if len(layer) == 2 and layer["kernel"].ndim == 2]
    whole.sort(
        key=lambda layer: (layer["kernel"].shape[0] != N_INPUTS, layer["kernel"].shape[1] == N_CHANNELS)
    )
    return [layer[kind] for layer in whole for kind in ("kernel", "bias")]


def _checked(layers: Sequence[NDArray[Any]], path: Path) -> list[Array]:
    """The six arrays as float64."""
    shapes = [array.shape for array in layers]
    fits = len(layers) == len(PARTS) and all(len(shape) == 2 - i % 2 for i, shape in enumerate(shapes))
    if fits:
        widths = [N_INPUTS, *(shape[-1] for shape in shapes[1::2])]
        expected = [part for a, b in itertools.pairwise(widths) for part in ((a, b), (b,))]
        fits = shapes == expected and widths[-1] == N_CHANNELS and max(widths) <= MAX_WIDTH
    if not fits or any(array.dtype.kind != "f" for array in layers):
        raise ValueError(
            f"{path}: not a neural BRDF: expected layers of 6 to n to m to 3 numbers, n and m at most {MAX_WIDTH}, got "
            f"arrays of shape {shapes!s:.200}."
        )
    arrays = [array.astype(np.float64) for array in layers]
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError(f"{path}: not a sound neural BRDF: a weight is not finite. Fetch it again.")
    return arrays


def _decode(weights: list[Array]) -> Array:
    """Table (channel, theta_h, theta_d, phi_d) in 1/sr; -1 where a direction is below the horizon."""
    theta_h, theta_d, phi_d = cell_angles("edge")
    planes = np.empty((N_CHANNELS, *SHAPE))
    across = np.sin(theta_d)[:, None] * np.cos(phi_d), np.sin(theta_d)[:, None] * np.sin(phi_d)
    along = np.broadcast_to(np.cos(theta_d)[:, None], across[0].shape)
    for i, theta in enumerate(theta_h):
        wi, wo = half_diff.to_directions(theta, theta_d[:, None], phi_d)
        both = [_network(weights, theta, sign * across[0], sign * across[1], along) for sign in (1.0, -1.0)]
        # One mean for all: what overflows is invalid
        values = np.where((wi[..., 2] > 0.0) & (wo[..., 2] > 0.0), 0.5 * (both[0] + both[1]), -1.0)
        planes[:, i] = values
    return planes


def _network(weights: list[Array], theta_h: float, x: Array, y: Array, z: Array) -> Array:
    """Values (channel, theta_d, phi_d) for one half vector and many difference vectors."""
    w1, b1, w2, b2, w3, b3 = weights
    half = np.sin(theta_h) * w1[0] + np.cos(theta_h) * w1[2] + b1
    with np.errstate(over="ignore", invalid="ignore"):
        a = np.maximum(np.stack([x, y, z], axis=-1) @ w1[3:] + half, 0.0)
        a = np.maximum(a @ w2 + b2, 0.0)
        return np.moveaxis(np.maximum(np.expm1(a @ w3 + b3), 0.0), -1, 0)
