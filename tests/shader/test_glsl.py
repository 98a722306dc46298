"""The model as GLSL: run by headless Chromium, it agrees with Python."""

import re

import numpy as np
import pytest
from browser import run_glsl
from chi2 import cell_integrals, p_value, sidak
from pairs import DECODED, TINY, random_pairs

import dsbrdf
from dsbrdf import shader
from dsbrdf.export import export
from dsbrdf.export.brdf_explorer import write_brdf_explorer
from dsbrdf.measured import built_in

#: Any parameters will do here.
pytestmark = pytest.mark.filterwarnings("ignore:.*out of iterations")


@pytest.fixture(scope="module")
def page(browser):
    return browser.new_page()


@pytest.fixture(scope="module")
def fitted():
    """Call with a name: the fit of a built-in material with three lobes."""
    models = {}

    def fit(name):
        if name not in models:
            models[name] = dsbrdf.fit(dsbrdf.material(name), n_lobes=3).model
        return models[name]

    return fit


def assert_equal_to_python(page, model, rng):
    wi, wo = random_pairs(rng)
    got = run_glsl(
        page, shader.baked(model), "vec4(dsbrdf_eval(a.xyz, b.xyz), dsbrdf_pdf(a.xyz, b.xyz))", wi, wo
    )
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)
    np.testing.assert_allclose(got[:, 3], model.pdf(wi, wo), rtol=1e-3)


@pytest.mark.parametrize("name", built_in.names())
def test_values_and_densities(page, fitted, rng, name):
    assert_equal_to_python(page, fitted(name), rng)


@pytest.mark.shared
@pytest.mark.parametrize("name", DECODED)
def test_values_and_densities_of_decoded_materials(page, decoded, rng, name):
    assert_equal_to_python(page, dsbrdf.fit(dsbrdf.read(decoded(name)), n_lobes=3).model, rng)


def test_spike_and_uneven_slices(page, rng):
    shape = (4, 3, 2)
    model = dsbrdf.DSBRDF(
        theta_d=[0.1, 0.15, 0.9, 1.2],
        kappa=rng.uniform(0.01, 9.0, shape),
        gamma=10.0 ** rng.uniform(-2.0, 4.5, shape),
        beta=rng.uniform(-0.9, 0.9, shape),
        spike=rng.uniform(0.0, 50.0, shape[:2]),
    )
    assert_equal_to_python(page, model, rng)


def test_one_slice(page, rng):
    model = dsbrdf.DSBRDF(theta_d=[0.3], kappa=[[[2.0]] * 3], gamma=[[[50.0]] * 3], beta=[[[0.5]] * 3])
    assert_equal_to_python(page, model, rng)


def test_zero_below_the_horizon(page, fitted):
    up, down = np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.6, -0.8]])
    for wi, wo in ((up, down), (down, up)):
        got = run_glsl(
            page,
            shader.baked(fitted("matte")),
            "vec4(dsbrdf_eval(a.xyz, b.xyz), dsbrdf_pdf(a.xyz, b.xyz))",
            wi,
            wo,
        )
        np.testing.assert_array_equal(got, 0.0)


def draw(page, model, wo, rng, n):
    u = rng.random((n, 3), dtype=np.float32)
    return run_glsl(
        page, shader.baked(model), "vec4(dsbrdf_sample(a.xyz, b.xyz), 1.0)", np.tile(wo, (n, 1)), u
    )[:, :3]


SAMPLED = ("rough-gold", "satin-plastic")
ANGLES = (0.0, 60.0, 80.0)


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("name", SAMPLED)
def test_samples_follow_the_density(page, fitted, rng, name, angle):
    model = fitted(name)
    wo = np.array([np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))])
    drawn = draw(page, model, wo, rng, 200_000)
    np.testing.assert_allclose((drawn**2).sum(-1), 1.0, atol=1e-5)
    mass = cell_integrals(lambda wi: model.pdf(wi, wo), wo * [-1.0, -1.0, 1.0])
    assert p_value(drawn, mass) > sidak(0.01, len(SAMPLED) * len(ANGLES))


