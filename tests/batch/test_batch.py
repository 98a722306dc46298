"""Many files: what is written, what is kept, and what happens when something fails."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from batches import OPTIONS, files_in, run, table

import dsbrdf
from dsbrdf import batch, cli
from dsbrdf.batch import dispatch, jobs, record

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


@pytest.fixture
def fitted(monkeypatch):
    """Names that are fitted, as they are."""
    names, real = [], jobs.fit

    def count(measured, **options):
        names.append(measured.name)
        return real(measured, **options)

    monkeypatch.setattr(jobs, "fit", count)
    return names


def test_models_and_tables(database, tmp_path):
    out = tmp_path / "out"
    told = []
    outcomes = run(database, out, done=told.append)
    assert [Path(outcome.target).name for outcome in outcomes] == ["a.binary", "b.binary", "c.binary"]
    assert told == outcomes
    assert files_in(out) == sorted(["a.json", "b.json", "c.json", batch.RECORD, *batch.TABLES])
    rows = table(out)
    assert [row["name"] for row in rows] == ["a", "b", "c"]
    expected = dsbrdf.fit(dsbrdf.read(database / "a.binary"), **OPTIONS)
    for outcome, row in zip(outcomes, rows, strict=True):
        assert not outcome.kept
        assert outcome.error is None
        np.testing.assert_array_equal(dsbrdf.load(outcome.path).lobes.scale, expected.model.lobes.scale)
        for key in ("rel", "cbrt", "log", "albedo", "bivariate_floor", "azimuthal_floor"):
            assert float(row[key]) == outcome.summary[key] == expected.summary()[key]
        assert (row["n_lobes"], row["n_parameters"], row["status"]) == ("1", "18", outcome.status)
    lines = (out / "fits.md").read_text().splitlines()
    assert "n_lobes 1" in lines[0]
    assert lines[4].startswith(f"| a | 1 | 18 | {expected.errors.rel:.3f} | ")


def test_nothing_is_written_without_a_folder(database, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcomes = run(database, None)
    assert [outcome.path for outcome in outcomes] == [None] * 3
    assert files_in(tmp_path) == ["database"]


def test_the_number_of_lobes_is_explained(table_file):
    (outcome,) = batch.fit_many([table_file])
    assert np.argmin(outcome.summary["criteria"]) + 1 == outcome.summary["n_lobes"]
    (outcome,) = batch.fit_many([table_file], **OPTIONS)
    assert "criteria" not in outcome.summary


# Again


def test_a_second_run_keeps_what_is_there(database, tmp_path, fitted):
    out = tmp_path / "out"
    first = run(database, out)
    tables = [(out / name).read_bytes() for name in batch.TABLES]
    times = [outcome.path.stat().st_mtime_ns for outcome in first]
    fitted.clear()
    second = run(database, out)
    assert fitted == []
    assert all(outcome.kept for outcome in second)
    assert [outcome.summary for outcome in second] == [outcome.summary for outcome in first]
    assert [outcome.path.stat().st_mtime_ns for outcome in second] == times
    assert [(out / name).read_bytes() for name in batch.TABLES] == tables


def test_force(database, tmp_path, fitted):
    run(database, tmp_path / "out")
    fitted.clear()
    assert not any(outcome.kept for outcome in run(database, tmp_path / "out", force=True))
    assert sorted(fitted) == ["a", "b", "c"]


def test_other_options_fit_again(database, tmp_path, fitted):
    run(database, tmp_path / "out")
    fitted.clear()
    run(database, tmp_path / "out", loss="gamma")
    assert sorted(fitted) == ["a", "b", "c"]


def test_another_version_fits_again(database, tmp_path, fitted, monkeypatch):
    run(database, tmp_path / "out")
    fitted.clear()
    monkeypatch.setattr(dsbrdf, "__version__", "99.0")
    run(database, tmp_path / "out")
    assert sorted(fitted) == ["a", "b", "c"]


@pytest.mark.parametrize("damage", ["edit", "remove", "other"])
def test_a_model_that_was_changed_is_fitted_again(database, tmp_path, fitted, damage):
    out = tmp_path / "out"
    run(database, out)
    fitted.clear()
    if damage == "edit":
        (out / "b.json").write_text((out / "b.json").read_text().replace('"b"', '"B"'))
    elif damage == "remove":
        (out / "b.json").unlink()
    else:
        # A single fit with other options into the same folder
        assert cli.main(["fit", str(database / "b.binary"), "-o", str(out), "--lobes", "2"]) == 0
        fitted.clear()
    run(database, out)
    assert fitted == ["b"]
    assert dsbrdf.load(out / "b.json").n_lobes == 1


def test_a_measurement_that_was_changed_is_fitted_again(database, table_file, tmp_path, fitted):
    out = tmp_path / "out"
    run(database, out)
    measured = dsbrdf.read(table_file)
    (database / "b.binary").unlink()
    dsbrdf.write_merl(dataclasses.replace(measured, planes=2.0 * measured.planes), database / "b.binary")
    fitted.clear()
    run(database, out)
    assert fitted == ["b"]


def test_a_copy_is_the_same_measurement(database, table_file, tmp_path, fitted):
    out = tmp_path / "out"
    run(database, out)
    (database / "b.binary").unlink()
    shutil.copyfile(table_file, database / "b.binary")
    os.utime(database / "b.binary", (1, 1))
    fitted.clear()
    run(database, out)
    assert fitted == []
    # The new time is noted: the next run need not hash
    entries = [json.loads(line) for line in (out / batch.RECORD).read_text().splitlines()]
    assert [entry["source"]["stamp"] for entry in entries if entry.get("name") == "b"] == [10**9]


def test_built_in_materials_are_fitted_again(tmp_path, fitted):
    for _ in range(2):
        batch.fit_many(["matte"], tmp_path, **OPTIONS)
    assert fitted == ["matte", "matte"]


@pytest.mark.parametrize(
    "text", ["", "[]", '{"format": "dsbrdf batch"}', '{"name": "a"}', "\0" * 9, "[", "\udcff"]
)
def test_a_broken_record_is_none(database, tmp_path, fitted, text):
    out = tmp_path / "out"
    run(database, out)
    (out / batch.RECORD).write_bytes(text.encode("utf-8", "surrogateescape"))
    fitted.clear()
    run(database, out)
    assert sorted(fitted) == ["a", "b", "c"]


def test_a_broken_entry_is_none(database, tmp_path, fitted):
    out = tmp_path / "out"
    run(database, out)
    head, *entries = (out / batch.RECORD).read_text().splitlines()
    entries = {json.loads(entry)["name"]: entry for entry in entries}
    a = json.loads(entries["a"])
    del a["summary"]["rel"]
    # The last line is cut off, as by a full disk
    (out / batch.RECORD).write_text("\n".join([head, json.dumps(a), entries["c"], entries["b"][:-20]]))
    fitted.clear()
    run(database, out)
    assert sorted(fitted) == ["a", "b"]


def test_the_table_has_earlier_files_too(database, tmp_path):
    out = tmp_path / "out"
    run(database, out)
    batch.fit_many([database / "b.binary"], out, **OPTIONS, force=True)
    assert [row["name"] for row in table(out)] == ["a", "b", "c"]
    # but not those of other options
    batch.fit_many([database / "b.binary"], out, n_lobes=2)
    assert [(row["name"], row["n_lobes"]) for row in table(out)] == [("b", "2")]


def test_figures_are_made_up_for(database, tmp_path, fitted):
    out = tmp_path / "out"
    targets = [database / "a.binary"]
    batch.fit_many(targets, out, **OPTIONS)
    batch.fit_many(targets, out, plots=True, **OPTIONS)
    batch.fit_many(targets, out, plots=True, **OPTIONS)
    assert fitted == ["a", "a"]
    assert {"a.png", "a-parameters.png"} < set(files_in(out))


# What fails


def test_goes_on_after_a_bad_file(database, tmp_path, capsys):
    (database / "b.binary").unlink()
    (database / "b.binary").write_text("not a | table")
    out = tmp_path / "out"
    for kept in (0, 2):
        assert cli.main(["fit", str(database), "-o", str(out), "--lobes", "1"]) == 1
        told = capsys.readouterr()
        assert f"{kept} of 2 kept" in told.out or not kept
        errors = [line for line in told.err.splitlines() if line.startswith("dsbrdf: error: ")]
        assert len(errors) == 1
        assert f"{database / 'b.binary'}: not a MERL file" in errors[0]
        rows = table(out)
        assert [row["name"] for row in rows] == ["a", "b", "c"]
        assert rows[1]["status"].startswith("failed: ")
        assert rows[1]["rel"] == rows[1]["n_lobes"] == ""


def test_a_failure_of_ours_does_not_stop_it_either(database, tmp_path, monkeypatch):
    real = jobs.fit

    def stand_in(measured, **options):
        if measured.name == "a":
            raise ZeroDivisionError("division by zero")
        return real(measured, **options)

    monkeypatch.setattr(jobs, "fit", stand_in)
    outcomes = run(database, tmp_path / "out")
    assert isinstance(outcomes[0].error, ZeroDivisionError)
    assert [outcome.error is None for outcome in outcomes] == [False, True, True]
    with pytest.raises(ZeroDivisionError):
        run(database, tmp_path / "out", strict=True)


def test_interruption_leaves_a_sound_state(database, tmp_path, monkeypatch, fitted):
    """What was finished is kept, also what was finished after the interruption."""
    out = tmp_path / "out"
    real = jobs.fit
    begun = threading.Event()

    def stand_in(measured, **options):
        if measured.name == "b":
            assert begun.wait(20)
            raise KeyboardInterrupt
        if measured.name == "a":
            begun.set()
            time.sleep(0.1)
        return real(measured, **options)

    with monkeypatch.context() as patch:
        patch.setattr(jobs, "fit", stand_in)
        with pytest.raises(KeyboardInterrupt):
            run(database, out)
    names = {row["name"] for row in table(out)}
    assert {"a"} <= names <= {"a", "c"}
    assert files_in(out) == sorted([*(f"{name}.json" for name in names), batch.RECORD, *batch.TABLES])
    fitted.clear()
    assert [outcome.kept for outcome in run(database, out)] == [True, False, "c" in names]
    assert sorted(fitted) == sorted({"b", "c"} - names)


def test_killed_between_model_and_record(database, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(database, out)
    monkeypatch.setattr(record.Book, "add", lambda *_: (_ for _ in ()).throw(OSError(28, "full", "record")))
    with pytest.raises(OSError, match="full"):
        run(database, out, loss="gamma")
    monkeypatch.undo()
    # The record is that of the first run, one model is not
    assert sorted(outcome.kept for outcome in run(database, out)) == [False, True, True]
    assert not [name for name in files_in(out) if name.endswith(".part")]


KILLED = """
import os, sys
from dsbrdf import batch

