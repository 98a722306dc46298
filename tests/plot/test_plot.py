"""Figures and spheres: that they show the numbers they should."""

import dataclasses
import sys
import warnings

import numpy as np
import pytest
from figures import assert_nothing_is_cut
from matplotlib.figure import Figure

import dsbrdf
from dsbrdf import Lobes, half_diff, plot
from dsbrdf.cli import _demo
from dsbrdf.geometry import lighting, panorama
from dsbrdf.measured import built_in
from dsbrdf.model import sphere

SHAPE = (45, 18, 36)


def quiet_fit(measured, n_lobes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
        return dsbrdf.fit(measured, n_lobes)


@pytest.fixture(scope="module")
def fit():
    """A small table of a material that differs over phi_d, fitted."""
    return quiet_fit(dsbrdf.tabulate(built_in.get("rough-gold").reflectance, "gold", shape=SHAPE), 3)


@pytest.fixture(scope="module")
def grey_fit():
    """One channel, two lobes."""
    return quiet_fit(dsbrdf.tabulate(lambda wi, wo: 0.3 + 0.0 * (wi + wo)[..., :1], "grey", shape=SHAPE), 2)


def with_channels(model, n, names=()):
    """A model whose channels are that many copies of its first."""
    lobes = model.lobes
    colour = np.repeat(lobes.colour[:1], n, axis=0)
    return model.replace(lobes=lobes.replace(colour=colour), channels=names, profile=None)


def line(axes, label):
    (found,) = [line for line in axes.get_lines() if line.get_label() == label]
    return found


@pytest.mark.parametrize("convention", ["centre", "edge"])
def test_incident_plane_lies_in_the_plane(convention):
    def reflectance(wi, wo):
        theta_h, _, phi_d = half_diff.from_directions(wi, wo)
        return np.stack([theta_h, 2.0 + np.cos(2.0 * phi_d)], axis=-1)

    table = dsbrdf.tabulate(reflectance, "angles", shape=(20, 10, 180), convention=convention)
    theta_h, values = plot.incident_plane(table, 4)
    right = theta_h > 0.0
    seen = np.isfinite(values[0])
    np.testing.assert_allclose(values[0, seen], np.abs(theta_h[seen]), atol=1e-12)
    # Half a cell beside the plane: cos(1 degree)
    near = np.cos(np.deg2rad(1.0)) if convention == "centre" else 1.0
    inner = seen & (np.abs(theta_h) > 0.01)
    np.testing.assert_allclose(values[1, inner & right], 2.0 + near)
    np.testing.assert_allclose(values[1, inner & ~right], 2.0 - near)
    assert not seen[theta_h + table.theta_d[4] > np.pi / 2].any()
    assert (np.diff(theta_h) >= 0.0).all()


def test_invalid_cells_are_left_out_of_the_plane(fit):
    planes = fit.measured.planes.copy()
    planes[:, 5, 3, 0] = -1.0
    planes[:, 6, 3, [0, -1]] = np.nan
    damaged = dataclasses.replace(fit.measured, planes=planes)
    _, values = plot.incident_plane(damaged, 3)
    right = values[:, SHAPE[0] :]
    np.testing.assert_array_equal(right[:, 5], planes[:, 5, 3, -1])
    assert np.isnan(right[:, 6]).all()


def test_fit_figure_shows_the_fit(fit):
    figure = plot.fit_figure(fit, theta_d=np.deg2rad([12.0, 42.0]), channel=1)
    grid = np.array(figure.axes).reshape(3, 2)
    assert [axes.get_title() for axes in grid[0]] == [r"$\theta_d$ = 12.5°", r"$\theta_d$ = 42.5°"]
    assert grid[0, 0].get_xlim() == (-90.0, 90.0)
    assert [axes.get_yscale() for axes in grid[:, 0]] == ["linear", "log", "log"]

    theta_d = fit.measured.theta_d[8]
    for axes in grid[:2, 1]:
        x, y = line(axes, "green, fitted").get_data()
        right, left = np.searchsorted(x, 20.0), np.searchsorted(x, -30.0)
        expected = fit.model.eval_angles(np.deg2rad(x[[right, left]]) * [1, -1], theta_d, [0.0, np.pi / 2])
        np.testing.assert_allclose(y[[right, left]], expected[:, 1], rtol=1e-9)
        assert np.isnan(y[-1])
    lobes = [line(grid[2, 1], f"lobe {k}").get_ydata() for k in range(3)]
    total = line(grid[2, 1], "fitted").get_ydata()
    np.testing.assert_allclose(np.sum(lobes, axis=0), total)
    x, y = line(grid[2, 1], "measured").get_data()
    theta_h, values = plot.incident_plane(fit.measured, 8)
    np.testing.assert_array_equal(y, values[1, ::3])
    np.testing.assert_allclose(x, np.rad2deg(theta_h[::3]))


def test_fit_figure_names_errors_and_the_brightest_channel(fit):
    figure = plot.fit_figure(fit)
    title = figure.get_suptitle()
    assert title.startswith(f"gold: 3 lobes, {fit.model.n_parameters} numbers\n")
    for key in ("rel", "cbrt", "log", "albedo", "bivariate_floor", "azimuthal_floor"):
        assert f"{key.replace('_', ' ')} {getattr(fit.errors, key):.3f}" in title
    assert len(figure.axes) == 9
    assert figure.axes[6].get_ylabel() == "BRDF (1/sr), lobes of red"


@pytest.mark.parametrize("columns", [1, 3])
def test_nothing_is_cut(fit, columns):
    assert_nothing_is_cut(plot.fit_figure(fit, theta_d=[0.1, 0.6, 1.2][:columns]))
    assert_nothing_is_cut(plot.parameter_figure(fit.model.replace(name="a name as long as some files have")))
    named = dataclasses.replace(fit, model=fit.model.replace(name="specular-black-phenolic"))
    longest = max(_demo.MATERIALS.values(), key=len)
    assert_nothing_is_cut(plot.demo_figure([named] * columns, [longest] * columns, n_pixels=16))


def test_figures_of_one_channel(grey_fit, tmp_path):
    figure = plot.fit_figure(grey_fit, theta_d=[0.6])
    assert "value, fitted" in [line.get_label() for line in figure.axes[0].get_lines()]
    for i, made in enumerate([figure, plot.parameter_figure(grey_fit.model), plot.demo_figure([grey_fit])]):
        plot.write_figure(made, tmp_path / f"{i}.png", dpi=40)


def test_of_many_channels_a_few_are_shown(grey_fit):
    names = [f"{nm}" for nm in range(400, 720, 10)]
    model = with_channels(grey_fit.model, len(names), names)
    figure = plot.parameter_figure(model)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:5] == [rf"$\kappa$, {nm}" for nm in (400, 480, 560, 630, 710)]
    assert len(titles) == 5 + 3
    assert_nothing_is_cut(figure)


