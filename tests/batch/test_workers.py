"""Fits in processes, in threads and after a fork: what is killed harms nothing else, and nothing waits for ever."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from batches import OPTIONS, files_in, run, table

import dsbrdf
from dsbrdf import batch
from dsbrdf.batch import worker

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")

# In processes


def test_processes_give_the_same(database, tmp_path):
    threads = run(database, tmp_path / "threads")
    processes = run(database, tmp_path / "processes", processes=2, plots=True)
    for one, other in zip(threads, processes, strict=True):
        assert other.error is None
        assert one.path.read_bytes() == other.path.read_bytes()
        assert {**one.summary, "seconds": 0} == {**other.summary, "seconds": 0}
    assert {"a.png", "a-parameters.png"} < set(files_in(tmp_path / "processes"))
    again = run(database, tmp_path / "processes", processes=2)
    assert all(outcome.kept for outcome in again)


def test_errors_come_from_processes_too(database, capsys):
    (database / "b.binary").unlink()
    (database / "b.binary").write_text("not a table")
    outcomes = run(database, None, processes=1)
    assert [outcome.error is None for outcome in outcomes] == [True, False, True]
    assert "not a MERL file" in outcomes[1].status
    (outcome,) = batch.fit_many(["matte"], processes=1, n_lobes=0)
    assert "'n_lobes' must be 1 to 10 or 'auto', got 0" in outcome.status
    assert isinstance(outcome.error, ValueError)
    assert capsys.readouterr().out == ""


def test_warnings_come_from_processes_too():
    with pytest.warns(
        dsbrdf.ConvergenceWarning, match="polished-chrome: the search ended after 1 iterations"
    ):
        (outcome,) = batch.fit_many(["polished-chrome"], processes=1, n_lobes=3, max_iterations=1)
    assert outcome.status == "out of iterations"


def kill_when_seen(processes, times, done):
    """Kill -9 the first process, as soon as it is there, so many times."""
    killed = set()
    while len(killed) < times and not done.is_set():
        for process in list(processes):
            if process.pid not in killed and process.poll() is None and len(killed) < times:
                os.kill(process.pid, signal.SIGKILL)
                killed.add(process.pid)
        time.sleep(0.005)


@pytest.mark.parametrize(("times", "n_failed"), [(1, 0), (2, 1)])
def test_a_killed_worker_harms_one_at_most(database, tmp_path, monkeypatch, times, n_failed):
    """Once, the fit is tried again; twice, it has failed. The others go on."""
    seen, done = [], threading.Event()
    real = worker.Workers.__init__

    def spied(self, count):
        real(self, count)
        seen.append(self)

    monkeypatch.setattr(worker.Workers, "__init__", spied)
    killer = threading.Thread(
        target=lambda: (wait_for(seen, done), kill_when_seen(seen[0]._all, times, done)), daemon=True
    )
    killer.start()
    outcomes = run(database, tmp_path / "out", processes=1)
    done.set()
    killer.join(10)
    failed = [outcome for outcome in outcomes if outcome.error is not None]
    assert len(failed) == n_failed
    for outcome in failed:
        assert isinstance(outcome.error, batch.WorkerDiedError)
        assert "the process of the fit died 2 times (signal 9, SIGKILL). Out of memory?" in outcome.status
    assert [row["status"] for row in table(tmp_path / "out")].count("ok") == 3 - n_failed
    assert all(process.poll() is not None for process in seen[0]._all)


def wait_for(seen, done):
    while not seen and not done.is_set():
        time.sleep(0.005)


def test_no_process_is_left(database, monkeypatch):
    """Not even when it is interrupted."""
    seen = []
    real = worker.Workers._process

    def spied(self):
        process = real(self)
        seen.append(process)
        return process

    monkeypatch.setattr(worker.Workers, "_process", spied)

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(database, None, processes=2, done=stop)
    assert seen
    assert all(process.poll() is not None for process in seen)


def test_fewer_processes_than_none():
    with pytest.raises(ValueError, match=r"'processes' must be at least 0, got -1\."):
        batch.fit_many([], processes=-1)


# Threads and forks


def test_fits_in_threads(small_table):
    expected = dsbrdf.fit(small_table, **OPTIONS).model.lobes.scale
    with ThreadPoolExecutor(8) as pool:
        fits = list(pool.map(lambda _: dsbrdf.fit(small_table, **OPTIONS), range(24)))
    for fit in fits:
        np.testing.assert_array_equal(fit.model.lobes.scale, expected)


def test_the_lock_of_the_interpreter_is_released():
    """Python goes on while the kernel works."""
    table = dsbrdf.material("rough-gold")
    ticks, done = [], threading.Event()

    def tick():
        while not done.wait(0.0005):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    dsbrdf.fit(table, 4)
    took = time.perf_counter() - start
    done.set()
    thread.join()
    during = [t for t in ticks if start < t < start + took]
    assert len(during) > 5
    assert np.diff([start, *during, start + took]).max() < 0.7 * took


FORK = """
import os, signal, sys, threading, warnings
import numpy as np
import dsbrdf
from tables import built_in

warnings.simplefilter("ignore")
table = built_in("matte", (30, 6, 12))
up = np.tile([0.0, 0.6, 0.8], (20000, 1))

def work():
    model = dsbrdf.fit(table, 1).model
    return model.lobes.scale.tobytes() + model.eval(up, up).tobytes()

expected = work()
stop = threading.Event()
others = [threading.Thread(target=lambda: [work() for _ in iter(stop.is_set, True)]) for _ in range(2)]
if "busy" in sys.argv:
    for thread in others:
        thread.start()
children = []
for _ in range(8):
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        os._exit(0 if work() == expected else 3)
    children.append(child)
codes = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
stop.set()
assert work() == expected
print(codes)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.parametrize("state", ["idle", "busy"])
def test_a_forked_child_can_fit(state):
    """The kernel's threads are not in the child: it needs its own. Also where others were at work in that moment."""
    command = [sys.executable, "-W", "ignore", "-c", FORK, state]
    path = os.pathsep.join(sys.path)
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str([0] * 8)
