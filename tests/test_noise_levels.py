"""Which sensor is the noisier one: read from the errors of the fitted model."""

import numpy as np
import pytest

from opid.mechanics.landing_gear import DEFAULT_LAW, LandingGear, taxi_test
from opid.mechanics.sensors import Sensor
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.one_gear.model_fit import fit_model
from opid.suspensions.one_gear.noise_levels import with_own_noise
from opid.suspensions.sensor_facts import IDEAL_PAIR, SensorFacts, SensorPair

MASS_KG = 1850.0
TRUTH = np.array([3.9e5, 6e3, 400.0, 0.02 * MASS_KG, 1.0]) / MASS_KG


def fitted(lower, upper, seed=0):
    """A fit that takes both sensors for equally noisy."""
    sensors = {"lower_sensor": Sensor(noise_m_per_s2=lower), "upper_sensor": Sensor(noise_m_per_s2=upper)}
    test = taxi_test(LandingGear(), rng=np.random.default_rng(seed), duration_s=20.0, fs=256.0, **sensors)
    runs = [
        driven_run(run.recording.channel("lower_z"), run.recording.channel("upper_z"), fs=256.0, mass_change_kg=change)
        for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg))
    ]
    law = DEFAULT_LAW.scaled(1 / MASS_KG)
    return runs, fit_model(runs, law, stiffness_per_mass=210.0, damping_per_mass=3.2, inverse_mass=1 / MASS_KG)


def levels(fit):
    return np.array(fit.noise) * np.sqrt(fit.variance)


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_spindle_is_found(seed):
    runs, before = fitted(0.02, 0.005, seed)
    after = with_own_noise(runs, before, IDEAL_PAIR)
    np.testing.assert_allclose(levels(after), [0.02, 0.005], rtol=0.1)
    np.testing.assert_array_less(np.abs(after.value - TRUTH), 4 * after.std)
    assert after.log_likelihood > before.log_likelihood
    # right weights: damping and law are better known, and what was too optimistic of the rest is mended
    assert np.all(after.std[1:4] < 0.9 * before.std[1:4])


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_airframe_is_found_and_every_interval_shrinks(seed):
    """Its own noise hides the quiet spindle's, so that one is known but roughly."""
    runs, before = fitted(0.005, 0.02, seed)
    after = with_own_noise(runs, before, IDEAL_PAIR)
    spindle, airframe = levels(after)
    assert airframe == pytest.approx(0.02, rel=0.05)
    assert 0.002 < spindle < 0.01
    np.testing.assert_array_less(np.abs(after.value - TRUTH), 4 * after.std)
    assert np.all(after.std < before.std)
    mass = before.names.index("inverse_mass")
    assert after.std[mass] < 0.75 * before.std[mass]


@pytest.mark.parametrize("seed", range(3))
def test_equal_levels_are_kept(seed):
    runs, fit = fitted(0.005, 0.005, seed)
    assert with_own_noise(runs, fit, IDEAL_PAIR) is fit


def test_stated_levels_are_left_alone():
    runs, fit = fitted(0.02, 0.005)
    stated = SensorPair(SensorFacts(noise_m_per_s2=0.005), SensorFacts(noise_m_per_s2=0.005))
    assert with_own_noise(runs, fit, stated) is fit
