"""The space of isotropic BRDFs: lobes and materials on their first principal functions (Figs. 9 and 10)."""

from __future__ import annotations

import warnings
from collections.abc import Callable

from dsbrdf.paper.fit_measured import ConvergenceWarning, fit
from dsbrdf.paper.tables import Tables
from dsbrdf.space import MaterialSpace, build_space

__all__ = ["paper_space"]


def paper_space(tables: Tables, progress: Callable[[str], None]) -> MaterialSpace:
    """The space of all materials, lobes along the border of diffuse and specular ones as in the paper.

    Of logarithms: of kappa and gamma as they are, the gamma of a few lobes that nobody sees makes most of the variance
    (decision record 0011). Lobes are followed over theta_d: curves of lobes that swap have no meaning.
    """
    models = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for name in tables.names:
            progress(name)
            models.append(fit(tables.load(name), azimuthal=False).model)
    return build_space(models, correspondence="border")
