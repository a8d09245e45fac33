"""From what a file holds to a recording: the wanted stretch and channels, in SI, on one clock."""

from pathlib import Path

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.conversion import recording_of
from opid.signals.log import (
    Block,
    ChannelSettings,
    Log,
    LoggedChannel,
    LogSettings,
    Track,
    log_of_recording,
    rows_from_start,
    rows_of_array,
)
from opid.signals.recording import recording_from_arrays

G = 9.80665
RNG = np.random.default_rng(5)
COUNTS = RNG.integers(-2000, 2000, (3000, 3)).astype(np.float64)


def log(*tracks):
    return Log(Path("run.xyz"), "XYZ", tracks)


def track(names=("ax", "ay", "az"), unit="g", counts=COUNTS, stamps=None, **more):
    channels = tuple(LoggedChannel(name, unit) for name in names)
    return Track(channels, rows_of_array(counts[:, : len(names)], stamps), n_samples=len(counts), **more)


def test_values_become_si_by_unit_scale_offset_and_sign():
    channels = {
        "plain": ChannelSettings("ax"),
        "raw": ChannelSettings("ay", unit="mm/s^2", scale=0.5, offset=-3.0),
        "turned": ChannelSettings(3, sign=-1),
    }
    run = recording_of(log(track(fs=200.0)), channels=channels)
    assert run.names == ("plain", "raw", "turned")
    assert {channel.unit for channel in run.channels} == {"m/s^2"}
    np.testing.assert_allclose(run.channel("plain"), COUNTS[:, 0] * G)
    np.testing.assert_allclose(run.channel("raw"), (0.5 * COUNTS[:, 1] - 3) / 1000, atol=1e-15)
    np.testing.assert_allclose(run.channel("turned"), -COUNTS[:, 2] * G)
    assert run.history == (
        "read 3000 samples from run.xyz",
        "rate 200 Hz as the file states",
        "ax: g -> m/s^2, times 9.80665",
        "ay: times 0.5, plus -3 mm/s^2, mm/s^2 -> m/s^2, times 0.001, the file states g",
        "3: sign reversed, g -> m/s^2, times 9.80665",
    )


def test_a_unit_that_nobody_states_is_asked_for():
    silent = log(track(unit=None, fs=200.0))
    with pytest.raises(InputError, match=r"run.xyz: channel 'ax' states no unit: write it in the log's header"):
        recording_of(silent)
    assert recording_of(silent, LogSettings(unit="g")).unit("ax") == "m/s^2"
    with pytest.raises(InputError, match="the unit 'furlong' is not known"):
        recording_of(log(track(unit="furlong", fs=200.0)), channels=["ax"])


@pytest.mark.parametrize("stamps", [None, np.arange(3000) / 200.0])
@pytest.mark.parametrize(
    ("start_s", "stop_s", "rows"), [(None, 2.0, (0, 400)), (3.0, None, (600, 3000)), (3.0, 4.5, (600, 900))]
)
def test_a_section_holds_its_rows(stamps, start_s, stop_s, rows):
    fs = None if stamps is not None else 200.0
    run = recording_of(log(track(stamps=stamps, fs=fs)), channels=["ay"], start_s=start_s, stop_s=stop_s)
    np.testing.assert_array_equal(run.channel("ay"), COUNTS[rows[0] : rows[1], 1] * G)
    assert run.start_s == pytest.approx(rows[0] / 200.0)
    assert run.fs == 200.0


def test_a_section_outside_is_refused():
    with pytest.raises(InputError, match=r"the section 20 s to 30 s of run.xyz holds no samples"):
        recording_of(log(track(fs=200.0)), start_s=20.0, stop_s=30.0)


def test_only_the_section_needs_a_sound_clock_and_values():
    stamps = np.arange(3000) / 200.0
    stamps[2000:] += 7.0
    counts = COUNTS.copy()
    counts[2500, 0] = np.nan
    broken = log(track(stamps=stamps, counts=counts))
    with pytest.raises(InputError, match=r"run.xyz row 2001: the time jumps from 9.995 s to 17 s"):
        recording_of(broken)
    assert recording_of(broken, stop_s=10.0).n_samples == 2000
    with pytest.raises(InputError, match=r"row 2501: channel .ax. has no number there: mend the log"):
        recording_of(broken, start_s=17.0)
    assert recording_of(broken, channels=["ay"], start_s=17.0).n_samples == 1000


