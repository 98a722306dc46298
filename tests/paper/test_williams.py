"""Williams' test: published critical values and examples, second routes, limits, level, errors."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import isotonic_regression
from scipy.stats import norm, t

from dsbrdf.paper import williams
from dsbrdf.paper.williams import critical_value, from_blocks, from_groups, isotonic_means, williams_test

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "williams.json").read_text())
# Replicates of the doses, of the control, degrees of freedom, level
DESIGNS = [
    ([1] * 10, 6, math.inf, 0.05),
    ([1] * 5, 6, 5, 0.01),
    ([1, 2, 5, 3], 2, 10, 0.05),
    ([100] * 4 + [1], 50, 20, 0.05),
    ([1] * 4 + [100], 0.1, 7, 0.05),
    ([3, 1], 1, 1, 0.02),
]
GOOD = {"variance": 1.0, "df": 9, "replicates": 4}


def table(name):
    """Level, degrees of freedom and row of critical values, of the published table `name`."""
    return [(float(a), float(df), row) for a, rows in REFERENCE[name].items() for df, row in rows.items()]


def simulate(rng, replicates, control, df, n):
    """Williams' statistic of the top dose, `n` times, from its definition."""
    r = np.array(replicates, dtype=float)
    x = rng.standard_normal((n, r.size)) / np.sqrt(r)
    means = np.cumsum((x * r)[:, ::-1], axis=1) / np.cumsum(r[::-1])
    s = 1.0 if math.isinf(df) else np.sqrt(rng.chisquare(df, n) / df)
    zero = rng.standard_normal(n) / math.sqrt(control)
    return (means.max(axis=1) - zero) / (s * math.sqrt(1 / r[-1] + 1 / control))


class TestPublishedValues:
    @pytest.mark.parametrize(("alpha", "df", "row"), table("table_1971"))
    def test_1971(self, alpha, df, row):
        computed = [critical_value(k, df, alpha) for k in range(1, 11)]
        assert_allclose(computed, row, rtol=0, atol=0.0006 if math.isinf(df) else 0.0051)

    @pytest.mark.parametrize(("alpha", "df", "row"), table("table_1972"))
    def test_1972(self, alpha, df, row):
        for k, (published, _) in zip([2, 3, 4, 5, 6, 8, 10], row, strict=True):
            if [alpha, df, k, published] not in REFERENCE["misprints"]:
                assert_allclose(critical_value(k, df, alpha), published, rtol=0, atol=0.0006)

    @pytest.mark.parametrize(("alpha", "df", "row"), table("table_1972"))
    def test_extrapolation_to_larger_controls(self, alpha, df, row):
        # A formula of one coefficient: within 0.9 % of the computed values
        for k, (_, beta) in zip([2, 3, 4, 5, 6, 8, 10], row, strict=True):
            for w in (1.5, 3.0, 6.0):
                formula = critical_value(k, df, alpha) - 0.01 * beta * (1 - 1 / w)
                assert_allclose(critical_value(k, df, alpha, control=w), formula, rtol=0.009)

    def test_pmcmrplus(self):
        reference = REFERENCE["pmcmrplus"]
        for control in (1.25, 1.75):  # the ratio in that run is not printed
            computed = [
                critical_value(k, reference["df"], reference["alpha"], control=control) for k in range(1, 7)
            ]
            assert_allclose(computed, reference["critical_value"], rtol=0, atol=0.015)

    @pytest.mark.parametrize(("alpha", "points"), [(0.05, "critical_value_5"), (0.01, "critical_value_1")])
    def test_example_of_1971(self, alpha, points):
        case = REFERENCE["example_1971"]
        design = {key: case[key] for key in ("variance", "df", "replicates")}
        result = williams_test(case["control"], case["doses"], alpha=alpha, **design)
        assert_allclose(result.isotonic_mean, case["isotonic"], rtol=1e-14)
        for i, expected in case["statistic"].items():
            assert_allclose(result.statistic[int(i) - 1], expected, atol=0.005)
        for i, expected in case[points].items():  # the paper takes the row of 40 degrees of freedom
            assert_allclose(critical_value(int(i), 40, alpha), expected, rtol=0, atol=0.0051)
            assert_allclose(result.critical_value[int(i) - 1], expected, rtol=0, atol=0.0101)
        if alpha == 0.05:
            assert result.minimum_effective_dose == case["minimum_effective_dose"] - 1
            assert_array_equal(result.significant, [False, False, False, True, True, True])

    def test_example_of_1972(self):
        case = REFERENCE["example_1972"]
        keys = ("variance", "df", "replicates", "control_replicates", "alpha")
        design = {key: case[key] for key in keys}
        result = williams_test(case["control"], case["doses"], alternative="less", **design)
        assert_allclose(result.isotonic_mean, case["isotonic"], atol=0.051)
        assert_allclose(result.statistic, case["statistic"], atol=0.006)
        for i, expected in case["critical_value"].items():  # by extrapolation, from equal replicates
            assert_allclose(result.critical_value[int(i) - 1], expected, atol=0.011)
        assert result.minimum_effective_dose == case["minimum_effective_dose"] - 1


