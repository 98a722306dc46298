"""The estimator: lobes grown one by one on a part of the observations, chosen, and brought to the end on all of them.

The work is done in the kernel (`crates/dsbrdf-core`: estimator, growth). What is minimised is `Estimate.objective`,
twice the negative logarithm of the posterior with the noise integrated out: `n ln(S) + penalty`, with S the weighted
mean of squared residuals and n the independent observations that the data are worth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core
from dsbrdf._brief import Brief
from dsbrdf.fitting import energy
from dsbrdf.fitting.observations import Observations
from dsbrdf.fitting.options import AUTO, FitOptions
from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes, curve_design
from dsbrdf.space import Gaussian
from dsbrdf.space import process as processes
from dsbrdf.space.process import Expectation

__all__ = ["Estimate", "estimate", "lobes_of", "unknowns_of"]

Array = NDArray[np.float64]

#: Most lobes that the choice goes up to.
MAX_CHOSEN = 6
#: Coefficients of curves that do not vary with theta_d.
CONSTANT = (1, 1, 1, 1, 1)
#: Positions that lobes are grown on, and those that they are brought near the end on; one azimuth each.
N_GROWTH = 1500
N_NEAR = 2500
#: Decrease of the objective over some iterations, relative, that ends the search near the end and at it.
TOLERANCE = 3e-3
LAST_TOLERANCE = 1e-2
#: Inverse squares of what is usual of second and first differences of coefficients, and of colours, beta and falloff.
PENALTY = (0.25, 0.25, 0.1)
#: Height of a lobe that is not there, `ln kappa`.
ABSENT = -30.0
#: What a space expects counts as so many observations, and ends the search as above: it is itself no more exact.
SUPPORT, SUPPORT_TOLERANCE = 100.0, 0.3
#: Most steps of a search for the lobes nearest to a reflectance.
NEAREST_STEPS = 60
#: How many times as bright a lobe may be at a theta_d of 90 degrees as at its last coefficient before.
RISE = 3.0
#: RMS of the residuals of one scan that lobes without change over theta_d may have.
ENOUGH = 0.03
#: More channels than this are grown as so many means of neighbours.
MAX_GROWN_CHANNELS = 3


@dataclass(frozen=True, repr=False)
class _Options(Brief):
    """What the kernel takes."""

    sizes: tuple[int, ...]
    loss: str
    offset: list[float]
    penalty: tuple[float, float, float]
    n_effective: float


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Brief):
    """Lobes that were found.

    Parameters
    ----------
    lobes : Lobes
    objective : float
        What was minimised; it never rises with one lobe more.
    squares : float
        Weighted mean of squared residuals.
    criteria : (n_lobes,) ndarray
        What chose the number of lobes, for 1, 2, ... lobes; lower is better. Empty if it was given.
    iterations : int
    converged : bool
    options : object
        Of the kernel, as they were at the end.
    observations : Observations
        What was fitted, with the weights at the end.
    prior : Gaussian, Expectation or None
    """

    lobes: Lobes
    objective: float
    squares: float
    criteria: Array
    iterations: int
    converged: bool
    options: _Options
    observations: Observations
    prior: Gaussian | Expectation | None = None


def unknowns_of(lobes: Lobes) -> Array:
    """Unknowns (unknown,) of the estimator: shared curves of each lobe, then each channel's colours, lobe by lobe."""
    shared = np.concatenate([lobes.scale, lobes.gamma, lobes.beta, lobes.falloff], axis=1)
    colour = lobes.colour.ravel() if lobes.n_channels > 1 else np.empty(0)
    return np.concatenate([shared.ravel(), colour])


