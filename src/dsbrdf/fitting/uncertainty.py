"""How certain a fit is: the posterior at the solution, standard errors of parameters, and bands of values.

The covariance of the unknowns is `H^-1 (M + P) H^-1`, with H the Hessian of the posterior, M the sum of squares of the
scores of single positions, and P the curvature of the penalty or of the prior: residuals that differ in size from place
to place, or that the channels of a position share, are counted as they are (White 1980; Liang and Zeger 1986), each
divided by what its leverage leaves of it (MacKinnon and White 1985). What the data do not decide keeps the spread of P.
It speaks of noise in the measurement, not of what the model cannot describe elsewhere.

`linearise` is the readable twin of the kernel's residuals and derivatives, and what they are tested against.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf import _check
from dsbrdf._brief import Brief
from dsbrdf.fitting.estimator import PENALTY, Estimate, unknowns_of, with_support
from dsbrdf.fitting.observations import Observations
from dsbrdf.geometry import half_diff
from dsbrdf.model.lobes import MAX_LN_KAPPA, Lobes, curve_design
from dsbrdf.space import process as processes
from dsbrdf.space.process import Expectation, Positions

__all__ = ["Posterior", "StandardErrors", "linearise", "posterior", "value_jacobian"]

Array = NDArray[np.float64]

#: Most unknowns that a dense covariance is made of.
MAX_UNKNOWNS = 3000
#: Most angles of the text of `StandardErrors`.
MAX_ROWS = 12
#: Positions handled together.
CHUNK = 1000
#: Differences of logarithms above this count linearly in the gamma deviance; as in the kernel.
MAX_LOG_RATIO = 3.0
#: Least square of a relative error of measurement; less would drown the penalty and the prior in rounding.
LEAST_SQUARES = 1e-10
#: Least share of its own noise that a residual is taken to show.
LEAST_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class StandardErrors:
    """Standard errors of the curves at some theta_d; its text is a table of them.

    Parameters
    ----------
    theta_d : (theta_d,) ndarray, radians
    ln_kappa : (theta_d, channel, lobe) ndarray
    ln_gamma, beta, falloff : (theta_d, lobe) ndarray
    """

    theta_d: Array
    ln_kappa: Array
    ln_gamma: Array
    beta: Array
    falloff: Array

    def __repr__(self) -> str:
        kappa, gamma = 100.0 * self.ln_kappa.max(1), 100.0 * self.ln_gamma
        cells = [["theta_d", *(f"lobe {k}" for k in range(gamma.shape[1]))]]
        n_rows = min(len(gamma), MAX_ROWS)
        for i in np.unique(np.linspace(0, len(gamma) - 1, n_rows).round().astype(int)):
            errors = zip(kappa[i], gamma[i], self.beta[i], strict=True)
            shown = [
                f"{_percent(ln_kappa)} {_percent(ln_gamma)} {beta:6.2g}"
                for ln_kappa, ln_gamma, beta in errors
            ]
            cells.append([f"{np.rad2deg(self.theta_d[i]):.0f}", *shown])
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        rows = ["   ".join(map(str.rjust, row, widths)) for row in cells]
        title = "Standard errors of kappa (%, of the least certain channel), gamma (%) and beta"
        return "\n".join([title, *rows])


def _percent(value: float) -> str:
    return f"{value:4.2g}" if value < 99.5 else ">100"


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Brief):
    """Covariance of the unknowns at the solution.

    Parameters
    ----------
    lobes : Lobes
    covariance : (unknown, unknown) ndarray
        In the order of `dsbrdf.fitting.estimator.unknowns_of`.
    n_decided : float
        How many of the unknowns the data decided; the penalty or the prior decided the others.
    expected : Expectation or None
        What a space expects of the material; it decides on the deviations of values.
    """

    lobes: Lobes
    covariance: Array
    n_decided: float
    expected: Expectation | None = None

    def standard_errors(self, theta_d: ArrayLike) -> StandardErrors:
        """Standard errors of the curves at angles (theta_d,) in radians."""
        theta_d = _check.angle(theta_d, "theta_d")
        x = np.cos(theta_d)
        index = _Index(self.lobes)
        n_d, n_lobes, n_channels = len(x), self.lobes.n_lobes, self.lobes.n_channels
        shared = {
            name: np.stack(
                [
                    self._deviation([(index.shared(name, k), curve_design(x, index.size(name)))], n_d)
                    for k in range(n_lobes)
                ],
                axis=1,
            )
            for name in ("gamma", "beta", "falloff")
        }
        ln_kappa = np.empty((n_d, n_channels, n_lobes))
        for channel in range(n_channels):
            for k in range(n_lobes):
                terms = [(index.shared("scale", k), curve_design(x, index.size("scale")))]
                if n_channels > 1:
                    terms.append((index.colour(channel, k), curve_design(x, index.size("colour"))))
                ln_kappa[:, channel, k] = self._deviation(terms, n_d)
        return StandardErrors(theta_d, ln_kappa, shared["gamma"], shared["beta"], shared["falloff"])

    def _deviation(self, terms: list[tuple[int, Array]], n: int) -> Array:
        rows = np.zeros((n, len(self.covariance)))
        for start, design in terms:
            rows[:, start : start + design.shape[1]] = design
        variance: Array = np.einsum("ip,pq,iq->i", rows, self.covariance, rows)
        return np.sqrt(np.maximum(variance, 0.0))

    def deviation(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Standard deviations (..., channel) of the logarithm of values at pairs of directions (..., 3)."""
        wi, wo = np.broadcast_arrays(_check.unit_vectors(wi, "wi"), _check.unit_vectors(wo, "wo"))
        flat_i, flat_o = wi.reshape(-1, 3), wo.reshape(-1, 3)
        deviation = np.empty((len(flat_i), self.lobes.n_channels))
        for start in range(0, len(flat_i), CHUNK):
            part = slice(start, start + CHUNK)
            theta_h, theta_d, phi_d = half_diff.from_directions(flat_i[part], flat_o[part])
            azimuth = half_diff.azimuthal_factor(theta_h, theta_d) * np.cos(2.0 * phi_d)
            value, jacobian = value_jacobian(
                self.lobes, half_diff.log_cos(theta_h), np.cos(theta_d), azimuth[:, None]
            )
            if self.expected is not None:
                positions = Positions(half_diff.log_cos(theta_h), np.cos(theta_d), azimuth)
                of_scale = self.expected.deviation(self.expected.process.at(positions))
                # From the scale of the process to the logarithm
                least = np.maximum(value[:, 0], 1e-300)
                deviation[part] = of_scale * np.hypot(1.0, 2.0 * processes.OFFSET / least)
                continue
            rows = jacobian[:, 0] / np.maximum(value[:, 0], 1e-300)[..., None]
            deviation[part] = np.sqrt(
                np.maximum(np.einsum("ncp,pq,ncq->nc", rows, self.covariance, rows, optimize=True), 0.0)
            )
        return deviation.reshape(*wi.shape[:-1], -1)


