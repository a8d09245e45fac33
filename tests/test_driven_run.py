"""One run as the model takes it: faults of the sensors are undone as they were made, and differentiated."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.driven import half_steps
from opid.mechanics.sensors import Sensor, measure
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair

FS, N = 256.0, 4000
LOOSE = SensorFacts(gain_tolerance=0.03, corner_hz=0.4, corner_tolerance=0.3)
PAIR = SensorPair(
    LOOSE,
    SensorFacts(gain_tolerance=0.03, corner_hz=0.3, corner_tolerance=0.3, lag_tolerance_s=0.01),
    (Leak("lower_x", "unsprung"), Leak("lower_y", "unsprung"), Leak("upper_x", "sprung")),
)
FAULTS = {
    "gain_unsprung": 1.03,
    "corner_unsprung_hz": 0.33,
    "gain_sprung": 0.97,
    "corner_sprung_hz": 0.46,
    "lag_s": 0.0021,
    "leak[0]": 0.03,
    "leak[1]": -0.02,
    "leak[2]": 0.04,
}


def band_limited(seed, *, low_hz=0.3, high_hz=40.0):
    """Return noise of rms 1 in a band, periodic, so that every operation on it has a closed form by its lines."""
    rng = np.random.default_rng(seed)
    frequency_hz = np.fft.rfftfreq(N, 1 / FS)
    lines = rng.standard_normal((2, frequency_hz.size)).T @ [1, 1j]
    lines[(frequency_hz < low_hz) | (frequency_hz > high_hz)] = 0.0
    samples = np.fft.irfft(lines, N)
    return samples / samples.std()


SIGNALS = [band_limited(seed) for seed in range(5)]


def run_of(unsprung=SIGNALS[0], sprung=SIGNALS[1], sensors=PAIR, leaks=SIGNALS[2:5]):
    return driven_run(unsprung, sprung, fs=FS, sensors=sensors, leaks=np.stack(leaks, axis=1) if leaks else None)


@pytest.mark.parametrize("side", ["drive", "measured"])
@pytest.mark.parametrize("name", FAULTS)
def test_derivatives_are_the_limits_of_differences(side, name):
    run = run_of()
    corrected = getattr(run, side)
    _, by = corrected(FAULTS)
    step = 1e-6 * max(abs(FAULTS[name]), 0.01)
    ahead, behind = (corrected(FAULTS | {name: FAULTS[name] + sign * step})[0] for sign in (1, -1))
    difference = (ahead - behind) / (2 * step)
    if name in by:
        # a lag cannot move what lies behind the end of the record
        known = slice(0, N - 1) if name == "lag_s" else slice(None)
        np.testing.assert_allclose(by[name][known], difference[known], atol=2e-6 * np.abs(difference).max())
    else:
        np.testing.assert_array_equal(ahead, behind)


def test_every_fault_has_its_derivative_on_one_side():
    run = run_of()
    names = [*run.drive(FAULTS)[1], *run.measured(FAULTS)[1]]
    assert sorted(names) == sorted(FAULTS)


def test_ideal_sensors_change_nothing_but_the_mean():
    run = run_of(SIGNALS[0] + 9.8, SIGNALS[1] - 3.0, SensorPair(), ())
    drive, by_drive = run.drive({})
    measured, by_measured = run.measured({})
    assert by_drive == by_measured == {}
    np.testing.assert_allclose(drive, half_steps(SIGNALS[0] - SIGNALS[0].mean()), atol=1e-12)
    np.testing.assert_allclose(measured, SIGNALS[1] - SIGNALS[1].mean(), atol=1e-12)


def read(samples, seed=9, across=None, **faults):
    sensor = Sensor(noise_m_per_s2=0.0, **faults)
    return measure(samples, fs=FS, sensor=sensor, rng=np.random.default_rng(seed), cross_axis_acceleration=across)


# the ends of the record have no neighbours to interpolate by
INTERIOR = slice(50, -50)


def away_from_a_constant(difference):
    return float(np.std(difference[INTERIOR]))


@pytest.mark.parametrize("corner_hz", [0.1, 0.33, 0.462])
def test_an_ac_coupling_is_undone(corner_hz):
    """The sensor's filter is the bilinear transform of the coupling, and the trapezoidal rule inverts just that."""
    sensors = SensorPair(SensorFacts(corner_hz=corner_hz), SensorFacts(corner_hz=corner_hz))
    reading = read(SIGNALS[0], corner_hz=corner_hz)
    run = run_of(reading, reading, sensors, ())
    time = np.arange(N) / FS
    for found in (run.drive({})[0][::2], run.measured({})[0]):
        # an unknown constant is left, and the mean that was taken off the reading grows to a straight line
        slope, constant = np.polyfit(time, found - SIGNALS[0], 1)
        np.testing.assert_allclose(found - SIGNALS[0], slope * time + constant, atol=1e-5)
        assert slope == pytest.approx(-2 * np.pi * corner_hz * reading.mean(), abs=1e-6)
    assert away_from_a_constant(reading - SIGNALS[0]) > 0.01


