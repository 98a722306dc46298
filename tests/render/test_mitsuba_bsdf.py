"""The plugin `dsbrdf`: its values against NumPy, its sampler against its density, its gradients, in scenes."""

import drjit as dr
import mitsuba as mi
import mitsuba_tools as tools
import numpy as np
import pytest
from models import random_model, upper
from tables import built_in, lobes, quiet_fit

import dsbrdf
from dsbrdf import DSBRDF, render
from dsbrdf.measured import built_in as materials

THETA_I = np.deg2rad([0.0, 30.0, 60.0, 80.0])
NEAR_MIRROR = lobes([5.0, 0.5], [2e4, 300.0], [0.0, 0.0])
SPIKED = lobes([2.0, 0.15], [300.0, 0.3], [0.3, -0.2]).replace(spike=np.full((6, 3), 400.0) * [1.0, 2.0, 0.5])
OWN = {"near-mirror": NEAR_MIRROR, "spike": SPIKED}
METALS = ("nickel", "chrome", "gold-paint")
CHI2_TESTS = 4 * (len(materials.names()) + len(METALS) + len(OWN))


@pytest.fixture(autouse=True)
def variant():
    tools.compiled()


@pytest.fixture(scope="module")
def fitted():
    """Call with a name: the model of a built-in material with three lobes."""
    models = {}

    def model(name):
        if name not in models:
            models[name] = quiet_fit(built_in(name), 3).model
        return models[name]

    return model


def toward(theta):
    return np.array([np.sin(theta), 0.0, np.cos(theta)])


def pairs(rng, n=4000):
    """Directions above the horizon: far apart, and near the mirror direction."""
    wi = upper(rng, n)
    wo = np.concatenate(
        [upper(rng, n // 2), wi[n // 2 :] * [-1, -1, 1] + 0.03 * rng.normal(size=(n // 2, 3))]
    )
    wo[:, 2] = np.abs(wo[:, 2])
    wi, wo = (
        w.astype(np.float32).astype(float) for w in (wi, wo / np.linalg.norm(wo, axis=1, keepdims=True))
    )
    return tuple(w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))


@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic", "matte"])
def test_values_are_those_of_numpy(fitted, name, rng):
    model, (wi, wo) = fitted(name), pairs(rng)
    value, density = tools.evaluate(tools.load(model), wi, wo)
    expected = model.eval(wi, wo)
    error = np.abs(value / expected - 1.0).max(1)
    # Single precision: its rounding of a direction is seen through the slope of a lobe
    assert np.median(error) < 1e-6
    assert np.quantile(error, 0.99) < 1e-4
    assert (density > 0.0).all()


@pytest.mark.parametrize("n_slices", [1, 2, 7, 90])
def test_any_slices_and_lobes(n_slices, rng):
    """Uneven theta_d, beta and spikes, up to as many slices as a table has rows."""
    model = random_model(n_slices, n_slices=n_slices, n_lobes=1 + n_slices % 4)
    # Uneven, but not so close that single precision cannot tell them apart
    model = model.replace(theta_d=(np.arange(n_slices) + rng.uniform(0.2, 0.8, n_slices)) * 1.5 / n_slices)
    wi, wo = pairs(rng)
    value, _ = tools.evaluate(tools.load(model), wi, wo)
    error = np.abs(value - model.eval(wi, wo)) / (model.eval(wi, wo) + 1e-6)
    assert np.median(error) < 5e-5
    # Neighbours without likeness: single precision shows in the weight of a slice
    assert np.quantile(error, 0.99) < 5e-3


def test_near_mirror(rng):
    """A lobe of half a degree, at and off its peak: `expm1` and the logarithm of the cosine must not cancel."""
    theta = np.repeat(THETA_I, 500)
    wi = toward(0.0) * np.cos(theta)[:, None] + np.array([1.0, 0, 0]) * np.sin(theta)[:, None]
    wo = wi * [-1, -1, 1] + 0.01 * rng.normal(size=wi.shape)
    wi, wo = (
        w.astype(np.float32).astype(float) for w in (wi, wo / np.linalg.norm(wo, axis=1, keepdims=True))
    )
    wi, wo = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))
    wi, wo = (w[wo[:, 2] > 0.0] for w in (wi, wo))
    value, _ = tools.evaluate(tools.load(NEAR_MIRROR), wi, wo)
    error = np.abs(value / NEAR_MIRROR.eval(wi, wo) - 1.0)
    assert np.quantile(error, 0.99) < 2e-3
    assert error.max() < 0.02


