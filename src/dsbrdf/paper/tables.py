"""The measured materials that the experiments run on, and the paper's model of one."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from dsbrdf.measured import built_in, read_merl
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.paper.collapse import slice_profiles
from dsbrdf.paper.fit import fit_slices
from dsbrdf.paper.fit_report import SliceFit
from dsbrdf.paper.slice_fit import ConvergenceWarning

__all__ = ["Tables", "open_tables", "paper_fit"]


@dataclass(frozen=True, eq=False)
class Tables:
    """Materials by name.

    Parameters
    ----------
    title : str
        What they are, for headings.
    names : sequence of str
    load : callable
        Table of a name.
    skipped : sequence of str, optional
        Why files of the folder are left out, one line each.
    """

    title: str
    names: Sequence[str]
    load: Callable[[str], MeasuredBRDF] = field(repr=False)
    skipped: Sequence[str] = ()

    def pick(self, preferred: Sequence[str], n: int) -> list[str]:
        """`preferred` if all are here, else `n` names that differ in how far the highlight stands out."""
        if all(name in self.names for name in preferred):
            return list(preferred)
        ranked = sorted(self.names, key=lambda name: -_contrast(self.load(name)))
        index = np.linspace(0, len(ranked) - 1, min(n, len(ranked))).round().astype(int)
        return [ranked[i] for i in index]

    def sample(self, n: int) -> list[str]:
        """At most `n` names, evenly spread over the list."""
        index = np.linspace(0, len(self.names) - 1, min(n, len(self.names))).round().astype(int)
        return [self.names[i] for i in index]


def _contrast(measured: MeasuredBRDF) -> float:
    """Largest over median mean of the first slice, over all channels."""
    (profile,) = slice_profiles(measured, n_slices=1)
    values = profile.moments[..., 1].sum(0)[profile.count.sum(0) > 0.0]
    return float(values.max() / max(float(np.median(values)), 1e-12)) if values.size else 0.0


def open_tables(data: Path | None) -> Tables:
    """Materials of a folder of MERL .binary files, or the built-in ones.

    Parameters
    ----------
    data : Path or None
        Files of other kinds are passed over; damaged .binary files too, and named in `skipped`.

    Raises
    ------
    ValueError
        If there is no such folder, or no readable .binary file in it.
    """
    if data is None:
        return Tables("built-in materials", built_in.names(), lru_cache(maxsize=3)(built_in.material))
    if not data.is_dir():
        raise ValueError(f"{data}: no such folder. Give a folder of MERL .binary files.")
    files, skipped = {}, []
    for path in sorted(data.iterdir()):
        if path.suffix.lower() != ".binary" or not path.is_file():
            continue
        try:
            files[read_merl(path).name] = path
        except (OSError, ValueError) as error:
            skipped.append(str(error))
    if not files:
        why = f" ({skipped[0]})" if skipped else ""
        raise ValueError(f"{data}: no readable .binary file in this folder{why}.")
    name = data.resolve().name
    return Tables(name, tuple(files), lambda material: read_merl(files[material]), tuple(skipped))


def paper_fit(
    measured: MeasuredBRDF, n_lobes: int | str = "auto", *, method: str = "joint", azimuthal: bool = False
) -> SliceFit:
    """Fit the paper's model: no azimuthal term, lobes ordered by kappa; slices out of iterations pass."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return fit_slices(measured, n_lobes, method=method, azimuthal=azimuthal, order="kappa")
