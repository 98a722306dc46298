"""Spaces of materials: correspondence and padding, round trips, blends, moves and draws, files."""

import dataclasses
import json
import time

import numpy as np
import pytest
from spaces import BASIS, smooth_model

from dsbrdf.measured.source import Source
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.space import SpaceFormatError, SpaceSettings, build_space, load_space, lobe_fpca
from dsbrdf.space.correspondence import gamma_norm, lobe_slots, pad, two_class_border
from dsbrdf.space.variables import Variables


@pytest.fixture(scope="module")
def models():
    return [smooth_model(i, n_lobes=2 + i % 3) for i in range(14)]


@pytest.fixture(scope="module", params=[True, False], ids=["logarithmic", "raw"])
def space(request, models):
    return build_space(models, logarithmic=request.param)


def values_of(model):
    theta_h, theta_d = np.deg2rad([[0.0], [5.0], [30.0]]), np.deg2rad([3.0, 30.0, 55.0])
    return model.eval_angles(theta_h, theta_d, 0.5)


def assert_same_values(a, b, rtol):
    np.testing.assert_allclose(values_of(a), values_of(b), rtol=rtol)


def assert_valid(model, space):
    """Positive parameters, no more light than comes in, lobes in the order of the space in every channel."""
    assert (model.kappa > 0.0).all()
    assert (model.gamma >= 0.0).all()
    assert model.albedo(np.deg2rad([0.0, 30.0, 60.0, 80.0])).max() <= 1.001
    curves = space.settings.variables.smooth(model, space.settings.basis)
    visible = np.asarray(model.kappa).max(0) > 1e-3
    for norm, seen in zip(gamma_norm(curves, space.settings.basis), visible, strict=True):
        assert (np.diff(norm[seen]) >= -0.02 * np.abs(norm[seen]).max()).all()


# Variables