def lobes_of(x: Array, sizes: tuple[int, ...], n_lobes: int, n_channels: int) -> Lobes:
    """Lobes of unknowns, from flat to sharp; colours add up to zero where the scale of a lobe can hold their mean."""
    *shared_sizes, n_colour = sizes
    n_shared = n_lobes * sum(shared_sizes)
    shared = np.split(x[:n_shared].reshape(n_lobes, -1), np.cumsum(shared_sizes)[:-1], axis=1)
    scale, gamma, beta, falloff = (part.copy() for part in shared)
    colour = np.zeros((n_channels, n_lobes, n_colour))
    if n_channels > 1:
        colour = x[n_shared:].reshape(n_channels, n_lobes, n_colour)
        n_scale = scale.shape[1]
        if n_colour == n_scale or n_colour <= min(n_scale, 3):
            mean = colour.mean(0)
            colour = colour - mean
            scale += _as_size(mean, n_scale)
    order = np.argsort(gamma.mean(1), kind="stable")
    return Lobes(scale[order], gamma[order], beta[order], falloff[order], colour[:, order])


def _as_size(coefficients: Array, size: int) -> Array:
    """Constants, lines and parabolas (curve, coefficient) as curves of `size` coefficients, exactly."""
    if coefficients.shape[1] == size:
        return coefficients
    x = np.linspace(0.0, 1.0, 4 * size + 1)
    values = curve_design(x, coefficients.shape[1]) @ coefficients.T
    return np.asarray(np.linalg.lstsq(curve_design(x, size), values)[0].T, dtype=np.float64)


def estimate(
    observations: Observations, options: FitOptions, prior: Gaussian | Expectation | None = None
) -> Estimate:
    """Find lobes.

    Parameters
    ----------
    observations : Observations
    options : FitOptions
    prior : Gaussian or Expectation, optional
        Of as many channels; it decides on the lobes and their curves.
    """
    if isinstance(prior, Expectation):
        return _as_expected(observations, options, prior)
    if prior is not None:
        return _with_prior(observations, options, prior)
    most = MAX_CHOSEN if options.n_lobes == AUTO else int(options.n_lobes)
    candidates = []
    # Where few angles were measured, curves that vary would explain what the lobes should
    is_open = options.n_lobes == AUTO and not observations.is_table
    for sizes in (CONSTANT, options.sizes) if is_open else (options.sizes,):
        how = _Options(sizes, options.loss, observations.offset.tolist(), PENALTY, observations.n_effective)
        path = _grown(observations, how, most)
        criteria = np.array([_criterion(observations, how, found) for found in path])
        best = int(criteria.argmin()) if options.n_lobes == AUTO else most - 1
        candidates.append((criteria[best], how, path[best], criteria, path))
        # One scan does not tell theta_h from theta_d: what needs no change over theta_d has none
        if observations.is_one_scan and path[best]["squares"] < ENOUGH**2:
            break
    _, how, chosen, criteria, path = min(candidates, key=lambda candidate: candidate[0])
    if options.n_lobes != AUTO:
        criteria = np.empty(0)
    # What was grown on few positions may be worse on more of them than one lobe less
    starts = [chosen]
    if chosen["n_lobes"] > 1:
        starts.append(_padded(path[chosen["n_lobes"] - 2], how.sizes))

    def refined(start: _core._Solution, part: _core.Observations, tolerance: float) -> _core._Solution:
        x = start["x"].tolist()
        return part.refine(how, start["n_lobes"], x, iterations=options.max_iterations, tolerance=tolerance)

    part = observations.kernel.thinned(N_NEAR)
    near = min((refined(start, part, TOLERANCE) for start in starts), key=lambda found: found["objective"])
    end = refined(near, observations.kernel, LAST_TOLERANCE)
    lobes = lobes_of(end["x"], how.sizes, end["n_lobes"], observations.n_channels)
    if observations.light is not None and options.loss != "l2":
        lobes = energy.keep_light(
            lobes,
            observations.log_cos,
            observations.x,
            observations.azimuth,
            observations.values.mean(-1),
            observations.light,
        )
    iterations, converged, squares = (
        chosen["iterations"] + end["iterations"],
        end["converged"],
        end["squares"],
    )
    if not observations.is_table:
        # Noise draws the minimum of logarithms down, and that of weights that follow it up
        how = replace(how, loss="gamma" if options.loss == "log" else options.loss)
        observations = observations.weighed_by(lobes)
        last = refined(end, observations.kernel, LAST_TOLERANCE)
        lobes = lobes_of(last["x"], how.sizes, last["n_lobes"], observations.n_channels)
        iterations, converged = iterations + last["iterations"], converged and last["converged"]
        squares = last["squares"]
    return Estimate(lobes, end["objective"], squares, criteria, iterations, converged, how, observations)


