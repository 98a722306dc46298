"""`fit`: measured reflectance to a model, for tables and scattered samples alike."""

from __future__ import annotations

import dataclasses
import html
import time
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf.fitting import estimator, metrics, uncertainty
from dsbrdf.fitting.coverage import Coverage
from dsbrdf.fitting.observations import Observations
from dsbrdf.fitting.options import FitOptions
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.table import MeasuredBRDF
from dsbrdf.model.dsbrdf import DSBRDF, channel_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dsbrdf.space import Gaussian, MaterialSpace
    from dsbrdf.space.process import Expectation

__all__ = ["ConvergenceWarning", "Fit", "PriorWarning", "fit"]

Array = NDArray[np.float64]

#: Rows of theta_d of a table that are kept for plots.
N_PROFILE = 18
#: Angles, degrees, of standard errors.
ERROR_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)


#: Name of the built-in library as a prior.
LIBRARY = "library"
#: Positions up to which the library as a prior comes nearer on nine materials in ten (record 0023), and its channels.
FEW, N_LIBRARY_CHANNELS = 64, 3
#: RMS of what a prior leaves of logarithms, above which a material is none of those that it knows.
UNLIKE = 0.25


class PriorWarning(UserWarning):
    """A material is unlike those of the prior."""


class ConvergenceWarning(UserWarning):
    """A fit ran out of iterations."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A model, how good it is and how it came about.

    Parameters
    ----------
    model : DSBRDF
    measured : MeasuredBRDF or Samples
    options : FitOptions
    estimate : Estimate
        What the estimator found.
    observations : Observations
        What it was given.
    errors : FitErrors
        Over all that was measured, the whole hemisphere.
    seconds : float
        Time of the fit and its choices.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
    >>> found.model
    DSBRDF('grey-primer', 2 lobes, 3 channels (r, g, b), 36 numbers)
    >>> low, high = found.band([0.0, 0.0, 1.0], [0.6, 0.0, 0.8])
    >>> bool((low < high).all())
    True
    """

    model: DSBRDF
    measured: MeasuredBRDF | Samples = field(repr=False)
    options: FitOptions = field(repr=False)
    estimate: estimator.Estimate = field(repr=False)
    observations: Observations = field(repr=False)
    errors: metrics.FitErrors
    seconds: float

    @property
    def objective(self) -> float:
        """What was minimised, twice the negative logarithm of the posterior; it never rises with one lobe more."""
        return self.estimate.objective

    @property
    def converged(self) -> bool:
        """Whether the search ended before its last iteration."""
        return self.estimate.converged

    @cached_property
    def coverage(self) -> Coverage:
        """Which angles the measurement covers."""
        return Coverage.of(self.observations)

    @cached_property
    def posterior(self) -> uncertainty.Posterior:
        """Covariance of the unknowns; see `dsbrdf.fitting.uncertainty`."""
        return uncertainty.posterior(self.estimate)

    @property
    def n_decided(self) -> float:
        """How many numbers the data decided; the penalty or the prior decided the others."""
        return self.posterior.n_decided

    def standard_errors(self, theta_d: ArrayLike | None = None) -> uncertainty.StandardErrors:
        """Standard errors of the curves at angles (theta_d,) in radians, every 15 degrees by default.

        Raises
        ------
        ValueError
            If an angle is out of range.
        """
        return self.posterior.standard_errors(np.deg2rad(ERROR_ANGLES) if theta_d is None else theta_d)

    def std(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Standard deviations (..., channel) in 1/sr of values at pairs of directions (..., 3)."""
        return np.asarray(self.model.eval(wi, wo)) * self.posterior.deviation(wi, wo)

    def band(self, wi: ArrayLike, wo: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper bounds (..., channel) in 1/sr that hold values with this probability.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        return uncertainty.band(np.asarray(self.model.eval(wi, wo)), self.posterior.deviation(wi, wo), level)

    def plot(self) -> Figure:
        """Figure of measurement and model: a table's rows, or the scans of scattered samples and what is off.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ModuleNotFoundError
            If matplotlib is not installed.
        """
        from dsbrdf import plot

        return plot.sample_fit_figure(self) if isinstance(self.measured, Samples) else plot.fit_figure(self)

    def summary(self) -> dict[str, Any]:
        """Numbers that tell how good the fit is, ready for JSON."""
        return {
            "name": self.model.name,
            "n_lobes": self.model.n_lobes,
            "n_parameters": self.model.n_parameters,
            "channels": list(self.model.channels),
            **self.errors.summary(),
            **({} if self.estimate.prior is None else {"n_decided": self.n_decided}),
            "converged": self.converged,
            "objective": self.objective,
            "coverage": self.coverage.sentence,
            **({"remarks": self._remarks()} if isinstance(self.measured, Samples) else {}),
            "seconds": self.seconds,
        }

    def _remarks(self) -> list[str]:
        """What was read of samples, and what would be better."""
        remarks = list(self.measured.remarks) if isinstance(self.measured, Samples) else []
        few = self.coverage.n_values <= FEW and self.model.n_channels == N_LIBRARY_CHANNELS
        if few and self.estimate.prior is None:
            remarks.append(
                f"{self.coverage.n_values} values hardly tell a material from others: what those of the library are "
                "like fills in for the rest (--prior library, prior='library')"
            )
        return remarks

    def _repr_html_(self) -> str:
        """The measured and the fitted sphere and the errors, for notebooks; without matplotlib the errors alone."""
        head = (
            f"{self.model.name or 'unnamed'}: {self.model.n_lobes} lobes, {self.model.n_parameters} numbers"
        )
        errors = {key: value for key, value in self.errors.summary().items() if np.isfinite(value)}
        names = "".join(f"<th>{key.replace('_', ' ')}</th>" for key in errors)
        values = "".join(f"<td>{value:.3f}</td>" for value in errors.values())
        lines = [f"<b>{html.escape(head)}</b>", f"<table><tr>{names}</tr><tr>{values}</tr></table>"]
        try:
            from dsbrdf import plot
        except ModuleNotFoundError:
            pass
        else:
            lines.insert(1, f'<br><img alt="Measured and fitted sphere" src="{plot.sphere_picture(self)}">')
        if self.coverage.sentence:
            lines.append(html.escape(self.coverage.sentence))
        return "\n".join(lines)

    def __repr__(self) -> str:
        return (
            f"Fit({self.model!r},\n    {self.errors},\n    {self.coverage.sentence or 'all angles covered'},\n"
            f"    {self.seconds:.2f} s)"
        )


def fit(
    measured: MeasuredBRDF | Samples,
    n_lobes: int | str = "auto",
    *,
    loss: str = "log",
    curves: str = "standard",
    prior: MaterialSpace | Gaussian | str | None = None,
    max_iterations: int = 100,
) -> Fit:
    """Fit a model to a measured reflectance.

    Parameters
    ----------
    measured : MeasuredBRDF or Samples
        All valid values are fitted.
    n_lobes : int or "auto", optional
        As few as the data call for, by default, by the Bayesian information criterion (decision record 0016).
    loss : {"log", "gamma", "l2"}, optional
        See `FitOptions`.
    curves : {"standard", "compact"}, optional
        How many coefficients the curves over theta_d have; "compact" is at most 60 numbers for three channels.
    prior : "library", MaterialSpace or Gaussian, optional
        What materials are like, for few samples: those of the built-in library, or of a space of your own. It decides
        on the lobes and their curves.
    max_iterations : int, optional
        Of the last search.

    Returns
    -------
    Fit
        `model`, `errors` over the whole hemisphere, `standard_errors()`, `band(wi, wo)`, and how it came about.

    Raises
    ------
    TypeError
        If `measured` is neither a table nor samples.
    ValueError
        If an option is out of range, no value is valid, or the prior has other channels.

    Warns
    -----
    ConvergenceWarning
        If the search ran out of iterations.
    PriorWarning
        If no material of the prior is like the measured one.

    Examples
    --------
    >>> import dsbrdf
    >>> found = dsbrdf.fit(dsbrdf.material("grey-primer"), n_lobes=2)
    >>> found.model.n_lobes
    2
    """
    if not isinstance(measured, MeasuredBRDF | Samples):
        raise TypeError(
            f"'measured' must be a MeasuredBRDF or Samples, got {type(measured).__name__}. "
            "dsbrdf.read(path) reads a file; dsbrdf.Samples(wi, wo, values) holds arrays."
        )
    options = FitOptions(n_lobes, loss, curves, max_iterations)
    start = time.perf_counter()
    observations = Observations.of(measured)
    found = estimator.estimate(observations, options, _prior(prior, measured, observations))
    seconds = time.perf_counter() - start
    label = f"{measured.name}: " if measured.name else ""
    if not found.converged:
        warnings.warn(
            f"{label}the search ended after {options.max_iterations} iterations and may not be "
            "at a minimum. Allow more with 'max_iterations', or fit fewer lobes.",
            ConvergenceWarning,
            stacklevel=2,
        )
    miss = _miss(found, loss)
    if miss > UNLIKE:
        warnings.warn(
            f"{label}no material of the prior is like it: the fit misses the data by a factor of {np.exp(miss):.2f}. "
            "Fit it without a prior, or with one of more materials.",
            PriorWarning,
            stacklevel=2,
        )
    model = DSBRDF(
        found.lobes,
        channel_names(measured.channels, observations.n_channels),
        name=measured.name,
        source=measured.source,
        fit_options=dataclasses.asdict(options) | {"prior": prior is not None},
        profile=_profile(measured),
    )
    errors = metrics.errors(model, measured)
    model = model.replace(errors=errors.summary())
    return Fit(model, measured, options, found, observations, errors, seconds)


def _miss(found: estimator.Estimate, loss: str) -> float:
    """RMS of the logarithm by which materials of a prior miss the data, 0 without a prior."""
    if found.prior is None or loss == "l2":
        return 0.0
    noise = getattr(found.prior, "noise", None)
    return float(np.sqrt(found.squares)) if noise is None else float(noise)


def _prior(
    prior: MaterialSpace | Gaussian | str | None, measured: MeasuredBRDF | Samples, observations: Observations
) -> Gaussian | Expectation | None:
    """What the estimator takes: of a space, what it expects of a material with these values."""
    if prior is None:
        return None
    from dsbrdf.space import Gaussian, MaterialSpace, builtin

    if isinstance(prior, str):
        if prior != LIBRARY:
            raise ValueError(f"'prior' must be {LIBRARY!r}, a space or a Gaussian, got {prior!r}.")
        prior = builtin()
    _check.instance(prior, (MaterialSpace, Gaussian), "prior")
    n_channels = observations.n_channels
    of = f"{len(prior.channels)} channels"
    fits = len(prior.channels) == n_channels
    if isinstance(prior, Gaussian):
        *shared, colour = prior.sizes
        need = prior.n_lobes * (sum(shared) + (n_channels * colour if n_channels > 1 else 0))
        of, fits = f"{len(prior.mean)} unknowns", len(prior.mean) == need
    if not fits:
        raise ValueError(
            f"a measurement of {n_channels} channels does not go with this prior of {of}. "
            "Build a space of models with the same channels."
        )
    if isinstance(prior, Gaussian):
        return prior
    return expectation(prior, measured, observations)


def expectation(
    space: MaterialSpace, measured: MeasuredBRDF | Samples, observations: Observations
) -> Expectation:
    """What a space expects of a material that was measured."""
    from dsbrdf.space.process import Positions

    n_channels, n_nodes = observations.n_channels, observations.azimuth.shape[1]
    weights = (observations.weights > 0.0).astype(np.float64)
    if isinstance(measured, Samples) and measured.weights is not None:
        weights *= measured.weights[:, None, None]
    return space.process.given(
        Positions(
            np.repeat(observations.log_cos, n_nodes),
            np.repeat(observations.x, n_nodes),
            observations.azimuth.ravel(),
        ),
        observations.values.reshape(-1, n_channels),
        weights.reshape(-1, n_channels),
    )


def _profile(measured: MeasuredBRDF | Samples) -> MeasuredProfile | None:
    """Every few rows of a table, for plots."""
    if isinstance(measured, Samples):
        return None
    n = len(measured.theta_d)
    rows = np.unique(np.arange(min(N_PROFILE, n)) * n // min(N_PROFILE, n))
    moments = measured.moments(rows)
    theta_h = np.broadcast_to(measured.theta_h, (len(rows), len(measured.theta_h)))
    return MeasuredProfile.of(measured.theta_d[rows], theta_h, moments)
