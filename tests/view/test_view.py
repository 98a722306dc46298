"""The web page as text: what goes into it, how it is put together, and the commands that write it."""

import base64
import dataclasses
import html
import json
import re
import zlib

import numpy as np
import pytest
from page_tools import described, part
from sphere_page import model_of

import dsbrdf
from dsbrdf import cli, shader
from dsbrdf.geometry import colour
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.view import collect, data, frame, layout, page, script, view

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")


@pytest.fixture(scope="module")
def model():
    return model_of("rough-gold", 2)


def changed(model, kappa=1.0, gamma=1.0):
    """The model with its lobes scaled."""
    lobes = model.lobes
    scaled = lobes.replace(scale=lobes.scale + np.log(kappa), gamma=lobes.gamma + np.log(gamma))
    return model.replace(lobes=scaled)


def numbers(text, dtype):
    """Numbers of a packed array, unpacked as the page does it."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)
    return planes.reshape(np.dtype(dtype).itemsize, -1).T.copy().view(dtype).ravel()


def test_the_page_holds_the_numbers(model):
    text = page(model)
    (entry,) = described(text)
    assert (entry["name"], entry["lobes"], entry["channels"]) == ("rough-gold", 2, ["r", "g", "b"])
    assert (entry["rgb"], entry["falseColours"]) == (np.eye(3).tolist(), False)
    names = ("scale", "gamma", "beta", "falloff", "colour")
    assert entry["sizes"] == {name: getattr(model.lobes, name).shape[-1] for name in names}
    errors = {key: value for key, value in model.errors.items() if np.isfinite(value)}
    assert entry["errors"] == pytest.approx(errors, rel=1e-5)
    floats = numbers(part(text, "floats"), "<f4")
    expected = np.concatenate([values.ravel() for values in model.lobes.parts])
    np.testing.assert_array_equal(floats[: expected.size], expected.astype(np.float32))
    assert set(json.loads(part(text, "shaders"))) >= {"constants", "dsbrdf", "sphere"}


def entries(packed):
    return json.loads(zlib.decompress(base64.b64decode(packed.materials)))["materials"]


def test_the_page_needs_nothing_else(model):
    text = page(model).replace("http://www.w3.org/2000/svg", "a name, not an address")
    assert not re.search(r"""(?:src|href)=["'](?!data:)|@import|url\((?!data:|#)|https?://""", text)
    assert "/*{" not in text
    assert "<!--{" not in text


def test_a_name_cannot_end_the_script(model):
    name = "</script><script>alert(1)//"
    text = page(model.replace(name=name))
    assert name not in text
    assert described(text)[0]["name"] == name


def test_names_are_told_apart(model):
    nameless = model.replace(name="")
    names = [entry["name"] for entry in described(page([model, model, nameless, nameless]))]
    assert names == ["rough-gold", "rough-gold (2)", "unnamed", "unnamed (2)"]


def test_measured_points_give_way(model):
    whole = data.pack([model], 10**6)
    assert whole.thinning == 1
    halved = data.pack([model], whole.size - 1000)
    assert halved.thinning == 2
    assert entries(halved)[0]["profile"]["shape"][:2] == [18, 45]
    without = data.pack([model], 0)
    assert (without.thinning, "profile" in entries(without)[0]) == (0, False)
    assert numbers(without.words, "<u2").size == 0
    assert data.pack([model.replace(profile=None)], 0).thinning is None


def test_rounding_is_as_stated(model):
    packed = data.pack([model], 10**6)
    levels = np.cumsum(numbers(packed.words, "<u2").reshape(-1, 90), axis=1, dtype=np.uint16)[: 18 * 3]
    top = np.nanmax(model.profile.mean)
    unpacked = top * 10.0 ** (data.DECADES * ((levels - 1.0) / (data.STEPS - 1) - 1.0))
    expected = model.profile.mean.reshape(-1, 90)
    assert (levels == 0).sum() == (~(expected > 0.0)).sum()
    seen = expected > 0.0
    assert np.abs(unpacked[seen] / expected[seen] - 1.0).max() <= 1.01 * data.ROUNDING


