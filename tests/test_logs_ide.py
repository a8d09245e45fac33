"""enDAQ recorders: recordings encoded with the maker's schema, and real ones against the maker's own reading."""

from datetime import UTC, datetime

import numpy as np
import pytest
from measured_data import SAMPLES, needs_samples
from scipy import signal
from small_logs import ide_blocks, ide_file

from opid.errors import InputError
from opid.signals.log import ChannelSettings, LogSettings
from opid.signals.logs import apart, open_log, read_log

idelib = pytest.importorskip("idelib", reason="idelib is not installed")
DAQ = SAMPLES / "DAQ12006_000005.IDE"
NAMES = ("ActTest_009", "Cloud_Test_000000", "DAQ12006_000005", "SSX66115", "SSX70065", "test3")

TICK_S = 1 / 32768


def values_of(track, *wanted):
    blocks = list(track.blocks(*wanted))
    stamps = None if blocks[0].stamps is None else np.concatenate([block.stamps for block in blocks])
    return np.concatenate([block.samples for block in blocks]), stamps


def tracks_of(path):
    return {track.name: track for track in open_log(path).tracks}


def opened(tmp_path, *blocks, **more):
    path = tmp_path / "run.IDE"
    path.write_bytes(ide_file([each for one in blocks for each in one], **more))
    return open_log(path).tracks


def blocks_on_a_clock(n_blocks, fs, *, rows=100, start_s=2.0, gaps=(), wrong_first=0, **more):
    """Values and blocks of a sensor whose recorder cuts the true times to whole ticks."""
    counts = np.arange(n_blocks)[:, None] * rows + np.arange(rows)
    times = start_s + (counts + sum(2 * (counts >= gap * rows) for gap in gaps)) / fs
    starts, ends = (np.floor(times[:, i] / TICK_S).astype(int) for i in (0, -1))
    starts[0] += wrong_first
    if more.get("modulo"):
        starts, ends = starts % (1 << 24), ends % (1 << 24)
    values = np.stack([counts, -counts], axis=2).astype(float)
    return values, times, ide_blocks(8, values, starts.tolist(), ends.tolist(), **more)


@pytest.mark.parametrize("fs", [96.6, 998.7, 5000.3, 20000.0])
def test_blocks_that_follow_one_another_have_a_rate(tmp_path, fs):
    values, times, blocks = blocks_on_a_clock(30, fs, rows=1000, wrong_first=-20)
    (track,) = opened(tmp_path, blocks)
    assert (track.name, track.n_samples) == ("gear", 30_000)
    found = track.start_s + np.arange(30_000) / track.fs
    # the stamps are cut: late by no more than a tick, and the clock lies between them
    assert (abs(found - times.ravel() + TICK_S / 2) < 0.6 * TICK_S).all()
    np.testing.assert_array_equal(values_of(track)[0], values.reshape(-1, 2))


def test_lost_samples_and_a_rate_that_changes_show_in_the_stamps(tmp_path):
    _, times, blocks = blocks_on_a_clock(6, 1000.0, gaps=(2, 4))
    (track,) = opened(tmp_path, blocks)
    stamps = values_of(track)[1]
    np.testing.assert_allclose(stamps, times.ravel(), atol=1.01 * TICK_S)
    assert (np.flatnonzero(np.diff(stamps) > 0.0025) == [199, 399]).all()
    _, _, fast = blocks_on_a_clock(2, 1000.0)
    _, _, slow = blocks_on_a_clock(2, 900.0, start_s=2.2)
    (track,) = opened(tmp_path, fast, slow)
    assert track.fs is None


def test_stamps_that_begin_again_at_zero(tmp_path):
    _, _, blocks = blocks_on_a_clock(8, 100.0, start_s=509.0, modulo=True)  # it wraps at 512 s
    (track,) = opened(tmp_path, blocks)
    assert track.start_s == pytest.approx(509.0, abs=1e-3)
    assert track.fs == pytest.approx(100.0, rel=1e-5)


def test_scales_of_time_and_calibrations(tmp_path):
    values, _, blocks = blocks_on_a_clock(5, 1000.0)
    (track,) = opened(tmp_path, blocks, scale="1/65536", calibrations=((2.0, 0.5), (-1.0, 0.0)))
    assert track.fs == pytest.approx(2000.0, rel=1e-4)
    np.testing.assert_array_equal(values_of(track)[0], values.reshape(-1, 2) * [2.0, -1.0] + [0.5, 0.0])


