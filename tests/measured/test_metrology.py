"""Formats of metrology: files made here, each with a value worked out by hand or read back by other means."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import Samples, cli, half_diff, read
from dsbrdf.measured.formats import bird, utia
from dsbrdf.measured.formats.grid import about_mirror
from dsbrdf.measured.read import FORMATS, format_of

# Directions by hand: light at 30 degrees, the mirror direction, and the normal
LIGHT = [0.5, 0.0, np.sqrt(0.75)]
MIRROR = [-0.5, 0.0, np.sqrt(0.75)]
UP = [0.0, 0.0, 1.0]


@pytest.fixture
def write(tmp_path):
    def to_file(content, name):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return to_file


def at(samples, wi, wo):
    """Values of the sample with these directions."""
    near = np.flatnonzero((np.abs(samples.wi - wi).max(1) < 1e-5) & (np.abs(samples.wo - wo).max(1) < 1e-5))
    assert near.size, "no such pair"
    return samples.values[near[0]]


def test_about_mirror_by_hand():
    wi, wo = about_mirror(
        np.pi / 6,
        0.0,
        np.array([0.0, np.pi / 6, np.pi / 6, np.pi / 2]),
        np.array([0.0, 0.0, np.pi, np.pi / 2]),
    )
    assert_allclose(wi[0], LIGHT)
    assert_allclose(wo, [MIRROR, UP, [-np.sqrt(0.75), 0.0, 0.5], [0.0, 1.0, 0.0]], atol=1e-15)
    wi, wo = about_mirror(np.pi / 6, np.pi / 2, 0.0, 0.0)
    assert_allclose((wi, wo), ([0.0, 0.5, np.sqrt(0.75)], [0.0, -0.5, np.sqrt(0.75)]), atol=1e-15)


# BiRD

BIRD = {
    "metadata": {"type": "measured"},
    "data": {
        "theta_i": {"unit": "deg", "values": [30, 30, 30, 30]},
        "phi_i": {"unit": "deg", "values": [0, 0, 0, 0]},
        "theta_r": {"unit": "deg", "values": [30, 0, 30, 0]},
        "phi_r": {"unit": "deg", "values": [180, 0, 180, 0]},
        "BRDF": {"unit": "sr^-1", "values": [1.2, 0.2, 1.1, 0.1], "uncertainty": {"value": 5, "unit": "%"}},
        "wavelength_i": {"unit": "nm", "values": [650, 650, 450, 450]},
        "polarization_i": {"notation": "sp", "values": ["u", "u", "u", "u"]},
    },
}


def test_bird_by_columns(write):
    samples = read(write(json.dumps(BIRD), "scan.brdf"))
    assert tuple(samples.channels) == ("450nm", "650nm")
    assert_array_equal(at(samples, LIGHT, MIRROR), [1.1, 1.2])
    assert_array_equal(at(samples, LIGHT, UP), [0.1, 0.2])
    assert_allclose(samples.weights, 0.02**2 / (0.05**2 + 0.02**2), rtol=0.1)
    assert any("polarization_i" in remark for remark in samples.remarks)


def test_bird_line_by_line(write):
    names = ["theta_i", "phi_i", "theta_r", "phi_r", "BRDF", "uBRDF"]
    units = ["deg"] * 4 + ["1/sr"] * 2
    variables = [{"name": n, "unit": u, "type": "number"} for n, u in zip(names, units, strict=True)]
    rows = [[30, 0, 30, 180, 1.2, 0.06], [30, 0, 0, 0, 0.2, 0.01]]
    samples = read(write(json.dumps({"data": {"variables": variables, "values": rows}}), "old.json"))
    assert tuple(samples.channels) == ("brdf",)
    assert_array_equal(at(samples, LIGHT, MIRROR), [1.2])
    assert_allclose(samples.weights, 0.02**2 / (0.05**2 + 0.02**2))


def test_bird_is_written_and_read_back(tmp_path, write):
    before = read(write(json.dumps(BIRD), "scan.json"))
    bird.write_bird(before, tmp_path / "copy.brdf")
    after = read(tmp_path / "copy.brdf")
    assert tuple(after.channels) == tuple(before.channels)
    assert_allclose(after.values, before.values)
    assert_allclose(after.wo, before.wo, atol=1e-12)
    assert_allclose(after.weights, before.weights, rtol=1e-6)
    content = json.loads((tmp_path / "copy.brdf").read_text())
    assert content["data"]["BRDF"]["unit"] == "1/sr"
    assert cli.main(["convert", str(tmp_path / "copy.brdf"), str(tmp_path / "again.json"), "-t", "bird"]) == 0
    assert_allclose(read(tmp_path / "again.json").values, before.values)
    with pytest.raises(
        ValueError, match=r"BiRD JSON holds one channel or wavelengths, got r, g, b. Use \.csv"
    ):
        bird.write_bird(Samples([UP], [UP], [[1, 2, 3]], channels=("r", "g", "b")), tmp_path / "x.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"polarization_i": {"values": ["s", "p", "s", "p"]}}, "polarization_i: 2 states of polarisation"),
        ({"BRDF": {"unit": "sr^-1", "values": [1, 2]}}, "columns of "),
        ({"BRDF": {"unit": "sr^-1", "values": ["a", 2, 3, 4]}}, "could not convert"),
        ({"temperature": {"unit": "K", "values": [1, 2, 3, 4]}}, "column temperature .* is no reflectance"),
        ({"theta_i": {"unit": "gon", "values": [1, 2, 3, 4]}}, "unit 'gon' is neither deg nor rad"),
    ],
)
def test_wrong_bird_is_refused(write, change, message):
    path = write(json.dumps(BIRD | {"data": BIRD["data"] | change}), "x.json")
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*{message}"):
        read(path)


# pbrt, Zemax, SSDD, DDR


def test_cornell_as_in_pbrt(write):
    text = "# plate\n3 # bands\n450 550 650\n# data\n0.5 0 0.5 3.141592654 1.2 1.1 1.0\n0.5 0 0.1 0 0.3\n0.2 0.1\n"
    samples = read(write(text, "plate.brdf"))
    assert tuple(samples.channels) == ("450nm", "550nm", "650nm")
    assert_allclose(samples.wo, [[-np.sin(0.5), 0, np.cos(0.5)], [np.sin(0.1), 0, np.cos(0.1)]], atol=1e-9)
    assert_array_equal(samples.values, [[1.2, 1.1, 1.0], [0.3, 0.2, 0.1]])
    with pytest.raises(ValueError, match="the file ends early, after line 5"):
        read(write(text[:60], "cut.brdf"))
    with pytest.raises(ValueError, match="no header that names a direction"):
        read(write(f"{'9' * 400}\n450 550\n0.5 0 0.5 3.1\n", "huge.brdf"))


ZEMAX = """#Data by hand
Source  Measured
Symmetry  PlaneSymmetrical
SpectralContent  Monochrome
ScatterType  {kind}
SampleRotation  1
0
AngleOfIncidence  2
0 30
ScatterAzimuth 3
0 90 180
ScatterRadial 3
0 30 100

