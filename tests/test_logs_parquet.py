"""Parquet logs from pyarrow and pandas: which column is what, and files that are at fault."""

import datetime
import json
from contextlib import suppress

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
import pytest

from opid.errors import InputError
from opid.signals.log import BLOCK_VALUES, LogSettings
from opid.signals.logs import open_log, read_log

N, FS = 600, 500.0
RNG = np.random.default_rng(5)
DATA = RNG.standard_normal((N, 3))
TIME = np.arange(N) / FS
START = 1_714_557_600_123_456_789  # ns since 1970


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.parquet"


def save(path, columns, *, metadata=None, units=None, **more):
    """Write columns with the units in the metadata of their fields."""
    arrays = {name: pyarrow.array(values) for name, values in columns.items()}
    fields = [
        pyarrow.field(name, array.type, metadata={"unit": units[name]} if units and name in units else None)
        for name, array in arrays.items()
    ]
    schema = pyarrow.schema(fields, metadata=metadata)
    pyarrow.parquet.write_table(pyarrow.table(list(arrays.values()), schema=schema), path, **more)


def channels(log):
    return [(channel.name, channel.unit) for channel in log.tracks[0].channels]


def test_columns_of_numbers_are_channels(path):
    table = {"a.z [g]": DATA[:, 0], "Time [ms]": TIME * 1e3, "b": DATA[:, 1].astype(np.float32), "note": ["x"] * N}
    save(path, table | {"adc": np.arange(N, dtype=np.int16), "on": TIME > 0.5}, units={"b": "m/s^2"})
    log = open_log(path)
    assert (log.format, log.tracks[0].n_samples) == ("Parquet", N)
    assert channels(log) == [("a.z", "g"), ("b", "m/s^2"), ("adc", None), ("on", None)]
    run = read_log(path, channels=["b", "a.z"])
    assert run.fs == FS
    np.testing.assert_array_equal(run.samples, np.stack([DATA[:, 1].astype(np.float32), DATA[:, 0] * 9.80665], 1))
    (block,) = log.tracks[0].blocks([3, 2], 248, 252)
    assert block.samples.tolist() == [[0, 248], [0, 249], [0, 250], [1, 251]]


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Vienna"])
def test_dates_become_seconds_from_the_first(path, unit, zone):
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    step = 2 * ticks // 1000 or 1
    whole = pyarrow.array(START // 10**9 * ticks + 7 + step * np.arange(N)).cast(pyarrow.timestamp(unit, zone))
    save(path, {"when": whole, "z [g]": DATA[:, 0]})
    (block,) = open_log(path).tracks[0].blocks()
    np.testing.assert_array_equal(block.stamps, np.arange(N) * step * (1 / ticks))
    assert read_log(path).fs == (1.0 if unit == "s" else FS)


def require_attributes(path):
    """Older libraries write a frame without its attributes: then there is nothing to read."""
    if not json.loads(pyarrow.parquet.read_schema(path).metadata[b"pandas"]).get("attributes"):
        pytest.skip("this version of pyarrow writes no attributes of a frame")


def test_the_index_of_a_frame_is_the_time(path):
    index = pandas.Timestamp(START) + pandas.to_timedelta(TIME, unit="s")
    frame = pandas.DataFrame({"z": DATA[:, 0], "t0": 3.0}, index=index)
    frame.attrs["units"] = {"z": "g", "t0": "N"}
    frame.to_parquet(path)
    require_attributes(path)
    assert channels(open_log(path)) == [("z", "g"), ("t0", "N")]
    assert read_log(path).fs == FS
    frame.index = TIME
    frame.to_parquet(path)
    assert read_log(path).fs == FS
    frame.index = pandas.to_timedelta(TIME + 2, unit="s")
    frame.to_parquet(path)
    assert (read_log(path).fs, read_log(path).start_s) == (FS, 2.0)


def test_the_rate_may_stand_in_the_metadata(path):
    save(path, {"z [g]": DATA[:, 0]}, metadata={"Fs": "512"})
    assert (open_log(path).tracks[0].fs, read_log(path).fs) == (512.0, 512.0)
    frame = pandas.DataFrame({"z [g]": DATA[:, 0]})
    frame.attrs["dt"] = 0.002
    frame.to_parquet(path)
    require_attributes(path)
    assert read_log(path).fs == 500.0


def test_without_rate_and_stamps_the_rate_is_asked_for(path):
    save(path, {"z [g]": DATA[:, 0]})
    with pytest.raises(InputError, match="neither a rate nor time stamps: give fs_hz"):
        read_log(path)
    assert read_log(path, LogSettings(fs_hz=50)).fs == 50.0


def test_the_settings_override_what_is_found(path):
    save(path, {"clock": TIME * 2, "time": TIME, "z": DATA[:, 0], "note": ["x"] * N})
    for time in ("clock", 1):
        assert read_log(path, LogSettings(time=time, unit="g")).fs == FS / 2
    assert read_log(path, LogSettings(unit="g", time_unit="ms"), channels=["z"]).fs == 1e3 * FS
    assert channels(open_log(path, LogSettings(names=("t", "p", "q [N]")))) == [("p", None), ("q", "N")]
    with pytest.raises(InputError, match=r"no column 'clok'.*did you mean 'clock'"):
        open_log(path, LogSettings(time="clok"))
    with pytest.raises(InputError, match="none is number 4"):
        open_log(path, LogSettings(time=4))
    with pytest.raises(InputError, match=r"has 3 column\(s\) of numbers.* are 1"):
        open_log(path, LogSettings(names=("q",)))


@pytest.mark.parametrize("unit", ["m", "ticks"])
def test_a_time_in_no_unit_of_time_is_refused(path, unit):
    save(path, {f"time [{unit}]": TIME, "z [g]": DATA[:, 0]})
    with pytest.raises(InputError, match=f"the time is in '{unit}', which is no unit of time: give time_unit"):
        open_log(path)


def test_a_missing_value_is_nan(path):
    holes = [None if k == 5 else float(k) for k in range(N)]
    whole = [None if k == 5 else k for k in range(N)]
    dates = [None if k == 5 else datetime.datetime(2024, 5, 1, 12, 0, k % 60, k) for k in range(N)]
    save(path, {"a": holes, "b": whole, "c": [None if k == 5 else k > 9 for k in range(N)], "when": dates})
    (block,) = open_log(path).tracks[0].blocks()
    assert np.isnan(block.samples).sum(axis=0).tolist() == [1, 1, 1]
    assert np.isnan(block.samples[5]).all()
    assert np.isnan(block.stamps).sum() == 1
    assert block.samples[10].tolist() == [10, 10, 1]


@pytest.mark.parametrize("columns", [{}, {"note": ["x"] * N}, {"time": TIME}])
def test_a_file_without_channels_is_refused(path, columns):
    save(path, columns)
    with pytest.raises(InputError, match="holds no channel with numbers"):
        open_log(path)


def test_columns_of_one_name_are_refused(path):
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays([pyarrow.array(DATA[:, 0])] * 2, names=["z", "z"]), path)
    with pytest.raises(InputError, match="2 columns 'z': rename all but one"):
        open_log(path)


