"""The plugin `dsbrdf`: its values against NumPy, its sampler against its density, its gradients, in scenes."""

import drjit as dr
import mitsuba as mi
import mitsuba_tools as tools
import numpy as np
import pytest
from by_hand import by_hand
from models import upper
from scipy import stats

import dsbrdf
from dsbrdf import DSBRDF, render
from dsbrdf.model.lobes import Lobes

THETA_I = np.deg2rad([0.0, 30.0, 60.0, 80.0])
MODELS = {
    "matte": by_hand([0.12, 0.02], [0.05, 2.0], [0.0, 0.5], name="matte"),
    "rough-gold": by_hand([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3], tint=(1.2, 0.9, 0.4), name="rough-gold"),
    "glossy-plastic": by_hand([2.0, 0.15, 0.4], [300.0, 0.3, 30.0], [0.3, -0.2, 0.1], name="glossy-plastic"),
    "near-mirror": by_hand([5.0, 0.5], [2e4, 300.0], [0.0, 0.0], name="near-mirror"),
}
METALS = ("nickel", "chrome", "gold-paint")
CHI2_TESTS = 4 * (len(MODELS) + len(METALS))


def some_model(seed=1, sizes=(6, 4, 3, 1, 2), n_lobes=3, n_channels=3):
    """Curves of these sizes (scale, gamma, beta, falloff, colour) with random coefficients."""
    rng = np.random.default_rng(seed)
    scale, gamma, beta, falloff, colour = sizes
    lobes = Lobes(
        rng.uniform(-2.0, 1.0, (n_lobes, scale)),
        np.linspace(0.0, 5.0, n_lobes)[:, None] + rng.uniform(-0.5, 0.5, (n_lobes, gamma)),
        rng.uniform(-0.8, 0.8, (n_lobes, beta)),
        rng.uniform(-0.5, 2.0, (n_lobes, falloff)),
        rng.uniform(-0.5, 0.5, (n_channels, n_lobes, colour)),
    )
    return DSBRDF(lobes, name=f"random {seed}")


@pytest.fixture(autouse=True)
def variant():
    tools.compiled()


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
def test_values_are_those_of_numpy(name, rng):
    model, (wi, wo) = MODELS[name], pairs(rng)
    value, density = tools.evaluate(tools.load(model), wi, wo)
    expected = model.eval(wi, wo)
    error = np.abs(value / expected - 1.0).max(1)
    # Single precision: its rounding of a direction is seen through the slope of a lobe
    assert np.median(error) < 1e-6
    assert np.quantile(error, 0.99) < 1e-4
    # The known direction of the plugin is wi
    np.testing.assert_allclose(density, model.pdf(wo, wi), rtol=2e-3)
    assert np.median(np.abs(density / model.pdf(wo, wi) - 1.0)) < 1e-5


@pytest.mark.parametrize(
    "sizes",
    [(1, 1, 1, 1, 1), (2, 2, 2, 2, 2), (3, 3, 3, 3, 3), (6, 4, 3, 1, 2), (4, 7, 5, 6, 1), (9, 1, 4, 2, 5)],
)
@pytest.mark.parametrize("n_channels", [1, 3])
def test_curves_of_any_size(sizes, n_channels, rng):
    """Up to more spans than a fit has, alone and with others."""
    model = some_model(sum(sizes), sizes, n_lobes=1 + sizes[0] % 4, n_channels=n_channels)
    wi, wo = pairs(rng)
    value, _ = tools.evaluate(tools.load(model), wi, wo)
    error = np.abs(value / model.eval(wi, wo) - 1.0)
    assert np.median(error) < 1e-6
    assert np.quantile(error, 0.999) < 3e-4


def test_what_is_beyond_single_precision_is_finite(rng):
    """Parameters that an optimiser may come to: no value or density is infinite or NaN."""
    model = MODELS["glossy-plastic"]
    bsdf = tools.load(model)
    parameters = mi.traverse(bsdf)
    for key, change in (("scale", 9.0), ("gamma", 30.0), ("beta", 60.0), ("colour", 9.0)):
        kept = mi.TensorXf(parameters[key])
        for sign in (1.0, -1.0):
            parameters[key] = kept + sign * change
            dr.enable_grad(parameters[key])
            parameters.update()
            value, density = tools.evaluate(bsdf, *pairs(rng, 500))
            assert np.isfinite(value).all()
            assert np.isfinite(density).all()
        parameters[key] = kept
        parameters.update()


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
    value, _ = tools.evaluate(tools.load(MODELS["near-mirror"]), wi, wo)
    error = np.abs(value / MODELS["near-mirror"].eval(wi, wo) - 1.0)
    assert np.quantile(error, 0.99) < 2e-3
    assert error.max() < 0.02


