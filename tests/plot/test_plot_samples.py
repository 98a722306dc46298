"""Figures of scattered samples and of fits of them."""

import numpy as np
import pytest
from figures import assert_nothing_is_cut

import dsbrdf
from dsbrdf import Samples, cli, plot
from dsbrdf.plot import space as figures_of_a_space


def directions(theta, phi):
    theta, phi = np.broadcast_arrays(np.deg2rad(theta), np.deg2rad(phi))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


@pytest.fixture(scope="module")
def scan():
    theta_o = np.tile(np.arange(-70.0, 71.0, 10.0), 2)
    theta_i = np.repeat([20.0, 50.0], 15)
    values = 0.05 + 1.5 * np.exp(-(((theta_i + theta_o) / 24.0) ** 2))
    stack = np.stack([values, 0.5 * values], axis=-1)
    return Samples(
        directions(theta_i, 0.0), directions(theta_o, 0.0), stack, name="paint", channels=("450nm", "650nm")
    )


def test_scans_and_views_of_samples(scan):
    figure = plot.samples_figure(scan)
    first, second, above = figure.axes[:3]
    assert [axes.get_title() for axes in (first, second)] == ["light at 20°", "light at 50°"]
    line = first.lines[0]
    x, y = line.get_xdata(), line.get_ydata()
    # The brightest point is in the mirror direction, on the negative side
    assert x[np.argmax(y)] == pytest.approx(-20.0)
    assert y.max() == pytest.approx(1.55)
    assert above.collections[0].get_offsets().shape == (30, 2)


def test_a_fit_draws_itself(scan):
    fit = dsbrdf.fit(scan, 2)
    figure = fit.plot()
    curve = figure.axes[0].lines[1]
    near = np.argmin(np.abs(curve.get_xdata() + 20.0))
    assert curve.get_ydata()[near] == pytest.approx(1.55, rel=0.1)
    ratios = figure.axes[2].collections[0].get_array()
    assert np.abs(ratios).max() < 0.5
    with pytest.raises(
        TypeError, match=r"expected a fit of samples, got one of a table. Use plot\.fit_figure"
    ):
        plot.sample_fit_figure(dsbrdf.fit(dsbrdf.material("matte"), 1))


def test_samples_without_a_scan_are_drawn_over_the_half_angle(rng):
    n = 40
    wi, wo = (directions(rng.uniform(5, 80, n), rng.uniform(0, 360, n)) for _ in range(2))
    samples = Samples(wi, wo, rng.uniform(0.1, 0.2, (n, 3)), channels=("r", "g", "b"))
    figure = plot.samples_figure(samples)
    assert figure.axes[0].get_xlabel().startswith(r"$\theta_h$")
    assert len(figure.axes[0].lines) == 3


def test_info_and_fit_draw_measured_files(scan, tmp_path, capsys):
    from dsbrdf.export.convert import write_csv

    path = tmp_path / "scan.csv"
    write_csv(scan, path)
    assert cli.main(["info", str(path), "--plot", str(tmp_path / "info.png")]) == 0
    out = capsys.readouterr().out
    assert "450nm, 650nm" in out
    assert "theta_i, degrees  20 to 50" in out
    assert (tmp_path / "info.png").stat().st_size > 10_000
    assert cli.main(["fit", str(path), "--lobes", "1", "--plot", "-o", str(tmp_path / "out")]) == 0
    assert "scan: channels 450nm, 650nm." in capsys.readouterr().out
    assert (tmp_path / "out" / "scan.png").stat().st_size > 10_000
    assert cli.main(["info", "matte", "--plot", str(tmp_path / "x.png")]) == 2
    assert "draws measured files" in capsys.readouterr().err


def test_nothing_of_samples_is_cut(scan):
    assert_nothing_is_cut(plot.samples_figure(scan))
    assert_nothing_is_cut(dsbrdf.fit(scan, 1).plot())


@pytest.mark.parametrize("name", figures_of_a_space.FIGURES)
def test_nothing_of_a_space_is_cut(name):
    names = ("nickel", "specular-black-phenolic", "red-fabric", "delrin", "blue-acrylic")
    space = dsbrdf.space.build_space([dsbrdf.library.load(each) for each in names])
    assert_nothing_is_cut(figures_of_a_space.FIGURES[name](space))
