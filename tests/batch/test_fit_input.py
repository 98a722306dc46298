"""What fits of many files take: folders, text whose columns are named, a space as a prior."""

from pathlib import Path

import numpy as np
import pytest
from spaces import smooth_model

import dsbrdf
from dsbrdf import batch, cli
from dsbrdf.export.convert import write_csv
from dsbrdf.fitting import PriorWarning
from dsbrdf.measured.formats.array_file import write_npz
from dsbrdf.measured.formats.nbrdf import PARTS
from dsbrdf.space import build_space, load_space

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
OPTIONS = {"n_lobes": 1}
SCAN = "".join(
    f"{theta_i},{theta_o},{phi},{0.2 + 0.001 * theta_i}\n"
    for theta_i in (10, 30, 50)
    for theta_o in range(5, 80, 15)
    for phi in (0, 90, 180)
)
COLUMNS = ["theta_i_deg", "theta_o_deg", "phi_o_deg", "value"]


def test_every_measured_file_of_a_folder(tmp_path):
    others = ["a.json", "a.png", "notes.txt", "map.exr", batch.RECORD, *batch.TABLES]
    network = [f"net_{part}.npy" for part in PARTS]
    measured = ["a.BINARY", "b.bsdf", "c.h5", "d.npz", "e.csv", "f.tsv", "g.npy", "lone_b1.npy"]
    for name in [*others, *network, *measured]:
        (tmp_path / name).touch()
    (tmp_path / "folder.csv").mkdir()
    targets, failures = batch.expand([tmp_path])
    assert not failures
    assert [Path(target).name for target in targets] == [*measured, "net_fc1.npy"]


def test_columns_of_text(tmp_path):
    scan = tmp_path / "scan.csv"
    scan.write_text(SCAN)
    out = tmp_path / "out"
    (nameless,) = batch.fit_many([scan], **OPTIONS)
    assert "no header" in nameless.status
    (outcome,) = batch.fit_many([scan], out, reading={"columns": COLUMNS}, **OPTIONS)
    expected = dsbrdf.fit(dsbrdf.read(scan, columns=COLUMNS), **OPTIONS).model
    np.testing.assert_array_equal(outcome.model.lobes.scale, expected.lobes.scale)
    assert batch.fit_many([scan], out, reading={"columns": COLUMNS}, **OPTIONS)[0].kept
    # Other names are another measurement
    swapped = [COLUMNS[1], COLUMNS[0], *COLUMNS[2:]]
    assert not batch.fit_many([scan], out, reading={"columns": swapped}, **OPTIONS)[0].kept


@pytest.mark.filterwarnings("ignore::dsbrdf.fitting.PriorWarning")
def test_a_prior_is_kept_by_what_it_holds(database, tmp_path):
    spaces = [build_space([smooth_model(i) for i in range(n, n + 5)]) for n in (0, 1)]
    spaces[0].save(tmp_path / "space.npz")
    for prior, kept in ((spaces[0], False), (load_space(tmp_path / "space.npz"), True), (spaces[1], False)):
        outcomes = batch.fit_many([database / "a.binary"], tmp_path / "out", plots=True, prior=prior)
        assert [outcome.kept for outcome in outcomes] == [kept], outcomes[0].status


def test_fit_with_a_prior(small_table, tmp_path, capsys):
    space = build_space([smooth_model(i) for i in range(5)])
    space.save(tmp_path / "space.npz")
    folder, out = tmp_path / "measured", tmp_path / "out"
    folder.mkdir()
    write_npz(small_table, folder / "table.npz")
    write_csv(small_table, folder / "scan.csv")
    (folder / "Copyright_Notice.txt").write_text("All rights reserved.")
    arguments = ["fit", str(folder), "-o", str(out), "--prior", str(tmp_path / "space.npz"), "--scale", "1"]
    assert cli.main(arguments) == 0
    # The table is like none of these materials, and reflects more light than it receives, as the models do
    *unlike, bright = capsys.readouterr().err.splitlines()
    assert len(unlike) == 2
    assert all("no material of the prior is like it" in line for line in unlike)
    assert bright.startswith("dsbrdf: warning: reflects more light than it receives: scan (")
    assert ", small (" in bright
    for file in ("table.npz", "scan.csv"):
        measured = dsbrdf.read(folder / file, scale=1.0)
        model = dsbrdf.load(out / f"{measured.name}.json")
        with pytest.warns(PriorWarning, match="like it: the fit misses the data by a factor of"):
            expected = dsbrdf.fit(measured, prior=space).model
        np.testing.assert_allclose(model.lobes.scale, expected.lobes.scale)


def test_fit_of_text_without_a_header(tmp_path, capsys):
    (tmp_path / "scan.csv").write_text(SCAN)
    arguments = ["fit", str(tmp_path / "scan.csv"), "-o", str(tmp_path), "--lobes", "1"]
    assert cli.main(arguments) == 1
    assert "no header" in capsys.readouterr().err
    assert cli.main([*arguments, "--columns", ",".join(COLUMNS)]) == 0
    assert dsbrdf.load(tmp_path / "scan.json").n_channels == 1
