"""`tensor_file` and `rgl` of `dsbrdf.measured.formats`: the container, the evaluation, and bad input."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsbrdf import fit, half_diff, read, write_merl
from dsbrdf.measured.formats.rgl import MAX_THETA, RGLReflectance, read_rgl
from dsbrdf.measured.formats.tensor_file import DTYPES, read_tensor_file, write_tensor_file

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "rgl.json").read_text())
THETA_I = np.array([0.0, 0.5, 1.1, 1.57])
ANGLE = st.floats(0.0, np.pi / 2)


def direction(theta, phi):
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def random_directions(seed, *shape):
    rng = np.random.default_rng(seed)
    return direction(np.arccos(rng.uniform(0, 1, shape)), rng.uniform(-np.pi, np.pi, shape))


def mirrored(wi, half):
    return 2 * np.sum(wi * half, axis=-1, keepdims=True) * half - wi


def square_nodes(nodes):
    return np.meshgrid(np.linspace(0, 1, nodes), np.linspace(0, 1, nodes), indexing="ij")


def uniform_fields(nodes=5, theta_i=THETA_I):
    """A valid file: uniform densities, which make the warp the identity, and values 1."""
    return {
        "description": np.frombuffer(b"synthetic", np.uint8),
        "phi_i": np.zeros(1),
        "theta_i": np.array(theta_i),
        "sigma": np.full((2, 4), 0.8),
        "ndf": np.full((2, 4), 0.6),
        "vndf": np.ones((1, len(theta_i), nodes, nodes)),
        "rgb": np.ones((1, len(theta_i), 3, nodes, nodes)),
        "jacobian": np.ones(1, np.uint8),
    }


def lambertian_fields(albedo, nodes=9):
    """A Lambertian surface in the encoding of the format, with a D and a sigma that vary."""
    fields = uniform_fields(nodes)
    fields["ndf"] = np.tile(np.linspace(3.0, 0.2, 7), (2, 1))
    fields["sigma"] = np.tile(np.linspace(1.0, 0.3, 9), (2, 1))
    v, u = square_nodes(nodes)
    half = direction(np.pi / 2 * u**2, 2 * np.pi * v - np.pi)
    d = np.interp(u, np.linspace(0, 1, 7), fields["ndf"][0])
    for k, theta_i in enumerate(THETA_I):
        sigma = np.interp(np.sqrt(2 * theta_i / np.pi), np.linspace(0, 1, 9), fields["sigma"][0])
        cos_o = mirrored(direction(theta_i, 0.0), half)[..., 2]
        fields["rgb"][0, k] = np.multiply.outer(np.array(albedo) / np.pi, cos_o * 4 * sigma / d)
    return fields


def written(folder, fields):
    write_tensor_file(folder / "made.bsdf", fields)
    return folder / "made.bsdf"


def small_file(folder):
    """96 bytes: 18 of header, 22 and 30 of fields, and after padding 12 and 8 of data at 72 and 88."""
    return written(folder, {"a": np.arange(3, dtype=np.float32), "b": np.zeros((2, 2), np.uint16)})


def test_round_trip_of_every_type_and_shape(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {f"f{code}": rng.uniform(0, 100, (3, 2)).astype(dtype) for code, dtype in DTYPES.items()}
    arrays |= {"scalar": np.float64(2.5), "é": np.arange(3, dtype=">i4"), "none": np.zeros((0, 3))}
    back = read_tensor_file(written(tmp_path, arrays))
    assert list(back) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == np.asarray(array).dtype.newbyteorder("<")


def test_layout(tmp_path):
    path = written(tmp_path, {"ab": np.array([1.5, -2.0], np.float32)})
    header = b"tensor_file\0" + bytes([1, 0]) + struct.pack("<I", 1)
    field = struct.pack("<H2sHBQQ", 2, b"ab", 1, 10, 48, 2)
    assert path.read_bytes() == header + field + bytes(7) + struct.pack("<2f", 1.5, -2.0)


@pytest.mark.parametrize("value", ["text", True, 1j, None, np.zeros((1,) * 33)])
def test_writer_refuses_what_the_format_lacks(tmp_path, value):
    with pytest.raises(ValueError, match=r"field 'x' must h.*, got .*\. (Convert|Shorten)"):
        written(tmp_path, {"x": value})


def test_every_truncation_and_text_are_refused(tmp_path):
    whole = small_file(tmp_path).read_bytes()
    path = tmp_path / "cut.bsdf"
    for content in [*(whole[:length] for length in range(len(whole))), b"Copyright notice, all in text\n"]:
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"^cut\.bsdf: not an RGL tensor file: expected .*, got .*; \w"):
            read_tensor_file(path)


@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (0, "6s", [b"sensor"], r"the first bytes b'tensor_file\\x00', got b'sensor_file\\x00'; give a"),
        (12, "B", [2], r"expected version 1\.0, got version 2\.0; convert"),
        (14, "I", [2**32 - 1], "at most 6 fields in 96 bytes, got 4,294,967,295 fields"),
        (18, "H", [2**16 - 1], "the name of field 0 at bytes 20 to 65,555, got a file of 96 bytes"),
        (20, "B", [0xFF], "the name of field 0 in UTF-8"),
        (21, "H", [2**16 - 1], "at most 32 axes of field 'a', got 65535"),
        (23, "B", [0], "a type of 1 to 11 for field 'a', got type 0"),
        (23, "B", [12], "a type of 1 to 11 for field 'a', got type 12"),
        (24, "Q", [2**64 - 1], r"field 'a' of shape \(3,\) .* got a file of 96 bytes"),
        (24, "Q", [8], "field 'a' at byte 70 or later, where the header ends, got byte 8"),
        (24, "Q", [80], "field 'b' at byte 92 or later, where field 'a' ends, got byte 88"),
        (32, "Q", [2**64 - 1], r"field 'a' of shape \(18446744073709551615,\) .* got a file of 96 bytes"),
        (54, "QQ", [0, 2**63], r"field 'b' of shape \(0, 9223372036854775808\)"),
        (42, "s", [b"a"], "fields of different names, got 'a' 2 times"),
    ],
)
def test_impossible_headers_are_refused(tmp_path, at, layout, values, message):
    path = small_file(tmp_path)
    content = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, content, at, *values)
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_tensor_file(path)


@settings(deadline=None, max_examples=200)
@given(changes=st.lists(st.tuples(st.integers(0, 95), st.integers(0, 255)), min_size=1, max_size=6))
def test_damaged_files_are_read_or_refused(tmp_path_factory, changes):
    path = small_file(tmp_path_factory.getbasetemp())
    content = bytearray(path.read_bytes())
    for at, value in changes:
        content[at] = value
    path.write_bytes(content)
    try:
        assert sum(array.nbytes for array in read_tensor_file(path).values()) <= len(content)
    except ValueError as error:
        if "not an RGL tensor file" not in str(error):
            raise


def test_lambertian_at_the_nodes_of_the_grid(tmp_path):
    albedo = np.array([0.2, 0.5, 0.9])
    brdf = read_rgl(written(tmp_path, lambertian_fields(albedo)))
    v, u = square_nodes(9)
    wi = direction(THETA_I[1:], 0.0)[:, np.newaxis]
    # The last row, v = 1, is the same half vectors as the first.
    wo = mirrored(wi, direction(np.pi / 2 * u**2, 2 * np.pi * v - np.pi)[:-1].reshape(-1, 3))
    seen = wo[..., 2] > 1e-3
    assert seen.sum() > 50
    value = brdf.eval(wi, wo)[seen]
    np.testing.assert_allclose(value, np.broadcast_to(albedo / np.pi, value.shape), rtol=1e-9)


def test_warp_against_its_closed_form(tmp_path):
    """Densities 1 and (1 + 2u)(2 - v) / 3 have simple integrals, and so has every mixture of the two."""
    fields = uniform_fields(7, theta_i=[0.3, 1.2])
    v, u = square_nodes(7)
    fields["vndf"][0, 1] = 41.0 * (1 + 2 * u) * (2 - v)
    fields["rgb"][0] = np.stack([u, v, np.ones_like(u)])
    fields["jacobian"][0] = 0
    brdf = read_rgl(written(tmp_path, fields))

    rng = np.random.default_rng(2)
    theta, u, phi, v = rng.uniform([[0], [0.05], [-np.pi], [0]], [[1.5], [0.95], [np.pi], [1]], (4, 4000))
    wi, half = direction(theta, phi), direction(np.pi / 2 * u**2, phi + 2 * np.pi * v - np.pi)
    wo = mirrored(wi, half)
    seen = (wo[:, 2] > 1e-3) & (np.sum(wi * half, axis=-1) > 0)
    w = np.clip((theta - 0.3) / 0.9, 0, 1)
    rows = (1 - w) + w * (2 - v) / 1.5
    s = ((1 - w) * u + w * (u + u**2) * (2 - v) / 3) / rows
    t = (1 - w) * v + w * (2 * v - v**2 / 2) / 1.5
    expected = np.stack([s, t, np.ones_like(s)], axis=-1)[seen]
    assert seen.sum() > 1000
    np.testing.assert_allclose(brdf.eval(wi, wo)[seen] * wo[seen, 2:], expected, rtol=1e-9, atol=1e-9)


def test_rows_without_density_stay_finite():
    fields = uniform_fields()
    fields["vndf"][:, :, :3] = 0.0
    fields["vndf"][:, :, :, 3:] = 0.0
    wi, wo = random_directions(3, 2, 2000)
    value = RGLReflectance.from_fields(fields).eval(wi, wo)
    # The values and their weights are constant, so the warp makes no difference.
    np.testing.assert_allclose(value * wo[:, 2:], np.full_like(value, 0.6 / (4 * 0.8)), rtol=1e-12)


def test_spectral_file_of_one_incident_angle_and_two_azimuths(tmp_path):
    spectrum = np.array([0.1, 0.4, 0.2, 0.9])
    fields = uniform_fields(theta_i=[0.4]) | {"phi_i": np.array([0.0, np.pi])}
    fields["wavelengths"] = np.array([400.0, 500.0, 600.0, 700.0], np.float32)
    fields["vndf"] = np.concatenate([fields["vndf"], 5 * fields["vndf"]])
    spectra = spectrum[:, None, None] * fields.pop("rgb")[:, :, :1]
    fields["spectra"] = np.concatenate([spectra, 3 * spectra])
    brdf = read_rgl(written(tmp_path, fields))
    np.testing.assert_array_equal(brdf.wavelengths, fields["wavelengths"])
    assert brdf.description == "synthetic"
    value = brdf.eval(direction([0.1, 0.9, 1.5], 0.2), direction(0.6, [0.0, 1.0, 2.0]))
    np.testing.assert_allclose(value, [2 * spectrum * 0.6 / (4 * 0.8) / np.cos(0.6)] * 3, rtol=1e-12)


@settings(deadline=None, max_examples=100)
@given(ANGLE, ANGLE, st.floats(-3.2, 3.2), st.floats(-10.0, 10.0))
def test_finite_and_isotropic(theta_i, theta_o, phi, turn):
    brdf = RGLReflectance.from_fields(lambertian_fields((0.5, 0.5, 0.5)))
    wi, wo = direction(theta_i, 0.0), direction(theta_o, phi)
    value = brdf.eval(wi, wo)
    assert np.isfinite(value).all()
    # At the seam of the azimuth and at the normal the value may jump.
    if min(wi[2], wo[2], theta_i, abs(wo[1])) > 1e-3:
        turned = brdf.eval(direction(theta_i, turn), direction(theta_o, phi + turn))
        np.testing.assert_allclose(turned, value, rtol=1e-6, atol=1e-9)


def test_below_the_horizon_and_at_the_normal():
    brdf = RGLReflectance.from_fields(uniform_fields())
    up, down, side, above = np.array([[0, 0, 1.0], [0, 0, -1], [1, 0, 0], [1, 0, 5e-324]])
    for wi, wo in [(up, down), (down, up), (down, down), (side, up), (up, side), (side, -side)]:
        np.testing.assert_array_equal(brdf.eval(wi, wo), np.zeros(3))
    np.testing.assert_allclose(brdf.eval(up, up), 0.6 / (4 * 0.8))
    assert np.isfinite(brdf.eval(above, above * [-1, 1, 1])).all()


def test_shapes():
    brdf = RGLReflectance.from_fields(lambertian_fields((0.1, 0.2, 0.3)))
    wi, wo = random_directions(4, 20_000, 1), random_directions(5, 2)
    wi[::7] *= -1
    value = brdf.eval(wi, wo)
    assert value.shape == (20_000, 2, 3)
    np.testing.assert_array_equal(value[::7], 0.0)
    np.testing.assert_array_equal(value[-3, 1], brdf.eval(wi[-3, 0], wo[1]))
    assert brdf.eval(np.zeros((0, 3)), wo[0]).shape == (0, 3)
    with pytest.raises(ValueError, match="'wo' must be unit vectors"):
        brdf.eval(wi, [0, 1, 1])


@pytest.mark.parametrize(
    ("key", "at", "value", "message"),
    [
        ("vndf", None, None, "expected a field 'vndf', got the fields 'description', 'phi_i'"),
        ("rgb", None, None, "expected a field 'wavelengths'"),
        ("phi_i", None, np.arange(8.0), "an anisotropic material: expected 1 or 2 azimuths .* got 8; give"),
        ("theta_i", None, [0.0, 0.5, 0.5, 1.0], "rising angles"),
        ("theta_i", None, [0.0, 30.0, 60.0, 90.0], "rising angles of at most pi/2 in field 'theta_i'"),
        ("theta_i", None, np.zeros(0), r"field 'theta_i' of shape \(any\), got shape \(0,\)"),
        ("theta_i", None, 0.1 * np.arange(5), r"field 'rgb' of shape \(1, 5, 3, any, any\), got shape"),
        ("rgb", None, np.ones((1, 4, 3, 1, 1)), "2 or more nodes along the last two axes of field 'rgb'"),
        ("vndf", None, np.ones((1, 4, 8)), r"'vndf' of shape \(1, 4, any, any\), got shape \(1, 4, 8\)"),
        ("vndf", (0, 2, 1, 3), -1.0, r"numbers >= 0 in field 'vndf', got -1 at index \(0, 2, 1, 3\)"),
        ("vndf", (0, 2), 0.0, "a density for each incident angle .* got one that is 0 everywhere"),
        ("rgb", (0, 1, 2, 3, 4), np.nan, r"finite numbers in field 'rgb', got nan at index \(0, 1, 2"),
        ("ndf", (1, 0), np.inf, r"finite numbers >= 0 in field 'ndf', got inf at index \(1, 0\)"),
        ("sigma", (0, 0), 0.0, "in field 'sigma', got 0 at"),
        ("jacobian", None, [1, 1], r"field 'jacobian' of shape \(1\), got shape \(2,\)"),
    ],
)
def test_wrong_fields_are_refused(tmp_path, key, at, value, message):
    fields = uniform_fields()
    if value is None:
        del fields[key]
    elif at is None:
        fields[key] = value
    else:
        fields[key][at] = value
    path = written(tmp_path, fields)
    with pytest.raises(ValueError, match=rf"^made\.bsdf: .*{message}"):
        read_rgl(path)


@pytest.fixture
def rgl_folder():
    root = Path(os.environ.get("DSBRDF_TEST_DATA") or pytest.skip("DSBRDF_TEST_DATA names no folder"))
    return root / "rgl" if (root / "rgl").is_dir() else root / "data" / "rgl"


@pytest.mark.shared
@pytest.mark.parametrize("name", REFERENCE["f_cos"])
def test_against_mitsuba(rgl_folder, name):
    """Mitsuba works in single precision, which costs digits where a value is far below its neighbours."""
    wi, wo = (np.array(REFERENCE[key], np.float32).astype(float) for key in ("wi", "wo"))
    expected = np.array(REFERENCE["f_cos"][name])
    error = np.abs(read_rgl(rgl_folder / name).eval(wi, wo) * wo[:, 2:] - expected)
    relative = error / np.maximum(np.abs(expected), 1e-7)
    assert np.median(relative) < 2e-6
    assert np.quantile(relative, 0.9) < 1e-5
    assert relative.max() < 1e-3
    assert error.sum() < 2e-6 * np.abs(expected).sum()


# As a table, and as a colour


def spectral_fields(wavelengths, spectrum):
    fields = lambertian_fields((0.5, 0.5, 0.5))
    rgb = fields.pop("rgb")
    fields["wavelengths"] = np.asarray(wavelengths, float)
    fields["spectra"] = rgb[:, :, :1] * np.asarray(spectrum, float)[:, None, None]
    return fields


def test_a_table_of_a_lambertian_surface(tmp_path):
    table = read(written(tmp_path, lambertian_fields((0.1, 0.2, 0.3))))
    wi, wo = half_diff.to_directions(table.theta_h[:, None, None], table.theta_d[:, None], table.phi_d)
    kept = (wi[..., 2] >= np.cos(MAX_THETA)) & (wo[..., 2] >= np.cos(MAX_THETA))
    np.testing.assert_array_equal(table.valid.all(-1), kept)
    np.testing.assert_array_equal(table.valid.any(-1), kept)
    # The 9 x 9 nodes of the file are linear in between
    np.testing.assert_allclose(
        np.median(table.values[kept], axis=0), np.array([0.1, 0.2, 0.3]) / np.pi, rtol=0.03
    )
    assert (table.name, table.source.file) == ("made", tmp_path / "made.bsdf")


def test_an_entry_is_the_mean_of_both_orders_and_never_negative(tmp_path):
    fields = lambertian_fields((0.5, 0.4, 0.3))
    rng = np.random.default_rng(3)
    fields["rgb"] *= rng.uniform(-1.0, 1.0, fields["rgb"].shape)
    path = written(tmp_path, fields)
    table, brdf = read(path, convention="edge"), read_rgl(path)
    assert table.convention == "edge"
    at = (np.array([3, 20, 44, 60]), np.array([5, 30, 20, 2]), np.array([0, 40, 100, 179]))
    wi, wo = half_diff.to_directions(table.theta_h[at[0]], table.theta_d[at[1]], table.phi_d[at[2]])
    mean = 0.5 * (brdf.eval(wi, wo) + brdf.eval(wo, wi))
    assert (mean < 0.0).any()
    np.testing.assert_allclose(table.values[at], np.maximum(mean, 0.0), rtol=1e-12)


@pytest.mark.parametrize("wavelengths", [np.arange(360.0, 1000.0, 3.3), [400, 450, 520, 600, 700]])
def test_a_grey_spectrum_is_grey(tmp_path, wavelengths):
    brdf = read_rgl(written(tmp_path, spectral_fields(wavelengths, np.full(len(wavelengths), 0.6))))
    colour = brdf.linear_srgb()
    assert colour.wavelengths is None
    wi, wo = random_directions(1, 50), random_directions(2, 50)
    np.testing.assert_allclose(colour.eval(wi, wo), brdf.eval(wi, wo)[:, :3], rtol=1e-12)
    assert colour.linear_srgb() is colour


@pytest.mark.parametrize(
    ("wavelengths", "message"),
    [
        ([700.0, 400.0], r"wavelengths must be ascending, got \[700. 400.\]"),
        ([550.0], "wavelengths must be ascending"),
        (
            [420.0, 700.0],
            "must cover 410 to 680 nm to make a colour, got 420 to 700 nm. Fit the wavelengths as channels",
        ),
        ([800.0, 900.0, 1000.0], "must cover 410 to 680 nm"),
    ],
)
def test_spectra_that_make_no_colour_are_refused(tmp_path, wavelengths, message):
    path = written(tmp_path, spectral_fields(wavelengths, np.ones(len(wavelengths))))
    with pytest.raises(ValueError, match=f"^{path}: .*{message}"):
        read(path)


def test_an_anisotropic_file_is_refused_by_read(tmp_path):
    path = written(tmp_path, uniform_fields() | {"phi_i": np.arange(8.0)})
    with pytest.raises(ValueError, match=f"^{path}: an anisotropic material: expected 1 or 2 azimuths"):
        read(path)


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCE["f_cos"])
def test_a_fit_by_way_of_a_merl_file_is_the_same(rgl_folder, tmp_path, name):
    table = read(rgl_folder / name)
    write_merl(table, tmp_path / "x.binary")
    direct, by_way = (fit(measured, 3).errors for measured in (table, read(tmp_path / "x.binary")))
    assert by_way.rel == pytest.approx(direct.rel, rel=1e-3)
    assert by_way.bivariate_floor == pytest.approx(direct.bivariate_floor, rel=1e-9)
