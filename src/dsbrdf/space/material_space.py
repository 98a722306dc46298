"""`MaterialSpace`: materials as points of a linear space, to be searched, blended, moved in and drawn from."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dsbrdf.model.check import ALBEDO_ANGLES
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.space.correspondence import gamma_norm, lobe_slots, pad
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.settings import SpaceSettings, check_channels, check_convention
from dsbrdf.space.variables import FLAT

__all__ = ["DRAWN_SHARE", "THETA_D", "MaterialSpace"]

Array = NDArray[np.float64]

#: Models are tabulated at every five degrees, both ends included.
THETA_D = np.linspace(0.0, np.pi / 2, 19)
#: Draws vary along the components that hold this share of the variance; those beyond tell single materials apart.
DRAWN_SHARE = 0.9
#: Draws that create light are drawn again, this many times at most.
MAX_REDRAWS = 20


@dataclass(frozen=True, eq=False)
class MaterialSpace:
    """Materials as curves of corresponding lobes, and their functional principal components (Section 6.C, Fig. 10).

    Parameters
    ----------
    settings : SpaceSettings
    names : tuple of str
        Of the materials.
    sources : tuple of str
        SHA-256 of the measurements they were fitted to; empty where unknown.
    curves : (material, channel, slot, function, coefficient) ndarray
        Splines of the lobes' variables, with flat lobes for missing ones.
    present : (material, channel, slot) ndarray of bool
        Which lobes are not flat ones.
    border : float
        Norm of the gamma curve at which specular lobes begin; minus infinity with "rank".
    n_diffuse : int
        Slots below the border.
    """

    settings: SpaceSettings
    names: tuple[str, ...]
    sources: tuple[str, ...]
    curves: Array
    present: NDArray[np.bool_]
    border: float
    n_diffuse: int

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.curves.shape[1])

    @property
    def n_slots(self) -> int:
        """Lobes a channel, flat ones included."""
        return int(self.curves.shape[2])

    @cached_property
    def fpca(self) -> Fpca:
        """The analysis of all curves; its functions are (channel, slot, variable) in one row.

        A positive score is on the side of sharper lobes.
        """
        curves = self.curves.reshape(len(self.curves), -1, self.settings.basis.size)
        weights = self.settings.weights(curves.mean(0))
        sharper = np.zeros(self.curves.shape[1:])
        sharper[:, :, 1] = 1.0
        return fit_fpca(curves, self.settings.basis, weights, sharper.reshape(curves.shape[1:]))

    def encode(self, model: DSBRDF) -> Array:
        """Curves (channel, slot, function, coefficient) of a model.

        Raises
        ------
        ValueError
            If it has other channels, more lobes than there are slots for, or was fitted with another convention.
        """
        check_channels(model, self.n_channels)
        check_convention(model, self.settings.convention)
        settings = self.settings
        curves = settings.variables.smooth(model, settings.basis)
        slots = lobe_slots(gamma_norm(curves, settings.basis), self.border, self.n_diffuse)
        if slots.min() < 0 or slots.max() >= self.n_slots:
            raise ValueError(
                f"{model.name or 'the model'}: {model.n_lobes} lobes do not go into this space, which has "
                f"{self.n_slots} a channel, {self.n_diffuse} of them diffuse. Build the space with this model, or fit "
                "the model with fewer lobes."
            )
        return pad(curves, slots, self.n_slots, settings.variables.flat)[0]

    def decode(
        self, curves: Array, name: str = "", theta_d: Array = THETA_D, *, conserve: bool = True
    ) -> DSBRDF:
        """The valid model nearest to some curves (channel, slot, function, coefficient), tabulated at `theta_d`.

        Parameters are kept in their ranges; a lobe whose norm would fall below that of the next flatter one stops
        there; lobes are dimmed where more light would leave than comes in, unless `conserve` is False. Lobes that are
        flat in all channels are left out.
        """
        curves = curves.copy()
        norm = gamma_norm(curves, self.settings.basis)
        # The splines add up to one: a constant raises the mean by itself
        curves[:, :, 1] += (np.maximum.accumulate(norm, axis=1) - norm)[..., None]
        values = np.einsum("tc,klfc->tklf", self.settings.basis.design(theta_d), curves)
        parameters = self.settings.variables.parameters(values)
        shown = parameters[0].max((0, 1)) > 2.0 * FLAT
        shown |= ~shown.any()
        kappa, gamma, beta = (parameter[:, :, shown] for parameter in parameters)
        model = DSBRDF(theta_d, kappa, gamma, beta, name=name)
        return model.conserve_energy() if conserve else model

    def scores(self, model: DSBRDF) -> Array:
        """Scores (component,) of a model; errors as `encode`."""
        return self.fpca.transform(self._row(self.encode(model)))

    def model(
        self, scores: Array, name: str = "", theta_d: Array = THETA_D, *, conserve: bool = True
    ) -> DSBRDF:
        """The valid model nearest to scores (component,) or the first few of them; options as of `decode`."""
        curves = self._unrow(self.fpca.inverse_transform(scores))
        return self.decode(curves, name, theta_d, conserve=conserve)

    def nearest(self, model: DSBRDF, n: int = 5) -> list[tuple[str, float]]:
        """Names of the nearest `n` materials and their distance, the norm of the difference; errors as `encode`."""
        difference = self.curves - self.encode(model)
        rows = difference.reshape(len(self.curves), -1, self.settings.basis.size)
        distance = np.sqrt(self.fpca.inner(rows, rows))
        return [(self.names[i], float(distance[i])) for i in np.argsort(distance, kind="stable")[:n]]

    def blend(self, a: DSBRDF, b: DSBRDF, t: float, name: str = "") -> DSBRDF:
        """The material at share `t` of the way from `a` to `b`: the curves themselves, nothing is projected.

        Raises
        ------
        ValueError
            If `t` is not in [0, 1]; and as `encode`.
        """
        if not 0.0 <= t <= 1.0:
            raise ValueError(f"'t' must be between 0 and 1, got {t!r}. To go farther, use move.")
        name = name or f"{a.name} {1.0 - t:.0%} {b.name} {t:.0%}"
        return self.decode((1.0 - t) * self.encode(a) + t * self.encode(b), name)

    def move(self, model: DSBRDF, axis: int, by: float, name: str = "") -> DSBRDF:
        """A model moved along a principal function; what the space does not know of it is kept.

        Parameters
        ----------
        model : DSBRDF
        axis : int
            From 1, the component with the most variance.
        by : float
            Standard deviations of the scores.
        name : str, optional

        Raises
        ------
        ValueError
            If there is no such axis, or `by` is not finite; and as `encode`.
        """
        n = len(self.fpca.variances)
        if not 1 <= axis <= n:
            raise ValueError(f"'axis' must be between 1 and {n}, got {axis!r}.")
        if not np.isfinite(by):
            raise ValueError(f"'by' must be finite, got {by!r}.")
        step = by * np.sqrt(self.fpca.variances[axis - 1]) * self.fpca.functions[axis - 1]
        name = name or f"{model.name} moved {by:+g} along {axis}"
        return self.decode(self.encode(model) + self._unrow(step), name)

    def sample(self, n: int, rng: np.random.Generator, *, share: float = DRAWN_SHARE) -> list[DSBRDF]:
        """Draw materials from the prior.

        Scores are independent and normal, with the variances of the space, clipped to the range of its materials; what
        would reflect more light than it receives is drawn again.

        Parameters
        ----------
        n : int
        rng : numpy.random.Generator
        share : float, optional
            Of the variance; the components that hold it are drawn, the others are zero.

        Raises
        ------
        ValueError
            If `n` is negative, or `share` out of range.
        """
        if n < 0:
            raise ValueError(f"'n' must not be negative, got {n}.")
        known = self.fpca.scores[:, : self.fpca.n_components(share)]
        deviation = np.sqrt(self.fpca.variances[: known.shape[1]])

        def draw() -> DSBRDF:
            scores = np.clip(deviation * rng.standard_normal(deviation.size), known.min(0), known.max(0))
            return self.model(scores, conserve=False)

        drawn = []
        for i in range(n):
            model = draw()
            for _ in range(MAX_REDRAWS):
                if model.albedo(ALBEDO_ANGLES).max() <= 1.0:
                    break
                model = draw()
            drawn.append(model.conserve_energy().replace(name=f"sample {i + 1}"))
        return drawn

    def material(self, name: str) -> DSBRDF:
        """A material of the space, as smoothed by its curves.

        Raises
        ------
        ValueError
            If there is no such material.
        """
        return self.decode(self.curves[self._index(name)], name)

    def without(self, name: str) -> MaterialSpace:
        """The space of all materials but `name`.

        Raises
        ------
        ValueError
            If there is no such material.
        """
        self._index(name)
        kept = np.array([other != name for other in self.names])
        names, sources = (
            tuple(x for x, keep in zip(values, kept, strict=True) if keep)
            for values in (self.names, self.sources)
        )
        return dataclasses.replace(
            self, names=names, sources=sources, curves=self.curves[kept], present=self.present[kept]
        )

    def save(self, path: str | Path) -> None:
        """Write the space as .npz; see `dsbrdf.space.space_file`.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        from dsbrdf.space import space_file

        space_file.save(self, path)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise ValueError(f"no material {name!r} in this space of {len(self.names)}.")
        return self.names.index(name)

    def _row(self, curves: Array) -> Array:
        return curves.reshape(-1, self.settings.basis.size)

    def _unrow(self, curves: Array) -> Array:
        return curves.reshape(self.curves.shape[1:])

    def __repr__(self) -> str:
        kind = "logarithmic" if self.settings.variables.logarithmic else "raw"
        return f"MaterialSpace({len(self.names)} materials, {self.n_channels} channels, {self.n_slots} lobes, {kind})"
