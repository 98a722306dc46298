"""The demonstration: fit some of the built-in materials, and write their models and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dsbrdf.fitting import Fit, fit
from dsbrdf.measured import MeasuredBRDF, built_in

__all__ = ["MATERIALS", "OVERVIEW", "DemoRow", "run"]

#: Built-in materials that show what lobes do well and what they do not, and what to look at.
MATERIALS = {
    "rough-gold": "A rough metal. Round lobes of one colour, which fades at grazing angles: what the model is for.",
    "polished-chrome": "Nearly a mirror. The peak is 100,000 times as bright as what is around it; lobes follow both.",
    "glossy-plastic": "A clear coat over colour. A wide red lobe and narrow white ones keep the two apart.",
    "paint-two-lobe": "A lacquer with a sharp and a hazy highlight, which get lobes of their own.",
    "matte": "Dry clay, no highlight: lobes so wide that together they are flat.",
    "grey-primer": "A limit. A rough coat brightens steeply within 15 degrees of the horizon, where lobes around the "
    "half vector cannot follow: most of the error lies there.",
}

#: Name of the figure that shows all materials.
OVERVIEW = "overview.png"


@dataclass(frozen=True, eq=False)
class DemoRow:
    """A built-in material, fitted.

    Parameters
    ----------
    fit : Fit
    measured : MeasuredBRDF
    path : Path
        Where its model was written; its figure, if any, lies beside it.
    albedo : float
        Directional albedo of the model at normal incidence, mean over channels.
    """

    fit: Fit
    measured: MeasuredBRDF
    path: Path
    albedo: float

    @property
    def n_table(self) -> int:
        """Numbers of the table that was fitted."""
        return int(self.measured.planes.size)


def run(
    out: str | Path,
    names: Sequence[str] | None = None,
    *,
    plots: bool = True,
    step: Callable[[str], None] = lambda _: None,
) -> list[DemoRow]:
    """Fit built-in materials, and write a model and a figure of each, and one figure of all.

    Parameters
    ----------
    out : str or Path
        Folder for `<name>.json`, `<name>.png` and `overview.png`; made if it does not exist.
    names : sequence of str, optional
        Built-in materials; those of `MATERIALS` by default.
    plots : bool, optional
        Write figures, which needs matplotlib.
    step : callable, optional
        Told what comes next: each material's name, and "overview" before the last figure.

    Returns
    -------
    list of DemoRow

    Raises
    ------
    ModuleNotFoundError
        If `plots` is set and matplotlib is missing; then nothing is written.
    OSError
        If a file cannot be written.
    ValueError
        If there is no such material.
    """
    out = Path(out)
    if plots:
        from dsbrdf import plot
    rows = []
    for name in MATERIALS if names is None else names:
        step(name)
        measured = built_in.material(name)
        result = fit(measured)
        path = out / f"{name}.json"
        result.model.save(path)
        if plots:
            plot.write_figure(plot.fit_figure(result), out / f"{name}.png")
        rows.append(DemoRow(result, measured, path, float(result.model.albedo(0.0).mean())))
    if plots and rows:
        step("overview")
        notes = [MATERIALS.get(row.fit.model.name, "") for row in rows]
        plot.write_figure(plot.demo_figure([row.fit for row in rows], notes), out / OVERVIEW)
    return rows
