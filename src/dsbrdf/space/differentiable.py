"""Materials of a space with gradients: scores to lobes in any library of the array API standard."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from dsbrdf.model.lobes import FALLOFF, MAX_BETA, Lobes
from dsbrdf.space.material_space import MaterialSpace
from dsbrdf.space.variables import DARK, GAMMA, HEIGHT

__all__ = ["from_scores"]


def from_scores(space: MaterialSpace, scores: Any, xp: Any = np) -> Lobes:
    """Lobes of scores, with gradients.

    Parameters
    ----------
    space : MaterialSpace
    scores : (component,) array of `xp`
        As of `MaterialSpace.scores`, or the first few of them.
    xp : module, optional
        An array library: `numpy`, `jax.numpy`, or `array_api_compat.torch`.

    Returns
    -------
    Lobes
        With arrays of `xp`, a lobe for each slot of the space. What `MaterialSpace.model` does beyond that is not
        smooth and is left out: dark lobes stay, lobes keep their order, nothing is lowered to conserve energy.

    Raises
    ------
    ValueError
        If there are more scores than components.

    Examples
    --------
    >>> import dsbrdf, numpy as np
    >>> from dsbrdf.space import from_scores
    >>> lobes = from_scores(dsbrdf.space.builtin(), np.zeros(10))
    >>> lobes.n_lobes
    5
    """
    fpca, variables, n = space.fpca, space.variables, int(scores.shape[0])
    if n > len(fpca.variances):
        raise ValueError(f"'scores' has {n} components, the analysis has {len(fpca.variances)}.")
    mean, functions = (xp.asarray(part, dtype=scores.dtype) for part in (fpca.mean, fpca.functions[:n]))
    rows = xp.reshape(mean + scores @ functions, (space.n_slots, variables.n_numbers))
    ends = np.cumsum([0, *variables.sizes[:4]]).tolist()
    height, gamma, beta, falloff = (rows[:, a:b] for a, b in pairwise(ends))
    colour = xp.reshape(rows[:, ends[-1] :], (space.n_slots, variables.n_channels, -1))
    bright = xp.exp(xp.clip(height[:, None] + colour, None, float(np.log(HEIGHT[1])))) - DARK
    ln_kappa = xp.permute_dims(xp.log(xp.log1p(xp.clip(bright, *HEIGHT))), (1, 0, 2))
    scale = xp.mean(ln_kappa, axis=0)
    return Lobes(
        scale,
        xp.log(xp.expm1(xp.clip(gamma, GAMMA[0], float(np.log1p(GAMMA[1]))))),
        xp.clip(beta, -MAX_BETA, MAX_BETA),
        xp.clip(falloff, *FALLOFF),
        ln_kappa - scale[None],
    )
