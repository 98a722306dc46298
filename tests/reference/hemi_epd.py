"""Reference values of `dsbrdf.hemi_epd` at 50 digits, written to `hemi_epd.json` beside this file.

Run with `python tests/reference/hemi_epd.py`; it needs mpmath and NumPy and takes about a minute.

Everything but the entropy is a sum of the positive series of Eq. (4), with u = cos(theta_h) and L = -ln u:

    int_0^1 expm1(kappa u^gamma) du = sum a_n,   a_n = kappa^n / (n! (n gamma + 1)),   n >= 1;
    P(angle > theta_h) = sum a_n exp(-(n gamma + 1) L) / sum a_n.

The entropy is an integral over L, by Gauss-Legendre rules on panels that grow by factors of three.
Parameters, angles and probabilities are float64 numbers, taken as exact; results are decimal strings.
"""

import json
from pathlib import Path

import mpmath as mp
import numpy as np

mp.mp.dps = 50

KAPPA = (1e-14, 1e-6, 0.01, 0.7, 3.0, 12.0, 45.0, 200.0, 700.0)
GAMMA = (1e-6, 1e-3, 0.1, 1.0, 7.5, 100.0, 2e4, 1e6)
SHARES = (1e-200, 1e-12, 1e-3, 0.1, 0.5, 0.9, 0.999, 1 - 2.0**-40, 1 - 2.0**-53)
# Angles are these multiples of the median angle, and some of a right angle.
OF_MEDIAN = (1e-9, 1e-3, 0.2, 1.0, 2.0, 4.0)
OF_RIGHT = (0.8, 1 - 1e-9, 1.0)
DIGITS = 20


def rates_and_weights(kappa, gamma):
    """Rates n gamma + 1 and normalised weights of the exponentials of L, and the sum of the series."""
    rates, terms, n, power = [], [], 0, mp.mpf(1)
    while n <= kappa or terms[-1] > mp.mpf(10) ** -60 * terms[0]:
        n += 1
        power *= kappa / n
        rates.append(n * gamma + 1)
        terms.append(power / rates[-1])
    total = mp.fsum(terms)
    return rates, [term / total for term in terms], total


def lower(depth, rates, weights):
    return -mp.fsum(w * mp.expm1(-r * depth) for r, w in zip(rates, weights, strict=True))


def upper(depth, rates, weights):
    return mp.fsum(w * mp.exp(-r * depth) for r, w in zip(rates, weights, strict=True))


def density(depth, rates, weights):
    return mp.fsum(w * r * mp.exp(-r * depth) for r, w in zip(rates, weights, strict=True))


def depth_at(share, rates, weights):
    """L with P(-ln cos(angle) <= L) = share, by Newton's method on a monotone function of one curvature."""
    depth = mp.mpf(0)
    while True:
        slope = density(depth, rates, weights)
        if share < 0.5:
            step = (mp.mpf(share) - lower(depth, rates, weights)) / slope
        else:
            tail = upper(depth, rates, weights)
            step = mp.log(tail / (1 - mp.mpf(share))) * tail / slope
        depth += step
        if step <= depth * mp.mpf(10) ** -30:
            return depth


def angle_at(depth):
    return mp.atan(mp.sqrt(mp.expm1(2 * depth)))


def entropy(kappa, gamma, total):
    """-int p ln p over the hemisphere, with p = expm1(x) / (2 pi total), x = kappa exp(-gamma L)."""
    end = mp.mpf(140) / (gamma + 1)
    panels = [end]
    while panels[-1] > mp.mpf(1) / (8 * (1 + gamma + kappa * gamma)):
        panels.append(panels[-1] / 3)

    def integrand(depth):
        value = mp.expm1(kappa * mp.exp(-gamma * depth))
        return mp.exp(-depth) * value * mp.log(value)

    integral = mp.quad(integrand, [0, *reversed(panels)], method="gauss-legendre")
    return mp.log(2 * mp.pi * total) - integral / total


def hemi_epd(kappa, gamma):
    """All reference values of one pair of parameters."""
    k, g = mp.mpf(kappa), mp.mpf(gamma)
    rates, weights, total = rates_and_weights(k, g)
    log_c = -mp.log(2 * mp.pi * total)
    median = float(angle_at(depth_at(0.5, rates, weights)))
    angles = sorted({m * median for m in OF_MEDIAN if m * median < 1.55} | {m * np.pi / 2 for m in OF_RIGHT})
    depths = [-mp.log(mp.cos(mp.mpf(theta))) for theta in angles]
    log_pdf = [log_c + mp.log(mp.expm1(k * mp.exp(-g * depth))) for depth in depths]
    return {
        "kappa": kappa,
        "gamma": gamma,
        "log_normaliser": text(log_c),
        "mean": text(mp.fsum(w * r / (r + 1) for r, w in zip(rates, weights, strict=True))),
        "entropy": text(entropy(k, g, total)),
        "theta_h": angles,
        "lobe": [text(mp.expm1(k * mp.exp(-g * depth))) for depth in depths],
        "log_pdf": [text(value) for value in log_pdf],
        "pdf": [text(mp.exp(value)) for value in log_pdf],
        "cdf": [text(lower(depth, rates, weights)) for depth in depths],
        "q": list(SHARES),
        "quantile": [text(angle_at(depth_at(q, rates, weights))) for q in SHARES],
    }


def von_mises_fisher(kappa):
    """Eq. (3), and its limit 1 / (4 pi) at kappa = 0."""
    k = mp.mpf(kappa)
    factor = k / mp.sinh(k) if kappa else mp.mpf(1)
    angles = [0.0, 1e-9, 1e-4, 0.03, 0.5, np.pi / 2, 2.5, np.pi]
    log_pdf = [mp.log(factor / (4 * mp.pi)) + k * mp.cos(mp.mpf(theta)) for theta in angles]
    return {
        "kappa": kappa,
        "theta_h": angles,
        "log_pdf": [text(value) for value in log_pdf],
        "pdf": [text(mp.exp(value)) for value in log_pdf],
    }


def text(value):
    return mp.nstr(value, DIGITS)


def main():
    values = {
        "hemi_epd": [hemi_epd(kappa, gamma) for kappa in KAPPA for gamma in GAMMA],
        "von_mises_fisher": [von_mises_fisher(k) for k in (0.0, 1e-12, 1e-3, 0.5, 1.0, 20.0, 700.0, 1e6)],
    }
    blocks = (f'"{name}": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]" for name, rows in values.items())
    Path(__file__).with_suffix(".json").write_text("{\n" + ",\n".join(blocks) + "\n}\n")


if __name__ == "__main__":
    main()