def test_reciprocity(fitted, rng):
    bsdf, (wi, wo) = tools.load(fitted("rough-gold")), pairs(rng)
    there, back = (tools.evaluate(bsdf, *both)[0] for both in ((wi, wo), (wo, wi)))
    # But for the division by the cosine, to the last bit
    np.testing.assert_allclose(there, back, rtol=3e-7)


def test_eval_pdf_and_sample_agree(fitted, rng):
    bsdf = tools.load(fitted("glossy-plastic"))
    wi = toward(0.7)
    wo, density, weight = tools.draw(bsdf, wi, rng, 1000)
    above = wo[:, 2] > 0.0
    assert (weight[~above] == 0.0).all()
    wo, density, weight = wo[above], density[above], weight[above]
    value, again = tools.evaluate(bsdf, np.broadcast_to(wi, wo.shape), wo)
    np.testing.assert_allclose(density, again, rtol=1e-3)
    np.testing.assert_allclose(weight, value * wo[:, 2:] / again[:, None], rtol=1e-3)
    si, there = tools.interaction(np.broadcast_to(wi, wo.shape)), tools.vectors(wo)
    context = mi.BSDFContext()
    both = bsdf.eval_pdf(context, si, there)
    np.testing.assert_array_equal(np.array(both[0]), np.array(bsdf.eval(context, si, there)))
    np.testing.assert_array_equal(np.array(both[1]), np.array(bsdf.pdf(context, si, there)))


def test_nothing_below_the_horizon(fitted):
    bsdf = tools.load(fitted("matte"))
    up, down = toward(0.3), toward(0.3) * [1, 1, -1]
    for wi, wo in ((up, down), (down, up), (down, down)):
        value, density = tools.evaluate(bsdf, wi, wo)
        assert not value.any()
        assert not density.any()


@pytest.mark.parametrize("theta_i", THETA_I, ids=lambda x: f"{np.rad2deg(x):.0f}")
@pytest.mark.parametrize("name", [*materials.names(), *OWN])
def test_chi_square(fitted, name, theta_i):
    model = OWN[name] if name in OWN else fitted(name)
    test = tools.chi2_test(tools.load(model), theta_i)
    assert test.run(0.01, CHI2_TESTS, quiet=True), test.messages
    # The grid sees all of the density; what is missing falls below the horizon
    assert 0.9 < test.pdf_sum[0] < 1.001


@pytest.mark.shared
@pytest.mark.parametrize("name", METALS)
def test_chi_square_of_metals(decoded, name):
    bsdf = tools.load(quiet_fit(dsbrdf.read(decoded(name)), 3).model)
    for theta_i in THETA_I:
        test = tools.chi2_test(bsdf, theta_i)
        assert test.run(0.01, CHI2_TESTS, quiet=True), test.messages


@pytest.mark.parametrize("theta_i", THETA_I[:2], ids=lambda x: f"{np.rad2deg(x):.0f}")
def test_chi_square_sees_a_wrong_density(fitted, theta_i):
    """Lobes a quarter off in gamma are found, at the pole of a near-mirror too."""
    for model in (fitted("rough-gold"), NEAR_MIRROR):
        bsdf, wrong = tools.load(model), tools.load(model.replace(gamma=1.25 * model.gamma))
        assert not tools.chi2_test(bsdf, theta_i, wrong).run(0.01, 1, quiet=True)


@pytest.mark.parametrize("theta_i", THETA_I, ids=lambda x: f"{np.rad2deg(x):.0f}")
@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic", "polished-chrome", "grey-primer"])
def test_mean_weight_is_the_albedo(fitted, name, theta_i, rng):
    """White furnace: what is reflected of light from everywhere, against quadrature."""
    model = fitted(name)
    _, _, weight = tools.draw(tools.load(model), toward(theta_i), rng, 1_000_000)
    np.testing.assert_allclose(weight.mean(0), model.albedo(theta_i), atol=1e-3)


def test_samples_are_quiet(fitted, rng):
    """Weights vary at most a quarter as much as with cosine sampling, on what is glossy."""
    looked_at = 0
    for name in materials.names():
        model, bsdf = fitted(name), tools.load(fitted(name))
        for theta_i in THETA_I[:3]:
            _, _, weight = tools.draw(bsdf, toward(theta_i), rng, 50_000)
            wo = cosine_directions(rng, 50_000)
            of_cosine = np.pi * model.eval(toward(theta_i), wo).mean(-1)
            if of_cosine.std() > of_cosine.mean():
                looked_at += 1
                assert weight.mean(-1).std() < 0.25 * of_cosine.std(), name
    assert looked_at > 8


