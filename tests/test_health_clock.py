"""The truth about a clock: each fault planted in the stamps is named with its place and its remedy."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_logs import log_of, messages, noise
from measured_data import DATA, needs_data

from opid.errors import FileError
from opid.signals.clock import reconstructed_clock, uniform_clock
from opid.signals.health.inspection import inspect
from opid.signals.log import ChannelSettings, Log, LoggedChannel, LogSettings, Track, rows_of_array

FS, N = 500.0, 20_000
TRUE = 3.0 + np.arange(N) / FS


def health_of(stamps, settings=None, rows=1000):
    return inspect(log_of(noise(len(stamps)), stamps=stamps, rows=rows), settings or LogSettings(), thorough=False)


def clock_of(stamps, **more):
    return health_of(stamps, **more).clocks[0]


@settings(max_examples=20)
@given(st.floats(20.0, 5000.0), st.sampled_from([4, 5, 6, 12]), st.integers(500, 30_000), st.floats(-1e3, 1e3))
def test_sound_stamps_give_the_rate_that_reading_gives(fs, digits, n, start_s):
    fs = round(fs, 3)
    if 10.0**-digits > 0.3 / fs:
        return
    stamps = np.round(start_s + np.arange(n) / fs, digits)
    health = health_of(stamps)
    (clock,) = health.clocks
    assert messages(health) == []
    # either is off by the rounding of the stamps, and goes as far again to a plain number
    assert clock.fs == pytest.approx(uniform_clock(stamps).fs, rel=2e-10 + 4 * 10.0**-digits * fs / n)
    assert (clock.n_samples, clock.repeated, clock.backward, clock.n_gaps) == (n, 0, 0, 0)
    assert clock.duration_s == pytest.approx(n / fs, abs=2 * 10.0**-digits)
    assert clock.start_s == stamps[0]


def test_a_plain_rate_is_found_exactly_with_resolution_and_rounding():
    clock = clock_of(np.round(TRUE, 3 + 1))
    assert (clock.fs, clock.resolution_s, clock.stated) == (FS, pytest.approx(1e-3), False)
    clock = clock_of(np.round(np.arange(N) / 512, 4))
    assert (clock.fs, clock.resolution_s) == (512.0, pytest.approx(1e-4))
    # a period is 19.53125 steps of the rounding: 17/32 of the steps between stamps are 20, the others 19 of them
    assert clock.jitter == pytest.approx(np.sqrt(17 / 32 * 15 / 32) * 1e-4 * 512, rel=0.01)


def test_gaps_are_counted_placed_and_what_was_lost_is_estimated():
    stamps = np.delete(TRUE, np.r_[5000:5100, 12_000:12_001])
    (judged,) = health_of(stamps).clocks
    assert (judged.n_gaps, judged.n_lost) == (1, 100)  # a lost row is interpolated, and no gap
    health = health_of(stamps, LogSettings(clock="stamps"))
    (clock,) = health.clocks
    assert (clock.fs, clock.n_gaps, clock.n_lost) == (FS, 2, 101)
    assert [(g.start_s, g.stop_s) for g in clock.gaps] == [
        pytest.approx((TRUE[4999], TRUE[5100])),
        pytest.approx((TRUE[11_999], TRUE[12_001])),
    ]
    (message,) = messages(health, "warning")
    assert "jumps from 12.998 s to 13.2 s where steps of 0.002 s are usual (2 gap(s), about 101 sample(s)" in message
    assert "start_s, stop_s" in message
    unsound = ~health.rms_history[0].sound[:, 0]
    assert unsound.sum() == 2
    for gap in clock.gaps:
        assert (health.rms_history[0].start_s[unsound] <= gap.stop_s).any()


def test_places_after_a_gap_are_told_in_the_time_of_the_log():
    samples = noise(N)
    samples[15_000] += 50.0
    stamps = TRUE.copy()
    stamps[10_007:] += 1000.0
    health = inspect(log_of(samples, stamps=stamps, rows=777))
    assert "the first at 1033.0000 s" in messages(health)[1]


def test_stamps_that_go_back_are_a_fault():
    stamps = TRUE.copy()
    stamps[8000:] -= 5.0
    health = health_of(stamps)
    assert health.clocks[0].backward == 1
    (message,) = messages(health, "fault")
    assert f"goes back 1 time(s), the first to {stamps[8000]:.9g} s: put the samples in order" in message
    assert health.clocks[0].fs == pytest.approx(FS)
    assert not health.rms_history[0].sound.all()


def test_stamps_that_stand_twice_are_a_fault():
    stamps = TRUE.copy()
    stamps[[700, 15_000]] = stamps[[699, 14_999]]
    health = health_of(stamps)
    assert health.clocks[0].repeated == 2
    (message,) = messages(health, "fault")
    assert f"2 time stamp(s) stand twice in a row, the first at {stamps[699]:.9g} s" in message


def test_stamps_that_are_no_numbers_are_a_fault():
    stamps = TRUE.copy()
    stamps[[0, 5000, 5001]] = np.nan
    assert "3 time stamp(s) are no number" in messages(health_of(stamps), "fault")[0]


@pytest.mark.parametrize("quantum", [0.03, 1.0])
def test_crowding_stamps_are_told_with_the_remedy_and_the_remedy_works(quantum):
    stamps = np.floor(np.arange(N) / 117.0 / quantum) * quantum
    assert "they are taken as equally spaced" in messages(health_of(stamps), "warning")[0]
    health = health_of(stamps, LogSettings(clock="stamps"))
    (message,) = messages(health, "fault")
    assert f"about {117 * quantum:.1f} rows share a time stamp" in message
    assert 'write `clock = "reconstructed"` in [log]' in message
    mended = health_of(stamps, LogSettings(clock="reconstructed"))
    assert messages(mended, "fault") == messages(mended, "warning") == []
    expected = reconstructed_clock(stamps)
    assert mended.clocks[0].fs == pytest.approx(expected.fs, rel=1e-9)
    assert mended.clocks[0].start_s == pytest.approx(expected.start_s, abs=1e-6)
    told = re.search(r"up to (\S+) s off", messages(mended, "note")[0])
    assert float(told[1]) == pytest.approx(expected.stray_s, rel=0.05)


def test_stamps_that_scatter_are_told():
    stamps = np.sort(TRUE + 0.1 / FS * np.random.default_rng(0).standard_normal(N))
    health = health_of(stamps)
    assert health.clocks[0].jitter == pytest.approx(0.1 * np.sqrt(2), rel=0.05)
    assert "scatter by 14% of the period" in messages(health, "note")[0]
    assert "scatter by 14% of the period" in messages(health_of(stamps, LogSettings(clock="stamps")), "warning")[0]
    assert health.clocks[0].n_gaps == 0


@pytest.mark.parametrize("value", [0.0, 1.7e9, 1.8e13])
def test_stamps_that_never_move_are_told(value):
    health = health_of(np.full(N, value))
    assert health.clocks[0].repeated == N - 1
    assert health.clocks[0].n_lost == 0
    assert "which is no clock" in messages(health, "fault")[0]


def test_stamps_that_cannot_be_times_are_no_numbers():
    stamps = TRUE.copy()
    stamps[[7000, 9000]] = [1e300, -1e200]
    assert "2 time stamp(s) are no number" in messages(health_of(stamps), "fault")[0]


def test_absurd_rates_are_told():
    assert (
        "follows from the time stamps: check their unit (time_unit in [log], --time-unit)"
        in messages(health_of(1000 * TRUE))[0]
    )
    assert "is stated: check the stated rate" in messages(health_of(TRUE, LogSettings(fs_hz=5e6)))[0]


def test_a_stated_rate_goes_before_the_stamps():
    health = health_of(np.zeros(N), LogSettings(fs_hz=250.0))
    (clock,) = health.clocks
    assert (clock.fs, clock.stated, clock.start_s, clock.duration_s) == (250.0, True, 0.0, N / 250)
    assert messages(health) == []
    late = inspect(log_of(noise(100), fs=50.0, start_s=7.0))
    assert late.clocks[0].start_s == late.rms_history[0].start_s[0] == 7.0


def stalled(stamps, at_s, lasting_s):
    """What a host stamps that stood still: the rows that came meanwhile get the time at which it went on."""
    inside = (stamps >= at_s) & (stamps < at_s + lasting_s)
    return np.where(inside, at_s + lasting_s, stamps)


CROWDING = np.ceil(np.arange(12_000) / 117.2 / 0.05) * 0.05  # a buffer that is emptied every 50 ms


@pytest.mark.parametrize("stalls", [[(9.0, 5.0)], [(0.7, 3.0)], [(20.0, 1.0), (50.0, 8.0), (99.0, 2.0)]])
def test_a_host_that_stalls_loses_no_samples(stalls):
    stamps = CROWDING
    for stall in stalls:
        stamps = stalled(stamps, *stall)
    health = health_of(stamps, LogSettings(clock="reconstructed"))
    (clock,) = health.clocks
    assert clock.fs == pytest.approx(117.2, rel=2e-4)
    assert clock.fs == pytest.approx(reconstructed_clock(stamps).fs, rel=2e-4)
    assert (clock.n_gaps, clock.n_lost) == (0, 0)
    (told,) = [text for text in messages(health, "note") if "the host stalled" in text]
    number, longest = re.findall(r"stand still (\d+) time\(s\), the longest for (\S+) s at", told)[0]
    assert int(number) == len(stalls)
    assert float(longest) == pytest.approx(max(lasting_s for _, lasting_s in stalls), abs=0.06)
    assert health.rms_history[0].complete.all()
    # where nobody says that the rows are equally spaced the same rate is offered
    assert health_of(stamps).clocks[0].fs == clock.fs


def test_samples_that_were_lost_are_not_taken_for_a_stall():
    stamps = np.delete(CROWDING, np.r_[9000:9586])  # 5 s
    health = health_of(stamps, LogSettings(clock="reconstructed"))
    (clock,) = health.clocks
    assert (clock.n_gaps, clock.n_lost) == (1, pytest.approx(586, abs=12))
    assert not [text for text in messages(health, "note") if "the host stalled" in text]


@needs_data("wobble_landcruiser")
@pytest.mark.parametrize(("name", "fs"), [("20211027T145614", 116.73), ("20211029T125712", 117.35)])
def test_a_stall_does_not_move_the_rate_of_a_measured_log(name, fs):
    stamps = np.loadtxt(DATA / "wobble_landcruiser" / f"{name}_sensors.csv", delimiter=",", usecols=0)
    late = stalled(stamps, 10.0, 5.0)
    assert clock_of(late).fs == pytest.approx(fs, rel=1e-3)
    assert reconstructed_clock(late).fs == pytest.approx(fs, rel=1e-3)
    assert clock_of(late).n_lost == 0


@needs_data("wobble_landcruiser")
@pytest.mark.parametrize(("name", "fs"), [("20211027T145614", 116.73), ("20211029T125712", 117.35)])
def test_a_measured_log_with_crowding_stamps_and_a_false_offset(name, fs):
    table = np.loadtxt(DATA / "wobble_landcruiser" / f"{name}_sensors.csv", delimiter=",")
    names = [f"{sensor}_{axis}" for sensor in "abcd" for axis in ("ax", "ay", "az", "rx", "ry", "rz")]
    track = Track(tuple(map(LoggedChannel, names)), rows_of_array(table[:, 1:], table[:, 0]), n_samples=len(table))
    log = Log(Path(f"{name}.csv"), "CSV", (track,))
    channels = {each: ChannelSettings(each, unit="g", scale=16 / 32767) for each in names if "_a" in each}
    health = inspect(log, channels=channels)
    assert not messages(health, "fault")
    assert any("share a time stamp" in message for message in messages(health, "warning"))
    assert health.fs == pytest.approx(fs, abs=0.005)
    offsets = {f.channel for f in health.findings if "more than gravity makes" in f.message}
    assert offsets == ({"c_ax", "c_ay", "c_az"} if name == "20211029T125712" else set())
    assert not messages(inspect(log, LogSettings(clock="reconstructed"), channels=channels), "fault")


@pytest.mark.parametrize("factor", [1e-300, 1e-12, 1e9])
def test_steps_that_no_recorder_makes_are_refused(factor):
    with pytest.raises(FileError, match=r"goes on by .* a sample, and that of a recorder by .*check its unit"):
        health_of(factor * np.arange(2000) / FS)
