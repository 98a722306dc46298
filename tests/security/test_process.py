"""What can happen to a process: no streams, no letters, no home, no room, interruptions; threads, forks and copies."""

import ast
import concurrent.futures
import copy
import dataclasses
import enum
import errno
import importlib
import inspect
import os
import pickle
import pkgutil
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf import _files, baselines, comparison, library, paper
from dsbrdf.baselines import engine
from dsbrdf.batch.texels import TexelMaps
from dsbrdf.export import FORMATS, export, preview, principled
from dsbrdf.export.convert import write_csv
from dsbrdf.fitting.plan import Plan
from dsbrdf.images import Light, fit_image, relight
from dsbrdf.measured.formats.array_file import write_npz
from dsbrdf.measured.formats.bird import write_bird
from dsbrdf.measured.formats.image_file import write_pixels
from dsbrdf.measured.formats.tensor_file import write_tensor_file
from dsbrdf.measured.samples import Samples
from dsbrdf.paper import baselines as paper_baselines
from dsbrdf.space import Sizes, build_space
from dsbrdf.view import view

COMMAND = [sys.executable, "-m", "dsbrdf"]


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "grün 合金.json"
    smooth_model(1, name="grün 合金").save(path)
    return path


def shell(line, *arguments, **environment):
    """A line of the shell, $C is the command, and $1, $2, ... are arguments."""
    environment = {key: value for key, value in (os.environ | environment).items() if value is not None}
    return subprocess.run(
        ["bash", "-c", f'set -o pipefail; C="$0 -m dsbrdf"; {line}', sys.executable, *map(str, arguments)],
        capture_output=True,
        env=environment,
        check=False,
    )


@pytest.mark.parametrize(
    ("line", "status", "message"),
    [
        ("$C info $1 >&-", 0, b""),
        ("$C --version >&- 2>&- <&-", 0, b""),
        ("$C info nothing.json 2>&-", 1, b""),
        ("$C info $1 >/dev/full", 1, b"dsbrdf: error: standard output: No space left on device.\n"),
        ("$C info $1 | true", 1, b""),
        ("LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 PYTHONIOENCODING=ascii $C info $1", 0, b""),
        ("env -u HOME $C data path", 0, b""),
    ],
)
def test_streams_and_surroundings(model_file, line, status, message):
    done = shell(line.replace("$1", '"$1"'), model_file)
    assert (done.returncode, done.stderr) == (status, message)


def test_a_closed_output_is_no_file(tmp_path):
    """What is printed does not end in the file that is opened next."""
    done = shell('cd "$1" && $C fit matte --lobes 1 -o . >&- 2>&- <&-', tmp_path)
    assert done.returncode == 0
    assert dsbrdf.load(tmp_path / "matte.json").n_lobes == 1


@pytest.mark.parametrize("module", ["typer", "numpy", "dsbrdf._core", "dsbrdf.fitting.fit"])
def test_an_interruption_during_imports(module):
    """A line and a status, and no traceback, whatever is being imported."""
    code = f"""
import sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
sys.argv = ["dsbrdf", "fit", "matte", "--lobes", "1"]
from dsbrdf.__main__ import run
sys.exit(run())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "dsbrdf: interrupted\n")


def test_a_signal_while_it_works(tmp_path):
    """The folder is left whole: models and the record of them."""
    code = """
import os, signal, sys, threading
from dsbrdf.batch import jobs
real = jobs.fit
def fit(*a, **k):
    os.kill(os.getpid(), signal.SIGINT)
    return real(*a, **k)
jobs.fit = fit
sys.argv = ["dsbrdf", "fit", "matte", "rough-gold", "--lobes", "1", "-o", sys.argv[1]]
from dsbrdf.__main__ import run
sys.exit(run())
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("*.part"))
    for path in tmp_path.glob("[!.]*.json"):
        dsbrdf.load(path)


# A full disk


