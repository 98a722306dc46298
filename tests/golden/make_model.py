"""Write `model-schema-1.json`, made by hand, and the values that it must have; takes a second.

Once schema 1 has been released these files stay as they are: every later version reads them.
"""

import json
from pathlib import Path

import mpmath as mp
import numpy as np

from dsbrdf import DSBRDF, Lobes, half_diff
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.source import Source

HERE = Path(__file__).parent
ANGLES = [(0.0, 0.0, 0.0), (0.1, 0.3, 0.4), (0.02, 1.3, 1.0), (0.6, 0.5, 2.2), (0.3, 0.9, 3.0), (0.9, 0.2, 1.5)]

MODEL = DSBRDF(
    Lobes(
        scale=[[-1.2345678901234567, -0.5, 1 / 3, 0.1], [0.7, 1.1, 1.3, 1.2]],
        gamma=[[-0.25, 0.5], [5.0, 6.2]],
        beta=[[1e-17, -0.3, 0.4], [0.6, 0.2, 0.0]],
        falloff=[[0.75], [0.0]],
        colour=[[[0.1, -0.2], [0.0, 0.05]], [[-0.1, 0.2], [0.0, -0.05]]],
    ),
    ["550", "650"],
    name="hand-made",
    source=Source(
        description="made by hand: é, 1/sr",
        recorded={"file": "hand.binary", "sha256": None, "description": "made by hand: é, 1/sr"},
    ),
    fit_options={"n_lobes": "auto", "loss": "log", "prior": False},
    errors={"rel": 0.012345678901234567, "albedo": float("nan")},
    profile=MeasuredProfile(
        [0.2, 0.8], [[0.0, 0.4]] * 2, np.full((2, 2, 2), 0.25), [[[0.0, np.nan]] * 2] * 2
    ),
)


def curve(coefficients, x):
    """By de Boor's recursion, with many digits."""
    size = len(coefficients)
    degree = min(size - 1, 2)
    spans = max(size - degree, 1)
    knots = [mp.mpf(0)] * degree + [mp.mpf(i) / spans for i in range(spans + 1)] + [mp.mpf(1)] * degree
    span = min(int(x * spans), spans - 1) + degree
    points = [mp.mpf(coefficients[i]) for i in range(span - degree, span + 1)]
    for level in range(1, degree + 1):
        for i in range(degree, level - 1, -1):
            low = knots[span - degree + i]
            share = (x - low) / (knots[span + 1 + i - level] - low)
            points[i] = (1 - share) * points[i - 1] + share * points[i]
    return points[degree]


def value(theta_h, theta_d, phi_d):
    """The formula of `Lobes`, written out."""
    lobes = MODEL.lobes
    x, cos = mp.cos(mp.mpf(theta_d)), mp.cos(mp.mpf(theta_h))
    p, q = mp.sin(theta_h) * mp.sin(theta_d), half_diff.AZIMUTHAL_WIDTH * cos * x
    azimuth = p / mp.hypot(p, q) * mp.cos(2 * mp.mpf(phi_d))
    result = []
    for colour in lobes.colour:
        total = mp.mpf(0)
        for k in range(MODEL.n_lobes):
            kappa = mp.exp(curve(lobes.scale[k], x) + curve(colour[k], x))
            gamma = mp.exp(curve(lobes.gamma[k], x))
            factor = cos ** curve(lobes.falloff[k], x) * mp.exp(curve(lobes.beta[k], x) * azimuth)
            total += mp.expm1(kappa * cos**gamma) * factor
        result.append(float(total))
    return result


if __name__ == "__main__":
    mp.mp.dps = 40
    MODEL.save(HERE / "model-schema-1.json")
    frozen = {"angles": ANGLES, "values": [value(*angles) for angles in ANGLES]}
    (HERE / "model-schema-1-values.json").write_text(json.dumps(frozen, indent=1) + "\n")
