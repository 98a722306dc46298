"""Models as RGL files: read back by our reader, by the published formula, and by stock Mitsuba."""

import numpy as np
import pytest
from by_hand import by_hand
from mitsuba_tools import VARIANT, interaction, vectors

from dsbrdf import fit, material, read
from dsbrdf.export import spectrum
from dsbrdf.export.rgl import write_rgl
from dsbrdf.measured import built_in as materials
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.measured.formats.tensor_file import read_tensor_file
from dsbrdf.model import chi_square

#: Values below are hardly seen, 1/sr.
DARK = 1e-3
NEAR_MIRROR = by_hand([5.0, 0.3], [2e4, 100.0], [0.0, 0.3])
STRETCHED = by_hand([3.0, 0.8, 0.1], [3e3, 300.0, 0.2], [0.6, -0.9, 0.4], tint=(1.0, 1.3, 0.7))
pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
UP_TO_75 = np.deg2rad([0.01, 13.0, 30.0, 52.0, 68.0, 75.0])


def toward(theta):
    return np.array([np.sin(theta), 0.0, np.cos(theta)])


def errors(model, evaluate, theta_i, limit=75.0, n=2000):
    """Errors relative to value + 1e-3/sr, for directions drawn from the model and for even ones."""
    low = np.cos(np.deg2rad(limit))
    rng = np.random.default_rng(2)
    drawn, even = [], []
    for theta in theta_i:
        wi = toward(theta)
        samples = model.sample(np.broadcast_to(wi, (n, 3)), rng)
        directions = chi_square.direction(rng.uniform(low, 1.0, n), 2.0 * np.pi * rng.random(n))
        for result, wo in ((drawn, samples[samples[:, 2] > low]), (even, directions)):
            value = model.eval(wi, wo)
            result.append((np.abs(evaluate(wi, wo) - value) / (value + DARK)).ravel())
    return np.concatenate(drawn), np.concatenate(even)


def assert_close(model, evaluate):
    """What is promised up to 75 degrees: median 0.5 %, 95th percentile 5 %."""
    for relative in errors(model, evaluate, UP_TO_75):
        assert np.median(relative) < 0.005
        assert np.percentile(relative, 95.0) < 0.05


@pytest.fixture
def stock():
    """Mitsuba's `measured` plugin of a file: values without the cosine of one wi and many wo, and the plugin."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant(VARIANT)

    def load(path):
        bsdf = mi.load_dict({"type": "measured", "filename": str(path)})

        def evaluate(wi, wo):
            si = interaction(np.broadcast_to(wi, wo.shape))
            return np.array(bsdf.eval(mi.BSDFContext(), si, vectors(wo))).T / wo[:, 2:]

        return evaluate, bsdf

    return load


@pytest.mark.parametrize("name", materials.names())
def test_stock_mitsuba_agrees_with_the_model(name, stock, tmp_path):
    model = fit(material(name), 3).model
    write_rgl(model, tmp_path / "x.bsdf")
    assert (tmp_path / "x.bsdf").stat().st_size < 10e6
    assert_close(model, stock(tmp_path / "x.bsdf")[0])


@pytest.mark.shared
@pytest.mark.parametrize("name", ["nickel", "specular-blue-phenolic", "orange-paint"])
def test_decoded_materials(name, decoded, tmp_path):
    model = fit(read(decoded(name))).model
    write_rgl(model, tmp_path / "x.bsdf")
    assert_close(model, read_rgl(tmp_path / "x.bsdf").eval)


@pytest.mark.parametrize("model", [NEAR_MIRROR, STRETCHED], ids=["near-mirror", "azimuth"])
def test_narrow_models(model, stock, tmp_path):
    write_rgl(model, tmp_path / "x.bsdf")
    assert_close(model, read_rgl(tmp_path / "x.bsdf").eval)
    assert_close(model, stock(tmp_path / "x.bsdf")[0])


@pytest.mark.parametrize("model", [NEAR_MIRROR, STRETCHED], ids=["near-mirror", "azimuth"])
def test_what_stock_mitsuba_samples(model, stock, tmp_path):
    """The mean weight is the albedo, and weights hardly vary but for colour."""
    import mitsuba as mi

    write_rgl(model, tmp_path / "x.bsdf")
    _, bsdf = stock(tmp_path / "x.bsdf")
    n = 200_000
    for degrees in (0.01, 45.0, 75.0):
        theta = np.deg2rad(degrees)
        numbers = np.random.default_rng(3).random((3, n), dtype=np.float32)
        si = interaction(np.broadcast_to(toward(theta), (n, 3)))
        _, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(numbers[0]), mi.Point2f(numbers[1:]))
        weight = np.array(weight).T
        np.testing.assert_allclose(weight.mean(0), model.albedo(theta), atol=1e-3, rtol=5e-3)
        assert (weight >= 0.0).all()
        assert weight.mean(1).std() < 0.35 * weight.mean()


def test_values_beyond_75_degrees(tmp_path):
    """Less precise toward grazing: the tables' steps in theta_i."""
    model = fit(material("satin-plastic"), 3).model
    write_rgl(model, tmp_path / "x.bsdf")
    drawn, _ = errors(model, read_rgl(tmp_path / "x.bsdf").eval, np.deg2rad([80.0, 85.0]), 88.0)
    assert np.median(drawn) < 0.01
    assert np.percentile(drawn, 95.0) < 0.15


