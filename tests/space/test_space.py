"""Spaces of materials: correspondence and padding, round trips, blends, moves and draws, files."""

import dataclasses
import json

import numpy as np
import pytest
from spaces import smooth_model

from dsbrdf.measured.source import Source
from dsbrdf.model.components import half_width
from dsbrdf.space import Sizes, SpaceFormatError, SpaceSettings, build_space, load_space, lobe_fpca
from dsbrdf.space.correspondence import lobe_slots, pad, two_class_border
from dsbrdf.space.variables import Variables

VARIABLES = Variables(Sizes(), 3)
THETA_D = np.deg2rad([0.0, 25.0, 50.0, 75.0])


@pytest.fixture(scope="module")
def models():
    return [smooth_model(i, n_lobes=2 + i % 3) for i in range(14)]


@pytest.fixture(scope="module")
def space(models):
    return build_space(models)


def values_of(model):
    theta_h, theta_d = np.deg2rad([[0.0], [5.0], [30.0]]), np.deg2rad([3.0, 30.0, 55.0])
    return model.eval_angles(theta_h, theta_d, 0.5)


def assert_same_values(a, b, rtol):
    np.testing.assert_allclose(values_of(a), values_of(b), rtol=rtol)


def sharpness(model):
    return VARIABLES.sharpness(VARIABLES.of(model.lobes))


def assert_valid(model):
    """No more light than comes in, lobes in order, values that are finite and not negative."""
    assert model.albedo(np.deg2rad([0.0, 30.0, 60.0, 80.0])).max() <= 1.001
    assert (np.diff(sharpness(model)) >= -1e-9).all()
    values = values_of(model)
    assert (np.isfinite(values) & (values >= 0.0)).all()


def heights_and_widths(model):
    """ln of heights (theta_d, channel, lobe), and widths at half height (theta_d, lobe) of the mean channel."""
    at = model.lobes.at(THETA_D)
    widths = half_width(at.kappa.mean(1), at.gamma, at.falloff)
    return np.log(np.expm1(at.kappa)), np.log(widths)


# Correspondence


def test_lobes_are_ordered_by_gamma_whatever_their_order(space, models):
    model = models[2]
    shuffled = model.replace(lobes=model.lobes.take([2, 0, 3, 1]))
    np.testing.assert_allclose(space.encode(shuffled), space.encode(model), atol=1e-12)
    assert (np.diff(VARIABLES.sharpness(space.encode(model))) > 0.0).all()


def test_slots_along_the_border():
    np.testing.assert_array_equal(lobe_slots(np.array([5.0, 0.2, 0.1]), 1.0, 2), [2, 1, 0])
    np.testing.assert_array_equal(lobe_slots(np.array([0.1, 5.0, 9.0]), 1.0, 2), [1, 2, 3])
    np.testing.assert_array_equal(lobe_slots(np.array([5.0, 0.2, 0.1]), -np.inf, 0), [2, 1, 0])


def test_border_is_the_best_split_in_two():
    assert two_class_border([np.array([0.1, 4.0]), np.array([0.2, 0.3, 4.2])]) == pytest.approx(
        0.5 * (0.2 + 4.1)
    )
    assert two_class_border([np.ones(2), np.ones(3)]) == -np.inf


def test_padding_is_dark_with_the_shape_of_the_neighbour():
    rows = VARIABLES.of(smooth_model(1, 2).lobes)
    padded, present = pad(rows, np.array([2, 1]), 4, VARIABLES)
    np.testing.assert_array_equal(present, [False, True, True, False])
    np.testing.assert_array_equal(padded[1:3], rows[::-1])
    parts = VARIABLES.parts(padded)
    assert (parts.height[[0, 3]] == VARIABLES.dark).all()
    assert (parts.colour[[0, 3]] == 0.0).all()
    for shape in (parts.gamma, parts.beta, parts.falloff):
        np.testing.assert_array_equal(shape[[0, 3]], shape[[1, 2]])


