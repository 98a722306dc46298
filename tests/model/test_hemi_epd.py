"""Hemi-EPD and von Mises-Fisher density: reference values, second routes, limits, sampling, errors."""

import json
import math
import tracemalloc
from itertools import pairwise
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import entr, hyp1f1
from scipy.stats import chisquare

from dsbrdf import hemi_epd

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "hemi_epd.json").read_text())
LOBES = [(0.01, 0.2), (1.0, 1.0), (3.0, 0.05), (6.0, 20.0), (40.0, 3.0), (300.0, 500.0)]
kappas = st.floats(-14.0, math.log10(700.0)).map(lambda e: 10.0**e)
gammas = st.one_of(st.just(0.0), st.floats(-6.0, 6.0).map(lambda e: 10.0**e))
each_lobe = pytest.mark.parametrize(("kappa", "gamma"), LOBES)


def reference(name, argument=None):
    """Parameters, arguments and reference values of one function, each flat."""
    rows = REFERENCE["hemi_epd"]
    counts = [len(row[argument]) if argument else 1 for row in rows]
    kappa, gamma = (np.repeat([row[key] for row in rows], counts) for key in ("kappa", "gamma"))
    values = np.array(np.hstack([row[name] for row in rows]), dtype=np.float64)
    arguments = (np.hstack([row[argument] for row in rows]),) if argument else ()
    return *arguments, kappa, gamma, values


def over_hemisphere(function, kappa, gamma, high=np.pi / 2):
    """Integral of `function` of the polar angle over a cone of half-angle `high`."""
    edges = hemi_epd.quantile([0.0, 0.1, 0.5, 0.9, 0.999, 1.0], kappa, gamma)
    return over_panels(function, np.append(edges[edges < high], high))


def over_panels(function, edges):
    """Integral over solid angle of `function` of the polar angle, panel by panel."""

    def integrand(theta):
        return 2 * np.pi * np.sin(theta) * function(theta)

    return sum(quad(integrand, a, b, epsabs=0, epsrel=1e-12)[0] for a, b in pairwise(edges))


class TestReferenceValues:
    """Against 50 digits, for kappa from 1e-14 to 700 and gamma from 1e-6 to 1e6."""

    def test_log_normaliser(self):
        kappa, gamma, expected = reference("log_normaliser")
        assert_allclose(hemi_epd.log_normaliser(kappa, gamma), expected, rtol=1e-15, atol=1e-14)

    def test_mean(self):
        kappa, gamma, expected = reference("mean")
        assert_allclose(hemi_epd.mean(kappa, gamma), expected, rtol=2e-14)

    def test_entropy(self):
        kappa, gamma, expected = reference("entropy")
        assert_allclose(hemi_epd.entropy(kappa, gamma), expected, rtol=1e-14, atol=1e-14)

    @pytest.mark.parametrize("name", ["lobe", "pdf"])
    def test_density(self, name):
        # The exponent reaches 700, and its rounding error is the relative error of the result.
        theta_h, kappa, gamma, expected = reference(name, "theta_h")
        assert_allclose(getattr(hemi_epd, name)(theta_h, kappa, gamma), expected, rtol=3e-13, atol=1e-300)

    def test_log_pdf(self):
        theta_h, kappa, gamma, expected = reference("log_pdf", "theta_h")
        assert expected.min() < -1e7
        assert_allclose(hemi_epd.log_pdf(theta_h, kappa, gamma), expected, rtol=1e-15, atol=2e-14)

    def test_cdf(self):
        theta_h, kappa, gamma, expected = reference("cdf", "theta_h")
        assert expected.min() < 1e-18
        assert_allclose(hemi_epd.cdf(theta_h, kappa, gamma), expected, rtol=1e-14)

    def test_quantile(self):
        q, kappa, gamma, expected = reference("quantile", "q")
        assert expected.min() < 1e-100
        assert_allclose(hemi_epd.quantile(q, kappa, gamma), expected, rtol=1e-14)

    @pytest.mark.parametrize("row", REFERENCE["von_mises_fisher"], ids=lambda row: f"kappa={row['kappa']:g}")
    def test_von_mises_fisher(self, row):
        log_pdf, pdf = (np.array(row[name], dtype=np.float64) for name in ("log_pdf", "pdf"))
        theta_h, kappa = row["theta_h"], row["kappa"]
        assert_allclose(hemi_epd.von_mises_fisher_log_pdf(theta_h, kappa), log_pdf, rtol=1e-15, atol=1e-14)
        assert_allclose(hemi_epd.von_mises_fisher_pdf(theta_h, kappa), pdf, rtol=3e-13, atol=1e-300)