def cosine_directions(rng, n):
    radius2, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
    x, y = np.sqrt(radius2) * np.cos(phi), np.sqrt(radius2) * np.sin(phi)
    return np.stack([x, y, np.sqrt(1.0 - radius2)], axis=-1)


@pytest.mark.parametrize("key", ["log_kappa", "log_gamma", "beta", "spike"])
def test_gradients_of_values(key, rng):
    """Against finite differences of NumPy's values in double precision."""
    model = lobes([2.0, 0.3], [60.0, 1.5], [0.3, -0.2]).replace(spike=np.full((6, 3), 5.0))
    wi, wo = pairs(rng, 400)
    wo[:100] = wi[:100] * [-1, -1, 1]
    bsdf = tools.load(model)
    parameters = mi.traverse(bsdf)
    dr.enable_grad(parameters[key])
    parameters.update()
    value = bsdf.eval(mi.BSDFContext(), tools.interaction(wi), tools.vectors(wo))
    dr.backward(dr.sum(value, axis=None))
    gradient = np.array(dr.grad(parameters[key]))

    name = key.removeprefix("log_")
    for index in np.ndindex(gradient.shape):
        change = np.zeros(gradient.shape)
        change[index] = 1e-4
        sides = []
        for sign in (1.0, -1.0):
            old = getattr(model, name)
            new = old * np.exp(sign * change) if key.startswith("log") else old + sign * change
            sides.append((model.replace(**{name: new}).eval(wi, wo) * wo[:, 2:]).sum())
        expected = (sides[0] - sides[1]) / 2e-4
        assert abs(gradient[index] - expected) < 0.01 * abs(expected) + 1e-4 * np.abs(gradient).max()


def scene(bsdf, **more):
    return {
        "type": "scene",
        "integrator": {"type": "prb", "max_depth": 3},
        "sensor": {
            "type": "perspective",
            "fov": 30.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 4.2], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}},
        },
        "light": {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.random.default_rng(1).random((8, 16, 3), np.float32)),
        },
        "sphere": {"type": "sphere", "bsdf": bsdf},
        **more,
    }


@pytest.mark.parametrize("key", ["log_kappa", "log_gamma"])
def test_gradients_of_a_picture(fitted, key, monkeypatch):
    """A scale of one parameter, with the same samples on both sides."""
    world = mi.load_dict(scene(render.to_dict(fitted("rough-gold"))))
    parameters = mi.traverse(world)
    name = f"sphere.bsdf.{key}"
    start = mi.TensorXf(parameters[name])

    def mean(shift):
        parameters[name] = start + shift
        parameters.update()
        return dr.mean(mi.render(world, parameters, seed=3, spp=64), axis=None)

    shift = mi.Float(0.0)
    dr.enable_grad(shift)
    dr.backward(mean(shift))
    # Tables that follow the parameters would move the samples
    bsdf = world.shapes()[0].bsdf()
    monkeypatch.setattr(bsdf, "set_tables", lambda _: None)
    step = 0.02
    difference = (np.array(mean(step)) - np.array(mean(-step))) / (2.0 * step)
    np.testing.assert_allclose(np.array(dr.grad(shift))[0], difference, rtol=0.01)


@pytest.mark.slow
def test_an_optimiser_finds_a_parameter(fitted):
    """Adam on the logarithm of kappa, from a material too dark by half."""
    target = fitted("satin-plastic")
    picture = mi.render(mi.load_dict(scene(render.to_dict(target))), spp=64)
    world = mi.load_dict(scene(render.to_dict(target.replace(kappa=0.5 * target.kappa))))
    parameters = mi.traverse(world)
    name = "sphere.bsdf.log_kappa"
    optimiser = mi.ad.Adam(lr=0.05, params={name: parameters[name]})
    errors = []
    for i in range(15):
        parameters.update(optimiser)
        error = dr.mean(dr.square(mi.render(world, parameters, spp=8, seed=i) - picture), axis=None)
        dr.backward(error)
        optimiser.step()
        errors.append(error.array[0])
    assert errors[-1] < 0.3 * errors[0]


