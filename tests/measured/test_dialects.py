# A row of the tables is a line
# ruff: noqa: E501
"""Dialects of text: the same two samples, written in every way we could think of, or refused with the cause.

Each row is a text, the options of `read`, and what is expected: the channels and values (`SAME`, `VALUE` ...), or
what the
refusal says. None may be read wrong in silence.
"""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dsbrdf import read
from dsbrdf.measured.samples import ReadWarning

#: Light at 30 degrees, view at 45 degrees on the mirror side, 0.2 / sr; light at 60 degrees, view along the normal,
#: 0.1 / sr.
ANGLES = np.deg2rad([[30.0, 45.0], [60.0, 0.0]])
WI = np.stack([np.sin(ANGLES[:, 0]), np.zeros(2), np.cos(ANGLES[:, 0])], axis=-1)
WO = np.stack([-np.sin(ANGLES[:, 1]), np.zeros(2), np.cos(ANGLES[:, 1])], axis=-1)
H = "theta_i_deg,theta_o_deg,phi_o_deg"
BODY = "30,45,180,0.2\n60,0,180,0.1\n"
RAD = "0.523599,0.785398,3.141593,0.2\n1.047198,0,3.141593,0.1\n"
VECTORS = "0.5,0,0.8660,-0.7071,0,0.7071,0.2\n0.8660,0,0.5,0,0,1,0.1\n"
V = ("v",)