# The spectral form


def published_formula(fields, wi, wo):
    """One value (wavelength,) of Dupuy and Jakob's evaluation, scalar and step by step, at a node of theta_i."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    row = int(np.argmin(np.abs(fields["theta_i"] - np.arccos(wi[2]))))
    u = np.sqrt(2.0 * np.arccos(min(half[2], 1.0)) / np.pi)
    v = np.arctan2(half[1], half[0]) / (2.0 * np.pi) + 0.5
    density = fields["vndf"][0, row].astype(float)
    # Share of the density below v, and of the row at v left of u, by brute force
    fine = 4001
    nodes_v, nodes_u = (np.linspace(0.0, 1.0, n) for n in density.shape)
    marginal = np.interp(np.linspace(0.0, 1.0, fine), nodes_v, np.trapezoid(density, nodes_u, axis=1))
    at_v = np.array([np.interp(v, nodes_v, column) for column in density.T])
    along = np.interp(np.linspace(0.0, 1.0, fine), nodes_u, at_v)

    def share(values, x):
        steps = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
        return np.interp(x, np.linspace(0.0, 1.0, fine), steps) / steps[-1]

    t, s = share(marginal, v), share(along, u)
    table = fields["spectra"][0, row].astype(float)
    y, x = t * (table.shape[1] - 1), s * (table.shape[2] - 1)
    j, i = int(y), int(x)
    b, a = y - j, x - i
    cell = table[:, j : j + 2, i : i + 2]
    value = np.einsum("lji,j,i", cell, [1.0 - b, b], [1.0 - a, a])
    ndf = np.interp(u, np.linspace(0.0, 1.0, fields["ndf"].shape[1]), fields["ndf"][0])
    place = np.sqrt(2.0 * np.arccos(wi[2]) / np.pi)
    sigma = np.interp(place, np.linspace(0.0, 1.0, fields["sigma"].shape[1]), fields["sigma"][0])
    return value * ndf / (4.0 * sigma) / wo[2]


def test_the_spectral_form_by_the_published_formula(tmp_path):
    model = STRETCHED
    write_rgl(model, tmp_path / "x.bsdf", form="spectral")
    assert (tmp_path / "x.bsdf").stat().st_size < 10e6
    fields = read_tensor_file(tmp_path / "x.bsdf")
    rng = np.random.default_rng(4)
    off = []
    for row in (5, 20, 35):
        wi = toward(float(fields["theta_i"][row]))
        for wo in model.sample(np.broadcast_to(wi, (40, 3)), rng):
            if wo[2] > 0.26:
                expected = spectrum.BASIS @ model.eval(wi, wo)
                off.append(published_formula(fields, wi, wo) / expected - 1.0)
    assert len(off) > 40
    assert np.median(np.abs(off)) < 0.005
    assert np.percentile(np.abs(off), 95.0) < 0.05


def test_the_spectral_form_in_our_reader(tmp_path):
    write_rgl(NEAR_MIRROR, tmp_path / "x.bsdf", form="spectral")
    table = read_rgl(tmp_path / "x.bsdf")
    np.testing.assert_allclose(table.wavelengths, spectrum.WAVELENGTHS)
    # Back to the colours that the spectra were made of
    to_rgb = np.linalg.pinv(spectrum.BASIS).T
    assert_close(NEAR_MIRROR, lambda wi, wo: table.eval(wi, wo) @ to_rgb)


def test_spectral_mitsuba_takes_the_spectral_form(tmp_path):
    import mitsuba as mi

    write_rgl(STRETCHED, tmp_path / "x.bsdf", form="spectral", n_theta_i=8, n_values=8)
    mi.set_variant("scalar_spectral")
    mi.load_dict({"type": "measured", "filename": str(tmp_path / "x.bsdf")})
    mi.set_variant("scalar_rgb")
    with pytest.raises(RuntimeError):
        mi.load_dict({"type": "measured", "filename": str(tmp_path / "x.bsdf")})


def test_spectra_are_those_of_sane_reflectances():
    assert spectrum.BASIS.min() >= 0.0
    np.testing.assert_allclose(spectrum.BASIS.sum(1), 1.0, atol=1e-12)


def test_a_colour_comes_back_through_its_spectrum():
    """By the tables of the CIE in Mitsuba, with the matrix of sRGB rather than that of the optimisation."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    wavelength = np.arange(360.0, 830.5)
    observer = np.array([mi.cie1931_xyz(float(w)) for w in wavelength]).T
    light = observer * np.array([mi.cie_d65(float(w)) for w in wavelength])
    spectra = np.stack([np.interp(wavelength, spectrum.WAVELENGTHS, b) for b in spectrum.BASIS.T])
    xyz = light @ spectra.T / light[1].sum()
    rgb = np.array([mi.xyz_to_srgb(mi.Color3f(*column)) for column in xyz.T]).T
    np.testing.assert_allclose(rgb, np.eye(3), atol=5e-4)