class _Index:
    """Where the curves lie among the unknowns."""

    def __init__(self, lobes: Lobes) -> None:
        self.lobes = lobes
        self.names = ("scale", "gamma", "beta", "falloff")
        sizes = [int(getattr(lobes, name).shape[1]) for name in self.names]
        self.a_lobe: int = sum(sizes)
        self.start: dict[str, int] = dict(zip(self.names, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))

    @property
    def n(self) -> int:
        return self.lobes.n_lobes * self.a_lobe + self.lobes.n_channels * self.n_block

    @property
    def n_block(self) -> int:
        return self.lobes.n_lobes * self.size("colour") if self.lobes.n_channels > 1 else 0

    def size(self, name: str) -> int:
        return int(getattr(self.lobes, name).shape[-1])

    def shared(self, name: str, k: int) -> int:
        return k * self.a_lobe + self.start[name]

    def colour(self, channel: int, k: int) -> int:
        return self.lobes.n_lobes * self.a_lobe + channel * self.n_block + k * self.size("colour")


def value_jacobian(lobes: Lobes, log_cos: Array, x: Array, azimuth: Array) -> tuple[Array, Array]:
    """Values (n, node, channel) at positions, and their derivatives (n, node, channel, unknown)."""
    index = _Index(lobes)
    design = {name: curve_design(x, index.size(name)) for name in (*index.names, "colour")}
    n, n_nodes, n_channels = len(x), azimuth.shape[1], lobes.n_channels
    value = np.zeros((n, n_nodes, n_channels))
    jacobian = np.zeros((n, n_nodes, n_channels, index.n))
    for k in range(lobes.n_lobes):
        scale, gamma, beta, falloff = (design[name] @ getattr(lobes, name)[k] for name in index.names)
        exponent = np.exp(gamma) * log_cos
        factor = np.exp(beta[:, None] * azimuth + (falloff * log_cos)[:, None])
        for channel in range(n_channels):
            ln_power = scale + exponent + design["colour"] @ lobes.colour[channel, k]
            power = np.exp(np.minimum(ln_power, MAX_LN_KAPPA))
            of_lobe = np.expm1(power)[:, None] * factor
            slope = (power * np.exp(power))[:, None] * factor
            value[..., channel] += of_lobe
            derivatives = {
                "scale": slope,
                "gamma": slope * exponent[:, None],
                "beta": of_lobe * azimuth,
                "falloff": of_lobe * log_cos[:, None],
            }
            for name, by_curve in derivatives.items():
                at = index.shared(name, k)
                jacobian[:, :, channel, at : at + index.size(name)] += (
                    by_curve[..., None] * design[name][:, None]
                )
            if n_channels > 1:
                at = index.colour(channel, k)
                jacobian[:, :, channel, at : at + index.size("colour")] += (
                    slope[..., None] * design["colour"][:, None]
                )
    return value, jacobian


