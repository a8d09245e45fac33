"""LabVIEW text logs: headers, segments and time columns as the specification has them, and what is said of bad ones."""

import gzip
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from measured_data import measured

from opid.errors import InputError
from opid.signals.log import LogSettings
from opid.signals.logs import open_log, read_log
from opid.signals.logs.text import table as text_table

SAMPLE = "reader_samples/raw_ambient_testVI.lvm"
SEPARATORS = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}


def file_header(separator="\t", decimal=".", x_columns="One", multi="No"):
    entries = [
        ("LabVIEW Measurement", ""),
        ("Writer_Version", "2"),
        ("Reader_Version", "2"),
        ("Separator", SEPARATORS[separator]),
        ("Decimal_Separator", decimal),
        ("Multi_Headings", multi),
        ("X_Columns", x_columns),
        ("Time_Pref", "Relative"),
        ("Date", "2024/05/01"),
        ("Time", "12:00:00"),
        ("***End_of_Header***", ""),
        ("", ""),
    ]
    return "".join(separator.join(entry) + "\n" for entry in entries)


def segment(rows, names, units, *, separator="\t", clock="12:00:00", dx="0.01", x0="0", more="", labels=None):
    n = len(units)
    entries = [
        ["Channels", str(n)],
        ["Samples", *[str(len(rows))] * n],
        ["Date", *["2024/05/01"] * n],
        ["Time", *[clock] * n],
        ["Y_Unit_Label", *units],
        ["X_Dimension", *["Time"] * n],
        ["X0", *(x0 if isinstance(x0, list) else [x0] * n)],
        ["Delta_X", *(dx if isinstance(dx, list) else [dx] * n)],
        ["***End_of_Header***"],
        labels or ["X_Value", *names, "Comment"],
        *rows,
    ]
    return more + "".join(separator.join(map(str, entry)) + "\n" for entry in entries)


A = [0.5, -1.25, 3.0, 2.0]
B = [1.0, 2.0, -3.5, 1e-3]
ROWS = [[f"{0.01 * k:.6f}", f"{A[k]:.6f}", f"{B[k]:.6f}"] for k in range(4)]
SPECIAL = "***Start_Special***\nChannels\t99\n***End_Special***\n"


@pytest.fixture
def lvm(tmp_path):
    """Write a file and return its path."""

    def write(text, name="run.lvm"):
        path = tmp_path / name
        content = text if isinstance(text, bytes) else text.encode()
        path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
        return path

    return write


@pytest.fixture(params=[23, 1 << 20], ids=["small blocks", "large blocks"])
def block_bytes(request, monkeypatch):
    monkeypatch.setattr("opid.signals.logs.lvm.BYTES_AT_ONCE", request.param)
    monkeypatch.setattr("opid.signals.logs.lvm._LINES_AT_ONCE", max(2, request.param >> 4))


def with_decimal(rows, decimal):
    return [[cell.replace(".", decimal) for cell in row] for row in rows]


@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), ("\t", ","), (",", "."), (";", ",")])
@pytest.mark.parametrize("name", ["run.lvm", "run.lvm.gz"])
def test_one_segment(lvm, block_bytes, separator, decimal, name):
    text = file_header(separator, decimal) + segment(
        with_decimal(ROWS, decimal), ["left", "right"], ["g", "mm"], separator=separator, dx=f"0{decimal}01"
    )
    for content in (text, text.replace("\n", "\r\n"), text.rstrip("\n"), text + separator + "\n\n"):
        run = read_log(lvm(content, name))
        assert (run.fs, run.start_s) == (100.0, 0.0)
        assert [(each.name, each.unit) for each in run.channels] == [("left", "m/s^2"), ("right", "m")]
        np.testing.assert_allclose(run.channel("left"), np.multiply(A, 9.80665))
        np.testing.assert_allclose(run.channel("right"), np.multiply(B, 1e-3))


def test_comments_and_what_other_programs_add_are_passed_over(lvm):
    rows = [[*ROWS[0], "begin, of the run"], ROWS[1], [*ROWS[2], ""], [*ROWS[3], "two\twords"]]
    text = file_header().replace("Date\t", SPECIAL + "Date\t", 1)
    run = read_log(lvm(text + segment(rows, ["left", "right"], ["g", "g"], more=SPECIAL)))
    np.testing.assert_allclose(run.channel("right"), np.multiply(B, 9.80665))


def test_without_time_column_the_period_counts(lvm, block_bytes):
    rows = [["", *row[1:]] for row in ROWS]
    text = file_header(x_columns="No") + segment(rows, ["left", "right"], ["g", "g"], dx="0.002", x0="1.5")
    run = read_log(lvm(text))
    assert (run.fs, run.start_s) == (pytest.approx(500.0), 1.5)
    np.testing.assert_allclose(run.channel("left"), np.multiply(A, 9.80665))


