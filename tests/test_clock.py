"""A uniform rate from time stamps: rounding is understood, real faults are refused."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from opid.signals.clock import ClockError, reconstructed_clock, uniform_clock
from opid.signals.stamps import at_equal_steps

N = 4096


def printed(stamps, how):
    return np.array([float(how % stamp) for stamp in stamps])


@pytest.mark.parametrize("fs", [100.0, 256.0, 500.0, 512.0])
@pytest.mark.parametrize("how", ["%.3f", "%.4f", "%.6f", "%.9f", "%.6e", "%.5g", "%.17g"])
def test_a_plain_rate_is_recovered_exactly_from_stamps_of_few_digits(fs, how):
    clock = uniform_clock(printed(np.arange(N) / fs, how))
    assert clock.fs == fs
    assert clock.fs_as_written == pytest.approx(fs, rel=1e-5)


@pytest.mark.parametrize("fs", [511.732, 0.1, 48000.5, 44100.0, 1 / 0.003])
def test_any_rate_is_recovered_from_full_digits(fs):
    assert uniform_clock(np.arange(N) / fs).fs == pytest.approx(fs, rel=1e-12)


@example(fs=9196.0, start=0.0, decimals=5, n_samples=5)
@example(fs=53334.0, start=0.3359375, decimals=5, n_samples=3)
@given(
    fs=st.floats(1, 1e5),
    start=st.floats(-1e4, 1e4),
    decimals=st.integers(0, 6),
    n_samples=st.integers(2, 3000),
)
def test_rounded_stamps_of_a_uniform_clock_are_accepted_and_the_rate_is_within_their_rounding(
    fs, start, decimals, n_samples
):
    resolution = 10.0**-decimals
    if resolution > 0.59 / fs:
        return
    clock = uniform_clock(np.round(start + np.arange(n_samples) / fs, decimals))
    duration = (n_samples - 1) / fs
    assert clock.fs == pytest.approx(fs, rel=3 * resolution / duration + 1e-9)
    assert clock.start_s == pytest.approx(start, abs=resolution)


def test_truncated_stamps_and_single_precision_and_unix_time_are_accepted():
    assert uniform_clock(np.floor(np.arange(N) / 512 * 1e3) / 1e3).fs == 512.0
    assert uniform_clock((3600 + np.arange(N) / 512).astype(np.float32)).fs == 512.0
    assert uniform_clock(np.round(1.7e9 + np.arange(N) / 512, 6)).fs == 512.0


def test_a_little_jitter_is_accepted_and_more_is_refused():
    rng = np.random.default_rng(0)
    jitter = rng.uniform(-1, 1, N) / 512
    assert uniform_clock(np.arange(N) / 512 + 0.008 * jitter).fs == pytest.approx(512.0, rel=1e-5)
    with pytest.raises(ClockError, match=r"not uniform: the step to .* off the usual"):
        uniform_clock(np.arange(N) / 512 + 0.1 * jitter)


@pytest.mark.parametrize("decimals", [3, 4, 9])
@pytest.mark.parametrize("lost", [1, 2, 500])
def test_lost_samples_are_found_even_between_coarse_stamps(decimals, lost):
    stamps = np.round(np.delete(np.arange(N), slice(1000, 1000 + lost)) / 512, decimals)
    with pytest.raises(ClockError, match=r"the time jumps from 1\.95.* s to") as caught:
        uniform_clock(stamps)
    assert caught.value.sample == 1000
    assert f"about {lost} sample(s) lost" in str(caught.value)


def test_a_lost_sample_is_found_when_the_stamps_are_as_coarse_as_the_period():
    with pytest.raises(ClockError, match="the time jumps") as caught:
        uniform_clock(np.delete(np.round(np.arange(N) / 1000, 3), 77))
    assert caught.value.sample == 77


def test_repeated_and_decreasing_stamps():
    stamps = np.arange(N) / 512
    stamps[10] = stamps[9]
    with pytest.raises(ClockError, match="stands twice in a row") as caught:
        uniform_clock(stamps)
    assert caught.value.sample == 10
    with pytest.raises(ClockError, match=r"goes back from 0\.998.* s to 0 s") as caught:
        uniform_clock(np.tile(np.arange(512) / 512, 2))
    assert caught.value.sample == 512


def read_at_equal_steps(stamps):
    return at_equal_steps(np.zeros((stamps.size, 1)), stamps)


@pytest.mark.parametrize("read", [uniform_clock, reconstructed_clock, read_at_equal_steps])
@pytest.mark.parametrize("step_s", [1e-320, 1e-40, 1e8])
def test_steps_that_no_recorder_makes_name_the_unit_of_the_time(read, step_s):
    with pytest.raises(ClockError, match="check its unit"):
        read(np.arange(N) * step_s)


def test_a_wandering_rate_is_refused():
    count = np.arange(N)
    with pytest.raises(ClockError, match="the sampling rate wanders"):
        uniform_clock((count + 3 * np.sin(2 * np.pi * count / N)) / 512)
