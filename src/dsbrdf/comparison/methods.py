"""What is compared: methods that are fitted, and models from elsewhere that are only judged."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dsbrdf import _files
from dsbrdf.baselines import fit_bivariate, fit_fresnel_ggx, fit_ggx_pair, fit_lambert_ggx
from dsbrdf.fitting.fit import fit
from dsbrdf.measured.formats import nbrdf
from dsbrdf.measured.read import read
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model import file as model_file
from dsbrdf.paper import fit_slices

__all__ = ["METHODS", "Folder", "Method", "content_of", "key_of", "n_parameters"]

Measured = MeasuredBRDF | Samples
#: Endings of a material's file in a folder of models from elsewhere, the first that there is.
ENDINGS = (".json", ".h5", "_fc1.npy", ".binary", ".bsdf")


@dataclass(frozen=True)
class Method:
    """A way from a measurement to a reflectance.

    Parameters
    ----------
    label : str
        In tables and figures.
    fit : callable
        `fit(measured)`, anything with `eval` and perhaps `n_parameters`. For processes it must be a function of a
        module.
    tables : bool
        Whether it takes tables only.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.comparison.METHODS["ggx"].model(dsbrdf.material("rough-gold")).n_parameters
    7
    """

    label: str
    fit: Callable[[Any], Any]
    tables: bool = False

    def model(self, measured: Measured) -> Any:
        """The reflectance; that a search ran out of iterations is not told.

        Raises
        ------
        ValueError
            If scattered samples are given to what takes tables.
        """
        if self.tables and isinstance(measured, Samples):
            raise ValueError("takes tables only, not scattered samples")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self.fit(measured)

    def key(self, name: str) -> str | None:  # noqa: ARG002
        """What tells a model of this method for a material from others; empty if the measurement tells all."""
        return ""


@dataclass(frozen=True)
class Folder:
    """Models of materials that were made elsewhere, named like the materials: they are judged, not fitted.

    Parameters
    ----------
    label : str
    folder : Path
        Holds NAME.json, a model file; or weights of a neural BRDF, NAME.h5 or NAME_fc1.npy to NAME_b3.npy; or
        NAME.binary or NAME.bsdf, any model as a table.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dsbrdf.comparison import Folder
    >>> Folder("mine", Path("models")).find("no such material") is None
    True
    """

    label: str
    folder: Path

    def find(self, name: str) -> Path | None:
        """The file of a material, None if there is none."""
        plain = _files.file_name(name)
        paths = (self.folder / f"{plain}{ending}" for ending in ENDINGS)
        return next((path for path in paths if path.is_file()), None)

    def model(self, measured: Measured) -> Any:
        """The model for a material.

        Raises
        ------
        FileNotFoundError
            If there is none.
        ValueError
            If its file is not sound.
        """
        path = self.find(measured.name)
        if path is None:
            raise FileNotFoundError(f"no model of {measured.name} in {self.folder}")
        return model_file.load(path) if path.suffix == ".json" else _Read(path, measured)

    def key(self, name: str) -> str | None:
        """What tells the model for a material from others; None if there is none."""
        path = self.find(name)
        return None if path is None else content_of(path)


class _Read:
    """A table, or the table of a neural BRDF, and how many numbers it was made of."""

    def __init__(self, path: Path, measured: Measured) -> None:
        # Weights may be what is measured, too
        is_same = measured.source.file is not None and measured.source.file.resolve() == path.resolve()
        content = measured if is_same else read(path)
        if isinstance(content, Samples):
            raise ValueError(f"{path}: scattered samples are no model.")
        is_network = path.suffix in (".h5", ".npy")
        weights = nbrdf.read_weights(path)[1] if is_network else ()
        self.n_parameters = sum(part.size for part in weights) or int(np.isfinite(content.values).sum())
        self.eval = content.eval


def _standard(measured: Measured) -> Any:
    return fit(measured).model


def _compact(measured: Measured) -> Any:
    return fit(measured, curves="compact").model


def _slices(measured: Any) -> Any:
    return fit_slices(measured).model


#: By the name that options have.
METHODS: Mapping[str, Method] = {
    "standard": Method("dsbrdf.fit", _standard),
    "compact": Method("dsbrdf.fit, compact", _compact),
    "slices": Method("the paper's slices", _slices, tables=True),
    "ggx": Method("Lambert + GGX", fit_lambert_ggx),
    "fresnel": Method("Lambert + GGX, Fresnel", fit_fresnel_ggx),
    "ggx-pair": Method("Lambert + two GGX", fit_ggx_pair),
    "bivariate": Method("bivariate table", fit_bivariate, tables=True),
}


def content_of(path: Path) -> str:
    """SHA-256 of a file, or of all that belong to it."""
    parts = nbrdf.npy_set(path) or {"": path}
    return "".join(_files.sha256(part) for part in parts.values())


def n_parameters(model: Any) -> float:
    """Numbers of a model, NaN if it does not say."""
    return float(getattr(model, "n_parameters", float("nan")))


def key_of(parts: Sequence[Any], reading: Mapping[str, Any]) -> str:
    """A short text that stands for what a result was made of."""
    text = json.dumps([*parts, reading], default=str, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