def test_a_profile_whose_angles_differ(model):
    theta_h = model.profile.theta_h + 1e-3 * np.arange(18)[:, None]
    profile = MeasuredProfile(model.profile.theta_d, theta_h, model.profile.mean, model.profile.amplitude)
    packed = data.pack([dataclasses.replace(model, profile=profile)], 10**6)
    assert entries(packed)[0]["profile"]["shape"] == [18, 90, 18]


def test_no_model():
    with pytest.raises(ValueError, match="'models' must hold at least one model, got none"):
        page([])


def test_other_channels(model):
    one = model.lobes.replace(colour=model.lobes.colour[:1])
    single = dsbrdf.DSBRDF(one, name="one")
    entry, *_ = described(page([single, single, single]))
    assert (entry["channels"], entry["rgb"]) == (["value"], [[1.0], [1.0], [1.0]])


@pytest.mark.parametrize(
    "channels", [["b", "g", "r"], ["value"], ["450nm", "550nm", "650nm"], ["X", "Y", "Z"]]
)
def test_channels_are_shown_in_their_colours(channels):
    weights, is_true = data.rgb_weights(channels)
    assert is_true
    np.testing.assert_array_equal(weights, colour.rgb_weights(channels))


@pytest.mark.parametrize(
    ("channels", "shown"),
    [
        (["a", "b", "c", "d", "e"], [4, 2, 0]),
        (["0", "1", "2", "3"], [3, 1, 0]),
        (["p", "q", "s"], [0, 1, 2]),
        (["900nm", "1000nm"], [1, 0, 0]),
    ],
)
def test_channels_that_tell_no_colour(model, channels, shown):
    weights, is_true = data.rgb_weights(channels)
    assert not is_true
    np.testing.assert_array_equal(weights, np.eye(len(channels))[shown])
    lobes = model.lobes.replace(colour=model.lobes.colour[np.zeros(len(channels), int)])
    assert described(page(dsbrdf.DSBRDF(lobes, channels)))[0]["falseColours"]


def test_the_map_puts_likes_together(model):
    dimmer = changed(model, kappa=0.98)
    other = changed(model, gamma=20.0)
    places = layout.place([model, dimmer, other])
    distance = np.hypot(*(places.at[:, None] - places.at).transpose(2, 0, 1))
    assert distance[0, 1] < 0.5 * min(distance[0, 2], distance[1, 2])
    assert distance[0, 1] > 0.5 * layout.GAP
    assert "logarithm of reflectance" in places.about
    assert layout.place([model]) is None
    assert sorted(layout.place([model, other]).at[:, 0]) == [0.0, 1.0]


def test_the_map_of_a_space(model):
    from dsbrdf.space import build_space

    models = [model, changed(model, kappa=0.8), changed(model, gamma=3.0)]
    space = build_space(models)
    places = layout.place(models, space)
    n = places.coordinates.shape[1]
    np.testing.assert_allclose(places.coordinates, space.fpca.scores[:, :n])
    assert "scores of the space" in places.about
    text = page(models, space=space)
    found = numbers(part(text, "floats"), "<f4")[: 3 * (2 + n)].reshape(3, 2 + n)
    np.testing.assert_allclose(found, np.hstack([places.at, places.coordinates]), rtol=1e-6)


def test_a_material_of_a_collection_takes_few_bytes(model, rng):
    """Names, errors and numbers of hundreds; what they have in common is there once."""
    lobes = model.lobes
    models = [
        model.replace(
            name=f"material {i}",
            profile=None,
            lobes=lobes.replace(scale=lobes.scale + rng.normal(0, 1, (2, 1))),
        )
        for i in range(300)
    ]
    one, many = page(models[:2]), page(models)
    # Of 36 numbers in single precision, ten for the map, errors and a hash
    assert (len(many) - len(one)) / 298 < 450