def test_names_that_are_used_twice(tmp_path):
    _, _, blocks = blocks_on_a_clock(2, 100.0)
    (track,) = opened(tmp_path, blocks, names=("a", "a"))
    assert [each.name for each in track.channels] == ["a", "a (2)"]


@needs_samples
@pytest.mark.parametrize("name", NAMES)
def test_values_units_and_times_are_those_of_the_maker(name):
    path = SAMPLES / f"{name}.IDE"
    log = open_log(path)
    with idelib.importFile(str(path)) as dataset:
        sensors = [channel for channel in dataset.channels.values() if len(channel.getSession())]
        assert [track.name for track in log.tracks] == [sensor.name for sensor in sensors]
        for track, sensor in zip(log.tracks, sensors, strict=True):
            times, *columns = sensor.getSession().arraySlice()
            samples, stamps = values_of(track)
            np.testing.assert_array_equal(samples, np.stack(columns, axis=1))
            assert [each.unit for each in track.channels] == [each.units[1] or None for each in sensor.children]
            if stamps is None:
                # the recorder's own stamps lie about the clock, but for the first ones
                stray = track.start_s + np.arange(track.n_samples) / track.fs - 1e-6 * times
                assert np.median(abs(stray)) < 0.05 / track.fs + 6 * TICK_S
            else:
                np.testing.assert_allclose(stamps, 1e-6 * times, atol=1.01e-6)  # which it cuts to whole microseconds


@needs_samples
def test_the_known_recording():
    tracks = tracks_of(DAQ)
    piezo, capacitive = tracks["100g PE Acceleration"], tracks["40g DC Acceleration"]
    assert [channel.name for channel in piezo.channels] == ["X (100g)", "Y (100g)", "Z (100g)", "Audio"]
    assert piezo.fs == pytest.approx(5000, rel=1e-4)
    # the first block pretends 3998 Hz; it and all others together, first stamp to last, 4038 Hz
    assert capacitive.fs == pytest.approx(4038.6, abs=0.1)
    assert (piezo.n_samples, capacitive.n_samples) == (124992, 100950)
    air = tracks["Pressure/Temperature"]
    assert [(channel.name, channel.unit) for channel in air.channels] == [("Pressure", "Pa"), ("Temperature", "°C")]
    samples, stamps = values_of(air)
    assert ((samples[:, 0] > 9e4) & (samples[:, 0] < 1.1e5)).all()
    assert np.median(np.diff(stamps)) == pytest.approx(1.0, abs=0.01)


@needs_samples
def test_two_rates_of_one_recording_come_onto_a_common_clock():
    both = {"piezo": ChannelSettings("X (100g)"), "capacitive": ChannelSettings("X (40g)")}
    run = read_log(DAQ, channels=both, stop_s=12.0)
    assert run.fs == pytest.approx(4038.6, abs=0.1)
    assert any("resampled from 5000" in words for words in run.history)
    assert {channel.unit for channel in run.channels} == {"m/s^2"}
    # both sensors sit on one board, one the other way round: they must agree at once, not some samples later
    sections = signal.butter(4, [5, 300], "band", fs=run.fs, output="sos")
    a, b = signal.sosfiltfilt(sections, run.samples, axis=0)[:48000].T
    agreement = signal.correlate(a, b) / np.sqrt((a @ a) * (b @ b))
    lags_s = signal.correlation_lags(a.size, b.size) / run.fs
    near = abs(lags_s) < 4e-3  # the shaker ran at 100 Hz: a period later they agree again
    best = int(abs(agreement[near]).argmax())
    assert agreement[near][best] < -0.97
    assert abs(lags_s[near][best]) < 0.6e-3


