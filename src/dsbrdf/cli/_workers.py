"""Processes that commands work in."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import Executor, ProcessPoolExecutor

__all__ = ["processes"]


def processes(n: int) -> Executor:
    """A pool of processes that share the cores."""
    threads = max(1, (os.cpu_count() or 1) // n)
    return ProcessPoolExecutor(
        n, multiprocessing.get_context("spawn"), initializer=_share_cores, initargs=(threads,)
    )


def _share_cores(threads: int) -> None:
    """Let the kernel of this process have so many threads, unless the user has said how many."""
    for name in ("RAYON_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, str(threads))
