"""What lobes are called, how wide they are and how much light they send back."""

import numpy as np
import pytest
from models import constant_model, random_model
from scipy.optimize import brentq

from dsbrdf import cli
from dsbrdf.model.components import components, half_width

# A mirror, a specular, a glossy lobe, a body
KAPPA = (4.0, 2.0, 0.8, 0.3)
GAMMA = (40000.0, 500.0, 60.0, 0.3)
LABELS = ["spike", "specular", "glossy", "body"]


def lobe(theta_h, kappa, gamma, falloff):
    return np.expm1(kappa * np.cos(theta_h) ** gamma) * np.cos(theta_h) ** falloff


@pytest.mark.parametrize("kappa", [1e-9, 0.3, 1.0, 5.0, 600.0])
@pytest.mark.parametrize("gamma", [0.1, 1.0, 300.0, 1e6])
@pytest.mark.parametrize("falloff", [0.0, -0.05, 2.0])
def test_half_width(kappa, gamma, falloff):
    width = float(half_width(kappa, gamma, falloff))
    assert 0.0 < width <= np.pi / 2
    assert lobe(width, kappa, gamma, falloff) == pytest.approx(0.5 * np.expm1(kappa), rel=1e-6)


def test_half_width_against_a_search(rng):
    kappa, gamma, falloff = rng.uniform(0.1, 5.0, 20), rng.uniform(1.0, 500.0, 20), rng.uniform(-0.5, 2.0, 20)
    expected = [
        brentq(lambda t, p=p: lobe(t, *p) - 0.5 * np.expm1(p[0]), 0.0, 1.3, xtol=1e-14)
        for p in zip(kappa, gamma, falloff, strict=True)
    ]
    np.testing.assert_allclose(half_width(kappa, gamma, falloff), expected, rtol=1e-9)


def test_half_width_of_a_lobe_that_does_not_fall():
    assert half_width(1.0, 0.0) == pytest.approx(np.pi / 2)
    assert half_width(1.0, 0.1, -0.9) == pytest.approx(np.pi / 2)


def test_shares_colours_and_labels():
    of_model = constant_model(KAPPA, GAMMA, falloff=[0.0, 0.2, 0.0, 1.0], tint=(1.0, 0.5, 0.25))
    found = components(of_model)
    assert [part.lobe for part in found] == [0, 1, 2, 3]
    assert [part.label for part in found] == LABELS
    assert sum(part.share for part in found) == pytest.approx(1.0)
    assert sum(part.share_oblique for part in found) == pytest.approx(1.0)
    at_zero = of_model.lobes.at([0.0])
    for part in found:
        k = part.lobe
        albedo = of_model.lobe(k).albedo([0.0, np.pi / 4])
        total = of_model.albedo([0.0, np.pi / 4])
        assert part.share == pytest.approx(albedo[0].sum() / total[0].sum())
        assert part.share_oblique == pytest.approx(albedo[1].sum() / total[1].sum())
        np.testing.assert_allclose(part.colour, albedo[0] / albedo[0].max())
        widths = half_width(at_zero.kappa[0, :, k], at_zero.gamma[0, k], at_zero.falloff[0, k])
        assert part.half_width == pytest.approx(np.average(widths, weights=albedo[0]))


def test_the_width_is_that_at_no_difference_angle():
    of_model = random_model(3)
    for part in components(of_model):
        at_zero = of_model.lobe(part.lobe).lobes.at([0.0])
        widths = half_width(at_zero.kappa[0, :, 0], at_zero.gamma[0, 0], at_zero.falloff[0, 0])
        assert widths.min() - 1e-12 <= part.half_width <= widths.max() + 1e-12


@pytest.mark.parametrize(
    ("degrees", "label"),
    [
        (0.5, "spike"), (1.49, "spike"), (1.51, "specular"), (5.9, "specular"),
        (6.1, "glossy"), (24.9, "glossy"), (25.1, "body"), (60.0, "body"),
    ],
)  # fmt: skip
def test_limits(degrees, label):
    # A lobe of small kappa is cos^gamma, half its height at cos = 2^(-1 / gamma)
    gamma = -np.log(2.0) / np.log(np.cos(np.deg2rad(degrees)))
    (part,) = components(constant_model(1e-9, gamma))
    assert part.label == label
    assert np.rad2deg(part.half_width) == pytest.approx(degrees, rel=1e-6)
    assert part.reason.startswith(f"It falls to half its height at {degrees:.2g} degrees, ")
    assert part.reason.endswith(".")


def test_a_lobe_that_gives_no_light():
    found = components(constant_model((0.3, 1e-30), (0.3, 10.0)))
    assert found[1].share < 1e-25
    assert np.isfinite(found[1].half_width)


def test_info_shows_them(tmp_path, capsys):
    constant_model(KAPPA, GAMMA).save(tmp_path / "made-up.json")
    assert cli.main(["info", str(tmp_path / "made-up.json")]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    kinds = {row[0]: row[1] for row in rows if len(row) > 6 and row[1] in LABELS}
    assert kinds == dict(zip("0123", LABELS, strict=True))