def test_the_stamps_tell_the_rate_better_than_a_rounded_period(lvm):
    rows = [[f"{k / 1651.6129:.6f}", "0.1"] for k in range(2000)]
    text = file_header() + segment(rows, ["left"], ["g"], dx="0.000605")
    assert read_log(lvm(text)).fs == pytest.approx(1651.6129, rel=1e-6)


@pytest.mark.parametrize(
    ("second", "clock"),
    [
        ([f"{0.04 + 0.01 * k:.6f}" for k in range(4)], "12:00:00"),
        ([f"{0.01 * k:.6f}" for k in range(4)], "12:00:00.04"),
    ],
    ids=["X goes on", "X begins again, the clock goes on"],
)
def test_segments_follow_one_another(lvm, block_bytes, second, clock):
    later = [[x, *row[1:]] for x, row in zip(second, ROWS, strict=True)]
    path = lvm(
        file_header(multi="Yes")
        + segment(ROWS, ["left", "right"], ["g", "g"])
        + "\t\n"
        + segment(later, ["left", "right"], ["g", "g"], clock=clock)
        + "\n"
    )
    run = read_log(path)
    assert run.fs == 100.0
    np.testing.assert_allclose(run.channel("left"), np.multiply(A + A, 9.80665))
    track = open_log(path).tracks[0]
    lines = path.read_text().splitlines()
    for row, text in ((0, "\t".join(ROWS[0])), (5, "\t".join(later[1]))):
        assert lines[int(track.locate(row).removeprefix("line ")) - 1] == text


def test_a_pause_between_segments_is_a_gap_and_not_hidden(lvm):
    path = lvm(
        file_header(multi="Yes")
        + segment(ROWS, ["left", "right"], ["g", "g"])
        + "\n"
        + segment(ROWS, ["left", "right"], ["g", "g"], clock="12:00:07.5")
    )
    with pytest.raises(InputError, match=r"run\.lvm line 38: the time jumps from 0.03 s to 7.5 s"):
        read_log(path)


def test_time_columns_of_their_own_make_clocks_of_their_own(lvm, block_bytes):
    rows = [[f"{0.01 * k}", A[k], f"{0.01 * k}", B[k], f"{0.02 * k}" * (k < 2), "7" * (k < 2)] for k in range(4)]
    text = file_header(x_columns="Multi") + segment(
        rows,
        [],
        ["g", "mm", "degC"],
        dx=["0.01", "0.01", "0.02"],
        labels=["X_Value", "left", "X_Value", "right", "X_Value", "slow", "Comment"],
    ).replace("Samples\t4\t4\t4", "Samples\t4\t4\t2")
    log = open_log(lvm(text))
    assert [[each.name for each in track.channels] for track in log.tracks] == [["left", "right"], ["slow"]]
    fast, slow = ([*track.blocks()] for track in log.tracks)
    np.testing.assert_array_equal(np.concatenate([block.samples for block in fast]), np.transpose([A, B]))
    np.testing.assert_array_equal(np.concatenate([block.samples for block in slow]), [[7.0], [7.0]])
    np.testing.assert_allclose(np.concatenate([block.stamps for block in slow]), [0, 0.02])


SLOW = ["7", "8", "", ""]  # every 0.02 s


@pytest.mark.parametrize(
    ("x_columns", "x", "columns", "names", "dx"),
    [
        ("One", ["0", "0.01", "0.02", "0.03"], [A, B, SLOW], ["left", "right", "slow"], ["0.01", "0.010", "0.02"]),
        ("One", ["0", "0.02", "", ""], [SLOW, A, B], ["slow", "left", "right"], ["0.02", "0.01", "0.010"]),
        ("No", [""] * 4, [SLOW, A, B], ["slow", "left", "right"], ["0.02", "0.01", "0.010"]),
    ],
)
def test_channels_of_different_periods_are_clocks_of_their_own(lvm, block_bytes, x_columns, x, columns, names, dx):
    rows = [list(row) for row in zip(x, *columns, strict=True)]
    log = open_log(lvm(file_header(x_columns=x_columns) + segment(rows, names, ["g"] * 3, dx=dx)))
    found = {}
    for track in log.tracks:
        blocks = [*track.blocks()]
        samples, stamps = (np.concatenate([getattr(each, key) for each in blocks]) for key in ("samples", "stamps"))
        found |= {channel.name: (own, stamps) for channel, own in zip(track.channels, samples.T, strict=True)}
    for name, values in (("left", A), ("right", B)):
        np.testing.assert_array_equal(found[name][0], values)
        np.testing.assert_allclose(found[name][1], [0, 0.01, 0.02, 0.03])
    np.testing.assert_array_equal(found["slow"][0], [7.0, 8.0])
    np.testing.assert_allclose(found["slow"][1], [0, 0.02])
    assert read_log(log.path, channels=["left", "right"]).fs == pytest.approx(100.0)


