"""How long a fit takes, as ratios against things run beside it.

    python benchmarks/fit.py DIR        DIR holds MERL `.binary` files
    python benchmarks/fit.py            built-in materials, written to a temporary folder

Prints medians over rounds of:

- all files, with all choices and with four lobes, and the paper's slices, against `numpy.fromfile` of the same files;
- scattered samples of a material, 20,000 of 3 channels and 1,439 of 31, against `numpy.exp` of ten million numbers;
- one file as a whole process (import included) and its peak memory;
- a slice of the paper against `scipy.optimize.least_squares` on the uncollapsed samples, same start and unknowns.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf.measured import built_in
from dsbrdf.paper import ConvergenceWarning, fit_slices, slice_profiles
from dsbrdf.paper.slice_fit import fit_profiles

N_LOBES = 3
ONE_FILE = """
import dsbrdf, pathlib, sys
dsbrdf.fit(dsbrdf.read(sys.argv[1]))
status = pathlib.Path("/proc/self/status")
lines = status.read_text().splitlines() if status.exists() else []
print(next((line.split()[1] for line in lines if line.startswith("VmHWM")), "nan"))
"""


def seconds(work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def read_all(files: list[Path]) -> None:
    for file in files:
        np.fromfile(file)


def fit_all(files: list[Path], fit, *options) -> None:
    for file in files:
        fit(dsbrdf.read(file), *options)


def whole_files(files: list[Path], rounds: int) -> None:
    jobs = {
        "numpy.fromfile": lambda: read_all(files),
        "fit": lambda: fit_all(files, dsbrdf.fit),
        "fit, four lobes": lambda: fit_all(files, dsbrdf.fit, 4),
        "paper's, three lobes": lambda: fit_all(files, fit_slices, N_LOBES),
    }
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds + 1):
        for name, job in jobs.items():
            times[name].append(seconds(job))
    base = times["numpy.fromfile"][1:]
    print(f"\n{len(files)} files, {os.cpu_count()} cores, median of {rounds} rounds")
    for name, all_times in times.items():
        warm = all_times[1:]
        ratio = statistics.median(t / b for t, b in zip(warm, base, strict=True))
        print(f"  {name:22s} {statistics.median(warm):7.3f} s   {ratio:5.2f} x fromfile")


def scattered(rounds: int) -> None:
    rng = np.random.default_rng(1)
    numbers = rng.random(10_000_000)
    reflectance = built_in.get("glossy-plastic").reflectance
    print()
    for n, n_channels in ((20_000, 3), (1_439, 31)):
        directions = rng.normal(size=(2, n, 3))
        directions[..., 2] = np.abs(directions[..., 2])
        wi, wo = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        values = reflectance(wi, wo)[:, np.arange(n_channels) % 3]
        samples = dsbrdf.Samples(wi, wo, values)
        ours, theirs = [], []
        for _ in range(rounds + 1):
            ours.append(seconds(lambda samples=samples: dsbrdf.fit(samples)))
            theirs.append(seconds(lambda: np.exp(numbers)))
        ratio = statistics.median(a / b for a, b in zip(ours[1:], theirs[1:], strict=True))
        print(
            f"  {n} samples x {n_channels} channels: {statistics.median(ours[1:]):.3f} s, {ratio:.1f} x exp"
        )


def one_process(file: Path, rounds: int) -> None:
    walls, peaks = [], []
    command = [sys.executable, "-W", "ignore", "-c", ONE_FILE, str(file)]
    for _ in range(rounds):
        start = time.perf_counter()
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        walls.append(time.perf_counter() - start)
        peaks.append(float(done.stdout) / 1024)
    print(f"\none file, whole process: {statistics.median(walls):.3f} s, peak {max(peaks):.0f} MB")


def against_scipy(files: list[Path]) -> None:
    """One green slice (theta_d = 40 degrees) of each file, uncollapsed, against the mean slice of the kernel."""
    from scipy.optimize import least_squares

    ours, theirs = [], []
    row, channel = 40, 1
    for file in files:
        measured = dsbrdf.read(file)
        profiles = slice_profiles(measured)
        theta_h = np.repeat(measured.theta_h[:, None], len(measured.phi_d), axis=1)
        values = measured.rows([row])[channel, :, 0]
        keep = (
            np.isfinite(values) & (theta_h >= np.deg2rad(1)) & (theta_h < np.pi / 2 - measured.theta_d[row])
        )
        y, log_cos = values[keep], np.log(np.cos(theta_h[keep]))
        start = np.log([[np.log1p(y.max()) / 2**k, 100 / 2**k] for k in range(N_LOBES)]).ravel()

        def residual(x, log_cos=log_cos, y=y):
            kappa, gamma = np.exp(x.reshape(-1, 2).T)
            return np.expm1(kappa * np.exp(gamma * log_cos[:, None])).sum(1) - y

        fit_profiles(profiles, N_LOBES)
        whole = seconds(lambda profiles=profiles: fit_profiles(profiles, N_LOBES))
        ours.append(whole / (len(profiles) * measured.n_channels))
        theirs.append(
            seconds(
                lambda residual=residual, start=start: least_squares(
                    residual, start, method="trf", x_scale="jac"
                )
            )
        )
    print(
        f"\none slice, mean of {len(files)} files: {np.mean(ours) * 1e6:.0f} us, SciPy {np.mean(theirs):.3f} s, "
        f"{np.mean(theirs) / np.mean(ours):,.0f} times"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    for category in (dsbrdf.ConvergenceWarning, ConvergenceWarning):
        warnings.simplefilter("ignore", category)
    with tempfile.TemporaryDirectory() as made:
        folder = args.folder
        if folder is None:
            folder = Path(made)
            for name in built_in.names():
                dsbrdf.write_merl(dsbrdf.material(name), folder / f"{name}.binary")
        files = sorted(folder.glob("*.binary"))
        whole_files(files, args.rounds)
        scattered(args.rounds)
        one_process(files[0], args.rounds)
        against_scipy(files[:: max(len(files) // 10, 1)])


if __name__ == "__main__":
    main()