class TestTwoRoutes:
    @settings(deadline=None)
    @given(kappas, gammas)
    def test_normaliser_is_the_series(self, kappa, gamma):
        orders = np.arange(1, 60 + int(kappa + 12 * math.sqrt(kappa)))
        terms = np.cumprod(kappa / orders) / (orders * gamma + 1)
        expected = -math.log(2 * np.pi * math.fsum(terms))
        assert_allclose(hemi_epd.log_normaliser(kappa, gamma), expected, rtol=0, atol=5e-13)

    @pytest.mark.parametrize("gamma", [0.05, 0.5, 1.0, 3.0, 100.0])
    @pytest.mark.parametrize("kappa", [0.7, 12.0, 150.0])
    def test_normaliser_is_the_printed_one(self, kappa, gamma):
        with mp.workdps(40):
            k, a = mp.mpc(kappa), 1 / mp.mpf(gamma)
            root = gamma * (-k) ** a
            printed = root / (2 * mp.pi * (mp.gamma(a) - mp.gammainc(a, -k) - root))
            assert abs(printed.imag) < 1e-30 * printed.real
            expected = float(mp.log(printed.real))
        assert_allclose(hemi_epd.log_normaliser(kappa, gamma), expected, rtol=1e-15, atol=1e-14)

    @pytest.mark.parametrize("gamma", [0.3, 1.0, 20.0])
    @pytest.mark.parametrize("kappa", [0.5, 5.0, 50.0])
    def test_normaliser_is_kummers_function(self, kappa, gamma):
        inverse = 2 * np.pi * (hyp1f1(1 / gamma, 1 + 1 / gamma, kappa) - 1)
        assert_allclose(np.exp(hemi_epd.log_normaliser(kappa, gamma)), 1 / inverse, rtol=1e-12)

    @each_lobe
    def test_pdf_is_the_scaled_lobe(self, kappa, gamma):
        theta_h = hemi_epd.quantile([0.0, 0.3, 0.9, 0.9999], kappa, gamma)
        scaled = np.exp(hemi_epd.log_normaliser(kappa, gamma)) * hemi_epd.lobe(theta_h, kappa, gamma)
        assert_allclose(hemi_epd.pdf(theta_h, kappa, gamma), scaled, rtol=1e-12)

    @each_lobe
    def test_pdf_integrates_to_cdf(self, kappa, gamma):
        for share in (1e-3, 0.3, 0.8, 1.0):
            theta_h = hemi_epd.quantile(share, kappa, gamma)
            integral = over_hemisphere(lambda t: hemi_epd.pdf(t, kappa, gamma), kappa, gamma, high=theta_h)
            assert_allclose(integral, share, rtol=1e-11)

    @each_lobe
    def test_mean_and_entropy_are_integrals(self, kappa, gamma):
        def pdf(theta_h):
            return hemi_epd.pdf(theta_h, kappa, gamma)

        mean = over_hemisphere(lambda t: np.cos(t) * pdf(t), kappa, gamma)
        entropy = over_hemisphere(lambda t: entr(pdf(t)), kappa, gamma)
        assert_allclose(hemi_epd.mean(kappa, gamma), mean, rtol=1e-11)
        assert_allclose(hemi_epd.entropy(kappa, gamma), entropy, rtol=1e-10)

    @pytest.mark.parametrize("kappa", [0.0, 0.3, 8.0, 500.0])
    def test_von_mises_fisher_integrates_to_one_over_the_sphere(self, kappa):
        def function(theta):
            return hemi_epd.von_mises_fisher_pdf(theta, kappa)

        assert_allclose(over_panels(function, [0.0, 0.1, 0.4, 1.0, np.pi]), 1.0, rtol=1e-12)


