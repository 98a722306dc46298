"""Conversions: what each format carries, what is lost and told, and what cannot be converted."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from by_hand import by_hand
from numpy.testing import assert_allclose, assert_array_equal

import dsbrdf
import dsbrdf.export.rgl
import dsbrdf.measured.reflectance
from dsbrdf import Samples, cli, read, tabulate
from dsbrdf.export.convert import KINDS, convert, write_csv
from dsbrdf.measured import built_in
from dsbrdf.measured.formats.array_file import write_npz
from dsbrdf.measured.formats.nbrdf import PARTS

SCAN = """theta_i_deg,theta_o_deg,phi_o_deg,r,g,b,std
30,45,170,1,2,3,0.5
30,45.001,170,3,4,nan,0.875
10,60,90,4,5,6,1
"""


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text(SCAN)
    return path


@pytest.fixture
def table_file(damaged_table, tmp_path):
    write_npz(damaged_table, tmp_path / "t.npz")
    return tmp_path / "t.npz"


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "matte.json"
    by_hand([0.3, 0.1], [20.0, 0.5], [0.1, 0.0], name="matte").save(path)
    return path


@pytest.mark.parametrize(
    ("names", "columns"),
    [
        (("450nm", "550nm"), ["450nm", "550nm"]),
        (("450", "550"), ["value_450", "value_550"]),
        (("weight", "x"), ["value_weight", "value_x"]),
        (("theta_h", "X"), ["value_theta_h", "value_X"]),
        (("a,b", "x"), ["value_1", "value_2"]),
        (("X", "x"), ["value_1", "value_2"]),
    ],
)
def test_columns_have_the_names_of_channels(names, columns, tmp_path):
    w = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]])
    write_csv(Samples(w, w[::-1], [[1.0, 2.0], [3.0, 4.0]], channels=names), tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text().splitlines()[0].split(",")[3:] == columns
    again = read(tmp_path / "x.csv")
    assert list(again.channels) == [name.removeprefix("value_") for name in columns]
    assert_array_equal(again.values, [[1.0, 2.0], [3.0, 4.0]])


def test_a_model_keeps_the_names_of_its_channels(tmp_path):
    by_hand([0.3], [2.0], [0.0], tint=(1.0, 0.5), channels=("450nm", "550nm")).save(tmp_path / "m.json")
    convert(tmp_path / "m.json", tmp_path / "m.csv")
    with (tmp_path / "m.csv").open() as file:
        assert file.readline() == "theta_i_rad,theta_o_rad,phi_o_rad,450nm,550nm\n"


def test_merl_to_merl_is_exact(merl_file, tmp_path):
    done = convert(merl_file, tmp_path / "copy.binary")
    assert (tmp_path / "copy.binary").read_bytes() == merl_file.read_bytes()
    assert done.rel_rms == 0.0
    # What the made-up file holds below the horizon does not count
    assert done.coverage == pytest.approx(0.75, abs=0.01)


def test_merl_to_npz_and_back_is_exact(merl_file, tmp_path):
    assert convert(merl_file, tmp_path / "t.npz").rel_rms == 0.0
    assert convert(tmp_path / "t.npz", tmp_path / "back.binary").rel_rms == 0.0
    assert_array_equal(read(tmp_path / "back.binary").values, read(merl_file).values)


def test_a_table_to_text(table_file, damaged_table, tmp_path):
    done = convert(table_file, tmp_path / "t.tsv")
    samples = read(tmp_path / "t.tsv", scale=1.0)
    assert isinstance(samples, Samples)
    wi, wo = dsbrdf.half_diff.to_directions(
        damaged_table.theta_h[:, None, None], damaged_table.theta_d[:, None], damaged_table.phi_d
    )
    above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
    known = damaged_table.values[above & damaged_table.valid.any(-1)]
    assert_allclose(samples.values, known, rtol=1e-8)
    # Nine digits of an angle near the pole
    assert done.rel_rms < 1e-5
    assert done.coverage == np.isfinite(known).mean()


def test_a_smaller_table_to_merl_keeps_its_mask(table_file, damaged_table, tmp_path):
    done = convert(table_file, tmp_path / "t.binary")
    result = read(tmp_path / "t.binary")
    assert done.coverage == result.valid.mean() > 0.3
    # The channel that is nowhere valid at one theta_h and the one at one theta_d
    at_h = np.abs(result.theta_h - damaged_table.theta_h[4]).argmin()
    at_d = np.abs(result.theta_d - damaged_table.theta_d[3]).argmin()
    assert not result.valid[at_h, :, :, 1].any()
    assert not result.valid[:, at_d, :, 2].any()
    assert done.rel_rms < 1e-12


@pytest.mark.slow
def test_a_table_to_rgl(tmp_path):
    def matte(wi, _):
        return np.full((*wi.shape[:-1], 3), [0.1, 0.2, 0.3])

    write_npz(tabulate(matte, "matte", shape=(12, 12, 12)), tmp_path / "t.npz")
    done = convert(tmp_path / "t.npz", tmp_path / "t.bsdf")
    assert done.rel_rms < 0.01
    assert read(tmp_path / "t.bsdf").values[30, 30, 30] == pytest.approx([0.1, 0.2, 0.3], rel=1e-3)


def test_samples_without_a_value(tmp_path):
    """BiRD leaves them out; the loss counts the others."""
    (tmp_path / "x.csv").write_text("theta_i_deg,theta_o_deg,value\n10,20,1\n10,-20,nan\n10,-30,3\n")
    assert convert(tmp_path / "x.csv", tmp_path / "x.json", "bird").rel_rms < 1e-12
    assert len(read(tmp_path / "x.json")) == 2


def test_bird_holds_samples(model_file, tmp_path):
    with pytest.raises(
        ValueError, match=r"BiRD JSON holds scattered samples; use \.npz or \.csv for a table"
    ):
        convert(model_file, tmp_path / "x.brdf", "bird")
    assert not (tmp_path / "x.brdf").exists()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "bird"])
def test_a_model_to_every_format(model_file, tmp_path, kind):
    # The suffix may be another
    done = convert(model_file, tmp_path / "x.dat", kind)
    assert done.kind == kind
    assert done.rel_rms < (0.02 if kind == "rgl" else 1e-5)
    if kind == "merl":
        result, model = read(tmp_path / "x.dat"), dsbrdf.load(model_file)
        expected = model.eval_angles(result.theta_h[20], result.theta_d[30], result.phi_d[40])
        assert_allclose(result.values[20, 30, 40], expected, rtol=1e-12)


def test_samples_to_text_and_arrays(scan, tmp_path):
    before = read(scan)
    for name in ("copy.tsv", "copy.npz", "copy.csv"):
        done = convert(scan, tmp_path / name)
        after = read(tmp_path / name)
        assert_allclose(after.values, before.values, rtol=1e-8)
        assert_allclose(after.weights, before.weights)
        assert_allclose((after.wi * after.wo).sum(-1), (before.wi * before.wo).sum(-1), atol=1e-8)
        assert done.rel_rms < 1e-8
        assert done.coverage == 8 / 9


def test_samples_to_merl_are_means_of_cells(scan, tmp_path):
    done = convert(scan, tmp_path / "scan.binary")
    result = read(tmp_path / "scan.binary")
    assert result.valid.sum() == 6
    assert done.coverage == 6 / result.values.size
    # Two samples share a cell: alike in weight, one without blue
    assert_allclose(result.values[result.valid.any(-1)][0], [2.0, 3.0, 3.0])
    expected = np.sqrt((4 * 1.0) / (1 + 4 + 9 + 9 + 16 + 16 + 25 + 36))
    assert done.rel_rms == pytest.approx(expected)


def test_names_of_columns(scan, tmp_path):
    names = ["theta_i_deg", "theta_o_deg", "phi_o_deg", "r", "g", "b", "-"]
    convert(scan, tmp_path / "x.npz", columns=names)
    assert read(tmp_path / "x.npz").weights is None


@pytest.mark.parametrize(
    ("target", "kind", "message"),
    [
        ("x.json", None, "a model file comes of a fit. Use dsbrdf fit."),
        (
            "x.dat",
            None,
            r"no format that can be written; expected .binary (merl), .bsdf (rgl), .npz (npz), .csv",
        ),
        ("x", "json", "no format that can be written; expected .binary (merl)"),
        ("x.bsdf", None, "scattered samples cannot become an RGL file. Fit them, and export the model."),
    ],
)
def test_what_cannot_be_converted_is_told(scan, tmp_path, target, kind, message):
    with pytest.raises(ValueError, match=re.escape(f"{tmp_path / target}: {message}")):
        convert(scan, tmp_path / target, kind)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("suffix", [".binary", ".bsdf"])
def test_formats_of_three_channels(make_table, tmp_path, suffix):
    write_npz(make_table(2), tmp_path / "t.npz")
    text = f"x{suffix}: this format holds three channels, red, green and blue, got 2. Use .npz."
    with pytest.raises(ValueError, match=re.escape(text)):
        convert(tmp_path / "t.npz", tmp_path / f"x{suffix}")


@pytest.mark.parametrize("n", [1, 2, 3])
def test_names_of_channels_in_text(make_table, tmp_path, n):
    write_csv(make_table(n), tmp_path / "x.csv")
    header = (tmp_path / "x.csv").read_text().splitlines()[0]
    names = {1: "value", 2: "value_0,value_1", 3: "r,g,b"}[n]
    assert header == f"theta_i_rad,theta_o_rad,phi_o_rad,{names}"
    assert read(tmp_path / "x.csv", scale=1.0).n_channels == n


def test_all_zero_has_no_relative_error(tmp_path):
    write_npz(tabulate(lambda wi, _: np.zeros((*wi.shape[:-1], 1)), "x", shape=(3, 3, 3)), tmp_path / "t.npz")
    assert np.isnan(convert(tmp_path / "t.npz", tmp_path / "x.csv").rel_rms)


# The command


def run(capsys, *arguments):
    status = cli.main(["convert", *map(str, arguments)])
    out, err = capsys.readouterr()
    return status, out.splitlines(), err.splitlines()


def test_the_command_prints_the_loss(scan, tmp_path, capsys):
    status, out, err = run(capsys, scan, tmp_path / "x.npz")
    assert (status, err) == (0, [])
    assert out == [f"{tmp_path / 'x.npz'}: relative RMS 0, 88.9% of the entries valid"]
    names = "theta_i_deg,theta_o_deg,phi_o_deg,r,g,b,-"
    assert run(capsys, scan, tmp_path / "y", "-t", "csv", "--columns", names)[0] == 0
    assert "weight" not in (tmp_path / "y").read_text()


def test_a_folder_to_a_folder(tmp_path, capsys):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "a.csv").write_text(SCAN)
    (folder / "b.csv").write_text("nothing")
    (folder / "c.csv").write_text(SCAN)
    status, out, err = run(capsys, folder, tmp_path / "out", "-t", "npz")
    assert status == 1
    assert len(out) == 2
    assert err == [
        f"dsbrdf: error: {folder / 'b.csv'}: no samples: expected lines of numbers after a header and comments, or "
        "another format."
    ]
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["a.npz", "c.npz"]
    status, _, err = run(capsys, folder, tmp_path / "out")
    assert status == 2
    assert "a folder needs a format: add -t FORMAT." in err[0]
    (folder / "notes.txt").write_text("Left alone")
    (folder / "figure.png").touch()
    kept = run(capsys, folder, tmp_path / "out", "-t", "npz")[2]
    assert sum("is there already, and dsbrdf did not write it" in line for line in kept) == 2
    assert len(run(capsys, folder, tmp_path / "out", "-t", "npz", "--force")[2]) == 1
    with pytest.raises(ValueError, match="no samples"):
        cli.main(["--debug", "convert", str(folder), str(tmp_path / "out"), "-t", "npz", "--force"])


def test_a_folder_of_networks_or_of_models(model_file, tmp_path, capsys, monkeypatch):
    from dsbrdf.export import convert

    done = []

    def stand_in(source, target, *_, **__):
        done.append((source, target))
        return convert.Conversion(target, "npz", 0.0, 1.0)

    monkeypatch.setattr(convert, "convert", stand_in)
    sets, models, empty = tmp_path / "sets", tmp_path / "models", tmp_path / "empty"
    for folder in (sets, models, empty):
        folder.mkdir()
    (models / "a.json").hardlink_to(model_file)
    (models / ".record.json").touch()
    for part in PARTS:
        (sets / f"one_{part}.npy").touch()
    assert run(capsys, sets, tmp_path / "one.npz")[0] == 0
    assert done.pop() == (sets, tmp_path / "one.npz")
    for part in PARTS:
        (sets / f"two_{part}.npy").touch()
    assert run(capsys, sets, tmp_path, "-t", "npz")[0] == 0
    assert done == [(sets / f"{name}_fc1.npy", tmp_path / f"{name}.npz") for name in ("one", "two")]
    assert run(capsys, models, tmp_path, "-t", "csv")[0] == 0
    assert done[2:] == [(models / "a.json", tmp_path / "a.csv")]
    status, _, err = run(capsys, empty, tmp_path, "-t", "csv")
    assert status == 1
    assert err == [f"dsbrdf: error: {empty}: no measured file and no model file (.json) in this folder."]


@pytest.mark.slow
def test_the_loss_an_rgl_file_counts_from_its_own_values(tmp_path):
    from dsbrdf.measured.formats.rgl import read_rgl
    from dsbrdf.measured.formats.tensor_file import read_tensor_file, write_tensor_file

    def glossy(wi, wo):
        return dsbrdf.measured.reflectance.ggx(wi, wo, 0.4, fresnel=[1.3, 1.5, 1.7])

    dsbrdf.export.rgl.write_rgl(SimpleNamespace(eval=glossy), tmp_path / "a.bsdf")
    fields = dict(read_tensor_file(tmp_path / "a.bsdf"))
    fields["rgb"] = fields["rgb"] * np.random.default_rng(1).uniform(0.5, 1.5, fields["rgb"].shape).astype(
        "f4"
    )
    write_tensor_file(tmp_path / "b.bsdf", fields)
    loss = [convert(tmp_path / f"{name}.bsdf", tmp_path / f"{name}.binary").rel_rms for name in "ab"]
    assert loss[0] < 0.01
    # The two orders of a pair now disagree: on that grid by this much
    table, rgl = read(tmp_path / "b.binary"), read_rgl(tmp_path / "b.bsdf")
    at = dsbrdf.half_diff.to_directions(table.theta_h[:, None, None], table.theta_d[:, None], table.phi_d)
    kept = table.valid.all(-1)
    there = rgl.eval(*(w[kept] for w in at))
    expected = np.sqrt(((table.values[kept] - there) ** 2).sum() / (there**2).sum())
    assert loss[1] == pytest.approx(expected, rel=1e-6)
    assert loss[1] > 0.02


def test_a_file_is_not_written_over_itself(tmp_path, capsys):
    path = tmp_path / "a.npz"
    path.write_bytes(b"as it was")
    status, _, err = run(capsys, path, path)
    assert status == 2
    assert f"{path} is what this is made from, and is not replaced." in err[0]
    assert path.read_bytes() == b"as it was"


def test_a_nearly_empty_table_is_told(scan, tmp_path, capsys):
    status, _, err = run(capsys, scan, tmp_path / "scan.binary")
    assert status == 0
    assert err == [
        f"dsbrdf: warning: {tmp_path / 'scan.binary'} is nearly empty. Fit what was measured, and convert the model."
    ]


def test_a_built_in_material_is_converted(tmp_path, capsys):
    assert run(capsys, "matte", tmp_path / "matte.npz")[0] == 0
    assert_array_equal(read(tmp_path / "matte.npz").values, built_in.material("matte").values)


def test_a_foreign_file_is_kept(scan, tmp_path, capsys):
    target = tmp_path / "x.npz"
    target.write_text("of another program")
    status, _, err = run(capsys, scan, target)
    assert status == 2
    assert "x.npz is there already, and dsbrdf did not write it" in err[0]
    assert target.read_text() == "of another program"
    assert run(capsys, scan, target, "--force")[0] == 0
    assert run(capsys, scan, scan, "--force")[0] == 2
