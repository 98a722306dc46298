"""The fit: known models come back, more lobes are never worse, samples, priors, threads, arguments."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fits import SMALL, built_in, known, pairs, white_plastic

import dsbrdf
from dsbrdf import ConvergenceWarning, Samples, fit, half_diff, tabulate
from dsbrdf.fitting import FitOptions
from dsbrdf.fitting.estimator import unknowns_of
from dsbrdf.space import Gaussian

HELPERS = Path(__file__).parents[1] / "helpers"
STANDARD = (6, 4, 3, 1, 2)


def off(model, truth, rng, within=80.0):
    """Largest relative difference over directions within so many degrees."""
    wi, wo = pairs(rng, 2000, within)
    return float(np.abs(np.asarray(model.eval(wi, wo)) / truth(wi, wo) - 1.0).max())


def log_error(model, truth, rng):
    wi, wo = pairs(rng, 10_000)
    return float(np.sqrt(np.mean(np.log((model.eval(wi, wo) + 1e-6) / (truth(wi, wo) + 1e-6)) ** 2)))


# Known models come back


def test_recovery_from_samples(rng):
    model = known()
    wi, wo = pairs(rng, 3000)
    found = fit(Samples(wi, wo, model.eval(wi, wo)), 2, max_iterations=400)
    assert off(found.model, model.eval, rng) < 1e-9
    for part, expected in zip(found.model.lobes.parts, model.lobes.parts, strict=True):
        np.testing.assert_allclose(part, expected, atol=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_recovery_from_any_samples(seed):
    """The search may end a little before the minimum."""
    model = known()
    rng = np.random.default_rng(seed)
    wi, wo = pairs(rng, 2000)
    found = fit(Samples(wi, wo, model.eval(wi, wo)), 2, max_iterations=400)
    np.testing.assert_allclose(found.model.eval(wi, wo), model.eval(wi, wo), rtol=1e-3)
    assert found.errors.rel < 1e-4


def test_recovery_from_a_table(rng):
    model = known(beta=False)
    found = fit(tabulate(model.eval, "known", shape=SMALL), 2, max_iterations=400)
    assert off(found.model, model.eval, rng) < 1e-9
    assert found.errors.rel < 1e-9


def test_recovery_from_a_table_with_azimuth(rng):
    """Three azimuths stand for all of a cell, which is exact only for what is linear in cos(2 phi_d)."""
    model = known()
    found = fit(tabulate(model.eval, "known", shape=SMALL), 2)
    assert 1e-7 < off(found.model, model.eval, rng) < 1e-3


def test_recovery_of_one_channel_and_many(rng):
    model = known(beta=False)
    for channels in ([1], [0, 1, 2, 0, 1, 2, 1]):
        truth = model.replace(lobes=model.lobes.replace(colour=model.lobes.colour[channels]), channels=())
        found = fit(tabulate(truth.eval, "known", shape=SMALL), 2, max_iterations=400)
        assert found.model.n_channels == len(channels)
        assert off(found.model, truth.eval, rng) < 1e-6


@pytest.mark.parametrize("loss", ["log", "gamma", "l2"])
def test_every_loss_finds_it(loss, rng):
    model = known(beta=False)
    wi, wo = pairs(rng, 2000)
    found = fit(Samples(wi, wo, model.eval(wi, wo)), 2, loss=loss, max_iterations=400)
    assert found.errors.rel < 1e-3


# More lobes


@pytest.mark.parametrize("name", ["rough-gold", "glossy-plastic"])
def test_the_objective_never_rises_with_one_lobe_more(name):
    measured = built_in(name)
    objectives = [fit(measured, n_lobes).objective for n_lobes in range(1, 6)]
    assert (np.diff(objectives) <= 0.0).all()


def test_the_number_of_lobes_is_that_of_least_criterion():
    found = fit(built_in("rough-gold"))
    criteria = found.estimate.criteria
    assert len(criteria) == 6
    assert found.model.n_lobes == criteria.argmin() + 1
    assert fit(built_in("rough-gold"), 2).estimate.criteria.size == 0


def test_no_more_lobes_than_the_data_call_for(rng):
    wi, wo = pairs(rng, 500)
    grey = np.full((500, 1), 0.2) * np.exp(0.02 * rng.normal(size=(500, 1)))
    assert fit(Samples(wi, wo, grey)).model.n_lobes == 1


def test_compact_curves_are_few_numbers():
    found = fit(built_in("rough-gold"), 6, curves="compact")
    assert found.model.n_parameters <= 66
    assert found.errors.log < 0.15


# Scattered samples


@pytest.mark.parametrize(("n", "bar"), [(200, 0.12), (2000, 0.06)])
def test_few_samples_of_a_plastic(n, bar):
    rng = np.random.default_rng(n)
    wi, wo = pairs(rng, n)
    found = fit(Samples(wi, wo, white_plastic(wi, wo)))
    assert log_error(found.model, white_plastic, rng) < bar


def in_plane(theta):
    theta = np.deg2rad(theta)
    return np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)


def same_at_all_angles(wi, wo):
    theta_h, _, _ = half_diff.from_directions(wi, wo)
    return (0.05 + 1.5 * np.exp(-((np.rad2deg(theta_h) / 12.0) ** 2)))[..., None]


@pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")
@pytest.mark.parametrize(
    ("theta_o", "theta_i", "sentence"),
    [
        (0.0, np.arange(0.0, 90.0), "theta_d only 0 to 44 degrees; theta_h only 0 to 44 degrees; 20% of"),
        (45.0, np.arange(-80.0, 81.0), "theta_d only 0 to 63 degrees; "),
    ],
)
def test_one_scan_in_a_plane(theta_o, theta_i, sentence, rng):
    """What is off the scan is held by the curves, and said."""
    wi = in_plane(theta_i)
    wo = np.broadcast_to(in_plane(np.array(theta_o)), wi.shape)
    values = same_at_all_angles(wi, wo)
    found = fit(Samples(wi, wo, values))
    assert found.errors.log < 0.25
    everywhere = found.model.eval(*pairs(rng, 20_000))
    assert np.isfinite(everywhere).all()
    assert everywhere.max() < 10.0 * values.max()
    assert np.isfinite(found.model.eval(*pairs(rng, 5000, 90.0))).all()
    said = found.coverage.sentence
    assert said.startswith(f"measured: {sentence}")
    assert said.endswith(". Elsewhere the model follows its curves, not data")


def test_coverage_of_a_whole_table_and_of_parts(rng):
    whole = fit(built_in("rough-gold"), 1).coverage
    assert whole.azimuth
    assert whole.empty_channels == ()
    assert "only" not in whole.sentence
    wi, wo = pairs(rng, 200)
    values = 0.2 * np.exp(0.02 * rng.normal(size=(200, 3)))
    values[:, 1] = np.nan
    found = fit(Samples(wi, wo, values), 1)
    assert found.coverage.empty_channels == (1,)
    assert "no value in channel 1" in found.coverage.sentence
    at_mirror = wi * [-1.0, -1.0, 1.0]
    assert "no variation with the azimuth" in fit(Samples(wi, at_mirror, values), 1).coverage.sentence


# Priors


def gaussian(lobes, deviation):
    mean = unknowns_of(lobes)
    precision = np.eye(len(mean)) / deviation**2
    return Gaussian(STANDARD, lobes.n_lobes, mean, precision, ("r", "g", "b"))


def test_a_prior_says_what_few_samples_do_not(rng):
    model = known()
    prior = gaussian(model.lobes, 0.3)
    moved = model.replace(lobes=model.lobes.replace(scale=model.lobes.scale + 0.2))
    wi, wo = pairs(rng, 8)
    samples = Samples(wi, wo, moved.eval(wi, wo) * np.exp(0.02 * rng.normal(size=(8, 3))))
    found = fit(samples, prior=prior)
    assert found.model.n_lobes == 2
    assert found.model.fit_options["prior"] is True
    assert found.estimate.criteria.size == 0
    with_prior = log_error(found.model, moved.eval, rng)
    assert with_prior < 0.15
    assert with_prior < 0.5 * log_error(fit(samples).model, moved.eval, rng)


@pytest.mark.filterwarnings("ignore::dsbrdf.fitting.PriorWarning")
def test_a_strong_prior_stays_where_it_is(rng):
    model = known()
    wi, wo = pairs(rng, 50)
    # Among them the brightest, which bounds how high a lobe may be
    wo[:25] = wi[:25] * [-1.0, -1.0, 1.0]
    found = fit(Samples(wi, wo, 2.0 * model.eval(wi, wo)), prior=gaussian(model.lobes, 1e-7))
    assert off(found.model, model.eval, rng) < 1e-3


def test_a_prior_of_other_channels_is_refused(rng):
    wi, wo = pairs(rng, 20)
    with pytest.raises(
        ValueError, match=r"measurement of 1 channels does not go with this prior of 40 unknowns"
    ):
        fit(Samples(wi, wo, np.ones((20, 1))), prior=gaussian(known().lobes, 1.0))


# The same every time


def test_same_bits_whatever_the_number_of_threads():
    code = (
        "from fits import built_in, known, pairs\n"
        "import dsbrdf, numpy as np, hashlib\n"
        "wi, wo = pairs(np.random.default_rng(1), 4000)\n"
        "for measured in (built_in('rough-gold'), dsbrdf.Samples(wi, wo, known().eval(wi, wo))):\n"
        "    found = dsbrdf.fit(measured, 3)\n"
        "    print(hashlib.sha256(b''.join(p.tobytes() for p in found.model.lobes.parts)).hexdigest())\n"
        "    print(found.objective.hex())\n"
    )
    said = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code],
            env=os.environ | {"RAYON_NUM_THREADS": n, "PYTHONPATH": str(HELPERS)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for n in ("1", "4")
    ]
    assert len(said[0].split()) == 4
    assert said[0] == said[1]


def test_a_fit_travels_between_processes(rng):
    found = fit(built_in("rough-gold"), 2)
    back = pickle.loads(pickle.dumps(found))
    wi, wo = pairs(rng, 50)
    np.testing.assert_array_equal(back.model.eval(wi, wo), found.model.eval(wi, wo))
    np.testing.assert_array_equal(back.std(wi, wo), found.std(wi, wo))


# What comes with it


def test_what_a_model_carries(rng):
    measured = built_in("rough-gold")
    found = fit(measured, 2, loss="gamma")
    assert found.model.name == "rough-gold"
    assert found.model.fit_options["loss"] == "gamma"
    assert found.model.fit_options["n_lobes"] == 2
    assert found.model.errors["rel"] == found.errors.rel
    assert found.model.profile is not None
    assert found.summary()["n_parameters"] == found.model.n_parameters == 2 * (14 + 4)
    gammas = found.model.lobes.gamma.mean(1)
    assert (np.diff(gammas) >= 0.0).all()
    np.testing.assert_allclose(found.model.lobes.colour.mean(0), 0.0, atol=1e-12)
    wi, wo = pairs(rng, 20)
    samples = Samples(wi, wo, np.ones((20, 2)), channels=("left", "right"), name="s")
    assert fit(samples, 1).model.channels == ("left", "right")
    assert fit(samples, 1).model.profile is None
    assert "Fit(DSBRDF('rough-gold', 2 lobes" in repr(found)


def test_running_out_of_iterations_is_said():
    text = (
        r"the search ended after 1 iterations and may not be at a minimum\. Allow more with 'max_iterations'"
    )
    with pytest.warns(ConvergenceWarning, match=text):
        found = fit(built_in("rough-gold"), 3, max_iterations=1)
    assert not found.converged


# Arguments


@pytest.mark.parametrize("measured", ["gold.binary", np.ones((3, 3)), None])
def test_what_is_no_measurement_is_refused(measured):
    kind = type(measured).__name__
    with pytest.raises(
        TypeError, match=rf"^'measured' must be a MeasuredBRDF or Samples, got {kind}\. dsbrdf\.read"
    ):
        fit(measured)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"n_lobes": 0}, r"'n_lobes' must be 1 to 10 or 'auto', got 0\."),
        ({"n_lobes": 11}, r"'n_lobes' must be 1 to 10 or 'auto', got 11\."),
        ({"n_lobes": True}, r"'n_lobes' must be 1 to 10 or 'auto', got True\."),
        ({"n_lobes": "many"}, r"'n_lobes' must be 1 to 10 or 'auto', got 'many'\."),
        ({"loss": "l1"}, r"'loss' must be one of 'log', 'gamma', 'l2', got 'l1'\."),
        ({"curves": "long"}, r"'curves' must be one of 'standard', 'compact', got 'long'\."),
        ({"max_iterations": 0}, r"'max_iterations' must be at least 1, got 0\."),
    ],
)
def test_options_out_of_range_are_refused(options, text):
    with pytest.raises(ValueError, match=text):
        FitOptions(**options)
    with pytest.raises(ValueError, match=text):
        dsbrdf.fit(built_in("matte"), **options)
