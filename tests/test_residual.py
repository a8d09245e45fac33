"""A residual that is white passes, one that is not is told apart and located."""

from types import SimpleNamespace

import numpy as np
import pytest
from law_runs import fitted, logs_of
from scipy import signal, stats

from opid.suspensions.fitting.noise import mean_level, measure_whiteness, motion_over_noise, sensor_ratio
from opid.suspensions.model.run import driven_run
from opid.suspensions.settings import IntervalSettings, Settings
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW

FS = 256.0
FREQUENCY_HZ = np.arange(0.3, 40.0, 0.05)


def residual_of(lines):
    """As much of a fit as the test of whiteness looks at: (n_runs, n_sensors, n_lines)."""
    run = SimpleNamespace(omega=2 * np.pi * FREQUENCY_HZ)
    model = SimpleNamespace(settings=Settings(), runs=(run,) * len(lines), compared=slice(0, None))
    return SimpleNamespace(model=model, errors=SimpleNamespace(lines=tuple(each.ravel() for each in lines)))


def white_lines(rng, n_runs=1, n_sensors=1):
    return rng.standard_normal((n_runs, n_sensors, FREQUENCY_HZ.size, 2)) @ [1, 1j]


def test_the_statistic_of_white_noise_is_kolmogorovs():
    rng = np.random.default_rng(0)
    statistics = [measure_whiteness(residual_of(white_lines(rng))).statistic for _ in range(1000)]
    # finitely many lines, looked at from one side of each step, lie a little below the limit
    assert stats.kstest(statistics, stats.kstwobign.cdf).statistic < 0.1
    assert np.mean(np.array(statistics) > stats.kstwobign.isf(0.05)) == pytest.approx(0.05, abs=0.025)


def test_white_noise_is_called_white():
    rng = np.random.default_rng(1)
    assert stats.kstwobign.sf(IntervalSettings().white_below) == pytest.approx(1e-3, rel=0.05)
    # two runs, 1 of 500 by the limit: 3 of 200 has a chance of 1 %
    assert sum(not measure_whiteness(residual_of(white_lines(rng, n_runs=2))).white for _ in range(200)) <= 2


@pytest.mark.parametrize("centre_hz", [2.0, 5.0, 11.0])
@pytest.mark.parametrize("n_sensors", [1, 3])
def test_a_hump_in_the_spectrum_of_one_sensor_is_located(centre_hz, n_sensors):
    lines = white_lines(np.random.default_rng(2), n_runs=2, n_sensors=n_sensors)
    lines[:, -1] *= 1 + 3 / (1 + ((FREQUENCY_HZ - centre_hz) / (0.1 * centre_hz)) ** 2)
    found = measure_whiteness(residual_of(lines))
    assert not found.white
    assert found.band_hz[0] < centre_hz < found.band_hz[1]
    assert found.excess > (1.5 if n_sensors == 1 else 1.2)


def test_a_second_resonance_of_the_airframe_is_located():
    """A bracket that rings at 11 Hz beside the airframe: its reading has a part that no gear makes."""
    pole = np.exp((-0.03 + 1j) * 2 * np.pi * 11.0 / FS)

    def runs(size):
        for recording, change in logs_of():
            lower, upper = recording.channel("lower_z"), recording.channel("upper_z")
            answer = signal.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], lower)
            yield driven_run(lower, upper + size * answer / answer.std(), fs=FS, loading=change)

    found = measure_whiteness(fitted(list(runs(0.02)), DEFAULT_LAW))
    assert not found.white
    assert found.band_hz[0] < 11.0 < found.band_hz[1]
    sound = fitted(list(runs(0.0)), DEFAULT_LAW)
    assert measure_whiteness(sound).white
    assert sensor_ratio(sound, 0) == pytest.approx(sound.ratio, rel=0.02)
    # 1 m/s^2 of motion over 5 mm/s^2 of noise
    signal_rms = np.sqrt(np.mean([np.mean(run.sprung**2) for run in sound.model.runs]))
    assert motion_over_noise(sound)["heave"] == pytest.approx(signal_rms / 5e-3 * np.sqrt(128 / 40), rel=0.1)


def test_the_residual_of_a_sensor_is_that_of_its_own_lines():
    lines = white_lines(np.random.default_rng(3), n_runs=2, n_sensors=3) * np.array([1.0, 2.0, 5.0])[:, np.newaxis]
    assert [sensor_ratio(residual_of(lines), k) for k in range(3)] == pytest.approx([1.0, 2.0, 5.0], rel=0.05)
    assert mean_level([3.0, 4.0]) == pytest.approx(np.sqrt(12.5))
