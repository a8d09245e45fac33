"""LabVIEW TDMS: what the library's writer wrote comes back, on the clock that its properties state."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from measured_data import SAMPLES, needs_samples

from opid.errors import InputError
from opid.signals.log import ChannelSettings, LoggedChannel, LogSettings
from opid.signals.logs import open_log, read_log

nptdms = pytest.importorskip("nptdms", reason="npTDMS is not installed")

START = np.datetime64("2024-05-01T10:00:00.000000", "us")
RNG = np.random.default_rng(0)


def channel(group, name, values, **properties):
    return nptdms.ChannelObject(group, name, np.asarray(values), properties=properties)


def written(path, *segments):
    with nptdms.TdmsWriter(path) as writer:
        for segment in segments:
            writer.write_segment(segment)
    return path


def values_of(track):
    blocks = list(track.blocks())
    stamps = None if blocks[0].stamps is None else np.concatenate([block.stamps for block in blocks])
    return np.concatenate([block.samples for block in blocks]), stamps


def test_rate_unit_and_values_of_channels_in_several_segments(tmp_path):
    one, two = RNG.standard_normal((2, 3000))
    facts = {"wf_increment": 1 / 51.2, "wf_start_offset": 0.25, "wf_start_time": START}
    segments = [
        [
            channel("gear", "lower", one[part], **facts, unit_string="g"),
            channel("gear", "upper", two[part], **facts, NI_UnitDescription="m/s^2"),
        ]
        for part in (slice(0, 1000), slice(1000, 1001), slice(1001, 3000))
    ]
    (track,) = open_log(written(tmp_path / "run.tdms", *segments)).tracks
    assert (track.fs, track.start_s, track.n_samples, track.name) == (51.2, 0.25, 3000, "")
    assert track.channels == (LoggedChannel("lower", "g"), LoggedChannel("upper", "m/s^2"))
    samples, stamps = values_of(track)
    np.testing.assert_array_equal(samples, np.stack([one, two], axis=1))
    assert stamps is None
    part = list(track.blocks([1], 990, 1010))
    np.testing.assert_array_equal(part[0].samples[:, 0], two[990:1010])


def test_groups_of_several_rates_and_starts_keep_one_origin(tmp_path):
    later = START + np.timedelta64(1_500_000, "us")
    log = open_log(
        written(
            tmp_path / "run.tdms",
            [
                channel("slow", "a", np.arange(10.0), wf_increment=0.1, wf_start_time=later),
                channel("fast", "a", np.arange(50.0), wf_increment=0.01, wf_start_time=START),
                channel("fast", "b", np.arange(20.0), wf_increment=0.01, wf_start_time=START),
            ],
        )
    )
    found = {track.name: (track.fs, track.start_s, track.n_samples) for track in log.tracks}
    assert found == {"slow": (10.0, 1.5, 10), "fast": (100.0, 0.0, 50), "fast (2)": (100.0, 0.0, 20)}
    assert sorted(log.names) == ["b", "fast/a", "slow/a"]


@pytest.mark.parametrize("scaled", [True, False])
def test_the_scaling_is_that_of_the_file(tmp_path, scaled):
    counts = np.arange(-100, 100, dtype=np.int16)
    scale = {
        "NI_Scaling_Status": "unscaled",
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.5,
        "NI_Scale[0]_Linear_Y_Intercept": 3.0,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }
    path = written(tmp_path / "run.tdms", [channel("g", "a", counts, wf_increment=0.01, **(scale if scaled else {}))])
    samples, _ = values_of(open_log(path).tracks[0])
    np.testing.assert_array_equal(samples[:, 0], 0.5 * counts + 3.0 if scaled else counts)


def test_a_channel_of_dates_gives_the_stamps(tmp_path):
    steps_us = np.cumsum(np.full(100, 1250))
    dates = START + steps_us.astype("timedelta64[us]")
    path = written(tmp_path / "run.tdms", [channel("g", "when", dates), channel("g", "a", np.arange(100.0))])
    (track,) = open_log(path).tracks
    assert (track.fs, track.channels) == (None, (LoggedChannel("a"),))
    np.testing.assert_allclose(values_of(track)[1], (steps_us - 1250) * 1e-6, atol=1e-12)
    assert read_log(path, LogSettings(unit="g")).fs == 800.0


@pytest.mark.parametrize(
    ("name", "unit", "settings"),
    [
        ("Time", "ms", LogSettings()),
        ("time (ms)", None, LogSettings()),
        ("host", "s", LogSettings(time="host", time_unit="ms")),
        ("host", "ms", LogSettings(time=1)),
    ],
)
def test_a_channel_called_time_gives_the_stamps(tmp_path, name, unit, settings):
    time = channel("g", name, np.arange(50) * 4.0, **({} if unit is None else {"unit_string": unit}))
    other = channel("h", "other", np.arange(5.0), wf_increment=1.0)
    path = written(tmp_path / "run.tdms", [time, channel("g", "a", np.arange(50.0)), other])
    track = open_log(path, settings).tracks[0]
    assert (track.fs, [each.name for each in track.channels]) == (None, ["a"])
    np.testing.assert_allclose(values_of(track)[1], np.arange(50) * 0.004)


def test_texts_empty_channels_and_copies_for_displays_are_left_out(tmp_path):
    path = written(
        tmp_path / "run.tdms",
        [
            channel("g", "a", np.arange(5.0), wf_increment=0.1),
            channel("g", "remarks", np.array(["x", "y", "z", "x", "y"])),
            channel("g", "empty", np.array([], dtype=np.float64)),
            nptdms.GroupObject("fewer", properties={"DecimationLevel": 1}),
            channel("fewer", "a", np.arange(2.0), wf_increment=0.25),
        ],
    )
    assert open_log(path).names == ("a",)


def test_what_states_no_rate_asks_for_one(tmp_path):
    path = written(tmp_path / "run.tdms", [channel("g", "a", np.arange(100.0), unit_string="g")])
    with pytest.raises(InputError, match="neither a rate nor time stamps: give fs_hz"):
        read_log(path)
    assert read_log(path, LogSettings(fs_hz=100.0)).fs == 100.0


def test_an_absurd_rate_and_a_wrong_time_are_named(tmp_path):
    path = written(tmp_path / "run.tdms", [channel("g", "a", np.arange(100.0), wf_increment=-1e-3, unit_string="g")])
    with pytest.raises(InputError, match=r"run\.tdms group 'g' states a rate of -1000 Hz: give the true one as fs_hz"):
        open_log(path)
    assert read_log(path, LogSettings(fs_hz=1000.0)).fs == 1000.0
    with pytest.raises(InputError, match=r"run\.tdms has no channel 'b'"):
        open_log(path, LogSettings(time="b"))


def test_the_index_beside_it_is_not_believed(tmp_path):
    path = written(tmp_path / "run.tdms", [channel("g", "a", np.arange(5.0), wf_increment=0.1)])
    (tmp_path / "run.tdms_index").write_bytes(b"TDSh" + bytes(40))
    assert values_of(open_log(path).tracks[0])[0].shape == (5, 1)


@needs_samples
def test_real_samples():
    big, stamps, digital, raw = (
        open_log(SAMPLES / f"{name}.tdms") for name in ("big_endian", "raw_timestamps", "Digital_Input", "raw1")
    )
    assert [len(log.tracks) for log in (big, stamps, digital, raw)] == [1, 1, 1, 1]
    track = big.tracks[0]
    assert (track.fs, track.n_samples, big.names) == (1000.0, 3500, ("Amplitude sweep", "Phase sweep"))
    samples, _ = values_of(track)
    # LabVIEW's example: a sine of growing amplitude, and one of amplitude 1 whose phase moves on
    assert abs(samples[:500, 0]).max() < abs(samples[-500:, 0]).max()
    np.testing.assert_allclose(abs(samples[:, 1]).max(), 1.0, atol=1e-3)
    np.testing.assert_allclose(
        values_of(stamps.tracks[0])[0][:, 0], np.sin(2 * np.pi * np.arange(128) / 128), atol=1e-12
    )
    track = digital.tracks[0]
    assert (track.fs, track.n_samples) == (2000.0, 20000)  # 10 s, as the file says in `log-duration`
    assert set(np.unique(values_of(track)[0])) == {0.0, 1.0}


@needs_samples
def test_raw_counts_of_a_real_sample_are_volts():
    run = read_log(SAMPLES / "raw1.tdms", channels={"a": ChannelSettings("Third Chan"), "b": ChannelSettings(1)})
    assert (run.fs, run.n_samples) == (50000.0, 2000)
    assert {channel.unit for channel in run.channels} == {"V"}
    steps = run.samples / 0.0003051850947599719  # 10 V over 32767 counts
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def zero_of(path, *channels):
    return open_log(written(path / "run.tdms", list(channels))).zero


def test_the_earliest_start_is_the_zero(tmp_path):
    later = START + np.timedelta64(1_500_001, "us")
    values = np.arange(10.0)
    zero = datetime(2024, 5, 1, 10, tzinfo=UTC)
    slow = channel("slow", "a", values, wf_increment=0.1, wf_start_time=later)
    fast = channel("fast", "a", values, wf_increment=0.1, wf_start_time=START)
    assert zero_of(tmp_path, slow, fast) == zero
    assert zero_of(tmp_path, slow) == zero + timedelta(microseconds=1_500_001)
    dates = START + np.arange(10) * np.timedelta64(1000, "us")
    assert zero_of(tmp_path, channel("gear", "stamp", dates), channel("gear", "a", values)) == zero
    assert zero_of(tmp_path, channel("gear", "a", values, wf_increment=0.1)) is None
    unset = np.datetime64("1904-01-01T00:00:00", "us")
    assert zero_of(tmp_path, channel("gear", "a", values, wf_increment=0.1, wf_start_time=unset)) is None
    # the numbers of a channel called time count from what only their writer knows
    dated = channel("gear", "a", values, wf_start_time=START)
    assert zero_of(tmp_path, channel("gear", "time", values), dated) is None
