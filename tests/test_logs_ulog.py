"""PX4 flight logs: bytes put together by hand after the published format, and real flights."""

import struct
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from measured_data import SAMPLES, needs_samples

from opid.errors import InputError
from opid.signals.log import ChannelSettings
from opid.signals.logs import apart, open_log, read_log

pytest.importorskip("pyulog", reason="pyulog is not installed")

START_US = 5_000_000


def message(kind, content):
    return struct.pack("<HB", len(content), ord(kind)) + content


def head(*formats, start_us=START_US, flags=b""):
    definitions = b"".join(message("F", form.encode()) for form in formats)
    return b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us) + flags + definitions


def subscription(number, topic, instance=0):
    return message("A", struct.pack("<BH", instance, number) + topic.encode())


def accel_log(n=200, step_us=4000, instance=0, first_us=START_US + 1000):
    stamps = first_us + step_us * np.arange(n)
    values = np.random.default_rng(1).standard_normal((n, 3)).astype(np.float32)
    data = [
        message("D", struct.pack("<HQ3fh", 7, stamp, *row, i))
        for i, (stamp, row) in enumerate(zip(stamps.tolist(), values.tolist(), strict=True))
    ]
    log = head("sensor_accel:uint64_t timestamp;float x;float y;float z;int16_t clips;uint8_t[2] _padding0;")
    return log + subscription(7, "sensor_accel", instance) + b"".join(data), stamps, values


def opened(tmp_path, content):
    path = tmp_path / "flight.ulg"
    path.write_bytes(content)
    return open_log(path)


def values_of(track):
    blocks = list(track.blocks())
    return np.concatenate([block.samples for block in blocks]), np.concatenate([block.stamps for block in blocks])


def test_values_units_and_times_since_the_start(tmp_path):
    content, stamps, values = accel_log()
    (track,) = opened(tmp_path, content).tracks
    assert (track.name, track.fs, track.n_samples) == ("sensor_accel", None, 200)
    assert [(each.name, each.unit) for each in track.channels] == [
        ("x", "m/s^2"),
        ("y", "m/s^2"),
        ("z", "m/s^2"),
        ("clips", None),
    ]
    samples, times = values_of(track)
    np.testing.assert_array_equal(samples[:, :3], values)
    np.testing.assert_array_equal(samples[:, 3], np.arange(200))
    np.testing.assert_allclose(times, (stamps - START_US) * 1e-6, rtol=1e-14)
    run = read_log(tmp_path / "flight.ulg", channels={"upper_z": ChannelSettings("z")})
    assert (run.fs, run.start_s) == (250.0, 0.001)


def test_topics_instances_and_nested_fields(tmp_path):
    content = head(
        "inner:float[2] delta_rad_s;int8_t flag;",
        "outer:uint64_t timestamp;inner[2] part;float gyro_rad;",
        "sensor_gyro:uint64_t timestamp;float x;",
    )
    content += subscription(1, "outer") + subscription(2, "sensor_gyro") + subscription(3, "sensor_gyro", 1)
    content += message("D", struct.pack("<HQ2fb2fbf", 1, START_US - 500, 1, 2, 3, 4, 5, 6, 7))
    content += message("D", struct.pack("<HQf", 2, START_US, 1.5)) + message("D", struct.pack("<HQf", 3, START_US, 2.5))
    log = opened(tmp_path, content)
    assert [track.name for track in log.tracks] == ["outer", "sensor_gyro", "sensor_gyro_1"]
    outer = log.tracks[0]
    assert [(each.name, each.unit) for each in outer.channels] == [
        ("part[0].delta_rad_s[0]", "rad/s"),
        ("part[0].delta_rad_s[1]", "rad/s"),
        ("part[0].flag", None),
        ("part[1].delta_rad_s[0]", "rad/s"),
        ("part[1].delta_rad_s[1]", "rad/s"),
        ("part[1].flag", None),
        ("gyro_rad", "rad/s"),
    ]
    samples, times = values_of(outer)
    assert samples.tolist() == [[1, 2, 3, 4, 5, 6, 7]]
    assert times.tolist() == [-0.0005]  # before the log's own start
    assert log.find("sensor_gyro_1/x")[0].channels[0].unit == "rad/s"


