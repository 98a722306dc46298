"""The web page in a headless browser: what is seen follows what is done, and both follow Python."""

import dataclasses
import json
import re

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from browser import watched
from page_tools import NO_WEBGL, click_material, curve_on_screen, faults, map_state, settle, values_in_page
from sphere_page import model_of

import dsbrdf
from dsbrdf import Lobes, cli
from dsbrdf.geometry import half_diff
from dsbrdf.model.components import components
from dsbrdf.view import layout, view

#: Materials and their numbers of lobes.
NAMES = {"rough-gold": 2, "glossy-plastic": 3, "polished-chrome": 2}
#: How many values of the simpler sphere are not of its background.
BRIGHT_VALUES = """(() => {
    const { width, height } = document.getElementById("sphere-2d");
    const context = document.getElementById("sphere-2d").getContext("2d");
    return [...context.getImageData(0, 0, width, height).data].filter((value) => value > 60).length;
})()"""
#: As if a link had been followed.
FOLLOW = """fragment => {
    history.replaceState(null, "", fragment);
    dispatchEvent(new HashChangeEvent("hashchange"));
}"""
READY = "window.dsbrdf && document.querySelector('#albedo-plot svg')"


@pytest.fixture(scope="module")
def models():
    return [model_of(name, n) for name, n in NAMES.items()]


