"""`Slices`: the paper's model (Eqs. 5 and 6), lobes at some theta_d, a channel at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.grids import SHAPE
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.measured.table import tabulate as tabulate_reflectance
from dsbrdf.model import hemi_epd
from dsbrdf.model.dsbrdf import channel_names
from dsbrdf.paper import evaluation

if TYPE_CHECKING:
    from dsbrdf.paper.curves import CurveBasis, Curves

__all__ = ["Roughness", "Slices", "roughness"]

#: Fields that curves stand for.
PARAMETERS = ("theta_d", "kappa", "gamma", "beta", "spike")
#: Added to gamma before its logarithm: shapes below a tenth look alike.
GAMMA_OFFSET = 0.1


@dataclass(frozen=True, eq=False)
class Slices:
    """A reflectance as lobes whose parameters are given at some theta_d.

    The value is the sum over lobes of `expm1(kappa cos(theta_h)^gamma) (1 + beta g cos(2 phi_d))`, with g of
    `dsbrdf.half_diff.azimuthal_factor`, and the spike, in 1/sr and without the cosine. Between slices the values
    of the two nearest are interpolated linearly in theta_d; beyond the first and the last slice that one's hold.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
        Ascending.
    kappa, gamma, beta : (theta_d, channel, lobe) ndarray
        `kappa` > 0, `gamma` >= 0, `beta` within [-1, 1], 0 by default.
    spike : (theta_d, channel) ndarray, 1/sr, optional
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
    channels : sequence of str, optional
        Names of the channels; r, g, b for three, value for one, by default.

    Raises
    ------
    ValueError
        If shapes disagree, a value is out of range, or there is not a name for each channel.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf import paper
    >>> slices = paper.fit_slices(dsbrdf.material("matte"), 1).model
    >>> slices.eval([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]).round(2)
    array([0.19, 0.1 , 0.07])
    """

    theta_d: NDArray[np.float64]
    kappa: NDArray[np.float64]
    gamma: NDArray[np.float64]
    beta: NDArray[np.float64] = None  # type: ignore[assignment]
    spike: NDArray[np.float64] = None  # type: ignore[assignment]
    name: str = ""
    source: Source = field(default_factory=Source)
    fit_options: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    profile: MeasuredProfile | None = None
    curves: Curves | None = None
    channels: Sequence[str] = ()

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
            given = getattr(self, name)
            values = np.zeros(np.shape(self.kappa)) if given is None else _check.finite(given, name, **limits)
            if values.ndim != 3 or len(values) != theta_d.size or values.shape != np.shape(self.kappa):
                raise ValueError(
                    f"'{name}' must have shape (theta_d, channel, lobe) like 'kappa' with {theta_d.size} theta_d, "
                    f"got {values.shape}."
                )
            object.__setattr__(self, name, np.ascontiguousarray(values))
        shape = self.kappa.shape[:2]
        spike = np.zeros(shape) if self.spike is None else _check.finite(self.spike, "spike", low=0.0)
        if spike.shape != shape:
            raise ValueError(f"'spike' must have shape (theta_d, channel) {shape}, got {spike.shape}.")
        object.__setattr__(self, "spike", np.ascontiguousarray(spike))
        object.__setattr__(self, "channels", channel_names(self.channels, self.n_channels))

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.kappa.shape[1])

    @property
    def n_lobes(self) -> int:
        """Number of lobes in each slice and channel."""
        return int(self.kappa.shape[2])

    @property
    def n_parameters(self) -> int:
        """Numbers that describe the reflectance: beta and the spike count where there are any."""
        if self.curves is not None:
            return self.curves.n_parameters
        parts = (self.kappa, self.gamma, self.beta, self.spike)
        return sum(part.size for part in parts if part.any())

    def replace(self, **changes: Any) -> Slices:
        """Return a copy with some fields changed.

        With other parameters the copy has no `curves`, unless those are given too.
        """
        if not changes.keys().isdisjoint(PARAMETERS):
            changes = {"curves": None} | changes
        return dataclasses.replace(self, **changes)

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """Values for pairs of directions.

        Parameters
        ----------
        wi, wo : (..., 3) array_like
            Unit vectors toward the light and the viewer, normal +z. They broadcast against each other.

        Returns
        -------
        (..., channel) ndarray, 1/sr, without the cosine
            Zero where a direction is below the horizon. The same to the last bit with `wi` and `wo` exchanged.

        Raises
        ------
        ValueError
            If directions are not unit vectors.
        """
        return evaluation.evaluate(wi, wo, self.theta_d, self.kappa, self.gamma, self.beta, self.spike)

    def eval_angles(self, theta_h: ArrayLike, theta_d: ArrayLike, phi_d: ArrayLike) -> NDArray[np.float64]:
        """Values (..., channel) in 1/sr at half and difference angles in radians, which broadcast.

        Zero where one of the two directions would be below the horizon.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        return self.eval(*half_diff.to_directions(theta_h, theta_d, phi_d))

    def lobe(self, k: int) -> Slices:
        """Lobe `k` alone, as a model; all lobes and the spike add up to the model (Section 6.B).

        Raises
        ------
        IndexError
            If there is no such lobe.
        """
        if not -self.n_lobes <= k < self.n_lobes:
            raise IndexError(f"lobe {k}: the model has {self.n_lobes} lobes, numbered from 0.")
        k %= self.n_lobes
        parts: dict[str, Any] = {
            name: getattr(self, name)[..., k : k + 1] for name in ("kappa", "gamma", "beta")
        }
        parts["curves"] = self.curves.lobe(k) if self.curves else None
        return self.replace(**parts, spike=None, name=f"{self.name} lobe {k}", errors={}, profile=None)

    def to_curves(self, basis: CurveBasis | None = None, *, logarithmic: bool = True) -> Slices:
        """The model with its parameters smoothed over theta_d by splines (Section 6.C).

        Parameters
        ----------
        basis : CurveBasis, optional
            By default that of the paper: quadratic, five uniform knots.
        logarithmic : bool, optional
            Smooth ln(kappa) and ln(gamma), which stay positive; False is the paper.

        Returns
        -------
        Slices
            With `curves`, tabulated at every degree. The errors of the slices are not its own, and left out.
        """
        from dsbrdf.paper.curves import Curves

        curves = Curves.of(self, basis, logarithmic=logarithmic)
        kept = {key: getattr(self, key) for key in ("name", "source", "fit_options", "profile", "channels")}
        return curves.model(**kept)

    def tabulate(self, *, shape: tuple[int, int, int] = SHAPE, convention: str = "centre") -> MeasuredBRDF:
        """The model as a table, to be rendered, exported, sampled, or fitted by `dsbrdf.fit`.

        Parameters
        ----------
        shape, convention : optional
            As of `dsbrdf.tabulate`.

        Raises
        ------
        ValueError
            If an option is out of range.
        """
        return tabulate_reflectance(
            self.eval, self.name, shape=shape, convention=convention, source=self.source
        )

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        return f"Slices({name}{self.n_lobes} lobes, {self.n_channels} channels, {len(self.theta_d)} slices)"


