"""Fit a goniometer scan: a CSV file of angles, values and standard deviations to a model.

Run as `python examples/csv_scan.py [scan.csv]`. Without a file it makes a scan of 200 pairs of directions, from a
built-in material with 2 % of noise.
"""

import sys
from pathlib import Path

import numpy as np

import dsbrdf


def make_scan(path):
    """Write a scan with the columns that `dsbrdf.read` looks for; the header says the unit of each angle."""
    rng = np.random.default_rng(1)
    theta_i, theta_o = rng.uniform(0.0, 70.0, (2, 200))
    # Half of the pairs are near the mirror direction
    theta_o[::2] = np.clip(theta_i[::2] + rng.normal(0.0, 6.0, 100), 0.0, 80.0)
    phi_o = np.where(np.arange(200) % 2, rng.uniform(0.0, 360.0, 200), 180.0 + rng.normal(0.0, 6.0, 200))

    def direction(theta, phi):
        theta, phi = np.deg2rad(theta), np.deg2rad(phi)
        return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)

    true = dsbrdf.material("matte").eval(direction(theta_i, 0.0), direction(theta_o, phi_o))
    std = 0.02 * true.mean(-1)
    noisy = np.maximum(true + std[:, None] * rng.normal(size=true.shape), 0.0)
    table = np.column_stack([theta_i, theta_o, phi_o, noisy, std])
    header = "theta_i_deg,theta_o_deg,phi_o_deg,r,g,b,std"
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=header, comments="")


def main():
    """Read, fit, and say how far to trust it."""
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "scan.csv")
    if not path.exists():
        make_scan(path)
    samples = dsbrdf.read(path)  # or dsbrdf.read_samples(path, columns=[...]) without a header
    fit = dsbrdf.fit(samples)
    print(samples)
    print(f"{fit.model}, {fit.errors}")
    if fit.coverage.sentence:
        print(fit.coverage.sentence)
    low, high = fit.band([np.sqrt(0.5), 0.0, np.sqrt(0.5)], [0.0, 0.0, 1.0])
    bounds = zip(fit.model.channels, low, high, strict=True)
    print("95 % at 45 degrees, normal view:", ", ".join(f"{c} {a:.4f} to {b:.4f}" for c, a, b in bounds))
    fit.model.save(path.with_suffix(".json"))


if __name__ == "__main__":
    main()
