"""The long fuzz run: mutated valid files for every reader, in processes that are watched.

    PYTHONPATH=tests/fuzz python tests/fuzz/run.py [--inputs 10000] [--seed 0] [KIND ...]

Prints a line for each reader: how many inputs were read and refused, how many ended in any other way (an exception that
is no ValueError or OSError, a crash, more than ten seconds), the slowest, and how far memory grew. An input is made
from its number and the seed alone; those that ended uncleanly are kept in `--keep`. Takes a few minutes a reader.
"""

import argparse
import contextlib
import json
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np
from formats import VALID, place, sound

SECONDS = 10
BATCH = 5000
EXTREMES = [0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1]
TOKENS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"9" * 400,
    b",",
    b"\n",
    b"[" * 300,
    b"{",
    b'"',
    b"\0",
    b"\xff\xfe",
    b"true",
]


def mutate(content, rng):
    """A few changes to the bytes of a file."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, len(content) + 1))
        length = int(2 ** rng.uniform(0, 8))
        match rng.integers(0, 7):
            case 0:
                del content[at:]
            case 1:
                del content[at : at + length]
            case 2:
                content[at:at] = content[at : at + length]
            case 3:
                content[at : at + length] = rng.bytes(length)
            case 4:
                size = int(rng.choice([1, 2, 4, 8]))
                value = int(EXTREMES[rng.integers(len(EXTREMES))]) % 256**size
                content[at : at + size] = value.to_bytes(size, "little" if rng.integers(2) else "big")
            case 5:
                content[at:at] = TOKENS[rng.integers(len(TOKENS))]
            case 6:
                value = float(rng.choice([np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, 1e-320]))
                kind = "<f" if rng.integers(2) and abs(value) < 1e30 else "<d"
                content[at : at + 8] = struct.pack(kind, value)
    return bytes(content)


def peak():
    """Most memory this process had, MB; `getrusage` would count the parent's as well."""
    return int(re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024


def work(kind, seed, first, count, keep, progress):
    """Read inputs `first` to `first + count`; the worker's whole life."""

    def late(*_):
        raise TimeoutError(f"more than {SECONDS} s")

    signal.signal(signal.SIGALRM, late)
    whole = VALID[kind]()
    result = {"read": 0, "refused": 0, "unclean": [], "slowest": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        sound(kind, place(kind, Path(folder), whole))
        before = peak()
        for index in range(first, first + count):
            progress.write_text(str(index))
            content = mutate(whole, np.random.default_rng([seed, index]))
            path = place(kind, Path(folder), content)
            start = time.perf_counter()
            signal.alarm(SECONDS)
            try:
                result["read" if sound(kind, path) else "refused"] += 1
            except BaseException:
                result["unclean"].append([index, traceback.format_exc(limit=-3)])
                (keep / f"{kind}-{seed}-{index}").write_bytes(content)
            finally:
                signal.alarm(0)
            result["slowest"] = max(result["slowest"], time.perf_counter() - start)
        result["grown"] = peak() - before
    print(json.dumps(result))


def run(kind, seed, inputs, keep):
    """All inputs of one reader, a worker process after another; the sums."""
    total = {"read": 0, "refused": 0, "unclean": [], "slowest": 0.0, "grown": 0.0}
    progress = keep / f".{kind}-progress"
    first = 0
    while first < inputs:
        count = min(BATCH, inputs - first)
        command = [sys.executable, __file__, "--worker", kind, str(seed), str(first), str(count), str(keep)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            # It died: of the last input it began. What it had done before is done again, but for that
            index = int(progress.read_text())
            total["unclean"].append([index, f"status {done.returncode}: {done.stderr[-500:]}"])
            (keep / f"{kind}-{seed}-{index}").write_bytes(
                mutate(VALID[kind](), np.random.default_rng([seed, index]))
            )
            first = index + 1
            continue
        # Libraries may print too
        result = json.loads(done.stdout[done.stdout.rindex('{"read"') :])
        for key in ("read", "refused", "unclean"):
            total[key] += result[key]
        for key in ("slowest", "grown"):
            total[key] = max(total[key], result[key])
        first += count
    with contextlib.suppress(FileNotFoundError):
        progress.unlink()
    return total


def main():
    """Parse, run, print."""
    if sys.argv[1:2] == ["--worker"]:
        kind, seed, first, count, keep = sys.argv[2:]
        work(kind, int(seed), int(first), int(count), Path(keep), Path(keep) / f".{kind}-progress")
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", metavar="KIND", nargs="*", help=f"of {', '.join(VALID)}; all by default")
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "dsbrdf-fuzz")
    arguments = parser.parse_args()
    arguments.keep.mkdir(parents=True, exist_ok=True)
    bad = 0
    print(
        f"{'reader':<12} {'inputs':>7} {'read':>7} {'refused':>8} {'unclean':>8} {'slowest s':>10} {'grown MB':>9}"
    )
    for kind in arguments.kinds or VALID:
        total = run(kind, arguments.seed, arguments.inputs, arguments.keep)
        unclean = len(total["unclean"])
        done = total["read"] + total["refused"] + unclean
        print(
            f"{kind:<12} {done:>7} {total['read']:>7} {total['refused']:>8} {unclean:>8} "
            f"{total['slowest']:>10.2f} {total['grown']:>9.0f}",
            flush=True,
        )
        for index, text in total["unclean"][:3]:
            print(f"  input {index}: {text}")
        bad += unclean
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