def test_several_in_one_scene(fitted):
    """Instances with one and with three lobes, in `twosided` and in `blendbsdf`."""
    one, three = fitted("rough-gold").lobe(0), fitted("glossy-plastic")
    blend = {"type": "blendbsdf", "weight": 0.5, "a": render.to_dict(one), "b": render.to_dict(three)}
    move = mi.ScalarTransform4f().translate([0.8, 0, 0]).scale(0.3)
    more = {
        "other": {"type": "sphere", "to_world": move, "bsdf": {"type": "twosided", "b": render.to_dict(one)}}
    }
    picture = np.array(mi.render(mi.load_dict(scene(blend, **more)), spp=4))
    assert np.isfinite(picture).all()
    assert picture.mean() > 0.01

    # A blend of values
    wi, wo = pairs(np.random.default_rng(0), 100)
    value, _ = tools.evaluate(mi.load_dict(blend), wi, wo)
    np.testing.assert_allclose(value, 0.5 * (one.eval(wi, wo) + three.eval(wi, wo)), rtol=1e-3)


def test_model_files_in_dict_and_xml(fitted, tmp_path, rng):
    model, (wi, wo) = fitted("rough-copper"), pairs(rng, 100)
    model.save(tmp_path / "copper.json")
    by_name = mi.load_dict({"type": "dsbrdf", "filename": str(tmp_path / "copper.json")})
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="dsbrdf">'
        '<string name="filename" value="copper.json"/></bsdf></shape></scene>'
    )
    in_xml = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].bsdf()
    expected, _ = tools.evaluate(tools.load(model), wi, wo)
    for bsdf in (by_name, in_xml):
        np.testing.assert_allclose(tools.evaluate(bsdf, wi, wo)[0], expected, rtol=1e-4)
    assert "lobes = 3" in str(by_name)
    assert "rough-copper" in str(by_name)


def test_one_channel_is_grey(rng):
    model, (wi, wo) = random_model(3, n_channels=1), pairs(rng, 100)
    value, _ = tools.evaluate(tools.load(model), wi, wo)
    np.testing.assert_array_equal(value[:, 0], value[:, 2])
    np.testing.assert_allclose(value[:, :1], model.eval(wi, wo), rtol=1e-3, atol=1e-6)


def test_black_lobes_are_sampled():
    """Nothing to reflect: a density all the same, and no division by zero."""
    shape = (3, 3, 2)
    model = DSBRDF(np.array([0.1, 0.5, 1.0]), np.full(shape, 1e-30), np.full(shape, 0.0), np.zeros(shape))
    _, density, weight = tools.draw(tools.load(model), toward(0.4), np.random.default_rng(0), 1000)
    assert np.isfinite(density).all()
    assert np.abs(weight).max() < 1e-20


def test_new_values_are_sampled_anew(fitted, rng):
    """Parameters set by hand bring their own tables; the density stays that of the samples."""
    bsdf = tools.load(fitted("rough-gold").lobe(0))
    parameters = mi.traverse(bsdf)
    parameters["log_gamma"] = parameters["log_gamma"] + np.log(50.0)
    parameters.update()
    assert tools.chi2_test(bsdf, 0.5).run(0.01, 1, quiet=True)
    wo, _, _ = tools.draw(bsdf, toward(0.5), rng, 2000)
    before, _, _ = tools.draw(tools.load(fitted("rough-gold").lobe(0)), toward(0.5), rng, 2000)
    assert np.median(1.0 - wo @ toward(-0.5)) < 0.1 * np.median(1.0 - before @ toward(-0.5))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"n_channels": 2}, "needs 1 or 3 channels, the model has 2"),
        ({"kappa": 200.0}, "'kappa' must be at most 87 in single precision, got 200"),
    ],
)
def test_models_that_do_not_fit(changes, text):
    model = random_model(n_channels=changes.get("n_channels", 3))
    if "kappa" in changes:
        model = model.replace(kappa=np.full_like(model.kappa, changes["kappa"]))
    with pytest.raises(RuntimeError, match=text):
        tools.load(model)


def test_scenes_that_say_too_much_or_too_little(fitted, tmp_path):
    fitted("matte").save(tmp_path / "matte.json")
    arrays = render.to_dict(fitted("matte"))
    with pytest.raises(RuntimeError, match="either 'filename' or arrays, got 'filename' and 'theta_d'"):
        mi.load_dict({**arrays, "filename": str(tmp_path / "matte.json")})
    del arrays["kappa"]
    with pytest.raises(RuntimeError, match="'kappa' is missing"):
        mi.load_dict(arrays)