def test_different_periods_in_pieces_that_state_no_time_are_refused(lvm):
    rows = [["", a, b] for a, b in zip(SLOW + SLOW, A + A, strict=True)]  # written twice below one header
    path = lvm(file_header(x_columns="No") + segment(rows, ["slow", "left"], ["g", "g"], dx=["0.02", "0.01"]))
    assert read_log(path, channels=["left"]).n_samples == 8
    with pytest.raises(
        InputError, match=r"run\.lvm line 27: numbers follow empty cells, and channels have different De"
    ):
        read_log(path, channels=["slow"])


def test_channels_of_one_name_are_numbered(lvm):
    log = open_log(lvm(file_header() + segment(ROWS, ["Voltage", "Voltage"], ["V", ""])))
    assert log.names == ("Voltage 1", "Voltage 2")
    assert [each.unit for each in log.tracks[0].channels] == ["V", None]


def test_a_stated_rate_takes_the_place_of_stamps(lvm):
    path = lvm(file_header() + segment([["0", *row[1:]] for row in ROWS], ["left", "right"], ["g", "g"]))
    assert read_log(path, LogSettings(fs_hz=512)).fs == 512
    with pytest.raises(InputError, match="stands twice in a row"):
        read_log(path)


GOOD = file_header() + segment(ROWS, ["left", "right"], ["g", "g"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time [s],a [g]\n0,1\n", "is no LabVIEW LVM file"),
        (file_header(), "no segment of data below its header"),
        (GOOD[:120], "no segment of data"),
        (GOOD[: GOOD.index("X_Value")], "the end of .*: 3 names that begin with X_Value were expected"),
        (GOOD[: GOOD.index("X_Value") + 12], "line 22: 3 names that begin with X_Value were expected .* found 2"),
        (GOOD.replace("Channels\t2", "Channels\tmany"), "line 22: .*says Channels 'many': a number from 1"),
        (GOOD.replace("Channels\t2", "Channels"), "says Channels '': a number from 1"),
        (GOOD.replace("Channels\t2", "Channels\t-1"), "says Channels '-1'"),
        (GOOD.replace("Channels\t2", "Channels\t1000000000"), "says Channels '1000000000': a number from 1 to 4096"),
        (GOOD.replace("Channels\t2", "Channels\t9"), "10 names that begin with X_Value .* for 9 channel"),
        (GOOD.replace("X_Columns\tOne", "X_Columns\tSome"), "X_Columns 'some'"),
        (GOOD.replace("Separator\tTab", "Separator|Tab"), "Separator '|'"),
        (GOOD.replace("***End_of_Header***", "x"), "no segment of data"),
        (file_header() + "note\t1\n" * 2000, "line 1013: a header of 1001 lines has no"),
        (GOOD.replace(ROWS[2][1], "off"), r"line 25, column 'left': 'off' is not a number"),
        (GOOD.replace("\t".join(ROWS[3]), "0.03"), r"line 26 has 1 cell\(s\) where the header has 3"),
        (GOOD.replace("\n0.020000", "\n"), "line 25, column 'X_Value': the cell is empty"),
        (GOOD + "\n" + segment(ROWS, ["left", "other"], ["g", "g"]), "line 37: this segment has other channels"),
        (GOOD + "\n" + segment(ROWS, ["left", "right"], ["g", "g"], clock="noon"), "Date and Time do not say when"),
        (
            file_header(x_columns="No") + segment([["", "1"]] * 3, ["left"], ["g"], dx=""),
            "says X0 '0', Delta_X '': give `fs_hz`",
        ),
        (GOOD.encode() + b"0.04\t1\t\0\n", "line 27 is binary or UTF-16"),
        (GOOD + "1" * 2_000_000, "line 27 has more than 1048576 characters"),
    ],
)
def test_a_bad_file_is_refused_with_place_and_remedy(lvm, text, words):
    with pytest.raises(InputError, match=words) as caught:
        read_log(lvm(text))
    assert "run.lvm" in str(caught.value)


def test_what_a_german_labview_wrote_is_read_and_told(lvm):
    run = read_log(lvm(GOOD.replace("right", "Höhe").encode("cp1252")))
    assert run.names[1] == "Höhe"
    assert run.history[1] == "the text is no UTF-8 and is read as cp1252 (Western Windows)"