def test_angles_are_shown_once(grey_fit):
    assert len(plot.fit_figure(grey_fit, theta_d=[0.0, 0.01, 0.02]).axes) == 3


def test_scattered_samples_have_no_such_figure(fit):
    wi = np.array([[0.0, 0.6, 0.8]])
    scattered = dataclasses.replace(fit, measured=dsbrdf.Samples(wi, wi, np.ones((1, 3))))
    with pytest.raises(TypeError, match=r"gold: figures of fits show tables, got scattered samples\."):
        plot.fit_figure(scattered)


def test_parameter_figure_shows_the_parameters(fit):
    figure = plot.parameter_figure(fit.model)
    assert [axes.get_title() for axes in figure.axes] == [
        *(rf"$\kappa$, {name}" for name in ("red", "green", "blue")),
        r"$\gamma$, all channels",
        r"$\beta$, all channels",
        "falloff, all channels",
    ]
    theta_d = np.deg2rad(line(figure.axes[0], "lobe 0").get_xdata())
    at = fit.model.lobes.at(theta_d)
    expected = [*np.moveaxis(at.kappa, 1, 0), at.gamma, at.beta, at.falloff]
    for axes, values in zip(figure.axes, expected, strict=True):
        for k in range(3):
            np.testing.assert_allclose(line(axes, f"lobe {k}").get_ydata(), values[:, k])


def test_demo_figure_has_a_row_a_fit(fit, grey_fit):
    figure = plot.demo_figure([fit, grey_fit], n_pixels=16)
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert texts[::2] == ["gold", "grey"]
    assert f"3 lobes, {fit.model.n_parameters} numbers\nrel {fit.errors.rel:.3f}" in texts[1]
    pictures = [axes.images[0].get_array() for axes in figure.axes if axes.images]
    # Measured, fitted, and three or two lobes
    assert len(pictures) == 5 + 4
    np.testing.assert_allclose(pictures[0], pictures[1], atol=0.15)
    headers = [text.get_text() for text in figure.texts]
    assert headers[:5] == ["measured", "fitted", "lobe 0", "lobe 1", "lobe 2"]


def test_demo_figure_puts_further_lobes_together(fit, monkeypatch):
    monkeypatch.setattr(plot.model, "SHOWN_LOBES", 1)
    figure = plot.demo_figure([fit], n_pixels=16)
    assert [text.get_text() for text in figure.texts][:4] == ["measured", "fitted", "lobe 0", "others"]
    fitted, first, others = ([axes.images[0].get_array() for axes in figure.axes if axes.images])[1:]
    dim = (fitted < 1.0).all(-1)
    linear = [picture[dim][:, :3] ** 2.2 for picture in (fitted, first, others)]
    np.testing.assert_allclose(linear[1] + linear[2], linear[0], atol=1e-9)


