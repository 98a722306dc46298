"""Standard errors and bands against repeated measurements."""

import numpy as np
import pytest
from models import known_model, upper

from dsbrdf import Samples, fit, tabulate

REPETITIONS = 10


@pytest.fixture(scope="module")
def pairs():
    """Directions within 80 degrees of the normal."""
    rng = np.random.default_rng(8)
    wi, wo = upper(rng, 1000), upper(rng, 1000)
    inside = np.minimum(wi, wo)[:, 2] > np.cos(np.deg2rad(80.0))
    return wi[inside], wo[inside]


def noisy(kind, seed):
    """`known_model` measured with 2 % of noise."""
    rng = np.random.default_rng(seed)
    model = known_model()

    def measured(wi, wo):
        value = model.eval(wi, wo)
        return value * np.exp(0.02 * rng.normal(size=value.shape))

    if kind == "table":
        return tabulate(measured, "noisy", shape=(30, 24, 24))
    wi, wo = upper(rng, 1500), upper(rng, 1500)
    return Samples(wi, wo, measured(wi, wo))


@pytest.mark.parametrize("kind", ["table", "samples"])
def test_bands_hold_values_as_often_as_they_say(kind, pairs):
    """Of 95 %, 88 to 99 % over ten measurements and some 670 pairs of directions, whose errors go together."""
    truth = known_model().eval(*pairs)
    held = []
    for seed in range(REPETITIONS):
        lower, upper_bound = fit(noisy(kind, seed), 2).band(*pairs)
        held.append(((lower <= truth) & (truth <= upper_bound)).mean())
    assert 0.88 < np.mean(held) < 0.99


def test_deviations_are_those_of_repeated_fits(pairs):
    fits = [fit(noisy("table", seed), 2) for seed in range(REPETITIONS)]
    logs = np.log([found.model.eval(*pairs) for found in fits])
    expected = np.median(fits[0].posterior.deviation(*pairs))
    assert np.median(logs.std(0, ddof=1)) == pytest.approx(expected, rel=0.5)
    np.testing.assert_allclose(
        fits[0].std(*pairs), fits[0].model.eval(*pairs) * fits[0].posterior.deviation(*pairs)
    )


def test_wider_bands_hold_more(pairs):
    found = fit(noisy("table", 0), 2)
    value = found.model.eval(*pairs)
    bounds = [found.band(*pairs, level) for level in (0.5, 0.95)]
    for lower, upper_bound in bounds:
        assert (lower < value).all()
        assert (value < upper_bound).all()
        np.testing.assert_allclose(lower * upper_bound, value**2)
    assert (bounds[1][0] < bounds[0][0]).all()


def test_standard_errors_of_curves():
    found = fit(noisy("table", 0), 2)
    errors = found.standard_errors()
    np.testing.assert_allclose(np.rad2deg(errors.theta_d), [0, 15, 30, 45, 60, 75])
    assert errors.ln_kappa.shape == (6, 3, 2)
    for part in (errors.ln_gamma, errors.beta, errors.falloff):
        assert part.shape == (6, 2)
        assert (part > 0.0).all()
    # Gamma of the highlight is known to a few percent
    assert errors.ln_gamma[:3, 1].max() < 0.05
    assert 10.0 < found.posterior.n_decided < 60.0
    with pytest.raises(ValueError, match=r"'theta_d' must lie in \[0, pi/2\] radians, got 20"):
        found.standard_errors([20.0])


def test_more_samples_are_more_certain(pairs):
    deviations = []
    for n in (300, 3000):
        rng = np.random.default_rng(1)
        wi, wo = upper(rng, n), upper(rng, n)
        values = known_model().eval(wi, wo) * np.exp(0.02 * rng.normal(size=(n, 3)))
        deviations.append(np.median(fit(Samples(wi, wo, values), 2).posterior.deviation(*pairs)))
    assert deviations[1] < 0.7 * deviations[0]