@pytest.mark.parametrize("logarithmic", [True, False])
def test_variables_and_parameters_are_inverse(logarithmic):
    variables = Variables(logarithmic, azimuthal=True)
    model = smooth_model(5, beta=True)
    for expected, got in zip(
        (model.kappa, model.gamma, model.beta), variables.parameters(variables.of(model)), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("logarithmic", [True, False])
def test_any_variables_give_valid_parameters(logarithmic, rng):
    values = rng.normal(size=(1000, 3)) * 50.0
    kappa, gamma, beta = Variables(logarithmic, azimuthal=True).parameters(values)
    assert np.isfinite(np.expm1(kappa)).all()
    assert (kappa > 0.0).all()
    assert ((gamma >= 0.0) & np.isfinite(gamma)).all()
    assert (np.abs(beta) <= 1.0).all()


@pytest.mark.parametrize("logarithmic", [True, False])
def test_slopes_are_derivatives(logarithmic):
    variables = Variables(logarithmic)
    values = np.array([[-3.0, 0.4], [0.7, 3.0], [2.0, 6.0]]) if logarithmic else np.array([[0.3, 20.0]])
    step = 1e-6 * np.eye(2)
    for f, slope in enumerate(variables.slopes(*variables.parameters(values)[:2])):
        up, down = (variables.parameters(values + sign * step[f])[f] for sign in (1, -1))
        np.testing.assert_allclose(slope, (up - down) / 2e-6, rtol=1e-6)


def test_smoothing_is_weighted_by_what_a_slice_says():
    """Slices on which a lobe is black do not bend its curve."""
    model = smooth_model(3, theta_d=np.deg2rad(np.arange(18) * 5.0 + 0.5))
    gamma = model.gamma.copy()
    kappa = model.kappa.copy()
    kappa[9, :, 0], gamma[9, :, 0] = 1e-9, 1e6
    damaged = model.replace(kappa=kappa, gamma=gamma)
    expected, got = (Variables().smooth(m, BASIS) for m in (model, damaged))
    assert np.abs(got[:, 1:] - expected[:, 1:]).max() == 0.0
    values = Variables().of(damaged)[:, :, 0, 1]
    plain = np.linalg.lstsq(BASIS.design(model.theta_d), values)[0].T
    bent, plainly_bent = (((x - expected[:, 0, 1]) ** 2).sum() for x in (got[:, 0, 1], plain))
    assert bent < 0.5 * plainly_bent


# Correspondence


def test_lobes_are_ordered_by_gamma_whatever_their_order(models):
    space = build_space(models)
    shuffled = models[2].replace(**{n: getattr(models[2], n)[:, :, ::-1] for n in ("kappa", "gamma", "beta")})
    np.testing.assert_allclose(space.encode(shuffled), space.encode(models[2]), atol=1e-9)
    norm = gamma_norm(space.encode(models[2])[:, : models[2].n_lobes], BASIS)
    assert (np.diff(norm, axis=1) >= 0.0).all()


def test_slots_along_the_border():
    norm = np.array([[5.0, 0.2, 0.1], [0.1, 5.0, 9.0]])
    np.testing.assert_array_equal(lobe_slots(norm, 1.0, 2), [[2, 1, 0], [1, 2, 3]])
    np.testing.assert_array_equal(lobe_slots(norm, -np.inf, 0), [[2, 1, 0], [0, 1, 2]])


def test_border_is_the_best_split_in_two():
    x = np.array([0.1, 0.2, 0.3, 4.0, 4.2])
    assert two_class_border([x[None]], True) == pytest.approx(0.5 * (0.2 + 4.1))
    assert two_class_border([np.expm1(x[:, None])], False) == pytest.approx(np.expm1(0.5 * (0.2 + 4.1)))
    assert two_class_border([np.ones((3, 2))], True) == -np.inf


def test_padding_is_flat_with_the_shape_of_the_neighbour():
    curves = np.arange(2 * 2 * 2 * 6, dtype=float).reshape(2, 2, 2, 6)
    padded, present = pad(curves, np.array([[1, 2], [2, 1]]), 4, -7.0)
    np.testing.assert_array_equal(present, [[False, True, True, False]] * 2)
    np.testing.assert_array_equal(padded[0, 1:3], curves[0])
    np.testing.assert_array_equal(padded[1, 1:3], curves[1, ::-1])
    assert (padded[:, [0, 3], 0] == -7.0).all()
    np.testing.assert_array_equal(padded[:, 0, 1], padded[:, 1, 1])
    np.testing.assert_array_equal(padded[:, 3, 1], padded[:, 2, 1])


def test_flat_lobes_reflect_nothing(space, models):
    decoded = space.decode(space.curves[0])
    assert models[0].n_lobes == decoded.n_lobes == 2 < space.n_slots


def test_border_space_has_slots_on_both_sides(models):
    space = build_space(models, correspondence="border")
    assert np.isfinite(space.border)
    assert 0 < space.n_diffuse < space.n_slots
    assert (space.present.sum(2) == [[model.n_lobes] * 3 for model in models]).all()
    gaps = np.abs(np.diff(np.pad(space.present.astype(int), ((0, 0), (0, 0), (1, 1))), axis=2)).sum(2)
    assert (gaps == 2).all()


# The space


def test_encode_and_decode_are_inverse(models):
    space = build_space(models)
    for model in models[:4]:
        assert_same_values(space.decode(space.encode(model)), model, 1e-4)


def test_all_components_reconstruct(space, models):
    for i in (0, 5):
        full = space.model(space.fpca.scores[i])
        assert_same_values(full, space.decode(space.curves[i]), 1e-6)
        np.testing.assert_allclose(space.scores(models[i]), space.fpca.scores[i], atol=1e-6)


def test_positive_scores_are_sharper(space):
    functions = space.fpca.functions.reshape(-1, *space.curves.shape[1:])
    gamma = functions[:, :, :, 1] @ BASIS.gram.sum(0)
    weights = space.fpca.weights.reshape(space.curves.shape[1:4])[:, :, 1]
    assert ((gamma * weights).sum((1, 2)) >= -1e-12).all()


def test_own_material_is_the_nearest(space, models):
    names = [name for name, _ in space.nearest(models[3], n=3)]
    assert names[0] == models[3].name
    assert space.nearest(models[3], n=1)[0][1] == pytest.approx(0.0, abs=1e-6)
    assert len(space.nearest(models[3], n=100)) == len(models)


def test_ends_of_a_blend_are_the_materials(models):
    space = build_space(models)
    a, b = models[0], models[2]
    assert_same_values(space.blend(a, b, 0.0), a, 1e-4)
    assert_same_values(space.blend(a, b, 1.0), b, 1e-4)
    assert space.blend(a, b, 0.0).n_lobes == a.n_lobes


def test_blends_lie_between(space, models):
    ends = [space.fpca.transform(x.reshape(-1, 6)) for x in space.curves[:2]]
    half = space.scores(space.blend(models[0], models[1], 0.5))
    if space.settings.variables.logarithmic:
        np.testing.assert_allclose(half, 0.5 * (ends[0] + ends[1]), atol=0.05)
    assert space.blend(models[0], models[1], 0.25).name == "material-0 75% material-1 25%"


def test_moves_move_along_one_axis():
    space = build_space([smooth_model(i) for i in range(12)])
    model = space.decode(space.curves[4])
    moved = space.scores(space.move(model, 1, 0.5)) - space.scores(model)
    expected = np.zeros_like(moved)
    expected[0] = 0.5 * np.sqrt(space.fpca.variances[0])
    np.testing.assert_allclose(moved, expected, atol=1e-3 * expected[0])


def test_blends_moves_and_draws_are_valid(space, models, rng):
    made = [space.blend(models[i], models[-1 - i], t) for i in range(2) for t in (0.3, 0.8)]
    made += [space.move(models[i], 1 + i, by) for i in (0, 1) for by in (-3.0, 3.0)]
    made += space.sample(6, rng)
    for model in made:
        assert_valid(model, space)


def test_a_lobe_stops_where_it_meets_its_neighbour(models):
    space = build_space(models)
    curves = space.encode(models[2])
    curves[:, 0, 1] += 20.0
    decoded = space.decode(curves)
    norm = gamma_norm(space.settings.variables.smooth(decoded, BASIS), BASIS)
    assert (np.diff(norm, axis=1) >= -1e-3).all()


def test_draws_are_of_a_seed(space):
    first, again, other = (space.sample(3, np.random.default_rng(seed)) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a.kappa, b.kappa)
        assert a.kappa.shape != c.kappa.shape or not np.array_equal(a.kappa, c.kappa)
    assert [model.name for model in first] == ["sample 1", "sample 2", "sample 3"]


def test_draws_stay_in_the_range_of_the_materials():
    space = build_space([smooth_model(i) for i in range(12)])
    k = space.fpca.n_components(0.9)
    low, high = space.fpca.scores[:, :k].min(0), space.fpca.scores[:, :k].max(0)
    for model in space.sample(8, np.random.default_rng(4)):
        scores = space.scores(model)[:k]
        slack = 0.1 * (high - low)
        assert ((scores >= low - slack) & (scores <= high + slack)).all()


def test_beta_joins_as_a_third_function():
    models = [smooth_model(i, beta=True) for i in range(8)]
    space = build_space(models, azimuthal=True)
    assert space.curves.shape[3] == 3
    assert np.abs(space.blend(models[0], models[1], 0.5).beta).max() > 0.1
    assert_same_values(space.blend(models[0], models[1], 0.0), models[0], 1e-4)
    assert (build_space(models).model(np.zeros(2)).beta == 0.0).all()


def test_without_leaves_one_out(models):
    space = build_space(models)
    rest = space.without("material-3")
    assert "material-3" not in rest.names
    assert len(rest.names) == len(rest.curves) == len(rest.sources) == len(models) - 1
    assert len(rest.fpca.scores) == len(models) - 1
    with pytest.raises(ValueError, match="no material 'jade' in this space of 14"):
        space.without("jade")


def test_lobe_fpca_takes_each_lobe_by_itself(space, models):
    fpca, lobes = lobe_fpca(space)
    assert len(fpca.scores) == len(lobes) == 3 * sum(model.n_lobes for model in models)
    assert fpca.mean.shape == (2, 6)
    np.testing.assert_allclose(
        fpca.inverse_transform(fpca.scores[0]), space.curves[tuple(lobes[0])], rtol=1e-9, atol=1e-9
    )
    if space.settings.variables.logarithmic:
        assert np.corrcoef(lobes[:, 2], fpca.scores[:, 0])[0, 1] > 0.8


@pytest.mark.parametrize("n_channels", [1, 4])
def test_any_number_of_channels(n_channels, rng):
    models = [smooth_model(i, n_channels=n_channels) for i in range(5)]
    space = build_space(models)
    assert space.sample(1, rng)[0].n_channels == n_channels
    assert_same_values(space.blend(models[0], models[1], 0.0), models[0], 1e-4)


def test_a_hundred_models_are_built_in_two_seconds():
    theta_d = np.deg2rad(np.arange(18) * 5.0 + 0.5)
    models = [smooth_model(i, n_lobes=2 + i % 3, theta_d=theta_d) for i in range(100)]
    start = time.process_time()
    assert len(build_space(models).fpca.scores) == 100
    assert time.process_time() - start < 2.0


def test_repr(models):
    assert repr(build_space(models)) == "MaterialSpace(14 materials, 3 channels, 4 lobes, logarithmic)"


# Errors


def test_spaces_refuse_what_does_not_fit(models):
    space = build_space([smooth_model(i, 2, fit_options={"convention": "centre"}) for i in range(4)])
    with pytest.raises(ValueError, match="material-9: 1 channels, where the space has 3"):
        space.encode(smooth_model(9, n_channels=1))
    with pytest.raises(ValueError, match=r"material-9: 4 lobes do not go into this space, which has 2"):
        space.encode(smooth_model(9, n_lobes=4))
    edge = smooth_model(9, 2, fit_options={"convention": "edge"})
    with pytest.raises(ValueError, match="'edge' convention of table cells, where the space has 'centre'"):
        space.encode(edge)
    with pytest.raises(ValueError, match="material-9: 1 channels, where the space has 3"):
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
        space.sample(-1, rng)
    with pytest.raises(ValueError, match="'share' must be above 0"):
        space.sample(1, rng, share=0.0)


# Files


@pytest.mark.parametrize("correspondence", ["rank", "border"])
def test_files_keep_everything(correspondence, models, tmp_path):
    space = build_space(models, correspondence=correspondence, logarithmic=False, azimuthal=True, n_knots=4)
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
        (
            {"kappa_offset": 0.5},
            "built with kappa_offset = 0.5, where this version has 0.001. Build the space again",
        ),
        ({"azimuthal_width": None}, "built with azimuthal_width = None, where this version has 0.01"),
        ({"n_knots": "REMOVE"}, "not a whole space: 'n_knots' is missing"),
        ({"n_knots": 9}, r"expected curves \(14, 3, 4, 2, 10\)"),
        ({"functions": ["gamma", "kappa"]}, "are not"),
        ({"materials": []}, "0 names"),
        ({"materials": [1]}, "not a sound space"),
        ({"domain": [0.0]}, "not a sound space"),
        ({"n_diffuse": 99}, "99 diffuse slots do not go together"),
        ({"correspondence": "colour"}, "'correspondence' must be"),
    ],
)
def test_files_with_another_header(rewrite, header, message):
    with pytest.raises(SpaceFormatError, match=message):
        load_space(rewrite(header))


def test_hostile_files(rewrite, tmp_path, models):
    curves = build_space(models).curves
    present = np.ones(curves.shape[:3], dtype=bool)
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
    monkeypatch.setattr("dsbrdf.space.space_file.MAX_BYTES", 1000)
    with pytest.raises(SpaceFormatError, match="bytes unpacked are more than any space has"):
        load_space(tmp_path / "space.npz")


def test_settings_are_compared_whole():
    assert SpaceSettings() == SpaceSettings()
    assert SpaceSettings() != SpaceSettings(basis=CurveBasis(6))