@pytest.mark.parametrize("rate", ["0", "-5", "nan", "inf", "1e12"])
def test_an_absurd_rate_is_refused(path, rate):
    save(path, {"z [g]": DATA[:, 0]}, metadata={"fs": rate})
    with pytest.raises(InputError, match=r"run\.parquet states a rate of .* Hz: give the true one as fs_hz"):
        open_log(path)


@pytest.mark.parametrize("part", [0.001, 0.1, 0.5, 0.9, 0.9999])
def test_a_file_that_is_cut_off_is_refused(path, part):
    save(path, {"time": TIME, "z [g]": DATA[:, 0]})
    content = path.read_bytes()
    path.write_bytes(content[: min(4 + int(part * len(content)), len(content) - 2)])
    with pytest.raises(InputError, match=r"run\.parquet is no sound Parquet file .* cut off or damaged"):
        open_log(path)


def test_another_file_under_the_name_is_refused(path):
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match="is no Parquet file, it begins like HDF5"):
        open_log(path)


def test_bytes_at_random_never_crash_the_reader(path):
    save(path, {"time": TIME, "z [g]": DATA[:, 0]}, metadata={"fs": "3"})
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        damaged = content.copy()
        damaged[-rng.integers(1, 1200, 5)] = rng.integers(0, 256, 5)
        path.write_bytes(damaged.tobytes())
        with suppress(InputError):
            for track in open_log(path).tracks:
                list(track.blocks())


@pytest.mark.parametrize("rows", [100, 1000, 10**6])
def test_a_stretch_is_read_from_any_row_groups(path, rows):
    save(path, {"time": np.arange(5000.0), "z": np.arange(5000.0)}, row_group_size=rows)
    track = open_log(path).tracks[0]
    for start, stop in ((0, None), (0, 1), (99, 101), (250, 3333), (4999, 9999), (5000, None), (30, 30)):
        blocks = list(track.blocks([0], start, stop))
        found = np.concatenate([block.samples[:, 0] for block in blocks]) if blocks else np.empty(0)
        np.testing.assert_array_equal(found, np.arange(5000.0)[start:stop])
        assert all((block.stamps == block.samples[:, 0]).all() for block in blocks)


def test_a_long_log_is_read_in_batches(path):
    n = BLOCK_VALUES // 2 + 1000
    save(path, {"time": np.arange(n) / FS, "z": np.arange(n, dtype=np.float32)})
    blocks = [block.samples for block in open_log(path).tracks[0].blocks()]
    assert len(blocks) > 1
    np.testing.assert_array_equal(np.concatenate(blocks)[:, 0], np.arange(n))


@pytest.mark.parametrize("codec", ["snappy", "gzip", "zstd", "none"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pages_of_every_kind_are_read(path, codec, version):
    rising = {"time": TIME, "z": np.round(DATA[:, 0], 1), "n": np.arange(N), "none": [None, 1.0] * (N // 2)}
    how = {"data_page_version": version, "data_page_size": 200, "write_page_index": True, "row_group_size": 250}
    save(path, rising, compression=codec, **how)
    (block,) = open_log(path).tracks[0].blocks()
    np.testing.assert_array_equal(block.samples[:, :2], np.stack([rising["z"], rising["n"]], 1))