READ = {
    # Delimiters
    "comma": (f"{H},v\n{BODY}", {}, V),
    "comma and blank": (f"{H},v\n{BODY}".replace(",", ", "), {}, V),
    "semicolon": (f"{H},v\n{BODY}".replace(",", ";"), {}, V),
    "tab": (f"{H},v\n{BODY}".replace(",", "\t"), {}, V),
    "bar": (f"{H},v\n{BODY}".replace(",", "|"), {}, V),
    "blanks": (f"{H},v\n{BODY}".replace(",", "   "), {}, V),
    "blanks around": (f"  {H},v  \n  30  45  180 0.2  \n 60 0 180  0.1".replace(",", " "), {}, V),
    "tabs and blanks": (f"{H},v\n{BODY}".replace(",", " \t"), {}, V),
    "header with commas, blanks in the table": (f"{H},v\n{BODY.replace(',', ' ')}", {}, V),
    "header with blanks, commas in the table": (f"{H} v\n".replace(",", " ") + BODY, {}, V),
    "sep=": (f"sep=;\n{H},v\n{BODY}".replace(",", ";"), {}, V),
    "trailing delimiters": (f"{H},v,\n{BODY}".replace("\n3", ",\n3").replace("2\n", "2,\n").replace(".1\n", ".1,\n").replace("v,,", "v,"), {}, V),
    "trailing delimiter in the header alone": (f"{H},v,\n{BODY}", {}, V),
    "trailing delimiters in the table alone": (f"{H},v\n30,45,180,0.2,,\n60,0,180,0.1,,\n", {}, V),
    # Numbers
    "decimal comma": (f"{H};v\n30;45;180;0,2\n60;0;180;0,1\n".replace("deg,", "deg;"), {}, V),
    "decimal comma and tab": ("theta_i_deg\ttheta_o_deg\tphi_o_deg\tv\n30,0\t45,0\t180\t,2\n60\t0\t180\t1,0E-1\n", {}, V),
    "decimal comma and blanks": ("theta_i_deg theta_o_deg phi_o_deg v\n30,0 45,0 180 0,2\n60 0 180 0,1\n", {}, V),
    "decimal comma in quotes": (f'{H},v\n"30,0","45,0","180,0","0,2"\n"60","0","180","0,1"\n', {}, V),
    "Fortran": (f"{H},v\n3.0D+01,4.5d1,180,2.0D-01\n6.Q1,0,180,1.0-001\n", {}, V),
    "plus signs and bare points": (f"{H},v\n+30.,+45.0,+1.8E+2,.2\n60.,0.,180,+.1\n", {}, V),
    "Unicode minus": (f"{H},v\n30,\u221245,0,0.2\n60,0,0,0.1\n", {}, V),
    "en dash": (f"{H},v\n30,\u201345,0,0.2\n60,0,0,0.1\n", {}, V),
    "hard blanks": (f"{H},v\n30,\xa045,180\xa0,0.2\n60,0,180,0.1\n", {}, V),
    "degree signs": (f"{H},v\n30°,45°,180°,0.2\n60°,0°,180°,0.1\n", {}, V),
    # Lines
    "no line end at the end": (f"{H},v\n{BODY.strip()}", {}, V),
    "CR": (f"{H},v\n{BODY}".replace("\n", "\r"), {}, V),
    "CRLF": (f"{H},v\n{BODY}".replace("\n", "\r\n"), {}, V),
    "blank lines": (f"\n\n{H},v\n\n30,45,180,0.2\n\n   \n60,0,180,0.1\n\n\n", {}, V),
    "mark of DOS at the end": (f"{H},v\n{BODY}\x1a", {}, V),
    "byte order mark": (f"\ufeff{H},v\n{BODY}", {}, V),
    # Comments, preambles
    "comment with #": (f"# by hand\n#{H},v\n{BODY}", {}, V),
    "comment with %": (f"%% by hand\n%{H},v\n{BODY}", {}, V),
    "comment with !": (f"! by hand\n! {H},v\n{BODY}", {}, V),
    "comment with ;": (f"; by hand\n; {H},v\n{BODY}", {}, V),
    "comment with //": (f"// by hand\n// {H},v\n{BODY}", {}, V),
    "comments among the numbers": (f"{H},v\n30,45,180,0.2 # far\n# pause\n% pause\n// pause\n60,0,180,0.1 ! normal\n", {}, V),
    "preamble of key and value": (f"Instrument,GX-1\nPoints,2\nDate,2020-01-01\n\n{H},v\n{BODY}", {}, V),
    "preamble of numbers": (f"# bands\n3\n450 550 650\n{H},v\n{BODY}", {}, V),
    "preamble that speaks of angles": (f"The angle theta i is that of the light, phi that of the view.\nphi = 0\n{H},v\n{BODY}", {}, V),
    "header said twice": (f"# {H},v\n{H},v\n{BODY}", {}, V),
    "header repeated in the table": (f"{H},v\n30,45,180,0.2\n{H},v\n60,0,180,0.1\n", {}, V),
    "row of units": (f"theta_i,theta_o,phi_o,v\n[deg],[deg],[deg],[1/sr]\n{BODY}", {}, V),
    "row of units in radians": (f"theta_i,theta_o,phi_o,v\nrad,rad,rad,sr^-1\n{RAD}", {}, V),
    # Names
    "capitals": (f"Theta_I_Deg,THETA_O_DEG,Phi_O_deg,V\n{BODY}", {}, V),
    "square brackets": (f"theta_i [deg],theta_o [deg],phi_o [deg],v [1/sr]\n{BODY}", {}, V),
    "square brackets and blanks": (f"theta_i [deg] theta_o [deg] phi_o [deg] v\n{BODY}".replace(",", " "), {}, V),
    "round brackets": (f"theta_i(deg),theta_o(deg),phi_o(°),v\n{BODY}", {}, V),
    "slashes": (f"theta_i / deg,theta_o / deg,phi_o / deg,v\n{BODY}", {}, V),
    "Greek": (f"θ_i [°],θ_o [°],φ_o [°],v\n{BODY}", {}, V),
    "words": (f"Incident zenith angle (deg),Viewing zenith angle (deg),Relative azimuth (deg),v\n{BODY}", {}, V),
    "words and blanks": ("Theta in (deg)   Theta out (deg)   Phi out (deg)   v\n30  45  180  0.2\n60 0 180  0.1\n", {}, V),
    "two azimuths": ("theta_i_deg,phi_i_deg,theta_r_deg,phi_r_deg,v\n30,90,45,270,0.2\n60,90,0,270,0.1\n", {"turn": 90}, V),
    "radians": (f"theta_i_rad,theta_o_rad,phi_o_rad,v\n{RAD}", {}, V),
    "degrees by their size": (f"theta_i,theta_o,phi_o,v\n{BODY}", {}, V),
    "remote sensing": (f"sza_deg,vza_deg,raa_deg,v\n{BODY}", {}, V),
    "detector": (f"angle of incidence [deg],detector angle [deg],azimuth [deg],v\n{BODY}", {}, V),
    "vectors": (f"wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,v\n{VECTORS}", {}, V),
    "short vectors": (f"ix iy iz ox oy oz v\n{VECTORS}".replace(",", " "), {}, V),
    "signed, in a plane": ("theta_i_deg,theta_o_deg,v\n30,-45,0.2\n60,0,0.1\n", {}, V),
    "signed light": ("theta_i_deg,theta_o_deg,v\n-30,45,0.2\n-60,0,0.1\n", {"turn": 180}, V),
    "aspecular": ("theta_i_deg,aspecular_deg,v\n30,-15,0.2\n60,60,0.1\n", {}, V),
    "number of the line": (f"no,{H},v\n1,30,45,180,0.2\n2,60,0,180,0.1\n", {}, V),
    "Astm": (f"FORMAT ASTM\nVARS theta_i,theta_s,phi_s,v\n{RAD}", {}, V),
    "luminance": (f"{H},Luminance\n{BODY}", {}, ("luminance",)),
    "one wavelength": (f"{H},632.8 nm\n{BODY}", {}, ("632.8nm",)),
    "bare wavelength": (f"{H},550\n{BODY}", {}, ("550nm",)),
    "micrometres": (f"{H},wavelength [um],brdf\n30,45,180,0.55,0.2\n60,0,180,0.55,0.1\n", {}, ("550nm",)),
    "a channel by word": (f"{H},value_band 3\n{BODY}", {}, ("band 3",)),
    # What the caller says
    "columns": (BODY, {"columns": [*H.split(","), "v"]}, V),
    "columns and preamble": (f"x,1\nabc\n1 2 3\n{BODY}", {"columns": [*H.split(","), "anything"]}, ("anything",)),
    "columns with text between": ("a,30,45,x,180,0.2\nb,60,0,y,180,0.1\n", {"columns": ["-", *H.split(",")[:2], "-", "phi_o_deg", "v"]}, V),
    "ignore": (f"{H},temperature,v\n30,45,180,20.5,0.2\n60,0,180,20.6,0.1\n", {"ignore": ["temperature"]}, V),
    "ignore text": (f"{H},comment,v\n30,45,180,good,0.2\n60,0,180,\"so, so\",0.1\n", {"ignore": ["Comment"]}, V),
    "set": ("theta_i_deg,theta_o_deg,v\n30,45,0.2\n60,0,0.1\n", {"set": {"phi_o_deg": 180}}, V),
    "scale": (f"{H},reflectance\n30,45,180,0.4\n60,0,180,0.2\n", {"scale": 0.5}, ("reflectance",)),
    "percent": (f"{H},v [%]\n30,45,180,20\n60,0,180,10\n", {"scale": 0.01}, V),
    "cosine": (f"{H},brdf*cos\n30,45,180,{0.2 * np.sqrt(0.5)}\n60,0,180,0.1\n", {"cosine": True}, ("brdf*cos",)),
    "mirror at 0": (f"{H},v\n30,45,0,0.2\n60,0,0,0.1\n", {"phi_offset": 180}, V),
    "keep": (f"{H},v\n{BODY}89,45,180,5\n", {"keep": "theta_i<=85"}, V),
}  # fmt: skip