@pytest.mark.parametrize("text", [file_header(), GOOD.replace("Channels\t2", "Channels\ttwo")])
def test_a_refused_file_is_closed_while_the_error_is_still_held(lvm, monkeypatch, text):
    opened = []

    def remember(path):
        opened.append(path.open("rb"))
        return opened[-1]

    monkeypatch.setattr(text_table, "_open", remember)
    with pytest.raises(InputError) as caught:
        open_log(lvm(text))
    assert opened, caught.value
    assert all(file.closed for file in opened)


def test_nothing_is_unpickled_or_written_beside_the_file(lvm, tmp_path):
    path = lvm(GOOD)
    (tmp_path / "run.lvm.pkl").write_bytes(b"cos\nsystem\n(S'touch " + bytes(tmp_path / "owned") + b"'\ntR.")
    assert read_log(path).n_samples == 4
    assert {each.name for each in tmp_path.iterdir()} == {"run.lvm", "run.lvm.pkl"}


def test_the_usual_library_reads_the_same(lvm):
    library = pytest.importorskip("lvm_read")
    text = file_header(multi="Yes") + GOOD.removeprefix(file_header())
    later = [[f"{0.04 + 0.01 * k:.6f}", *row[1:]] for k, row in enumerate(ROWS)]
    text += "\n" + segment(later, ["left", "right"], ["g", "g"])
    theirs = library.read_str(text)  # of a string: no file, no pickle
    both = np.concatenate([theirs[0]["data"][:, 1:3], theirs[1]["data"][:, 1:3]])
    np.testing.assert_allclose(read_log(lvm(text)).samples, both * 9.80665)


def test_a_footbridge_measured_by_others():
    run = read_log(measured(SAMPLE))
    # 102.4 kHz / 62; the header rounds the period to 0.000605 s, which would be 1652.9 Hz
    assert run.fs == pytest.approx(102400 / 62, rel=1e-7)
    assert [(each.name, each.unit) for each in run.channels] == [("Acceleration", "m/s^2")]
    table = np.loadtxt(measured(SAMPLE), delimiter=",", skiprows=23)
    np.testing.assert_array_equal(run.samples[:, 0], table[:, 1] * 9.80665)


NOON = datetime(2024, 5, 1, 12)


def test_date_and_time_are_the_zero(lvm):
    later = segment(ROWS, "AB", "gg", clock="12:00:03.25")
    assert open_log(lvm(file_header() + later)).zero == NOON + timedelta(seconds=3.25)
    undated = later.replace("Date\t2024/05/01\t2024/05/01\n", "").replace("Time\t12:00:03.25\t12:00:03.25\n", "")
    assert open_log(lvm(file_header() + undated)).zero == NOON
    neither = file_header().replace("Date\t2024/05/01\n", "") + undated
    assert open_log(lvm(neither)).zero is None
    rows = [[f"{2.5 + 0.01 * k}", *row[1:]] for k, row in enumerate(ROWS)]
    stamped = lvm(file_header() + segment(rows, "AB", "gg"))
    assert open_log(stamped).zero == NOON
    assert open_log(stamped, LogSettings(fs_hz=100.0)).zero == NOON + timedelta(seconds=2.5)  # its first row is at 0


@pytest.mark.parametrize("preference", ["Relative", "Absolute"])
def test_large_x_values_count_from_1904(lvm, preference):
    rows = [[f"{3.7e9 + 0.01 * k:.6f}", *row[1:]] for k, row in enumerate(ROWS)]
    header = file_header().replace("Relative", preference)
    log = open_log(lvm(header + segment(rows, "AB", "gg")))
    assert log.zero == datetime(1904, 1, 1, tzinfo=UTC)
    assert open_log(lvm(header + segment(ROWS, "AB", "gg"))).zero == NOON


@pytest.mark.parametrize("fs_hz", [None, 100.0])
def test_channels_that_began_at_different_times_are_on_one_axis(lvm, fs_hz):
    rows = [[cell for pair in zip([row[0]] * 2, row[1:], strict=True) for cell in pair] for row in ROWS]
    text = segment(rows, "AB", "gg", labels=["X_Value", "A", "X_Value", "B", "Comment"])
    text = text.replace("Time\t12:00:00\t12:00:00", "Time\t12:00:01.5\t12:00:00")
    log = open_log(lvm(file_header(x_columns="Multi") + text), LogSettings(fs_hz=fs_hz))
    assert log.zero == NOON
    first = {}
    for track in log.tracks:
        stamps = next(track.blocks()).stamps
        first[track.channels[0].name] = track.start_s if stamps is None else stamps[0]
    assert first == {"A": 1.5, "B": 0.0}


def test_the_real_log_began_when_its_header_says():
    assert open_log(measured(SAMPLE)).zero == datetime(2022, 2, 10, 9, 59, 53, 189_069)