def linearise(
    lobes: Lobes, observations: Observations, loss: str, part: slice = slice(None)
) -> tuple[Array, Array]:
    """Residuals (position, node, channel), without weights, and derivatives (position, node, channel, unknown)."""
    value, jacobian = value_jacobian(
        lobes, observations.log_cos[part], observations.x[part], observations.azimuth[part]
    )
    offset = observations.offset
    target = observations.values[part]
    if loss == "l2":
        return (value - target) / offset, jacobian / offset[:, None]
    residual = np.arcsinh(0.5 * value / offset) - np.arcsinh(0.5 * target / offset)
    slope = 1.0 / np.hypot(value, 2.0 * offset)
    if loss == "gamma":
        residual, by_residual = _gamma_deviance(residual)
        slope = slope * by_residual
    return residual, jacobian * slope[..., None]


def _gamma_deviance(residual: Array) -> tuple[Array, Array]:
    """Signed root of the gamma deviance of a difference of logarithms, and its derivative."""
    u = np.minimum(-residual, MAX_LOG_RATIO)
    small = np.abs(u) < 1e-3
    safe = np.where(small, 1.0, u)
    root = np.sign(safe) * np.sqrt(2.0 * (np.expm1(safe) - safe))
    slope = np.where(small, 1.0 + u / 3.0 + u**2 / 12.0, np.expm1(safe) / root)
    root = np.where(small, u * (1.0 + u * (1.0 / 6.0 + u / 36.0)), root)
    return -(root + (-residual - u) * slope), slope


def penalty_matrix(lobes: Lobes, penalty: tuple[float, float, float]) -> Array:
    """Curvature (unknown, unknown) of the penalty, as the kernel has it."""
    bend, slope, size = penalty
    index = _Index(lobes)
    matrix = np.zeros((index.n, index.n))
    starts = [(name, index.shared(name, k)) for k in range(lobes.n_lobes) for name in index.names]
    if lobes.n_channels > 1:
        starts += [
            ("colour", index.colour(channel, k))
            for channel in range(lobes.n_channels)
            for k in range(lobes.n_lobes)
        ]
    for name, start in starts:
        n = index.size(name)
        spacing = 5.0 / (max(n, 2) - 1)
        block = np.zeros((n, n))
        stiffness = slope if name == "colour" else slope / spacing
        for order, weight in ((1, stiffness), (2, bend / spacing**3)):
            if n > order:
                difference = np.diff(np.eye(n), order, axis=0)
                block += weight * difference.T @ difference
        if name in ("colour", "beta", "falloff"):
            block += size / n * np.eye(n)
        matrix[start : start + n, start : start + n] += block
    return matrix


