"""What people do with the sphere, and what happens when the browser or the device cannot."""

import json

import numpy as np
import pytest
from browser import run_glsl
from pairs import TINY, random_pairs
from sphere_page import N, inside, picture

from dsbrdf import shader
from dsbrdf.model import sampling


def test_halves_meet_without_a_seam(show_sphere):
    """Twice the same material is the whole sphere, and each half is that of its own material."""
    page = show_sphere("satin-plastic", "rough-gold")
    left = picture(page, 4)
    page.evaluate("sphere.setMaterials(materials[0], { ...materials[0] })")
    np.testing.assert_array_equal(picture(page, 4), left)
    page.evaluate("sphere.setMaterials(materials[1])")
    right = picture(page, 4)
    page.evaluate("sphere.setMaterials(materials[0], materials[1])")
    both = picture(page, 4)
    np.testing.assert_array_equal(both[:, : N // 2], left[:, : N // 2])
    np.testing.assert_array_equal(both[:, N // 2 :], right[:, N // 2 :])


def test_measured_profile(show_sphere, sphere_models):
    """A profile that holds twice the model's values: twice the picture where there are numbers, the model elsewhere."""
    model = sphere_models["rough-gold"]
    theta_h, angles = np.linspace(0.0, 1.0, 300), np.linspace(0.02, 1.5, 40)
    flat = np.zeros((len(angles), len(theta_h), 3))
    for slice_, theta_d in enumerate(angles):
        # At phi_d = 45 degrees the azimuthal term is one
        above = theta_h < np.pi / 2 - theta_d - 0.02
        flat[slice_, above] = 2.0 * model.eval_angles(theta_h[above], theta_d, np.pi / 4)
        flat[slice_, ~above] = np.nan
    profile = {
        "thetaD": angles.tolist(),
        "thetaH": theta_h.tolist(),
        "mean": np.where(np.isnan(flat), -1.0, flat).swapaxes(1, 2).ravel().tolist(),
    }
    page = show_sphere("rough-gold")
    page.evaluate("sphere.setLighting('point'); materials[0].beta.fill(0); sphere.setMaterials(materials[0])")
    plain = picture(page, 16)
    page.evaluate(
        """(profile) => {
            const mean = new Float32Array(profile.mean.map((value) => (value < 0 ? NaN : value)));
            const [thetaD, thetaH] = [new Float32Array(profile.thetaD), new Float32Array(profile.thetaH)];
            const amplitude = new Float32Array(mean.length).fill(NaN);
            sphere.setMaterials({ ...materials[0], measured: true, profile: { thetaD, thetaH, mean, amplitude } });
        }""",
        profile,
    )
    lit = inside() & (plain.min(-1) > 1e-3)
    ratio = picture(page, 16)[lit] / plain[lit]
    assert np.median(ratio) == pytest.approx(2.0, rel=5e-3)
    assert np.all(ratio < 2.05)
    assert np.all(ratio > 0.99)
    assert np.any(ratio < 1.01)


def test_turning_both_is_turning_neither(show_sphere):
    page = show_sphere("rough-gold")
    page.evaluate("sphere.setLighting('point')")
    before = picture(page, 4)
    page.evaluate("sphere.rotateView(0.7, 0)")
    turned = picture(page, 4)
    assert np.abs(turned - before)[inside()].max() > 0.1
    page.evaluate("sphere.rotateLight(0.7, 0)")
    np.testing.assert_allclose(picture(page, 4)[inside()], before[inside()], rtol=1e-3, atol=1e-4)
    page.evaluate("sphere.resetRotation()")
    np.testing.assert_array_equal(picture(page, 4), before)


def test_dragging_and_keys(show_sphere):
    """What is under the pointer follows it: the highlight of the point light moves to the right with the light."""
    page = show_sphere("polished-chrome", size=200)
    page.evaluate("""async () => {
        const { orbit } = await import("/orbit.js");
        orbit(canvas, sphere, { mode: () => window.mode ?? "view" });
        canvas.tabIndex = 0;
        canvas.focus();
        sphere.setLighting("point");
    }""")

    def highlight():
        """Middle column and row of the light in the picture."""
        image = picture(page, 2, size=200).mean(-1)
        return np.array([(image.sum(axis) * np.arange(200)).sum() / image.sum() for axis in (0, 1)])

    def drag(right, down):
        page.mouse.move(100, 100)
        page.mouse.down()
        page.mouse.move(100 + right, 100 + down, steps=3)
        page.mouse.up()

    start = highlight()
    page.keyboard.down("Shift")
    drag(30, 0)
    page.keyboard.up("Shift")
    assert highlight()[0] > start[0] + 5.0
    page.evaluate("sphere.resetRotation(); mode = 'light'")
    drag(0, 30)
    assert highlight()[1] > start[1] + 5.0
    page.evaluate("sphere.resetRotation(); mode = 'view'")
    drag(30, 0)
    assert highlight()[0] > start[0] + 5.0
    page.evaluate("sphere.resetRotation()")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("sphere.yaw") == pytest.approx(-0.1)
    page.keyboard.press("Shift+ArrowUp")
    assert highlight()[1] < start[1] - 1.0


def test_exposure_keeps_the_samples(show_sphere):
    page = show_sphere("rough-gold")
    picture(page, 4)
    look = "(() => { sphere.setExposure(%d); return canvas.toDataURL(); })()"
    assert page.evaluate(look % 0) != page.evaluate(look % 2)
    assert page.evaluate("sphere.nSamples") == 4


WITHOUT = {
    "WebGL2": (
        "HTMLCanvasElement.prototype.getContext = () => null;",
        "This browser offers no WebGL2, which the sphere needs. The plots work without it.",
    ),
    "float targets": (
        "WebGL2RenderingContext.prototype.getExtension = () => null;",
        "This graphics device cannot draw into float textures (EXT_color_buffer_float), which the sphere needs. "
        "The plots work without it.",
    ),
}


@pytest.mark.parametrize("missing", WITHOUT)
def test_without_webgl_it_says_so_and_does_nothing(show_sphere, missing):
    script, text = WITHOUT[missing]
    page = show_sphere("rough-gold", script=script)
    page.evaluate("""() => {
        sphere.setEnvironment("sky");
        sphere.setLighting("point");
        sphere.setExposure(1);
        sphere.rotateView(1, 1);
        sphere.rotateLight(1, 1);
        sphere.start();
        sphere.render();
        sphere.stop();
        sphere.dispose();
    }""")
    assert page.evaluate("errors") == [text]
    assert page.evaluate(
        "[sphere.nSamples, sphere.pixels().width, sphere.evaluate(new Float32Array(6)).length]"
    ) == [0, 0, 0]


def test_shader_that_does_not_compile(show_sphere):
    page = show_sphere("rough-gold")
    page.evaluate("""async () => {
        const { Sphere } = await import("/sphere.js");
        const broken = { ...sphere.shaders, sphere: "nonsense" };
        const other = new Sphere(document.createElement("canvas"), broken, { onError: (text) => errors.push(text) });
        other.setMaterials(materials[0]);
        other.render();
    }""")
    assert len(page.evaluate("errors")) == 1
    assert page.evaluate("errors[0]").startswith("A shader does not compile here: ")


def test_comes_back_after_the_device_was_lost(show_sphere):
    page = show_sphere("rough-gold", "satin-plastic")
    page.evaluate("sphere.setMaterials(materials[0], materials[1]); sphere.setEnvironment('sky')")
    before = picture(page, 4)
    page.evaluate(
        "window.device = canvas.getContext('webgl2').getExtension('WEBGL_lose_context'); device.loseContext()"
    )
    page.wait_for_function("sphere.nSamples === 0")
    page.evaluate("sphere.render(); sphere.setMaterials(materials[1], materials[0])")
    page.evaluate("device.restoreContext()")
    page.wait_for_function("sphere.renderer !== null")
    page.evaluate("sphere.setMaterials(materials[0], materials[1])")
    np.testing.assert_array_equal(picture(page, 4), before)
    assert page.evaluate("errors") == []


def test_draws_by_itself_until_done_and_after_changes(show_sphere):
    page = show_sphere("rough-gold")
    page.evaluate("sphere.maxSamples = 6; sphere.start()")
    page.wait_for_function("sphere.nSamples === 6")
    page.evaluate("sphere.rotateView(0.1, 0)")
    page.wait_for_function("sphere.nSamples === 6")
    page.evaluate("sphere.stop(); sphere.rotateView(0.1, 0)")
    page.wait_for_timeout(100)
    assert page.evaluate("sphere.nSamples") == 0


def test_baked_glsl_is_that_of_python(show_sphere, sphere_models, rng, monkeypatch):
    """But for the shares of its sampler, which are found from fewer nodes."""
    page = show_sphere("satin-plastic")
    text, shares = page.evaluate("""async () => {
        const { bakedGlsl } = await import("/baked_glsl.js");
        const { samplingShares } = await import("/sampler.js");
        return [bakedGlsl(materials[0], sphere.shaders), samplingShares(materials[0])];
    }""")
    model = sphere_models["satin-plastic"]
    wi, wo = random_pairs(rng, 2000)
    got = run_glsl(page, text, "vec4(dsbrdf_eval(a.xyz, b.xyz), dsbrdf_pdf(a.xyz, b.xyz))", wi, wo)
    theirs = run_glsl(page, shader.baked(model), "vec4(dsbrdf_eval(a.xyz, b.xyz), 1.0)", wi, wo)
    np.testing.assert_allclose(got[:, :3], theirs[:, :3], rtol=1e-4, atol=TINY)
    np.testing.assert_allclose(got[:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)
    made = sampling.SamplingTables(np.array(shares)[:, :-1], alias=None)
    monkeypatch.setattr(sampling, "tables", lambda _: made)
    np.testing.assert_allclose(got[:, 3], model.pdf(wi, wo), rtol=1e-3)


def test_sources_go_into_json():
    sources = shader.sources()
    assert json.loads(json.dumps(sources)) == sources
    assert {"constants", "dsbrdf", "sphere", "show"} <= sources.keys()
