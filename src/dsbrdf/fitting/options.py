"""`FitOptions`: how a fit is made."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

__all__ = ["AUTO", "CURVES", "LOSSES", "MAX_LOBES", "FitOptions"]

AUTO = "auto"
#: Most lobes that a fit may have.
MAX_LOBES = 10
LOSSES = ("log", "gamma", "l2")
#: Coefficients of the curves of a lobe: scale, gamma, beta, falloff, and colour of each channel beyond the first.
CURVES = {"standard": (6, 4, 3, 1, 2), "compact": (3, 2, 2, 1, 1)}


@dataclass(frozen=True)
class FitOptions:
    """How a fit is made.

    Parameters
    ----------
    n_lobes : int or "auto", optional
        As few as the data call for, six at most, by default.
    loss : {"log", "gamma", "l2"}, optional
        Squares of the logarithm (an asinh, linear below the noise), the default; the deviance of the gamma
        distribution; or squares of the values themselves. Scattered samples are fitted by "log" first, and by "gamma",
        which noise does not draw down, in the end.
    curves : {"standard", "compact"}, optional
        How many coefficients the curves have; six compact lobes of three channels are 60 numbers.
    max_iterations : int, optional
        Of the last search.

    Raises
    ------
    ValueError
        If an option is out of range.

    Examples
    --------
    >>> import dsbrdf
    >>> dsbrdf.FitOptions(n_lobes=3, curves="compact").sizes
    (3, 2, 2, 1, 1)
    """

    n_lobes: int | str = AUTO
    loss: str = "log"
    curves: str = "standard"
    max_iterations: int = 100

    def __post_init__(self) -> None:
        if self.n_lobes != AUTO and (
            isinstance(self.n_lobes, bool)
            or not isinstance(self.n_lobes, Integral)
            or not 1 <= self.n_lobes <= MAX_LOBES
        ):
            raise ValueError(f"'n_lobes' must be 1 to {MAX_LOBES} or {AUTO!r}, got {self.n_lobes!r}.")
        for name, allowed in (("loss", LOSSES), ("curves", tuple(CURVES))):
            if getattr(self, name) not in allowed:
                listed = ", ".join(map(repr, allowed))
                raise ValueError(f"'{name}' must be one of {listed}, got {getattr(self, name)!r}.")
        if self.max_iterations < 1:
            raise ValueError(f"'max_iterations' must be at least 1, got {self.max_iterations}.")

    @property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """Coefficients of scale, gamma, beta, falloff and colour."""
        return CURVES[self.curves]
