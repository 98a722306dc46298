"""A hand-made model of curves and its values, written beside this file; it takes a second.

`model-schema-2-curves.json` is what `save` wrote when curves came to schema 2: do not write it again when the layout
changes. Its values in 1/sr at angles (theta_h, theta_d, phi_d) are from mpmath and the formulas alone: B-splines by
their recursion (Cox, de Boor), tabulated at the middles of one-degree cells, values linear between those.

Run with `python tests/golden/curves.py`; it needs mpmath, and the package for a model not yet there.
"""

import json
from pathlib import Path

import mpmath as mp
import numpy as np
from models import ANGLES, WIDTH

HERE = Path(__file__).parent
DEGREE = 2
#: Knots at 0, 22.5, 45, 67.5 and 90 degrees.
BREAKS = 5
#: (channel, lobe, coefficient), of ln(kappa) and ln(gamma).
LN_KAPPA = [
    [[-1.5, -1.25, -1.0, -1.5, -0.5, 0.75], [0.5, 0.25, 0.625, 0.5, 1.0, 1.75]],
    [[-3.0, -2.0, -2.5, -1.0, 0.0, 0.5], [1 / 3, 0.1, 0.2, 0.4, 0.9, 1.1]],
]
LN_GAMMA = [
    [[-0.5, 0.5, 0.0, 1.0, 0.25, 0.1], [4.5, 4.0, 5.0, 4.25, 3.0, 2.0]],
    [[-2.0, -1.0, 0.0, 1.0, 2.0, 1.5], [6.0, 5.0, 4.0, 5.0, 4.0, 3.0]],
]
BETA = [
    [[0.0, 0.1, 0.2, 0.3, 0.2, 0.1], [-0.9, -0.5, 0.0, 0.5, 0.9, 1.0]],
    [[0.5, 0.25, 0.0, -0.25, -0.5, -1.0], [0.0] * 6],
]
SPIKE = [[0.0] * 6, [5.0, 0.0, 0.25, 10.0, 30.0, 2.0]]


def write_model(path):
    """The model file of the package."""
    from dsbrdf import CurveBasis, Curves

    arrays = (np.array(values) for values in (LN_KAPPA, LN_GAMMA, BETA))
    Curves(CurveBasis(), *arrays, spike=np.array(SPIKE)).model(name="hand-made").save(path)


def functions(x):
    """Values of the six B-splines at `x`."""
    step = mp.pi / 2 / (BREAKS - 1)
    inner = [i * step for i in range(BREAKS)]
    knots = [inner[0]] * DEGREE + inner + [inner[-1]] * DEGREE

    def spline(i, degree):
        if degree == 0:
            return mp.mpf(knots[i] <= x < knots[i + 1])
        low, high = knots[i + degree] - knots[i], knots[i + degree + 1] - knots[i + 1]
        rising = (x - knots[i]) / low * spline(i, degree - 1) if low else 0
        falling = (knots[i + degree + 1] - x) / high * spline(i + 1, degree - 1) if high else 0
        return rising + falling

    return [spline(i, DEGREE) for i in range(BREAKS + DEGREE - 1)]


def row_value(row, channel, theta_h, theta_d, phi_d):
    """Sum over the lobes at the parameters of a row, with the azimuthal term, and the spike."""
    basis = functions((row + mp.mpf(1) / 2) * mp.pi / 180)

    def at(coefficients):
        return mp.fdot(basis, coefficients)

    p, q = mp.sin(theta_h) * mp.sin(theta_d), mp.cos(theta_h) * mp.cos(theta_d)
    azimuth = p / mp.sqrt(p**2 + (mp.mpf(WIDTH) * q) ** 2) * mp.cos(2 * phi_d)
    light = 0
    for kappa, gamma, beta in zip(LN_KAPPA[channel], LN_GAMMA[channel], BETA[channel], strict=True):
        lobe = mp.expm1(mp.exp(at(kappa)) * mp.cos(theta_h) ** mp.exp(at(gamma)))
        light += lobe * (1 + at(beta) * azimuth)
    cap = 1 - (mp.sin(theta_h) / mp.sin(mp.pi / 180)) ** 2
    return light + at(SPIKE[channel]) * max(cap, 0)


def value(channel, theta_h, theta_d, phi_d):
    """Value of the model, linear in theta_d between rows and held beyond the first and last."""
    position = min(max(theta_d * 180 / mp.pi - mp.mpf(1) / 2, 0), 89)
    low = min(int(position), 88)
    weight = position - low
    below, above = (row_value(row, channel, theta_h, theta_d, phi_d) for row in (low, low + 1))
    return (1 - weight) * below + weight * above


def main():
    """Write the values, and the model if it is not there."""
    path = HERE / "model-schema-2-curves.json"
    if not path.exists():
        write_model(path)
    with mp.workdps(40):
        values = [[float(value(channel, *map(mp.mpf, at))) for channel in range(2)] for at in ANGLES]
    text = json.dumps({"angles": ANGLES, "values": values}, indent=1)
    (HERE / f"{path.stem}-values.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