def writers():
    """Every writer, by name: a function of a path."""
    model, table = smooth_model(1, name="a"), dsbrdf.material("matte")
    up = np.tile([0.0, 0.0, 1.0], (5000, 1))
    samples = Samples(up, up, np.random.default_rng(1).random((5000, 1)), name="a")
    from dsbrdf.paper import report, survey
    from dsbrdf.paper.subsampling import Curve
    from dsbrdf.paper.tables import Tables as paper_tables
    from dsbrdf.plot import parameter_figure, write_figure

    flat = np.full((2, 2), 0.1, "f4")
    maps = TexelMaps(np.full((2, 2, 22), 0.1, "f4"), flat, flat, 2, Sizes(3, 2, 2, 1, 1), ("r", "g", "b"))
    plan = Plan(*np.ones((3, 50)), np.ones(51), ("r",))
    row = survey.Row(**{field.name: 1 for field in dataclasses.fields(survey.Row)} | {"name": "a"})
    compared = comparison.Comparison([comparison.Row("a", "b", n_parameters=3, cbrt=0.1)])
    curve = Curve("a", 0.0, [1], [0.1], [0.1])
    return {
        "model.json": model.save,
        "library.dsbrdf": lambda path: library.write(path, [model]),
        "space.npz": build_space([smooth_model(i) for i in range(3)]).save,
        "table.npz": lambda path: write_npz(samples, path),
        "bird.json": lambda path: write_bird(samples, path),
        "table.binary": lambda path: dsbrdf.write_merl(table, path),
        "page.html": lambda path: view(model, path),
        "figure.png": lambda path: write_figure(parameter_figure(model), path),
        "picture.exr": lambda path: write_pixels(np.ones((64, 64, 3)), path),
        "code.glsl": lambda path: export(model, path, "glsl"),
        "table.csv": lambda path: write_csv(samples, path),
        "table.bsdf": lambda path: export(model, path, "rgl", force=True),
        "tensors.bsdf": lambda path: write_tensor_file(path, {"a": np.ones(100)}),
        "texels.npz": maps.save,
        "texels.exr": maps.to_exr,
        "plan.csv": plan.save,
        "compare.csv": compared.save,
        "compare.md": lambda path: comparison._write(compared, path.parent),
        "paper.md": lambda path: report.write_table([row], path, "title"),
        "paper.csv": lambda path: survey.write_csv([row], path),
        "report.md": lambda path: report.write_report(
            path, paper_tables("x", ("a",), None), [row], [curve], [], []
        ),
        **{
            f"export.{entry.suffix}": lambda path, kind=kind: export(model, path, kind, force=True)
            for kind, entry in FORMATS.items()
            if kind not in ("rgl", "rgl-spectral", "merl", "glsl")
        },
    }


