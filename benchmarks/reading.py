"""Speed of `read` on text, as a ratio to `pandas.read_csv` of the same file, and the memory of a large one.

    python benchmarks/reading.py

Writes files of 100,000 and 600,000 samples of three channels to a temporary folder. Ratios of CPU time, best of five.
Takes about 20 s; needs pandas.
"""

import re
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

PEAK = """
import sys, warnings
warnings.simplefilter("ignore")
import dsbrdf
dsbrdf.read(sys.argv[1])
print(open("/proc/self/status").read())
"""


def best(work, n=5):
    seconds = []
    for _ in range(n):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def main():
    import pandas as pd

    from dsbrdf import read

    warnings.simplefilter("ignore")
    rng = np.random.default_rng(1)
    n = 100_000
    angles = rng.uniform(0.0, (80.0, 80.0, 360.0), (n, 3))
    rows = np.concatenate([angles, rng.uniform(0.0, 0.3, (n, 3))], axis=1)
    header = "theta_i_deg,theta_o_deg,phi_o_deg,r,g,b\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.csv"
        with path.open("w") as file:
            file.write(header)
            np.savetxt(file, rows, fmt="%.6g", delimiter=",")
        plain = path.read_text()
        yardstick = best(lambda: pd.read_csv(path))
        print(f"pandas.read_csv, {n:,} lines: {yardstick:.3f} s of CPU")
        kinds = {
            "plain": plain,
            "decimal comma": plain.replace(",", ";").replace(".", ","),
            "blanks": plain.replace(",", " "),
            "quoted": "\n".join('"' + line.replace(",", '","') + '"' for line in plain.splitlines()),
        }
        for kind, text in kinds.items():
            path.write_text(text)
            print(f"read, {kind}: {best(lambda: read(path)) / yardstick:.1f} times that")
        body = plain.split("\n", 1)[1]
        path.write_text(header + 6 * body)
        done = subprocess.run([sys.executable, "-c", PEAK, path], capture_output=True, text=True, check=True)
        peak = int(re.search(r"VmHWM:\s*(\d+)", done.stdout)[1]) / 1024
        print(f"{path.stat().st_size / 1e6:.0f} MB of text: {peak:.0f} MB at most, the whole process")


if __name__ == "__main__":
    main()
