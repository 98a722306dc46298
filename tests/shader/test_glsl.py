"""The model as GLSL: run by headless Chromium, it agrees with Python."""

import re

import numpy as np
import pytest
from browser import run_glsl
from by_hand import by_hand
from chi2 import cell_integrals, p_value, sidak
from pairs import DECODED, TINY, random_pairs

import dsbrdf
from dsbrdf import shader
from dsbrdf.export import export
from dsbrdf.export.brdf_explorer import write_brdf_explorer
from dsbrdf.model import sampling
from dsbrdf.model.lobes import Lobes

MODELS = {
    "matte": by_hand([0.12, 0.02], [0.05, 2.0], [0.0, 0.5], name="matte"),
    "rough-copper": by_hand([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3], tint=(1.2, 0.9, 0.4), name="rough-copper"),
    "plastic": by_hand([2.0, 0.15, 0.4], [300.0, 0.3, 30.0], [0.3, -0.2, 0.1], name="plastic"),
    "mirror": by_hand([8.0, 0.5], [2e4, 300.0], [0.0, 0.0], name="mirror"),
}


def of_sizes(rng, sizes, n_lobes=3):
    """Curves of these sizes (scale, gamma, beta, falloff, colour) with random coefficients."""
    scale, gamma, beta, falloff, colour = sizes
    return dsbrdf.DSBRDF(
        Lobes(
            rng.uniform(-3.0, 1.5, (n_lobes, scale)),
            rng.uniform(-2.0, 8.0, (n_lobes, gamma)),
            rng.uniform(-0.9, 0.9, (n_lobes, beta)),
            rng.uniform(-0.8, 6.0, (n_lobes, falloff)),
            rng.uniform(-0.5, 0.5, (3, n_lobes, colour)),
        )
    )


@pytest.fixture(scope="module")
def page(browser):
    return browser.new_page()


def assert_equal_to_python(page, model, rng):
    wi, wo = random_pairs(rng)
    got = run_glsl(
        page, shader.baked(model), "vec4(dsbrdf_eval(a.xyz, b.xyz), dsbrdf_pdf(a.xyz, b.xyz))", wi, wo
    )
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)
    np.testing.assert_allclose(got[:, 3], model.pdf(wi, wo), rtol=1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_values_and_densities(page, rng, name):
    assert_equal_to_python(page, MODELS[name], rng)


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore:.*the search ended")
@pytest.mark.parametrize("name", DECODED)
def test_values_and_densities_of_decoded_materials(page, decoded, rng, name):
    assert_equal_to_python(page, dsbrdf.fit(dsbrdf.read(decoded(name))).model, rng)


@pytest.mark.parametrize(
    "sizes", [(1, 1, 1, 1, 1), (2, 2, 2, 2, 2), (3, 3, 3, 3, 3), (6, 4, 3, 1, 2), (4, 7, 1, 6, 8)]
)
def test_curves_of_any_size(page, rng, sizes):
    assert_equal_to_python(page, of_sizes(rng, sizes, n_lobes=1 + sizes[0] % 3), rng)


def test_the_texture_holds_what_is_baked(page):
    """`texture.glsl` reads the same texels from a texture, here as inputs of a draw."""
    model = MODELS["plastic"]
    texels = shader.texels(model.lobes)
    most = max(part.shape[-1] for part in model.lobes.parts)
    assert texels.shape == (2 + 2 * most * model.n_lobes + 3 * sampling.N_ROWS, 4)
    source = (
        shader.sources()["texture"]
        .replace("u_parameters", "u_inputs")
        .replace("uniform sampler2D u_inputs;", "")
    )
    n = np.arange(len(texels))
    index = np.stack([n, 0 * n, 0 * n, 0 * n], axis=-1).astype(float)
    # Inputs lie in rows of 1024 pixels of two texels, index and texel
    got = run_glsl(page, source, "dsbrdf_texel(2 * int(a.x) + 1)", index, texels)
    np.testing.assert_allclose(got, texels, rtol=1e-6)


def test_shares_are_those_of_python():
    made = sampling.tables(MODELS["mirror"].lobes)
    shares = shader.texels(MODELS["mirror"].lobes)[-3 * sampling.N_ROWS :].reshape(sampling.N_ROWS, -1)
    np.testing.assert_array_equal(shares[:, :-1], made.shares)
    np.testing.assert_allclose(shares.sum(1), 1.0)


def test_zero_below_the_horizon(page):
    up, down = np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.6, -0.8]])
    for wi, wo in ((up, down), (down, up)):
        got = run_glsl(
            page,
            shader.baked(MODELS["matte"]),
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


SAMPLED = ("rough-copper", "plastic")
ANGLES = (0.0, 60.0, 80.0)


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("name", SAMPLED)
def test_samples_follow_the_density(page, rng, name, angle):
    model = MODELS[name]
    wo = np.array([np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))])
    drawn = draw(page, model, wo, rng, 200_000)
    np.testing.assert_allclose((drawn**2).sum(-1), 1.0, atol=1e-5)
    mass = cell_integrals(lambda wi: model.pdf(wi, wo), wo * [-1.0, -1.0, 1.0])
    assert p_value(drawn, mass) > sidak(0.01, len(SAMPLED) * len(ANGLES))


