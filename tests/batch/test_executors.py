"""Fits on other executors: processes, Dask, and what happens when a worker or the way to it is lost."""

import dataclasses
import os
import pickle
import signal
import threading
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import loky
import numpy as np
import pytest
from batches import OPTIONS, files_in, run, table

import dsbrdf
from dsbrdf import batch, cli
from dsbrdf.batch import dispatch, jobs
from dsbrdf.measured.formats.array_file import write_npz

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


@pytest.fixture
def folder(tmp_path, make_table):
    """Ten small tables."""
    (tmp_path / "measured").mkdir()
    table = make_table(1, (9, 12, 8))
    for i in range(10):
        write_npz(dataclasses.replace(table, name=f"m{i}"), tmp_path / "measured" / f"m{i}.npz")
    return tmp_path / "measured"


@pytest.fixture(scope="module")
def client():
    """Of a Dask cluster with one worker in this process."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def processes():
    """A function that gives a pool of two processes, as they are when they are asked for."""
    yield lambda: loky.get_reusable_executor(2, timeout=60)
    loky.get_reusable_executor(2).shutdown(kill_workers=True)


class Lossy(ThreadPoolExecutor):
    """An executor that loses some chunks, and may break by it."""

    def __init__(self, lose, error=ConnectionError):
        super().__init__(2)
        self.lose, self.error, self.sent, self.is_broken = lose, error, [], False

    def submit(self, function, chunk, order):
        if self.is_broken:
            raise BrokenExecutor("a process was killed")
        self.sent.append([job.index for job in chunk])
        if not self.lose(chunk):
            return super().submit(function, chunk, order)
        self.is_broken = issubclass(self.error, BrokenExecutor)
        future = Future()
        future.set_exception(self.error("a process was killed"))
        return future


def test_the_same_everywhere(small_table, tmp_path, client, processes):
    database = tmp_path / "database"
    database.mkdir()
    for name in "ab":
        write_npz(dataclasses.replace(small_table, name=name), database / f"{name}.npz")
    here = run(database, tmp_path / "here")
    for name, executor in (("dask", client.get_executor()), ("loky", processes)):
        there = run(database, tmp_path / name, executor=executor)
        for one, other in zip(here, there, strict=True):
            assert (one.status, other.status) == ("ok", "ok")
            assert one.path.read_bytes() == other.path.read_bytes()
            assert {**one.summary, "seconds": 0} == {**other.summary, "seconds": 0}
        assert files_in(tmp_path / name) == files_in(tmp_path / "here")
        assert all(outcome.kept for outcome in run(database, tmp_path / name, executor=executor))
    outcomes = batch.fit_many(
        [database / "a.npz"], tmp_path / "loky", executor=processes, plots=True, **OPTIONS
    )
    assert not outcomes[0].kept
    assert {"a.png", "a-parameters.png"} < set(files_in(tmp_path / "loky"))


def test_what_comes_back_is_small(table_file):
    """20 kB at most for a table of 90 x 90 x 180 cells, whose model has a profile, and nothing of the table."""
    order = jobs.Order(OPTIONS, {}, True, False)
    (answers, _) = jobs.work([jobs.Job(0, str(table_file))], order)
    assert len(pickle.dumps(answers)) <= 20_000
    assert len(pickle.dumps(jobs.Job(0, str(table_file)))) < 500


def test_errors_and_warnings_come_back(tmp_path, processes, capsys):
    (tmp_path / "b.binary").write_text("not a table")
    with pytest.warns(dsbrdf.ConvergenceWarning, match="polished-chrome: the search ended after 1 iter"):
        outcomes = batch.fit_many(
            ["polished-chrome", tmp_path / "b.binary"], executor=processes, n_lobes=3, max_iterations=1
        )
    assert outcomes[0].status == "out of iterations"
    assert "not a MERL file" in outcomes[1].status
    (outcome,) = batch.fit_many(["matte"], executor=processes, n_lobes=0)
    assert isinstance(outcome.error, ValueError)
    assert "'n_lobes' must be 1 to 10 or 'auto', got 0" in outcome.status
    assert capsys.readouterr().out == ""


def test_warnings_of_threads_are_told_apart():
    with pytest.warns(dsbrdf.ConvergenceWarning) as caught:
        batch.fit_many(["rough-gold", "satin-plastic", "polished-chrome"], n_lobes=3, max_iterations=1)
    assert {str(w.message).partition(":")[0] for w in caught} == {
        "rough-gold",
        "satin-plastic",
        "polished-chrome",
    }


def test_an_error_that_cannot_be_sent(monkeypatch):
    class OddError(Exception):
        def __init__(self, first, second):
            super().__init__(f"{first} {second}")

    monkeypatch.setattr(jobs, "open_target", lambda *_: (_ for _ in ()).throw(OddError("very", "odd")))
    (outcome,) = batch.fit_many(["matte"])
    assert "OddError: very odd" in outcome.status


def test_work_is_sent_in_chunks(folder, monkeypatch):
    """Short ones together, as many as make up the time; long ones by themselves."""
    lossless = Lossy(lambda _: False)
    real = jobs.work
    seconds = 0.5
    monkeypatch.setattr(dispatch, "work", lambda chunk, order: (real(chunk, order)[0], seconds))
    run(folder, None, executor=lossless, pending=1)
    assert [len(chunk) for chunk in lossless.sent] == [1, 4, 4, 1]
    seconds, lossless.sent = 3.0, []
    run(folder, None, executor=lossless, pending=1)
    assert [len(chunk) for chunk in lossless.sent] == [1] * 10
    # What is kept takes no time; and no more are sent by themselves than it takes to see how long one takes
    monkeypatch.setattr(dispatch, "PROBES", 2)
    seconds, lossless.sent = 0.0, []
    run(folder, None, executor=lossless, pending=100)
    assert [len(chunk) for chunk in lossless.sent] == [1, 1, 8]


def test_a_worker_hands_back_what_takes_too_long(folder, monkeypatch):
    """A chunk that turned out to be long is not all for one worker."""
    monkeypatch.setattr(jobs, "LONGEST", 0.0)
    monkeypatch.setattr(jobs.time, "perf_counter", iter(range(1000)).__next__)
    chunk = [jobs.Job(i, str(folder / f"m{i}.npz")) for i in range(3)]
    monkeypatch.setattr(jobs, "LONGEST", 1.5)
    monkeypatch.setattr(jobs, "_answer", lambda job, _: jobs.Answer(str(job.index)))
    answers, seconds = jobs.work(chunk, jobs.Order(OPTIONS, {}, False, False))
    assert [answer.name for answer in answers] == ["0"]
    assert seconds == 3.0
    monkeypatch.undo()
    real = jobs.work
    monkeypatch.setattr(dispatch, "work", lambda chunk, order: (real(chunk, order)[0][:1], 0.1))
    lossless = Lossy(lambda _: False)
    assert [outcome.status for outcome in run(folder, None, executor=lossless, pending=1)] == ["ok"] * 10
    assert [len(chunk) for chunk in lossless.sent] == [1, *range(9, 0, -1)]


# What is lost


def test_a_lost_chunk_is_sent_again(folder):
    """Once: nothing is lost. Always: that one has failed, and says why."""
    seen = set()

    def once(chunk):
        first = chunk[0].index in (2, 5) and chunk[0].index not in seen
        seen.add(chunk[0].index)
        return first

    assert [outcome.status for outcome in run(folder, None, executor=Lossy(once))] == ["ok"] * 10
    always = Lossy(lambda chunk: any(job.index == 3 for job in chunk))
    outcomes = run(folder, None, executor=always)
    assert [outcome.error is None for outcome in outcomes] == [i != 3 for i in range(10)]
    assert isinstance(outcomes[3].error, batch.WorkerDiedError)
    assert "the worker of the fit died 2 times (a process was killed). Out of memory?" in outcomes[3].status


def test_a_broken_executor_is_replaced(folder):
    """What kills its worker is found, and harms no other."""
    made = []

    def make():
        made.append(Lossy(lambda chunk: any(job.index == 3 for job in chunk), BrokenExecutor))
        return made[-1]

    outcomes = run(folder, None, executor=make, pending=6)
    assert [outcome.error is None for outcome in outcomes] == [i != 3 for i in range(10)]
    assert isinstance(outcomes[3].error, batch.WorkerDiedError)
    assert len(made) == 4
    # After the first time it was sent by itself
    assert [chunk for executor in made[1:3] for chunk in executor.sent].count([3]) == 2


def test_without_another_executor_the_run_ends(folder, tmp_path):
    """It keeps what was fitted, and a second run does the rest."""
    out = tmp_path / "out"
    broken = Lossy(lambda chunk: any(job.index == 6 for job in chunk), BrokenExecutor)
    with pytest.raises(batch.ExecutorLostError, match=r"takes no more work .* run this again to go on"):
        run(folder, out, executor=broken, pending=1)
    n = len(table(out))
    assert 1 <= n < 10
    outcomes = run(folder, out)
    assert [outcome.status for outcome in outcomes] == ["ok"] * 10
    assert sum(outcome.kept for outcome in outcomes) == n


def kill_a_worker(executor, killed):
    """Kill -9 the first process that is seen."""
    while not killed:
        for pid in list(executor()._processes):
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)
            break


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL on this system")
def test_ten_files_and_a_killed_worker(folder, tmp_path, processes):
    killed = []

    def done(_):
        if not killed:
            kill_a_worker(processes, killed)

    outcomes = run(folder, tmp_path / "out", executor=processes, pending=4, done=done)
    assert killed
    assert [outcome.status for outcome in outcomes] == ["ok"] * 10
    assert len(table(tmp_path / "out")) == 10


def test_a_cluster_that_is_closed(folder, tmp_path):
    """The connection is lost in the middle: what was fitted is kept."""
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    )
    client = distributed.Client(cluster)
    done = []

    def close(outcome):
        done.append(outcome)
        if len(done) == 2:
            client.close()

    with pytest.raises(batch.ExecutorLostError, match="takes no more work"):
        run(folder, tmp_path / "out", executor=client.get_executor(), pending=2, done=close)
    cluster.close()
    outcomes = run(folder, tmp_path / "out")
    assert [outcome.status for outcome in outcomes] == ["ok"] * 10
    assert sum(outcome.kept for outcome in outcomes) >= 2


# From other places, and from the command line


def test_a_file_at_a_url(table_file, tmp_path):
    fsspec = pytest.importorskip("fsspec")
    system = fsspec.filesystem("memory")
    system.pipe("/lab/gold.binary", table_file.read_bytes())
    out = tmp_path / "out"
    (outcome,) = batch.fit_many(["memory://lab/gold.binary"], out, **OPTIONS)
    expected = dsbrdf.fit(dsbrdf.read(table_file), **OPTIONS).model
    np.testing.assert_array_equal(outcome.model.lobes.scale, expected.lobes.scale)
    assert outcome.model.source.to_json()["sha256"] == expected.source.sha256
    assert batch.fit_many(["memory://lab/gold.binary"], out, **OPTIONS)[0].kept
    (missing,) = batch.fit_many(["memory://lab/silver.binary"], out, **OPTIONS)
    assert "memory://lab/silver.binary" in missing.status


@pytest.mark.parametrize("how", ["workers", "scheduler"])
def test_command_line(folder, tmp_path, how, client, capsys):
    options = {"workers": ["--workers", "2"], "scheduler": ["--scheduler", client.scheduler.address]}[how]
    files = [str(folder / f"m{i}.npz") for i in range(3)]
    assert cli.main(["fit", *files, "--lobes", "1", "-o", str(tmp_path / "out"), *options]) == 0
    assert [row["name"] for row in table(tmp_path / "out")] == ["m0", "m1", "m2"]
    capsys.readouterr()
    assert cli.main(["fit", *files, "--workers", "2", "--scheduler", "tcp://nowhere:1"]) == 2
    assert "leave out --workers" in capsys.readouterr().err


def test_any_executor_will_do(folder):
    """One that says nothing of its workers, as that of Dask."""

    class Plain(Executor):
        def submit(self, function, *arguments):
            future = Future()
            future.set_result(function(*arguments))
            return future

    seen = threading.get_ident()
    assert [outcome.status for outcome in run(folder, None, executor=Plain())] == ["ok"] * 10
    assert seen == threading.get_ident()
