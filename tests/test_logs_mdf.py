"""ASAM MDF: what the library appended and saved comes back, group by group on its own master."""

import os
import tempfile
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from measured_data import measured

from opid.errors import InputError
from opid.signals.log import AS_WRITTEN, ChannelSettings
from opid.signals.logs import open_log, read_log
from opid.signals.logs.mdf import open_mdf

asammdf = pytest.importorskip("asammdf", reason="asammdf is not installed")
SAMPLE = "reader_samples/ASAP2_Demo_V171.mf4"

RNG = np.random.default_rng(0)


def signal(name, samples, stamps, unit="", **more):
    return asammdf.Signal(samples=np.asarray(samples), timestamps=stamps, name=name, unit=unit, **more)


def saved(path, *groups, version="4.10", compression=0):
    with asammdf.MDF(version=version) as file:
        for name, signals in groups:
            file.append(signals, acq_name=name, comment=name, common_timebase=True)
        file.save(path, overwrite=True, compression=compression)
    return path


def values_of(track, *wanted):
    blocks = list(track.blocks(*wanted))
    stamps = None if blocks[0].stamps is None else np.concatenate([block.stamps for block in blocks])
    return np.concatenate([block.samples for block in blocks]), stamps


@pytest.mark.parametrize(
    ("ending", "version", "compression"), [("mf4", "4.10", 0), ("mf4", "4.11", 2), ("mdf", "3.30", 0)]
)
def test_groups_are_tracks_on_their_own_stamps(tmp_path, ending, version, compression):
    fast, slow = np.arange(5000) / 512.0, 0.5 + np.arange(40) / 4.0
    a = RNG.standard_normal((2, 5000))
    counts = RNG.integers(-100, 100, 5000).astype(np.int16)
    path = saved(
        tmp_path / f"run.{ending}",
        ("wheels", [signal("lower", a[0], fast, "m/s^2"), signal("upper", a[1], fast, "g"), signal("n", counts, fast)]),
        ("cabin", [signal("lower", np.arange(40.0), slow, "degC")]),
        version=version,
        compression=compression,
    )
    log = open_log(path)
    assert log.format == "MDF"
    wheels, cabin = log.tracks
    assert [(each.name, each.unit) for each in wheels.channels] == [("lower", "m/s^2"), ("upper", "g"), ("n", None)]
    assert (wheels.n_samples, wheels.fs, cabin.n_samples) == (5000, None, 40)
    samples, stamps = values_of(wheels)
    np.testing.assert_array_equal(samples, np.stack([*a, counts], axis=1))
    np.testing.assert_array_equal(stamps, fast)
    np.testing.assert_array_equal(values_of(cabin)[1], slow)
    part, stamps = values_of(wheels, [2, 0], 4000, 4003)
    np.testing.assert_array_equal(part, np.stack([counts, a[0]], axis=1)[4000:4003])
    np.testing.assert_array_equal(stamps, fast[4000:4003])


def test_two_groups_come_onto_a_common_clock(tmp_path):
    fast, slow = np.arange(5120) / 512.0, 0.5 + np.arange(1000) / 128.0
    sine = [np.sin(2 * np.pi * 3 * t) for t in (fast, slow)]
    path = saved(
        tmp_path / "run.mf4", ("a", [signal("x", sine[0], fast, "g")]), ("b", [signal("x", sine[1], slow, "g")])
    )
    run = read_log(path, channels={"fast": ChannelSettings("a/x"), "slow": ChannelSettings("b/x")})
    assert (run.fs, run.start_s) == (128.0, 0.5)
    np.testing.assert_allclose(run.channel("fast"), run.channel("slow"), atol=0.01)


def test_more_records_than_are_read_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("opid.signals.log.BLOCK_VALUES", 1)
    stamps = np.arange(5000) / 100.0
    path = saved(tmp_path / "run.mf4", ("a", [signal("x", np.arange(5000.0), stamps)]), compression=1)
    (track,) = open_mdf(path, AS_WRITTEN).tracks
    assert [block.samples.shape[0] for block in track.blocks()] == [1024] * 4 + [904]
    np.testing.assert_array_equal(values_of(track)[0][:, 0], np.arange(5000.0))


def test_invalid_values_are_nan_and_keep_their_place(tmp_path):
    stamps = np.arange(10) / 10.0
    invalid = np.arange(10) % 4 == 1
    path = saved(tmp_path / "run.mf4", ("a", [signal("x", np.arange(10.0), stamps, "g", invalidation_bits=invalid)]))
    samples, times = values_of(open_log(path).tracks[0])
    np.testing.assert_array_equal(samples[:, 0], np.where(invalid, np.nan, np.arange(10.0)))
    np.testing.assert_array_equal(times, stamps)


