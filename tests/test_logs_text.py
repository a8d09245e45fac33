"""Texts as loggers write them: what sets the columns apart, where the table begins, what its columns and times are."""

import gzip
import math
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings as hypothesis_settings, strategies as st
from measured_data import measured

from opid.errors import InputError
from opid.signals.log import ChannelSettings, LogSettings
from opid.signals.logs import open_log, read_log
from opid.signals.logs.text.header import name_and_unit
from opid.signals.logs.text.stamps import nanoseconds
from opid.signals.logs.text.table import TextTable, lines_of, numbers_of

LOWER = [0.5, -1.25, 3.0, 2.0, 1e-3]
UPPER = [1.0, 2.0, -3.5, 0.0, 4.0]
ROWS = "".join(f"{2 * k},{LOWER[k]},{UPPER[k]}\n" for k in range(5))
HEADER = "time [ms],lower_z [m/s^2],upper_z [g]\n"


@pytest.fixture
def wrote(tmp_path):
    """Write a text and return its path."""

    def write(content, name="run.csv"):
        path = tmp_path / name
        content = content if isinstance(content, bytes) else content.encode()
        path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
        return path

    return write


@pytest.fixture
def small_blocks(monkeypatch):
    """Read texts some bytes at a time, so that blocks end anywhere."""
    monkeypatch.setattr("opid.signals.logs.text.table.lines_of", partial(lines_of, bytes_at_once=23))


def all_of(track):
    """Samples and stamps of a track."""
    blocks = list(track.blocks())
    stamps = None if blocks[0].stamps is None else np.concatenate([block.stamps for block in blocks])
    return np.concatenate([block.samples for block in blocks]), stamps


# ---- header and layout ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.csv", "Logger;X7\nSerial;12345\nRate;500\n\n" + (HEADER + ROWS).replace(",", ";")),
        ("run.csv", "Logger,X7\nSerial,12345\nStarted,2024-05-01 12:00:00\n" + HEADER + ROWS),
        ("run.txt", "Recorded on the apron, dry, 3 bar\n12 runs\n" + HEADER + ROWS),
        ("run.csv", "time,lower_z,upper_z\nms,m/s^2,g\n" + ROWS),
        ("run.csv", "time,lower_z,upper_z\n[ms],[m/s^2],[g]\n" + ROWS),
        ("run.csv", "Site,apron,7\ntime,lower_z,upper_z\n(ms),(m/s^2),(g)\n" + ROWS),
        ("run.asc", "time lower_z upper_z\n(ms) (m/s^2) (g)\n-------------\n" + ROWS.replace(",", "  ")),
        ("run.txt", "time [ms]  lower_z [m/s^2]  upper_z [g]\n" + ROWS.replace(",", "\t").replace("\n", " \n")),
        ("run.dat", HEADER + ROWS.replace(",", "  ")),
        ("run.csv", '"time, ms","lower_z, m/s^2","upper_z, g"\n' + ROWS),
        ("run.csv", "time / ms,lower_z / m/s^2,upper_z / g\n" + ROWS),
        ("run.csv", HEADER + "".join(f'"{2 * k}","{LOWER[k]}","{UPPER[k]}"\n'.replace(".", ",") for k in range(5))),
        ("run.txt", "% strain relief mended\n% " + HEADER + ROWS),
        ("run.txt", "// " + HEADER + ROWS.replace("\n", "\n// remark\n")),
        ("run.csv.gz", HEADER + ROWS),
        ("run.TXT.gz", (HEADER + ROWS).replace(",", "\t")),
        ("run.tsv", ("\ufeff" + HEADER + ROWS).replace(",", "\t").encode("utf-16-be")),
        ("run.csv", HEADER.replace("\n", ",status\n") + ROWS.replace("\n", ",ok\n")),
        ("run.csv", "date," + HEADER + "".join(f"2024-05-01,{row}\n" for row in ROWS.splitlines())),
    ],
)
def test_a_logger_may_write_the_table_in_its_own_way(wrote, name, content):
    run = read_log(wrote(content, name))
    assert run.fs == 500.0
    assert [(each.name, each.unit) for each in run.channels] == [("lower_z", "m/s^2"), ("upper_z", "m/s^2")]
    np.testing.assert_array_equal(run.channel("lower_z"), LOWER)
    np.testing.assert_allclose(run.channel("upper_z"), np.multiply(UPPER, 9.80665), rtol=1e-15)


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("upper_z [m/s^2]", "upper_z", "m/s^2"),
        ("upper_z (furlong)", "upper_z", "furlong"),
        ("strut (upper) (m/(s^2))", "strut (upper)", "m/(s^2)"),
        ("Weg / mm", "Weg", "mm"),
        ("v / m/s", "v", "m/s"),
        ("left / right", "left / right", None),
        ("gear, left, kN", "gear, left", "kN"),
        ("gear, left", "gear, left", None),
        ("time_us", "time_us", "us"),
        ("travel_mm", "travel_mm", "mm"),
        ("az_m/s^2", "az_m/s^2", "m/s^2"),
        ("upper_m", "upper_m", None),
        ("imu_g", "imu_g", None),
        ("pump_in", "pump_in", None),
        ("node_1", "node_1", None),
        ("[g]", "", "g"),
        ("force (2)", "force (2)", None),
    ],
)
def test_a_unit_is_taken_where_it_is_surely_one(cell, name, unit):
    assert name_and_unit(cell) == (name, unit)