REFUSED = {
    "no header": (BODY, {}, "no header .* line 1: '30,45,180,0.2'. Name the columns, as in columns="),
    "names that say nothing": (f"a,b,c,d\n{BODY}", {}, "no header .* line above the numbers: 'a,b,c,d'"),
    "small angles without unit": ("theta_i,theta_o,phi_o,v\n1,0.5,3,0.2\n", {}, "column theta_i must say its unit: call it theta_i_deg"),
    "gons": (f"theta_i [gon],theta_o [gon],phi_o [gon],v\n{BODY}", {}, "column theta_i .* unit 'gon' is neither deg nor rad"),
    "units that differ": (f"{H},v\nrad,rad,rad,1/sr\n{BODY}", {}, "column theta_i_deg: the line below says rad. Correct one"),
    "degrees called radians": (f"theta_i_rad,theta_o_rad,phi_o_rad,v\n{BODY}", {}, "theta_i_rad must lie within 1.570796 .* got 60"),
    "unsigned, in a plane": ("theta_i_deg,theta_o_deg,v\n30,45,0.2\n60,0,0.1\n", {}, "no azimuth, .*--set phi_o_deg=180"),
    "angle in the preamble": ("theta_i = 30 deg\ntheta_o_deg,v\n-45,0.2\n0,0.1\n", {}, "without theta_i. If it is one angle"),
    "no values": (f"{H}\n30,45,180\n", {}, "expected a column of values beside the directions"),
    "reflectance": (f"{H},reflectance\n{BODY}", {}, "column reflectance is not a BRDF in 1/sr .*--scale 0.3183"),
    "percent": (f"{H},v [%]\n{BODY}", {}, r"column v \[%\] is in percent, .*--scale 0.003183"),
    "another unit": (f"{H},v [cd/m2]\n{BODY}", {}, r"column v \[cd/m2\] is in cd/m2, not in 1/sr"),
    "times cosine": (f"{H},ccbrdf\n{BODY}", {}, "column ccbrdf holds the cosine by its name: say cosine=True"),
    "transmission": (f"{H},btdf\n{BODY}", {}, "column btdf holds transmitted light"),
    "place on the sample": (f"{H},x,y,v\n30,45,180,1,2,0.2\n", {}, "column x may be a tristimulus value"),
    "place beside a value": (f"{H},y,v\n30,45,180,1,0.2\n", {}, "column y may be a tristimulus value, without the other two, or a place"),
    "radius beside a value": (f"{H},r,v\n30,45,180,1,0.2\n", {}, "column r may be a colour, without the other two, or a place"),
    "azimuths that may be either": ("theta_i,theta_o,phi_o,v\n30,45,3.14159,0.2\n", {}, "column phi_o must say its unit: its angles may be"),
    "temperature": (f"{H},temperature,v\n30,45,180,20,0.2\n", {}, "column temperature is no reflectance.*--ignore temperature"),
    "polarisation": (f"{H},brdf_s,brdf_p\n30,45,180,20,0.2\n", {}, "column brdf_s is of no known meaning"),
    "two of one": (f"{H},theta_r_deg,v\n30,45,180,45,0.2\n", {}, "column theta_r_deg is there twice: theta_o_deg means the same"),
    "angles and vectors": (f"{H},wi_x,v\n30,45,180,0.5,0.2\n", {}, "expected angles or vectors, got both"),
    "thousands": (f"{H};v\n30;45;180;1.234,5\n".replace(",p", ";p").replace(",t", ";t"), {}, r"'1.234,5'|1\.234,5"),
    "both decimal marks": (f"{H};v\n30;45;180;0,2\n60;0;180;0.1\n".replace("g,", "g;"), {}, "line 3, column v: '0.1' has another decimal mark"),
    "text for a number": (f"{H},v\n30,45,180,bright\n", {}, "not a table of numbers|'bright' is not a number"),
    "text further down": (f"{H},v\n{BODY}30,45,180,bright\n", {}, "line 4, column v: 'bright' is not a number"),
    "below the limit": (f"{H},v\n{BODY}30,45,180,<0.01\n", {}, "line 4, column v: '<0.01' is not a number"),
    "percent in a cell": (f"{H},v\n{BODY}30,45,180,12 %\n", {}, "line 4, column v: '12 %' is in percent"),
    "cut off": (f"{H},v\n{BODY}30,45\n", {}, "line 4 has 2 cells, not 4 as the others: '30,45'. Is it cut off"),
    "too many cells": (f"{H},v\n{BODY}30,45,180,1,2\n", {}, "line 4 has 5 cells, not 4"),
    "two tables": (f"{H},v\n{BODY}Second sample\n{BODY}", {}, "line 4 stands between lines of numbers: 'Second sample'"),
    "row names of R": (f"{H},v\n1,30,45,180,0.2\n2,60,0,180,0.1\n", {}, "4 names of columns, but 5 columns in line 2"),
    "below the horizon": (f"{H},v\n30,135,0,0.2\n", {}, "no sample is left: all are below the horizon, the first in line 2"),
    "not unit vectors": ("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,v\n0,0,2,0,0,1,2\n", {}, "must be unit vectors, got norm 2"),
    "half of the vectors": ("wi_x,wi_y,wi_z,v\n0,0,1,2\n", {}, "got vectors without wo_x, wo_y, wo_z"),
    "aspecular and azimuth": ("theta_i_deg,aspecular_deg,phi_o_deg,v\n30,15,180,2\n", {}, "theta_i and an aspecular angle alone"),
    "two azimuths of the view": (f"{H},phi_deg,v\n30,15,180,90,2\n", {}, "expected one azimuth of the view, got phi_deg, phi_o_deg"),
    "columns that are too few": (BODY, {"columns": ["theta_i_deg", "v"]}, "2 names of columns, but 4 columns in line 1: '30,45,180,0.2'"),
    "index among the columns": (BODY, {"columns": ["theta_i_deg", "theta_o_deg", "temperature", "v"]}, "column temperature is no reflectance"),
    "ignore what is not there": (f"{H},v\n{BODY}", {"ignore": ["w"]}, "there is no column 'w' to ignore; got the columns theta_i_deg"),
    "set what is there": (f"{H},v\n{BODY}", {"set": {"phi_r_deg": 0}}, "column phi_r_deg is there twice: phi_o_deg means the same"),
    "keep nothing": (f"{H},v\n{BODY}", {"keep": "theta_o>80"}, "no sample satisfies keep"),
    "keep nonsense": (f"{H},v\n{BODY}", {"keep": "brightness<1"}, "'keep' must be comparisons such as 'theta_o<=85'"),
    "wavelengths in metres": (f"{H},wavelength [m],v\n30,45,180,5e-7,0.2\n", {}, "must hold wavelengths in nm or um"),
    "two values of a wavelength": (f"{H},wavelength,v,f\n30,45,180,500,0.2,0.1\n", {}, "a column of wavelengths goes with one column"),
    "only words": ("Copyright notice.\nAll rights reserved.\n", {}, "no samples: expected lines of numbers"),
}  # fmt: skip