@needs_samples
def test_what_a_lower_rate_cannot_hold_is_taken_out_first():
    run = read_log(DAQ, channels=["X (100g)", "X (40g)"], stop_s=12.0, fs_hz=150.0)
    whole = read_log(DAQ, channels=["X (100g)"], start_s=run.start_s, stop_s=12.0).samples[:, 0]
    power = {
        name: signal.welch(samples, fs, nperseg=round(fs))[1]
        for name, samples, fs in (
            ("written", whole, 5000.0),
            ("every 33rd", whole[::33], 5000.0 / 33),
            ("resampled", run.channel("X (100g)"), 150.0),
        )
    }
    # the shaker's 100 Hz stand above the new Nyquist frequency of 75 Hz, and would fold to 50 Hz
    assert power["written"][98:103].sum() > 1000 * power["written"][48:53].sum()
    assert power["every 33rd"][48:54].sum() > 1000 * power["written"][48:53].sum()
    np.testing.assert_allclose(power["resampled"][1:58], power["written"][1:58], rtol=0.1)
    assert power["resampled"][73:].max() < 1e-2 * power["written"][73:76].max()


@needs_samples
def test_a_sensor_that_loses_samples_keeps_its_stamps():
    rotation = tracks_of(SAMPLES / "test3.IDE")["Rotation"]
    assert rotation.fs is None
    steps = np.diff(values_of(rotation)[1])
    assert np.median(steps) == pytest.approx(1 / 3198.6, rel=1e-4)
    assert (steps > 1.5 / 3198.6).sum() == 28  # two samples are lost at the end of each block
    with pytest.raises(InputError, match=r"test3\.IDE row 1119: the time jumps"):
        read_log(SAMPLES / "test3.IDE", LogSettings(clock="stamps"), channels=["Rotation/X"])
    judged = read_log(SAMPLES / "test3.IDE", channels=["Rotation/X"])
    assert any("lost row(s) were interpolated" in line for line in judged.history)
    run = read_log(SAMPLES / "test3.IDE", LogSettings(clock="reconstructed"), channels=["Rotation/X"])
    assert run.fs == pytest.approx(3193, abs=1)


@needs_samples
@pytest.mark.parametrize(("start", "stop"), [(0, 1), (1343, 1346), (100_000, 124_992), (124_991, None), (7, 7)])
def test_any_rows_of_any_columns(start, stop):
    piezo = tracks_of(DAQ)["100g PE Acceleration"]
    whole, _ = values_of(piezo)
    found = [block.samples for block in piezo.blocks([3, 1], start, stop)]
    np.testing.assert_array_equal(np.concatenate([np.empty((0, 2)), *found]), whole[start:stop, [3, 1]])


@needs_samples
def test_nothing_is_printed(capsys):
    for name in NAMES:
        list(open_log(SAMPLES / f"{name}.IDE").tracks[0].blocks(stop=10))
    assert capsys.readouterr() == ("", "")


@needs_samples
def test_a_recording_that_is_cut_off(tmp_path):
    whole = DAQ.read_bytes()
    path = tmp_path / "cut.IDE"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.IDE is cut off or damaged after 1126458 of 1126458 bytes"):
        open_log(path)


@needs_samples
@pytest.mark.parametrize("text", [b"9**9**9*9", b"__doc__ ", b"1,2,3"])
def test_a_scale_of_the_stamps_that_is_no_number(tmp_path, monkeypatch, text):
    """The scale is a text of arithmetic, which the maker's library computes."""
    open_log(DAQ)  # loads the library
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=1, bytes_per_s=5e6))
    whole = DAQ.read_bytes()
    path = tmp_path / "scale.IDE"
    path.write_bytes(whole.replace(b"1.0/32768", text.ljust(9)))
    with pytest.raises(InputError, match=r"scale\.IDE (is no sound IDE file|holds no channel)"):
        open_log(path)


@pytest.mark.parametrize(
    ("since_1970_s", "zero"), [(1_714_557_600, datetime(2024, 5, 1, 10, tzinfo=UTC)), (1497, None), (None, None)]
)
def test_a_clock_that_was_set_is_the_zero(tmp_path, since_1970_s, zero):
    _, _, blocks = blocks_on_a_clock(3, 1000.0)
    stated = [] if since_1970_s is None else [("TimeBaseUTC", since_1970_s)]
    path = tmp_path / "run.IDE"
    path.write_bytes(ide_file([*stated, *blocks]))
    assert open_log(path).zero == zero


@needs_samples
def test_real_recorders_know_when_they_began():
    assert open_log(DAQ).zero == datetime(2021, 12, 22, 17, 15, 44, tzinfo=UTC)
    assert open_log(SAMPLES / "ActTest_009.IDE").zero is None  # its clock began in 1970