@pytest.fixture
def full_disk():
    """No file can have more than a few bytes, as on a disk that is full."""
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limit[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    signal.signal(signal.SIGXFSZ, handler)


WRITERS = writers()


#: Functions that write for others, which `test_a_full_disk_in_a_batch` and the tests of downloads reach.
OTHERS = {
    ("__init__", "_finished"),
    ("record", "_compact"),
    ("record", "_write_tables"),
    ("databases", "_extract"),
}


@pytest.fixture(autouse=True)
def nearest(monkeypatch):
    """Exports of the nearest material do not search for it, which is no matter here."""

    def material(_, form, name):
        third = np.full(3, 0.3)
        return engine.EngineMaterial(third, third, third, 0.5, 0.5, 0.04, 0.5, False, form, name)

    monkeypatch.setattr(preview, "fit_engine", material)
    near = preview.Nearness(0.1, 1.0)
    monkeypatch.setattr(preview, "nearness", lambda *_: near)
    monkeypatch.setattr(principled, "fit_principled", lambda _: ({"type": "principled" + 100 * " "}, near))


def test_every_writer_is_among_them(tmp_path, monkeypatch):
    """Every function of the package that writes a file aside; a new one needs an entry above."""
    used, real = set(), _files.aside

    def noting(path):
        code = sys._getframe(1).f_code
        used.add((Path(code.co_filename).stem, code.co_name))
        return real(path)

    monkeypatch.setattr(_files, "aside", noting)
    for name, write in WRITERS.items():
        write(tmp_path / name)
    there = set()
    for file in Path(dsbrdf.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and "_files.aside(" in ast.unparse(node):
                there.add((file.stem, node.name))
    assert used | OTHERS == there


def test_a_full_disk_in_a_batch(tmp_path, small_table, full_disk):  # noqa: ARG001
    with pytest.raises(OSError, match=r"too large|No space"):
        dsbrdf.fit_many([small_table], tmp_path, n_lobes=1)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk(tmp_path, full_disk, name):  # noqa: ARG001
    """The error names the file; nothing is left, and what was there before stays."""
    path = tmp_path / name
    path.write_text("dsbrdf: earlier")
    with pytest.raises(OSError, match=r"too large|No space|requested") as caught:
        WRITERS[name](path)
    assert caught.value.filename == str(path)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [(name, "dsbrdf: earlier")]


@pytest.mark.parametrize("name", WRITERS)
def test_a_folder_that_is_none(tmp_path, name):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        WRITERS[name](tmp_path / "file" / name)


def test_aside_leaves_nothing(tmp_path):
    def write(path, error):
        with _files.aside(path) as part:
            part.write_text("half")
            raise error

    with pytest.raises(RuntimeError):
        write(tmp_path / "x", RuntimeError())
    with pytest.raises(OSError, match="No space") as caught:
        write(tmp_path / "x", OSError(errno.ENOSPC, "No space left on device"))
    assert caught.value.filename == str(tmp_path / "x")
    assert not list(tmp_path.iterdir())


# A package folder that cannot be written


def test_a_package_that_is_read_only():
    """Nothing is written beside the code: no cache, no state."""
    package = Path(dsbrdf.__file__).parent
    code = f"""
import sys, os
def refuse(event, arguments):
    if event == "open" and isinstance(arguments[0], str) and arguments[0].startswith({str(package)!r}):
        if arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            raise PermissionError(arguments[0])
sys.dont_write_bytecode = True
sys.addaudithook(refuse)
from dsbrdf.cli import main
sys.exit(main(["fit", "matte", "--lobes", "1"]) or main(["space", "nearest", "--help"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# Threads, processes and copies


def numbers(table):
    return dsbrdf.fit(table, 2).model.lobes.parts


PROCESSES = """
import multiprocessing, sys
import dsbrdf
from dsbrdf.measured import built_in
from dsbrdf.measured.table import tabulate

def numbers(table):
    return [part.tolist() for part in dsbrdf.fit(table, 2).model.lobes.parts]

def answer(table, queue):
    queue.put(numbers(table))

if __name__ == "__main__":
    table = tabulate(built_in.get("rough-gold").reflectance, "gold", shape=(9, 8, 12))
    expected = numbers(table)
    context = multiprocessing.get_context(sys.argv[1])
    queue = context.Queue()
    process = context.Process(target=answer, args=(table, queue))
    process.start()
    assert queue.get(timeout=60) == expected
    process.join(60)
    assert process.exitcode == 0
"""


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_after_use(tmp_path, method):
    """The kernel's threads do not come along in a fork; it works nevertheless."""
    script = tmp_path / "processes.py"
    script.write_text(PROCESSES)
    done = subprocess.run(
        [sys.executable, script, method], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr


def test_eight_threads(make_table):
    """Each gives what it gives alone, to the last bit."""
    tables = [make_table(n) for n in (1, 2, 3, 4)]
    alone = [numbers(table) for table in tables]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        together = list(pool.map(numbers, tables * 2))
    for expected, found in zip(alone * 2, together, strict=True):
        for a, b in zip(expected, found, strict=True):
            np.testing.assert_array_equal(a, b)


def public_classes():
    """All classes that packages name as theirs."""
    packages = [m.name for m in pkgutil.walk_packages(dsbrdf.__path__, "dsbrdf.") if m.ispkg]
    modules = [importlib.import_module(name) for name in ("dsbrdf", *packages)]
    return {
        thing
        for module in modules
        for name in getattr(module, "__all__", ())
        if inspect.isclass(thing := getattr(module, name)) and thing.__module__.startswith("dsbrdf")
    }


def kinds_in(thing, seen):
    """The classes of an object, and of what it holds."""
    if id(thing) in seen:
        return set()
    seen[id(thing)] = thing
    parts = (
        list(vars(thing).values())
        if type(thing).__module__.startswith("dsbrdf") and hasattr(thing, "__dict__")
        else []
    )
    parts += (
        list(thing.values())
        if isinstance(thing, dict)
        else list(thing)
        if isinstance(thing, list | tuple)
        else []
    )
    return {type(thing)}.union(*(kinds_in(part, seen) for part in parts))


def same(a, b):
    """Whether two objects are of one kind and hold the same, to the last bit."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict):
        return list(a) == list(b) and all(map(same, a.values(), b.values()))
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if type(a).__module__.startswith("dsbrdf") and hasattr(a, "__dict__") and not isinstance(a, enum.Enum):
        return same(dict(vars(a)), dict(vars(b)))
    # What the kernel holds has no comparison
    return type(a).__eq__ is object.__eq__ or bool(a == b) or a != a


def objects(small_table):
    """One of every public kind of object."""
    fit = dsbrdf.fit(small_table, 1)
    flat = np.full((2, 2), 0.1, "f4")
    lamp = Light.distant([0.0, 0.6, 0.8])
    compared = comparison.Comparison([comparison.Row("a", "b", n_parameters=3, cbrt=0.1)])
    judge = comparison.Judge(small_table)
    slices = paper.fit_slices(small_table, method="em", n_slices=6)
    space = build_space([smooth_model(i) for i in range(3)])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    return {
        "table": small_table,
        "samples": Samples(up, up, np.ones((3, 1)), name="a"),
        "model": fit.model,
        "lobes": fit.model.lobes,
        "fit": fit,
        "errors": fit.errors,
        "coverage": fit.coverage,
        "check": dsbrdf.check_model(smooth_model(1)),
        "options": dsbrdf.FitOptions(),
        "space": [space, space.fpca],
        "prior": space.gaussian(),
        "library": library.builtin(),
        "outcome": dsbrdf.batch.Outcome("a"),
        "texels": TexelMaps(
            np.full((2, 2, 22), 0.1, "f4"), flat, flat, 2, Sizes(3, 2, 2, 1, 1), ("r", "g", "b")
        ),
        "picture": fit_image(relight(smooth_model(1), "sphere", lamp, size=12), "sphere", lamp, prior=space),
        "slices": [slices, slices.model.to_curves(), paper.slice_profiles(small_table, n_slices=2)],
        "baselines": [
            baselines.fit_bivariate(small_table),
            baselines.fit_lambert_ggx(small_table),
            baselines.fit_ggx_pair(small_table),
            baselines.fit_fresnel_ggx(small_table),
            paper_baselines.fit_interpolation(small_table),
            paper_baselines.fit_lambert_torrance_sparrow(small_table),
            paper_baselines.fit_von_mises_fisher(small_table, 2),
        ],
        "format": FORMATS["glsl"],
        "comparison": [
            compared,
            compared.standings,
            comparison.METHODS["ggx"],
            comparison.Folder("a", Path("b")),
        ],
        "judge": [judge, judge.merit(fit.model)],
    }


def test_copies(small_table):
    """pickle and deepcopy of every public kind of object give one of the same kind and content, to the last bit."""
    kinds = set()
    for name, thing in objects(small_table).items():
        kinds |= kinds_in(thing, {})
        copies = pickle.loads(pickle.dumps(thing)), copy.deepcopy(thing)
        assert all(same(thing, again) for again in copies), name
        assert len({re.sub(r" at 0x\w+", "", repr(one)) for one in (thing, *copies)}) == 1, name
        if name == "fit":
            # The kernel's part of it too
            wi = np.array([0.0, 0.6, 0.8])
            bands = [np.array(one.band(wi, wi)).tolist() for one in (thing, *copies)]
            assert bands[0] == bands[1] == bands[2]
    wanted = {kind for kind in public_classes() if not issubclass(kind, BaseException | dict)}
    assert {kind for kind in wanted if not inspect.isabstract(kind)} - kinds == set()


@pytest.mark.parametrize(
    "error",
    sorted(
        (kind for kind in public_classes() if issubclass(kind, BaseException)),
        key=str,
    ),
)
def test_errors_travel(error):
    assert str(pickle.loads(pickle.dumps(error("x")))) == "x"
