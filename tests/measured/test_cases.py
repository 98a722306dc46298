"""Files as they come from laboratories, one kind of fault each: read right, or refused with the cause."""

import io
import re
import struct
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import dsbrdf
from dsbrdf import cli, read
from dsbrdf.measured.samples import ReadWarning

HEADER = "theta_i_deg,theta_o_deg,phi_o_deg"


def lobe(theta_i, theta_o):
    """A peak of 1.5 and 12 degrees about the mirror direction, both angles signed, in degrees."""
    return 0.05 + 1.5 * np.exp(-((0.5 * (theta_i + theta_o) / 12.0) ** 2))


def scan(theta_i=(10, 30, 50), theta_o=range(-60, 61, 5)):
    """Lines of angles and value."""
    return [(i, o, lobe(i, o)) for i in theta_i for o in theta_o]


@pytest.fixture
def write(tmp_path):
    def to_file(text, name="scan.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return path

    return to_file


# A column that is no reflectance


@pytest.mark.parametrize(
    "name", ["wavelength", "wavelength_nm", "lambda", "wl", "nm", "Wavelength [nm]", "λ (nm)"]
)
@pytest.mark.parametrize("given", [False, True])
def test_wavelengths_in_a_column_are_channels(write, name, given):
    offset = {620: 0.0, 540: 0.05, 460: 0.15}
    lines = [f"{i},{o},0,{nm},{v + more:.6g}" for nm, more in offset.items() for i, o, v in scan()]
    columns = [*HEADER.split(","), name, "brdf"]
    header = [] if given else [",".join(columns)]
    samples = read(write("\n".join([*header, *lines])), columns=columns if given else None)
    assert tuple(samples.channels) == ("460nm", "540nm", "620nm")
    assert len(samples) == 75
    assert_allclose(samples.values[:, 0] - samples.values[:, 2], 0.15, atol=1e-5)
    assert_allclose(samples.values.max(), 1.7, atol=1e-5)


def test_a_pair_measured_twice_at_one_wavelength_is_two_samples(write):
    text = f"{HEADER},wl,brdf,std\n30,0,0,500,1,.1\n30,0,0,600,2,.1\n30,0,0,500,3,.1\n30,10,0,600,4,.2\n"
    samples = read(write(text))
    assert_array_equal(samples.values, [[1, 2], [3, np.nan], [np.nan, 4]])
    assert_allclose(samples.wo[:, 0], np.sin(np.deg2rad([0, 0, 10])))
    assert len(samples.weights) == 3


@pytest.mark.parametrize("name", ["", "Unnamed: 0", "index"])
def test_a_column_that_counts_lines_is_left_out(write, name):
    lines = [f"{k},{i},{o},0,{v},{v + 0.05},{v + 0.15}" for k, (i, o, v) in enumerate(scan())]
    samples = read(write("\n".join([f"{name},{HEADER},r,g,b", *lines])))
    assert tuple(samples.channels) == ("r", "g", "b")
    assert_allclose(samples.values[:, 0], [v for *_, v in scan()])
    assert any("counts the lines, and is left out" in remark for remark in samples.remarks)


@pytest.mark.parametrize(
    "name", ["", "temperature", "id", "T_sample", "dark", "polarisation", "counter", "intensity", "foo"]
)
def test_a_column_of_another_meaning_is_refused_by_name(write, name):
    text = f"{HEADER},{name},brdf\n10,20,180,5,0.1\n10,30,180,5,0.2\n"
    shown = f"column {name or 'without a name'} .*--ignore {name}.*--columns"
    with pytest.raises(ValueError, match=shown):
        read(write(text))
    if name:
        assert tuple(read(write(text), ignore=[name]).channels) == ("brdf",)
    columns = [*HEADER.split(","), "-", "brdf"]
    assert_array_equal(read(write(text), columns=columns).values, [[0.1], [0.2]])


@pytest.mark.parametrize(
    "name", ["u_brdf", "sigma", "uncertainty", "err", "stdev", "sd", "std", "u", "brdf_err", "σ"]
)
def test_an_uncertainty_is_a_weight(write, name):
    lines = [f"{i},{o},0,{v:.6g},{0.02 * v:.3g}" for i, o, v in scan()]
    samples = read(write("\n".join([f"{HEADER},brdf,{name}", *lines])))
    assert tuple(samples.channels) == ("brdf",)
    assert_allclose(samples.weights, 0.5, rtol=0.03)


def test_uncertainties_of_single_channels_and_in_percent(write):
    text = f"{HEADER},r,g,b,std_r,std_g,std_b\n10,20,180,1,2,3,.1,.1,.1\n"
    by_channel = read(write(text)).weights
    assert_allclose(by_channel, read(write(f"{HEADER},r,g,b,std\n10,20,180,1,2,3,.1\n")).weights)
    percent = read(write(f"{HEADER},r,g,b,u [%]\n10,20,180,1,2,3,5\n")).weights
    assert_allclose(by_channel, percent)
    with pytest.raises(ValueError, match="column std_g is the uncertainty of g, which is not there"):
        read(write(f"{HEADER},r,std_g\n10,20,180,1,2\n"))


def test_a_sample_without_a_value_needs_no_uncertainty(write):
    samples = read(
        write(f"{HEADER},brdf,u_brdf\n10,20,180,0.1,0.01\n10,30,180,NA,NA\n10,40,180,-0.001,0.01\n")
    )
    # What is negative counts, since its uncertainty is known
    assert_array_equal(samples.values, [[0.1], [np.nan], [-0.001]])
    assert np.isfinite(samples.weights).all()
    with pytest.raises(ValueError, match="'u_brdf' must be > 0 and finite, got nan in line 3"):
        read(write(f"{HEADER},brdf,u_brdf\n10,20,180,0.1,0.01\n10,30,180,0.1,NA\n"))


# Names of channels


@pytest.mark.parametrize(
    ("header", "values"),
    [
        ("b,g,r", [0.8, 0.5, 0.2]),
        ("blue,green,red", [0.8, 0.5, 0.2]),
        ("G,R,B", [0.5, 0.2, 0.8]),
        ("brdf_b,brdf_g,brdf_r", [0.8, 0.5, 0.2]),
        ("f_b,f_g,f_r", [0.8, 0.5, 0.2]),
    ],
)
def test_red_green_and_blue_in_any_order(write, tmp_path, header, values):
    path = write(f"{header},{HEADER}\n{','.join(map(str, values))},30,30,180\n")
    samples = read(path)
    assert tuple(samples.channels) == ("r", "g", "b")
    assert_array_equal(samples.values, [[0.2, 0.5, 0.8]])
    assert cli.main(["convert", str(path), str(tmp_path / "x.tsv")]) == 0
    names, line = (tmp_path / "x.tsv").read_text().splitlines()
    assert (
        dict(zip(names.split("\t"), line.split("\t"), strict=True)).items()
        >= {"r": "0.2", "g": "0.5", "b": "0.8"}.items()
    )


def test_a_spectrum_keeps_its_wavelengths(write, tmp_path):
    nm = range(400, 701, 10)
    pairs = [
        (30, 30, 180),
        (30, 0, 0),
        (30, 60, 180),
        (45, 45, 180),
        (45, 10, 0),
        (60, 60, 180),
        (60, 10, 180),
        (10, 10, 180),
    ]
    lines = [",".join(map(str, [*pair, *[0.095493] * 31])) for pair in pairs]
    path = write("\n".join([",".join([HEADER, *(f"{w}nm" for w in nm)]), *lines]))
    samples = read(path)
    assert list(samples.channels) == [f"{w}nm" for w in nm]
    assert cli.main(["convert", str(path), str(tmp_path / "s.tsv")]) == 0
    assert (tmp_path / "s.tsv").read_text().splitlines()[0].split("\t")[3:] == list(samples.channels)
    assert dsbrdf.fit(samples, 1).model.channels == tuple(samples.channels)


def test_wavelengths_that_descend_are_sorted(write):
    samples = read(write(f"{HEADER},lambda_650,550,0.45 um\n30,30,180,3,2,1\n"))
    assert tuple(samples.channels) == ("450nm", "550nm", "650nm")
    assert_array_equal(samples.values, [[1, 2, 3]])


# Preambles, encodings, spreadsheets


def test_lines_before_the_table_when_the_columns_are_named(write):
    names = "theta_i_rad,phi_i_rad,theta_o_rad,phi_o_rad"
    body = "0.5,0,0.5,3.14159,1.2\n0.5,0,0.1,0,0.3\n0.7,0,0.7,3.14159,1.1\n0.7,0,0.2,0,0.2\n"
    samples = read(write(f"Instrument,GX-1\nPoints,4\n\n{body}"), columns=[*names.split(","), "v"])
    assert_allclose(samples.wi[0], [np.sin(0.5), 0.0, np.cos(0.5)])
    assert_array_equal(samples.values.ravel(), [1.2, 0.3, 1.1, 0.2])
    lines = [f"{line.replace(',', ' ')} 1.1 1.0" for line in body.splitlines()]
    text = "\n".join(["# plate", "# bands", "3", "", "# centres", "450 550 650", "", "# data", *lines])
    samples = read(write(text, "pre.txt"), columns=f"{names},b450,b550,b650".split(","))
    assert tuple(samples.channels) == ("b450", "b550", "b650")
    assert len(samples) == 4


@pytest.mark.parametrize(
    "encoding", ["latin-1", "cp1252", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(write, encoding, end):
    lines = [
        "# detector at 0°, sample: grün 3",
        f"{HEADER},r,g,b",
        *(f"{i},{o},0,{v:g},0.1,0.2" for i, o, v in scan()),
    ]
    samples = read(write(end.join([*lines, ""]), encoding=encoding))
    assert samples.values.shape == (75, 3)
    assert_allclose(samples.values[:, 0], [v for *_, v in scan()], rtol=1e-5)


SHEET = {
    "decimal comma": ("theta_i_deg;theta_o_deg;phi_o_deg;r;g\n10;-60;0;0,069549;1\n50;60;0;0,05;2\n", 0.069549),

           "quoted": (
        '"theta_i_deg","theta_o_deg","phi_o_deg","r","g"\n"10","-60","0","0.069549","1"\n"50","60","0","0.05","2"\n',
        0.069549,
    ),
    "trailing comma": (f"{HEADER},r,g,\n10,-60,0,0.069549,1,\n50,60,0,0.05,2,\n", 0.069549),
    "units row": (f"{HEADER},r,g\ndeg,deg,deg,1/sr,1/sr\n10,-60,0,0.069549,1\n50,60,0,0.05,2\n", 0.069549),
    "unicode minus": (f"{HEADER},r,g\n10,\u221260,0,0.069549,1\n50,60,0,0.05,2\n", 0.069549),
    "fortran": (f"{HEADER},r,g\n1.00000D+01,-6.0D+01,0.0D+00,6.95490D-02,1d0\n50,60,0,0.05,2\n", 0.069549),
    "empty cell": (f"{HEADER},r,g\n10,-60,0,,1\n50,60,0,0.05,2\n", np.nan),
    "NA": (f"{HEADER},r,g\n10,-60,0,NA,1\n50,60,0,0.05,2\n", np.nan),
    "dash": (f"{HEADER},r,g\n10,-60,0,-,1\n50,60,0,0.05,2\n", np.nan),
    "percent comments": ("% matlab\n% "
    "theta_i_deg\ttheta_o_deg\tphi_o_deg\tr\tg\n10\t-60\t0\t0.069549\t1\n50\t60\t0\t0.05\t2\n", 0.069549),
}  # fmt: skip


@pytest.mark.parametrize("kind", SHEET)
def test_spreadsheets_and_instruments(write, kind):
    text, first = SHEET[kind]
    samples = read(write(text))
    assert tuple(samples.channels) == ("r", "g")
    assert_array_equal(samples.values, [[first, 1], [0.05, 2]])
    assert_allclose(samples.wo[:, 0], np.sin(np.deg2rad([-60, 60])))


def test_text_after_the_table_is_left_out_with_a_warning(write):
    path = write(f"{HEADER},r\n10,-60,0,0.07\n50,60,0,0.05\n# end\nEnd of measurement\nOperator: N. N.\n")
    with pytest.warns(
        ReadWarning, match="^scan: 2 lines after the table left out, from line 5: 'End of measurement'"
    ):
        assert len(read(path)) == 2


# Arrays without angles, planes without azimuths


@pytest.mark.parametrize("shape", [(30, 30, 60, 3), (12, 9), (12, 9, 3)])
def test_values_alone_are_a_table(tmp_path, shape):
    values = np.full(shape, 0.1)
    np.savez(tmp_path / "t.npz", values=values)
    np.save(tmp_path / "t.npy", values)
    table, same = read(tmp_path / "t.npz"), read(tmp_path / "t.npy")
    assert_array_equal(table.values, same.values)
    assert_array_equal(table.theta_h, same.theta_h)


def test_a_plane_without_azimuths(write):
    samples = read(write("theta_i_deg,theta_o_deg,v\n30,-60,0.1\n30,-30,1.2\n30,0,0.2\n30,30,0.1\n"))
    assert_allclose(samples.wo[:, 0], np.sin(np.deg2rad([-60, -30, 0, 30])), atol=1e-15)
    assert_allclose(dsbrdf.half_diff.from_directions(samples.wi, samples.wo)[0][1], 0.0, atol=1e-9)


@pytest.mark.parametrize("letter", ["r", "s", "v", "out", "scat", "det"])
def test_the_usual_names_of_the_view(write, letter):
    samples = read(
        write(f"theta_i_deg,theta_{letter}_deg,phi_{letter}_deg,v\n30,30,180,1.2\n30,0,0,.2\n30,60,180,.1\n")
    )
    assert_allclose(samples.wo[0], [-0.5, 0.0, np.sqrt(0.75)], atol=1e-15)
    assert len(samples) == 3


# ASTM, strangers


def test_astm_names_its_columns_in_a_line_of_its_own(write):
    lines = [
        f"{np.deg2rad(10):.6f},0.0,{np.deg2rad(o):.6f},3.141593,{lobe(10, -o):g}" for o in range(60, 20, -5)
    ]
    head = [
        "FORMAT ASTM E 1392-90",
        'SAMPLE_ID "plate"',
        "NUM_POINTS 8",
        "VARS theta_i,phi_i,theta_s,phi_s,BRDF",
    ]
    samples = read(write("\n".join([*head, *lines]), "scan.astm"))
    assert_allclose(samples.wo[0], [-np.sin(np.pi / 3), 0.0, 0.5], atol=1e-6)
    assert len(samples) == 8
    assert any("angles in radians" in remark for remark in samples.remarks)


def workbook():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("docProps/app.xml", "xl/workbook.xml", "[Content_Types].xml"):
            archive.writestr(name, "<a/>")
    return file.getvalue()


def plain_zip():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("scan.csv", "1")
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (workbook(), "an Excel workbook: save the sheet as CSV"),
        (plain_zip(), "a zip archive. Unpack it first"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "an old Office file, perhaps an Excel workbook"),
        (b"%PDF-1.7\n" + bytes(100), "a PDF document"),
        (b"PAR1" + bytes(100), "a Parquet file"),
        (b"\x80\x04\x95" + bytes(100), "a Python pickle, which is not read since it can run anything"),
        (b"<html><body>1,2,3</body></html>", "a web page"),
        (b"\xff\xd8\xff\xe0" + bytes(100), "an image, not a measurement"),
        (b'<?xml version="1.0"?>\n<a/>', "an XML file of no known kind"),
        (b"SIMPLE  =                    T", "a FITS file"),
        (struct.pack("<4i", 1, 2, 3, 4), "no known format"),
    ],
)  # fmt: skip
def test_what_else_a_file_may_be_is_said(write, content, message):
    path = write(content, "scan.dat")
    with pytest.raises(ValueError, match=re.escape(message)):
        read(path)


def test_hdf5_without_a_network_says_what_it_holds(tmp_path):
    import h5py

    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["scan/theta"] = np.zeros(3)
    with pytest.raises(
        ValueError, match="an HDF5 file without a neural BRDF, and without arrays at its top, but scan/theta"
    ):
        read(tmp_path / "x.h5")


# The files themselves


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore::dsbrdf.measured.samples.ReadWarning")
def test_all_cases_of_the_data_folder(data):
    counts = {}
    for path in sorted((data / "cases").rglob("*.*")):
        if path.suffix not in (".csv", ".txt", ".astm") or path.parent.name.startswith("07"):
            continue
        samples = read(path)
        counts[f"{path.parent.name[:2]}/{path.name}"] = (len(samples), samples.n_channels)
    assert counts["01/scan.csv"] == (75, 3)
    assert counts["02/scan.csv"] == (75, 3)
    assert counts["08/scan.csv"] == counts["08/utf16.csv"] == (75, 3)
    assert counts["12/scan.csv"] == (4, 1)
    assert counts["12/theta_r.csv"] == (3, 1)
    assert counts["13/footer.csv"] == (8, 3)
    assert {
        counts[f"13/{name}.csv"][0] for name in ("NA", "decimal_comma", "empty_cell", "fortran_D", "quoted")
    } == {10}
    assert counts["16/s.csv"] == (8, 31)
    assert counts["19/scan.csv"] == (29, 1)
    assert counts["21/scan.astm"] == (8, 1)
    assert counts["21/percent.txt"] == (10, 3)
    assert len(counts) >= 25
