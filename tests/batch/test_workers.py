"""Fits in threads and after a fork: nothing waits for ever."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from batches import OPTIONS

import dsbrdf

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


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