def test_stamps_that_crowd_give_only_the_rate():
    true = np.arange(3000) / 117.0
    crowded = np.floor(true / 0.034) * 0.034
    with pytest.raises(InputError, match="stands twice in a row"):
        recording_of(log(track(stamps=crowded)), LogSettings(clock="stamps"))
    judged = recording_of(log(track(stamps=crowded)))
    assert judged.fs == pytest.approx(117.0, rel=2e-4)
    assert "some stand twice, and the samples show" in judged.history[2]
    run = recording_of(log(track(stamps=crowded)), LogSettings(clock="reconstructed"))
    assert run.fs == pytest.approx(117.0, rel=2e-4)
    assert "reconstructed: the stamps lie up to 0.0" in run.history[1]
    stated = recording_of(log(track(stamps=crowded)), LogSettings(fs_hz=117.0))
    assert (stated.fs, stated.start_s, stated.history[1]) == (
        117.0,
        0.0,
        "rate 117 Hz as the user states (time stamps are not looked at)",
    )


@pytest.mark.parametrize("clock", ["auto", "own_times"])
def test_a_value_that_nothing_measures_does_not_judge_the_stamps(clock):
    counts = COUNTS.copy()
    counts[1500, 1] = 1e200
    stamps = (np.arange(3000) + 0.3 * RNG.uniform(size=3000)) / 200.0
    with pytest.raises(InputError, match=r"run\.xyz"):
        recording_of(log(track(stamps=stamps, counts=counts)), LogSettings(clock=clock))


def test_a_log_with_several_clocks_asks_for_names_and_puts_them_on_one():
    slow = track(names=("bx",), counts=COUNTS[:1500], fs=100.0, name="slow")
    both = log(track(fs=200.0, name="fast"), slow)
    with pytest.raises(InputError, match=r"run.xyz has 2 clocks: name the channels wanted, of 'ax', 'ay', 'az', 'bx'"):
        recording_of(both)
    run = recording_of(both, channels=["bx", "ax"])
    assert (run.fs, run.names, run.n_samples) == (100.0, ("bx", "ax"), 1500)
    np.testing.assert_array_equal(run.channel("bx"), COUNTS[:1500, 0] * G)
    assert recording_of(both, channels=["bx", "ax"], fs_hz=50.0).fs == 50.0


def test_names_that_do_not_tell():
    both = log(track(fs=200.0, name="left"), track(fs=200.0, name="right"))
    assert both.names == ("left/ax", "left/ay", "left/az", "right/ax", "right/ay", "right/az")
    with pytest.raises(InputError, match=r"2 channels of run.xyz are called 'ax': write one of 'left/ax', 'right/ax'"):
        both.find("ax")
    assert both.find("right/ay") == (both.tracks[1], 1)
    assert both.find(5) == (both.tracks[1], 1)
    with pytest.raises(InputError, match=r"there is no channel 'left/aq' in run.xyz: did you mean 'left/a.'"):
        both.find("left/aq")
    with pytest.raises(InputError, match=r"no channel number 7 in run.xyz: it has 6"):
        both.find(7)


@pytest.mark.parametrize("rows_at_once", [1, 7, 1000, 5000])
def test_blocks_do_not_show(monkeypatch, rows_at_once):
    def blocks(columns):
        for first in range(0, 3000, rows_at_once):
            part = slice(first, first + rows_at_once)
            yield Block(COUNTS[part][:, list(columns)], np.arange(3000)[part] / 200.0)

    channels = tuple(LoggedChannel(name, "g") for name in ("ax", "ay", "az"))
    run = recording_of(log(Track(channels, rows_from_start(blocks))), channels=["az"], start_s=1.0, stop_s=9.0)
    np.testing.assert_array_equal(run.samples[:, 0], COUNTS[200:1800, 2] * G)


def test_a_recording_is_a_log_too():
    run = recording_from_arrays(RNG.standard_normal((2, 500)), ["a", "b"], fs=50.0, start_s=3.0)
    back = recording_of(log_of_recording(run))
    np.testing.assert_array_equal(back.samples, run.samples)
    assert (back.fs, back.start_s, back.channels) == (run.fs, run.start_s, run.channels)


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (
            LogSettings,
            {"clock": "clocks"},
            "clock is 'clocks': give one of 'auto', 'stamps', 'own_times', 'reconstructed'",
        ),
        (LogSettings, {"fs_hz": -1.0}, "fs_hz is -1: give a rate in Hz that a recorder can have"),
        (LogSettings, {"decimal": ";"}, "decimal is ';': give"),
        (LogSettings, {"time_unit": "g"}, "time_unit is 'g': give a unit of time"),
        (LogSettings, {"unit": "furlong"}, "the unit 'furlong' is not known"),
        (LogSettings, {"skip_lines": -1}, "skip_lines is -1"),
        (ChannelSettings, {"channel": "a", "scale": 0.0}, "scale is 0.0"),
        (ChannelSettings, {"channel": "a", "sign": 0}, "sign is 0: give 1 or -1"),
        (ChannelSettings, {"channel": "a", "offset": np.inf}, "offset is inf"),
        (ChannelSettings, {"channel": "a", "shift_s": np.nan}, "shift_s is nan"),
    ],
)
def test_settings_that_cannot_be(kind, values, words):
    with pytest.raises(InputError, match=words):
        kind(**values)
