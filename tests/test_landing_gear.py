import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR, default_law
from opid.mechanics.structure import natural_frequencies
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

FAULTY = Sensor(noise_m_per_s2=0.02, gain=1.01, corner_hz=0.33, cross_axis=0.03, bits=16, range_m_per_s2=500.0)


def run(gear=None, *, seed=1, duration_s=5.0, **settings):
    return taxi_run(gear or LandingGear(), rng=np.random.default_rng(seed), duration_s=duration_s, **settings)


def test_bounce_and_hop_are_where_they_should_be():
    modes = natural_frequencies(airframe_structure(LandingGear().airframe))
    np.testing.assert_allclose(modes.frequency_hz, [1.8, 15.7], atol=0.05)
    assert 0.05 < modes.zeta[0] < 0.15


@pytest.mark.parametrize("seed", [1, 2])
def test_the_levels_are_those_of_a_taxiing_aircraft(seed):
    levels = run(seed=seed, duration_s=40.0).truth.rms
    assert 1.5 < levels["lower_z"] < 4.0
    assert 0.6 < levels["upper_z"] < 0.9
    assert 2e-3 < levels["travel"] < 4e-3


@pytest.mark.parametrize("law_name", ["linear", "arctan_velocity", "quadratic_damping+cubic_stiffness"])
def test_the_truth_obeys_the_equation_of_the_sprung_mass(law_name):
    # M2 x2'' + C2 z' + K2 z + f = 0 where no spring goes to the ground
    gear = LandingGear(law=default_law(law_name))
    truth = run(gear).truth
    z, rate = truth.channel("travel"), truth.channel("travel_velocity")
    strut = gear.suspension_stiffness_n_per_m * z + gear.suspension_damping_n_s_per_m * rate
    balance = gear.sprung_mass_kg * truth.channel("upper_z") + strut + gear.law.force(z, rate)
    assert np.std(balance) < 1e-3 * np.std(strut)


def test_the_ground_spring_carries_its_share():
    # M2 x2'' + C2 z' + K2 z + f = -K3 x2, and x2 twice derived is the acceleration
    gear = LandingGear(ground_stiffness_n_per_m=1.67e5, law=LINEAR)
    truth = run(gear, fs=2048.0).truth
    strut = 3.9e5 * truth.channel("travel") + 6e3 * truth.channel("travel_velocity")
    height = -(1850.0 * truth.channel("upper_z") + strut) / 1.67e5
    twice_derived = np.diff(height, 2) * truth.fs**2
    slow = np.ones(32) / 32.0
    expected = np.convolve(truth.channel("upper_z")[1:-1], slow, "valid")
    found = np.convolve(twice_derived, slow, "valid")
    np.testing.assert_allclose(found, expected, atol=0.05 * np.std(expected))


def test_the_travel_is_the_twice_integrated_relative_acceleration():
    truth = run(fs=2048.0).truth
    relative = truth.channel("upper_z") - truth.channel("lower_z")
    rate = truth.channel("travel_velocity")
    numeric = (rate[2:] - rate[:-2]) * truth.fs / 2.0
    np.testing.assert_allclose(numeric, relative[1:-1], atol=0.02 * np.std(relative))


def test_the_motion_of_a_linear_gear_scales_with_the_road():
    linear = LandingGear(law=LINEAR)
    smooth, rough = (run(linear, road_class=road_class).truth.samples for road_class in ("A", "C"))
    np.testing.assert_allclose(rough, 4.0 * smooth, rtol=1e-6, atol=1e-9)
    # friction holds the strut of the real gear on a smooth road
    smooth, rough = (run(road_class=road_class).truth.rms["travel"] for road_class in ("A", "C"))
    assert rough > 4.3 * smooth


def test_the_record_begins_in_full_motion():
    truth = run(duration_s=8.0, speed_m_per_s=(6.0, 6.0)).truth
    first = truth.section(0.0, 2.0).samples
    assert (np.std(first, axis=0) > 0.4 * np.std(truth.samples, axis=0)).all()


def test_a_stopped_aircraft_is_quiet():
    truth = run(speed_m_per_s=(15.0, 0.0), duration_s=10.0).truth
    assert np.std(truth.section(9.8).channel("lower_z")) < 0.2 * np.std(truth.channel("lower_z"))