def test_an_unknown_unit_is_kept_as_written_until_its_channel_is_wanted(wrote):
    path = wrote("time [s],a [gg],b [g],c\n0,1,2,3\n1,2,3,4\n")
    assert [each.unit for each in open_log(path).tracks[0].channels] == ["gg", "g", None]
    assert read_log(path, channels=["b"]).names == ("b",)
    with pytest.raises(InputError, match=r"run\.csv.*'gg' is not known: did you mean 'g'"):
        read_log(path, channels=["a"])
    with pytest.raises(InputError, match="channel 'c' states no unit"):
        read_log(path, channels=["c"])
    assert read_log(path, LogSettings(unit="m"), channels=["c"]).channels[0].unit == "m"


def test_columns_of_words_are_no_channels(wrote):
    path = wrote("time [s],state,b [g],note\n0,idle,2,\n1,idle,3,\n2,taxi,4,\n")
    assert open_log(path).names == ("b", "note")  # nothing speaks against numbers in the last
    assert read_log(path, channels=["b"]).n_samples == 3


# ---- what the user says --------------------------------------------------------------------------


def test_numbers_without_a_header(wrote):
    path = wrote(ROWS)
    log = open_log(path, LogSettings(fs_hz=500))
    assert log.names == ("column 1", "column 2", "column 3")
    assert {each.unit for each in log.tracks[0].channels} == {None}
    assert log.tracks[0].fs == 500
    samples, stamps = all_of(log.tracks[0])
    assert stamps is None
    np.testing.assert_array_equal(samples[:, 1], LOWER)
    timed = open_log(path, LogSettings(time=1, time_unit="ms"))
    assert timed.names == ("column 2", "column 3")
    np.testing.assert_allclose(all_of(timed.tracks[0])[1], 0.002 * np.arange(5))


