"""Another rate changes nothing that both rates can hold, and lets nothing else through."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import signal

from opid.errors import InputError
from opid.signals.recording import Recording, recording_from_arrays
from opid.signals.resampling import PASS, STOP, design_low_pass, on_common_clock, resampled


def tone(frequency_hz, fs, *, start_s=0.0, duration_s=8.0, name="a"):
    t = start_s + np.arange(round(duration_s * fs)) / fs
    return recording_from_arrays([np.cos(2 * np.pi * frequency_hz * t + 0.3)], [name], fs=fs, start_s=start_s)


def error(recording, frequency_hz):
    """Largest departure from the tone, away from the ends by ten of its periods and a hundred samples."""
    truth = np.cos(2 * np.pi * frequency_hz * recording.time_s + 0.3)
    edge = round(max(100, 10 * recording.fs / frequency_hz))
    return np.abs(recording.samples[:, 0] - truth)[edge:-edge].max()


@pytest.mark.parametrize(
    ("pass_hz", "stop_hz", "stop_db"), [(40.0, 60.0, 80.0), (199.0, 205.0, 60.0), (1.0, 9.0, 51.0)]
)
def test_the_low_pass_filter_is_that_of_scipy(pass_hz, stop_hz, stop_db):
    n_taps, beta = signal.kaiserord(stop_db, 2 * (stop_hz - pass_hz) / 500)
    expected = signal.firwin(n_taps | 1, (pass_hz + stop_hz) / 2, window=("kaiser", beta), fs=500)
    np.testing.assert_allclose(
        design_low_pass(pass_hz, stop_hz, fs=500, stop_db=stop_db), expected, rtol=1e-10, atol=1e-14
    )


@pytest.mark.parametrize(
    ("fs", "new"), [(512.0, 500.0), (5000.0, 512.0), (400.0, 1000.0), (117.0371, 100.0), (5e3, 500.0)]
)
@pytest.mark.parametrize("fraction", [0.02, 0.2, 0.39])
def test_a_tone_that_both_rates_hold_is_kept(fs, new, fraction):
    frequency_hz = fraction * min(fs, new)
    assert error(resampled(tone(frequency_hz, fs, duration_s=4000 / min(fs, new)), new), frequency_hz) < 1e-3


@pytest.mark.parametrize("fraction", [STOP + 0.01, 0.7, 0.95, 1.3])
def test_what_the_lower_rate_cannot_hold_is_gone(fraction):
    fast = tone(fraction * 500.0, 5000.0, duration_s=20.0)
    slow = resampled(fast, 500.0).samples[500:-500]
    assert np.abs(slow).max() < 3e-4
    # without the filter it would fold back in full
    assert np.abs(fast.samples[::10][500:-500]).max() > 0.9


@settings(max_examples=20)
@given(shift=st.floats(0.0, 3.0), fraction=st.floats(0.01, PASS))
def test_nothing_is_shifted_in_time(shift, fraction):
    moved = resampled(tone(fraction * 200.0, 200.0, duration_s=20.0), 200.0, start_s=shift, n_samples=3000)
    assert moved.start_s == shift
    assert error(moved, fraction * 200.0) < 1e-3


def test_against_the_fourier_way_on_a_periodic_signal():
    rng = np.random.default_rng(3)
    lines = np.zeros(2001, dtype=complex)
    lines[1:700] = rng.standard_normal(699) + 1j * rng.standard_normal(699)
    x = np.fft.irfft(lines, 4000) * 100
    ours = resampled(recording_from_arrays([x], ["a"], fs=1000.0), 500.0).samples[:, 0]
    # the other way keeps everything below the new Nyquist frequency; so does ours up to 0.4 of the rate (line 800)
    theirs = signal.resample(x, 2000)
    np.testing.assert_allclose(ours[300:-300], theirs[300:-300], atol=2e-3 * x.std())


def test_the_history_says_so_and_units_stay():
    slow = resampled(tone(3.0, 1000.0), 250.0)
    assert slow.history[-1] == "resampled from 1000 Hz to 250 Hz"
    assert slow.channels == tone(3.0, 1000.0).channels


@pytest.mark.parametrize("fs_hz", [0.0, -5.0, np.nan, np.inf])
def test_a_rate_must_be_positive(fs_hz):
    with pytest.raises(InputError, match="give a positive rate"):
        resampled(tone(3.0, 100.0), fs_hz)


@pytest.mark.parametrize(("start_s", "n"), [(-1.0, 100), (7.9, 100), (0.0, 1)])
def test_times_outside_are_refused(start_s, n):
    with pytest.raises(InputError, match="choose times inside it"):
        resampled(tone(3.0, 100.0), 100.0, start_s=start_s, n_samples=n)


def test_a_recording_of_a_millisecond_is_told_as_too_short():
    moment = recording_from_arrays([np.arange(1000.0)], ["a"], fs=1e6)
    with pytest.raises(InputError, match=r"lasts 0\.001 s, less than two samples at 500 Hz: give a longer one"):
        resampled(moment, 500.0)


def test_channels_of_two_rates_and_two_beginnings():
    fast, slow = tone(7.0, 1000.0, name="fast"), tone(7.0, 256.0, start_s=0.4017, name="slow")
    both = on_common_clock([fast, slow], order=("slow", "fast"))
    assert both.fs == 256.0
    assert both.names == ("slow", "fast")
    assert both.start_s == 0.4017
    assert both.time_s[-1] <= 8.0
    truth = np.cos(2 * np.pi * 7.0 * both.time_s + 0.3)
    np.testing.assert_array_equal(both.channel("slow"), slow.samples[: both.n_samples, 0])
    assert np.abs(both.channel("fast") - truth)[100:-100].max() < 1e-3
    assert "fast: resampled from 1000 Hz to 256 Hz, from 0.4017 s on" in both.history


def test_channels_of_one_clock_are_not_touched():
    one, other = tone(7.0, 256.0, name="one"), tone(9.0, 256.0, start_s=1.0, name="other")
    both = on_common_clock([one, other])
    np.testing.assert_array_equal(both.channel("one"), one.samples[256:, 0])
    np.testing.assert_array_equal(both.channel("other"), other.samples[: both.n_samples, 0])
    assert both.n_samples == 7 * 256


def test_channels_that_share_no_time_are_refused():
    with pytest.raises(InputError, match=r"share no time .*0 to 7.99 s, 9 to 16.99 s"):
        on_common_clock([tone(3.0, 100.0), tone(3.0, 100.0, start_s=9.0, name="b")])


def test_a_short_recording():
    short = Recording(np.arange(6.0)[:, None], fs=10.0, channels=tone(1.0, 10.0).channels)
    np.testing.assert_allclose(resampled(short, 20.0).samples[:, 0], np.arange(11) / 2, atol=0.2)
