"""Lines by their names, the noise floor, and channels beside each other."""

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_logs import log_of, messages, noise
from scipy import signal, stats

from opid.signals import spectra
from opid.signals.health.chunks import rows_of_a_bin
from opid.signals.health.inspection import inspect
from opid.signals.health.settings import HEALTH
from opid.signals.health.spectrum import OVERLAPPED_BINS, name_lines
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

FS = 1024.0
N = 60 * 1024


def hum(frequency_hz, n=N, fs=FS):
    return np.sqrt(2) * np.sin(2 * np.pi * frequency_hz * np.arange(n) / fs + 0.3)


def lines_of(samples, fs=FS):
    channel = inspect(log_of(samples[:, None], fs=fs), thorough=False).channels[0]
    return {line.name: line for line in channel.lines}


def test_the_density_is_scipys():
    samples = noise(N)[:, 0] + 3.0
    picture = inspect(log_of(samples[:, None], fs=FS)).channels[0].overview
    frequency_hz, density = signal.welch(samples, FS, nperseg=2 * rows_of_a_bin(FS))
    np.testing.assert_allclose(picture.frequency_hz, frequency_hz)
    np.testing.assert_allclose(picture.psd, density, rtol=1e-9)


def test_a_short_record_is_one_block():
    samples = noise(700)[:, 0]
    picture = inspect(log_of(samples[:, None], fs=FS)).channels[0].overview
    np.testing.assert_allclose(picture.psd, signal.welch(samples, FS, nperseg=700)[1], rtol=1e-9)


