"""Writes the golden model files beside this script; takes a second. The values come from mpmath, with 40 digits.

Run it again only for a new schema: a file of a schema must be read for ever as it was written.
"""

import json
from pathlib import Path

import mpmath as mp

mp.mp.dps = 40
HERE = Path(__file__).parent
WIDTH = 0.01
LOBES = {
    "scale": [[0.1, 1 / 3, -0.25, -1.2345678901234567], [-1.5, -2.0, -2.5, -1.0]],
    "gamma": [[3.0, 4.5, 5.25], [0.1, 2 / 3, -0.2]],
    "beta": [[0.3, -0.7], [1e-17, 0.2]],
    "falloff": [[0.0], [0.9]],
    "colour": [[[0.0, 0.1], [0.5, 0.4]], [[-0.1, 1e-14], [0.25, -0.3]]],
}
ANGLES = [
    [0.0, 0.0, 0.0],
    [0.02, 0.1, 0.3],
    [0.1, 0.8, 1.0],
    [0.3, 1.0, 2.0],
    [0.7, 0.4, 3.0],
    [0.2, 1.3, 1.5],
]
CONTENT = {
    "format": "dsbrdf model",
    "schema": 1,
    "name": "hand-made",
    "units": "radians; 1/sr without the cosine",
    "azimuthal_width": WIDTH,
    "channels": ["450", "650"],
    "lobes": LOBES,
    "source": {"file": "hand.binary", "sha256": None, "description": "made by hand: é, 1/sr"},
    "fit": {"n_lobes": 2, "loss": "log", "prior": False},
    "errors": {"rel": 0.012345678901234567, "albedo": None},
    "profile": {
        "theta_d": [0.1, 0.7],
        "theta_h": [[0.0, 0.5, 1.0]],
        "mean": [[[1.0, 0.5, None], [2.0, 1.0, 0.5]], [[1.5, 0.5, 0.25], [2.5, 1.0, 0.5]]],
        "amplitude": [[[0.0, 0.0, None], [0.0, 0.125, 0.0]], [[0.0, 0.25, 0.5], [0.0, 0.0, 0.0]]],
    },
}


def curve(coefficients, x):
    """Bernstein polynomials up to three coefficients; four are a B-spline of two spans, by de Boor."""
    c = [mp.mpf(value) for value in coefficients]
    if len(c) == 1:
        return c[0]
    knots = {2: [0, 0, 1, 1], 3: [0, 0, 0, 1, 1, 1], 4: [0, 0, 0, mp.mpf(1) / 2, 1, 1, 1]}[len(c)]
    degree = min(len(c) - 1, 2)
    span = max(i for i in range(degree, len(c)) if x >= knots[i])
    d = [c[span - degree + j] for j in range(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[j + span - degree], knots[j + 1 + span - r]
            share = (x - low) / (high - low)
            d[j] = (1 - share) * d[j - 1] + share * d[j]
    return d[degree]


def value(channel, theta_h, theta_d, phi_d):
    theta_h, theta_d, phi_d = map(mp.mpf, (theta_h, theta_d, phi_d))
    x = mp.cos(theta_d)
    p = mp.sin(theta_h) * mp.sin(theta_d)
    g = p / mp.hypot(p, mp.mpf(WIDTH) * mp.cos(theta_h) * x) if p else mp.mpf(0)
    total = mp.mpf(0)
    for k in range(len(LOBES["scale"])):
        kappa = mp.exp(curve(LOBES["scale"][k], x) + curve(LOBES["colour"][channel][k], x))
        power = kappa * mp.cos(theta_h) ** mp.exp(curve(LOBES["gamma"][k], x))
        stretch = mp.exp(curve(LOBES["beta"][k], x) * g * mp.cos(2 * phi_d))
        total += mp.expm1(power) * mp.cos(theta_h) ** curve(LOBES["falloff"][k], x) * stretch
    return float(total)


if __name__ == "__main__":
    values = [[value(channel, *angles) for channel in range(2)] for angles in ANGLES]
    for name, content in (
        ("model-schema-1.json", CONTENT),
        ("model-schema-1-values.json", {"angles": ANGLES, "values": values}),
    ):
        (HERE / name).write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