class TestLimits:
    @pytest.mark.parametrize("gamma", [0.0, 1e-13])
    def test_gamma_zero_is_lambert(self, gamma):
        theta_h, kappa = np.linspace(0.0, np.pi / 2, 7), np.array([[1e-9], [2.0], [200.0]])
        log_c = hemi_epd.log_normaliser(kappa, gamma)
        assert_allclose(log_c, -np.log(2 * np.pi * np.expm1(kappa)), rtol=1e-15, atol=1e-9 * (gamma > 0))
        assert_allclose(hemi_epd.pdf(theta_h, kappa, gamma), 0.5 / np.pi, rtol=1e-9)
        share = np.broadcast_to(2 * np.sin(theta_h / 2) ** 2, (3, 7))
        assert_allclose(hemi_epd.cdf(theta_h, kappa, gamma), share, rtol=1e-9)
        assert_allclose(hemi_epd.mean(kappa, gamma), 0.5, rtol=1e-9)
        assert_allclose(hemi_epd.entropy(kappa, gamma), np.log(2 * np.pi), rtol=1e-9)

    def test_large_gamma_is_a_mirror(self):
        gamma = np.array([1e2, 1e6, 1e10, 1e14])
        width = hemi_epd.quantile(0.999, 4.0, gamma)
        assert np.all(hemi_epd.mean(4.0, gamma[1:]) > 1 - 1e-5)
        assert_allclose(width[1:] * np.sqrt(gamma[1:]), width[1] * 1e3, rtol=1e-5)
        assert width[-1] < 1e-6

    def test_small_kappa_is_a_cosine_power(self):
        theta_h, gamma = np.linspace(0.0, 1.5, 9), np.array([[0.5], [4.0], [90.0]])
        power = (gamma + 1) / (2 * np.pi) * np.cos(theta_h) ** gamma
        assert_allclose(hemi_epd.pdf(theta_h, 1e-14, gamma), power, rtol=1e-13)

    @pytest.mark.parametrize("gamma", [0.2, 3.0, 1e4])
    def test_large_kappa_has_its_asymptotic_normaliser(self, gamma):
        # Laplace's method: 1/C = 2 pi e^kappa / (kappa gamma) (1 + (1 - 1/gamma) / kappa + ...).
        kappa = 1e6
        log_c = hemi_epd.log_normaliser(kappa, gamma)
        leading = -kappa + np.log(kappa * gamma / (2 * np.pi)) - (1 - 1 / gamma) / kappa
        assert_allclose(log_c, leading, rtol=0, atol=1e-9)

    @pytest.mark.parametrize(("kappa", "gamma"), [(2.0, 3.0), (8.0, 0.5), (5.0, 60.0)])
    def test_small_angles_are_gaussian_to_fourth_order(self, kappa, gamma):
        # Section 3: p = C (e^kappa exp(-kappa gamma theta_h^2 / 2) - 1) + O(theta_h^4).
        theta_h = 0.02 / np.sqrt(kappa * gamma) * np.array([4.0, 2.0])
        gaussian = np.exp(kappa - kappa * gamma * theta_h**2 / 2) - 1
        rest = hemi_epd.lobe(theta_h, kappa, gamma) - gaussian
        assert np.all(np.abs(rest) < np.exp(kappa) * kappa * gamma * (1 + gamma) * theta_h**4)
        assert_allclose(rest[0] / rest[1], 16.0, rtol=0.02)

    def test_von_mises_fisher_needs_the_whole_sphere(self):
        # Its share of the hemisphere: (1 - exp(-kappa)) / (1 - exp(-2 kappa)).
        inside = over_panels(lambda t: hemi_epd.von_mises_fisher_pdf(t, 1.0), [0.0, np.pi / 2])
        assert_allclose(inside, 1 / (1 + np.exp(-1.0)), rtol=1e-12)

    def test_ends_of_the_range(self):
        kappa, gamma = (np.array(parameter) for parameter in zip(*LOBES, strict=True))
        assert_allclose(hemi_epd.cdf([[0.0], [np.pi / 2]], kappa, gamma), [[0.0] * 6, [1.0] * 6], rtol=1e-15)
        assert_allclose(hemi_epd.quantile([[0.0], [1.0]], kappa, gamma), [[0.0] * 6, [np.pi / 2] * 6], rtol=0)

    def test_quantile_of_the_smallest_numbers(self):
        smallest = np.nextafter(0.0, 1.0)
        for kappa in (1e-14, 1.0, 1e15):
            theta_h = hemi_epd.quantile([smallest, 1e-300, 1e-200, 0.5], kappa, [[0.0], [3.0]])
            assert np.all(theta_h[:, 0] < 1e-140)
            assert np.all(np.diff(theta_h) > 0)

    def test_lobe_overflows_aloud_and_the_density_does_not(self):
        with pytest.warns(RuntimeWarning, match="overflow"):
            assert hemi_epd.lobe(0.0, 800.0, 2.0) == np.inf
        assert_allclose(hemi_epd.pdf(0.0, 800.0, 2.0), 1600 / (2 * np.pi), rtol=1e-3)


