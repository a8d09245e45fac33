"""How noisy sensors are: as stated, from the quieter side, and as the errors of the fitted model tell."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from law_runs import fitted, runs_of, shared, true_values
from scipy import signal

import opid
from opid.suspensions.fitting.noise import known_noise, with_own_noise
from opid.suspensions.sensor_facts import IDEAL, SensorFacts, SensorPair, ideal_sensors
from opid.suspensions.settings import RunSettings
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

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
    below, above = known_noise(one_stated, [(loud, quiet)], fs=256.0, settings=RunSettings()).levels
    assert below[1] == 0.3
    np.testing.assert_allclose([below[0], *above], 0.01, rtol=0.3)
    # no model is better than a fraction of the motion, however quiet the sensor
    slow = np.sin(np.arange(5000) / 50)[:, np.newaxis] * np.ones(2)
    settings = RunSettings(least_noise_fraction=0.02)
    known = known_noise(TWO, [(loud, slow)], fs=256.0, settings=settings)
    floor, _ = known.levels
    np.testing.assert_allclose(floor, 0.02 * slow[:, 0].std(), rtol=1e-3)


def test_noise_is_no_larger_in_the_band_than_what_the_two_sides_do_not_share():
    """A lively structure is nowhere quiet, and yet one side follows the other."""
    rng = np.random.default_rng(1)
    loud = rng.standard_normal((20000, 1))
    with_noise = [side + 0.02 * rng.standard_normal(side.shape) for side in (loud, 0.7 * loud)]
    known = known_noise(ideal_sensors(1, 1), [tuple(with_noise)], fs=256.0, settings=RunSettings())
    # that of the other side is in it, too
    np.testing.assert_allclose(known.levels, np.hypot(0.02, 0.7 * 0.02), rtol=0.1)
    assert known.most == 1.0


def test_motion_that_the_two_sides_do_not_share_is_no_noise_of_a_filtered_log():
    """As of a frame that swings above its isolators."""
    rng = np.random.default_rng(2)
    low_pass = signal.butter(4, 20.0, fs=256.0, output="sos")
    sides = [signal.sosfilt(low_pass, rng.standard_normal((20000, 1)), axis=0) for _ in range(2)]
    known = known_noise(ideal_sensors(1, 1), [tuple(sides)], fs=256.0, settings=RunSettings())
    assert known.most > 1.0
    largest = known.most * known.levels[0]
    np.testing.assert_allclose(largest, 0.1 * min(side.std() for side in sides), rtol=1e-6)


@pytest.fixture(scope="module", params=range(2))
def of_filtered_logs(request):
    """Two runs whose logs end at 100 Hz, identified with the law searched."""
    test = taxi_test(LandingGear(), rng=np.random.default_rng(request.param))
    low_pass = signal.butter(4, 100.0, fs=512.0, output="sos")
    runs = []
    for name, run in (("heavy", test.heavy), ("light", test.light)):
        # the filter was running before the log began
        samples = [signal.sosfilt(low_pass, run.recording.channel(side))[256:] for side in ("lower_z", "upper_z")]
        change_kg = run.gear.sprung_mass_kg - test.heavy.gear.sprung_mass_kg
        runs.append(Run(name, opid.signals.recording_from_arrays(samples, ["lower_z", "upper_z"], fs=512.0), change_kg))
    return opid.identify(study_of_gear("filtered", sprung="upper_z", unsprung="lower_z", runs=runs))


def test_the_noise_of_a_filtered_log_is_what_the_model_leaves_in_the_band(of_filtered_logs):
    found = of_filtered_logs
    assert found.noise_m_per_s2 == pytest.approx(0.005, rel=0.1)
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.05)
    assert found.limited_by == "noise"
    assert found.law.name == "arctan_velocity"
    mass = found.parameters.sprung_mass_kg
    assert abs(mass.value - 1850.0) < 4 * mass.std < 0.05 * 1850.0
    assert any("low-pass" in warning for warning in found.warnings)


def test_what_a_wrong_law_leaves_of_a_filtered_log_is_no_noise(of_filtered_logs):
    wrong = opid.identify(of_filtered_logs.study, law="linear")
    assert wrong.noise_m_per_s2 < 0.005
    assert wrong.limited_by == "model"


STATED = "the stated noise of the sensors"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (0.0005, f"{STATED}, 0.5 mm/s^2, contradicts the runs: the residual of the model is white, with 5 mm"),
        (0.0025, f"{STATED}, 2.5 mm/s^2, contradicts the runs: the residual of the model is white, with 5 mm"),
        (0.0045, None),
        (0.0075, None),
        (0.05, f"{STATED}, 50 mm/s^2, contradicts the runs: the residual of the model is white, with 5 mm"),
    ],
)
def test_stated_noise_that_the_runs_contradict_is_named_and_bends_nothing(stated, said):
    result = with_stated_noise(stated)
    contradictions = [each for each in result.warnings if "contradicts the runs" in each]
    assert len(contradictions) == (said is not None)
    assert all(each.startswith(said) for each in contradictions)
    # beside it nothing is told of gears that roll or of forces that nobody measured
    assert len(result.warnings) == len(contradictions)
    assert result.limited_by == "noise"
    mass, right = result.parameters.sprung_mass_kg, with_stated_noise(0.005).parameters.sprung_mass_kg
    assert mass.value == pytest.approx(right.value, abs=0.2 * right.std)
    assert mass.std == pytest.approx(right.std, rel=0.1)
    assert mass.holds(1850.0)


@pytest.mark.parametrize("stated", [0.0005, 0.005, 0.05])
def test_a_force_that_nobody_measured_is_no_noise_of_the_sensors(stated):
    result = with_stated_noise(stated, pushed_fraction=0.05)
    assert not any("contradicts the runs" in each for each in result.warnings)
    assert result.parameters.sprung_mass_kg.holds(1850.0)


@cache
def with_stated_noise(stated, **world):
    """A gear whose sensors have 5 mm/s2 of noise, identified with what a study says of them."""
    sensor = Sensor(noise_m_per_s2=5e-3)
    settings = {"duration_s": 40.0, "fs": 256.0, "lower_sensor": sensor, "upper_sensor": sensor}
    test = taxi_test(LandingGear(), rng=np.random.default_rng(1), **settings, **world)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    facts = SensorPair(SensorFacts(noise_m_per_s2=stated), SensorFacts(noise_m_per_s2=stated))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, sensors=facts, repeatability=0.0)
    return opid.identify(study, law="arctan_velocity")
