"""Scattered samples: columns of text and arrays to directions and values, units, weights, and what is refused."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from dsbrdf import Samples, half_diff, read, read_samples
from dsbrdf.measured.samples import ReadWarning, samples_from_columns

HEADER = "theta_i_deg,theta_o_deg,phi_o_deg,r,g,b\n"
UP = np.array([[0.0, 0.0, 1.0]])


def direction(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


@pytest.fixture
def write(tmp_path):
    def to_file(text, name="scan.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_text(text, encoding=encoding)
        return path

    return to_file


def test_angles_in_degrees(write):
    samples = read(write(HEADER + "30,45,180,1,2,3\n60,0,90,4,5,6\n"))
    assert isinstance(samples, Samples)
    assert_allclose(samples.wi, direction(np.deg2rad([30, 60]), 0.0), atol=1e-15)
    assert_allclose(samples.wo, direction(np.deg2rad([45, 0]), np.deg2rad([180, 90])), atol=1e-15)
    assert_array_equal(samples.values, [[1, 2, 3], [4, 5, 6]])
    assert samples.weights is None
    assert samples.name == "scan"
    assert samples.source.to_json()["file"] == "scan.csv"
    assert repr(samples) == "Samples('scan', 2 pairs of directions, 3 channels)"


@pytest.mark.parametrize(
    "text",
    [
        "theta_i_deg;theta_o_deg;phi_o_deg;value\n30;45;180;2\n",
        "theta_i_deg\ttheta_o_deg\tphi_o_deg\tvalue\n30\t45\t180\t2\n",
        "theta_i_deg theta_o_deg  phi_o_deg value\n  30 45 180   2\n",
        "# by hand\r\n#theta_i_deg,theta_o_deg,phi_o_deg,value\r\n\r\n30,45,180,2\r\n",
        'Theta_I [deg],"THETA_O (deg)",phi_o deg,450\n30,45,180,2\n',
        f"theta_i_rad,theta_o_rad,phi_o_rad,f\n{np.pi / 6},{np.pi / 4},{np.pi},2\n",
        "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,f\n30,0,-45,0,2 # far side\n",
        "theta_i_deg,phi_i_rad,theta_o_deg,phi_o_deg,f\n-30,3.141592653589793,45,180,2\n",
        "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n.5,0,.866,-.707,0,.707,2\n",
        "\ufefftheta_i_deg,theta_o_deg,phi_o_deg,value\n30,45,180,2\n",
    ],
)
def test_any_layout_of_text_gives_the_same(write, text):
    samples = read(write(text, "x.dat"))
    assert_allclose(samples.wi, direction(np.deg2rad([30]), 0.0), atol=2e-4)
    assert_allclose(samples.wo, direction(np.deg2rad([45]), np.pi), atol=2e-4)
    assert_allclose(np.linalg.norm(samples.wo, axis=-1), 1.0, rtol=1e-12)
    assert_array_equal(samples.values, [[2.0]])


def test_half_and_difference_angles(write):
    samples = read(write("theta_h_deg,theta_d_deg,phi_d_deg,value\n20,30,40,2\n"))
    assert_allclose(np.rad2deg(half_diff.from_directions(samples.wi, samples.wo)), [[20], [30], [40]])


def test_names_given_replace_the_header_and_leave_columns_out(write):
    columns = ["-", "theta_i_deg", "theta_o_deg", "phi_o_deg", "value"]
    for text in ("id,a,b,c,d\nfirst,30,45,180,2\n", "first,30,45,180,2\n"):
        samples = read_samples(write(text), columns)
        assert_array_equal(samples.values, [[2.0]])
        assert_allclose(samples.wi, direction(np.deg2rad([30]), 0.0))
        assert len(read(write(text), columns=columns)) == 1


@pytest.mark.parametrize("n", [1, 2, 3, 31])
def test_any_number_of_channels(write, n):
    header = ",".join(["theta_i_deg", "theta_o_deg", "phi_o_deg", *(f"{400 + 10 * i}nm" for i in range(n))])
    samples = read(write(f"{header}\n30,45,180,{','.join(map(str, range(n)))}\n"))
    assert_array_equal(samples.values, [np.arange(n)])
    assert samples.n_channels == n
    assert list(samples.channels) == header.split(",")[3:]


def test_weights_and_standard_deviations(write):
    start = "theta_i_deg,theta_o_deg,phi_o_deg,value"
    assert_array_equal(read(write(f"{start},weight\n1,2,3,4,0.5\n1,2,3,4,0\n")).weights, [0.5, 0.0])
    samples = read(write(f"{start},std\n1,2,3,4,0.4\n1,2,3,4,1\n1,2,3,4,1e-9\n1,2,3,4,9\n"))
    # Inverse squares of the relative error, which is at least 0.02 and at most 1
    assert_allclose(samples.weights, 0.02**2 / (np.array([0.1, 0.25, 0.0, 1.0]) ** 2 + 0.02**2))
    assert_array_equal(samples.values, np.full((4, 1), 4.0))
    assert tuple(samples.channels) == ("value",)
    assert repr(samples).endswith("1 channels, weighted)")


def test_what_is_negative_or_not_finite_is_invalid(write):
    path = write(HEADER + "30,45,180,-1,nan,inf\n30,45,180,0,1e-300,-inf\n")
    with pytest.warns(
        ReadWarning, match="^scan: channel b holds no valid value: it is dark in what comes of it"
    ):
        samples = read(path)
    assert_array_equal(samples.values, [[np.nan] * 3, [0.0, 1e-300, np.nan]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an empty file. Expected a MERL"),
        ("# only\n\n", "no samples: expected lines of numbers after a header and comments, or another format."),
        (HEADER, "no samples: expected lines of numbers"),
        ("30,45,180,1\n", r"no header that names a direction .*in line 1: '30,45,180,1'. Name .* "
        r"columns=\['theta_i_deg'"),
        (HEADER + "1,2,3,4,5\n", "6 names of columns, but 5 columns in line 2."),
        (HEADER + "1,2,3,4,5,6,7\n", "6 names of columns, but 7 columns in line 2."),
        (HEADER + "1,2,3,4,5,6\n1,2,3\n", "line 3 has 3 cells, not 6 as the others: '1,2,3'. Is it cut off"),
        (HEADER + "1,2,3,4,5,6\n1,2,3,4,5,x\n", "line 3, column b: 'x' is not a number. .* '1,2,3,4,5,x'"),
        (HEADER.replace("g,b", "r,b") + "1,2,3,4,5,6\n", "column r is there twice"),
        (HEADER.replace("g,b", "red,b") + "1,2,3,4,5,6\n", "column red is there twice: r means the same. Leave "
        "one out"),
        ("theta_i,theta_o,phi_o,f\n1,2,3,4\n", "column theta_i must say its unit: call it theta_i_deg or theta_i_rad."),
        ("theta_i_deg,theta_o_deg,f\n1,2,3\n", "no azimuth, and theta_o_deg has no negative angle .*--set "
        "phi_o_deg=180"),
        ("theta_i_deg,phi_o_deg,f\n1,2,3\n", "expected columns theta_i and theta_o .*, without theta_o.*--set "
        "theta_o_deg="),
        ("a,b,c\n1,2,3\n", "no header that names a direction .*line above the numbers: 'a,b,c'"),
        ("theta_i_deg,theta_o_deg,phi_o_deg\n1,2,3\n", "expected a column of values beside the directions; got"),
        (HEADER + "95,2,3,4,5,6\n", "no sample is left: all are below the horizon, the first in line 2"),
        (HEADER + "1,nan,3,4,5,6\n", "no sample is left: all are without a direction, the first in line 2"),
        (HEADER.replace("deg", "rad") + "1,20,3,4,5,6\n", "theta_o_rad must lie within 1.570796 .* got 20. Are "
        "these deg"),
        (HEADER.replace("deg", "gon") + "1,20,3,4,5,6\n", "no header that names a direction"),
        (HEADER.replace("_deg", " [gon]") + "1,20,3,4,5,6\n", "unit 'gon' is neither deg nor rad"),
        (HEADER + "1,2,inf,4,5,6\n", "no sample is left: all are without a direction"),
        (HEADER.replace("r,g,b", "f,std,weight") + "1,2,3,4,5,6\n", "a column weight or std, got both. Leave one out"),
        (HEADER.replace("r,g,b", "r,g,std") + "1,2,3,4,5,0\n", "'std' must be > 0 and finite, got 0 in line 2"),
        (HEADER.replace("r,g,b", "r,g,weight") + "1,2,3,4,5,-1\n", "'weights' must be >= 0 and finite, got -1 "
        "in line 2"),
        ("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n0,0,1,0,1,1,2\n", "must be unit vectors, got norm 1.41421 at index 0"),
        ("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,f\n0,0,1,0,0,-1,2\n", "no sample is left: all are below the horizon, "
        "the first in"),
        ("theta_h_deg,theta_d_deg,phi_d_deg,f\n80,80,0,2\n", "no sample is left: all are below the horizon"),
        ("theta_i_deg," + "x" * 100_001 + "\n", "not a table of samples: a line has more than 100,000 bytes."),
        (HEADER + "1,2,3,4,5,6\n" + " " * 5000 + "\0", "not a table of samples: it holds a byte that is no text."),
    ],
)  # fmt: skip
def test_wrong_text_is_refused(write, text, message):
    path = write(text)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*({message})"):
        read(path)


def test_names_that_do_not_fit_are_refused(write):
    with pytest.raises(ValueError, match="2 names of columns, but 3 columns in line 1"):
        read_samples(write("1,2,3\n"), ["theta_i_deg", "f"])
    with pytest.raises(ValueError, match="line 2, column theta_i_deg: 'first' is not a number"):
        read_samples(write("1,2,3,4\nfirst,2,3,4\n"), ["theta_i_deg", "theta_o_deg", "phi_o_deg", "f"])


def test_long_lines_are_found_across_blocks(write):
    path = write(HEADER + "1,2,3,4,5,6\n" * 90_000 + "1" * 100_001)
    with pytest.raises(ValueError, match="a line has more than 100,000 bytes"):
        read(path)
    assert len(read(write(HEADER + "1,2,3,4,5,6\n" * 100_000))) == 100_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": [1.0]}, r"'values' must have shape \(n, channel\) with a sample at least, got \(1,\)"),
        ({"values": np.zeros((0, 3))}, r"'values' must have shape .*, got \(0, 3\)"),
        ({"wi": [[0.0, 0.0, 2.0]]}, "'wi' must be unit vectors"),
        ({"wo": np.repeat(UP, 2, axis=0)}, r"'wo' must have shape \(1, 3\), got \(2, 3\)"),
        (
            {"wo": -UP},
            "'wo' must not lie below the horizon, got z = -1 at index 0. Light that passes through",
        ),
        ({"weights": [np.nan]}, "'weights' must be >= 0 and finite"),
        ({"weights": [1.0, 1.0]}, r"'weights' must have shape \(1,\), got \(2,\)"),
    ],
)
def test_arguments_that_disagree_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Samples(**{"name": "x", "wi": UP, "wo": UP, "values": [[1.0]]} | change)


@given(st.floats(-90, 90), st.floats(-720, 720), st.floats(0, 90), st.floats(-720, 720))
def test_angles_and_vectors_are_the_same(theta_i, phi_i, theta_o, phi_o):
    keys = ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")
    angles = dict(zip(keys, ([x] for x in (theta_i, phi_i, theta_o, phi_o)), strict=True))
    samples = samples_from_columns(angles | {"f": [1.0]}, "x")
    components = {f"{w}_{a}": getattr(samples, w)[:, i] for w in ("wi", "wo") for i, a in enumerate("xyz")}
    again = samples_from_columns(components | {"f": [1.0]}, "x")
    assert_allclose(again.wi, samples.wi, atol=1e-15)
    assert_allclose(again.wo, samples.wo, atol=1e-15)


# Arrays


def test_arrays_of_samples(tmp_path, rng):
    wi = direction(rng.uniform(0, 1.5, 7), rng.uniform(0, 6, 7))
    path = tmp_path / "scan.npz"
    np.savez(
        path, wi=wi, wo=wi[::-1], values=np.arange(14.0).reshape(7, 2), weights=np.arange(7), name="cloth"
    )
    samples = read(path)
    assert samples.name == "cloth"
    assert_allclose(samples.wo, wi[::-1], atol=1e-15)
    assert_array_equal(samples.values, np.arange(14.0).reshape(7, 2))
    assert_array_equal(samples.weights, np.arange(7.0))
    assert_array_equal(read_samples(path).values, samples.values)


def test_columns_may_be_arrays(tmp_path):
    path = tmp_path / "scan.npz"
    np.savez_compressed(
        path,
        theta_i_deg=np.array([10, 20], ">i2"),
        theta_o_deg=np.array([30.0, 40.0], "<f4"),
        phi_o_deg=np.array([0.0, 180.0]),
        values=np.array([1.0, 2.0]),
        std=np.array([0.5, 0.5]),
    )
    samples = read(path)
    assert_allclose(samples.wi, direction(np.deg2rad([10, 20]), 0.0))
    assert_array_equal(samples.values, [[1.0], [2.0]])
    assert_allclose(samples.weights, 0.02**2 / (np.array([0.5, 0.25]) ** 2 + 0.02**2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.zeros(3)}, "arrays of samples must be of one length, got .*values 3"),
        ({"wi": np.zeros((1, 2, 3))}, r"array wi must be numbers of shape \(n,\), got float64 \(1, 2, 3\)"),
        ({"std": np.array(["a"])}, r"array std must be numbers of shape \(n,\), got <U1"),
        ({"wo": UP * 1.1}, "the directions must be unit vectors, got norm 1.1 at index 0"),
    ],
)
def test_wrong_arrays_are_refused(tmp_path, change, message):
    path = tmp_path / "x.npz"
    np.savez(path, **{"wi": UP, "wo": UP, "values": np.zeros((1, 3))} | change)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: {message}"):
        read(path)


def test_read_samples_wants_samples(tmp_path, small_table):
    from dsbrdf.measured.formats.array_file import write_npz

    write_npz(small_table, tmp_path / "t.npz")
    with pytest.raises(ValueError, match=r"expected scattered samples, got a table. Use dsbrdf.read\.$"):
        read_samples(tmp_path / "t.npz")
    with pytest.raises(ValueError, match=r"names of columns are for text; this is a NumPy arrays"):
        read_samples(tmp_path / "t.npz", ["r"])
