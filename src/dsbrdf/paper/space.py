"""The space of isotropic BRDFs of Section 6.C: lobes and materials on their first principal functions.

Curves are of kappa and gamma as they are, or of logarithms: of the height of a lobe, `ln(expm1(kappa) + e)`, e =
`dsbrdf.paper.metrics.LOG_OFFSET`, and of `ln(1 + gamma)`. These are finite for a lobe that is not there, and nearly
constant where a change cannot be seen: below 0.001/sr, and about gamma = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dsbrdf.paper.correspondence import gamma_norm, lobe_slots, pad, two_class_border
from dsbrdf.paper.curves import CurveBasis, sensitivity
from dsbrdf.paper.metrics import LOG_OFFSET
from dsbrdf.paper.slices import Slices
from dsbrdf.space.fpca import Fpca, fit_fpca

__all__ = ["FLAT", "THETA_D", "PaperSpace", "Variables", "build_space"]

Array = NDArray[np.float64]

#: The kappa of a lobe that is not there, and the greatest of any, `expm1` of which is 1e13/sr.
FLAT, MAX_KAPPA = 1e-12, 30.0
#: Beyond a lobe is a mirror.
MAX_GAMMA = 1e6
#: Slices count in smoothing by what they say of the lobe, at least this share of the slice that says most.
LEAST_WEIGHT = 0.1
#: Models are tabulated at every five degrees, both ends included.
THETA_D = np.linspace(0.0, np.pi / 2, 19)


@dataclass(frozen=True)
class Variables:
    """The two functions of a lobe: kappa and gamma, or logarithms of them.

    Parameters
    ----------
    logarithmic : bool
    """

    logarithmic: bool = True

    @property
    def flat(self) -> float:
        """The first function of a lobe that is not there."""
        return float(np.log(LOG_OFFSET)) if self.logarithmic else 0.0

    def of(self, model: Slices) -> Array:
        """Variables (theta_d, channel, lobe, function) of a model's lobes."""
        kappa, gamma = np.minimum(model.kappa, MAX_KAPPA), np.minimum(model.gamma, MAX_GAMMA)
        if self.logarithmic:
            kappa, gamma = np.log(np.expm1(kappa) + LOG_OFFSET), np.log1p(gamma)
        return np.stack([kappa, gamma], axis=-1)

    def parameters(self, values: Array) -> tuple[Array, Array]:
        """Kappa and gamma (...) of variables (..., function), all within their ranges."""
        kappa, gamma = values[..., 0], values[..., 1]
        if self.logarithmic:
            kappa = np.log1p(np.maximum(np.exp(np.minimum(kappa, MAX_KAPPA)) - LOG_OFFSET, 0.0))
            gamma = np.expm1(np.minimum(gamma, np.log1p(MAX_GAMMA)))
        return np.clip(kappa, FLAT, MAX_KAPPA), np.clip(gamma, 0.0, MAX_GAMMA)

    def smooth(self, model: Slices, basis: CurveBasis) -> Array:
        """Coefficients (channel, lobe, function, coefficient) of curves through a model's slices.

        Least squares weighted by `dsbrdf.paper.curves.sensitivity`: a slice on which a lobe is dark says little of it.
        """
        weights = sensitivity(model)
        peak = weights.max(0)
        weights = np.divide(weights, peak, out=np.ones_like(weights), where=peak > 0.0)
        weights = np.maximum(weights, LEAST_WEIGHT)
        design = basis.design(model.theta_d)
        normal = np.einsum("tcl,ti,tj->clij", weights, design, design)
        right = np.einsum("tcl,ti,tclf->clif", weights, design, self.of(model))
        # Few slices leave some coefficients open: of those, the least
        coefficients: Array = np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ right
        return coefficients.swapaxes(-1, -2)


