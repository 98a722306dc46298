"""Shared fixtures: random numbers, small tables, a file in the layout of MERL, the measured data."""

import dataclasses
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

# Before NumPy: threads that wait for small matrices cost a search seven times its work, on each worker
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings
from reflectances import closed_form

from dsbrdf import material, tabulate, write_merl

# A shell that runs in the background leaves Ctrl-C ignored, here and in all that is started from here
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The first example of a test may have to wait for an import or a file
settings.register_profile("dsbrdf", settings.default, deadline=None)
settings.load_profile("dsbrdf")

SMALL = (12, 18, 20)


@pytest.fixture(autouse=importlib.util.find_spec("matplotlib") is not None)
def nothing_is_cut(monkeypatch):
    """Whatever figure a test writes, all its texts lie in it."""
    from figures import assert_nothing_is_cut
    from matplotlib.figure import Figure

    save = Figure.savefig

    def checked(figure, *arguments, **options):
        save(figure, *arguments, **options)
        is_vector = options.get("format") in ("pdf", "svg")
        assert_nothing_is_cut(figure, drawn_at=None if is_vector else options.get("dpi", figure.dpi))

    monkeypatch.setattr(Figure, "savefig", checked)


@pytest.fixture
def rng():
    return np.random.default_rng(20110101)


@pytest.fixture(scope="session")
def make_table():
    """Call with a number of channels, and a shape: a table of `closed_form`."""

    def make(n_channels=3, shape=SMALL, convention="centre"):
        return tabulate(closed_form(n_channels), "small", shape=shape, convention=convention)

    return make


@pytest.fixture(scope="session")
def small_table(make_table):
    """A table of 12 x 18 x 20 cells and three channels in which only what is below the horizon is invalid."""
    return make_table()


@pytest.fixture(scope="session")
def damaged_table(small_table):
    """`small_table` in other units, with every kind of invalid entry, and with theta_h that have no other."""
    rng = np.random.default_rng(5)
    scale = np.array([0.5, 2.0, 1.0 / 3.0])
    planes = small_table.planes / scale[:, None, None, None]
    for bad in (np.nan, np.inf, -np.inf, -1.0, -1e-300):
        planes[rng.random(planes.shape) < 0.06] = bad
    planes[rng.random(planes.shape) < 0.05] = 0.0
    planes[1, 4, :, :] = np.nan
    planes[2, :, 3, :] = -1.0
    return dataclasses.replace(small_table, planes=planes, scale=scale)


@pytest.fixture(scope="session")
def merl_file(tmp_path_factory):
    """A whole file in the layout of MERL, written without our writer; a quarter of the entries are -1."""
    rng = np.random.default_rng(90)
    stored = rng.exponential(100.0, (3, 90, 90, 180))
    stored[:, rng.random((90, 90, 180)) < 0.25] = -1.0
    stored[0, :2, :2, :2] = -1.0
    stored[:, 10, 10, 10] = 0.0
    path = tmp_path_factory.mktemp("merl") / "made-up.binary"
    with path.open("wb") as file:
        np.array([90, 90, 180], dtype="<i4").tofile(file)
        stored.astype("<f8").tofile(file)
    return path


@pytest.fixture(scope="session")
def table_file(tmp_path_factory):
    """A built-in material as a file in the layout of MERL."""
    path = tmp_path_factory.mktemp("table") / "gold.binary"
    write_merl(material("rough-gold"), path)
    return path


@pytest.fixture
def database(table_file, tmp_path):
    """A folder of three files."""
    folder = tmp_path / "database"
    folder.mkdir()
    for name in ("c", "a", "b"):
        (folder / f"{name}.binary").hardlink_to(table_file)
    return folder


@pytest.fixture(scope="session")
def data():
    """Folder with `data/rgl`, `data/hdri`, `data/nbrdf` and `tools/decode_merl.py`."""
    folder = os.environ.get("DSBRDF_TEST_DATA")
    if not folder:
        pytest.skip("DSBRDF_TEST_DATA names no folder")
    return Path(folder)


@pytest.fixture(scope="session")
def decoded(data, tmp_path_factory):
    """Call with the name of a material: the NBRDF-decoded MERL file of it, made once a session."""
    folder = tmp_path_factory.mktemp("decoded")

    def path(name):
        file = folder / f"{name}.binary"
        if not file.exists():
            command = [sys.executable, str(data / "tools" / "decode_merl.py"), str(folder), name]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        return file

    return path


@pytest.fixture(scope="session")
def browser():
    """The system's Chromium; a second beside it cannot be driven."""
    from browser import chromium

    with chromium() as browser:
        yield browser


@pytest.fixture(scope="session")
def sphere_models():
    """Models that the sphere of the web page shows, by name."""
    from sphere_page import fitted

    return fitted("satin-plastic", "polished-chrome", "rough-gold")


@pytest.fixture
def show_sphere(browser, sphere_models):
    """Call with names of `sphere_models`: a tab with the sphere in it; see `sphere_page.shown`."""
    from sphere_page import shown

    with shown(browser, sphere_models) as call:
        yield call
