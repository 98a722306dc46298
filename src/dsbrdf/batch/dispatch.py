"""Jobs to the workers of any `concurrent.futures.Executor`, and what to do when workers die.

A worker's own errors are answers. A future that fails means that the worker or the way to it is gone, and its jobs are
sent again, each by itself. If that broke the whole executor, as a dead process does with pools of processes, its jobs
are sent one after another, so that the one that kills its worker is found and harms no other.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from queue import SimpleQueue
from typing import TypeAlias

from dsbrdf.batch.jobs import Answer, Job, Order, work

__all__ = ["ExecutorLostError", "Executors", "WorkerDiedError", "dispatched"]

#: An executor, or a function that makes one.
Executors: TypeAlias = Executor | Callable[[], Executor]
Work: TypeAlias = Future[tuple[list[Answer], float]]

#: Jobs are sent in chunks of about this many seconds.
CHUNK_SECONDS = 2.0
MAX_CHUNK = 100
#: One fit uses all cores for most of its time; a second fills in while the first reads.
THREADS = 2
#: Chunks that are sent before the first comes back: so many a worker, or all in all if the executor does not say how
#: many workers it has; one beyond those that threads work on, as what they read takes memory here.
CHUNKS_A_WORKER, CHUNKS, AHEAD = 2, 1000, 1
#: Chunks, of a job each, that are sent before it is known how long a job takes.
PROBES = 16
#: Times that a job is sent before it is given up.
ATTEMPTS = 2


class WorkerDiedError(RuntimeError):
    """The process or the machine of a fit ended before the fit did."""


class ExecutorLostError(RuntimeError):
    """The executor cannot take more jobs."""


def dispatched(
    executor: Executors | None, jobs: Iterable[Job], order: Order, pending: int | None = None
) -> Generator[tuple[Job, Answer], None, None]:
    """Jobs and their answers, as they come; interrupted, it still hands on what is ready.

    Parameters
    ----------
    executor : Executor or callable, optional
        Threads by default.
    jobs : iterable of Job
        Taken from as the work goes on.
    order : Order
    pending : int, optional
        Most chunks that are sent before the first comes back.

    Raises
    ------
    ExecutorLostError
        If the executor is broken and there is no function to make another one.
    """
    sender = _Sender(executor, order, pending)
    jobs = iter(jobs)
    lost: deque[Sequence[Job]] = deque()
    alone: deque[Job] = deque()
    deaths: Counter[int] = Counter()
    size, ended, limit = 1, False, min(sender.limit, PROBES)
    try:
        while True:
            if alone and not sender.pending:
                sender.send([alone.popleft()])
            while not alone and len(sender.pending) < limit and (lost or not ended):
                chunk = lost.popleft() if lost else _taken(jobs, size)
                if chunk:
                    sender.send(chunk)
                else:
                    ended = True
            if not sender.pending:
                return
            chunk, answers, seconds, error = sender.receive()
            yield from zip(chunk, answers, strict=False)
            rest = chunk[len(answers) :]
            if error is None:
                # What was kept takes no time
                size = max(math.ceil(CHUNK_SECONDS / max(seconds, CHUNK_SECONDS / MAX_CHUNK)), 1)
                limit = sender.limit
                if rest:
                    lost.append(rest)
                continue
            is_broken = isinstance(error, BrokenExecutor)
            for job in rest:
                deaths[job.index] += 1
                # Those that were lost together with others need not have killed anything
                if deaths[job.index] == ATTEMPTS + is_broken:
                    yield job, Answer("", error=WorkerDiedError(_reason(error)))
                elif is_broken:
                    alone.append(job)
                else:
                    lost.append([job])
    except GeneratorExit:
        raise
    except BaseException:
        yield from sender.ready()
        raise
    finally:
        sender.close()


def _taken(jobs: Iterable[Job], size: int) -> list[Job]:
    """The next jobs; measurements, which are large, by themselves."""
    chunk: list[Job] = []
    for job in itertools.islice(jobs, size):
        chunk.append(job)
        if not isinstance(job.target, str):
            break
    return chunk


def _reason(error: BaseException) -> str:
    what = str(error) or type(error).__name__
    return f"the worker of the fit died {ATTEMPTS} times ({what}). Out of memory?"


class _Sender:
    """Chunks that are with the workers."""

    def __init__(self, executor: Executors | None, order: Order, limit: int | None) -> None:
        self._given, self._order, self._limit = executor, order, limit
        self._ended: SimpleQueue[Work] = SimpleQueue()
        # With the executor that has them
        self.pending: dict[Work, tuple[Executor, Sequence[Job]]] = {}
        self._take()

    def _take(self) -> None:
        given = self._given
        if isinstance(given, Executor):
            self._executor = given
        else:
            self._executor = ThreadPoolExecutor(THREADS) if given is None else given()
        workers = getattr(self._executor, "_max_workers", None)
        self.limit = CHUNKS if not isinstance(workers, int) else CHUNKS_A_WORKER * workers
        if isinstance(self._executor, ThreadPoolExecutor):
            self.limit = self._executor._max_workers + AHEAD
        self.limit = self._limit or self.limit

    def send(self, chunk: Sequence[Job]) -> None:
        future: Work
        try:
            future = self._executor.submit(work, chunk, self._order)
        except Exception as error:
            # A pool that has been shut down, a connection that is lost
            future = Future()
            future.set_exception(error if isinstance(error, BrokenExecutor) else BrokenExecutor(str(error)))
        self.pending[future] = self._executor, chunk
        future.add_done_callback(self._ended.put)

    def receive(self) -> tuple[Sequence[Job], list[Answer], float, BaseException | None]:
        """Jobs of a chunk that came back, answers for the first of them, the time of each, and what went wrong."""
        future = self._ended.get()
        executor, chunk = self.pending.pop(future)
        try:
            return chunk, *future.result(), None
        except (CancelledError, Exception) as error:
            if isinstance(error, BrokenExecutor) and executor is self._executor:
                self._replace(error)
            return chunk, [], 0.0, error

    def _replace(self, error: BrokenExecutor) -> None:
        if isinstance(self._given, Executor):
            raise ExecutorLostError(
                f"the executor takes no more work ({error}). What was fitted is kept: run this again to go on. With a "
                "function that makes executors, such as loky.get_reusable_executor, it goes on by itself."
            ) from error
        self._take()

    def ready(self) -> Generator[tuple[Job, Answer], None, None]:
        """What need not be waited for; of threads of our own, also what they are at."""
        for future in self.pending:
            future.cancel()
        wait(self.pending, None if self._given is None else 0)
        for future, (_, chunk) in self.pending.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                yield from zip(chunk, future.result()[0], strict=False)

    def close(self) -> None:
        for future in self.pending:
            future.cancel()
        # What a function made may be for others too, as that of loky is
        if self._given is None:
            self._executor.shutdown()