class TestCriticalValue:
    @pytest.mark.parametrize("df", [0.5, 1, 2.5, 7, 300, math.inf])
    @pytest.mark.parametrize("alpha", [0.3, 0.05, 1e-4])
    def test_one_dose_is_student(self, df, alpha):
        expected = norm.isf(alpha) if math.isinf(df) else t.isf(alpha, df)
        assert_allclose(critical_value(1, df, alpha, control=3), expected, rtol=1e-12)
        # The general route as well
        assert_allclose(williams._upper_tail(expected, (1.0,), 3.0, df), alpha, rtol=1e-9)

    @pytest.mark.parametrize(("replicates", "control", "df", "alpha"), DESIGNS)
    def test_simulation(self, replicates, control, df, alpha):
        n = 200_000
        point = critical_value(len(replicates), df, alpha, replicates=replicates, control=control)
        share = (simulate(np.random.default_rng(20), replicates, control, df, n) > point).mean()
        assert abs(share - alpha) < 4 * math.sqrt(alpha * (1 - alpha) / n)

    def test_two_doses_by_plain_integration(self):
        # P(M_2 <= x): the upper mean is at most x, and so is the mean of both
        node, weight = np.polynomial.legendre.leggauss(150)
        z = 9.0 * node
        x = z + 2.0 * math.sqrt(2.0)
        u = -10.0 + 0.5 * (x[:, None] + 10.0) * (node + 1.0)
        below = 0.5 * (x + 10.0) * ((norm.pdf(u) * norm.cdf(2.0 * x[:, None] - u)) @ weight)
        expected = 1.0 - 9.0 * np.sum(weight * norm.pdf(z) * below)
        assert_allclose(williams._upper_tail(2.0, (1.0, 1.0), 1.0, math.inf), expected, rtol=1e-10)

    @pytest.mark.parametrize(("replicates", "control", "df", "alpha"), DESIGNS)
    def test_only_ratios_of_replicates_matter(self, replicates, control, df, alpha):
        k = len(replicates)
        one = critical_value(k, df, alpha, replicates=replicates, control=control)
        two = critical_value(k, df, alpha, replicates=np.multiply(replicates, 7), control=7 * control)
        assert_allclose(two, one, rtol=1e-9)

    def test_grows_with_doses_and_falls_with_df(self):
        values = [[critical_value(k, df, 0.02) for df in (1, 3, 8, 50, 1e5, math.inf)] for k in range(1, 12)]
        assert (np.diff(values, axis=0) > 0).all()
        assert (np.diff(values, axis=1) < 0).all()
        assert_allclose([row[-2] for row in values], [row[-1] for row in values], rtol=1e-4)

    def test_a_dose_of_little_weight_changes_little(self):
        with_it = critical_value(3, 12, 0.05, replicates=[1e-3, 1, 1])
        assert_allclose(with_it, critical_value(2, 12, 0.05), rtol=1e-3)

    def test_walks_of_wide_range(self):
        # In parts, so that factors between walks stay finite; equal to one part where both work
        x = np.linspace(-2.0, 8.0, 33)
        parts = williams._stays_up(x, np.ones(30))
        single = np.concatenate([williams._stays_up(x[i : i + 1], np.ones(30)) for i in (0, 8, 16, 32)])
        assert_allclose(parts[[0, 8, 16, 32]], single, rtol=1e-9, atol=1e-15)


class TestIsotonicMeans:
    @settings(max_examples=60, deadline=None)
    @given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(0.1, 50.0)), min_size=1, max_size=12))
    def test_like_scipy_and_max_min(self, pairs):
        means, weights = np.array(pairs).T
        result = isotonic_means(means, weights)
        assert_allclose(result, isotonic_regression(means, weights=weights).x, rtol=1e-9, atol=1e-9)
        k = means.size
        average = [
            [np.average(means[u:v], weights=weights[u:v]) for v in range(u + 1, k + 1)] for u in range(k)
        ]
        by_hand = [max(min(average[u][i - u :]) for u in range(i + 1)) for i in range(k)]
        assert_allclose(result, by_hand, rtol=1e-9, atol=1e-9)


