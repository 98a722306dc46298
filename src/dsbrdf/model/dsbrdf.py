"""`DSBRDF`: a fitted reflectance, its values, its samples and its file. The work is done in the modules beside it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check, _text
from dsbrdf.geometry import half_diff
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.source import Source
from dsbrdf.model import evaluation
from dsbrdf.model.lobes import Lobes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["DSBRDF", "channel_names"]


@dataclass(frozen=True, eq=False)
class DSBRDF:
    """A reflectance as a sum of lobes of the half angle; `Lobes` has the formula.

    Parameters
    ----------
    lobes : Lobes
        NumPy arrays, or arrays of any library of the array API standard to keep gradients.
    channels : sequence of str, optional
        Names of the channels; r, g, b for three, value for one, by default.
    name : str, optional
    source : Source, optional
        The measurement that was fitted.
    fit_options, errors : mapping, optional
        Options used and errors reached by the fit.
    profile : MeasuredProfile, optional
        Summary of what was fitted, for plots.

    Raises
    ------
    ValueError
        If there is not a name for each channel.

    Examples
    --------
    >>> import dsbrdf
    >>> model = dsbrdf.library.load("nickel")
    >>> model.eval([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]).round(1)
    array([10.8,  9. ,  7.4])
    >>> model.lobe(-1).albedo(0.5).round(2)  # what the sharpest lobe reflects of the light from 0.5 radians
    array([0.04, 0.03, 0.03])
    """

    lobes: Lobes
    channels: Sequence[str] = ()
    name: str = ""
    source: Source = field(default_factory=Source)
    fit_options: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    profile: MeasuredProfile | None = None

    def __post_init__(self) -> None:
        _check.instance(self.lobes, Lobes, "lobes")
        object.__setattr__(self, "name", _text.well_formed(self.name))
        object.__setattr__(self, "channels", channel_names(self.channels, self.lobes.n_channels))

    @property
    def n_lobes(self) -> int:
        """Number of lobes."""
        return self.lobes.n_lobes

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return self.lobes.n_channels

    @property
    def n_parameters(self) -> int:
        """Numbers that describe the reflectance."""
        return self.lobes.n_parameters

    def replace(self, **changes: Any) -> DSBRDF:
        """Return a copy with some fields changed, e.g. `lobes` by arrays that carry gradients."""
        return dataclasses.replace(self, **changes)

    def eval(self, wi: Any, wo: Any) -> Any:
        """Values for pairs of directions.

        Parameters
        ----------
        wi, wo : (..., 3) arrays
            Unit vectors toward the light and the viewer, normal +z; NumPy, PyTorch, JAX or another library of
            the array API standard. They broadcast against each other.

        Returns
        -------
        (..., channel) array, 1/sr, without the cosine
            Zero where a direction is below the horizon. The same to the last bit with `wi` and `wo` exchanged.

        Raises
        ------
        ValueError
            If directions are not unit vectors.
        """
        return evaluation.evaluate(self.lobes, wi, wo)

    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> Any:
        """Values (..., channel) in 1/sr at half and difference angles in radians, which broadcast.

        Zero where one of the two directions would be below the horizon.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        return self.eval(*half_diff.to_directions(theta_h, theta_d, phi_d))

    def lobe(self, k: int) -> DSBRDF:
        """Lobe `k` alone, as a model; all lobes add up to the model (Section 6.B).

        Raises
        ------
        IndexError
            If there is no such lobe.
        """
        k = _check.index(k, "k")
        if not -self.n_lobes <= k < self.n_lobes:
            raise IndexError(f"lobe {k}: the model has {self.n_lobes} lobes, numbered from 0.")
        k %= self.n_lobes
        return self.replace(lobes=self.lobes.take(k), name=f"{self.name} lobe {k}", errors={}, profile=None)

    def albedo(self, theta_i: ArrayLike) -> NDArray[np.float64]:
        """Directional albedo: the share of light from `theta_i` that is reflected.

        Parameters
        ----------
        theta_i : (...) array_like, radians in [0, pi/2]

        Returns
        -------
        (..., channel) ndarray
            Can exceed 1: nothing in the model bounds it. Quadrature; relative error below 1e-3.
        """
        from dsbrdf.model import energy

        return energy.albedo(self, theta_i)

    def conserve_energy(self) -> DSBRDF:
        """The model, lowered where it reflects more light than it receives; the same if it does nowhere.

        Heights are lowered as functions of theta_d, so that reciprocity stays (see `dsbrdf.model.energy`). Up to 89
        degrees no albedo is above 1.001 afterwards. `errors` are dropped, as they are not those of the result.

        Raises
        ------
        RuntimeError
            If the albedo cannot be brought down.
        """
        from dsbrdf.model import energy

        return energy.conserve_energy(self)

    def sample(self, wo: ArrayLike, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw a direction toward the light for each direction toward the viewer.

        Parameters
        ----------
        wo : (..., 3) array_like
            Unit vectors above the horizon.
        rng : numpy.random.Generator

        Returns
        -------
        (..., 3) ndarray
            Unit vectors; those below the horizon carry no light and are to be given weight zero. Their density
            is `pdf`.

        Raises
        ------
        TypeError
            If the parameters carry gradients and have no values here.
        """
        from dsbrdf.model import sampling

        return sampling.sample(self.lobes, wo, rng)

    def pdf(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """Density (...) in 1/sr with which `sample` draws `wi` for `wo`, exactly; zero below the horizon."""
        from dsbrdf.model import sampling

        return sampling.pdf(self.lobes, wi, wo)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `dsbrdf.model.file`.

        Raises
        ------
        OSError
            If the file cannot be written; then nothing is left of it.
        TypeError
            If the parameters carry gradients and have no values here.
        """
        from dsbrdf.model import file

        file.save(self, path)

    def plot(self) -> Figure:
        """Figure of the curves of the lobes over theta_d.

        Raises
        ------
        ModuleNotFoundError
            If matplotlib is not installed.
        """
        from dsbrdf import plot

        return plot.parameter_figure(self)

    def _repr_html_(self) -> str:
        """The page of `dsbrdf.view`, for notebooks."""
        from dsbrdf import view

        return view.frame(self)

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        shown = ", ".join(self.channels[:3]) + (", ..." if self.n_channels > 3 else "")
        return f"DSBRDF({name}{self.n_lobes} lobes, {self.n_channels} channels ({shown}), {self.n_parameters} numbers)"


def channel_names(names: Sequence[str], n_channels: int) -> tuple[str, ...]:
    """The names as a tuple; r, g, b of three channels, value of one, and numbers of others, where there are none.

    Raises
    ------
    ValueError
        If there is not a name for each channel, or two are the same.
    """
    if isinstance(names, str) or not names:
        names = {1: ("value",), 3: ("r", "g", "b")}.get(n_channels) or tuple(map(str, range(n_channels)))
    found = tuple(_text.well_formed(str(name)) for name in names)
    if len(found) != n_channels or len(set(found)) != n_channels:
        raise ValueError(f"'channels' must be {n_channels} different names, got {list(found)!r:.200}.")
    return found