def test_reciprocity(rng):
    bsdf, (wi, wo) = tools.load(MODELS["rough-gold"]), pairs(rng)
    there, back = (tools.evaluate(bsdf, *both)[0] for both in ((wi, wo), (wo, wi)))
    # But for the division by the cosine, to the last bit
    np.testing.assert_allclose(there, back, rtol=3e-7)


def test_eval_pdf_and_sample_agree(rng):
    bsdf = tools.load(MODELS["glossy-plastic"])
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


def test_nothing_below_the_horizon():
    bsdf = tools.load(MODELS["matte"])
    up, down = toward(0.3), toward(0.3) * [1, 1, -1]
    for wi, wo in ((up, down), (down, up), (down, down)):
        value, density = tools.evaluate(bsdf, wi, wo)
        assert not value.any()
        assert not density.any()


@pytest.mark.parametrize("theta_i", THETA_I, ids=lambda x: f"{np.rad2deg(x):.0f}")
@pytest.mark.parametrize("name", MODELS)
def test_chi_square(name, theta_i):
    test = tools.chi2_test(tools.load(MODELS[name]), theta_i)
    assert test.run(0.01, CHI2_TESTS, quiet=True), test.messages
    # The grid sees all of the density; what is missing falls below the horizon
    assert 0.9 < test.pdf_sum[0] < 1.001


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore:.*the search ended")
@pytest.mark.parametrize("name", METALS)
def test_chi_square_of_metals(decoded, name):
    bsdf = tools.load(dsbrdf.fit(dsbrdf.read(decoded(name))).model)
    for theta_i in THETA_I:
        test = tools.chi2_test(bsdf, theta_i)
        assert test.run(0.01, CHI2_TESTS, quiet=True), test.messages


@pytest.mark.parametrize("theta_i", THETA_I[:2], ids=lambda x: f"{np.rad2deg(x):.0f}")
def test_chi_square_sees_a_wrong_density(theta_i):
    """Lobes of other widths are found, at the pole of a near-mirror too."""
    for model in (MODELS["rough-gold"], MODELS["near-mirror"]):
        lobes = model.lobes
        other = model.replace(lobes=lobes.replace(gamma=lobes.gamma + np.log(1.5)))
        bsdf, wrong = tools.load(model), tools.load(other)
        assert not tools.chi2_test(bsdf, theta_i, wrong).run(0.01, 1, quiet=True)


@pytest.mark.parametrize("theta_i", THETA_I, ids=lambda x: f"{np.rad2deg(x):.0f}")
@pytest.mark.parametrize("name", MODELS)
def test_mean_weight_is_the_albedo(name, theta_i, rng):
    """White furnace: what is reflected of light from everywhere, against quadrature."""
    model = MODELS[name]
    _, _, weight = tools.draw(tools.load(model), toward(theta_i), rng, 1_000_000)
    limit = stats.norm.isf(1e-4) * weight.std(0) / 1000.0 + 3e-4 * model.albedo(theta_i)
    assert (np.abs(weight.mean(0) - model.albedo(theta_i)) < limit).all()


@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic", "near-mirror"])
def test_samples_are_those_of_numpy(name, rng):
    """As quiet, and a third as noisy as with cosine sampling at most."""
    model, bsdf = MODELS[name], tools.load(MODELS[name])
    n = 50_000
    for theta_i in THETA_I:
        w = toward(theta_i)
        _, _, weight = tools.draw(bsdf, w, rng, n)
        wo = cosine_directions(rng, n)
        of_cosine = np.pi * model.eval(w, wo).mean(-1)
        drawn = model.sample(np.broadcast_to(w, (n, 3)), rng)
        drawn = drawn[drawn[:, 2] > 0.0]
        of_numpy = model.eval(drawn, w).mean(-1) * drawn[:, 2] / model.pdf(drawn, w)
        of_numpy = np.append(of_numpy, np.zeros(n - len(of_numpy)))
        assert weight.mean(-1).std() == pytest.approx(of_numpy.std(), rel=0.15)
        assert weight.mean(-1).std() < 0.35 * of_cosine.std(), name


def cosine_directions(rng, n):
    radius2, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
    x, y = np.sqrt(radius2) * np.cos(phi), np.sqrt(radius2) * np.sin(phi)
    return np.stack([x, y, np.sqrt(1.0 - radius2)], axis=-1)