class TestProcedure:
    def test_shift_scale_and_direction(self):
        rng = np.random.default_rng(3)
        control, doses = rng.normal(size=6), [rng.normal(0.4 * i, 1.0, 3 + i) for i in range(5)]
        one = from_groups(control, doses)
        other = from_groups(70 - 20 * control, [70 - 20 * dose for dose in doses], alternative="less")
        assert one.minimum_effective_dose == other.minimum_effective_dose
        assert_allclose(other.statistic, one.statistic, rtol=1e-12)
        assert_allclose(other.isotonic_mean, 70 - 20 * one.isotonic_mean, rtol=1e-12)
        assert from_groups(control, doses, alternative="less").minimum_effective_dose is None

    def test_two_groups_are_the_t_test(self):
        from scipy.stats import ttest_ind

        rng = np.random.default_rng(4)
        a, b = rng.normal(size=5), rng.normal(0.5, 1.0, 9)
        result = from_groups(a, [b])
        assert_allclose(result.statistic, [ttest_ind(b, a).statistic], rtol=1e-12)
        assert result.df == 12.0

    def test_two_treatments_in_blocks_are_the_paired_t_test(self):
        from scipy.stats import ttest_rel

        values = np.random.default_rng(5).normal(size=(7, 2))
        result = from_blocks(values)
        assert_allclose(result.statistic, [ttest_rel(values[:, 1], values[:, 0]).statistic], rtol=1e-12)
        assert result.df == 6.0

    def test_blocks_cancel(self):
        rng = np.random.default_rng(6)
        values = rng.normal(size=(8, 5))
        shifted = from_blocks(values + 100 * rng.normal(size=(8, 1)))
        assert_allclose(shifted.statistic, from_blocks(values).statistic, rtol=1e-9)
        assert shifted.df == 28.0

    def test_stops_at_the_first_that_is_not_significant(self):
        # Many replicates of dose 1 and few of dose 2: dose 1 would pass alone
        design = {"variance": 1.0, "df": math.inf, "replicates": [100, 1], "control_replicates": 100}
        result = williams_test(0.0, [0.5, 0.6], **design)
        assert (result.statistic > result.critical_value).tolist() == [True, False]
        assert not result.significant.any()
        assert result.minimum_effective_dose is None

    def test_level_and_power(self):
        # Share of simulations with an effect found, without one and with growing ones
        shares, n = [], 1000
        for effect in (0.0, 0.5, 1.0, 2.0):
            rng = np.random.default_rng(7)
            values = rng.normal(size=(n, 6, 4)) + effect * np.array([0.0, 0.2, 0.6, 1.0])
            shares.append(np.mean([from_blocks(v).minimum_effective_dose is not None for v in values]))
        assert abs(shares[0] - 0.05) < 4 * math.sqrt(0.05 * 0.95 / n)
        assert shares == sorted(shares)
        assert shares[-1] > 0.9

    def test_no_false_dose_below_an_effective_one(self):
        # Strong control: doses 1 and 2 are idle, dose 3 is not
        rng, n = np.random.default_rng(8), 2000
        values = rng.normal(size=(n, 8, 4)) + np.array([0.0, 0.0, 0.0, 4.0])
        false = np.mean([from_blocks(v).significant[:2].any() for v in values])
        assert false < 0.05 + 4 * math.sqrt(0.05 * 0.95 / n)

    def test_effective_blocks_hold_the_level(self):
        # Autoregressive blocks, rho = 0.6: treatment means are as precise as those of 10.5 of 40 blocks
        rng, n, b, rho = np.random.default_rng(9), 800, 40, 0.6
        lag = np.abs(np.subtract.outer(np.arange(b), np.arange(b)))
        covariance = rho**lag
        effective = b**2 / covariance.sum()
        values = np.linalg.cholesky(covariance) @ rng.standard_normal((n, b, 4))
        found = [
            [from_blocks(v, effective_blocks=e).minimum_effective_dose is not None for v in values]
            for e in (None, effective)
        ]
        plain, corrected = np.mean(found, axis=1)
        assert plain > 0.1
        assert 0.03 < corrected < 0.07
        variance = np.mean([from_blocks(v, effective_blocks=effective).variance for v in values])
        assert_allclose(variance, 1.0, rtol=0.03)

    def test_effective_blocks_scale_replicates_and_df(self):
        values = np.random.default_rng(10).normal(size=(9, 4))
        whole, part, least = (from_blocks(values, effective_blocks=e) for e in (9, 3.0, 1.2))
        assert_array_equal(whole.statistic, from_blocks(values).statistic)
        assert (part.df, least.df) == (6.0, 1.0)
        assert_allclose(part.variance / whole.variance, (3 / 2) / (9 / 8), rtol=1e-12)
        assert_allclose(part.statistic / whole.statistic, math.sqrt(2 / 8), rtol=1e-12)