def test_the_density_of_a_long_log_weights_all_of_it_alike():
    fs = 30.0
    bins = 2 * OVERLAPPED_BINS
    samples = noise(bins * 64)[:, 0]
    samples[samples.size // 2 :] *= 3.0
    picture = inspect(log_of(samples[:, None], fs=fs)).channels[0].overview
    assert picture.psd[1:-1].mean() == pytest.approx(samples.var() * 2 / fs, rel=0.01)
    levels = np.nanmean(picture.spectrogram, axis=1) * fs / 2
    half = levels.size // 2
    np.testing.assert_allclose(levels[: half - 1], 1.0, rtol=0.5)
    np.testing.assert_allclose(levels[half + 1 :], 9.0, rtol=0.5)


@pytest.mark.parametrize("fs", [1024.0, 512.0, 117.3])
def test_the_noise_floor_is_that_of_the_spectra(fs):
    pole = signal.lfilter([1.0], [1.0, -1.9, 0.95], noise(N)[:, 0])
    samples = pole + 0.2 * noise(N, seed=1)[:, 0]
    channel = inspect(log_of(samples[:, None], fs=fs), thorough=False).channels[0]
    assert channel.noise_floor == pytest.approx(spectra.noise_floor(samples, fs=fs), rel=0.05)


def test_the_rms_above_5_hz():
    slow, fast = 3.0 * hum(2.0), 0.1 * hum(20.0)
    channel = inspect(log_of((slow + fast)[:, None], fs=FS), thorough=False).channels[0]
    assert channel.high_frequency_rms == pytest.approx(0.1, rel=1e-3)


@settings(max_examples=20)
@given(st.sampled_from([50.0, 60.0]), st.floats(-0.1, 0.1), st.floats(0.3, 1.0))
def test_mains_and_their_harmonics_are_named_and_measured(mains_hz, off_hz, rms):
    own_hz = mains_hz + off_hz
    samples = noise(N)[:, 0] + rms * hum(own_hz) + 0.5 * rms * hum(3 * own_hz)
    found = lines_of(samples)
    base, third = found[f"mains, {mains_hz:g} Hz"], found[f"harmonic 3 of the mains ({mains_hz:g} Hz)"]
    assert base.frequency_hz == pytest.approx(own_hz, abs=0.1)
    assert base.rms == pytest.approx(rms, rel=0.15)
    assert third.rms == pytest.approx(0.5 * rms, rel=0.25)


def test_the_supply_of_an_aircraft_and_an_aliased_harmonic():
    found = lines_of(noise(N)[:, 0] + 0.5 * hum(398.0) + 0.3 * hum(3 * 398.0))
    assert found["aircraft supply, 400 Hz"].frequency_hz == pytest.approx(398.0, abs=0.1)
    assert found["harmonic 3 of the aircraft supply (400 Hz), aliased"].frequency_hz == pytest.approx(170.0, abs=0.2)


def test_a_line_that_is_no_supply_has_no_name_and_noise_has_no_lines():
    assert name_lines([33.0, 150.0], fs=FS, resolution_hz=0.5) == [("", None), ("", None)]
    (line,) = inspect(log_of((noise(N)[:, 0] + hum(33.0))[:, None], fs=FS)).channels[0].lines
    assert (line.name, line.frequency_hz) == ("", pytest.approx(33.0, abs=0.05))
    for seed in range(10):
        assert lines_of(noise(4096, seed=seed)[:, 0]) == {}


def test_clean_taxi_runs_have_hardly_a_line():
    """Their speed falls, so the first seconds make the spectrum: it is worth fewer blocks than were averaged."""
    runs = [
        run.recording
        for seed in range(100, 108)
        for test in [taxi_test(LandingGear(), rng=np.random.default_rng(seed))]
        for run in (test.heavy, test.light)
    ]
    with_lines = [channel for run in runs for channel in inspect(run, thorough=False).channels if channel.lines]
    assert len(with_lines) <= 2  # of 32


def falling_noise(seed, n=40 * 512, fs=512.0):
    return noise(n, seed=seed)[:, 0] * np.exp(-np.arange(n) / fs / 8.0)


def test_noise_that_dies_away_has_lines_as_rarely_as_is_said():
    found = [bool(lines_of(falling_noise(seed), fs=512.0)) for seed in range(150)]
    assert sum(found) <= 3  # 6 of 2000 have one


def test_tones_three_standard_deviations_above_what_chance_makes_are_found():
    """The threshold is that of the chi-squared law of as many blocks as the mean is worth, here counted by hand."""
    n, fs, block = 40 * 512, 512.0, 16 * 512
    envelope = np.exp(-np.arange(n) / fs / 8.0)
    window = signal.get_window("hann", block) ** 2
    starts = range(0, n - block + 1, block // 2)
    power = np.array([(envelope[at : at + block] ** 2 * window).sum() for at in starts])
    worth, density = power.sum() ** 2 / (power**2).sum(), 2 * power.mean() / window.sum() / fs
    usual = density * stats.chi2.ppf(0.5, 2 * worth) / (2 * worth)
    chance = density * stats.chi2.isf(HEALTH.line_chance / 1500, 2 * worth) / (2 * worth)
    threshold = max(chance, HEALTH.line_ratio * usual)
    level = threshold + 3 * np.sqrt((2 * threshold * density + density**2) / worth)
    amplitude = np.sqrt(2 * level * 1.5 * fs / block)  # what a line of this level is under a Hann window
    tone = amplitude * np.sin(2 * np.pi * 30.0 * np.arange(n) / fs)  # on a line: 480 periods in a block
    found = [
        any(abs(line.frequency_hz - 30.0) < 0.1 for line in each)
        for seed in range(60)
        for each in [inspect(log_of((falling_noise(seed) + tone)[:, None], fs=fs)).channels[0].lines]
    ]
    assert np.mean(found) > 0.95


def test_a_damped_resonance_is_no_line():
    b, a = signal.iirpeak(50.0, 15.0, fs=FS)
    assert lines_of(signal.lfilter(b, a, noise(N)[:, 0])) == {}


def resonance(frequency_hz, zeta, n, fs=FS, seed=0):
    w = 2 * np.pi * frequency_hz
    moved = signal.lfilter(*signal.bilinear([w**2], [1, 2 * zeta * w, w**2], fs), noise(n, seed=seed)[:, 0])
    return moved / moved.std()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("frequency_hz", "zeta"), [(1.98, 0.11), (10.0, 0.01), (10.0, 0.02), (50.0, 0.01)])
def test_resonances_are_no_lines_and_tones_beside_them_are(frequency_hz, zeta, seed):
    fs = 256.0
    n = 180 * 256
    moved = resonance(frequency_hz, zeta, n, fs, seed) + 0.01 * noise(n, seed=seed + 9)[:, 0]
    assert inspect(log_of(moved[:, None], fs=fs)).channels[0].lines == ()
    (line,) = inspect(log_of((moved + 0.1 * hum(31.3, n, fs))[:, None], fs=fs)).channels[0].lines
    assert (line.frequency_hz, line.rms) == (pytest.approx(31.3, abs=0.01), pytest.approx(0.1, rel=0.05))
    assert line.resolved


def test_what_a_short_record_does_not_tell_is_a_peak():
    fs, n = 256.0, 24 * 256
    moved = resonance(10.0, 0.01, n, fs) + 0.01 * noise(n, seed=9)[:, 0]
    (peak,) = inspect(log_of(moved[:, None], fs=fs)).channels[0].lines
    assert peak.frequency_hz == pytest.approx(10.0, abs=0.3)
    assert not peak.resolved
    assert all(
        line.resolved for line in inspect(log_of((noise(n) + hum(100.0, n, fs)[:, None]), fs=fs)).channels[0].lines
    )


def test_a_weak_hum_in_a_long_log_and_a_tone_that_wanders_are_found():
    n = 180 * 1024
    motion = resonance(1.8, 0.1, n) + resonance(12.0, 0.15, n, seed=1) + 0.02 * noise(n, seed=2)[:, 0]
    (line,) = inspect(log_of((motion + 0.01 * hum(50.0, n))[:, None], fs=FS), thorough=False).channels[0].lines
    assert (line.name, line.rms) == ("mains, 50 Hz", pytest.approx(0.01, rel=0.15))
    # the speed of a machine wanders by 1 in 1000 around 350 Hz
    phase = np.cumsum(2 * np.pi * 350.0 * (1 + 1e-3 * np.sin(2 * np.pi * np.arange(n) / 20e3)) / FS)
    lines = inspect(log_of((motion + 0.3 * np.sin(phase))[:, None], fs=FS), thorough=False).channels[0].lines
    assert lines[0].frequency_hz == pytest.approx(350.0, abs=0.4)
    assert lines[0].rms == pytest.approx(0.3 / np.sqrt(2), rel=0.1)


def test_a_gap_between_long_blocks_makes_no_line():
    n = 120 * 1024
    stamps = np.arange(n) / FS + 0.0371 * (np.arange(n) > 30_000) + 0.0371 * (np.arange(n) > 70_000)
    samples = noise(n)[:, 0] + hum(33.0, n)
    samples[100_000:100_100] = np.nan
    (line,) = inspect(log_of(samples[:, None], stamps=stamps)).channels[0].lines
    assert line.frequency_hz == pytest.approx(33.0, abs=0.01)


@pytest.mark.parametrize("fs", [100.0, 1000.0, 5000.0])
def test_the_bands_of_the_spectrogram_grow_with_frequency(fs):
    picture = inspect(log_of(noise(int(20 * fs)), fs=fs)).channels[0].overview
    bands_hz = picture.spectrogram_hz
    assert np.count_nonzero((bands_hz >= 1.0) & (bands_hz <= 3.0)) >= 4
    assert np.diff(bands_hz)[bands_hz[1:] < 20.0].max() <= 0.51
    assert (np.diff(bands_hz)[1:] <= np.maximum(0.51, 0.03 * bands_hz[2:])).all()
    np.testing.assert_allclose(np.nanmean(picture.spectrogram, axis=0)[1:-1].mean(), 2 / fs, rtol=0.05)


@pytest.mark.parametrize("seconds", [1.3, 2.5, 7.6, 90.0])
def test_the_spectrogram_has_a_value_wherever_the_log_is_sound(seconds):
    fs = 5000.0
    samples = noise(int(seconds * fs), 2)
    assert np.isfinite(inspect(log_of(samples, fs=fs, rows=7777)).channels[0].overview.spectrogram).all()
    if seconds > 10:
        samples[200_000:203_000, 0] = np.nan
        picture = inspect(log_of(samples, fs=fs)).channels[0].overview
        (empty,) = np.flatnonzero(np.isnan(picture.spectrogram).all(axis=1))
        assert abs(picture.spectrogram_s[empty] - 40.3) < 1.1


def test_hum_is_a_finding_with_a_remedy():
    samples = noise(N)[:, 0] + 0.3 * hum(50.0)
    health = inspect(log_of(samples[:, None], fs=FS))
    (message,) = messages(health, "warning")
    assert re.match(r"0\.3\d? m/s\^2 rms of the electric supply \(50\S* Hz: mains, 50 Hz\): earth the shield", message)


# ---- channels beside each other ----------------------------------------------------------------------


def delayed(samples, delay_s, fs=FS):
    """Delay by the shift theorem, over a circle."""
    spectrum = np.fft.rfft(samples)
    return np.fft.irfft(spectrum * np.exp(-2j * np.pi * np.fft.rfftfreq(samples.size, 1 / fs) * delay_s), samples.size)


def band_noise(n, seed=0):
    b, a = signal.butter(4, 150.0, fs=FS)
    return signal.lfilter(b, a, noise(n, seed=seed)[:, 0])


@settings(max_examples=15)
@given(st.floats(-0.02, 0.02), st.sampled_from([1.0, -1.0]), st.integers(0, 1000))
def test_a_lag_between_sensors_that_move_alike_is_measured(delay_s, sign, seed):
    motion = band_noise(N, seed)
    pair = np.stack([motion, sign * delayed(motion, delay_s)], axis=1) + 0.05 * noise(N, 2, seed=seed + 1)
    (found,) = inspect(log_of(pair, fs=FS)).pairs
    assert abs(found.lag_s - delay_s) < 5 * found.lag_std_s < 1e-4
    assert found.coherent_band_hz[1] > 150.0


def test_the_standard_deviation_of_the_lag_is_what_repetition_shows():
    errors, stated = [], []
    for seed in range(40):
        motion = band_noise(20 * 1024, 3 * seed)
        pair = np.stack([motion, delayed(motion, 1e-3)], axis=1) + 0.1 * noise(20 * 1024, 2, seed=3 * seed + 1)
        (found,) = inspect(log_of(pair, fs=FS)).pairs
        errors.append(found.lag_s - 1e-3)
        stated.append(found.lag_std_s)
    # 40 repetitions know a standard deviation to 11 %
    assert 0.65 < np.std(errors) / np.mean(stated) < 1.5
    assert abs(np.mean(errors)) < 4 * np.std(errors) / np.sqrt(40)


def test_a_lag_is_a_finding_with_the_remedy_and_none_where_there_is_none():
    motion = band_noise(N)
    own = 0.02 * noise(N, 3, seed=1)
    samples = np.stack([motion, delayed(motion, 2e-3), motion], axis=1) + own
    health = inspect(log_of(samples, fs=FS))
    (finding,) = [f for f in health.findings if f.severity == "warning"]
    assert finding.channel == "c1"
    assert "comes 2 ms" in finding.message.replace("1.999 ms", "2 ms").replace("2.001 ms", "2 ms")
    assert "later than 'c0'" in finding.message
    assert float(re.search(r"`shift_s = (\S+)`", finding.message)[1]) == pytest.approx(-2e-3, abs=1e-5)


def test_the_phase_of_a_suspension_is_called_no_lag():
    wheel = noise(N)[:, 0]
    w, zeta = 2 * np.pi * 2.0, 0.2
    body = signal.lfilter(*signal.bilinear([2 * zeta * w, w**2], [1, 2 * zeta * w, w**2], FS), wheel)
    samples = np.stack([wheel, body], axis=1) + 0.001 * noise(N, 2, seed=1)
    health = inspect(log_of(samples, fs=FS))
    assert [m for m in messages(health) if "later" in m or "earlier" in m] == []
    assert health.looks_unsprung == "c0"


def test_unrelated_channels_are_not_coherent():
    (found,) = inspect(log_of(noise(N, 2), fs=FS)).pairs
    assert np.isnan(found.lag_s)
    assert found.coherent_band_hz is None or np.diff(found.coherent_band_hz) < 3.0


def test_one_signal_twice_is_told():
    samples = noise(N, 2)
    health = inspect(log_of(np.column_stack([samples, samples[:, 0]]), fs=FS))
    assert ("c2", "the same signal as 'c0': check the wiring and the export") in [
        (f.channel, f.message) for f in health.findings
    ]


def test_at_most_eight_accelerations_are_put_beside_each_other_and_nothing_else():
    assert len(inspect(log_of(noise(9000, 10), fs=FS)).pairs) == 28
    assert inspect(log_of(noise(9000, 2), fs=FS, unit="m")).pairs == ()
    assert inspect(log_of(noise(9000, 2), fs=FS), thorough=False).pairs == ()