def test_modules_are_put_in_order(monkeypatch):
    texts = {
        "main": 'import { b, c } from "./b.js";\nimport { a } from "./a.js";\nb(a, c);\n',
        "b": 'import { a } from "./a.js";\nexport const c = 1;\nexport function b() {\n  return a;\n}\n',
        "a": "export class a {}\n",
    }
    monkeypatch.setattr(script, "_read", texts.get)
    text = script.bundle()
    assert re.findall(r"^modules\.(\w+) =", text, re.MULTILINE) == ["a", "b", "main"]
    assert "return { c, b };" in text
    assert "const { b, c } = modules.b;" in text
    assert not re.search(r"^(import|export)\b", text, re.MULTILINE)


@pytest.mark.parametrize("line", ['import * as b from "./b.js";', "export let b = 1;", "export default 1;"])
def test_other_forms_of_import_are_refused(monkeypatch, line):
    monkeypatch.setattr(script, "_read", lambda _: f"{line}\n")
    with pytest.raises(ValueError, match=re.escape(f"main.js: {line!r} is no form of import or export")):
        script.bundle()


def test_what_is_written_is_minified(model):
    text = page(model)
    whole = script.bundle()
    small = script.minified()
    assert small in text
    assert len(small) < 0.75 * len(whole)
    shaders = json.loads(part(text, "shaders"))
    sources = shader.sources()
    assert shaders["dsbrdf"] == sources["dsbrdf"]
    assert len(shaders["sphere"]) < 0.75 * len(sources["sphere"])


def test_the_minifier_can_read_the_scripts():
    """It knows no template literal inside of another."""
    assert not re.findall(r"`[^`]*\$\{[^}`]*`", script.bundle())


def test_notebooks_show_the_page(model):
    text = model._repr_html_()
    assert text == frame(model)
    inside = html.unescape(re.search(r'srcdoc="([^"]*)"', text)[1])
    assert inside == page(model)


def test_nothing_is_left_of_a_page_that_cannot_be_written(model, tmp_path):
    (tmp_path / "page.html").mkdir()
    with pytest.raises(OSError, match=r"page\.html"):
        view(model, tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_targets(model, tmp_path):
    model.save(tmp_path / "b.json")
    model.save(tmp_path / "a.json")
    (tmp_path / ".record.json").write_text("{}")
    assert collect.expand([tmp_path, "matte"]) == [f"{tmp_path}/a.json", f"{tmp_path}/b.json", "matte"]
    opened = collect.open_model(f"{tmp_path}/a.json")
    np.testing.assert_array_equal(opened.lobes.scale, model.lobes.scale)
    told = []
    assert collect.open_model("matte", told.append).name == "matte"
    assert told == ["matte"]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ValueError, match=r"empty: no model file \(\.json\) and no measured file"):
        collect.expand([empty])


def test_command(model, tmp_path, capsys):
    model.save(tmp_path / "gold.json")
    out = tmp_path / "pages" / "gold.html"
    assert cli.main(["view", str(tmp_path / "gold.json"), "-o", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert out.read_text() == page(dsbrdf.load(tmp_path / "gold.json"))
    assert cli.main(["view", str(tmp_path / "none.json"), "-o", str(out)]) == 1
    assert "none.json: No such file" in capsys.readouterr().err


def test_fit_writes_the_page(tmp_path, capsys):
    assert cli.main(["fit", "matte", "--lobes", "1", "--view", "-o", str(tmp_path / "fit")]) == 0
    text = (tmp_path / "fit" / collect.PAGE).read_text()
    assert described(text)[0]["name"] == "matte"
    assert cli.main(["fit", "matte", "--view"]) == 2
    assert "the page needs a folder: add -o DIR" in capsys.readouterr().err


def test_demo_writes_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr("dsbrdf.measured.built_in.names", lambda: ("matte",))
    monkeypatch.setattr("dsbrdf.cli.demo.missing_plots", lambda: "no matplotlib")
    assert cli.main(["demo", "--view", "-o", str(tmp_path / "demo")]) == 0
    assert (tmp_path / "demo" / collect.PAGE).exists()