@pytest.mark.parametrize(
    ("content", "given"),
    [
        (ROWS, {"names": ("t", "a", "b"), "time_unit": "ms", "unit": "g"}),
        (ROWS, {"names": ("t [ms]", "a [g]", "b [g]")}),
        ("x\ny z\n" + ROWS, {"names": ("t [ms]", "a [g]", "b [g]")}),
        ("9,9,9\n" + ROWS, {"names": ("t [ms]", "a [g]", "b [g]"), "skip_lines": 1}),
        ("9,9,9\n8,8,8\nt [ms],a [g],b [g]\n" + ROWS, {"skip_lines": 2}),
        ("t [s],a [g],b [g]\n" + ROWS, {"time_unit": "ms"}),
        ("n [1],t [ms],a [g],b [g]\n" + ROWS.replace("\n", "\n7,")[:-2].join(["7,", ""]), {"time": "t"}),
        ("a [g],b [g],x [ms]\n" + "".join(f"{LOWER[k]},{UPPER[k]},{2 * k}\n" for k in range(5)), {"time": 3}),
        ("a [g],b [g]\n" + "".join(f"{LOWER[k]},{UPPER[k]}\n" for k in range(5)), {"fs_hz": 500}),
        ("t,a [g],b [g]\n" + ROWS, {"fs_hz": 500}),
        ("t [ms]^a [g]^b [g]\n" + ROWS.replace(",", "^"), {"delimiter": "^"}),
        ("t [ms];a [g];b [g]\n" + ROWS.replace(",", ";").replace(".", ","), {"decimal": ",", "delimiter": ";"}),
        ("t [ms],Größe a [g],b [g]\n".encode("cp1252") + ROWS.encode(), {"encoding": "cp1252"}),
        (("t [ms],a [g],b [g]\n" + ROWS).encode("utf-16-le"), {"encoding": "utf-16-le"}),
        (("\ufefft [ms],a [g],b [g]\n" + ROWS).encode(), {"encoding": "utf-8"}),
    ],
)
def test_what_the_user_says_is_done(wrote, content, given):
    run = read_log(wrote(content), LogSettings(**given))
    assert run.fs == 500.0
    kept = [name for name in run.names if name != "n"]
    assert len(kept) == 2
    np.testing.assert_allclose(run.channel(kept[0]), np.multiply(LOWER, 9.80665))
    np.testing.assert_allclose(run.channel(kept[1]), np.multiply(UPPER, 9.80665))