@pytest.fixture(scope="module")
def path(models, tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "page.html"
    view(models, path)
    return path


def opened(browser, file, fragment="", webgl=False, before=None, **options):
    """A tab with a page, and a list of its errors.

    Without WebGL2 by default: in software it takes its time, and only the sphere needs it.
    """
    context = browser.new_context(**({"viewport": {"width": 1280, "height": 900}} | options))
    page = context.new_page()
    page.errors = watched(page)
    if not webgl:
        page.add_init_script(NO_WEBGL)
    if before is not None:
        page.add_init_script(before)
    page.goto(file.as_uri() + fragment)
    page.wait_for_function(READY)
    if webgl:
        page.add_style_tag(content="#sphere { width: 96px !important; }")
    return page


@pytest.fixture(scope="module")
def tab(browser, path):
    """A tab that tests share."""
    page = opened(browser, path)
    yield page
    page.context.close()


@pytest.fixture
def show(request, browser, path):
    """Call with the fragment of a link, and options of `opened`: its own tab, or without any the shared one."""
    pages = []

    def call(fragment="", fresh=False, **options):
        if not fresh and not options:
            page = request.getfixturevalue("tab")
            page.errors.clear()
            page.evaluate(FOLLOW, fragment or "#")
            settle(page)
            return page
        pages.append(opened(browser, **({"file": path, "fragment": fragment} | options)))
        return pages[-1]

    yield call
    for page in pages:
        page.context.close()


def angles(rng, n=200):
    """Half and difference angles above the horizon, dense near the pole."""
    theta_h = np.pi / 2 * rng.random(n) ** 3
    return theta_h, (np.pi / 2 - theta_h) * rng.random(n), np.pi * rng.random(n)


def check_curve(page, model, theta_d, channel):
    """The curve on screen is the model's, to the pixel."""
    theta_h, values = curve_on_screen(page, channel)
    # phi_d is 90 degrees on the left side, 0 on the right
    phi_d = np.where(theta_h < 0.0, np.pi / 2, 0.0)
    expected = model.eval_angles(np.deg2rad(np.abs(theta_h)), np.deg2rad(theta_d), phi_d)[:, channel]
    inside = np.abs(theta_h) + theta_d < 89.0
    assert inside.sum() > 100
    top = expected[inside].max()
    np.testing.assert_allclose(values[inside], expected[inside], rtol=0.02, atol=0.02 * top)


def test_opens_from_disk_at_once(show, models):
    page = show(webgl=True)
    page.wait_for_function("dsbrdf.sphere.nSamples >= 1")
    resources = page.evaluate("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert [name for name in resources if not name.startswith(("data:", "blob:"))] == []
    painted = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    assert painted < 1500.0
    page.wait_for_function("document.getElementById('sphere-2d').hidden")
    # Its size changes soon after it opens, and it begins anew
    page.wait_for_function("Math.min(...dsbrdf.sphere.meanPixel()) > 0.01")
    assert page.title() == "rough-gold · dsbrdf"
    facts = page.locator("#facts").inner_text()
    assert facts.startswith(f"2 lobes · {models[0].n_parameters} numbers · 3 channels · rel 0.")
    assert [fact.rsplit(" ", 1)[0] for fact in facts.split(" · ")[3:]] == [
        *("rel", "cbrt", "log", "albedo"),
        *("bivariate floor", "azimuthal floor"),
    ]
    assert faults(page) == []


def test_a_simpler_sphere_is_seen_until_the_first_samples(show):
    # The sphere never gets to draw
    held = "(frame) => (String(frame).includes('#step') ? 0 : draw(frame))"
    page = show(before=f"const draw = requestAnimationFrame; requestAnimationFrame = {held};", webgl=True)
    assert page.locator("#sphere-2d").is_visible()
    assert page.evaluate(BRIGHT_VALUES) > 1000


def test_values_are_those_of_python(show, models, rng):
    page = show()
    for i, model in enumerate(models):
        theta_h, theta_d, phi_d = angles(rng)
        expected = model.eval_angles(theta_h, theta_d, phi_d)
        got = values_in_page(page, i, theta_h, theta_d, phi_d)
        np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-30, err_msg=model.name)
        albedo = page.evaluate(f"[...dsbrdf.albedo(dsbrdf.materials[{i}], 0.7)]")
        np.testing.assert_allclose(albedo, model.albedo(0.7), rtol=5e-3, err_msg=model.name)


def any_model(rng, n_channels, sizes, name):
    """A model with curves of these sizes, and no two channels alike."""
    scale, gamma, beta, falloff, colour = sizes
    lobes = Lobes(
        rng.uniform(-3.0, 1.0, (2, scale)),
        rng.uniform(-2.0, 6.0, (2, gamma)),
        rng.uniform(-1.5, 1.5, (2, beta)),
        rng.uniform(-0.8, 3.0, (2, falloff)),
        rng.uniform(-0.5, 0.5, (n_channels, 2, colour)),
    )
    return dsbrdf.DSBRDF(lobes, name=name)


def test_values_of_any_curves_and_channels(show, rng, tmp_path):
    sizes = [(1, 1, 1, 1, 1), (2, 3, 4, 2, 5), (7, 5, 3, 1, 2)]
    models = [any_model(rng, n, of, f"{n}") for n, of in zip((1, 3, 4), sizes, strict=True)]
    models.append(any_model(rng, 31, sizes[0], "31").replace(channels=[f"{400 + 10 * i}" for i in range(31)]))
    view(models, tmp_path / "any.html")
    page = show(file=tmp_path / "any.html")
    for i, model in enumerate(models):
        theta_h, theta_d, phi_d = angles(rng)
        got = values_in_page(page, i, theta_h, theta_d, phi_d)
        np.testing.assert_allclose(got, model.eval_angles(theta_h, theta_d, phi_d), rtol=2e-4)
    assert not page.locator("#channels").is_visible()
    page.evaluate("dsbrdf.setState({ material: 2 })")
    settle(page)
    assert page.locator("#channels span").all_inner_texts() == ["All", "0", "1", "2", "3"]
    page.evaluate("dsbrdf.setState({ material: 3 })")
    settle(page)
    assert page.locator("#curves-plot .fitted").count() == 7
    page.get_by_label("Channel", exact=True).last.select_option("550")
    settle(page)
    assert page.evaluate("dsbrdf.state.channel") == 15
    assert page.locator("#curves-plot .fitted").count() == 1
    assert faults(page) == []


def test_means_over_phi_are_those_of_the_visible_part(show, models, rng):
    page = show()
    theta_h, theta_d = np.pi / 2 * rng.random((2, 60)) ** [[2.0], [1.0]]
    phi_d = np.pi * (np.arange(2000) + 0.5) / 2000
    wi, wo = half_diff.to_directions(theta_h[:, None], theta_d[:, None], phi_d)
    seen = (wi[..., 2] > 0.0) & (wo[..., 2] > 0.0)
    values = models[0].eval_angles(theta_h[:, None], theta_d[:, None], phi_d)
    expected = np.where(seen[..., None], values, 0.0).sum(1) / seen.sum(1)[:, None]
    script = "points => points.map(p => [...dsbrdf.meanOverPhi(dsbrdf.materials[0], ...p)])"
    got = page.evaluate(script, np.stack([theta_h, theta_d], axis=1).tolist())
    np.testing.assert_allclose(got, expected, rtol=0.01)


def test_lobes_are_called_what_python_calls_them(show, models):
    page = show("#material=glossy-plastic")
    got = page.evaluate("dsbrdf.components(dsbrdf.currentModel())")
    for found, part in zip(got, components(models[1]), strict=True):
        assert found["label"] == part.label
        assert found["share"] == pytest.approx(part.share, abs=0.002)
        assert found["width"] == pytest.approx(part.half_width, rel=5e-3)
    first = page.locator(".about").first.inner_text()
    assert first.startswith(f"{got[0]['label']} · {100 * got[0]['share']:.1f} % of the light · half width ")
    page.uncheck("#lobe-0")
    settle(page)
    assert page.locator(".about").first.inner_text() == "off"


def test_measured_points_are_those_of_the_model(show, models):
    page = show()
    got = page.evaluate(
        "dsbrdf.materials.map(({profile}) => [...profile.mean].map(v => isNaN(v) ? null : v))"
    )
    for values, model in zip(got, models, strict=True):
        expected = model.profile.mean.ravel()
        seen = expected > 1e-5 * np.nanmax(expected)
        np.testing.assert_allclose(np.array(values, dtype=float)[seen], expected[seen], rtol=6e-4)
    amplitude = np.array(
        page.evaluate("[...dsbrdf.materials[0].profile.amplitude].map(v => isNaN(v) ? 0 : v)")
    )
    expected = np.nan_to_num(models[0].profile.amplitude.ravel())
    np.testing.assert_allclose(amplitude, expected, atol=0.005 * np.nanmax(models[0].profile.mean))


def test_a_lobe_goes_off_and_on(show, models):
    """In the same light from everywhere the picture is the albedo: without a lobe it falls as Python says."""
    page = show("#material=glossy-plastic&lighting=flat&scale=linear&channel=0&theta_d=30", webgl=True)
    model = models[1]
    without = model.replace(lobes=model.lobes.take([1, 2]))
    check_curve(page, model, 30.0, 0)
    before = middle_of_sphere(page)
    page.uncheck("#lobe-0")
    settle(page)
    check_curve(page, without, 30.0, 0)
    after = middle_of_sphere(page)
    # Three per cent of noise
    ratio = without.albedo(0.1) / model.albedo(0.1)
    assert ratio[0] < 0.5
    np.testing.assert_allclose(after / before, ratio, rtol=0.12)
    assert page.locator("#curves-plot .lobe").count() == 2
    page.click("#reset")
    settle(page)
    check_curve(page, model, 30.0, 0)
    assert faults(page) == []


def middle_of_sphere(page, n_samples=32):
    """Mean radiance of the pixels in the middle, which look at the sphere from straight above."""
    page.wait_for_function(f"dsbrdf.sphere.nSamples >= {n_samples}")
    read = (
        "() => { const {width, height, data} = dsbrdf.sphere.pixels(); return [width, height, [...data]]; }"
    )
    width, height, data = page.evaluate(read)
    picture = np.array(data).reshape(height, width, 3)
    return picture[height // 2 - 16 : height // 2 + 16, width // 2 - 16 : width // 2 + 16].mean((0, 1))


def test_solo_and_sliders(show, models):
    page = show("#material=glossy-plastic")
    page.get_by_role("button", name="Solo lobe 1").click()
    settle(page)
    assert page.evaluate("dsbrdf.state.edits.map(edit => edit.on)") == [False, True, False]
    page.get_by_role("button", name="Solo lobe 1").click()
    page.focus("#kappa-0")
    page.keyboard.press("End")
    page.focus("#gamma-0")
    page.keyboard.press("Home")
    settle(page)
    assert page.locator("output[for=kappa-0]").inner_text() == "×2.00"
    assert page.locator("output[for=gamma-0]").inner_text() == "×0.10"
    model = models[1]
    first = np.array([[1.0], [0.0], [0.0]])
    lobes = model.lobes
    scaled = lobes.replace(scale=lobes.scale + np.log(2.0) * first, gamma=lobes.gamma - np.log(10.0) * first)
    edited = model.replace(lobes=scaled)
    theta_h, theta_d, phi_d = angles(np.random.default_rng(2), 50)
    got = values_in_page(page, None, theta_h, theta_d, phi_d)
    np.testing.assert_allclose(got, edited.eval_angles(theta_h, theta_d, phi_d), rtol=2e-4)


def test_theta_d_by_keyboard(show, models):
    page = show("#scale=linear&channel=1")
    page.focus("#theta-d")
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    settle(page)
    assert page.locator("#theta-d-value").inner_text() == "50°"
    check_curve(page, models[0], 50.0, 1)
    page.locator("#slice-fitted").click(position={"x": 5, "y": 5})
    settle(page)
    assert page.evaluate("dsbrdf.state.thetaD") > 80.0


def test_slice_veils_what_is_not_measured(show, models, tmp_path):
    alpha = "(id => { const c = document.getElementById(id); return [...c.getContext('2d')" \
        ".getImageData(0, 0, c.width, c.height).data].filter((_, i) => i % 4 === 3); })"  # fmt: skip
    page = show()
    measured, fitted = (
        np.array(page.evaluate(f"{alpha}('slice-{kind}')")) for kind in ("measured", "fitted")
    )
    assert 0.001 < (measured == 0).mean() < 0.5
    np.testing.assert_array_equal(fitted == 255, measured == 255)
    assert set(fitted) <= {76, 77, 255}
    caption = "figure:has(#slice-fitted) figcaption"
    assert page.locator(caption).inner_text() == "Fitted. Veiled: not measured."
    view([models[0].replace(profile=None)], tmp_path / "bare.html")
    bare = show(file=tmp_path / "bare.html")
    assert bare.locator(caption).inner_text() == "Model"
    assert set(bare.evaluate(f"{alpha}('slice-fitted')")) == {255}


def test_map_opens_compares_and_blends(show, models):
    page = show()
    click_material(page, "polished-chrome")
    settle(page)
    assert page.title() == "polished-chrome · dsbrdf"
    assert page.locator("#lobes .factors").count() == models[2].n_lobes
    click_material(page, "glossy-plastic", modifiers=["Shift"])
    settle(page)
    assert page.evaluate("[dsbrdf.state.second, dsbrdf.state.compare]") == [1, "second"]
    assert page.locator("#half-names").inner_text().split() == ["polished-chrome", "glossy-plastic"]
    page.locator("#mix").fill("0.5")
    settle(page)
    theta_h, theta_d, phi_d = angles(np.random.default_rng(4), 50)
    got = values_in_page(page, None, theta_h, theta_d, phi_d)
    ends = [model.eval_angles(theta_h, theta_d, phi_d) for model in (models[2], models[1])]
    between = (np.minimum(*ends) * 0.99 <= got) & (got <= np.maximum(*ends) * 1.01)
    assert between.mean() > 0.7
    page.locator("#mix").fill("1")
    settle(page)
    np.testing.assert_allclose(
        values_in_page(page, None, theta_h, theta_d, phi_d), ends[1], rtol=5e-3, atol=5e-3
    )
    page.focus("#map-canvas")
    # One of the four leads away, wherever the others lie
    for key in ("ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft"):
        page.keyboard.press(key)
        if not page.locator("#map-details").inner_text().startswith("polished-chrome"):
            break
    page.keyboard.press("Enter")
    settle(page)
    assert page.title() != "polished-chrome · dsbrdf"
    assert faults(page) == []


def test_the_edited_model_comes_back(show, models, tmp_path):
    page = show("#material=glossy-plastic&lobes=101&kappa=1.5,1,1&gamma=1,1,2")
    with page.expect_download() as event:
        page.click("#download-model")
    assert event.value.suggested_filename == "glossy-plastic-edited.json"
    event.value.save_as(tmp_path / "model.json")
    loaded = dsbrdf.load(tmp_path / "model.json")
    model = models[1]
    assert loaded.name == "glossy-plastic edited"
    assert loaded.n_lobes == 2
    lobes = model.lobes.take([0, 2])
    lobes = lobes.replace(
        scale=lobes.scale + np.log([[1.5], [1.0]]), gamma=lobes.gamma + np.log([[1.0], [2.0]])
    )
    for got, expected in zip(loaded.lobes.parts, lobes.parts, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)
    assert (loaded.channels, loaded.errors) == (("r", "g", "b"), {})
    assert loaded.source.to_json() == model.source.to_json()
    with page.expect_download() as event:
        page.click("#download-glsl")
    event.value.save_as(tmp_path / "model.glsl")
    text = (tmp_path / "model.glsl").read_text()
    assert text.startswith("// glossy-plastic edited\n")
    sizes = [part.shape[-1] for part in lobes.parts]
    assert f"vec4({sizes[4]}.0, {max(sizes)}.0, 2.0, 0.0)" in text
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.click("#copy")
    page.wait_for_function("document.getElementById('downloads-note').textContent === 'Copied.'")
    copied = json.loads(page.evaluate("navigator.clipboard.readText()"))
    assert copied == json.loads((tmp_path / "model.json").read_text())
    page.get_by_role("button", name="Solo lobe 0").click()
    page.uncheck("#lobe-0")
    settle(page)
    page.click("#download-model")
    assert page.locator("#downloads-note").inner_text() == "All lobes are off: switch one on first."


def test_an_unedited_model_comes_back_whole(show, models, tmp_path):
    page = show("#material=rough-gold")
    with page.expect_download() as event:
        page.click("#download-model")
    event.value.save_as(tmp_path / "model.json")
    loaded = dsbrdf.load(tmp_path / "model.json")
    assert loaded.name == "rough-gold"
    for got, expected in zip(loaded.lobes.parts, models[0].lobes.parts, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)
    assert loaded.fit_options == json.loads(json.dumps(dict(models[0].fit_options)))
    assert loaded.errors == pytest.approx(models[0].errors)


def test_names_that_would_do_harm_as_files_or_code(show, models, tmp_path):
    """They are text in the page, safe names of files, and end no comment."""
    name = "../con <img src=x onerror=document.title='broken'>\n#error \x1b \\"
    view([models[0].replace(name=name)], tmp_path / "page.html")
    page = show(file=tmp_path / "page.html")
    assert page.title() != "broken"
    assert page.locator("img").count() == 0
    with page.expect_download() as event:
        page.click("#download-glsl")
    assert re.fullmatch(r"[\w-][\w.-]*\.glsl", event.value.suggested_filename)
    event.value.save_as(tmp_path / "model.glsl")
    first, second = (tmp_path / "model.glsl").read_text().splitlines()[:2]
    assert first.startswith("// ../con <img")
    assert first.isprintable()
    assert not first.endswith("\\")
    assert "#error" not in second


def test_a_link_carries_the_state(show):
    page = show(
        "#material=polished-chrome&theta_d=12.5&lobes=10&channel=2&scale=linear&exposure=1&second=matte"
    )
    state = page.evaluate("dsbrdf.state")
    assert (state["material"], state["thetaD"], state["channel"], state["log"]) == (2, 12.5, 2, False)
    assert state["edits"][1]["on"] is False
    assert state["second"] is None
    page.get_by_label("Green", exact=True).check()
    settle(page)
    link = page.url
    assert "channel=1" in link
    again = show(link[link.index("#") :], fresh=True)
    assert again.evaluate("dsbrdf.state") == page.evaluate("dsbrdf.state")
    nonsense = show("#material=nothing&theta_d=999&channel=-1&lobes=x&kappa=a,b&compare=what&lighting=dark")
    assert nonsense.evaluate("[dsbrdf.state.material, dsbrdf.state.thetaD, dsbrdf.state.channel]") == [
        0,
        40,
        None,
    ]
    assert faults(nonsense) == []


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_nothing_is_wider_than_the_screen(show, width):
    page = show("#material=polished-chrome&second=rough-gold", viewport={"width": width, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    wide = page.evaluate(
        "[...document.querySelectorAll('section *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1)"
        ".map(e => e.outerHTML.slice(0, 80))"
    )
    assert wide == []


def test_light_and_dark(show):
    dark = show(color_scheme="dark")
    background = "getComputedStyle(document.body).backgroundColor"
    assert dark.evaluate(background) == "rgb(19, 20, 22)"
    dark.click("#theme")
    assert dark.evaluate(background) == "rgb(247, 247, 245)"


def test_without_webgl(show):
    page = show()
    message = page.locator("#sphere-message").inner_text()
    assert "WebGL2" in message
    assert "The plots work without it" in message
    assert page.evaluate(BRIGHT_VALUES) > 1000
    assert page.locator("#curves-plot .fitted").count() == 3
    assert not page.locator("#compare").is_visible()
    assert faults(page) == []


def test_measured_against_fitted(show):
    page = show("#material=glossy-plastic&compare=measured", webgl=True)
    page.wait_for_function("dsbrdf.sphere.nSamples >= 2")
    assert page.locator("#half-names").inner_text().split() == ["measured", "fitted"]
    assert faults(page) == []


@pytest.mark.parametrize(("scheme", "webgl"), [("light", True), ("dark", False)])
def test_accessibility(show, scheme, webgl):
    page = show("#material=glossy-plastic&second=rough-gold", webgl=webgl, color_scheme=scheme)
    page.evaluate("dsbrdf.sphere.stop()")
    violations = Axe().run(page).response["violations"]
    assert [(v["id"], v["impact"], v["nodes"][0]["html"][:90]) for v in violations] == []


def test_a_hundred_materials(show, models, tmp_path):
    """Each a little different from the others, with noise in what was measured."""
    rng = np.random.default_rng(3)
    varied = []
    for i in range(100):
        model = models[i % 3]
        noise = 1.0 + 0.01 * rng.normal(size=model.profile.mean.shape)
        profile = dataclasses.replace(model.profile, mean=model.profile.mean * noise)
        lobes = model.lobes
        scale, gamma = (x + rng.uniform(-0.3, 0.3, x.shape) for x in (lobes.scale, lobes.gamma))
        lobes = lobes.replace(scale=scale, gamma=gamma)
        varied.append(model.replace(name=f"{i}", lobes=lobes, profile=profile))
    file = tmp_path / "hundred.html"
    view(varied, file)
    assert file.stat().st_size <= 1_000_000
    page = show(file=file)
    assert len(map_state(page)["chips"]) >= 30
    assert faults(page) == []


def collection(n, rng):
    """Models that differ from those of the library by their heights and sharpness."""
    library = [dsbrdf.library.load(name) for name in dsbrdf.library.names()[::9]]
    models = []
    for i in range(n):
        model = library[i % len(library)]
        lobes = model.lobes
        scale, gamma = (x + rng.normal(0.0, 0.3, (len(x), 1)) for x in (lobes.scale, lobes.gamma))
        models.append(
            model.replace(name=f"{model.name} {i:05d}", lobes=lobes.replace(scale=scale, gamma=gamma))
        )
    return models


@pytest.fixture(scope="module")
def five_hundred(tmp_path_factory):
    """A library file of so many materials, as the command line shows it."""
    folder = tmp_path_factory.mktemp("collection")
    models = collection(500, np.random.default_rng(5))
    dsbrdf.library.write(folder / "many.dsbrdf", models)
    assert cli.main(["view", str(folder / "many.dsbrdf"), "-o", str(folder / "many.html"), "-q"]) == 0
    return models, folder / "many.html"


def elements(page):
    return page.evaluate("document.querySelectorAll('*').length")


def test_a_collection_is_found_by_name(show, five_hundred):
    models, file = five_hundred
    page = show(file=file)
    field = page.locator("#material")
    field.click()
    field.fill("alum 0")
    options = page.locator("#material-list [role=option]")
    found = page.evaluate("dsbrdf.search('alum 0').map(i => dsbrdf.materials[i].name)")
    assert found == [model.name for model in models if "alum" in model.name]
    assert options.all_inner_texts() == found[:40]
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowUp")
    active = field.get_attribute("aria-activedescendant")
    assert page.locator(f"#{active}").inner_text() == found[1]
    page.keyboard.press("Enter")
    settle(page)
    assert page.title() == f"{found[1]} · dsbrdf"
    assert not options.first.is_visible()
    # What is not found is not taken
    field.fill("nothing of this name")
    assert options.all_inner_texts() == ["No material of this name"]
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    assert field.input_value() == found[1]
    page.locator("#second").evaluate("field => field.focus()")
    page.keyboard.type(models[3].name)
    page.keyboard.press("Enter")
    assert page.evaluate("dsbrdf.state.second") == 3
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowUp")
    for _ in range(5):
        page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    assert page.evaluate("dsbrdf.state.second") is None
    assert faults(page) == []


def test_the_nearest_are_those_of_python(show, five_hundred):
    models, file = five_hundred
    page = show(f"#material={models[7].name}", file=file)
    coordinates = layout.likeness(models)
    distance = np.linalg.norm(coordinates - coordinates[7], axis=1)
    order = np.argsort(distance)[1:9]
    got = page.evaluate("dsbrdf.nearest(7)")
    assert [one["name"] for one in got] == [models[i].name for i in order]
    np.testing.assert_allclose([one["distance"] for one in got], distance[order], rtol=1e-4)
    button = page.locator("#nearest button").first
    assert button.inner_text().startswith(models[order[0]].name)
    button.click(modifiers=["Shift"])
    assert page.evaluate("dsbrdf.state.second") == order[0]
    page.locator("#nearest button").nth(1).click()
    assert page.evaluate("dsbrdf.state.material") == order[1]


def test_the_map_zooms_until_each_is_a_sphere(show, five_hundred):
    models, file = five_hundred
    page = show(file=file)
    settle(page)
    few = elements(page)
    assert few < 1000
    first = map_state(page)
    assert 20 < len(first["chips"]) < 250
    # A material that is a point at first, on which the wheel zooms
    hidden = next(i for i in range(499, 0, -1) if i not in first["chips"])
    page.focus("#map-canvas")
    place = page.locator("#map-canvas").bounding_box()
    page.mouse.move(place["x"] + first["x"][hidden], place["y"] + first["y"][hidden])
    for _ in range(30):
        if hidden in map_state(page)["chips"]:
            break
        page.mouse.wheel(0, -300)
        settle(page)
    near = map_state(page)
    assert near["zoom"] > 2.0
    # It stayed under the pointer, and what is shown has room
    at = np.array([near["x"], near["y"]]).T
    assert np.hypot(*(at[hidden] - [first["x"][hidden], first["y"][hidden]])) < 2.0
    shown = at[near["chips"]]
    gaps = np.hypot(*(shown[:, None] - shown).transpose(2, 0, 1)) + 1e3 * np.eye(len(shown))
    assert np.median(gaps.min(1)) > 15.0
    page.mouse.down()
    page.mouse.up()
    settle(page)
    assert page.title() == f"{models[hidden].name} · dsbrdf"
    assert models[hidden].name in page.locator(".map-name").all_inner_texts()
    # Dragged, it moves as far as the pointer
    page.mouse.down()
    page.mouse.move(place["x"] + first["x"][hidden] + 20, place["y"] + first["y"][hidden] + 10, steps=4)
    page.mouse.up()
    settle(page)
    moved = map_state(page)
    np.testing.assert_allclose(
        [moved["x"][hidden] - at[hidden, 0], moved["y"][hidden] - at[hidden, 1]], [20, 10], atol=1.5
    )
    assert page.title() == f"{models[hidden].name} · dsbrdf"
    for _ in range(2):
        page.keyboard.press("-")
    page.keyboard.press("0")
    settle(page)
    assert map_state(page)["zoom"] == 1.0
    assert abs(elements(page) - few) < 60
    assert faults(page) == []


@pytest.mark.slow
def test_ten_thousand_materials(show, tmp_path):
    """The page is small, the elements on it few, whatever is done."""
    models = collection(10_000, np.random.default_rng(6))
    view(models, tmp_path / "many.html")
    assert (tmp_path / "many.html").stat().st_size < 600 * len(models)
    page = show(file=tmp_path / "many.html")
    page.locator("#material").click()
    page.keyboard.type("04999")
    page.keyboard.press("Enter")
    settle(page)
    assert page.title() == f"{models[4999].name} · dsbrdf"
    page.focus("#map-canvas")
    for _ in range(8):
        page.keyboard.press("+")
    settle(page)
    state = map_state(page)
    assert state["zoom"] > 20.0
    assert 4999 in state["chips"]
    assert elements(page) < 1000
    assert faults(page) == []


def test_coarse_while_dragged(show):
    """On a slow device samples are larger while the sphere is dragged; its place on the page is the same."""
    page = show(webgl=True)
    page.wait_for_function("dsbrdf.sphere.nSamples >= 1")
    box = page.locator("#sphere").bounding_box()
    whole = page.evaluate("[dsbrdf.sphere.canvas.width, dsbrdf.sphere.pixels().width]")
    assert whole[0] == whole[1]
    sizes = page.evaluate("""async () => {
        const { sphere } = dsbrdf;
        const frame = () => new Promise((done) => requestAnimationFrame(done));
        sphere.draggedCoarseness = 4;
        for (let i = 0; i < 3; i++) {
            sphere.rotateView(0.05, 0);
            await frame();
        }
        return [sphere.canvas.width, sphere.pixels().width, sphere.coarseness];
    }""")
    assert sizes[0] == whole[0]
    assert sizes[1] == -(-whole[0] // sizes[2])
    assert sizes[2] > 1
    assert page.locator("#sphere").bounding_box() == box
    page.wait_for_function("dsbrdf.sphere.pixels().width === dsbrdf.sphere.canvas.width")
    page.wait_for_function("dsbrdf.sphere.nSamples >= 1")
    assert faults(page) == []


def test_channels_in_any_order_have_their_colours(show, models, tmp_path):
    """Gold of the channels b, g, r, and of wavelengths from long to short, looks as that of r, g, b."""
    lobes = models[0].lobes
    reverse = dsbrdf.DSBRDF(lobes.replace(colour=lobes.colour[::-1]), ["b", "g", "r"], "bgr")
    lines = dsbrdf.DSBRDF(lobes, ["650nm", "550nm", "450nm"], "lines")
    odd = dsbrdf.DSBRDF(lobes, ["p", "q", "s"], "odd")
    view([models[0], reverse, lines, odd], tmp_path / "page.html")
    page = show(file=tmp_path / "page.html")
    middle = "(() => { const c = document.getElementById('slice-fitted'); return [...c.getContext('2d')" \
        ".getImageData(c.width / 2, c.height / 2, 1, 1).data]; })()"  # fmt: skip
    seen = []
    for i in range(4):
        page.evaluate(f"dsbrdf.setState({{ material: {i} }})")
        page.wait_for_timeout(250)
        seen.append(page.evaluate(middle)[:3])
        facts = page.locator("#facts").inner_text()
        assert ("false colours: p, q, s as red, green, blue" in facts) == (i == 3)
    assert seen[1] == seen[0] == seen[3]
    # Gold: more red than green than blue
    assert seen[2][0] > seen[2][1] > seen[2][2]
    page.evaluate("dsbrdf.setState({ material: 1 })")
    settle(page)
    assert page.locator("#channels span").all_inner_texts() == ["All", "Blue", "Green", "Red"]
    assert page.locator("#curves-plot path[data-channel='0']").get_attribute("stroke") == "var(--blue)"