@dataclass(frozen=True, eq=False)
class PaperSpace:
    """Materials as curves of corresponding lobes, and their functional principal components.

    Parameters
    ----------
    names : tuple of str
        Of the materials.
    curves : (material, channel, slot, function, coefficient) ndarray
        Splines of the lobes' variables, with flat lobes for missing ones.
    present : (material, channel, slot) ndarray of bool
        Which lobes are not flat ones.
    variables : Variables, optional
    basis : CurveBasis, optional
    """

    names: tuple[str, ...]
    curves: Array
    present: NDArray[np.bool_]
    variables: Variables = field(default_factory=Variables)
    basis: CurveBasis = field(default_factory=CurveBasis)

    @property
    def n_slots(self) -> int:
        """Lobes a channel, flat ones included."""
        return int(self.curves.shape[2])

    @cached_property
    def materials(self) -> Fpca:
        """The analysis of all curves of a material, (channel, slot, function) in one row (Fig. 10).

        A positive score is on the side of sharper lobes.
        """
        return self._analysis(self.curves.reshape(len(self.curves), -1, self.basis.size))

    @cached_property
    def lobes(self) -> Fpca:
        """The analysis of all lobes by themselves, without flat ones for missing ones: the bivariate one of Fig. 9.

        In the order of `numpy.argwhere(space.present)`.
        """
        return self._analysis(self.curves[self.present])

    def _analysis(self, curves: Array) -> Fpca:
        """Of curves (observation, function, coefficient), every second of which is of gamma."""
        metric = np.kron(np.diag(self.weights(curves.mean(0))), self.basis.gram)
        sharper = np.zeros(curves.shape[1:])
        sharper[1::2] = 1.0
        return fit_fpca(curves.reshape(len(curves), -1), metric, sharper.ravel())

    def weights(self, mean: Array) -> Array:
        """Weights (function,) in the inner product of functions whose mean curves (function, coefficient) are given.

        Eq. (7) for kappa and gamma as they are. Logarithms are on one scale already, and their mean depends on a unit.
        """
        if self.variables.logarithmic:
            return np.ones(len(mean))
        norm = np.einsum("fc,cd,fd->f", mean, self.basis.gram, mean)
        # A slot that hardly any material has a lobe for must not outweigh all others
        typical = np.where(np.arange(len(norm)) % 2, norm[1::2].mean(), norm[::2].mean())
        weights: Array = 1.0 / np.maximum(norm, np.maximum(1e-3 * typical, 1e-12))
        return weights

    def decode(self, curves: Array, name: str = "", theta_d: Array = THETA_D) -> Slices:
        """The valid model nearest to some curves (channel, slot, function, coefficient), tabulated at `theta_d`.

        Parameters are kept in their ranges; a lobe whose norm would fall below that of the next flatter one stops
        there. Lobes that are flat in all channels are left out.
        """
        curves = curves.copy()
        norm = gamma_norm(curves, self.basis)
        # The splines add up to one: a constant raises the mean by itself
        curves[:, :, 1] += (np.maximum.accumulate(norm, axis=1) - norm)[..., None]
        values = np.einsum("tc,klfc->tklf", self.basis.design(theta_d), curves)
        kappa, gamma = self.variables.parameters(values)
        shown = kappa.max((0, 1)) > 2.0 * FLAT
        shown |= ~shown.any()
        return Slices(theta_d, kappa[:, :, shown], gamma[:, :, shown], name=name)

    def __repr__(self) -> str:
        kind = "logarithmic" if self.variables.logarithmic else "raw"
        n_channels = self.curves.shape[1]
        return f"PaperSpace({len(self.names)} materials, {n_channels} channels, {self.n_slots} lobes, {kind})"


def build_space(
    models: Sequence[Slices], *, logarithmic: bool = True, n_knots: int = CurveBasis().n_knots
) -> PaperSpace:
    """The space of a collection of models, lobes along the border of diffuse and specular ones.

    Parameters
    ----------
    models : sequence of Slices
        Of the same channels; with any number of lobes.
    logarithmic : bool, optional
        Curves of logarithms; otherwise kappa and gamma as they are (the paper).
    n_knots : int, optional
        Of the splines over theta_d.

    Raises
    ------
    ValueError
        If there are fewer than two models, or they differ in channels.
    """
    models = list(models)
    if len(models) < 2:
        raise ValueError(f"a space needs two models at least, got {len(models)}.")
    for model in models:
        if model.n_channels != models[0].n_channels:
            raise ValueError(
                f"{model.name or 'a model'}: {model.n_channels} channels, where the first model has "
                f"{models[0].n_channels}. Build a space of models with the same channels."
            )
    variables, basis = Variables(logarithmic), CurveBasis(n_knots)
    lobes = [variables.smooth(model, basis) for model in models]
    norms = [gamma_norm(curves, basis) for curves in lobes]
    border = two_class_border(norms, logarithmic)
    n_diffuse = max(int((norm < border).sum(1).max()) for norm in norms)
    slots = [lobe_slots(norm, border, n_diffuse) for norm in norms]
    n_slots = 1 + max(int(slot.max()) for slot in slots)
    padded = [pad(c, s, n_slots, variables.flat) for c, s in zip(lobes, slots, strict=True)]
    names = tuple(model.name for model in models)
    curves, present = (np.stack(part) for part in zip(*padded, strict=True))
    return PaperSpace(names, curves, present, variables, basis)