# What cannot be written


def test_what_is_no_colour_is_refused(tmp_path):
    class OneChannel:
        def eval(self, wi, wo):
            return np.ones((*np.broadcast_shapes(np.shape(wi), np.shape(wo))[:-1], 1))

    with pytest.raises(ValueError, match=r"an RGL file has 3 channels, linear sRGB; the model has 1\. Make"):
        write_rgl(OneChannel(), tmp_path / "x.bsdf")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"form": "xyz"}, r"'form' must be 'rgb' or 'spectral', got 'xyz'\."),
        ({"n_values": 1}, r"'n_theta_i' and 'n_values' must be at least 2, got 64 and 1\."),
    ],
)
def test_bad_options(options, text, tmp_path):
    with pytest.raises(ValueError, match=text):
        write_rgl(NEAR_MIRROR, tmp_path / "x.bsdf", **options)


def test_anything_with_values_can_be_written(tmp_path):
    class Grey:
        def eval(self, wi, wo):
            return np.full((*np.broadcast(wi, wo).shape[:-1], 3), 0.2)

    write_rgl(Grey(), tmp_path / "x.bsdf", n_theta_i=8, n_values=16)
    rng = np.random.default_rng(0)
    wo = chi_square.direction(rng.uniform(0.3, 1.0, 500), 2.0 * np.pi * rng.random(500))
    np.testing.assert_allclose(read_rgl(tmp_path / "x.bsdf").eval(toward(0.5), wo), 0.2, rtol=0.03)


def test_black_can_be_written(tmp_path):
    write_rgl(by_hand([1e-30], [1.0], [0.0]), tmp_path / "x.bsdf", n_theta_i=4, n_values=8)
    assert np.abs(read_rgl(tmp_path / "x.bsdf").eval(toward(0.4), toward(-0.3))).max() < 1e-29