@pytest.fixture
def write(tmp_path):
    def to_file(text):
        path = tmp_path / "scan.csv"
        path.write_bytes(text.encode())
        return path

    return to_file


def turned(w, degrees):
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return w @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("name", READ)
def test_read(write, name):
    text, options, channels = READ[name]
    options = dict(options)
    turn = options.pop("turn", 0.0)
    samples = read(write(text), **options)
    assert tuple(samples.channels) == channels
    assert_allclose(samples.wi, turned(WI, turn), atol=2e-5)
    assert_allclose(samples.wo, turned(WO, turn), atol=2e-5)
    assert_allclose(samples.values, [[0.2], [0.1]], rtol=1e-12)
    assert samples.weights is None


@pytest.mark.parametrize("name", REFUSED)
def test_refused(write, name):
    text, options, message = REFUSED[name]
    path = write(text)
    with pytest.raises(ValueError, match=message) as error:
        read(path, **options)
    if name not in ("keep nonsense",):
        assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    "missing",
    ["", "NA", "n/a", "NaN", "nan", "null", "-", "--", ".", "1.#QNAN", "-1.#IND", "#N/A", "#DIV/0!"],
)
def test_a_cell_without_a_value(write, missing):
    samples = read(write(f"{H},r,g\n30,45,180,0.2,0.3\n60,0,180,{missing},0.1\n"))
    assert_allclose(samples.values, [[0.2, 0.3], [np.nan, 0.1]])