Monochrome
DataBegin
TIS 0.5
1 2 0
1 2 0
1 2 0
TIS 0.4
9 4 0
9 5 0
9 6 0
DataEnd
"""


@pytest.mark.filterwarnings("ignore::dsbrdf.measured.samples.ReadWarning")
def test_zemax(write):
    samples = read(write(ZEMAX.format(kind="BRDF"), "x.bsdf"))
    assert at(samples, LIGHT, MIRROR) == [9.0]
    # 30 degrees from the mirror direction, toward the normal, and away from it
    assert at(samples, LIGHT, UP) == [4.0]
    assert at(samples, LIGHT, [-np.sqrt(0.75), 0.0, 0.5]) == [6.0]
    # On both sides of the plane of incidence
    theta_h, _, _ = half_diff.from_directions(samples.wi, samples.wo)
    assert (samples.values[:, 0] == 5.0).sum() == 2
    assert theta_h.max() < np.pi / 2
    with pytest.raises(ValueError, match=r"line 15: holds BTDF: transmitted light"):
        read(write(ZEMAX.format(kind="BTDF"), "x.bsdf"))
    with pytest.raises(ValueError, match="the file ends early"):
        read(write(ZEMAX.format(kind="BRDF")[:-40], "x.bsdf"))


SSDD = """VERSION 0.2
SOFTWARE by hand