class TestShape:
    @settings(deadline=None)
    @given(kappas, gammas, st.floats(0.0, 1.0))
    def test_cdf_inverts_quantile(self, kappa, gamma, q):
        theta_h = hemi_epd.quantile(q, kappa, gamma)
        assert 0.0 <= theta_h <= np.pi / 2
        assert_allclose(hemi_epd.cdf(theta_h, kappa, gamma), q, rtol=1e-13, atol=1e-280)

    @settings(deadline=None)
    @given(kappas, gammas, st.floats(0.0, np.pi / 2))
    def test_quantile_inverts_cdf(self, kappa, gamma, theta_h):
        q = hemi_epd.cdf(theta_h, kappa, gamma)
        if 1e-280 < q < 0.5:
            assert_allclose(hemi_epd.quantile(q, kappa, gamma), theta_h, rtol=1e-13)

    @settings(deadline=None)
    @given(kappas, gammas)
    def test_monotone(self, kappa, gamma):
        theta_h = np.append(0.0, np.geomspace(1e-6, np.pi / 2, 60))
        assert np.all(np.diff(hemi_epd.cdf(theta_h, kappa, gamma)) >= -1e-15)
        assert np.all(np.diff(hemi_epd.log_pdf(theta_h, kappa, gamma)) <= 1e-13)
        assert np.all(np.diff(hemi_epd.quantile(np.linspace(0.0, 1.0, 30), kappa, gamma)) > 0)

    @settings(deadline=None)
    @given(kappas)
    def test_larger_gamma_is_narrower(self, kappa):
        gamma = np.geomspace(1e-6, 1e6, 25)
        assert np.all(np.diff(hemi_epd.mean(kappa, gamma)) > 0)
        assert np.all(np.diff(hemi_epd.entropy(kappa, gamma)) < 1e-15)
        assert np.all(np.diff(hemi_epd.quantile(0.5, kappa, gamma)) < 0)

    def test_one_kappa_gives_distinct_shapes(self):
        # Fig. 1(b). Measured from the peak in half-widths, so that neither height nor width counts.
        theta_h = np.linspace(0.0, np.pi / 2, 4001)
        profile = hemi_epd.pdf(theta_h, 5.0, np.array([[0.3], [2.0], [20.0]]))
        profile /= profile[:, :1]
        widths = np.array([theta_h[np.argmax(row < 0.5)] for row in profile])
        tails = [np.interp(1.7 * width, theta_h, row) for width, row in zip(widths, profile, strict=True)]
        assert np.all(widths[:-1] > 2 * widths[1:])
        assert np.all(np.diff(np.log(tails)) > 0.05)


