import numpy as np
import pytest

from opid.errors import InputError
from opid.virtual.taxi_tests.sensors import Sensor, decimate, measure

FS = 512.0
TIME_S = np.arange(int(20 * FS)) / FS
MIDDLE = slice(int(5 * FS), int(15 * FS))
QUIET = {"noise_m_per_s2": 0.0}


def tone(frequency_hz, time_s=TIME_S):
    return np.sin(2.0 * np.pi * frequency_hz * time_s)


def read(sensor, acceleration, seed=1, **others):
    return measure(acceleration, fs=FS, sensor=sensor, rng=np.random.default_rng(seed), **others)


def complex_amplitude(reading, frequency_hz):
    """Amplitude of a tone of whole periods in the middle of the record, 1 for `tone`."""
    time_s = TIME_S[MIDDLE]
    return 2j * np.mean(reading[MIDDLE] * np.exp(-2j * np.pi * frequency_hz * time_s))


def test_a_perfect_sensor_reads_the_truth():
    np.testing.assert_array_equal(read(Sensor(**QUIET), tone(3.0)), tone(3.0))


def test_noise_is_white_and_of_its_level_whatever_the_signal():
    reading = read(Sensor(noise_m_per_s2=0.02), tone(3.0))
    noise = reading - tone(3.0)
    assert np.std(noise) == pytest.approx(0.02, rel=0.03)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03
    np.testing.assert_allclose(read(Sensor(noise_m_per_s2=0.04), tone(3.0)) - tone(3.0), 2.0 * noise, atol=1e-14)


def test_gain_acts_on_the_axis_and_on_the_leak():
    reading = read(Sensor(**QUIET, gain=1.01, cross_axis=0.03), tone(3.0), cross_axis_acceleration=tone(7.0))
    np.testing.assert_allclose(reading, 1.01 * (tone(3.0) + 0.03 * tone(7.0)), atol=1e-14)


@pytest.mark.parametrize("frequency_hz", [0.1, 0.3, 0.5, 2.0, 20.0])
def test_ac_coupling_is_a_first_order_high_pass(frequency_hz):
    corner_hz = 0.33
    reading = read(Sensor(**QUIET, corner_hz=corner_hz), tone(frequency_hz))
    expected = 1j * frequency_hz / (corner_hz + 1j * frequency_hz)
    assert complex_amplitude(reading, frequency_hz) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("lag_samples", [0.2, 1.0, 3.5])
def test_lag_delays(lag_samples):
    reading = read(Sensor(**QUIET, lag_s=lag_samples / FS), tone(15.0))
    expected = np.exp(-2j * np.pi * 15.0 * lag_samples / FS)
    assert complex_amplitude(reading, 15.0) == pytest.approx(expected, abs=1e-5)


def test_a_converter_has_steps_and_a_range():
    reading = read(Sensor(**QUIET, bits=8, range_m_per_s2=1.6), 2.0 * tone(3.0))
    step = 3.2 / 256
    np.testing.assert_allclose(reading / step, np.round(reading / step), atol=1e-9)
    inside = np.abs(2.0 * tone(3.0)) < 1.6 - step
    assert np.abs(reading - 2.0 * tone(3.0))[inside].max() <= step / 2 + 1e-12
    assert reading.max() == 1.6
    assert reading.min() == -1.6


def test_the_input_is_not_changed():
    acceleration = tone(3.0)
    read(Sensor(gain=2.0), acceleration)
    np.testing.assert_array_equal(acceleration, tone(3.0))


@pytest.mark.parametrize("factor", [1, 2, 8])
def test_decimation_keeps_the_band_in_time_and_level(factor):
    fine = np.arange(TIME_S.size * factor) / (FS * factor)
    for frequency_hz in (1.0, 15.0, 150.0, 200.0):
        kept = decimate(tone(frequency_hz, fine), factor)
        np.testing.assert_allclose(kept[MIDDLE], tone(frequency_hz)[MIDDLE], atol=1e-4)


def test_decimation_stops_what_would_fold():
    fine = np.arange(TIME_S.size * 8) / (FS * 8)
    for frequency_hz in (257.0, 300.0, 512.5, 1000.0):
        assert np.abs(decimate(tone(frequency_hz, fine), 8)[MIDDLE]).max() < 1e-4


def test_decimation_works_along_time_for_many_channels():
    fine = np.arange(TIME_S.size * 4) / (FS * 4)
    both = decimate(np.stack([tone(3.0, fine), tone(9.0, fine)], axis=1), 4)
    np.testing.assert_allclose(both[:, 1], decimate(tone(9.0, fine), 4), atol=1e-14)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sensor(noise_m_per_s2=-1.0), "neither can be negative"),
        (lambda: Sensor(corner_hz=float("nan")), "neither can be negative"),
        (lambda: Sensor(bits=16), "and the range"),
        (lambda: Sensor(range_m_per_s2=0.0), "give a positive number"),
        (lambda: read(Sensor(cross_axis=0.03), tone(3.0)), "give the acceleration across it"),
        (lambda: decimate(tone(3.0), 0), "factor is 0"),
        (lambda: read(Sensor(corner_hz=300.0), tone(3.0)), "below fs/2"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
