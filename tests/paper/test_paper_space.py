"""The paper's space: correspondence and padding, principal functions, and maps of them."""

import functools

import numpy as np
import pytest
from curve_models import SLICES
from slices import random_slices, smooth_slices

from dsbrdf import paper, tabulate
from dsbrdf.measured import built_in
from dsbrdf.paper import maps, tables
from dsbrdf.paper.correspondence import gamma_norm, lobe_slots, pad, two_class_border
from dsbrdf.paper.curves import CurveBasis
from dsbrdf.paper.space import Variables, build_space

BASIS = CurveBasis()


def material(seed, **options):
    return smooth_slices(seed, BASIS, Variables(), **options)


@pytest.fixture(scope="module")
def models():
    return [material(i, n_lobes=2 + i % 3) for i in range(14)]


@pytest.fixture(scope="module", params=[True, False], ids=["logarithmic", "raw"])
def space(request, models):
    return build_space(models, logarithmic=request.param)


def values_of(model):
    theta_h, theta_d = np.deg2rad([[0.0], [5.0], [30.0]]), np.deg2rad([3.0, 30.0, 55.0])
    return model.eval_angles(theta_h, theta_d, 0.5)


# Variables


@pytest.mark.parametrize("logarithmic", [True, False])
def test_variables_and_parameters_are_inverse(logarithmic):
    variables, model = Variables(logarithmic), material(5)
    for expected, got in zip(
        (model.kappa, model.gamma), variables.parameters(variables.of(model)), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("logarithmic", [True, False])
def test_any_variables_give_valid_parameters(logarithmic, rng):
    kappa, gamma = Variables(logarithmic).parameters(rng.normal(size=(1000, 2)) * 50.0)
    assert np.isfinite(np.expm1(kappa)).all()
    assert (kappa > 0.0).all()
    assert ((gamma >= 0.0) & np.isfinite(gamma)).all()


def test_smoothing_is_weighted_by_what_a_slice_says():
    """Slices on which a lobe is black do not bend its curve."""
    model = material(3, theta_d=SLICES)
    kappa, gamma = model.kappa.copy(), model.gamma.copy()
    kappa[9, :, 0], gamma[9, :, 0] = 1e-9, 1e6
    damaged = model.replace(kappa=kappa, gamma=gamma)
    expected, got = (Variables().smooth(m, BASIS) for m in (model, damaged))
    assert np.abs(got[:, 1:] - expected[:, 1:]).max() == 0.0
    values = Variables().of(damaged)[:, :, 0, 1]
    plain = np.linalg.lstsq(BASIS.design(model.theta_d), values)[0].T
    bent, plainly_bent = (((x - expected[:, 0, 1]) ** 2).sum() for x in (got[:, 0, 1], plain))
    assert bent < 0.5 * plainly_bent


# Correspondence


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


def test_lobes_are_contiguous_and_in_order(space, models):
    assert (space.present.sum(2) == [[model.n_lobes] * 3 for model in models]).all()
    gaps = np.abs(np.diff(np.pad(space.present.astype(int), ((0, 0), (0, 0), (1, 1))), axis=2)).sum(2)
    assert (gaps == 2).all()
    for curves, present in zip(space.curves, space.present, strict=True):
        for norm, some in zip(gamma_norm(curves, BASIS), present, strict=True):
            assert (np.diff(norm[some]) >= 0.0).all()


# The space


def test_smooth_materials_come_back(space, models):
    if space.variables.logarithmic:
        for model, curves in zip(models[:4], space.curves, strict=False):
            decoded = space.decode(curves)
            assert model.n_lobes <= decoded.n_lobes <= space.n_slots
            np.testing.assert_allclose(values_of(decoded), values_of(model), rtol=1e-4)


def test_all_components_reconstruct(space):
    rows = space.curves.reshape(len(space.curves), -1)
    np.testing.assert_allclose(
        space.materials.inverse_transform(space.materials.scores), rows, atol=1e-8 * np.abs(rows).max()
    )
    lobes = space.curves[space.present]
    np.testing.assert_allclose(
        space.lobes.inverse_transform(space.lobes.scores).reshape(lobes.shape), lobes, atol=1e-8 * lobes.max()
    )


def test_inner_product_is_eq_7(space):
    """Integrals of products by quadrature, weighted by the reciprocal of the squared norm of the mean curve."""
    theta_d = (np.arange(20_000) + 0.5) / 20_000 * np.pi / 2
    a, b = (
        np.einsum("tc,fc->ft", BASIS.design(theta_d), curves) for curves in space.curves[space.present][:2]
    )
    mean = np.einsum("tc,fc->ft", BASIS.design(theta_d), space.curves[space.present].mean(0))
    step = np.pi / 2 / 20_000
    weight = np.ones(2) if space.variables.logarithmic else 1.0 / (mean**2).sum(1) / step
    expected = (weight * (a * b).sum(1) * step).sum()
    first, second = (curves.ravel() for curves in space.curves[space.present][:2])
    assert space.lobes.inner(first, second) == pytest.approx(expected, rel=1e-6)


def test_positive_scores_are_sharper(space):
    for fpca in (space.materials, space.lobes):
        sharper = np.zeros((fpca.mean.size // 12, 2, 6))
        sharper[:, 1] = 1.0
        assert (fpca.inner(fpca.functions, sharper.ravel()) >= -1e-12).all()


def test_a_lobe_stops_where_it_meets_its_neighbour(space):
    curves = space.curves[0].copy()
    curves[:, 0, 1], curves[:, 1, 1] = curves[:, 1, 1].copy(), curves[:, 0, 1].copy()
    decoded = space.decode(curves)
    norm = gamma_norm(space.variables.smooth(decoded, space.basis), space.basis)
    visible = decoded.kappa.max(0) > 1e-3
    for row, seen in zip(norm, visible, strict=True):
        assert (np.diff(row[seen]) >= -0.02 * np.abs(row[seen]).max()).all()


def test_spaces_refuse_what_does_not_fit(models):
    with pytest.raises(ValueError, match="a space needs two models at least, got 1"):
        build_space(models[:1])
    with pytest.raises(ValueError, match=r"a model: 1 channels, where the first model has 3\. Build a space"):
        build_space([models[0], random_slices(n_channels=1)])


def test_tells_what_it_is(space):
    kind = "logarithmic" if space.variables.logarithmic else "raw"
    assert repr(space) == f"PaperSpace(14 materials, 3 channels, {space.n_slots} lobes, {kind})"


# Figs. 9 and 10


@functools.cache
def load(name):
    return tabulate(built_in.get(name).reflectance, name, shape=(45, 18, 24))


@pytest.mark.parametrize("what", ["fig9", "fig10"])
def test_each_map(tmp_path, monkeypatch, what):
    names = ("satin-aluminium", "paint-two-lobe", "matte")
    monkeypatch.setattr(tables, "open_tables", lambda _: tables.Tables("small", names, load))
    steps = []
    (path,) = paper.run(what, None, tmp_path, steps.append)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert steps == list(names)
    assert len(steps) == paper.n_steps(what, None)


def test_maps_show_each_once(space):
    for draw, n in ((maps.material_map, 14), (maps.lobe_map, int(space.present.sum()))):
        figure = draw(space)
        assert len(figure.axes[0].artists) == n
        assert str(n) in figure.axes[0].get_title()