class TestSample:
    # Both kinds of proposal, their border, few and many components, and near-mirrors.
    CASES = (
        (1e-9, 7.0),
        (0.5, 3.0),
        (3.0, 0.3),
        (3.0, 0.4),
        (15.0, 1.0),
        (40.0, 0.02),
        (9.0, 2e4),
        (600.0, 2e4),
    )

    def test_chi_square(self):
        rng = np.random.default_rng(20110201)
        p_values = []
        for kappa, gamma in self.CASES:
            edges = hemi_epd.quantile(np.linspace(0.0, 1.0, 41), kappa, gamma)
            counts, _ = np.histogram(hemi_epd.sample(kappa, gamma, rng, 200_000), edges)
            p_values.append(chisquare(counts).pvalue)
        # Sidak: one level for all cases together.
        assert min(p_values) > 1 - (1 - 0.01) ** (1 / len(p_values)), p_values

    def test_parameters_may_differ_from_draw_to_draw(self):
        rng = np.random.default_rng(4)
        kappa, gamma = 10 ** rng.uniform(-2, 2.5, 40_000), 10 ** rng.uniform(-3, 4, 40_000)
        ranks = hemi_epd.cdf(hemi_epd.sample(kappa, gamma, rng), kappa, gamma)
        assert chisquare(np.histogram(ranks, 40, (0.0, 1.0))[0]).pvalue > 0.01
        # The ranks are uniform also among the draws of similar parameters.
        assert abs(np.corrcoef(ranks, np.log(kappa))[0, 1]) < 4 / np.sqrt(ranks.size)
        assert abs(np.corrcoef(ranks, np.log(gamma))[0, 1]) < 4 / np.sqrt(ranks.size)

    def test_wrong_parameters_are_seen(self):
        draws = hemi_epd.sample(9.0, 2e4 * 1.05, np.random.default_rng(1), 200_000)
        edges = hemi_epd.quantile(np.linspace(0.0, 1.0, 41), 9.0, 2e4)
        assert chisquare(np.histogram(draws, edges)[0]).pvalue < 1e-6

    @pytest.mark.parametrize(("kappa", "gamma"), CASES)
    def test_moments(self, kappa, gamma):
        draws = hemi_epd.sample(kappa, gamma, np.random.default_rng(7), 100_000)
        for values, expected in (
            (np.cos(draws), hemi_epd.mean(kappa, gamma)),
            (-hemi_epd.log_pdf(draws, kappa, gamma), hemi_epd.entropy(kappa, gamma)),
        ):
            assert abs(values.mean() - expected) < 4.5 * values.std() / np.sqrt(draws.size)

    def test_shapes_and_repeatability(self):
        kappa, gamma = [1.0, 2.0, 500.0], [[3.0], [4.0]]
        assert hemi_epd.sample(1.0, 2.0, np.random.default_rng(0)).shape == ()
        assert hemi_epd.sample(kappa, gamma, np.random.default_rng(0)).shape == (2, 3)
        first = hemi_epd.sample(kappa, gamma, np.random.default_rng(0), size=(5, 2, 3))
        again = hemi_epd.sample(kappa, gamma, np.random.default_rng(0), size=(5, 2, 3))
        assert first.shape == again.shape == (5, 2, 3)
        assert np.array_equal(first, again)
        assert hemi_epd.sample(kappa, gamma, np.random.default_rng(0), size=(0, 2, 3)).size == 0

    def test_size_must_hold_the_parameters(self):
        with pytest.raises(ValueError, match=r"broadcast"):
            hemi_epd.sample([1.0, 2.0], 3.0, np.random.default_rng(0), size=3)


