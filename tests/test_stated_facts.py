"""What a study states of its sensors holds for every structure that is tried: a pair, a gear of an aircraft."""

import numpy as np
import pytest

from opid.errors import NotDeterminedError
from opid.signals.recording import recording_from_arrays
from opid.suspensions.identification import identify
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair
from opid.suspensions.study import MeasuredInterface, PointMass, Run, StructureSettings, Study, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

LAW, NOISE, MASS_KG = "arctan_velocity", 5e-3, LandingGear().sprung_mass_kg
COUPLED = SensorFacts(corner_hz=0.33, corner_tolerance=0.1)


def gears_study(left, right, *, kind, facts, noise=0.0):
    """Two gears left and right of the middle, each under a mass of its own, with white noise beside the sensors'."""
    rng, recordings = np.random.default_rng(1), []
    for name in ("heavy", "light"):
        columns = {}
        for side, test in (("left", left), ("right", right)):
            log = getattr(test, name).recording
            for channel in log.names:
                columns[f"{side}_{channel}"] = log.channel(channel) + noise * rng.standard_normal(log.n_samples)
        recordings.append(recording_from_arrays([*columns.values()], [*columns], fs=log.fs))
    loading = tuple(PointMass(left.mass_change_kg, 0.0, y_m) for y_m in (1.0, -1.0))
    interfaces = tuple(
        MeasuredInterface(side, f"{side}_upper_z", f"{side}_lower_z", 0.0, y_m, facts=each)
        for side, y_m, each in zip(("left", "right"), (1.0, -1.0), facts, strict=True)
    )
    runs = (Run("heavy", recordings[0]), Run("light", recordings[1], loading))
    return Study("two gears", interfaces, runs, StructureSettings(kind, noise_m_per_s2=NOISE), repeatability=0.0)


def gear_test(seed, sensor, **more):
    rng = np.random.default_rng(seed)
    return taxi_test(LandingGear(), rng=rng, duration_s=20, fs=256, lower_sensor=sensor, upper_sensor=sensor, **more)


@pytest.fixture(scope="module")
def coupled():
    """Both gears of a pair roll over one road, under sensors with one AC coupling."""
    return gear_test(0, Sensor(noise_m_per_s2=1e-4, corner_hz=0.33))


def test_a_stated_corner_of_a_pair_is_no_demand_of_the_runs(coupled):
    both = (SensorPair(COUPLED, COUPLED),) * 2
    result = identify(gears_study(coupled, coupled, kind="pair", facts=both, noise=NOISE), law=LAW)
    (evidence,) = result.evidence
    assert evidence.demands == ()
    assert result.residual_over_noise < 1.1
    assert not any("AC coupling" in warning for warning in result.warnings)
    for side in ("unsprung", "sprung"):
        assert abs(evidence.fit.value(f"corner_{side}_hz") - 0.33) < 0.01
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - 2 * MASS_KG) < 4 * mass.std


def test_a_pair_of_unlike_sensors_is_refused_with_the_reason(coupled):
    unlike = (SensorPair(COUPLED, COUPLED), SensorPair())
    with pytest.raises(NotDeterminedError, match=r"the unsprung sensors have different corners .*take each gear alone"):
        identify(gears_study(coupled, coupled, kind="pair", facts=unlike, noise=NOISE), law=LAW)


def test_a_stated_leak_into_one_gear_of_an_aircraft_is_taken_out():
    left, right = (gear_test(3 + k, Sensor(NOISE, cross_axis=0.03 * k), fore_aft=True) for k in (0, 1))
    leaks = (Leak("right_lower_x", "unsprung"), Leak("right_upper_x", "sprung"))
    result = identify(gears_study(left, right, kind="single", facts=(SensorPair(), SensorPair(leaks=leaks))), law=LAW)
    assert [each.residual_over_noise < 1.1 for each in result.candidates] == [True, True]
    assert result.evidence[0].fit.model.faults == ()
    fit = result.evidence[1].fit
    assert [fault.side for fault in fit.model.faults] == ["unsprung", "sprung"]
    np.testing.assert_allclose([fit.value(fault.name) for fault in fit.model.faults], 0.03, atol=0.001)
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - 2 * MASS_KG) < 4 * mass.std


@pytest.mark.parametrize(("true_hz", "stated"), [(0.6, True), (0.5, False)])
def test_a_corner_far_from_what_the_study_says_is_found_and_named(true_hz, stated):
    """Of both sensors where one is stated without a tolerance, of the upper one alone where none is."""
    lower, upper = Sensor(noise_m_per_s2=NOISE), Sensor(noise_m_per_s2=NOISE, corner_hz=true_hz)
    rng = np.random.default_rng(1)
    test = taxi_test(
        LandingGear(), rng=rng, duration_s=30, fs=256, lower_sensor=upper if stated else lower, upper_sensor=upper
    )
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    facts = SensorPair(*(2 * [SensorFacts(corner_hz=0.33)])) if stated else SensorPair()
    result = identify(
        study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, sensors=facts, repeatability=0.0),
        law=LAW,
    )
    assert result.residual_over_noise < 1.1
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - MASS_KG) < 3.5 * mass.std
    assert abs(result.evidence[0].fit.value("corner_sprung_hz") - true_hz) < 0.005
    said = "with another corner than the study states" if stated else "of the sensors that the study does not state"
    assert any(f"AC coupling {said}" in warning for warning in result.warnings)
