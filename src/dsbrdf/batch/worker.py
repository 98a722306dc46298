"""Fits in processes of their own, which may crash or be killed without harm to the one that asked for them."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pickle
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from dsbrdf.batch import WorkerDiedError, open_target
from dsbrdf.fitting.fit import Fit, fit
from dsbrdf.measured import MeasuredBRDF, Samples

__all__ = ["Workers"]

#: Times that a fit is begun before its process is not given another chance.
ATTEMPTS = 2


class Workers:
    """A process for each thread that asks for a fit, started when it is needed.

    Parameters
    ----------
    count : int
        Number of threads that will ask; the processor's cores are shared out to so many processes.
    """

    def __init__(self, count: int) -> None:
        self._threads_each = max(1, (os.cpu_count() or 1) // count)
        self._of_thread = threading.local()
        self._all: list[subprocess.Popen[bytes]] = []
        self._closed = False

    def fit(
        self,
        target: str | MeasuredBRDF | Samples,
        reading: Mapping[str, Any] | None,
        measured: MeasuredBRDF | Samples,
        options: Mapping[str, Any],
        hashed: bool,
    ) -> tuple[Fit, dict[str, Any]]:
        """Fit `target`, which is `measured` or names it; the result and its summary, and the file's hash if wanted.

        Raises
        ------
        WorkerDiedError
            If the process dies, and the next one too.
        Exception
            What the fit raises.
        """
        for attempt in range(1, ATTEMPTS + 1):
            process = self._process()
            try:
                result, summary, error, told = _ask(process, (target, reading, dict(options), hashed))
                break
            except (EOFError, OSError, pickle.UnpicklingError):
                process.kill()
                code = process.wait()
                if attempt == ATTEMPTS or self._closed:
                    raise WorkerDiedError(
                        f"the process of the fit died {attempt} times ({_reason(code)}). Out of memory?"
                    ) from None
        for text, category in told:
            warnings.warn(text, category, stacklevel=2)
        if error is not None:
            raise error
        if result.model.source.file is not None:
            # With its hash
            measured = dataclasses.replace(measured, source=result.model.source)
        return dataclasses.replace(result, measured=measured), summary

    def _process(self) -> subprocess.Popen[bytes]:
        process: subprocess.Popen[bytes] | None = getattr(self._of_thread, "process", None)
        if process is None or process.poll() is not None:
            import dsbrdf

            path = [str(Path(dsbrdf.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
            environment = {"RAYON_NUM_THREADS": str(self._threads_each)} | os.environ
            environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "dsbrdf.batch.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )
            self._of_thread.process = process
            self._all.append(process)
        return process

    def close(self) -> None:
        """End all processes; fits that go on fail."""
        self._closed = True
        for process in self._all:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                # What a dead process did not take is lost
                with contextlib.suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]


def _ask(process: subprocess.Popen[bytes], job: Any) -> Any:
    assert process.stdin is not None
    assert process.stdout is not None
    pickle.dump(job, process.stdin)
    process.stdin.flush()
    return pickle.load(process.stdout)


def _reason(code: int) -> str:
    with contextlib.suppress(ValueError):
        return f"signal {-code}, {signal.Signals(-code).name}"
    return f"exit status {code}"


def _serve(jobs: BinaryIO, answers: BinaryIO) -> None:
    """Answer jobs until there are no more."""
    while True:
        try:
            target, reading, options, hashed = pickle.load(jobs)
        except EOFError:
            return
        result, summary, error = None, None, None
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                measured = open_target(target, reading) if isinstance(target, str) else target
                result = fit(measured, **options)
                summary = result.summary()
                if hashed:
                    # Here, while the other processes fit
                    _ = measured.source.sha256
                # Without what the kernel keeps, which cannot be sent
                observations = dataclasses.replace(result.observations)
                result = dataclasses.replace(result, measured=None, observations=observations)  # type: ignore[arg-type]
            except Exception as raised:
                error = raised
        told = [(str(warning.message), warning.category) for warning in caught]
        _send((result, summary, error, told), answers)


def _send(answer: Any, answers: BinaryIO) -> None:
    try:
        data = pickle.dumps(answer)
    except Exception as error:
        # An exception may hold what cannot be sent
        data = pickle.dumps((None, None, RuntimeError(f"{answer[2] or error}"), []))
    answers.write(data)
    answers.flush()


if __name__ == "__main__":
    # An interruption is the business of who started this; what prints must not get between the answers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        _serve(sys.stdin.buffer, out)