DATA_TYPE specular_reflectance
COLOR_MODEL monochrome
PARAM0_LIST 0 90
DATA ascii
0.05
0.05
# the BRDF
DATA_TYPE brdf
COLOR_MODEL {colour}
{waves}PARAM_TYPE {kind}
PARAM0_LIST {p0}
PARAM2_LIST {p2}
PARAM3_LIST {p3}
DATA {mode}
"""


@pytest.mark.parametrize("mode", ["ascii", "binary"])
def test_ssdd_in_angles(write, mode):
    numbers = np.arange(1.0, 9.0).reshape(-1, 2)  # parameter 0 fastest, then 2, then 3
    head = SSDD.format(
        colour="spectrum", waves="WAVELENGTH_LIST 450 650\n", kind="spherical_coordinate_system",
        p0="30", p2="0 30", p3="0 180", mode=mode,
    )  # fmt: skip
    body = (
        numbers.astype("<f8").tobytes()
        if mode == "binary"
        else "\n".join(f"{a} {b}" for a, b in numbers).encode()
    )
    samples = read(write(head.encode() + body, "x.ssdd"), scale=1)
    assert tuple(samples.channels) == ("450nm", "650nm")
    assert_array_equal(at(samples, LIGHT, MIRROR), [7.0, 8.0])
    assert any("specular_reflectance left out" in remark for remark in samples.remarks)


def test_ssdd_about_the_mirror_and_half_angles(write):
    options = {"colour": "rgb", "waves": "", "mode": "ascii"}
    about = SSDD.format(kind="specular_coordinate_system", p0="30", p2="0 30", p3="0 180", **options)
    lines = "9 8 7\n4 4 4\n9 8 7\n6 6 6\n"
    samples = read(write(about + lines, "x.ssdd"), scale=1)
    assert_array_equal(at(samples, LIGHT, MIRROR), [9, 8, 7])
    assert_array_equal(at(samples, LIGHT, UP), [4, 4, 4])
    half = SSDD.format(kind="half_difference_coordinate_system", p0="0 10", p2="30", p3="0 90", **options)
    samples = read(write(half + "1 1 1\n2 2 2\n3 3 3\n4 4 4\n", "x.ssdd"), scale=1)
    assert_allclose(
        np.rad2deg(half_diff.from_directions(samples.wi, samples.wo)[0]), [0, 0, 10, 10], atol=1e-6
    )
    assert_array_equal(samples.values[:, 0], [1, 3, 2, 4])
    with pytest.raises(ValueError, match="expected 12 values, got 3"):
        read(write(half + "1 1 1\n", "x.ssdd"))


DDR = """;; by hand
Source Measured
TypeSym PlaneSymmetrical
TypeColorModel RGB
TypeData {data}
sigma 1
30
phi 2
0 180
theta 2
0 30
red
kbdf
0.5
def
{pi2} 4
{pi2} 6
gre
kbdf
1
def
1 1
1 1
blu
kbdf
1
def
1 1
1 1
"""


def test_ddr(write):
    text = DDR.format(data="Luminance Absolute", pi2=2 * np.pi)
    samples = read(write(text, "x.ddr"))
    assert_allclose(at(samples, LIGHT, MIRROR), [1.0, 1 / np.pi, 1 / np.pi])
    assert_allclose(at(samples, LIGHT, UP), [2 / np.pi, 1 / np.pi, 1 / np.pi])
    with pytest.raises(ValueError, match=r"its values are relative: say by which factor .*--scale"):
        read(write(DDR.format(data="Luminance Relative", pi2=1), "x.ddr"))


# ALTA, UTIA, arrays by name


@pytest.mark.parametrize("binary", [False, True])
def test_alta(write, binary):
    table = np.array([[0.1, 0.2, 0.3, 1.0, 2.0, 3.0], [0.5, 0.4, 2.0, 4.0, 5.0, 6.0]])
    head = "#DIM 3 3\n#PARAM_IN  RUSIN_TH_TD_PD\n#PARAM_OUT RGB_COLOR\n"
    if binary:
        head += "#FORMAT binary\n#VERSION 0\n#PRECISION ieee754-double\n#SAMPLE_COUNT 2\n"
        head += "#ENDIAN little\n#BEGIN_STREAM\n"
        content = head.encode() + table.astype("<f8").tobytes() + b"\n#END_STREAM\n"
    else:
        content = (head + "".join(" ".join(map(str, row)) + "\n" for row in table)).encode()
    samples = read(write(content, "x.alta"))
    assert tuple(samples.channels) == ("r", "g", "b")
    assert_array_equal(samples.values, table[:, 3:])
    assert_allclose(np.transpose(half_diff.from_directions(samples.wi, samples.wo)), table[:, :3])
    with pytest.raises(ValueError, match="parametrisation 'COS_TH' of 3 numbers does not tell"):
        read(write(content.replace(b"RUSIN_TH_TD_PD", b"COS_TH"), "x.alta"))


def test_alta_with_the_cosine(write):
    head = "#DIM 3 1\n#PARAM_IN ISOTROPIC_TV_TL_DPHI\n#PARAM_OUT INV_STERADIAN_COS_FACTOR\n"
    text = f"{head}1.0471976 0.5235988 3.1415927 0.1\n"
    with pytest.raises(ValueError, match=r"the values hold the cosine .*--cosine"):
        read(write(text, "x.alta"))
    samples = read(write(text, "x.alta"), cosine=True)
    assert_allclose(samples.values, [[0.2]], rtol=1e-6)
    assert_allclose(samples.wi, [LIGHT], atol=1e-7)


@pytest.mark.filterwarnings("ignore::dsbrdf.measured.samples.ReadWarning")
def test_utia(write):
    values = np.random.default_rng(1).uniform(0.1, 0.2, (3, 6, 48, 6, 48))
    path = write(values.astype("<f8").tobytes(), "m001.bin")
    assert path.stat().st_size == utia.N_BYTES
    samples = read(path)
    assert len(samples) == (6 * 48) ** 2
    assert_array_equal(at(samples, LIGHT, MIRROR), values[:, 2, 0, 2, 24])


def test_arrays_of_matlab(tmp_path):
    from scipy.io import savemat

    columns = {"theta_i_deg": [[30.0], [30.0]], "theta_o_deg": [[30.0], [0.0]], "phi_o_deg": [[180.0], [0.0]]}
    savemat(tmp_path / "x.mat", columns | {"brdf": [[1.2], [0.2]]})
    assert_array_equal(at(read(tmp_path / "x.mat"), LIGHT, MIRROR), [1.2])
    savemat(tmp_path / "t.mat", {"values": np.full((3, 4, 5, 3), 0.1)})
    assert read(tmp_path / "t.mat").values.shape == (3, 4, 5, 3)
    savemat(tmp_path / "text.mat", {"name": "no numbers"})
    with pytest.raises(ValueError, match="a MATLAB file without arrays of numbers"):
        read(tmp_path / "text.mat")


def test_arrays_of_hdf5(tmp_path):
    import h5py

    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["wi"], file["wo"] = [LIGHT, LIGHT], [MIRROR, UP]
        file["values"] = [[1.2, 1.1], [0.2, 0.1]]
    assert_array_equal(at(read(tmp_path / "x.h5"), LIGHT, MIRROR), [1.2, 1.1])


def test_frames():
    columns = {
        "theta_i_deg": [30.0, 30.0],
        "theta_o_deg": [-30.0, 0.0],
        "450nm": [1.1, 0.1],
        "650nm": [1.2, 0.2],
    }
    assert_array_equal(at(read(columns), LIGHT, MIRROR), [1.1, 1.2])
    import pandas as pd
    import xarray as xr

    assert_array_equal(at(read(pd.DataFrame(columns)), LIGHT, MIRROR), [1.1, 1.2])
    angles = {"theta_i_deg": [30.0], "theta_o_deg": [-30.0, 0.0]}
    grid = xr.DataArray([[1.2, 0.2]], coords=angles, dims=tuple(angles), name="brdf")
    for table in (grid, grid.to_dataset()):
        assert_array_equal(at(read(table), LIGHT, MIRROR), [1.2])
    with pytest.raises(
        TypeError, match="expected a path, a DataFrame, an xarray Dataset or a mapping of columns, got int"
    ):
        read(3)
    with pytest.raises(ValueError, match=r"column id must be numbers"):
        read(columns | {"id": ["a", "b"]})
    assert len(read(columns | {"id": ["a", "b"]}, ignore=["id"])) == 2


def test_formats_do_not_overlap(write):
    files = {
        "BiRD JSON file": json.dumps(BIRD),
        "Zemax BSDF file": ZEMAX,
        "SSDD file": SSDD,
        "Integra DDR file": DDR,
        "ALTA data file": "#DIM 3 1\n#PARAM_IN CARTESIAN\n",
        "pbrt-v2 measured BRDF": "2\n450 650\n0.5 0 0.5 3.1 1 1\n",
        "text": "theta_i_deg,theta_o_deg,phi_o_deg,v\n1,2,3,4\n",
    }
    for name, content in files.items():
        path = write(content, "x")
        assert format_of(path).name == name
        head = path.read_bytes()
        assert [f.name for f in FORMATS[:-1] if f.fits(head, path)] == [name][: name != "text"]
