"""The paper's experiment, to the letter, with its figures and claims on any set of materials.

`fit_slices` fits a table as the paper does and gives a `SliceFit` with a model of `Slices`. Read the method first:
`collapse` reduces a table to slices, `slices` is the model and `evaluation` its values, `curves` holds parameters as
splines over theta_d, `metrics` measures errors, `spike` is the delta term, `slice_fit` fits lobes to slices, `williams`
and `selection` choose their number, and `fit` and `fit_report` put these together; `baselines` are the paper's
competitors, `space` and `correspondence` its space of materials. Then what `dsbrdf paper` runs: `run` makes the figures
as the paper draws them, a table of all materials, and a report that puts each claim beside our number, from `tables`,
`profiles`, `planes`, `survey`, `accuracy`, `subsampling`, `spheres`, `maps`, `claims` and `report`. Nothing outside of
this room depends on it. Figures need the extra `[plot]`; Figs. 4, 7, 8 and the spheres of Fig. 5 also `[render]`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dsbrdf.paper.collapse import SliceProfile, slice_profiles
from dsbrdf.paper.curves import CurveBasis, Curves
from dsbrdf.paper.fit import fit_slices
from dsbrdf.paper.fit_report import SliceFit
from dsbrdf.paper.selection import LobeSelection, select_lobes
from dsbrdf.paper.slice_fit import ConvergenceWarning, FitStatus
from dsbrdf.paper.slices import Slices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dsbrdf.paper.tables import Tables

__all__ = [
    "WHAT",
    "ConvergenceWarning",
    "CurveBasis",
    "Curves",
    "FitStatus",
    "LobeSelection",
    "SliceFit",
    "SliceProfile",
    "Slices",
    "fit_slices",
    "n_steps",
    "run",
    "select_lobes",
    "slice_profiles",
]

#: What there is to make.
WHAT = (
    "all",
    "fig1",
    "fig2",
    "fig3",
    "fig4",
    "fig5",
    "spheres",
    "fig6",
    "fig7",
    "fig8",
    "fig9",
    "fig10",
    "table",
)


def run(what: str, data: Path | None, out: Path, progress: Callable[[str], None] | None = None) -> list[Path]:
    """Make figures, the table, or everything with the report.

    Parameters
    ----------
    what : str
        One of `WHAT`. "table" writes `table.md` and `table.csv`; "all" also `report.md`; "spheres" are those of Fig. 5.
    data : Path or None
        Folder with MERL .binary files; other files in it are passed over. The built-in materials by default.
    out : Path
        Folder to write to; made if it does not exist.
    progress : callable, optional
        Told what comes next, `n_steps` times.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError
        If `what` is unknown, or the folder has no readable .binary file.
    ModuleNotFoundError
        If a figure is wanted and matplotlib, or Mitsuba for spheres, is missing; then nothing is written.
    OSError
        If a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from dsbrdf import paper
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in paper.run("fig2", None, folder)]
    ['fig2.png']
    """
    return _run(what, _open(what, data), Path(out), progress or (lambda _: None))


def n_steps(what: str, data: Path | None) -> int:
    """How often `run` with these arguments calls `progress`; the same errors.

    Examples
    --------
    >>> from dsbrdf import paper
    >>> paper.n_steps("fig2", None)
    1
    """
    from dsbrdf.paper.spheres import n_renders
    from dsbrdf.paper.survey import N_SAMPLE

    if what in ("fig1", "fig2", "fig3"):
        return 1
    n = len(_open(what, data).names)
    curves = min(n, 3)
    renders = n_renders(n)
    everything = 3 + 2 * n + curves + min(n, N_SAMPLE) + sum(renders.values())
    surveys = dict.fromkeys(("table", "fig5", "fig9", "fig10"), n)
    return {"fig6": curves, "all": everything, **surveys, **renders}[what]


def _open(what: str, data: Path | None) -> Tables:
    from dsbrdf.paper.tables import open_tables

    if what not in WHAT:
        raise ValueError(f"'what' must be one of {', '.join(map(repr, WHAT))}, got {what!r}.")
    return open_tables(None if data is None else Path(data))


def _run(what: str, tables: Tables, out: Path, progress: Callable[[str], None]) -> list[Path]:
    from dsbrdf.paper import accuracy, claims, profiles, report, spheres, subsampling, survey

    if what != "table":
        from dsbrdf import plot
    if what == "all" or what in spheres.FIGURES:
        from dsbrdf.render import variants

        variants.import_mitsuba()
    written: list[Path] = []

    def wanted(*names: str) -> bool:
        return what in ("all", *names)

    def keep(name: str) -> Path:
        written.append(out / name)
        return written[-1]

    makers: dict[str, Callable[[], Figure]] = {
        "fig1": profiles.distributions,
        "fig2": lambda: profiles.lobe_profiles(tables),
        "fig3": lambda: profiles.slice_profiles(tables),
    }
    for name, make in makers.items():
        if wanted(name):
            progress(name)
            plot.write_figure(make(), keep(f"{name}.png"))
    if wanted("fig5", "table"):
        rows = survey.survey(tables, progress)
    if wanted("fig5"):
        plot.write_figure(accuracy.draw(rows), keep("fig5.png"))
    if wanted("fig6"):
        curves = subsampling.subsample(tables, progress)
        plot.write_figure(subsampling.draw(curves), keep("fig6.png"))
    for name, draw in spheres.FIGURES.items():
        if wanted(name):
            plot.write_figure(draw(tables, progress), keep(f"{name}.png"))
    if wanted("fig9", "fig10"):
        from dsbrdf.paper import maps

        space = maps.paper_space(tables, progress)
        for name, draw_map in {"fig9": maps.lobe_map, "fig10": maps.material_map}.items():
            if wanted(name):
                plot.write_figure(draw_map(space), keep(f"{name}.png"))
    figures = list(written)
    if wanted("table"):
        report.write_table(rows, keep("table.md"), tables.title)
        survey.write_csv(rows, keep("table.csv"))
    if what == "all":
        shapes = survey.compare_shapes(tables, progress)
        findings = claims.judge(rows, curves, shapes)
        report.write_report(keep("report.md"), tables, rows, curves, findings, figures)
    return written
