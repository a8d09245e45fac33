"""How noisy sensors are: as stated, from the quieter side, and as the errors of the fitted model tell."""

from dataclasses import replace

import numpy as np
import pytest
from law_runs import fitted, runs_of, shared, true_values

from opid.mechanics.landing_gear import DEFAULT_LAW
from opid.mechanics.sensors import Sensor
from opid.suspensions.noise import known_noise, with_own_noise
from opid.suspensions.sensor_facts import IDEAL, SensorFacts, SensorPair, ideal_sensors
from opid.suspensions.settings import RunSettings

TWO = ideal_sensors(2, 2)


def fit_of(lower, upper, seed=0, sensors=None):
    """A fit that takes both sensors for equally noisy."""
    faults = {"lower_sensor": Sensor(noise_m_per_s2=lower), "upper_sensor": Sensor(noise_m_per_s2=upper)}
    return fitted(runs_of(DEFAULT_LAW, seed, **faults), DEFAULT_LAW, sensors=sensors)


def levels(fit):
    return np.concatenate(fit.model.noise) * fit.ratio


def holds_the_truth(fit):
    return np.all(np.abs(shared(fit) - true_values(fit, DEFAULT_LAW)) < 4 * fit.std)


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_spindle_is_found(seed):
    before = fit_of(0.02, 0.005, seed)
    after = with_own_noise(before)
    np.testing.assert_allclose(levels(after), [0.02, 0.005], rtol=0.1)
    assert holds_the_truth(after)
    assert after.bic < before.bic
    # right weights: damping and law are better known, and what was too optimistic of the rest is mended
    assert np.all(after.std[1:4] < 0.9 * before.std[1:4])


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_airframe_is_found_and_every_interval_shrinks(seed):
    """Its own noise hides the quiet spindle's, so that one is known but roughly."""
    before = fit_of(0.005, 0.02, seed)
    after = with_own_noise(before)
    spindle, airframe = levels(after)
    assert airframe == pytest.approx(0.02, rel=0.05)
    assert 0.002 < spindle < 0.01
    assert holds_the_truth(after)
    assert np.all(after.std < before.std)
    mass = before.model.names.index("inverse_mass")
    assert after.std[mass] < 0.75 * before.std[mass]


@pytest.mark.parametrize("seed", range(3))
def test_equal_levels_are_kept(seed):
    fit = fit_of(0.005, 0.005, seed)
    assert with_own_noise(fit) is fit


def test_stated_levels_are_left_alone():
    stated = SensorFacts(noise_m_per_s2=0.005)
    fit = fit_of(0.02, 0.005, sensors=SensorPair(stated, stated))
    assert with_own_noise(fit) is fit


def test_noise_is_as_stated_and_else_that_of_the_quieter_side():
    rng = np.random.default_rng(0)
    quiet, loud = 0.01 * rng.standard_normal((5000, 2)), rng.standard_normal((5000, 2))
    one_stated = replace(TWO, unsprung=(IDEAL, SensorFacts(noise_m_per_s2=0.3)))
    below, above = known_noise(one_stated, [(loud, quiet)], fs=256.0, settings=RunSettings())
    assert below[1] == 0.3
    np.testing.assert_allclose([below[0], *above], 0.01, rtol=0.3)
    # no model is better than a fraction of the motion, however quiet the sensor
    slow = np.sin(np.arange(5000) / 50)[:, np.newaxis] * np.ones(2)
    settings = RunSettings(least_noise_fraction=0.02)
    floor, _ = known_noise(TWO, [(loud, slow)], fs=256.0, settings=settings)
    np.testing.assert_allclose(floor, 0.02 * slow[:, 0].std(), rtol=1e-3)