class TestBroadcasting:
    FUNCTIONS = (
        *((name, (0.5, 3.0, 7.0)) for name in ("lobe", "pdf", "log_pdf", "cdf", "quantile")),
        *((name, (3.0, 7.0)) for name in ("log_normaliser", "mean", "entropy")),
        *((name, (0.5, 3.0)) for name in ("von_mises_fisher_pdf", "von_mises_fisher_log_pdf")),
    )

    @pytest.mark.parametrize(("name", "typical"), FUNCTIONS)
    @settings(deadline=None)
    @given(shapes=mutually_broadcastable_shapes(num_shapes=3, min_side=0, max_dims=3), seed=st.integers(0, 9))
    def test_equals_one_by_one(self, name, typical, shapes, seed):
        function = getattr(hemi_epd, name)
        rng = np.random.default_rng(seed)
        inputs = zip(typical, shapes.input_shapes, strict=False)
        arguments = [x * rng.uniform(0.2, 1.8, shape) for x, shape in inputs]
        result = function(*arguments)
        spread = np.broadcast_arrays(*arguments)
        assert result.shape == spread[0].shape
        assert result.dtype == np.float64
        single = [function(*row) for row in zip(*(a.ravel() for a in spread), strict=True)]
        assert_allclose(result.ravel(), single, rtol=1e-14)

    def test_many_rows(self):
        kappa, gamma = np.geomspace(0.01, 100.0, 3001), np.geomspace(1e3, 0.1, 3001)
        few = hemi_epd.mean(kappa[::500], gamma[::500])
        assert_allclose(hemi_epd.mean(kappa, gamma)[::500], few, rtol=1e-14)

    def test_memory_does_not_grow_with_the_rule(self):
        kappa = np.geomspace(0.01, 700.0, 100_000)
        tracemalloc.start()
        try:
            hemi_epd.log_normaliser(kappa, 30.0)
            assert tracemalloc.get_traced_memory()[1] < 12 * kappa.nbytes
        finally:
            tracemalloc.stop()

    def test_float32_and_lists_give_float64(self):
        assert hemi_epd.pdf(np.float32(0.25), [1, 2], np.array([3], dtype=np.int64)).dtype == np.float64


class TestErrors:
    @pytest.mark.parametrize("kappa", [0.0, -2.0, np.nan, np.inf])
    def test_kappa(self, kappa):
        with pytest.raises(ValueError, match=r"'kappa' must be > 0 and finite, got .* at index 1\."):
            hemi_epd.log_normaliser([1.0, kappa], 2.0)

    def test_gamma(self):
        gamma = np.ones((5, 1, 3))
        gamma[4, 0, 2] = -0.3
        match = r"'gamma' must be >= 0 and finite, got -0\.3 at index \(4, 0, 2\)\."
        for function in (hemi_epd.log_normaliser, hemi_epd.mean, hemi_epd.entropy):
            with pytest.raises(ValueError, match=match):
                function(1.0, gamma)
        for function in (hemi_epd.lobe, hemi_epd.pdf, hemi_epd.log_pdf, hemi_epd.cdf, hemi_epd.quantile):
            with pytest.raises(ValueError, match=match):
                function(0.5, 1.0, gamma)
        with pytest.raises(ValueError, match=match):
            hemi_epd.sample(1.0, gamma, np.random.default_rng(0))

    @pytest.mark.parametrize("name", ["lobe", "pdf", "log_pdf", "cdf"])
    def test_degrees(self, name):
        with pytest.raises(ValueError, match=r"'theta_h' must lie in \[0, pi/2\] radians, got 45\. Degree"):
            getattr(hemi_epd, name)(45.0, 1.0, 2.0)

    def test_probability(self):
        with pytest.raises(ValueError, match=r"'q' must be >= 0 and <= 1 and finite, got 1\.2 at index 1\."):
            hemi_epd.quantile([0.5, 1.2], 1.0, 2.0)

    def test_seed_in_place_of_generator(self):
        match = r"'rng' must be a numpy\.random\.Generator, got int\. Use numpy\.random\.default_rng"
        with pytest.raises(TypeError, match=match):
            hemi_epd.sample(1.0, 2.0, 1234)

    def test_von_mises_fisher(self):
        with pytest.raises(ValueError, match=r"'kappa' must be >= 0 and finite, got -1\."):
            hemi_epd.von_mises_fisher_pdf(0.1, -1.0)
        with pytest.raises(ValueError, match=r"'theta_h' must lie in \[0, 3\.14159\] radians, got 90\."):
            hemi_epd.von_mises_fisher_log_pdf(90.0, 1.0)