def posterior(found: Estimate) -> Posterior:
    """The posterior of an estimate.

    Raises
    ------
    ValueError
        If there are too many unknowns for a dense covariance.
    """
    lobes, prior, observations = found.lobes, found.prior, found.observations
    n = len(unknowns_of(lobes))
    if n > MAX_UNKNOWNS:
        raise ValueError(
            f"{n:,} unknowns are too many for their covariance, {MAX_UNKNOWNS:,} at most. Fit fewer channels."
        )
    if isinstance(prior, Expectation):
        return _as_expected(found, prior)
    weights = observations.weights / observations.weights.sum()
    parts = [slice(start, start + CHUNK) for start in range(0, len(observations.x), CHUNK)]
    hessian = np.zeros((n, n))
    for part in parts:
        _, jacobian = linearise(lobes, observations, found.options.loss, part)
        weighted = jacobian * weights[part][..., None]
        hessian += np.einsum("nkcp,nkcq->pq", weighted, jacobian, optimize=True)
    precision = found.options.n_effective / max(found.squares, LEAST_SQUARES)
    held = penalty_matrix(lobes, found.options.penalty) if prior is None else prior.precision
    inverse = np.linalg.pinv(precision * hessian + held, rcond=1e-14, hermitian=True)
    scores = np.zeros((n, n))
    for part in parts:
        residual, jacobian = linearise(lobes, observations, found.options.loss, part)
        weighted = jacobian * weights[part][..., None]
        # A value that draws the fit to itself has a residual that is too small for its noise
        leverage = precision * np.einsum("nkcp,pq,nkcq->nkc", weighted, inverse, jacobian, optimize=True)
        residual = residual / np.maximum(1.0 - leverage, LEAST_SHARE)
        of_position = np.einsum("nkcp,nkc->np", weighted, residual, optimize=True)
        scores += of_position.T @ of_position
    covariance = inverse @ (precision**2 * scores + held) @ inverse
    n_decided = float(np.trace(inverse @ (precision * hessian)))
    return Posterior(lobes, covariance, n_decided)


def _as_expected(found: Estimate, expected: Expectation) -> Posterior:
    """The posterior of lobes that are nearest to what is expected, which varies as its process says."""
    lobes, joined = found.lobes, with_support(found.observations, expected)
    value, jacobian = value_jacobian(lobes, joined.log_cos, joined.x, joined.azimuth)
    jacobian /= np.hypot(value, 2.0 * processes.OFFSET)[..., None]
    weights = joined.weights / joined.weights.sum()
    precision = joined.n_effective / max(found.squares, LEAST_SQUARES)
    weighted = (precision * weights[..., None] * jacobian).reshape(-1, jacobian.shape[-1])
    held = penalty_matrix(lobes, PENALTY)
    hessian = weighted.T @ jacobian.reshape(weighted.shape)
    inverse = np.linalg.pinv(hessian + held, rcond=1e-14, hermitian=True)
    n_nodes = joined.azimuth.shape[1]
    positions = Positions(
        np.repeat(joined.log_cos, n_nodes), np.repeat(joined.x, n_nodes), joined.azimuth.ravel()
    )
    factor = expected.factor(expected.process.at(positions)[1]).reshape(expected.process.n_materials, -1)
    common, single = factor @ weighted, expected.noise * weighted
    covariance = inverse @ (common.T @ common + single.T @ single + held) @ inverse
    return Posterior(lobes, covariance, expected.n_decided, expected)


def band(value: Any, deviation: Array, level: float) -> tuple[Array, Array]:
    """Lower and upper bounds of values (..., channel) with these deviations of their logarithm.

    Raises
    ------
    ValueError
        If `level` is not between 0 and 1.
    """
    from scipy.special import ndtri

    if not 0.0 < float(_check.numbers(level, "level")) < 1.0:
        raise ValueError(f"'level' must be between 0 and 1, got {level!r}.")
    factor = np.exp(float(ndtri(0.5 + 0.5 * level)) * deviation)
    return value / factor, value * factor
