"""`MaterialSpace`: materials as points of a linear space, to be searched, blended, moved in and drawn from."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from dsbrdf import _check
from dsbrdf.model import energy
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.model.energy import ALBEDO_ANGLES
from dsbrdf.model.lobes import curve_design
from dsbrdf.space.correspondence import lobe_slots, pad
from dsbrdf.space.fpca import Fpca, fit_fpca
from dsbrdf.space.settings import SpaceSettings, check_channels, check_convention
from dsbrdf.space.variables import DARK, Variables

if TYPE_CHECKING:
    from dsbrdf.space.prior import Gaussian
    from dsbrdf.space.process import Process

__all__ = ["DRAWN_SHARE", "MaterialSpace"]

Array = NDArray[np.float64]

#: Draws vary along the components that hold this share of the variance; those beyond tell single materials apart.
DRAWN_SHARE = 0.9
#: Angles of the albedo whose colour a blend keeps, and steps until it does.
COLOUR_ANGLES, N_COLOURED = np.deg2rad([10.0, 35.0, 55.0, 75.0]), 6
#: Places x on which functions of curves are located.
N_PLACES = 200
#: Draws that create light are drawn again, this many times at most.
MAX_REDRAWS = 20


@dataclass(frozen=True, eq=False)
class MaterialSpace:
    """Materials as curves of corresponding lobes, and their functional principal components (Section 6.C, Fig. 10).

    Parameters
    ----------
    settings : SpaceSettings
    channels : tuple of str
        Names of the channels.
    names : tuple of str
        Of the materials.
    sources : tuple of str
        SHA-256 of the measurements they were fitted to; empty where unknown.
    curves : (material, slot, number) ndarray
        Rows of `dsbrdf.space.variables`, with dark lobes for missing ones.
    present : (material, slot) ndarray of bool
        Which lobes are not dark ones.
    border : float
        Sharpness at which specular lobes begin; minus infinity with "rank".
    n_diffuse : int
        Slots below the border.

    Examples
    --------
    >>> import dsbrdf
    >>> space = dsbrdf.space.builtin()
    >>> [name for name, _ in space.nearest(space.material("nickel"), 2)]
    ['nickel', 'blue-metallic-paint2']
    >>> space.move(space.material("nickel"), axis=1, by=0.5).n_lobes
    5
    """

    settings: SpaceSettings
    channels: tuple[str, ...]
    names: tuple[str, ...]
    sources: tuple[str, ...]
    curves: Array
    present: NDArray[np.bool_]
    border: float
    n_diffuse: int

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return len(self.channels)

    @property
    def n_slots(self) -> int:
        """Lobes of a material, dark ones included."""
        return int(self.curves.shape[1])

    @property
    def variables(self) -> Variables:
        """What the numbers of a lobe are."""
        return Variables(self.settings.sizes, self.n_channels)

    @cached_property
    def fpca(self) -> Fpca:
        """The analysis of all curves, those of a material in one row.

        A positive score is on the side of sharper lobes.
        """
        variables = self.variables
        sharper = np.zeros(self.curves.shape[1:])
        variables.parts(sharper).gamma[:] = 1.0
        sharpness = variables.sharpness(self.curves).mean(0)
        metric = block_diag(*map(variables.metric, sharpness))
        return fit_fpca(self.curves.reshape(len(self.curves), -1), metric, sharper.ravel())

    @cached_property
    def process(self) -> Process:
        """What the materials are like, for fits of few samples; see `dsbrdf.space.process`."""
        from dsbrdf.space.process import Process

        return Process.of_space(self)

    def encode(self, model: DSBRDF) -> Array:
        """Curves (slot, number) of a model.

        Raises
        ------
        ValueError
            If it has other channels, more lobes than there are slots for, or was fitted with another convention.
        """
        _check.instance(model, DSBRDF, "model")
        check_channels(model, self.channels)
        check_convention(model, self.settings.convention)
        variables = self.variables
        rows = variables.of(model.lobes)
        slots = lobe_slots(variables.sharpness(rows), self.border, self.n_diffuse)
        if slots.min() < 0 or slots.max() >= self.n_slots:
            raise ValueError(
                f"{model.name or 'the model'}: {model.n_lobes} lobes do not go into this space, which has "
                f"{self.n_slots}, {self.n_diffuse} of them diffuse. Build the space with this model, or fit "
                "the model with fewer lobes."
            )
        return pad(rows, slots, self.n_slots, variables)[0]

    def decode(self, curves: Array, name: str = "", *, conserve: bool = True) -> DSBRDF:
        """The valid model nearest to some curves (slot, number).

        Parameters are kept in their ranges; a lobe that would become flatter than the next flatter one stops there;
        lobes are dimmed where more light would leave than comes in, unless `conserve` is False. Dark lobes are left
        out.
        """
        variables = self.variables
        sharpness = variables.sharpness(curves)
        parts = variables.parts(curves)
        # The curve's functions add up to one: a constant raises the mean by itself
        gamma = parts.gamma + (np.maximum.accumulate(sharpness) - sharpness)[:, None]
        lobes = variables.lobes(variables.joined(parts._replace(gamma=gamma)))
        model = DSBRDF(lobes, self.channels, name=name)
        return model.conserve_energy() if conserve else model

    def scores(self, model: DSBRDF) -> Array:
        """Scores (component,) of a model; errors as `encode`."""
        return self.fpca.transform(self.encode(model).ravel())

    def model(self, scores: Array, name: str = "", *, conserve: bool = True) -> DSBRDF:
        """The valid model nearest to scores (component,) or the first few of them; option as of `decode`."""
        return self.decode(self._unrow(self.fpca.inverse_transform(scores)), name, conserve=conserve)

    def nearest(self, model: DSBRDF, n: int = 5) -> list[tuple[str, float]]:
        """Names of the nearest `n` materials and their distance, the norm of the difference; errors as `encode`."""
        difference = (self.curves - self.encode(model)).reshape(len(self.curves), -1)
        distance = np.sqrt(self.fpca.inner(difference, difference))
        return [(self.names[i], float(distance[i])) for i in np.argsort(distance, kind="stable")[:n]]

    def blend(self, a: DSBRDF, b: DSBRDF, t: float, name: str = "") -> DSBRDF:
        """The material at share `t` of the way from `a` to `b`: the curves themselves, nothing is projected.

        Lobes of the same place may differ in kind, and halves of their colours add up to one that neither end has. So
        the heights of all lobes are changed by a factor a channel and theta_d, such that the albedo, too, is on the
        way.

        Raises
        ------
        ValueError
            If `t` is not in [0, 1]; and as `encode`.
        """
        for name_of, end in (("a", a), ("b", b)):
            _check.instance(end, DSBRDF, name_of)
        if not 0.0 <= t <= 1.0:
            raise ValueError(f"'t' must be between 0 and 1, got {t!r}. To go farther, use move.")
        name = name or f"{a.name} {1.0 - t:.0%} {b.name} {t:.0%}"
        curves = (1.0 - t) * self.encode(a) + t * self.encode(b)
        wanted = (1.0 - t) * _ln_albedo(a) + t * _ln_albedo(b)
        variables = self.variables
        x = np.linspace(0.0, 1.0, N_PLACES)
        functions = curve_design(x, variables.sizes.scale)
        # Where each function of a curve has its weight
        places = x @ functions / functions.sum(0)
        for _ in range(N_COLOURED):
            missing = wanted - _ln_albedo(self.decode(curves, conserve=False))
            # Light from an angle is seen at differences about as large
            change = [np.interp(places, np.cos(COLOUR_ANGLES)[::-1], of[::-1]) for of in missing.T]
            parts = variables.parts(curves)
            height = np.exp(parts.height[:, None] + parts.colour)
            # What is dark stays dark: the offset of heights is no light
            lit = np.maximum(height - DARK, 0.0) * np.exp(change) + np.minimum(height, DARK)
            height = np.log(lit)
            mean = height.mean(1)
            curves = variables.joined(parts._replace(height=mean, colour=height - mean[:, None]))
        return self.decode(curves, name)

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
        n, axis = len(self.fpca.variances), _check.index(axis, "axis")
        if not 1 <= axis <= n:
            raise ValueError(f"'axis' must be between 1 and {n}, got {axis!r}.")
        if not np.isfinite(by):
            raise ValueError(f"'by' must be finite, got {by!r}.")
        step = by * np.sqrt(self.fpca.variances[axis - 1]) * self.fpca.functions[axis - 1]
        name = name or f"{model.name} moved {by:+g} along {axis}"
        return self.decode(self.encode(model) + self._unrow(step), name)

    def draw(self, n: int, rng: np.random.Generator, *, share: float = DRAWN_SHARE) -> list[DSBRDF]:
        """Draw materials.

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
        _check.generator(rng)
        if n < 0:
            raise ValueError(f"'n' must not be negative, got {n}.")
        known = self.fpca.scores[:, : self.fpca.n_components(share)]
        deviation = np.sqrt(self.fpca.variances[: known.shape[1]])

        def attempt() -> DSBRDF:
            scores = np.clip(deviation * rng.standard_normal(deviation.size), known.min(0), known.max(0))
            return self.model(scores, conserve=False)

        drawn = []
        for i in range(n):
            model = attempt()
            for _ in range(MAX_REDRAWS):
                if model.albedo(ALBEDO_ANGLES).max() <= 1.0:
                    break
                model = attempt()
            drawn.append(model.conserve_energy().replace(name=f"draw {i + 1}"))
        return drawn

    def gaussian(self) -> Gaussian:
        """The materials as a Gaussian prior over the unknowns of the estimator; see `dsbrdf.space.prior`."""
        from dsbrdf.space import prior

        return prior.of_space(self)

    def material(self, name: str) -> DSBRDF:
        """A material of the space.

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

    def _unrow(self, row: Array) -> Array:
        return row.reshape(self.curves.shape[1:])

    def __repr__(self) -> str:
        return f"MaterialSpace({len(self.names)} materials, {self.n_channels} channels, {self.n_slots} lobes)"


def _ln_albedo(model: DSBRDF) -> Array:
    """Logarithm (angle, channel) of the albedo at `COLOUR_ANGLES`."""
    return np.log(np.maximum(energy.albedo(model, COLOUR_ANGLES, energy.QUICK_N_PHI), 1e-12))