def test_samples_of_a_mirror_and_of_a_spike(page, rng):
    """Where a cell of directions is too wide: theta_h of half vectors, against the hemi-EPD and the cap."""
    from scipy import stats

    from dsbrdf import hemi_epd
    from dsbrdf.paper import spike

    kappa, gamma, wo = 8.0, 20000.0, np.array([0.0, 0.0, 1.0])
    lobe = dsbrdf.DSBRDF(theta_d=[0.1], kappa=[[[kappa]] * 3], gamma=[[[gamma]] * 3], beta=[[[0.0]] * 3])
    only_spike = lobe.replace(kappa=np.full((1, 3, 1), 1e-12), spike=np.full((1, 3), 100.0))

    def tilts(model):
        drawn = draw(page, model, wo, rng, 200_000)
        half = drawn + wo
        theta_h = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
        return theta_h[theta_h < 0.05]

    assert stats.kstest(tilts(lobe), lambda x: hemi_epd.cdf(x, kappa, gamma)).pvalue > 0.001
    width = np.sqrt(spike.SIN2_WIDTH)
    within = tilts(only_spike)
    within = within[np.sin(within) < width]
    assert stats.kstest(np.sin(within) ** 2 / spike.SIN2_WIDTH, lambda x: 1.0 - (1.0 - x) ** 2).pvalue > 0.001


def as_brdf_explorer_reads(text):
    """The shader section of a `.brdf` file as the program reads it: no blank lines, none that begin with #."""
    lines = [line for line in text.splitlines() if line.strip() and not line.strip().startswith("#")]
    assert lines[0].split()[0] == "analytic"
    sections, current = {}, None
    for line in lines[1:]:
        words = line.split()
        if words[0] == "::begin":
            assert current is None
            current = words[1]
            sections[current] = []
        elif words[0] == "::end":
            assert words[1] == current
            current = None
        else:
            sections[current].append(line)
    assert current is None
    assert sections["parameters"] == []
    return "\n".join(sections["shader"])


def test_brdf_explorer(page, fitted, rng, tmp_path):
    """The text compiles where the program's templates put it, behind uniforms of theirs, and gives our values."""
    model = fitted("rough-copper").replace(name="two\n::end shader")
    write_brdf_explorer(model, tmp_path / "model.brdf")
    source = as_brdf_explorer_reads((tmp_path / "model.brdf").read_text())
    before = "uniform float gamma;\nuniform float brightness;\nuniform float exposure;\nuniform vec3 incidentVector;\n"
    wi, wo = random_pairs(rng, 2000)
    # The frame turned: normal +x, tangent +y, bitangent +z
    turned = [w[:, [2, 0, 1]] for w in (wi, wo)]
    call = "vec4(BRDF(a.xyz, b.xyz, vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1)), 1.0)"
    got = run_glsl(page, before + source, call, *turned)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)


def test_glsl_file(page, fitted, rng, tmp_path):
    model = fitted("rough-copper").replace(name="of two\nlines")
    export(model, tmp_path / "model.glsl", "glsl")
    text = (tmp_path / "model.glsl").read_text()
    assert text.startswith("// of two lines\n")
    wi, wo = random_pairs(rng, 100)
    got = run_glsl(page, text, "vec4(dsbrdf_eval(a.xyz, b.xyz), 1.0)", wi, wo)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)


def test_names_of_the_source_have_a_prefix(fitted):
    """So that a file can be put into any program."""
    text = re.sub(r"//.*", "", shader.baked(fitted("matte")))
    declared = re.findall(r"^(?:const )?(?:int|float|bool|vec3|struct|dsbrdf_\w+) (\w+)", text, re.MULTILINE)
    assert len(declared) > 20
    assert all(name.lower().startswith("dsbrdf_") for name in declared)


@pytest.mark.parametrize("format", ["glsl", "brdf"])
def test_refuses_models_that_are_not_rgb(fitted, tmp_path, format):
    model = fitted("matte")
    two = model.replace(**{key: getattr(model, key)[:, :2] for key in ("kappa", "gamma", "beta", "spike")})
    with pytest.raises(ValueError, match="a shader has 3 channels, linear sRGB; the model has 2"):
        export(two, tmp_path / "file", format)
    assert not list(tmp_path.iterdir())
