"""The choice of the number of lobes: that it finds what is there, and takes no more."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import dsbrdf
from dsbrdf.paper import SliceProfile, fit_slices, plot_selection, slice_profiles
from dsbrdf.paper.selection import LobeSelection, divergence, select_lobes

# Those of a MERL table, and its slices every 5 degrees
THETA_H = np.pi / 2 * ((np.arange(90) + 0.5) / 90) ** 2
THETA_D = np.deg2rad(5.0 * np.arange(18) + 0.5)
N_PHI = 180
# Body, gloss, highlight, narrow highlight: half widths of 60 to 1 degrees; each well above the flank of the next
KAPPA = np.array([0.25, 0.6, 1.5, 3.0])
GAMMA = np.array([0.5, 15.0, 250.0, 4000.0])


def profiles_of(kappa, gamma, rng=None, noise=0.01, theta_d=THETA_D):
    """Slices of lobes (theta_d, channel, lobe), each sample with a relative error of `noise`."""
    cos_h = np.cos(THETA_H)[:, None]
    made = []
    for angle, k, g in zip(theta_d, kappa, gamma, strict=True):
        f = np.expm1(k[:, None] * cos_h ** g[:, None]).sum(-1)
        error = noise * f if rng is not None else 0.0 * f
        mean = f + error * (0.0 if rng is None else rng.standard_normal(f.shape)) / np.sqrt(N_PHI)
        moments = np.zeros((*f.shape, 6))
        moments[..., 0] = N_PHI
        moments[..., 1] = N_PHI * mean
        moments[..., 2] = N_PHI * (mean**2 + error**2)
        moments[..., 4] = N_PHI / 2
        fitted = (np.deg2rad(1.0) <= THETA_H) & (np.pi / 2 - angle > THETA_H)
        moments[:, ~fitted] = 0.0
        made.append(SliceProfile(float(angle), THETA_H, moments))
    return made


def mixture(n_lobes, rng, n_slices=18):
    """kappa and gamma (theta_d, channel, lobe) of a random mixture that changes over theta_d."""
    theta_d = THETA_D[:n_slices, None, None]
    kappa = KAPPA[:n_lobes] * rng.uniform(0.8, 1.25, n_lobes) * (1.0 + rng.uniform(0.0, 0.4) * theta_d)
    gamma = GAMMA[:n_lobes] * rng.uniform(0.8, 1.25, n_lobes) * (1.0 + 0.0 * theta_d)
    return kappa, gamma


def known(n_lobes, rng, n_slices=18, **options):
    return profiles_of(*mixture(n_lobes, rng, n_slices), rng, theta_d=THETA_D[:n_slices], **options)


def test_divergence_by_brute_force(rng):
    kappa, gamma = mixture(3, rng)
    profiles = profiles_of(kappa, gamma, rng, noise=0.3)
    got = divergence(profiles, 1.3 * kappa, 0.7 * gamma)
    assert got.shape == (18, 1)
    for i, profile in enumerate(profiles):
        some = profile.count[0] > 0.0
        p = profile.moments[0, some, 1]
        p = p / p.sum()
        q = np.zeros(some.sum())
        for k, g in zip(1.3 * kappa[i, 0], 0.7 * gamma[i, 0], strict=True):
            q += np.exp(k * np.cos(THETA_H[some]) ** g) - 1.0
        q = q / q.sum()
        expected = sum(a * (np.log(a) - np.log(b)) for a, b in zip(p, q, strict=True))
        assert got[i, 0] == pytest.approx(expected, rel=1e-9, abs=1e-14)


def test_divergence_is_zero_for_a_perfect_fit_and_never_negative(rng):
    kappa, gamma = mixture(4, rng)
    profiles = profiles_of(kappa, gamma)
    np.testing.assert_allclose(divergence(profiles, kappa, gamma), 0.0, atol=1e-13)
    # The scale of a slice is no matter of shape
    darker = [SliceProfile(p.theta_d, p.theta_h, p.moments * [1, 0.1, 0.01, 1, 1, 0.1]) for p in profiles]
    np.testing.assert_allclose(divergence(darker, kappa, gamma), 0.0, atol=1e-13)
    assert (divergence(profiles, kappa, 1.1 * gamma) > 0.0).all()


def test_divergence_of_an_empty_slice():
    profiles = profiles_of(np.ones((2, 1, 1)), np.ones((2, 1, 1)), theta_d=THETA_D[:2])
    empty = SliceProfile(profiles[1].theta_d, THETA_H, np.zeros_like(profiles[1].moments))
    assert divergence([profiles[0], empty], np.ones((2, 1, 1)), np.ones((2, 1, 1)))[1, 0] == 0.0


def test_known_mixtures():
    """One to four separated lobes, 1 % noise: the right number in at least 95 of 100."""
    rng = np.random.default_rng(2011)
    chosen = np.array([[select_lobes(known(n, rng)).n_lobes for _ in range(25)] for n in (1, 2, 3, 4)])
    right = (chosen == np.array([[1], [2], [3], [4]])).sum(1)
    assert right.sum() >= 95, chosen
    assert (right >= 22).all(), chosen
    assert (chosen < 6).all(), chosen


@pytest.mark.parametrize("max_lobes", [3, 4, 8])
def test_the_upper_bound_is_not_preferred(rng, max_lobes):
    selection = select_lobes(known(2, rng), max_lobes=max_lobes)
    assert selection.n_lobes == 2
    assert selection.max_lobes == max_lobes
    assert len(selection.statistic) == len(selection.critical) == max_lobes


def test_the_upper_bound_where_more_is_needed(rng):
    selection = select_lobes(known(4, rng), max_lobes=2)
    assert selection.n_lobes == 2
    assert selection.statistic[0] > selection.critical[0]


def test_the_record_of_the_test_is_its_verdict(rng):
    selection = select_lobes(known(3, rng))
    assert selection.criterion == "williams"
    assert selection.n_lobes == 3
    significant = selection.statistic[:-1] > selection.critical[:-1]
    np.testing.assert_array_equal(significant, [True, True, False, False, False])
    assert np.isnan([selection.statistic[-1], selection.critical[-1]]).all()
    assert (np.diff(selection.values[:3]) < 0.0).all()


def test_the_level(rng):
    profiles = known(3, rng)
    loose, strict = (select_lobes(profiles, alpha=alpha).critical[:-1] for alpha in (0.05, 0.01))
    assert (loose < strict).all()


def test_channels_share_one_number(rng):
    kappa, gamma = mixture(2, rng)
    tint = np.array([1.0, 0.7, 1.2])[:, None]
    assert select_lobes(profiles_of(kappa * tint, gamma * np.ones((3, 1)), rng)).n_lobes == 2


def test_bic(rng):
    selection = select_lobes(known(2, rng), criterion="bic")
    assert selection.criterion == "bic"
    assert selection.n_lobes == selection.values.argmin() + 1
    assert 2 <= selection.n_lobes <= 4
    assert selection.values[0] > selection.values[1]
    assert np.isnan(selection.statistic).all()


def test_held_out(rng):
    kappa, gamma = mixture(2, rng)
    fitted, held_out = (profiles_of(kappa, gamma, rng) for _ in range(2))
    selection = select_lobes(fitted, criterion="held-out", held_out=held_out)
    assert selection.criterion == "held-out"
    assert selection.n_lobes == selection.values.argmin() + 1
    # What is left with enough lobes is the noise of the samples, and little that grown fits are short of the best
    assert selection.values[0] > 2.0 * selection.values[1]
    assert (selection.values > 0.0098).all()
    assert (selection.values[2:] < 0.012).all()


@pytest.mark.parametrize(("n_slices", "criterion"), [(5, "bic"), (6, "williams")])
def test_few_slices(rng, n_slices, criterion):
    selection = select_lobes(known(2, rng, n_slices))
    assert selection.criterion == criterion
    assert 2 <= selection.n_lobes <= 4


def test_black_slices_do_not_count(rng):
    profiles = known(2, rng)
    black = [SliceProfile(p.theta_d, p.theta_h, p.moments * [1, 0, 0, 1, 1, 0]) for p in profiles]
    assert select_lobes([*profiles[:5], *black[5:]]).criterion == "bic"
    assert select_lobes([*profiles[:12], *black[12:]]).n_lobes == 2


def test_errors(rng):
    profiles = known(1, rng, 6)
    with pytest.raises(
        ValueError, match="'criterion' must be one of 'williams', 'bic', 'held-out', got 'aic'"
    ):
        select_lobes(profiles, criterion="aic")
    with pytest.raises(ValueError, match="'max_lobes' must be at least 1, got 0"):
        select_lobes(profiles, max_lobes=0)
    with pytest.raises(ValueError, match="needs the slices that were held out"):
        select_lobes(profiles, criterion="held-out")


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore::dsbrdf.paper.ConvergenceWarning")
def test_materials_of_the_paper(decoded):
    """5, 4 and 2 in the paper; ours are within one of each, and in this order."""
    names = ("nickel", "specular-blue-phenolic", "orange-paint")
    profiles = [slice_profiles(dsbrdf.read(decoded(name))) for name in names]
    chosen = np.array([select_lobes(each).n_lobes for each in profiles])
    assert (np.abs(chosen - [5, 4, 2]) <= 1).all(), chosen
    assert chosen[0] > chosen[1] > chosen[2]


@pytest.mark.shared
@pytest.mark.parametrize("name", ["pink-felt", "white-fabric"])
def test_matte_materials(decoded, name):
    assert select_lobes(slice_profiles(dsbrdf.read(decoded(name)))).n_lobes in (1, 2)


def test_figure(rng):
    selection = select_lobes(known(3, rng))
    figure = plot_selection.selection_figure(selection, "made up")
    assert isinstance(figure, Figure)
    values, test = figure.axes
    np.testing.assert_array_equal(values.get_lines()[0].get_ydata(), selection.values)
    np.testing.assert_array_equal(test.get_lines()[0].get_ydata(), selection.statistic)
    np.testing.assert_array_equal(test.get_lines()[1].get_ydata(), selection.critical)
    assert figure.get_suptitle() == "made up: 3 lobes, shaded"


def test_figure_without_a_test():
    nothing = np.full(3, np.nan)
    selection = LobeSelection(1, "bic", np.array([1.0, 2.0, 3.0]), nothing, nothing)
    figure = plot_selection.selection_figure(selection)
    assert len(figure.axes) == 1
    assert figure.get_suptitle() == "1 lobe, shaded"


@pytest.mark.parametrize("criterion", ["bic", "held-out"])
def test_fit_takes_another_criterion(criterion):
    chosen = fit_slices(dsbrdf.material("matte"), criterion=criterion).selection
    assert chosen.criterion == criterion
    assert 1 <= chosen.n_lobes <= chosen.max_lobes
    with pytest.raises(ValueError, match="'criterion' must be one of"):
        fit_slices(dsbrdf.material("matte"), criterion="aic")