@pytest.mark.parametrize("infinite", ["inf", "-inf", "Infinity", "1.#INF", "-1.#INF", "∞"])
def test_an_infinite_value_is_invalid(write, infinite):
    samples = read(write(f"{H},r,g\n30,45,180,0.2,0.3\n60,0,180,{infinite},0.1\n"))
    assert_allclose(samples.values, [[0.2, 0.3], [np.nan, 0.1]])


@pytest.mark.parametrize("right", ["1.5708", "1.571", "1.57079633"])
def test_a_right_angle_may_be_printed(write, right):
    samples = read(write(f"theta_i_rad,theta_o_rad,phi_o_rad,v\n0.5,{right},3.14159,0.2\n"))
    assert_allclose(samples.wo[0], [-1.0, 0.0, 0.0], atol=3e-4)
    assert samples.wo[0, 2] >= 0.0


def test_samples_below_the_horizon_are_left_out_and_counted(write):
    path = write(f"{H},v\n{BODY}30,91,0,9\n95,10,0,9\nNaN,10,0,9\n")
    with pytest.warns(ReadWarning) as told:
        samples = read(path)
    assert len(samples) == 2
    assert [str(w.message) for w in told] == [
        "scan: 1 of 5 samples are without a direction and left out, the first in line 6.",
        "scan: 2 of 5 samples are below the horizon and left out, the first in line 4.",
    ]