class TestErrors:
    @pytest.mark.parametrize(
        ("arguments", "text"),
        [
            ((0, 5, 0.05), r"'k' must be an integer >= 1, got 0\."),
            ((2.5, 5, 0.05), r"'k' must be an integer >= 1, got 2\.5\."),
            ((2, 0, 0.05), r"'df' must be > 0, got 0\. Use math\.inf for a known variance\."),
            ((2, math.nan, 0.05), r"'df' must be > 0, got nan\."),
            ((2, 5, 0.0), r"'alpha' must lie in \(0, 0\.5\), got 0\."),
            ((2, 5, 0.5), r"'alpha' must lie in \(0, 0\.5\), got 0\.5\."),
        ],
    )
    def test_critical_value(self, arguments, text):
        with pytest.raises(ValueError, match=text):
            critical_value(*arguments)

    @pytest.mark.parametrize(
        ("options", "text"),
        [
            ({"replicates": [3, -1]}, r"'replicates' must be > 0 and finite, got -1 at index 1\."),
            (
                {"replicates": [3, 1, 2]},
                r"'replicates' must be a number or one for each of the 2 doses, got .*\(3,\)",
            ),
            ({"replicates": [1, 4], "control": 4001}, r"must lie within a factor of 1000, got 1 to 4001\."),
            ({"control": 0}, r"'control' must be > 0 and finite, got 0\."),
        ],
    )
    def test_replicates(self, options, text):
        with pytest.raises(ValueError, match=text):
            critical_value(2, 5, 0.05, **options)

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            (
                {"dose_means": [[1.0]]},
                r"'dose_means' must be one-dimensional and not empty, got shape \(1, 1\)\.",
            ),
            ({"dose_means": []}, r"'dose_means' must be one-dimensional and not empty, got shape \(0,\)\."),
            ({"dose_means": [1.0, np.nan]}, r"'dose_means' must be finite, got nan at index 1\."),
            ({"variance": 0.0}, r"'variance' must be > 0 and finite, got 0\."),
            ({"df": -1}, r"'df' must be > 0, got -1\."),
            ({"alpha": 0.7}, r"'alpha' must lie in \(0, 0\.5\), got 0\.7\."),
            ({"control_replicates": -2}, r"'control_replicates' must be > 0 and finite, got -2\."),
            ({"alternative": "two-sided"}, r"'alternative' must be 'greater' or 'less', got 'two-sided'\."),
        ],
    )
    def test_williams_test(self, change, text):
        arguments = {"control_mean": 0.0, "dose_means": [1.0, 2.0], **GOOD, **change}
        with pytest.raises(ValueError, match=text):
            williams_test(**arguments)

    def test_groups(self):
        with pytest.raises(
            ValueError, match=r"'doses' must hold at least 1 dose and leave df >= 1, got .*\[2\]\."
        ):
            from_groups([1.0, 2.0], [])
        with pytest.raises(ValueError, match=r"leave df >= 1, got groups of \[1, 1\]\."):
            from_groups([1.0], [[2.0]])
        with pytest.raises(ValueError, match=r"'doses\[1\]' must be finite, got inf at index 0\."):
            from_groups([1.0, 2.0], [[2.0], [np.inf]])

    def test_blocks(self):
        with pytest.raises(ValueError, match=r"'table' must be \(block, treatment\).*got shape \(1, 3\)\."):
            from_blocks(np.zeros((1, 3)))
        for n in (1.0, 4.5, math.nan):
            with pytest.raises(ValueError, match=rf"'effective_blocks' must be > 1 and <= 4, .*got {n:g}\."):
                from_blocks(np.eye(4), effective_blocks=n)


def test_import_stays_light():
    code = "import sys, dsbrdf.paper.williams; print(sorted({'scipy.optimize', 'scipy.stats'} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"