def test_the_seed_makes_the_run():
    np.testing.assert_array_equal(run().recording.samples, run().recording.samples)
    assert not np.allclose(run().recording.samples, run(seed=2).recording.samples)


def test_another_sensor_changes_neither_the_road_nor_the_other_channel():
    plain = run()
    other = run(upper_sensor=FAULTY, fore_aft=True)
    np.testing.assert_array_equal(other.truth.samples, plain.truth.samples)
    np.testing.assert_array_equal(other.recording.channel("lower_z"), plain.recording.channel("lower_z"))
    assert not np.allclose(other.recording.channel("upper_z"), plain.recording.channel("upper_z"))


def test_the_recording_is_the_truth_with_noise():
    plain = run()
    for name in ("lower_z", "upper_z"):
        noise = plain.recording.channel(name) - plain.truth.channel(name)
        assert np.std(noise) == pytest.approx(0.005, rel=0.06)
        assert plain.recording.unit(name) == "m/s^2"
    assert plain.recording.n_samples == plain.truth.n_samples == 2560
    assert plain.truth.unit("travel") == "m"


def test_fore_aft_motion_leaks_in_and_can_be_recorded():
    leaking = Sensor(noise_m_per_s2=0.0, cross_axis=0.03)
    leaked = run(upper_sensor=leaking, fore_aft=True)
    assert leaked.recording.names == ("lower_z", "upper_z", "lower_x", "upper_x")
    clean = leaked.truth.channel("upper_z")
    # the fore-aft sensor leaks too, x + 0.03 z, and the vertical one reads z + 0.03 x
    across = leaked.recording.channel("upper_x") - 0.03 * clean
    np.testing.assert_allclose(leaked.recording.channel("upper_z"), clean + 0.03 * across, atol=1e-12)
    assert np.std(across) == pytest.approx(np.std(clean), rel=0.3)
    assert abs(np.corrcoef(across, clean)[0, 1]) < 0.25


@pytest.mark.parametrize("fs", [256.0, 500.0, 1000.0, 4096.0])
def test_the_rate_of_the_record_does_not_change_the_motion(fs):
    # draws of the road do not depend on fs, and 8 s of lead-in are whole samples at each of these rates
    slow, fast = run(fs=fs, duration_s=2.0).truth, run(fs=2048.0, duration_s=2.0).truth
    common_s = np.arange(0.0, 2.0, 0.25)
    for name in ("travel", "travel_velocity"):
        one = np.interp(common_s, slow.time_s, slow.channel(name))
        other = np.interp(common_s, fast.time_s, fast.channel(name))
        np.testing.assert_allclose(one, other, atol=1e-4 * np.std(fast.channel(name)))


def test_a_taxi_test_has_two_masses_and_two_roads():
    test = taxi_test(LandingGear(), rng=np.random.default_rng(1), mass_removed_kg=300.0, duration_s=2.0, fs=256.0)
    assert test.mass_change_kg == -300.0
    assert test.heavy.gear.sprung_mass_kg == 1850.0
    assert test.light.gear.sprung_mass_kg == 1550.0
    assert test.heavy.recording.fs == test.light.recording.fs == 256.0
    roads = [taxi.truth.channel("lower_z") for taxi in (test.heavy, test.light)]
    assert abs(np.corrcoef(*roads)[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: LandingGear(sprung_mass_kg=0.0), "landing gear is 0.0: give a positive"),
        (lambda: LandingGear(ground_stiffness_n_per_m=-1.0), "give zero or more"),
        (lambda: LandingGear(tyre_damping_n_s_per_m=float("nan")), "give zero or more"),
        (lambda: run(duration_s=0.0), "duration_s is 0.0 s"),
        (lambda: run(fs=-512.0), "fs -512.0 Hz"),
        (lambda: run(road_class="Z"), "no road class 'Z'"),
        (lambda: run(speed_m_per_s=(-18.0, 0.0)), "speeds that are not negative"),
        (lambda: taxi_test(LandingGear(), rng=np.random.default_rng(1), mass_removed_kg=1850.0),
         "less than the sprung mass"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
