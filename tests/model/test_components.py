"""What lobes are called, and how rough their curves are."""

import numpy as np
import pytest

import dsbrdf
from dsbrdf import DSBRDF, cli, hemi_epd
from dsbrdf.model.components import components, half_width, roughness

THETA_D = np.pi / 2 * (np.arange(6) + 0.5) / 6
# A mirror, a specular, a glossy lobe, a body
KAPPA = (4.0, 2.0, 0.8, 0.3)
GAMMA = (40000.0, 500.0, 60.0, 0.3)
LABELS = ["spike", "specular", "glossy", "body"]


def model(kappa=KAPPA, gamma=GAMMA, tint=(1.0, 1.0, 1.0), spike=None):
    ones = np.ones((len(THETA_D), len(tint), 1))
    kappa = np.asarray(kappa) * ones * np.asarray(tint)[:, None]
    return DSBRDF(THETA_D, kappa, np.asarray(gamma) * ones, 0.0 * kappa, spike=spike)


@pytest.mark.parametrize("kappa", [1e-9, 0.3, 1.0, 5.0, 600.0])
@pytest.mark.parametrize("gamma", [0.1, 1.0, 300.0, 1e6])
def test_half_width(kappa, gamma):
    width = float(half_width(np.array(kappa), np.array(gamma)))
    assert 0.0 < width <= np.pi / 2
    at = float(hemi_epd.lobe(width, kappa, gamma))
    assert at == pytest.approx(0.5 * np.expm1(kappa), rel=1e-6)


def test_half_width_of_a_lobe_that_does_not_fall():
    assert half_width(np.array(1.0), np.array(0.0)) == pytest.approx(np.pi / 2)


def test_shares_colours_and_labels():
    of_model = model(tint=(1.0, 0.5, 0.25))
    found = components(of_model)
    assert [part.lobe for part in found] == [0, 1, 2, 3]
    assert [part.label for part in found] == LABELS
    assert sum(part.share for part in found) == pytest.approx(1.0)
    assert sum(part.share_oblique for part in found) == pytest.approx(1.0)
    for part in found:
        albedo = of_model.lobe(part.lobe).albedo([0.0, np.pi / 4])
        total = of_model.albedo([0.0, np.pi / 4])
        assert part.share == pytest.approx(albedo[0].sum() / total[0].sum())
        assert part.share_oblique == pytest.approx(albedo[1].sum() / total[1].sum())
        np.testing.assert_allclose(part.colour, albedo[0] / albedo[0].max())
        widths = half_width(of_model.kappa[0, :, part.lobe], of_model.gamma[0, :, part.lobe])
        assert part.half_width == pytest.approx(np.average(widths, weights=albedo[0]))


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
    (part,) = components(model((1e-9,), (gamma,)))
    assert part.label == label
    assert np.rad2deg(part.half_width) == pytest.approx(degrees, rel=1e-6)
    assert part.reason.startswith(f"It falls to half its height at {degrees:.2g} degrees, ")
    assert part.reason.endswith(".")


def test_the_delta_term():
    spike = np.full((len(THETA_D), 3), 50.0)
    with_spike = model((0.3,), (0.3,), spike=spike)
    body, delta = components(with_spike)
    assert (body.label, delta.label, delta.lobe) == ("body", "spike", None)
    assert "delta term" in delta.reason
    expected = with_spike.albedo(0.0).sum() - model((0.3,), (0.3,)).albedo(0.0).sum()
    assert delta.share * with_spike.albedo(0.0).sum() == pytest.approx(expected, rel=1e-6)
    assert np.rad2deg(delta.half_width) == pytest.approx(np.sqrt(0.5), rel=1e-3)
    np.testing.assert_allclose(delta.colour, 1.0)


def test_a_lobe_that_gives_no_light():
    found = components(model((0.3, 1e-30), (0.3, 10.0)))
    assert found[1].share < 1e-25
    assert np.isfinite(found[1].half_width)


def test_order_of_lobes_makes_curves_rough():
    smooth = model()
    swapped = smooth.kappa.copy(), smooth.gamma.copy()
    for values in swapped:
        values[3] = values[3][:, ::-1]
    assert roughness(smooth).kappa == pytest.approx(0.0, abs=1e-20)
    rough = roughness(smooth.replace(kappa=swapped[0], gamma=swapped[1]))
    assert rough.kappa > 0.1
    assert rough.gamma > 1.0


def test_roughness_by_hand():
    kappa = np.full((4, 1, 1), 2.0)
    kappa[2] *= np.e
    of_model = DSBRDF(THETA_D[:4], kappa, np.ones_like(kappa), 0.0 * kappa)
    # ln(kappa) steps by 0, 1, -1: second differences 1 and -2
    assert roughness(of_model).kappa == pytest.approx((1.0 + 4.0) / 2.0)
    assert roughness(of_model).gamma == 0.0


def test_absent_lobes_do_not_make_it_rough():
    absent = model().kappa.copy()
    rng = np.random.default_rng(3)
    absent[..., 0] = 10.0 ** rng.uniform(-18.0, -12.0, absent.shape[:2])
    assert roughness(model().replace(kappa=absent)).kappa < 1e-6


def test_roughness_needs_three_slices():
    kappa = np.ones((2, 1, 1))
    assert np.isnan(roughness(DSBRDF(THETA_D[:2], kappa, kappa, 0.0 * kappa)).kappa)


def test_info_shows_them(tmp_path, capsys):
    model(spike=np.full((len(THETA_D), 3), 50.0)).save(tmp_path / "made-up.json")
    assert cli.main(["info", str(tmp_path / "made-up.json")]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    kinds = {row[0]: row[1] for row in rows if len(row) > 8 and row[1] in LABELS}
    assert kinds == {"0": "spike", "1": "specular", "2": "glossy", "3": "body", "delta": "spike"}


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
def test_measured_materials(decoded):
    fabric = components(dsbrdf.fit(dsbrdf.read(decoded("pink-felt"))).model)
    assert max(fabric, key=lambda part: part.share).label == "body"
    metal = components(dsbrdf.fit(dsbrdf.read(decoded("nickel"))).model)
    assert max(metal, key=lambda part: part.share).label == "specular"
