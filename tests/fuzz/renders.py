"""The Mitsuba plugin over random models: a white furnace, and its sampler against its density.

    PYTHONPATH=tests/fuzz:tests/helpers python tests/fuzz/renders.py [--models 200]

Prints how many models fail, and the extremes. Takes some seconds a model.
"""

import argparse
import sys

import mitsuba_tools as tools
import numpy as np
from scipy import stats

from dsbrdf import DSBRDF, Lobes

#: Incident angles, radians.
ANGLES = np.deg2rad([0.0, 30.0, 60.0, 80.0])
N_SAMPLES, N_CHI2 = 100_000, 100_000
#: Probability that a right plugin fails in a whole run.
SIGNIFICANCE = 1e-3


def random_model(seed):
    """Up to five lobes of any width from flat to near-mirrors, stretched, in colour, with curves of any size."""
    rng = np.random.default_rng([19, seed])
    n_lobes, sizes = rng.integers(1, 6), rng.integers(1, 7, 5)
    top = rng.uniform(0.0, 9.0)
    gamma = np.sort(rng.uniform(-3.0, top, n_lobes))[:, None] + rng.uniform(-0.7, 0.7, (n_lobes, sizes[1]))
    lobes = Lobes(
        rng.uniform(-4.0, 1.5, (n_lobes, sizes[0])),
        gamma,
        rng.uniform(-1.0, 1.0, (n_lobes, sizes[2])),
        rng.uniform(-0.8, 4.0, (n_lobes, sizes[3])),
        rng.uniform(-1.0, 1.0, (3, n_lobes, sizes[4])),
    )
    return DSBRDF(lobes, name=f"random {seed}").conserve_energy()


def furnace(model, bsdf, theta, rng):
    """Light that leaves under white light from everywhere, by the plugin's samples: (sigmas off, greatest channel)."""
    wi = np.array([np.sin(theta), 0.0, np.cos(theta)])
    _, density, weight = tools.draw(bsdf, wi, rng, N_SAMPLES)
    assert np.isfinite(weight).all()
    assert (weight >= 0.0).all()
    assert not weight[density <= 0.0].any()
    error = np.maximum(weight.std(0) / np.sqrt(len(weight)), 1e-9)
    albedo = model.albedo(theta)
    # The quadrature is good to a thousandth, the plugin rounds to single precision
    off = np.maximum(np.abs(weight.mean(0) - albedo) - 2e-3 * albedo, 0.0) / error
    return float(off.max()), float((weight.mean(0) - 4.0 * error).max())


def check(seeds):
    """Failures of some models as text, the worst deviation and brightest furnace, and the least p-value."""
    tools.compiled()
    failures, worst, brightest, least = [], 0.0, 0.0, 1.0
    n_tests = len(seeds) * len(ANGLES)
    significance = 1.0 - (1.0 - SIGNIFICANCE) ** (1.0 / n_tests)
    sigmas = float(stats.norm.isf(significance / 6.0))
    for seed in seeds:
        model = random_model(seed)
        bsdf, rng = tools.load(model), np.random.default_rng(seed)
        for theta in ANGLES:
            where = f"model {seed} at {np.rad2deg(theta):.0f} degrees"
            off, bright = furnace(model, bsdf, theta, rng)
            worst, brightest = max(worst, off), max(brightest, bright)
            if off > sigmas or bright > 1.003:
                failures.append(f"{where}: furnace off by {off:.1f} standard deviations, {bright:.4f}")
            test = tools.chi2_test(bsdf, theta, n=N_CHI2)
            if not test.run(SIGNIFICANCE, n_tests, quiet=True):
                failures.append(f"{where}: samples do not follow their density, p-value {test.p_value:.1e}")
            least = min(least, float(test.p_value))
    return failures, worst, brightest, least


def main(check, about, how):
    """Parse, check models, print: `about` describes the program, `how` what models were seen in."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--models", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    failures, worst, brightest, least = check(range(arguments.first, arguments.first + arguments.models))
    print(
        f"{arguments.models} models{how}: {len(failures)} failures; furnace at most {worst:.1f} "
        f"standard deviations off, brightest {brightest:.4f}; least p-value {least:.1e}"
    )
    print("\n".join(failures))
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main(check, __doc__, f", {len(ANGLES)} angles"))