def test_dark_lobes_reflect_nothing(space, models):
    decoded = space.decode(space.curves[0])
    assert models[0].n_lobes == decoded.n_lobes == 2 < space.n_slots


def test_border_space_has_slots_on_both_sides(models):
    space = build_space(models, correspondence="border")
    assert np.isfinite(space.border)
    assert 0 < space.n_diffuse < space.n_slots
    assert (space.present.sum(1) == [model.n_lobes for model in models]).all()
    gaps = np.abs(np.diff(np.pad(space.present.astype(int), ((0, 0), (1, 1))), axis=1)).sum(1)
    assert (gaps == 2).all()


# The space


def test_encode_and_decode_are_inverse(space, models):
    for model in models[:4]:
        assert_same_values(space.decode(space.encode(model)), model, 1e-9)


def test_all_components_reconstruct(space, models):
    for i in (0, 5):
        full = space.model(space.fpca.scores[i])
        assert_same_values(full, space.decode(space.curves[i]), 1e-6)
        np.testing.assert_allclose(space.scores(models[i]), space.fpca.scores[i], atol=1e-6)


def test_positive_scores_are_sharper(space):
    functions = space.fpca.functions.reshape(-1, *space.curves.shape[1:])
    assert (VARIABLES.sharpness(functions).sum(1) >= -1e-9).all()


def test_own_material_is_the_nearest(space, models):
    names = [name for name, _ in space.nearest(models[3], n=3)]
    assert names[0] == models[3].name
    assert space.nearest(models[3], n=1)[0][1] == pytest.approx(0.0, abs=1e-6)
    assert len(space.nearest(models[3], n=100)) == len(models)


def test_ends_of_a_blend_are_the_materials(space, models):
    a, b = models[0], models[2]
    assert_same_values(space.blend(a, b, 0.0), a, 1e-9)
    assert_same_values(space.blend(a, b, 1.0), b, 1e-9)
    assert space.blend(a, b, 0.0).n_lobes == a.n_lobes


def test_blends_lie_between(space, models):
    """Shapes of lobes half-way, and the albedo: heights follow from it."""
    ends, blend = models[:2], space.blend(models[0], models[1], 0.5)
    a, b, half = (VARIABLES.parts(space.encode(model)) for model in (*ends, blend))
    for name in ("gamma", "beta", "falloff"):
        between = 0.5 * (getattr(a, name) + getattr(b, name))
        np.testing.assert_allclose(getattr(half, name), between, atol=1e-6)
    angles = np.deg2rad([20.0, 45.0, 65.0])
    albedo = [np.log(model.albedo(angles)) for model in (*ends, blend)]
    np.testing.assert_allclose(albedo[2], 0.5 * (albedo[0] + albedo[1]), atol=0.05)
    assert space.blend(models[0], models[1], 0.25).name == "material-0 75% material-1 25%"


@pytest.mark.parametrize("t", [0.1, 0.5, 0.8])
def test_blends_stay_within_the_colours_and_widths_of_their_ends(t):
    """Lobe by lobe: heights, ratios of channels, and widths."""
    models = [smooth_model(i, 3) for i in range(8)]
    # One as bright as a mirror, one as dark as soot, of about the same colours
    lobes = models[0].lobes
    models[0] = models[0].replace(lobes=lobes.replace(scale=lobes.scale + 2.0, colour=0.1 * lobes.colour))
    models[1] = models[1].replace(lobes=models[1].lobes.replace(scale=models[1].lobes.scale - 2.0))
    space = build_space(models)
    for i in range(0, 8, 2):
        ends = [heights_and_widths(space.decode(space.encode(m), conserve=False)) for m in models[i : i + 2]]
        mixed = (1.0 - t) * space.encode(models[i]) + t * space.encode(models[i + 1])
        height, width = heights_and_widths(space.decode(mixed, conserve=False))
        ratios = [h - h[:, :1] for h in (ends[0][0], ends[1][0], height)]
        for a, b, x in ((ends[0][0], ends[1][0], height), ratios, (ends[0][1], ends[1][1], width)):
            low, high = np.minimum(a, b), np.maximum(a, b)
            slack = 0.02 + 0.05 * (high - low)
            assert (x >= low - slack).all()
            assert (x <= high + slack).all()


