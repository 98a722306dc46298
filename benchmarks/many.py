"""What it costs to send fits to the workers of Dask.

python benchmarks/many.py [N]

Fits N small tables (default 800) on a local cluster of two worker processes of a thread each. Overhead is the share of
the two workers' time between the first and the last answer in which they were not fitting; what the machine does
besides counts on both sides.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
import warnings
from pathlib import Path

import dsbrdf
from dsbrdf.batch import dispatch, fit_many
from dsbrdf.measured.formats.array_file import write_npz


def main() -> None:
    from distributed import Client, LocalCluster

    warnings.simplefilter("ignore")
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 800
    busy, chunks, ends, sent = [], [], [], []
    receive = dispatch._Sender.receive
    send = dispatch._Sender.send

    def noted(self):
        found = receive(self)
        ends.append(time.perf_counter())
        busy.append(found[2] * len(found[1]))
        chunks.append(len(found[1]))
        return found

    dispatch._Sender.receive = noted
    dispatch._Sender.send = lambda self, chunk: (sent.append(time.perf_counter()), send(self, chunk))
    with tempfile.TemporaryDirectory() as folder:
        table = dsbrdf.tabulate(dsbrdf.material("satin-plastic").eval, "satin", shape=(30, 20, 12))
        measured = Path(folder, "measured")
        measured.mkdir()
        for i in range(n):
            write_npz(dataclasses.replace(table, name=f"m{i}"), measured / f"m{i}.npz")
        cluster = LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            env={"RAYON_NUM_THREADS": "1"},
        )
        with cluster, Client(cluster) as client:
            executor = client.get_executor()
            targets = [str(path) for path in sorted(measured.iterdir())]
            # The workers import the package
            fit_many(targets[:4], executor=executor, n_lobes=2)
            for part in (busy, chunks, ends, sent):
                part.clear()
            cpu = time.process_time()
            outcomes = fit_many(targets, Path(folder, "models"), executor, n_lobes=2)
            cpu = time.process_time() - cpu
    wall = ends[-1] - sent[0]
    if failed := [outcome.status for outcome in outcomes if outcome.error is not None]:
        raise SystemExit(failed[0])
    print(
        f"{n} fits in {len(chunks)} chunks of up to {max(chunks)}: {wall:.1f} s, workers busy "
        f"{sum(busy) / (2 * wall):.1%} of it; client and scheduler {1e3 * cpu / n:.1f} ms of processor time a fit"
    )
    # The last chunks end one after another: up to a chunk's time, however many there are
    tail = ends[-1] - ends[-2]
    print(
        f"without the end, when one worker has no more work ({tail:.1f} s): overhead "
        f"{1.0 - sum(busy) / (2 * wall - tail):.1%}"
    )


if __name__ == "__main__":
    main()