def test_samples_of_a_mirror(page, rng):
    """Where a cell of directions is too wide: theta_h of half vectors, against the density at normal incidence."""
    from scipy import stats

    model, wo = MODELS["mirror"], np.array([0.0, 0.0, 1.0])
    half = draw(page, model, wo, rng, 200_000) + wo
    theta_h = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
    near = theta_h[theta_h < 0.05]
    edges = np.linspace(0.0, 0.05, 2001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    wi = np.stack([np.sin(2.0 * middle), 0.0 * middle, np.cos(2.0 * middle)], axis=-1)
    mass = np.cumsum(model.pdf(wi, wo) * np.sin(2.0 * middle))
    assert stats.kstest(near, lambda x: np.interp(x, edges[1:], mass / mass[-1], left=0.0)).pvalue > 0.001
    assert len(near) / len(half) > 0.5


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


def test_brdf_explorer(page, rng, tmp_path):
    """The text compiles where the program's templates put it, behind uniforms of theirs, and gives our values."""
    model = MODELS["rough-copper"].replace(name="two\n::end shader")
    write_brdf_explorer(model, tmp_path / "model.brdf")
    source = as_brdf_explorer_reads((tmp_path / "model.brdf").read_text())
    before = "uniform float gamma;\nuniform float brightness;\nuniform float exposure;\nuniform vec3 incidentVector;\n"
    wi, wo = random_pairs(rng, 2000)
    # The frame turned: normal +x, tangent +y, bitangent +z
    turned = [w[:, [2, 0, 1]] for w in (wi, wo)]
    call = "vec4(BRDF(a.xyz, b.xyz, vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1)), 1.0)"
    got = run_glsl(page, before + source, call, *turned)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)


def test_glsl_file(page, rng, tmp_path):
    model = MODELS["rough-copper"].replace(name="of two\nlines")
    export(model, tmp_path / "model.glsl", "glsl")
    text = (tmp_path / "model.glsl").read_text()
    assert text.startswith("// of two lines, written by dsbrdf\n")
    wi, wo = random_pairs(rng, 100)
    got = run_glsl(page, text, "vec4(dsbrdf_eval(a.xyz, b.xyz), 1.0)", wi, wo)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)


def test_names_of_the_source_have_a_prefix():
    """So that a file can be put into any program."""
    text = re.sub(r"//.*", "", shader.baked(MODELS["matte"]))
    declared = re.findall(r"^(?:const )?(?:int|float|bool|vec3|struct|dsbrdf_\w+) (\w+)", text, re.MULTILINE)
    assert len(declared) > 12
    assert all(name.lower().startswith("dsbrdf_") for name in declared)


def test_refuses_models_that_are_not_rgb():
    model = MODELS["matte"]
    lobes = model.lobes
    two = model.replace(lobes=lobes.replace(colour=lobes.colour[:2]), channels=())
    with pytest.raises(ValueError, match="a shader has 3 channels, linear sRGB; the model has 2"):
        shader.baked(two)