def test_moves_move_along_one_axis(space):
    model = space.decode(space.curves[4], conserve=False)
    moved = space.scores(space.move(model, 1, 0.5)) - space.scores(model)
    expected = np.zeros_like(moved)
    expected[0] = 0.5 * np.sqrt(space.fpca.variances[0])
    np.testing.assert_allclose(moved, expected, atol=1e-3 * expected[0])


def test_blends_moves_and_draws_are_valid(space, models, rng):
    made = [space.blend(models[i], models[-1 - i], t) for i in range(2) for t in (0.3, 0.8)]
    made += [space.move(models[i], 1 + i, by) for i in (0, 1) for by in (-3.0, 3.0)]
    made += space.draw(6, rng)
    for model in made:
        assert_valid(model)


def test_a_lobe_stops_where_it_meets_its_neighbour(space, models):
    curves = space.encode(models[2])
    VARIABLES.parts(curves).gamma[0] += 20.0
    assert (np.diff(sharpness(space.decode(curves, conserve=False))) >= -1e-9).all()


def test_draws_are_of_a_seed(space):
    first, again, other = (space.draw(3, np.random.default_rng(seed)) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a.lobes.scale, b.lobes.scale)
        assert a.lobes.scale.shape != c.lobes.scale.shape or not np.array_equal(a.lobes.scale, c.lobes.scale)
    assert [model.name for model in first] == ["draw 1", "draw 2", "draw 3"]


def test_draws_stay_in_the_range_of_the_materials():
    space = build_space([smooth_model(i) for i in range(12)])
    k = space.fpca.n_components(0.9)
    low, high = space.fpca.scores[:, :k].min(0), space.fpca.scores[:, :k].max(0)
    for model in space.draw(8, np.random.default_rng(4)):
        scores = space.scores(model)[:k]
        slack = 0.1 * (high - low)
        assert ((scores >= low - slack) & (scores <= high + slack)).all()


def test_without_leaves_one_out(space, models):
    rest = space.without("material-3")
    assert "material-3" not in rest.names
    assert len(rest.names) == len(rest.curves) == len(rest.sources) == len(models) - 1
    assert len(rest.fpca.scores) == len(models) - 1
    with pytest.raises(ValueError, match="no material 'jade' in this space of 14"):
        space.without("jade")


def test_lobe_fpca_takes_each_lobe_by_itself(space, models):
    fpca, lobes = lobe_fpca(space)
    assert len(fpca.scores) == len(lobes) == sum(model.n_lobes for model in models)
    np.testing.assert_allclose(
        fpca.inverse_transform(fpca.scores[0]), space.curves[tuple(lobes[0])], rtol=1e-9, atol=1e-9
    )
    assert np.corrcoef(lobes[:, 1], fpca.scores[:, 0])[0, 1] > 0.8


@pytest.mark.parametrize("n_channels", [1, 4])
def test_any_number_of_channels(n_channels, rng):
    models = [smooth_model(i, n_channels=n_channels) for i in range(5)]
    space = build_space(models)
    assert space.draw(1, rng)[0].n_channels == n_channels
    assert_same_values(space.blend(models[0], models[1], 0.0), models[0], 1e-9)


def test_channels_keep_their_names(rng):
    names = ("450nm", "550nm")
    models = [smooth_model(i, n_channels=2, channels=names) for i in range(4)]
    space = build_space(models)
    made = [space.blend(*models[:2], 0.5), space.move(models[0], 1, 1.0), *space.draw(1, rng)]
    assert {model.channels for model in made} == {names}
    with pytest.raises(ValueError, match="channels 0, 1, where the space has 450nm, 550nm"):
        space.encode(smooth_model(9, n_channels=2))