@dataclass(frozen=True)
class Roughness:
    """Mean squared second difference from slice to slice of the curves of a model.

    Parameters
    ----------
    kappa : float
        Of ln(kappa).
    gamma : float
        Of ln(gamma + 0.1).
    """

    kappa: float
    gamma: float


def roughness(model: Slices) -> Roughness:
    """How rough the curves of kappa and gamma over theta_d are; low where lobes correspond between slices.

    Squares of second differences over three neighbouring slices are averaged over slices, channels and lobes. The
    weight is the least share of the light (of `expm1(kappa cos^gamma)` over the hemisphere of half vectors) that the
    lobe has in the three, so that lobes that come, go or are absent count for little. NaN with fewer than three slices.

    Parameters
    ----------
    model : Slices

    Returns
    -------
    Roughness
    """
    kappa, gamma = model.kappa, model.gamma
    if len(kappa) < 3:
        return Roughness(float("nan"), float("nan"))
    log_energy = -hemi_epd.log_normaliser(kappa, gamma)
    energy = np.exp(log_energy - log_energy.max(-1, keepdims=True))
    share = energy / energy.sum(-1, keepdims=True)
    weight = np.minimum(np.minimum(share[:-2], share[1:-1]), share[2:])
    curves = (np.log(kappa), np.log(gamma + GAMMA_OFFSET))
    return Roughness(*(float(np.average(np.diff(curve, 2, axis=0) ** 2, weights=weight)) for curve in curves))
