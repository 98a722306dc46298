"""`DSBRDF`: the fitted model (Eqs. 5 and 6), its evaluation, sampling and files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.measured.source import Source
from dsbrdf.model import evaluation
from dsbrdf.measured.profile import MeasuredProfile

if TYPE_CHECKING:
    from dsbrdf.paper.curves import CurveBasis, Curves

__all__ = ["DSBRDF"]

#: Fields that curves stand for.
PARAMETERS = ("theta_d", "kappa", "gamma", "beta", "spike")


@dataclass(frozen=True, eq=False)
class DSBRDF:
    """A reflectance as lobes whose parameters are given at some theta_d.

    The value is the sum over lobes of `expm1(kappa cos(theta_h)^gamma) (1 + beta g cos(2 phi_d))`, with g of
    `dsbrdf.half_diff.azimuthal_factor`, and the spike, in 1/sr and without the cosine. Between slices the values
    of the two nearest are interpolated linearly in theta_d; beyond the first and the last slice that one's hold.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
        Ascending.
    kappa, gamma, beta : (theta_d, channel, lobe) arrays
        `kappa` > 0, `gamma` >= 0, `beta` within [-1, 1], 0 by default; of NumPy, or of any library of the array API
        standard to keep gradients.
    spike : (theta_d, channel) array, 1/sr, optional
        Heights, at least 0, of the delta term: a cap of the half vector that ends at one degree (see
        `dsbrdf.paper.spike`); none by default.
    name : str, optional
    source : Source, optional
        The measurement that was fitted.
    fit_options, errors : mapping, optional
        Options used and errors reached by the fit.
    profile : MeasuredProfile, optional
        Summary of what was fitted, for plots.
    curves : Curves, optional
        The splines that the parameters are tabulated from, if they are (see `to_curves`).

    Raises
    ------
    ValueError
        If shapes disagree or a value is out of range.
    """

    theta_d: NDArray[np.float64]
    kappa: Any
    gamma: Any
    beta: Any = None
    spike: Any = None
    name: str = ""
    source: Source = field(default_factory=Source)
    fit_options: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    profile: MeasuredProfile | None = None
    curves: Curves | None = None

    def __post_init__(self) -> None:
        theta_d = _check.angle(self.theta_d, "theta_d")
        if theta_d.ndim != 1 or theta_d.size == 0 or (np.diff(theta_d) <= 0.0).any():
            raise ValueError("'theta_d' must be a non-empty ascending list of angles.")
        object.__setattr__(self, "theta_d", theta_d)
        checks: dict[str, dict[str, Any]] = {
            "kappa": {"low": 0.0, "open_low": True},
            "gamma": {"low": 0.0},
            "beta": {"low": -1.0, "high": 1.0},
        }
        for name, limits in checks.items():
            values = getattr(self, name)
            if name == "beta" and values is None:
                values = np.zeros(_shape(self.kappa))
            shape = _shape(values)
            if len(shape) != 3 or shape[0] != theta_d.size or shape != _shape(self.kappa):
                raise ValueError(
                    f"'{name}' must have shape (theta_d, channel, lobe) like 'kappa' with {theta_d.size} theta_d, "
                    f"got {shape}."
                )
            object.__setattr__(self, name, _checked(values, name, **limits))

        expected = _shape(self.kappa)[:2]
        spike = np.zeros(expected) if self.spike is None else self.spike
        if _shape(spike) != expected:
            raise ValueError(f"'spike' must have shape (theta_d, channel) {expected}, got {_shape(spike)}.")
        object.__setattr__(self, "spike", _checked(spike, "spike", low=0.0))

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.kappa.shape[1])

    @property
    def n_lobes(self) -> int:
        """Number of lobes in each slice and channel."""
        return int(self.kappa.shape[2])

    def replace(self, **changes: Any) -> DSBRDF:
        """Return a copy with some fields changed, e.g. `kappa` by an array that carries gradients.

        With other parameters the copy has no `curves`, unless those are given too.
        """
        if not changes.keys().isdisjoint(PARAMETERS):
            changes = {"curves": None} | changes
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
            If NumPy directions are not unit vectors.
        """
        return evaluation.evaluate(wi, wo, self.theta_d, self.kappa, self.gamma, self.beta, self.spike)

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
        """Lobe `k` alone, as a model; all lobes and the spike add up to the model (Section 6.B).

        Raises
        ------
        IndexError
            If there is no such lobe.
        """
        if not -self.n_lobes <= k < self.n_lobes:
            raise IndexError(f"lobe {k}: the model has {self.n_lobes} lobes, numbered from 0.")
        k %= self.n_lobes
        parts = {name: getattr(self, name)[..., k : k + 1] for name in ("kappa", "gamma", "beta")}
        parts["curves"] = self.curves.lobe(k) if self.curves else None
        return self.replace(**parts, spike=None, name=f"{self.name} lobe {k}", errors={}, profile=None)

    def to_curves(self, basis: CurveBasis | None = None, *, logarithmic: bool = True) -> DSBRDF:
        """The model with its parameters smoothed over theta_d by splines (Section 6.C).

        Parameters
        ----------
        basis : CurveBasis, optional
            By default that of the paper: quadratic, five uniform knots.
        logarithmic : bool, optional
            Smooth ln(kappa) and ln(gamma), which stay positive; False is the paper.

        Returns
        -------
        DSBRDF
            With `curves`, tabulated at every degree. `dsbrdf.fit` with `curves=True` fits curves to data and is
            more exact. The errors of the slices are not its own, and left out.
        """
        from dsbrdf.paper.curves import Curves

        curves = Curves.of(self, basis, logarithmic=logarithmic)
        kept = {key: getattr(self, key) for key in ("name", "source", "fit_options", "profile")}
        return curves.model(**kept)

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
        from dsbrdf.model import sampling

        return sampling.albedo(self, theta_i)

    def conserve_energy(self) -> DSBRDF:
        """The model, lowered where it reflects more light than it receives; the same if it does nowhere.

        Slices are lowered by a factor each, so that reciprocity stays; each lobe keeps its kind but for a little (see
        `dsbrdf.model.energy`). Up to 89 degrees no albedo is above 1.001 afterwards (1.004 of a near-mirror with an
        albedo of 17). `kappa`, `gamma` and `spike` change; `errors` are dropped, as they are not those of the result.

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
        """
        from dsbrdf.model import sampling

        return sampling.sample(self, wo, rng)

    def pdf(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """Density (...) in 1/sr with which `sample` draws `wi` for `wo`, exactly; zero below the horizon."""
        from dsbrdf.model import sampling

        return sampling.pdf(self, wi, wo)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `dsbrdf.model.file`.

        Raises
        ------
        OSError
            If the file cannot be written; then nothing is left of it.
        """
        from dsbrdf.model import file as model_file

        model_file.save(self, path)

    def _repr_html_(self) -> str:
        """The page of `dsbrdf.view`, for notebooks."""
        from dsbrdf import view

        return view.frame(self)

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        return f"DSBRDF({name}{self.n_lobes} lobes, {self.n_channels} channels, {len(self.theta_d)} slices)"


def _shape(values: Any) -> tuple[int, ...]:
    """Shape of an array of any library, or of what is none: empty for a scalar."""
    return tuple(values.shape) if hasattr(values, "shape") else np.shape(values)


def _checked(values: Any, name: str, **limits: Any) -> Any:
    """NumPy arrays and sequences as a checked array; arrays of other libraries as they are."""
    if isinstance(values, np.ndarray | list | tuple):
        return np.ascontiguousarray(_check.finite(values, name, **limits))
    return values