def test_curves_of_other_sizes():
    models = [smooth_model(i) for i in range(4)]
    space = build_space(models, sizes=(3, 2, 1, 1, 1))
    assert space.blend(*models[:2], 0.5).lobes.scale.shape == (3, 3)
    assert space.settings.sizes == Sizes(3, 2, 1, 1, 1)


def test_repr(space):
    assert repr(space) == "MaterialSpace(14 materials, 3 channels, 4 lobes)"


# Errors


def test_spaces_refuse_what_does_not_fit(models):
    space = build_space([smooth_model(i, 2, fit_options={"convention": "centre"}) for i in range(4)])
    with pytest.raises(ValueError, match="material-9: channels value, where the space has r, g, b"):
        space.encode(smooth_model(9, n_channels=1))
    with pytest.raises(
        ValueError, match=r"material-9: channels 0 \.\.\. 30 \(31\), where the space has r, g, b"
    ):
        space.encode(smooth_model(9, n_channels=31))
    with pytest.raises(ValueError, match=r"material-9: 4 lobes do not go into this space, which has 2"):
        space.encode(smooth_model(9, n_lobes=4))
    edge = smooth_model(9, 2, fit_options={"convention": "edge"})
    with pytest.raises(ValueError, match="'edge' convention of table cells, where the space has 'centre'"):
        space.encode(edge)
    with pytest.raises(ValueError, match="material-9: channels value, where the space has r, g, b"):
        build_space([*models, smooth_model(9, n_channels=1)])
    with pytest.raises(ValueError, match="fitted with the 'edge' convention"):
        build_space([smooth_model(1, fit_options={"convention": "centre"}), edge])
    with pytest.raises(ValueError, match="two models at least, got 1"):
        build_space(models[:1])
    with pytest.raises(ValueError, match="'correspondence' must be 'rank' or 'border', got 'colour'"):
        build_space(models, correspondence="colour")


def test_arguments_out_of_range(space, models, rng):
    with pytest.raises(ValueError, match=r"'t' must be between 0 and 1, got 1\.5\. To go farther, use move"):
        space.blend(models[0], models[1], 1.5)
    with pytest.raises(ValueError, match=r"'axis' must be between 1 and 13, got 0"):
        space.move(models[0], 0, 1.0)
    with pytest.raises(ValueError, match="'by' must be finite, got nan"):
        space.move(models[0], 1, np.nan)
    with pytest.raises(ValueError, match="'n' must not be negative, got -1"):
        space.draw(-1, rng)
    with pytest.raises(ValueError, match="'share' must be above 0"):
        space.draw(1, rng, share=0.0)


# Files


@pytest.mark.parametrize("correspondence", ["rank", "border"])
def test_files_keep_everything(correspondence, models, tmp_path):
    space = build_space(models, correspondence=correspondence, sizes=(5, 3, 2, 1, 1))
    path = tmp_path / "space.npz"
    space.save(path)
    again = load_space(path)
    assert again.settings == space.settings
    for field in dataclasses.fields(space):
        if field.name != "settings":
            np.testing.assert_array_equal(getattr(again, field.name), getattr(space, field.name))
    np.testing.assert_array_equal(again.fpca.scores, space.fpca.scores)
    assert [path.name for path in tmp_path.iterdir()] == ["space.npz"]


def test_the_file_says_what_it_was_built_from(tmp_path):
    models = [smooth_model(i, source=Source(recorded={"sha256": f"{i:064x}"})) for i in range(3)]
    build_space(models).save(tmp_path / "space.npz")
    with np.load(tmp_path / "space.npz") as file:
        header = json.loads(str(file["header"]))
    assert header["materials"][2] == {"name": "material-2", "sha256": f"{2:064x}"}
    assert load_space(tmp_path / "space.npz").sources[1] == f"{1:064x}"


