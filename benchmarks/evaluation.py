"""How many directions a second a model is evaluated at, beside plain NumPy and a table look-up.

python benchmarks/evaluation.py [--directions N]
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

import dsbrdf
from dsbrdf import half_diff
from dsbrdf.model.evaluation import evaluate_any


def look_up(measured, wi, wo):
    """Value of the cell that a pair of directions falls into."""
    theta_h, theta_d, phi_d = half_diff.from_directions(wi, wo)
    i = np.minimum((90 * np.sqrt(theta_h / (np.pi / 2))).astype(int), 89)
    j = np.minimum((theta_d * 180 / np.pi).astype(int), 89)
    k = ((phi_d % np.pi) * 180 / np.pi).astype(int) % 180
    return measured.planes[:, i, j, k].T * measured.scale


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--directions", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    measured = dsbrdf.material("satin-plastic")
    three, five = (dsbrdf.fit(measured, n).model for n in (3, 5))
    rng = np.random.default_rng(0)
    w = rng.normal(size=(2, args.directions, 3))
    w[..., 2] = np.abs(w[..., 2])
    wi, wo = w / np.linalg.norm(w, axis=-1, keepdims=True)
    few = slice(0, args.directions // 5)
    jobs = {
        "kernel, three lobes": (lambda: three.eval(wi, wo), 1),
        "kernel, five lobes": (lambda: five.eval(wi, wo), 1),
        "plain NumPy, three lobes": (lambda: evaluate_any(three.lobes, wi[few], wo[few]), 5),
        "table look-up": (lambda: look_up(measured, wi[few], wo[few]), 5),
    }
    print(f"three channels, {args.directions:,} pairs of directions, median of {args.rounds} rounds")
    rates: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(args.rounds):
        for name, (job, part) in jobs.items():
            start = time.perf_counter()
            job()
            rates[name].append(args.directions / part / (time.perf_counter() - start) / 1e6)
    for name, rate in rates.items():
        print(f"  {name:25s} {statistics.median(rate):6.1f} million a second")


if __name__ == "__main__":
    main()