def test_linear_conversions_are_applied_and_texts_left_out(tmp_path):
    stamps = np.arange(10) / 10.0
    counts = np.arange(10, dtype=np.uint8)
    words = {f"val_{i}": i for i in range(10)} | {f"text_{i}": f"gear {i}" for i in range(10)}
    path = saved(
        tmp_path / "run.mf4",
        (
            "a",
            [
                signal("scaled", counts, stamps, "g", conversion={"a": 0.5, "b": -1.0}),
                signal("gear", counts, stamps, conversion=words),
                signal("text", np.array([b"x"] * 10), stamps, encoding="utf-8"),
            ],
        ),
    )
    log = open_log(path)
    assert log.names == ("scaled",)
    np.testing.assert_array_equal(values_of(log.tracks[0])[0][:, 0], 0.5 * counts - 1.0)


def test_names_that_are_used_twice(tmp_path):
    stamps = np.arange(10) / 10.0
    one = [signal("x", np.arange(10.0), stamps), signal("x", -np.arange(10.0), stamps)]
    log = open_log(saved(tmp_path / "run.mf4", ("a", one), ("a", one[:1])))
    assert log.names == ("a/x", "x (2)", "a (2)/x")
    np.testing.assert_array_equal(values_of(log.tracks[0])[0][:, 1], -np.arange(10.0))


def test_a_file_that_its_recorder_did_not_finish(tmp_path):
    path = saved(tmp_path / "run.mf4", ("a", [signal("x", np.arange(10.0), np.arange(10.0))]))
    whole = path.read_bytes()
    for changed in (b"UnFinMF " + whole[8:], whole[:60] + b"\x01\x00" + whole[62:]):
        path.write_bytes(changed)
        with pytest.raises(InputError, match=r"run\.mf4 was not finished by its recorder"):
            open_log(path)
        assert path.read_bytes() == changed


def test_no_temporary_file_stays(tmp_path, monkeypatch):
    path = saved(tmp_path / "run.mf4", ("a", [signal("x", np.arange(10.0), np.arange(10.0))]))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", os.fspath(scratch))
    list(open_mdf(path, AS_WRITTEN).tracks[0].blocks())
    assert list(scratch.iterdir()) == []


def test_the_demo_of_the_standard():
    tracks = {track.name: track for track in open_log(measured(SAMPLE)).tracks}
    assert {name: track.n_samples for name, track in tracks.items() if "_" in name} == {
        "100ms_sync": 124,
        "10ms_sync": 1240,
        "Engine_1": 12402,
        "Engine_2": 12402,
        "Engine_3": 12402,
        "Leading_All": 12402,
    }
    for name, period_s in (("100ms_sync", 0.1), ("10ms_sync", 0.01), ("Engine_1", 0.001)):
        samples, stamps = values_of(tracks[name])
        assert np.isfinite(samples).mean() > 0.99  # one conversion divides by zero
        assert np.median(np.diff(stamps)) == pytest.approx(period_s, rel=1e-4)
    assert not {"time"} & {each.name for each in tracks["Engine_1"].channels}


def began(path, version, **header):
    with asammdf.MDF(version=version) as file:
        file.append([signal("a", np.arange(3.0), np.arange(3.0))])
        for name, value in header.items():
            setattr(file.header, name, value)
        file.save(path, overwrite=True)
    return open_log(path).zero


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_the_start_of_the_measurement_is_the_zero(tmp_path, version):
    path = tmp_path / ("run.mf4" if version == "4.10" else "run.mdf")
    noon = datetime(2024, 5, 1, 12, 0, 7, 250_000)
    if version == "4.10":
        zoned = noon.replace(tzinfo=timezone(timedelta(hours=2)))
        assert began(path, version, start_time=zoned) == zoned.astimezone(UTC)
        assert began(path, version, start_time=noon) == noon
        assert began(path, version, abs_time=0, time_flags=0) is None
        return
    texts = {"date": b"01:05:2024", "time": b"12:00:07"}
    for zone_h in (0, 2, -7):  # some write local time here, some UTC
        since_1970_s = int(noon.replace(tzinfo=UTC).timestamp()) - 3600 * zone_h
        assert began(path, version, **texts, abs_time=since_1970_s * 10**9 + 250_000_000, tz_offset=zone_h) == noon
    assert began(path, version, **texts, abs_time=0) == noon.replace(microsecond=0)
    assert began(path, version, date=b"00:00:0000", time=b"00:00:00", abs_time=0) is None


def test_the_real_measurement_began_when_its_header_says():
    assert open_log(measured(SAMPLE)).zero == datetime(2018, 11, 22, 14, 26, 35, 439_737, tzinfo=UTC)
