"""Logs as text: what is read, what is written, and what is said about a file that is at fault."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from opid.errors import InputError
from opid.signals.logs import read_log, write_log
from opid.signals.recording import Channel, Recording, recording_from_arrays

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
    ],
)
def test_the_freedoms_of_a_log(log, content):
    run, plain = log(content), log(GOOD)
    assert (run.fs, run.channels) == (plain.fs, plain.channels)
    np.testing.assert_array_equal(run.samples, plain.samples)


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
        ("time [s],b\n1,2\n2,3\n", "channel 'b' states no unit: give `unit`"),
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
            GOOD.replace("^2", "²").encode("latin-1"),
            r"""line 1 is not UTF-8 text \(byte 0xb2\): if that stands for '²', give encoding = "latin-1" in \[log\]""",
        ),
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
    data=st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=3, max_size=40),
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