@pytest.mark.parametrize("sizes", [(6, 4, 3, 1, 2), (2, 1, 1, 2, 1)])
@pytest.mark.parametrize("key", ["scale", "gamma", "beta", "falloff", "colour"])
def test_gradients_of_values(key, sizes, rng):
    """Against finite differences of NumPy's values in double precision."""
    model = some_model(3, sizes, n_lobes=2)
    wi, wo = pairs(rng, 400)
    wo[:100] = wi[:100] * [-1, -1, 1]
    bsdf = tools.load(model)
    parameters = mi.traverse(bsdf)
    dr.enable_grad(parameters[key])
    parameters.update()
    value = bsdf.eval(mi.BSDFContext(), tools.interaction(wi), tools.vectors(wo))
    dr.backward(dr.sum(value, axis=None))
    gradient = np.array(dr.grad(parameters[key]))

    for index in np.ndindex(gradient.shape):
        sides = []
        for sign in (1.0, -1.0):
            changed = getattr(model.lobes, key).copy()
            changed[index] += sign * 1e-4
            other = model.replace(lobes=model.lobes.replace(**{key: changed}))
            sides.append((other.eval(wi, wo) * wo[:, 2:]).sum())
        expected = (sides[0] - sides[1]) / 2e-4
        assert abs(gradient[index] - expected) < 0.01 * abs(expected) + 1e-4 * np.abs(gradient).max()


@pytest.mark.parametrize("key", ["scale", "colour"])
def test_forward_gradients_of_values(key, rng):
    """A shift of one parameter, in forward mode, is that of finite differences in double precision at each pair."""
    model = some_model(3, (2, 1, 1, 2, 1), n_lobes=2)
    wi, wo = pairs(rng, 400)
    bsdf = tools.load(model)
    parameters = mi.traverse(bsdf)
    shift = mi.Float(0.0)
    dr.enable_grad(shift)
    parameters[key] = mi.TensorXf(parameters[key]) + shift
    parameters.update()
    value = bsdf.eval(mi.BSDFContext(), tools.interaction(wi), tools.vectors(wo))
    dr.forward(shift)
    gradient = np.array(dr.grad(value)).T
    sides = [
        model.replace(lobes=model.lobes.replace(**{key: getattr(model.lobes, key) + step})).eval(wi, wo)
        for step in (1e-4, -1e-4)
    ]
    expected = (sides[0] - sides[1]) / 2e-4 * wo[:, 2:]
    np.testing.assert_allclose(gradient, expected, rtol=0.01, atol=1e-3 * np.abs(expected).max())


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


@pytest.mark.parametrize("key", ["scale", "gamma", "colour"])
def test_gradients_of_a_picture(key, monkeypatch):
    """A shift of one parameter, with the same samples on both sides."""
    world = mi.load_dict(scene(render.to_dict(MODELS["rough-gold"])))
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
def test_an_optimiser_finds_a_parameter():
    """Adam on the logarithm of kappa, from a material too dark by half."""
    target = MODELS["glossy-plastic"]
    picture = mi.render(mi.load_dict(scene(render.to_dict(target))), spp=64)
    dark = target.replace(lobes=target.lobes.replace(scale=target.lobes.scale - np.log(2.0)))
    world = mi.load_dict(scene(render.to_dict(dark)))
    parameters = mi.traverse(world)
    name = "sphere.bsdf.scale"
    optimiser = mi.ad.Adam(lr=0.05, params={name: parameters[name]})
    errors = []
    for i in range(15):
        parameters.update(optimiser)
        error = dr.mean(dr.square(mi.render(world, parameters, spp=8, seed=i) - picture), axis=None)
        dr.backward(error)
        optimiser.step()
        errors.append(error.array[0])
    assert errors[-1] < 0.3 * errors[0]


def test_several_in_one_scene():
    """Instances with one and with three lobes, in `twosided` and in `blendbsdf`."""
    one, three = MODELS["rough-gold"].lobe(0), MODELS["glossy-plastic"]
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


def test_model_files_in_dict_and_xml(tmp_path, rng):
    model, (wi, wo) = MODELS["glossy-plastic"], pairs(rng, 100)
    model.save(tmp_path / "plastic.json")
    by_name = mi.load_dict({"type": "dsbrdf", "filename": str(tmp_path / "plastic.json")})
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="dsbrdf">'
        '<string name="filename" value="plastic.json"/></bsdf></shape></scene>'
    )
    in_xml = mi.load_file(str(tmp_path / "scene.xml")).shapes()[0].bsdf()
    expected, _ = tools.evaluate(tools.load(model), wi, wo)
    for bsdf in (by_name, in_xml):
        np.testing.assert_allclose(tools.evaluate(bsdf, wi, wo)[0], expected, rtol=1e-4)
    assert str(by_name) == (
        "DSBRDF[\n  name = 'glossy-plastic',\n  lobes = 3,\n  channels = 3,\n  azimuthal = True\n]"
    )


