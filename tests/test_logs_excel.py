"""Excel workbooks: the first sheet with numbers is read like a text; what would not fit into memory is refused."""

import numpy as np
import pytest
from small_logs import FS, NAMES, UNIT, VALUES, T, xlsx

from opid.errors import InputError
from opid.signals.log import LogSettings
from opid.signals.logs import open_log, read_log

HEADER = ["time [s]", *(f"{name} [{UNIT}]" for name in NAMES)]
ROWS = [[t, *row] for t, row in zip(T.tolist(), VALUES.tolist(), strict=True)]


@pytest.fixture
def workbook(tmp_path):
    pytest.importorskip("python_calamine")

    def write(rows, **more):
        path = tmp_path / "run.xlsx"
        path.write_bytes(rows if isinstance(rows, bytes) else xlsx(rows, **more))
        return path

    return write


@pytest.mark.parametrize(
    ("rows", "given"),
    [
        ([HEADER, *ROWS], {}),
        ([["Test of", "Tuesday"], [""], HEADER, *ROWS], {}),
        ([["time", *NAMES], ["s", UNIT, UNIT], *ROWS], {}),
        ([["", *HEADER], *([k, *row] for k, row in enumerate(ROWS))], {}),
        ([[*HEADER, "remark"], *([*row, "driver's seat"] for row in ROWS)], {}),
        ([HEADER, *ROWS], {"decimal": ",", "delimiter": ";", "encoding": "cp1252"}),  # of a text beside it
        (ROWS, {"names": HEADER}),
    ],
)
def test_a_sheet_is_read_like_a_text(workbook, rows, given):
    run = read_log(workbook(rows), LogSettings(**given))
    assert (run.fs, run.names) == (FS, NAMES)
    np.testing.assert_array_equal(run.samples, VALUES)


def test_dates_count_from_the_first(workbook):
    stamps = [f"2024-05-01T12:00:{k / 2:06.3f}" for k in range(10)]
    run = read_log(workbook([["date", "az [g]"], *([stamp, k * 0.1] for k, stamp in enumerate(stamps))]))
    assert (run.fs, run.names) == (2.0, ("az",))


def test_the_first_sheet_with_numbers_is_read_and_told(workbook):
    run = read_log(workbook([HEADER, *ROWS], other=[["Notes"], ["nothing was measured"]]))
    np.testing.assert_array_equal(run.samples, VALUES)
    assert "the sheet 'sheet2' is read, the first with numbers" in run.history
    with pytest.raises(InputError, match=r"run\.xlsx has no sheet with numbers"):
        open_log(workbook([["Notes"], ["nothing was measured"]]))


def test_a_fault_is_named_with_its_row(workbook):
    rows = [list(row) for row in ROWS]
    rows[20][1] = "off"
    with pytest.raises(InputError, match=r"run\.xlsx line 22, column 'lower': 'off' is not a number"):
        read_log(workbook([HEADER, *rows]))


def test_the_older_format_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "run.xls"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")
    with pytest.raises(InputError, match=r"older format of Excel is not read: save it as \.xlsx"):
        open_log(path)