@pytest.mark.parametrize(
    ("content", "given", "words"),
    [
        (ROWS, {"names": ("t", "a")}, "`names` of .* has 2 entries, line 1 has 3 cells"),
        (ROWS, {"names": ("t", "a", "b")}, "column 't' has no unit.*give `time_unit`"),
        (ROWS, {"names": ("p", "q", "r")}, "no time column .*'p', without a unit.*`fs_hz`"),
        (HEADER + ROWS, {"time": 4}, "time is column 4 in .*: give a number from 1 to 3"),
        (HEADER + ROWS, {"time": "tim"}, "no column 'tim' .*did you mean 'time'"),
        (HEADER + ROWS, {"time": "upper_z"}, "'upper_z': the time is in 'g', which is no unit of time"),
        (HEADER + ROWS, {"encoding": "klingon"}, "encoding 'klingon' is not known"),
        (HEADER + ROWS, {"encoding": "hex"}, "encoding 'hex' is not known"),
        (HEADER + ROWS, {"encoding": "utf-16"}, "is not utf-16 text .*give another `encoding`"),
        (HEADER + ROWS, {"delimiter": "ab"}, "delimiter is 'ab': give one like"),
        (HEADER + ROWS, {"delimiter": "5"}, "delimiter is '5': give one like"),
        ("time [sx],a [g]\n0,1\n1,2\n", {}, "line 1: column 'time': the time is in 'sx', .*: give time_unit"),
        ("day,a [g]\n2024-05-01,1\n2024-05-02,2\n", {"time": 1}, "dates without a time of day"),
        ("time [s],a [g]\n0,1,2\n1,2,3\n", {}, r"line 1 has 2 cell\(s\) where line 2 has 3"),
        ("time [s],a [g]\n0,off\n1,2\n2,3\n3,4\n", {}, "line 2, column 'a': 'off' is not a number"),
        ("time [s],a [g]\n0,1\n" + "1," * 5000 + "\n", {}, "lines of 5001 cells"),
        ("time [s]\tstate\n0\ton\n1\toff\n", {}, "no column of numbers beside the time"),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(wrote, content, given, words):
    with pytest.raises(InputError, match=words) as caught:
        read_log(wrote(content), LogSettings(**given))
    assert "\n" not in str(caught.value)


# ---- times of day --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "stamps",
    [
        [f"2024-05-01T12:00:00.{2 * k:03d}" for k in range(5)],
        [f"2024-05-01 12:00:00.{2000 * k:06d}Z" for k in range(5)],
        [f"2024-12-31T23:59:{59 + (995 + 2 * k) // 1000 - 60 * (k > 2)}.{(995 + 2 * k) % 1000:03d}" for k in range(3)]
        + ["2025-01-01T00:00:00.001", "2025-01-01T00:00:00.003"],
        [f"2024/5/1 9:00:00.{2 * k:03d}" for k in range(5)],
        [f"01.05.2024 12:00:00,{2 * k:03d}" for k in range(5)],
        [f"2024-03-31T01:59:59.{996 + 2 * k}+01:00" for k in range(2)]
        + [f"2024-03-31T03:00:00.{2 * k:03d}+02:00" for k in range(3)],
        [f"12:00:00.{2 * k:03d}" for k in range(5)],
        ["23:59:59.996", "23:59:59.998", "0:00:00", "0:00:00.002", "0:00:00.004"],
        [f"36:00:00.{2 * k:03d}" for k in range(5)],
    ],
)
def test_times_of_day_count_from_the_first(wrote, small_blocks, stamps):
    rows = "".join(f"{stamp};{LOWER[k]}\n" for k, stamp in enumerate(stamps))
    track = open_log(wrote("clock;a [g]\n" + rows)).tracks[0]
    samples, found = all_of(track)
    np.testing.assert_allclose(found, 0.002 * np.arange(5), atol=1e-12)
    np.testing.assert_array_equal(samples[:, 0], LOWER)


def test_a_date_beside_a_time_of_day_is_no_channel(wrote):
    rows = "".join(f"01.05.2024;12:00:0{k},5;{k},5\n" for k in range(5))
    run = read_log(wrote("Datum;Uhrzeit;a (g)\n" + rows))
    assert (run.fs, run.names) == (1.0, ("a",))


@pytest.mark.parametrize(
    "cell",
    [
        "",
        "today",
        "NaT",
        "2024-13-01T12:00:00",
        "12:61:00",
        "2024-05-01T12",
        "2024-05-01T12:00:00-02",
        "2024-05-01T12:00:099:00",
        "2500-01-01T00:00:00",
    ],
)
def test_what_is_no_time_is_said_with_its_line(wrote, cell):
    stamps = ["2024-05-01T12:00:00", "2024-05-01T12:00:01", cell]
    with pytest.raises(InputError, match=r"line 4, column 'time': .*(is not a finite number or a time|is empty)"):
        read_log(wrote("time,a [g]\n" + "".join(f"{stamp},1\n" for stamp in stamps)))


@given(st.lists(st.datetimes(min_value=datetime(1950, 1, 1)), min_size=1, max_size=5))
def test_dates_are_those_of_the_standard_library(moments):
    epoch = datetime(1970, 1, 1)
    moments = [moment.replace(year=min(moment.year, 2199), day=min(moment.day, 28)) for moment in moments]
    expected = [((moment - epoch) // timedelta(microseconds=1)) * 1000 for moment in moments]
    assert nanoseconds([moment.isoformat() for moment in moments]).tolist() == expected
    german = [moment.strftime("%d.%m.%Y %H:%M:%S,%f") for moment in moments]
    assert nanoseconds(german).tolist() == expected


# ---- missing values, blocks, places --------------------------------------------------------------


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_empty_cells_and_nan_are_missing(wrote, small_blocks, mark):
    text = "time [s],a [g],b [g]\n0,1,\n1,,2\n2,,\n3,nan,NaN\n4,n/a,-1.#IND\n5,inf,7\n".replace(",", mark)
    samples, stamps = all_of(open_log(wrote(text)).tracks[0])
    expected = [[1, np.nan], [np.nan, 2], [np.nan] * 2, [np.nan] * 2, [np.nan] * 2, [np.nan, 7]]
    np.testing.assert_array_equal(samples, expected)
    np.testing.assert_array_equal(stamps, range(6))


def test_a_channel_that_begins_late_is_a_channel(wrote):
    text = "time [s],a [g],slow [degC]\n" + "".join(f"{k},1,{20 if k == 99 else ''}\n" for k in range(100))
    samples, _ = all_of(open_log(wrote(text)).tracks[0])
    assert samples[99, 1] == 20
    assert np.isnan(samples[:99, 1]).all()


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@hypothesis_settings(max_examples=80)
@given(
    rows=st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=1, max_size=8),
    holes=st.sets(st.tuples(st.integers(0, 7), st.integers(0, 2))),
    layout=st.sampled_from([(",", "."), (";", ","), ("\t", ","), ("|", "."), (" ", "."), (" ", ",")]),
    quoted=st.booleans(),
    columns=st.permutations(range(3)).flatmap(lambda order: st.integers(1, 3).map(lambda n: order[:n])),
)
def test_the_quick_way_and_the_cells_agree_to_the_last_bit(rows, holes, layout, quoted, columns):
    delimiter, decimal = layout
    hole = "nan" if delimiter == " " else ""
    cells = [
        [hole if (i, j) in holes else repr(x).replace(".", decimal) for j, x in enumerate(row)]
        for i, row in enumerate(rows)
    ]
    if quoted:
        cells = [[f'"{cell}"' for cell in row] for row in cells]
    expected = [[np.nan if (i, j) in holes else row[j] for j in columns] for i, row in enumerate(rows)]
    table = TextTable(Path("run.csv"), None, delimiter, decimal, 1, ("a", "b", "c"))
    lines = ["# remark", *(delimiter.join(row) for row in cells), "  "]
    if delimiter == "\t" or not all(set(row) == {""} for row in cells):
        found = numbers_of(table, 1, lines, columns)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_point_is_not_taken_for_a_comma_nor_the_other_way(decimal):
    other = {".": ",", ",": "."}[decimal]
    table = TextTable(Path("run.csv"), None, ";", decimal, 1, ("t", "a"))
    lines = [f"1{decimal}5;2{decimal}5", f"2{decimal}5;1{other}234"]
    with pytest.raises(InputError, match=f"line 8, column 'a': '1{other}234' has a decimal"):
        numbers_of(table, 7, lines, [0, 1])


@hypothesis_settings(max_examples=60)
@given(
    text=st.text(st.sampled_from("ab,1\u00e9\u2028\x0b\x1c\n\r"), max_size=60),
    encoding=st.sampled_from([None, "utf-8", "utf-16", "utf-16-le"]),
    bytes_at_once=st.integers(1, 20),
)
def test_lines_do_not_depend_on_how_they_are_read(tmp_path_factory, text, encoding, bytes_at_once):
    path = tmp_path_factory.mktemp("text") / "run.txt"
    path.write_bytes(text.encode(encoding or "utf-8"))
    expected = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    expected = expected[:-1] if expected[-1] == "" else expected
    blocks = list(lines_of(path, encoding, bytes_at_once=bytes_at_once))
    assert [line for block in blocks for line in block] == expected


def test_opening_reads_the_head_and_reading_stops_where_it_may(wrote):
    rows = [f"{k},{k % 7}" for k in range(300_000)]
    rows[250_000] = "250000,off"
    path = wrote("time [s],a [g]\n# remark\n" + "\n".join(rows) + "\n")
    track = open_log(path).tracks[0]
    assert track.n_samples is None
    assert track.locate(3) == "line 6"
    few = np.concatenate([block.samples for block in track.blocks(start=1000, stop=1010)])
    np.testing.assert_array_equal(few[:, 0], np.arange(1000, 1010) % 7)
    with pytest.raises(InputError, match="line 250003, column 'a': 'off' is not a number"):
        all_of(track)


def test_no_block_is_as_long_as_the_file(wrote):
    rows = "".join(f"{k},{k % 7}\n" for k in range(400_000))
    blocks = [block.samples.shape[0] for block in open_log(wrote("time [s],a [g]\n" + rows)).tracks[0].blocks()]
    assert sum(blocks) == 400_000
    assert max(blocks) < 200_000


@pytest.mark.parametrize(
    "content",
    [
        ",".join(map(str, range(1_000_000))) + "\n1,2\n",
        b"1" * 100_000_000,
        b"time [s],a [g]\n0,1\n" + b"\n".join([b"1,2", b"x" * 3_000_000, b"3,4"]),
    ],
)
def test_a_line_without_an_end_is_refused_before_it_is_held(wrote, content):
    with pytest.raises(InputError, match=r"line \d has more than 1048576 characters"):
        read_log(wrote(content, "run.csv.gz"))


def test_packed_texts_that_are_damaged(wrote, tmp_path):
    whole = wrote(HEADER + "".join(f"{2 * k},{math.sin(k)},1\n" for k in range(50_000)), "run.csv.gz").read_bytes()
    (tmp_path / "cut.csv.gz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "bent.csv.gz").write_bytes(whole[:300_000] + b"\xff" * 40 + whole[300_040:])
    for name in ("cut.csv.gz", "bent.csv.gz"):
        with pytest.raises(InputError, match=f"{name} is no sound CSV file|{name} line|cannot read .*{name}"):
            read_log(tmp_path / name)


# ---- measured by others --------------------------------------------------------------------------


AXES = ("ax", "ay", "az", "rx", "ry", "rz")
PLACES = ("passenger_knuckle", "driver_knuckle", "passenger_axle", "driver_axle")
NAMES = ("time", *(f"{place}_{axis}" for place in PLACES for axis in AXES))


@pytest.mark.parametrize("record", ["20211027T145614", "20211029T125712"])
def test_raw_counts_of_a_shimmying_axle_become_a_sound_recording(record):
    path = measured(f"wobble_landcruiser/{record}_sensors.csv")
    settings = LogSettings(names=NAMES, time="time", time_unit="s", clock="reconstructed")
    offset = {"ax": 0.01, "ay": 0.0, "az": -0.02}
    channels = {
        f"{place} {axis}": ChannelSettings(f"{place}_{axis}", scale=16 / 32767, unit="g", offset=offset[axis])
        for place in PLACES
        for axis in offset
    }
    run = read_log(path, settings, channels=channels)
    assert run.fs == pytest.approx(117, abs=0.5)
    assert run.n_samples == len(path.read_text().split())
    raw = np.loadtxt(path, delimiter=",")
    np.testing.assert_allclose(run.samples[:, 2], (raw[:, 3] * 16 / 32767 - 0.02) * 9.80665, rtol=1e-12)
    assert any("reconstructed" in words for words in run.history)
    # the vehicle stands and rolls: sound sensors show 1 g on the average, whichever way they are turned
    mean_g = run.samples.mean(axis=0).reshape(4, 3) / 9.80665 - list(offset.values())
    magnitude = dict(zip(PLACES, np.linalg.norm(mean_g, axis=1), strict=True))
    false = magnitude.pop("passenger_axle") if record == "20211029T125712" else None
    assert all(0.85 < each < 1.1 for each in magnitude.values()), magnitude
    if false is not None:
        assert false > 5  # the false offset of some -2.8, -2.7, -4.3 g, to be given as `offset`
        np.testing.assert_allclose(mean_g[2], [-2.8, -2.7, -4.3], atol=0.1)


def test_a_ground_vibration_test_without_header_or_time():
    path = measured("f16_gvt_sysidentpy/f-16.txt")
    run = read_log(path, LogSettings(names=("voltage [V]", "force [N]", "acceleration [m/s^2]"), fs_hz=400))
    assert (run.fs, run.n_samples) == (400.0, 32768)
    np.testing.assert_array_equal(run.samples, np.loadtxt(path, delimiter=","))


def test_a_table_whose_lines_end_with_a_comma():
    path = measured("silverbox/SNLS80mV.csv")
    run = read_log(path, LogSettings(fs_hz=610.35, unit="V"))
    assert (run.names, run.n_samples) == (("V1", "V2"), 131072)
    assert run.samples[0].tolist() == [0.0057756, 0.0093978]