def test_arrays_of_a_scene(rng, capfd):
    """Shapes as documented, or with one more axis in front; what is not given has no effect."""
    wi, wo = pairs(rng, 100)
    scale, gamma = np.array([[0.1, 0.4], [-1.0, -1.2]]), np.array([[4.0], [0.5]])
    model = DSBRDF(Lobes(scale, gamma, np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((1, 2, 1))))
    for front in ((), (None,)):
        arrays = {
            name: mi.TensorXf(array[front] if front else array)
            for name, array in (("scale", scale.astype(np.float32)), ("gamma", gamma.astype(np.float32)))
        }
        value, _ = tools.evaluate(mi.load_dict({"type": "dsbrdf", **arrays}), wi, wo)
        np.testing.assert_allclose(value, np.repeat(model.eval(wi, wo), 3, axis=1), rtol=1e-3)
    # Neither does a model in memory make Mitsuba complain
    capfd.readouterr()
    tools.load(MODELS["glossy-plastic"])
    assert capfd.readouterr().err == ""


def test_numbers_in_the_kernel(rng):
    """The same values; an optimiser's gradients come through all the same."""
    model, (wi, wo) = MODELS["glossy-plastic"], pairs(rng, 1000)
    fixed = mi.load_dict(render.to_dict(model) | {"fixed": True})
    for a, b in zip(*(tools.evaluate(bsdf, wi, wo) for bsdf in (fixed, tools.load(model))), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5)
    parameters = mi.traverse(fixed)
    dr.enable_grad(parameters["gamma"])
    parameters.update()
    value = fixed.eval(mi.BSDFContext(), tools.interaction(wi), tools.vectors(wo))
    dr.backward(dr.sum(value, axis=None))
    assert np.array(dr.grad(parameters["gamma"])).all()


def test_one_channel_is_grey(rng):
    model, (wi, wo) = some_model(3, n_channels=1), pairs(rng, 100)
    value, _ = tools.evaluate(tools.load(model), wi, wo)
    np.testing.assert_array_equal(value[:, 0], value[:, 2])
    np.testing.assert_allclose(value[:, :1], model.eval(wi, wo), rtol=1e-3, atol=1e-6)


def test_black_lobes_are_sampled():
    """Nothing to reflect: a density all the same, and no division by zero."""
    model = by_hand([1e-30, 1e-30], [1e-6, 1.0], [0.0, 0.0])
    _, density, weight = tools.draw(tools.load(model), toward(0.4), np.random.default_rng(0), 1000)
    assert np.isfinite(density).all()
    assert np.abs(weight).max() < 1e-20


def test_new_values_are_sampled_anew(rng):
    """Parameters set by hand bring their own tables; the density stays that of the samples."""
    model = MODELS["rough-gold"].lobe(0)
    bsdf = tools.load(model)
    parameters = mi.traverse(bsdf)
    parameters["gamma"] = parameters["gamma"] + np.log(50.0)
    parameters.update()
    assert tools.chi2_test(bsdf, 0.5).run(0.01, 1, quiet=True)
    wo, _, _ = tools.draw(bsdf, toward(0.5), rng, 2000)
    before, _, _ = tools.draw(tools.load(model), toward(0.5), rng, 2000)
    assert np.median(1.0 - wo @ toward(-0.5)) < 0.1 * np.median(1.0 - before @ toward(-0.5))


def test_two_channels_are_refused():
    with pytest.raises(RuntimeError, match="needs 1 or 3 channels, the model has 2"):
        tools.load(some_model(n_channels=2))


@pytest.mark.parametrize("colours", [1, 2])
def test_lobes_too_high_for_single_precision(colours, rng):
    """As fits have them at grazing angles where nothing was measured: higher than any other, and finite."""
    model = by_hand([90.0, 0.2], [9.0, 1.0], [4.0, 0.0], rise=0.0)
    lobes = model.lobes
    model = model.replace(
        lobes=lobes.replace(colour=np.repeat(lobes.colour, colours, axis=2), falloff=[[-0.9], [0.0]])
    )
    wi, wo = pairs(rng, 1000)
    value, density = tools.evaluate(tools.load(model), wi, wo)
    assert np.isfinite(value).all()
    assert np.isfinite(density).all()
    assert value.max() > 1e18
    low = model.eval(wi, wo) < 1e15
    np.testing.assert_allclose(value[low], model.eval(wi, wo)[low], rtol=1e-3)


def test_scenes_that_say_too_much_or_too_little(tmp_path):
    MODELS["matte"].save(tmp_path / "matte.json")
    arrays = render.to_dict(MODELS["matte"])
    with pytest.raises(RuntimeError, match="either 'filename' or arrays, got 'filename' and 'scale'"):
        mi.load_dict({**arrays, "filename": str(tmp_path / "matte.json")})
    del arrays["gamma"]
    with pytest.raises(RuntimeError, match="'gamma' is missing"):
        mi.load_dict(arrays)