@pytest.fixture
def rewrite(models, tmp_path):
    """Call with changes of the header and of arrays: a file of a space with these."""
    build_space(models).save(tmp_path / "good.npz")

    def write(header=None, arrays=None):
        with np.load(tmp_path / "good.npz") as file:
            content = dict(file.items())
        changed = json.loads(str(content["header"])) | (header or {})
        changed = {key: value for key, value in changed.items() if value != "REMOVE"}
        content["header"] = np.array(json.dumps(changed))
        content = {key: value for key, value in (content | (arrays or {})).items() if value is not None}
        path = tmp_path / "bad.npz"
        np.savez(path, **content)
        return path

    return write


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"format": "zoo"}, 'expected a header with "format": "dsbrdf space"'),
        ({"schema": 2}, r"schema 2 is not the one this version reads \(1\). Update dsbrdf"),
        ({"dark": 0.5}, r"built with dark = 0\.5, where this version has 0\.001\. Build the space again"),
        ({"azimuthal_width": None}, "built with azimuthal_width = None, where this version has 0.01"),
        ({"sizes": "REMOVE"}, "not a whole space: 'sizes' is missing"),
        ({"sizes": {"scale": 9}}, r"expected curves \(14, 4, 44\)"),
        ({"sizes": {"height": 9}}, "not a sound space"),
        ({"sizes": {"scale": 0}}, "a coefficient at least"),
        ({"channels": ["r", "g"]}, r"expected curves \(14, 4, 26\)"),
        ({"materials": []}, "0 names"),
        ({"materials": [1]}, "not a sound space"),
        ({"n_diffuse": 99}, "99 diffuse slots do not go together"),
        ({"correspondence": "colour"}, "'correspondence' must be"),
    ],
)
def test_files_with_another_header(rewrite, header, message):
    with pytest.raises(SpaceFormatError, match=message):
        load_space(rewrite(header))


def test_hostile_files(rewrite, tmp_path, models):
    curves = build_space(models).curves
    present = np.ones(curves.shape[:2], dtype=bool)
    for arrays, message in (
        ({"curves": np.array([{}], dtype=object)}, "not a sound .npz file"),
        ({"curves": curves[:, :1]}, "do not go together"),
        ({"curves": curves * np.nan}, "finite float64"),
        ({"curves": curves.astype("f4")}, "finite float64"),
        ({"present": present[0]}, "not a sound space"),
        ({"present": present.astype(int)}, "present must be bool"),
        ({"present": None}, "no array 'present'"),
        ({"header": np.array("[1, 2")}, "its header is not JSON"),
        ({"header": np.array("[" * 100_000)}, "its header is not JSON"),
        ({"header": np.array([1, 2])}, "not"),
    ):
        with pytest.raises(SpaceFormatError, match=message):
            load_space(rewrite(arrays=arrays))
    for content in (b"", b"PK\x03\x04", b"\x93NUMPY", b"{}"):
        (tmp_path / "x.npz").write_bytes(content)
        with pytest.raises(SpaceFormatError, match=r"x.npz: not a space: not a sound .npz file"):
            load_space(tmp_path / "x.npz")
    whole = rewrite().read_bytes()
    (tmp_path / "x.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SpaceFormatError, match=r"not a sound \.npz"):
        load_space(tmp_path / "x.npz")
    with pytest.raises(FileNotFoundError):
        load_space(tmp_path / "none.npz")


def test_files_that_unpack_to_too_much(tmp_path, monkeypatch, models):
    build_space(models).save(tmp_path / "space.npz")
    monkeypatch.setattr("dsbrdf._files.ROOM", -8000)
    with pytest.raises(SpaceFormatError, match=r"[\d,]+ bytes of arrays in a file of [\d,]+ bytes"):
        load_space(tmp_path / "space.npz")


def test_settings_are_compared_whole():
    assert SpaceSettings() == SpaceSettings()
    assert SpaceSettings() != SpaceSettings(sizes=Sizes(scale=4))
