"""The model in other languages of shaders: WGSL runs in headless Chromium and agrees with Python; the others' form."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import run_glsl, run_wgsl, secure_page
from by_hand import by_hand
from chi2 import cell_integrals, p_value
from pairs import TINY, random_pairs

import dsbrdf
from dsbrdf import shader
from dsbrdf.model.lobes import Lobes
from dsbrdf.shader import languages

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = {
    "matte": by_hand([0.12, 0.02], [0.05, 2.0], [0.0, 0.5], name="matte"),
    "plastic": by_hand([2.0, 0.15, 0.4], [300.0, 0.3, 30.0], [0.3, -0.2, 0.1], name="plastic"),
    "mirror": by_hand([8.0, 0.5], [2e4, 300.0], [0.0, 0.0], name="mirror"),
}


@pytest.fixture(scope="module")
def page(browser):
    return secure_page(browser)


def of_sizes(rng, sizes):
    scale, gamma, beta, falloff, colour = sizes
    return dsbrdf.DSBRDF(
        Lobes(
            rng.uniform(-3.0, 1.5, (2, scale)),
            rng.uniform(-2.0, 8.0, (2, gamma)),
            rng.uniform(-0.9, 0.9, (2, beta)),
            rng.uniform(-0.8, 6.0, (2, falloff)),
            rng.uniform(-0.5, 0.5, (3, 2, colour)),
        )
    )


def assert_equal_to_python(page, model, rng):
    wi, wo = random_pairs(rng)
    call = "vec4f(dsbrdf_eval(a.xyz, b.xyz), dsbrdf_pdf(a.xyz, b.xyz))"
    got = run_wgsl(page, shader.baked(model, "wgsl"), call, wi, wo)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)
    np.testing.assert_allclose(got[:, 3], model.pdf(wi, wo), rtol=1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_wgsl(page, rng, name):
    assert_equal_to_python(page, MODELS[name], rng)


@pytest.mark.parametrize("sizes", [(1, 1, 1, 1, 1), (2, 2, 2, 2, 2), (6, 4, 3, 1, 2)])
def test_wgsl_of_curves_of_any_size(page, rng, sizes):
    assert_equal_to_python(page, of_sizes(rng, sizes), rng)


def test_wgsl_samples_follow_the_density(page, rng):
    model, n = MODELS["plastic"], 200_000
    wo = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
    call = "vec4f(dsbrdf_sample(a.xyz, b.xyz), 1.0)"
    u = rng.random((n, 3), dtype=np.float32)
    drawn = run_wgsl(page, shader.baked(model, "wgsl"), call, np.tile(wo, (n, 1)), u)[:, :3]
    np.testing.assert_allclose((drawn**2).sum(-1), 1.0, atol=1e-5)
    assert p_value(drawn, cell_integrals(lambda wi: model.pdf(wi, wo), wo * [-1.0, -1.0, 1.0])) > 0.01


FORBIDDEN = {
    "wgsl": r"\b(float|int|vec[234]|ivec4|\+\+k)\b|\?",
    "hlsl": r"\b(vec[234]|ivec4)\b|\?",
    "slang": r"\b(vec[234]|ivec4)\b|\?",
}


@pytest.mark.parametrize("language", FORBIDDEN)
def test_nothing_of_glsl_is_left(language):
    code = re.sub(r"//.*", "", shader.baked(MODELS["matte"], language))
    assert re.findall(FORBIDDEN[language], code) == []


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_the_parameters_are_a_compact_block(language):
    """Four numbers a vector, three vectors a line."""
    text = shader.baked(MODELS["plastic"], language)
    n = len(shader.texels(MODELS["plastic"].lobes))
    lines = [line for line in text.splitlines() if re.match(r" {4}(vec4f?|float4)\(", line)]
    assert len(lines) == -(-n // languages.TEXELS_A_LINE)
    assert max(map(len, lines)) < 200
    assert sum(line.count("(") for line in lines) == n


def test_the_example(browser, tmp_path, monkeypatch):
    """Shadertoy's text draws a copper sphere; the page of three.js holds the same code, without what would end it."""
    MODELS["plastic"].save(tmp_path / "model.json")
    monkeypatch.setattr(sys, "argv", ["web_shaders.py", str(tmp_path / "model.json"), str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "web_shaders.py"), run_name="__main__")
    text = (tmp_path / "shadertoy.glsl").read_text()
    at = np.stack(np.meshgrid(np.arange(32.0), np.arange(32.0)), axis=-1).reshape(-1, 2) + 0.5
    around = (
        "vec3 iResolution = vec3(32.0, 32.0, 1.0);\n"
        + text
        + "\nvec4 shown(vec2 at) { vec4 c; mainImage(c, at); return c; }"
    )
    image = run_glsl(browser.new_page(), around, "shown(a.xy)", at).reshape(32, 32, 4)
    assert np.isfinite(image).all()
    assert image[0, 0, 0] == image[-1, -1, 0] < 0.2
    assert image[10:22, 10:22, :3].mean() > 0.3
    page = (tmp_path / "three.html").read_text()
    assert shader.baked(dsbrdf.load(tmp_path / "model.json")) in page
    assert page.count("`") == 4


def test_an_unknown_language():
    with pytest.raises(ValueError, match=r"'language' must be one of glsl, wgsl, hlsl, slang, got 'osl'\."):
        shader.baked(MODELS["matte"], "osl")