def done(outcome):
    os._exit(9)

batch.fit_many(sys.argv[1], sys.argv[2], n_lobes=1, done=done)
"""


def test_a_run_that_was_killed_is_gone_on_with(database, tmp_path, fitted):
    """Nothing that was written is lost, and no lock is left."""
    out = tmp_path / "out"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-W", "ignore", "-c", KILLED, str(database), str(out)]
    assert subprocess.run(command, env=environment, check=False, timeout=120).returncode == 9
    assert record.LOCK in files_in(out)
    there = {name for name in files_in(out) if name.endswith(".json")}
    assert "a.json" in there
    outcomes = run(database, out)
    assert [outcome.kept for outcome in outcomes] == [f"{name}.json" in there for name in "abc"]
    assert len(fitted) == 3 - len(there)
    assert record.LOCK not in files_in(out)


def test_two_runs_in_a_folder(database, tmp_path):
    """The second is refused, and says by whom; the first is not disturbed."""
    out = tmp_path / "out"
    refused = []

    def second(_):
        with pytest.raises(batch.BusyError, match=f"process {os.getpid()} on .* is writing to") as error:
            run(database, out)
        refused.append(batch.describe(error.value))

    outcomes = run(database, out, done=second)
    assert [outcome.status for outcome in outcomes] == ["ok"] * 3
    assert len(refused) == 3
    assert "Wait for it, or give another folder." in refused[0]
    assert all(outcome.kept for outcome in run(database, out))


def test_a_folder_that_holds_nothing(tmp_path, database):
    (tmp_path / "empty").mkdir()
    targets, failures = batch.expand([tmp_path / "empty", database / "a.binary"])
    assert targets == [str(database / "a.binary")]
    assert [failure.status for failure in failures] == [
        f"{tmp_path / 'empty'}: no measured file ({', '.join(batch.SUFFIXES)}) in this folder."
    ]
    with pytest.raises(ValueError, match=r"no measured file \(\.binary, .*\) in this folder"):
        batch.expand([tmp_path / "empty"], strict=True)


def test_memory_is_bounded(monkeypatch):
    """However many files, a thread holds no more than the one that it works on."""
    alive, most = [], []
    lock = threading.Lock()
    table = dsbrdf.tabulate(lambda wi, wo: 0.3 + 0.0 * (wi + wo)[..., :1], "grey", shape=(9, 6, 8))

    def stand_in(target, _):
        opened = dataclasses.replace(table, name=target)
        with lock:
            alive.append(target)
            most.append(len(alive))
        weakref.finalize(opened, alive.remove, target)
        return opened

    monkeypatch.setattr(jobs, "open_target", stand_in)
    names, finished = [f"m{i}" for i in range(20)], []
    outcomes = batch.fit_many(names, done=lambda outcome: finished.append(outcome.target), **OPTIONS)
    assert finished == [outcome.target for outcome in outcomes] == names
    assert max(most) <= 2 * dispatch.THREADS


def test_two_at_a_time(monkeypatch):
    """The second is begun while the first is being fitted."""
    both = threading.Barrier(2, timeout=20)
    table = dsbrdf.tabulate(lambda wi, wo: 0.3 + 0.0 * (wi + wo)[..., :1], "grey", shape=(9, 6, 8))

    def stand_in(target, _):
        both.wait()
        return dataclasses.replace(table, name=target)

    monkeypatch.setattr(jobs, "open_target", stand_in)
    assert all(outcome.error is None for outcome in batch.fit_many(["a", "b"], **OPTIONS))


def test_the_same_as_one_by_one(small_table, monkeypatch):
    monkeypatch.setattr(jobs, "open_target", lambda target, _: dataclasses.replace(small_table, name=target))
    expected = dsbrdf.fit(small_table, **OPTIONS).errors.rel
    outcomes = batch.fit_many([f"m{i}" for i in range(6)], **OPTIONS)
    assert [outcome.summary["rel"] for outcome in outcomes] == [expected] * 6


# As a library


def test_a_folder_and_what_comes_of_it(database):
    outcomes = dsbrdf.fit_many(database, **OPTIONS)
    assert [Path(outcome.target).name for outcome in outcomes] == ["a.binary", "b.binary", "c.binary"]
    expected = dsbrdf.fit(dsbrdf.read(database / "a.binary"), **OPTIONS).model
    for outcome in outcomes:
        assert isinstance(outcome, dsbrdf.Outcome)
        np.testing.assert_array_equal(outcome.model.lobes.scale, expected.lobes.scale)
    (database / "empty").mkdir()
    with pytest.raises(ValueError, match=r"no measured file \(\.binary, .*\) in this folder"):
        dsbrdf.fit_many(database / "empty")


def test_measurements_one_by_one(small_table, tmp_path):
    """Of an iterable that makes them: no more are there than are worked on, and results come as they are done."""
    alive, done, most = weakref.WeakSet(), [], []

    def measurements():
        for i in range(12):
            made = dataclasses.replace(small_table, name=f"m{i}")
            alive.add(made)
            most.append(len(alive))
            yield made
            del made

    outcomes = dsbrdf.fit_many(measurements(), tmp_path, done=done.append, **OPTIONS)
    assert done == outcomes
    assert [outcome.target for outcome in outcomes] == [f"m{i}" for i in range(12)]
    assert max(most) <= dispatch.THREADS + dispatch.AHEAD + 1
    assert len(list(tmp_path.glob("*.json"))) == 12


def test_scattered_samples(tmp_path, rng):
    w = np.abs(rng.normal(size=(2, 80, 3)))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    scan = dsbrdf.Samples(*w, 0.2 + 0.1 * w[0, :, 2:], name="scan")
    (outcome,) = dsbrdf.fit_many([scan], tmp_path, plots=False)
    assert outcome.error is None
    assert dsbrdf.load(outcome.path).name == "scan"
    assert outcome.summary["channels"] == ["value"]