@pytest.mark.parametrize(("most", "shown"), [(2, True), (1, False)])
def test_small_maps_have_names(monkeypatch, most, shown):
    from dsbrdf.plot import space as maps

    monkeypatch.setattr(maps, "MOST_NAMES", most)
    picture, at = np.ones((4, 4, 4)), np.eye(2)
    figure = maps._map([picture, picture], at, np.array([0.7, 0.3]), "", ("jade", "gold"))
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == (["jade", "gold"] if shown else [])


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_write_figure(tmp_path, ending):
    path = tmp_path / f"figure.{ending}"
    plot.write_figure(Figure(), path)
    assert path.stat().st_size > 500
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_half_written(tmp_path):
    with pytest.raises(ValueError, match="bmpx"):
        plot.write_figure(Figure(), tmp_path / "figure.bmpx")
    assert not list(tmp_path.iterdir())


def test_matplotlib_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "dsbrdf.plot")
    monkeypatch.delattr(dsbrdf, "plot")
    with pytest.raises(
        ModuleNotFoundError, match=r'dsbrdf.plot needs matplotlib: pip install "dsbrdf\[plot\]"'
    ):
        from dsbrdf import plot  # noqa: F401


# Spheres


def lambert(albedo):
    scale = np.log(np.log1p(np.array(albedo) / np.pi)).reshape(-1, 1, 1)
    flat = np.full((1, 1), -40.0)
    return dsbrdf.DSBRDF(Lobes(np.zeros((1, 1)), flat, np.zeros((1, 1)), np.zeros((1, 1)), scale))


def test_a_lambertian_sphere_follows_the_cosines():
    image = sphere.shade(lambert([0.9, 0.5]), 33)
    middle = image[16, 16]
    irradiance = sum(strength * direction[2] for direction, strength in sphere.LIGHTS)
    np.testing.assert_allclose(middle, np.array([0.9, 0.5]) / np.pi * irradiance, rtol=1e-4)
    assert not image[0, 0].any()
    # Brightest toward the main light: above, on the left
    row, column = np.unravel_index(image[..., 0].argmax(), image.shape[:2])
    assert row < 12
    assert column < 12


def test_a_table_and_its_reflectance_make_the_same_sphere():
    model = lambert([0.9, 0.5, 0.2])
    table = dsbrdf.tabulate(model.eval, "lambert", shape=SHAPE)
    seen, expected = sphere.shade(table, 48), sphere.shade(model, 48)
    # Cells at the horizon are invalid, and so black
    assert np.isclose(seen, expected, atol=1e-9).mean() > 0.97
    assert (seen <= expected + 1e-9).all()


def test_lobes_of_a_sphere_add_up(fit):
    for shade in (sphere.shade, sphere.shade_in_room):
        parts = sum(shade(fit.model.lobe(k), 24) for k in range(3))
        np.testing.assert_allclose(parts, shade(fit.model, 24), rtol=1e-9, atol=1e-12)


def test_a_sphere_in_the_room_sums_all_its_light(fit):
    """Against a sum over the pixels of a map, at normals of all azimuths."""
    n, height = 61, 256
    image = sphere.shade_in_room(fit.model, n)
    at = (np.arange(n) + 0.5) * 2.0 / n - 1.0
    directions = panorama.directions(height, 2 * height).reshape(-1, 3)
    light = lighting.studio(height).reshape(-1, 3)
    areas = np.repeat(panorama.solid_angles(height, 2 * height), 2 * height)
    for row, column in ((30, 30), (12, 20), (20, 47), (45, 10), (50, 36)):
        x, y = at[column], -at[row]
        normal = np.array([x, y, np.sqrt(1.0 - x * x - y * y)])
        across = np.cross([0.3, 0.8, 0.5], normal)
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(normal, across), normal])
        wi, wo = directions @ frame.T, frame[:, 2]
        values = np.asarray(fit.model.eval(wi, wo)) * np.maximum(wi[:, 2:], 0.0) * light
        np.testing.assert_allclose(image[row, column], (values * areas[:, None]).sum(0), rtol=0.004)
    assert not image[0, 0].any()


def test_other_channels_are_lit_by_grey_light(grey_fit):
    grey = sphere.shade_in_room(grey_fit.model, 16)
    same = sphere.shade_in_room(with_channels(grey_fit.model, 2, ["a", "b"]), 16)
    assert same.shape == (16, 16, 2)
    np.testing.assert_allclose(same, np.repeat(grey, 2, axis=-1), rtol=1e-9, atol=1e-12)


def test_invalid_cells_are_black(fit):
    empty = dataclasses.replace(
        fit.measured, planes=np.full((1, *SHAPE), -1.0), scale=np.ones(1), channels=()
    )
    assert not sphere.shade(empty, 16).any()


def test_picture_is_clear_outside():
    picture = sphere.picture(np.full((20, 20, 3), 0.5), 1.0)
    assert picture.shape == (20, 20, 4)
    assert picture[0, 0, 3] == 0.0
    assert picture[10, 10, 3] == 1.0
    np.testing.assert_allclose(picture[10, 10, :3], 0.5 ** (1 / 2.2))
    assert sphere.picture(np.full((4, 4, 1), 9.0), 1.0).max() == 1.0