def _padded(found: _core._Solution, sizes: tuple[int, ...]) -> _core._Solution:
    """A solution with one more lobe, which is not there."""
    *shared, n_colour = sizes
    n_lobes = found["n_lobes"]
    absent = np.repeat((ABSENT, 1.0, 0.0, 0.0), shared)
    x, colour = np.split(found["x"], [n_lobes * sum(shared)])
    colour = (
        np.pad(colour.reshape(-1, n_lobes * n_colour), ((0, 0), (0, n_colour))) if colour.size else colour
    )
    return {**found, "n_lobes": n_lobes + 1, "x": np.concatenate([x, absent, colour.ravel()])}


def _grown(observations: Observations, how: _Options, most: int) -> list[_core._Solution]:
    """Fits with 1 to `most` lobes on a part of the observations."""
    n_channels = observations.n_channels
    if n_channels <= MAX_GROWN_CHANNELS:
        return observations.kernel.thinned(N_GROWTH).grow(how, most)
    groups = np.arange(n_channels) * MAX_GROWN_CHANNELS // n_channels
    few = _grouped(observations, groups)
    few_how = _Options(how.sizes, how.loss, few.offset.tolist(), how.penalty, how.n_effective)
    path = few.kernel.thinned(N_GROWTH).grow(few_how, most)
    for found in path:
        n_shared = found["n_lobes"] * sum(how.sizes[:-1])
        colour = found["x"][n_shared:].reshape(MAX_GROWN_CHANNELS, -1)[groups]
        found["x"] = np.concatenate([found["x"][:n_shared], colour.ravel()])
    return path


def _grouped(observations: Observations, groups: NDArray[np.int_]) -> Observations:
    """Observations of means over channels (channel,) of the same group."""
    values, weights = [], []
    for group in range(groups.max() + 1):
        weight = observations.weights[..., groups == group]
        total = weight.sum(-1)
        of_group = (weight * observations.values[..., groups == group]).sum(-1)
        values.append(np.divide(of_group, total, out=np.zeros_like(total), where=total > 0.0))
        weights.append(total)
    return Observations(
        observations.log_cos,
        observations.x,
        observations.azimuth,
        np.stack(values, axis=-1),
        np.stack(weights, axis=-1),
        observations.n_effective,
    )


def _criterion(observations: Observations, how: _Options, found: _core._Solution) -> float:
    """Bayesian information criterion of a fit; the colour of the first channel is part of the scale."""
    *shared, colour = how.sizes
    numbers = found["n_lobes"] * (
        sum(shared) + (min(observations.n_channels, MAX_GROWN_CHANNELS) - 1) * colour
    )
    # As many numbers as values would explain anything
    least = found["n_lobes"] == 1 and how.sizes == CONSTANT
    if not least and 3 * numbers > 2 * np.count_nonzero(observations.weights):
        return float("inf")
    return found["objective"] + numbers * float(np.log(max(observations.n_effective, 2.0)))


def _with_prior(observations: Observations, options: FitOptions, prior: Gaussian) -> Estimate:
    how = _Options(
        tuple(prior.sizes),
        options.loss,
        observations.offset.tolist(),
        (0.0, 0.0, 0.0),
        observations.n_effective,
    )
    end = observations.kernel.refine(
        how,
        prior.n_lobes,
        prior.mean.tolist(),
        iterations=options.max_iterations,
        tolerance=TOLERANCE,
        prior=(prior.mean.tolist(), prior.precision.ravel().tolist()),
    )
    lobes = lobes_of(end["x"], how.sizes, prior.n_lobes, observations.n_channels)
    prior = _in_order(prior, end["x"], observations.n_channels)
    return _given(end, lobes, how, observations, prior)


def _given(
    end: _core._Solution,
    lobes: Lobes,
    how: _Options,
    observations: Observations,
    prior: Gaussian | Expectation,
) -> Estimate:
    """The estimate of a prior, which has chosen the number of lobes."""
    parts = (end["objective"], end["squares"], np.empty(0), end["iterations"], end["converged"])
    return Estimate(lobes, *parts, how, observations, prior)