@pytest.mark.parametrize("samples", [0.2, 0.5, 1.0])
def test_a_lag_is_undone(samples):
    lag_s = samples / FS
    sensors = SensorPair(SensorFacts(), SensorFacts(lag_tolerance_s=0.01))
    reading = read(SIGNALS[1], lag_s=lag_s)
    found, _ = run_of(sprung=reading, sensors=sensors, leaks=()).measured({"lag_s": lag_s})
    assert away_from_a_constant(found - SIGNALS[1]) < 3e-3
    assert away_from_a_constant(reading - SIGNALS[1]) > 0.1 * samples


def test_a_gain_is_divided_out():
    sensors = SensorPair(SensorFacts(gain_tolerance=0.03), SensorFacts(gain_tolerance=0.03))
    run = run_of(read(SIGNALS[0], gain=1.03), read(SIGNALS[1], gain=0.97), sensors, ())
    gains = {"gain_unsprung": 1.03, "gain_sprung": 0.97}
    np.testing.assert_allclose(run.drive(gains)[0][::2], SIGNALS[0], atol=1e-12)
    np.testing.assert_allclose(run.measured(gains)[0], SIGNALS[1], atol=1e-12)


def test_a_leak_is_taken_out_of_the_side_that_it_went_into():
    sensors = SensorPair(leaks=(Leak("lower_x", "unsprung"), Leak("upper_x", "sprung")))
    lower = read(SIGNALS[0], cross_axis=0.03, across=SIGNALS[2])
    upper = read(SIGNALS[1], cross_axis=-0.02, across=SIGNALS[3])
    run = run_of(lower, upper, sensors, SIGNALS[2:4])
    shares = {"leak[0]": 0.03, "leak[1]": -0.02}
    np.testing.assert_allclose(run.drive(shares)[0][::2], SIGNALS[0], atol=1e-12)
    np.testing.assert_allclose(run.measured(shares)[0], SIGNALS[1], atol=1e-12)


def test_the_lines_are_those_of_the_band_and_of_unit_noise():
    run = driven_run(SIGNALS[0], SIGNALS[1], fs=FS, band_hz=(0.5, 20.0))
    frequency_hz = run.omega / (2 * np.pi)
    assert (frequency_hz[0], frequency_hz[-1]) == pytest.approx((0.5, 20.0), abs=FS / N)
    np.testing.assert_allclose(frequency_hz, np.fft.rfftfreq(run.n_samples, 1 / FS)[run.lines])
    noise = np.random.default_rng(0).standard_normal((20, run.n_samples))
    lines = run.transform(noise)
    assert lines.shape == (20, run.omega.size)
    np.testing.assert_allclose([lines.real.std(), lines.imag.std()], 1.0, rtol=0.03)
    # no sensor says anything near half the sampling rate
    assert driven_run(SIGNALS[0], SIGNALS[1], fs=FS, band_hz=(0.5, 500.0)).omega[-1] <= 0.4 * FS * 2 * np.pi


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"unsprung": SIGNALS[0][:-1]}, r"unsprung has shape \(3999,\) and sprung \(4000,\): give runs of one length"),
        ({"leaks": SIGNALS[2:4]}, r"leaks has shape \(4000, 2\) where \(4000, 3\) is needed: give one column"),
        ({"leaks": ()}, r"leaks has shape \(4000, 0\) where \(4000, 3\) is needed"),
    ],
)
def test_signals_that_do_not_belong_together_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        run_of(**arguments)


def test_a_band_with_few_lines_is_refused():
    with pytest.raises(InputError, match=r"the band 5 to 6 Hz holds 15 lines of a run of 15.6 s: give a longer run"):
        driven_run(SIGNALS[0], SIGNALS[1], fs=FS, band_hz=(5, 6))
