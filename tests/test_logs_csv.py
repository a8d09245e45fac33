"""Logs as text: what is read, what is written, and what is said about a file that is at fault."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from opid.errors import InputError
from opid.signals.health.inspection import inspect
from opid.signals.log import LogSettings
from opid.signals.logs import open_log, read_log, write_log
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.signals.units import time_name

HEADER = "time [s],lower_z [m/s^2],upper_z [g]"
ROWS = [f"{k / 512:.4f},{k % 7 - 3}.5,{k % 5 - 2}e-1" for k in range(50)]
GOOD = "\n".join([HEADER, *ROWS]) + "\n"


@pytest.fixture
def log(tmp_path):
    """Write a log and read it."""

    def write_and_read(content, name="run.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_log(path)

    return write_and_read


def test_a_log_is_read_into_si(log):
    run = log(GOOD)
    assert run.fs == 512.0
    assert run.start_s == 0.0
    assert run.channels == (Channel("lower_z", "m/s^2"), Channel("upper_z", "m/s^2"))
    np.testing.assert_array_equal(
        run.channel("lower_z"), [k % 7 - 3 + 0.5 * (1 if k % 7 >= 3 else -1) for k in range(50)]
    )
    np.testing.assert_allclose(run.channel("upper_z"), [0.980665 * (k % 5 - 2) for k in range(50)], rtol=1e-15)
    assert run.history[0] == "read 50 samples from run.csv"
    assert run.history[1].startswith("rate 512 Hz from the time stamps (512.028")
    assert "upper_z: g -> m/s^2, times 9.80665" in run.history


@pytest.mark.parametrize(
    "content",
    [
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        GOOD + "\n  \n\n",
        "# recorder 7\n# strain relief mended\n" + GOOD,
        "# " + GOOD,  # as numpy.savetxt writes it
        GOOD.replace("0.0977", "# a remark\n\n0.0977"),
        GOOD.replace(",", ", "),
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", "|"),
        GOOD.replace(",", "   "),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t").replace(".", ","),
        GOOD.replace(",", " ").replace(".", ","),
        GOOD.replace("\n", ",\n"),
        GOOD.replace("\n", ",\n").replace("],\n", "]\n"),
        GOOD.replace("\n", "\r"),
        GOOD.encode("utf-16"),
        GOOD.encode("utf-16-le").join([b"\xff\xfe", b""]),
        GOOD.replace("[", "(").replace("]", ")").replace("time", "Time"),
        GOOD.replace("m/s^2", "m/s²").replace("time", "T"),
        GOOD.replace("time [s]", "recorder clock [s]"),
        "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in GOOD.splitlines()),
        GOOD.rstrip("\n"),
        GOOD.replace("m/s^2", "m/s²").encode("cp1252"),
        "\n".join(f"{k - 1 if k else ''},{line}" for k, line in enumerate(GOOD.splitlines())),
        "\n".join(f"{k + 5119 if k else ''};{line.replace(',', ';')}" for k, line in enumerate(GOOD.splitlines())),
    ],
)
def test_the_freedoms_of_a_log(log, content):
    run, plain = log(content), log(GOOD)
    assert (run.fs, run.channels) == (plain.fs, plain.channels)
    np.testing.assert_array_equal(run.samples, plain.samples)


def test_german_excel_and_the_index_of_a_data_frame_are_read_and_told(log, tmp_path):
    text = GOOD.replace(",", ";").replace(".", ",").replace("time", "Zeit").replace("lower_z", "Fahrwerk_Höhe")
    text = "\n".join(f"{k - 1 if k else ''};{line}" for k, line in enumerate(text.splitlines()))
    run = log(text.encode("cp1252"))
    assert run.names == ("Fahrwerk_Höhe", "upper_z")
    np.testing.assert_array_equal(run.samples, log(GOOD).samples)
    told = (
        "the text is no UTF-8 and is read as cp1252 (Western Windows)",
        "the first column has no name and counts the rows: it is left out",
    )
    assert run.history[1:3] == told
    log(text.encode("cp1252"))
    notes = [each.message for each in inspect(open_log(tmp_path / "run.csv")).findings if each.severity == "note"]
    assert set(told) <= set(notes)


def test_quoted_cells_and_names_with_commas_and_parentheses(log):
    run = log('"t [ms]","gear, left [g]","strut (upper) (m/(s^2))"\n"0","1","2"\n"2","3","4"\n"4","5","6"\n')
    assert run.names == ("gear, left", "strut (upper)")
    assert run.fs == 500.0
    np.testing.assert_array_equal(run.channel("strut (upper)"), [2, 4, 6])


def test_the_time_may_stand_anywhere_if_it_is_called_so(log):
    run = log("a [g],elapsed [s],TIME [s]\n1,5,0.5\n2,6,1.0\n3,9,1.5\n")
    assert run.names == ("a", "elapsed")
    assert (run.fs, run.start_s) == (2.0, 0.5)


def test_a_column_t_beside_a_time_is_a_channel(log):
    assert log("time [s],T [degC]\n0,20\n1,21\n").channels == (Channel("T", "degC"),)


def replaced(row, text):
    lines = GOOD.splitlines()
    lines[row - 1] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty: export the log again"),
        ("\n\n", r"has no header and no samples: begin with `time \[s\],lower_z"),
        ("%\n#\n", "has no header and no samples"),
        (HEADER, "holds no samples below its header"),
        (HEADER + "\n0,1,2\n", "holds one sample below its header"),
        ("\n".join(ROWS), r"line 1 is numbers, there is no header: begin with `time.*give `names` and `time`"),
        ("time [s]\n1\n2\n", "line 1 has one column"),
        ("time [s],b\n1,2\n2,3\n", "channel 'b' states no unit: write it in the log's header"),
        ("time,b [g]\n1,2\n", r"column 'time' has no unit: write it in brackets, like `time \[s\]`"),
        (
            "# note\ntime [s],b [gg]\n1,2\n2,3\n",
            "the unit 'gg' is not known: did you mean 'g'",
        ),
        ("a [g],b [g]\n1,2\n", r"line 1: there is no time column \(the first is 'a' in g\).*`fs_hz` in \[log\]"),
        ("time [s],b [g],b [g]\n1,2,3\n", "line 1 names 2 columns 'b': rename all but one"),
        ("time [s],Time [s],b [g]\n1,2,3\n", "names 2 columns 'time'"),
        ("time [s],[g]\n1,2\n", "column 2 has no name"),
        ("time [s],b [g],\n1,2,3\n", "column 3 has no name"),
        ("time [s],b [g],,\n1,2,,\n", "column 3 has no name"),
        (replaced(11, "0.0176,off,2"), "line 11, column 'lower_z': 'off' is not a number"),
        (replaced(11, ",1,2"), "line 11, column 'time': the cell is empty: every row needs its time"),
        (replaced(11, "0.0176,,2"), "line 11: channel 'lower_z' has no number there"),
        (replaced(11, "0.0176,1,NaN"), "line 11: channel 'upper_z' has no number there"),
        (replaced(11, "0.0176,1,-inf"), "line 11: channel 'upper_z' has no number there"),
        (replaced(11, "-inf,1,2"), "line 11, column 'time': '-inf' is not a finite number"),
        (replaced(11, "0.0176,1_0,2"), "'1_0' is not a number"),
        (replaced(11, "0.0176,1"), r"line 11 has 2 cell\(s\) where the header has 3"),
        (replaced(11, "0.0176,1,2,3"), r"line 11 has 4 cell\(s\) where the header has 3"),
        (replaced(51, "0.0"), r"line 51 has 1 cell\(s\).*delete it if the log was cut off there"),
        (replaced(11, "0.0156,1,2"), r"line 11: the time 0.0156 s stands twice in a row \(1 such"),
        (replaced(11, "0.0001,1,2"), "line 11: the time goes back from 0.0156 s to 0.0001 s"),
        (replaced(11, ""), r"line 12: the time jumps from 0.0156 s to 0.0195 s .* about 1 sample\(s\) lost"),
        (
            replaced(11, "0.0185,1,2"),
            "line 11: the time stamps are not uniform: the step to 0.0185 s lasts 0.0029 s",
        ),
        (GOOD.replace(",", ";") + "0,0978;1,0;2,0\n", "line 52, column 'lower_z': '1,0' has a decimal comma"),
        (GOOD.encode("utf-16-le"), "line 1 is binary or UTF-16"),
        (GOOD.encode() + b"\0", "line 52 is binary or UTF-16"),
        (
            GOOD.encode() + b"#" * 200_000 + "\n# ²\n".encode("latin-1"),
            r"""line 53 is not UTF-8 text .byte 0xb2.: if that stands for '²', give encoding = "latin-1" in \[log\]""",
        ),
        (GOOD.encode() + "# ² and ".encode() + "²\n".encode("latin-1"), r"line 52 is not UTF-8 text \(byte 0xb2\)"),
        ("time [s],b [g],,c [g]\n1,2,0,3\n2,2,1,3\n", "column 3 has no name"),
        (",time [s],b [g]\n0,1,2\n2,2,3\n", "column 1 has no name: write one$"),
        (GOOD.encode() + b"\xff,1,2\n", r"line 52 is not UTF-8 text \(byte 0xff\): give `encoding` in \[log\]"),
        (bytes(range(1, 256)) * 10, "is not UTF-8 text"),
        ("x" * 200_000 + "\n1,2\n", r"line 1 has 1 cell\(s\) where line 2 has 2: mend the header"),
    ],
)
def test_a_fault_is_named_with_its_place_and_remedy(log, content, words):
    with pytest.raises(InputError, match=words) as caught:
        log(content)
    assert "run.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_log_a_directory_and_an_unknown_format(tmp_path, log):
    log(GOOD, "heavy.csv")
    with pytest.raises(InputError, match=r"there is no file .*heavi\.csv: did you mean 'heavy\.csv'"):
        read_log(tmp_path / "heavi.csv")
    with pytest.raises(InputError, match="nor a directory"):
        read_log(tmp_path / "missing" / "heavy.csv")
    with pytest.raises(InputError, match="is a directory or a device"):
        read_log(tmp_path)
    with pytest.raises(InputError, match=r"no format has the ending '\.xslx'"):
        log(GOOD, "heavy.xslx")
    with pytest.raises(InputError, match=r"no format has the ending '\.mat'"):
        write_log(log(GOOD), tmp_path / "heavy.mat")


@settings(max_examples=50)
@given(
    fs=st.floats(1, 20000).map(lambda rate: round(rate, 3)),
    start_s=st.floats(-100, 1000),
    # the largest value of a channel has a size that something real has
    data=st.lists(st.tuples(*[st.floats(-1e40, 1e40)] * 2), min_size=3, max_size=40).map(
        lambda rows: [(1.0, 1.0), *rows]
    ),
    names=st.lists(
        st.text(
            st.characters(codec="utf-8", exclude_categories=["C", "Z"]),
            min_size=1,
            max_size=8,
        ).filter(lambda name: name.casefold() != "time"),
        min_size=2,
        max_size=2,
        unique=True,
    ),
)
def test_what_is_written_reads_back_to_the_last_bit(tmp_path_factory, fs, start_s, data, names):
    channels = (Channel(names[0], "m/s^2"), Channel(names[1], "N"))
    run = Recording(np.array(data), fs=fs, channels=channels, start_s=start_s)
    path = tmp_path_factory.mktemp("log") / "run.csv"
    write_log(run, path)
    back = read_log(path)
    assert (back.fs, back.start_s, back.channels) == (pytest.approx(fs, rel=1e-9), start_s, channels)
    np.testing.assert_array_equal(back.samples, run.samples)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("a\nb", "m"), ("a", "g"), ("a", "furlong"), ("", "m"), (" a", "m"), ("a\0", "m"), ("Time", "s")],
)
def test_a_channel_that_would_not_read_back_is_not_written(tmp_path, name, unit):
    run = recording_from_arrays([[0.0, 1.0]], [name], fs=1.0, unit=unit)
    with pytest.raises(InputError, match="cannot write"):
        write_log(run, tmp_path / "run.csv")
    assert list(tmp_path.iterdir()) == []


def test_more_rows_than_are_written_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("opid.signals.logs.csv._ROWS_AT_ONCE", 7)
    run = recording_from_arrays([np.random.default_rng(0).standard_normal(50)], ["upper_z"], fs=512.0)
    write_log(run, tmp_path / "run.csv")
    np.testing.assert_array_equal(read_log(tmp_path / "run.csv").samples, run.samples)


@pytest.mark.parametrize(
    ("stamps", "zero"),
    [
        ("2024-05-01T12:00:00.{k}", datetime(2024, 5, 1, 12)),
        ("1.5.2024 12:00:00.{k}", datetime(2024, 5, 1, 12)),
        ("2024-05-01T12:00:00.{k}Z", datetime(2024, 5, 1, 12, tzinfo=UTC)),
        ("2024-05-01 01:30:00.{k}+02:00", datetime(2024, 4, 30, 23, 30, tzinfo=UTC)),
        ("12:00:00.{k}", None),
        ("0.{k}", None),
    ],
)
def test_the_first_dated_stamp_is_the_zero(tmp_path, stamps, zero):
    path = tmp_path / "run.csv"
    rows = "".join(f"{stamps.format(k=k)},{k}.5\n" for k in range(2, 9))
    path.write_text("recorder 7,x,\n# a remark\ntime [s],upper_z [g]\n# another\n\n" + rows)
    found = open_log(path).zero
    assert found == (None if zero is None else zero.replace(microsecond=200_000))
    assert open_log(path, LogSettings(fs_hz=10.0)).zero == found  # its rows count from there, too


US_DATE = r"line 1: column '{}' holds '.*', a date or time in a form that is not read: write it as ISO 8601"


@pytest.mark.parametrize("name", ["time", "time [s]", "Date/Time"])
@pytest.mark.parametrize(
    "stamp",
    [
        "05/01/2024 11:59:59.{k} PM",
        "05/01/2024 11:59:59.{k}",
        "01-May-2024 11:59:59.{k}",
        "May 1 2024 11:59:59.{k}",
        "11:59:59.{k} PM",
    ],
)
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_date_in_another_form_is_named_as_one(log, tmp_path, name, stamp, delimiter):
    rows = [f"{stamp.format(k=k)}{delimiter}0.{k}" for k in range(9)]
    with pytest.raises(InputError, match=US_DATE.format(name.removesuffix(" [s]"))):
        log("\n".join([f"{name}{delimiter}upper_z [g]", *rows]))
    assert read_log(tmp_path / "run.csv", LogSettings(fs_hz=10.0)).names == ("upper_z",)


def test_a_time_that_is_none(log):
    with pytest.raises(InputError, match=r"column 'time' holds 'a0', which is no time: give another as `time`"):
        log("time,upper_z [g]\n" + "".join(f"a{k},0.5\n" for k in range(9)))
    late = "time [s],upper_z [g]\n" + "".join(f"0.{k},0.5\n" for k in range(9))
    with pytest.raises(InputError, match=r"line 11, column 'time': 'later' is not a number: every row needs its time"):
        log(late + "later,0.5\n")


@pytest.mark.parametrize(
    ("table", "cell"),
    [
        ('time [s],upper_z [g]\n0.{k},"1,23{k}.5"', "1,232.5"),
        ('time [ms],upper_z [g]\n"1,23{k}.5",0.5', "1,232.5"),
        ('time [s],upper_z [g]\n0.{k},"1,23{k}"', "1,232"),
        ("time [s];upper_z [g]\n0,{k};1.23{k},5", "1.232,5"),
        ("time [s];upper_z [g]\n{k};1.23{k},5", "1.232,5"),
        ("time [s];upper_z [g]\n0,{k};-1 23{k},5", "-1 232,5"),
        ("time [s];upper_z [g]\n0.{k};1'23{k}", "1'232"),
    ],
)
def test_a_mark_between_thousands_is_named(log, table, cell):
    header, row = table.split("\n")
    with pytest.raises(InputError, match=f"{cell}. has a mark between the thousands.*export the log") as caught:
        log("\n".join([header, *(row.format(k=k) for k in range(2, 9))]))
    assert cell in str(caught.value)


@pytest.mark.parametrize(
    ("cell", "words"),
    [("1,000.5", "has a mark between the thousands"), ("1,000", "has a decimal comma or a mark between the thousands")],
)
def test_a_mark_between_thousands_in_a_late_row(log, cell, words):
    rows = "".join(f"0.{k},{990 + k}.5\n" for k in range(9))
    with pytest.raises(InputError, match=f"run.csv line 11, column 'upper_z': '{cell}' {words}"):
        log(f'time [s],upper_z [g]\n{rows}0.9,"{cell}"\n')


def test_three_decimals_are_no_thousands(log):
    run = log("time [s];upper_z [m/s^2]\n" + "".join(f"0,00{k};1,23{k}\n" for k in range(9)))
    np.testing.assert_allclose(run.channel("upper_z"), [1.23 + 0.001 * k for k in range(9)], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "unit_s"),
    [("times [ms]", 1e-3), ("Time_Stamp [s]", 1), ("Elapsed Time [s]", 1), ("elapsed_time_us", 1e-6), ("t_ms", 1e-3)],
)
def test_the_time_has_the_same_names_in_texts_as_elsewhere(log, name, unit_s):
    rows = "".join(f"0.5,{2 * k}\n" for k in range(9))
    assert time_name(["az", name]) == name
    assert log(f"upper_z [g],{name}\n{rows}").fs == pytest.approx(0.5 / unit_s)


def test_what_only_begins_like_the_time_is_none(log):
    assert time_name(["t_inlet", "time_to_failure"]) is None
    with pytest.raises(InputError, match="there is no time column"):
        log("t_inlet,upper_z [g]\n0,1\n1,2\n2,3\n")


def test_a_full_scale_is_for_wav_files(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(GOOD)
    with pytest.raises(InputError, match=r"run\.csv is a CSV file, and full_scale of \[log\] is for WAV files: remove"):
        open_log(path, LogSettings(full_scale=2.0))