def _in_order(prior: Gaussian, x: Array, n_channels: int) -> Gaussian:
    """The prior with its lobes in the order in which `lobes_of` has those of the unknowns."""
    *shared, n_colour = prior.sizes
    n_lobes = prior.n_lobes
    rows, colours = np.split(np.arange(len(x)), [n_lobes * sum(shared)])
    rows = rows.reshape(n_lobes, -1)
    gamma = x[rows[:, shared[0] : shared[0] + shared[1]]].mean(1)
    order = np.argsort(gamma, kind="stable")
    if colours.size:
        colours = colours.reshape(n_channels, n_lobes, n_colour)[:, order]
    at = np.concatenate([rows[order].ravel(), colours.ravel()])
    return replace(prior, mean=prior.mean[at], precision=prior.precision[np.ix_(at, at)])


def with_support(observations: Observations, expected: Expectation) -> Observations:
    """Observations, and what is expected at the directions that stand for all.

    What is expected counts as `SUPPORT` observations, and each of them the less, the less certain it is.
    """
    positions, area = processes.support()
    at = expected.process.at_support
    n_nodes = observations.azimuth.shape[1]
    values = processes.unscaled(expected.mean(at))
    certain = SUPPORT * area[:, None] * (expected.noise / expected.deviation(at)) ** 2 / n_nodes
    weights = observations.n_effective * observations.weights / observations.weights.sum()
    return Observations(
        np.concatenate([observations.log_cos, positions.log_cos]),
        np.concatenate([observations.x, positions.x]),
        np.concatenate([observations.azimuth, np.repeat(positions.azimuth[:, None], n_nodes, axis=1)]),
        np.concatenate([observations.values, np.repeat(values[:, None], n_nodes, axis=1)]),
        np.concatenate([weights, np.repeat(certain[:, None], n_nodes, axis=1)]),
        observations.n_effective + SUPPORT,
    )


def nearest_lobes(observations: Observations, sizes: tuple[int, ...], n_lobes: int, start: Array) -> Array:
    """Unknowns (unknown,) of the lobes nearest to values of a reflectance, by one search from some unknowns."""
    offset = [processes.OFFSET] * observations.n_channels
    how = _Options(sizes, "log", offset, PENALTY, observations.n_effective)
    end = observations.kernel.refine(
        how, n_lobes, start.tolist(), iterations=NEAREST_STEPS, tolerance=SUPPORT_TOLERANCE
    )
    return _ending_low(end["x"], sizes, n_lobes)


def _ending_low(x: Array, sizes: tuple[int, ...], n_lobes: int) -> Array:
    """Unknowns whose lobes rise to 90 degrees of theta_d, where nothing is expected, no more than Fresnel's factor."""
    *shared, _ = sizes
    if shared[0] < 2:
        return x
    x = x.copy()
    scale = x[: n_lobes * sum(shared)].reshape(n_lobes, -1)[:, : shared[0]]
    before = np.minimum(scale[:, 1], MAX_LN_KAPPA - 1.0)
    scale[:, 0] = np.minimum(scale[:, 0], np.log(np.log1p(RISE * np.expm1(np.exp(before)))))
    return x


def _as_expected(observations: Observations, options: FitOptions, expected: Expectation) -> Estimate:
    """The lobes nearest to the observations and to what is expected of the material."""
    process, n_channels = expected.process, observations.n_channels
    joined = with_support(observations, expected)
    offset = [processes.OFFSET] * n_channels
    how = _Options(tuple(process.sizes), options.loss, offset, PENALTY, joined.n_effective)
    end = joined.kernel.refine(
        how,
        process.n_lobes,
        expected.unknowns.tolist(),
        iterations=options.max_iterations,
        tolerance=SUPPORT_TOLERANCE,
    )
    x = _ending_low(end["x"], how.sizes, process.n_lobes)
    return _given(end, lobes_of(x, how.sizes, process.n_lobes, n_channels), how, observations, expected)