def test_wavelengths_may_be_kept(write):
    text = f"{H},wavelength,v\n" + "".join(f"30,45,180,{nm},{nm / 1000}\n" for nm in (400, 500, 600))
    samples = read(write(text), keep=["wavelength>=450", "wavelength<600"])
    assert tuple(samples.channels) == ("500nm",)


# What the numbers say


def plane(value, theta_i=(20, 45, 60), theta_o=range(-80, 81, 5)):
    lines = [f"{i},{o},0,{value(i, o):.6g}" for i in theta_i for o in theta_o]
    return "\n".join([f"{H},v", *lines])


def glossy(i, o):
    return 0.05 + 2.0 * np.exp(-(((i + o) / 12.0) ** 2))


DOUBTFUL = {
    "mirrored": (lambda i, o: glossy(i, -o), "brightest samples are .* on the side of the light.*--phi-offset 180", {"phi_offset": 180}),
    "percent": (lambda _i, _o: 85.0, "far from the mirror direction .* percent, say scale=0.003183", {"scale": 0.003183}),
    "factor": (lambda _i, _o: 0.9, "far from the mirror direction .* reflectance factors, say scale=0.3183", {"scale": 0.3183}),
    "cosine": (lambda _i, o: 0.2 * np.cos(np.deg2rad(o)), "the values fall as the cosine of theta_o does.*--cosine", {"cosine": True}),
}  # fmt: skip


@pytest.mark.parametrize("name", DOUBTFUL)
def test_what_speaks_against_the_convention_is_said(write, name):
    value, message, remedy = DOUBTFUL[name]
    path = write(plane(value))
    with pytest.warns(ReadWarning, match=f"^scan: .*{message}"):
        read(path)
    read(path, **remedy)


@pytest.mark.parametrize("value", [glossy, lambda _i, _o: 0.25, lambda i, o: 0.3 - 0.001 * abs(i + o)])
def test_what_is_in_order_is_read_without_a_word(write, value):
    read(write(plane(value)))


def test_an_anisotropic_sample_is_said(write):
    lines = [f"{i},{p},{i},{p + 180},{0.1 + 0.9 * (p == 0)}" for i in range(10, 80, 5) for p in (0, 90)]
    path = write("\n".join(["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,v", *lines]))
    with pytest.warns(
        ReadWarning, match=r"differ by a factor of 3\.16 as the sample is turned: it is anisotropic"
    ):
        read(path)


def test_hints_name_angles_above_the_table(write):
    text = "theta_i: 30 deg\nphi_o = 180\n45,0.2,7\n50,0.1,7\n"
    with pytest.raises(ValueError, match=re.escape("--set theta_i_deg=30 --set phi_o_deg=180")):
        read(write(text))


def test_a_comma_that_may_part_thousands_is_said(write):
    path = write(f"{H},v\n".replace(",", ";") + "30;45;180;1,234\n60;0;180;2,345\n")
    with pytest.warns(
        ReadWarning, match="numbers such as '1,234' are read with a decimal comma. If it parts thousands"
    ):
        assert_allclose(read(path).values, [[1.234], [2.345]])


def test_dialects_are_many():
    assert len(READ) + len(REFUSED) >= 100
