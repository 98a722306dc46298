"""The Mitsuba plugin over a few random models; `tests/fuzz/renders.py` does two hundred."""

import pytest
import renders


def test_furnace_and_sampler():
    failures, _, brightest, _ = renders.check(range(1000, 1002))
    assert not failures
    assert brightest <= 1.003


def test_the_furnace_sees_what_is_wrong(monkeypatch):
    """A sampler whose density is a hundredth off is found."""
    real = renders.tools.draw

    def off(*arguments):
        wo, density, weight = real(*arguments)
        return wo, density, 1.01 * weight

    monkeypatch.setattr(renders.tools, "draw", off)
    failures, worst, _, _ = renders.check(range(1000, 1001))
    assert any("furnace off" in failure for failure in failures)
    assert worst > 5.0


@pytest.mark.parametrize("seed", [0, 5])
def test_random_models_conserve_energy(seed):
    model = renders.random_model(seed)
    assert model.albedo(renders.ANGLES).max() <= 1.001