def test_a_dropout_shows_as_a_gap(tmp_path):
    before, _, _ = accel_log(100)
    after, _, _ = accel_log(100, first_us=START_US + 1000 + 150 * 4000)
    content = before + message("O", struct.pack("<H", 200)) + after[len(after) - 100 * 27 :]
    _, times = values_of(opened(tmp_path, content).tracks[0])
    np.testing.assert_allclose(np.diff(times), np.where(np.arange(199) == 99, 51 * 0.004, 0.004), atol=1e-9)
    with pytest.raises(InputError, match=r"flight\.ulg row 101: the time jumps"):
        read_log(tmp_path / "flight.ulg", channels=["x"])


def test_a_last_message_that_is_not_whole_is_left_out(tmp_path):
    content, _, values = accel_log()
    samples, _ = values_of(opened(tmp_path, content[:-5]).tracks[0])
    np.testing.assert_array_equal(samples[:, :3], values[:-1])


NESTED = [f"a{i}:a{i + 1}[60000] x;" for i in range(12)]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (head(*NESTED, "a12:float x;") + subscription(1, "a0"), "no sound ULog file"),
        (head("a:b x;", "b:a x;") + subscription(1, "a"), "no sound ULog file"),
        (head("a:uint64_t timestamp;") + subscription(1, "a"), "holds no channel with numbers"),
        (head(), "holds no channel with numbers"),
        (accel_log()[0] + message("D", struct.pack("<H", 9)), "has broken messages"),
        (accel_log()[0] + message("D", struct.pack("<HQ", 7, 1)), "has broken messages"),
        (accel_log()[0] + message("\0", b"x"), "has broken messages"),
    ],
    ids=["vast", "circle", "no data", "no topic", "unknown topic", "short message", "unknown kind"],
)
def test_what_no_recorder_writes(tmp_path, content, words, capsys, monkeypatch):
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=3))
    with pytest.raises(InputError, match=words) as caught:
        opened(tmp_path, content)
    assert "flight.ulg" in str(caught.value)
    assert capsys.readouterr() == ("", "")


@needs_samples
def test_a_real_flight():
    log = open_log(SAMPLES / "sample.ulg")
    track = next(each for each in log.tracks if each.name == "sensor_combined")
    assert track.n_samples == 17070
    units = {each.name: each.unit for each in track.channels}
    assert units["accelerometer_m_s2[2]"] == "m/s^2"
    assert units["gyro_rad[0]"] == "rad/s"
    assert units["magnetometer_ga[0]"] is None
    samples, times = values_of(track)
    assert np.median(np.diff(times)) == pytest.approx(0.004, abs=1e-5)
    assert times[-1] - times[0] == pytest.approx(68.9, abs=0.05)
    gravity = samples[:, list(units).index("accelerometer_m_s2[2]")].mean()
    assert gravity == pytest.approx(-9.8, abs=0.3)


@needs_samples
def test_another_real_flight_has_instances():
    names = [track.name for track in open_log(SAMPLES / "sample_log_small.ulg").tracks]
    assert len(names) == len(set(names)) == 70
    assert {"sensor_accel", "sensor_accel_1", "sensor_accel_2", "vehicle_angular_velocity"} <= set(names)


def gps_log(fixes, topic="vehicle_gps_position"):
    """Stamp since the start, UTC (both in microseconds) and kind of fix of each message."""
    content = head(f"{topic}:uint64_t timestamp;uint64_t time_utc_usec;uint8_t fix_type;") + subscription(1, topic)
    return content + b"".join(message("D", struct.pack("<HQQB", 1, START_US + at, *fix)) for at, *fix in fixes)


def test_a_receiver_with_a_fix_gives_the_zero(tmp_path):
    began = datetime(2024, 5, 1, 10, 0, 0, 125_000, tzinfo=UTC)
    since_1970_us = int(began.timestamp() * 1e6)
    without = [(-1000, 0, 0), (0, 5_000_000, 3), (1000, since_1970_us + 7_000_000, 1)]
    late = [(200_000 * k + 3000 * (k == 3), since_1970_us + 200_000 * k, 3) for k in range(1, 6)]
    for topic in ("vehicle_gps_position", "sensor_gps"):
        assert opened(tmp_path, gps_log(without + late, topic)).zero == began
        assert opened(tmp_path, gps_log(without, topic)).zero is None
    assert opened(tmp_path, accel_log()[0]).zero is None


@needs_samples
def test_a_real_flight_knows_when_it_began():
    # its first message with a fix: 2021-04-21 06:30:58.600345 UTC
    zero = open_log(SAMPLES / "sample_log_small.ulg").zero
    assert abs(zero - datetime(2021, 4, 21, 6, 30, 58, 450_000, tzinfo=UTC)) < timedelta(milliseconds=20)
    assert open_log(SAMPLES / "sample.ulg").zero is None
