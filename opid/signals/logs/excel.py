"""Excel workbooks (.xlsx): the first sheet with numbers is read as the text table that it would be, row by row.

Header, units, time and channels are found as in a text (`opid.signals.logs.csv`).
Cells of the time may be dates. A workbook is read whole when it is opened.
"""

from __future__ import annotations

import re
import zipfile
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO

from opid.errors import InputError
from opid.signals.archives import opened_archive
from opid.signals.log import Log
from opid.signals.log_settings import LogSettings
from opid.signals.logs import reader
from opid.signals.logs.csv import log_of_lines

_SHEET = re.compile(r"xl/worksheets/[^/]+\.xml")
_PLACE = re.compile(rb"<(?:\w+:)?(?:c|row)\s(?:[^>]*\s)?r=[\"']([A-Z]{0,4})(\d{1,8})[\"']")
_BYTES_AT_ONCE = 1 << 20
_LONGEST_TAG = 1 << 10
_SPARSE = 100
"""Cells of the rectangle around a sheet's cells, over those that are written: it is held in memory as a whole."""

_FEW_CELLS = 1 << 20


@reader(".xlsx", name="Excel", needs="python-calamine", extra="excel", magic=(b"PK\x03\x04",))
def open_excel(path: Path, settings: LogSettings) -> Log:
    """Open an Excel workbook: its first sheet with numbers.

    Args:
        path: the file.
        settings: what the file does not say; what sets columns and decimals of a text apart has no meaning here.

    Raises:
        InputError: the file is damaged, unfolds to more than memory holds, or its table is at fault, with its row.
    """
    import python_calamine

    with opened_archive(path) as archive:
        names = [name for name in archive.namelist() if _SHEET.fullmatch(name)]
        for name in names:
            with archive.open(name) as sheet:
                _require_dense(path, sheet)
        if "[Content_Types].xml" not in archive.namelist() or not names:
            raise zipfile.BadZipFile("no sheet in it")
    with python_calamine.CalamineWorkbook.from_path(path) as workbook:
        for name in workbook.sheet_names:
            lines, has_numbers = _lines(workbook.get_sheet_by_name(name))
            if has_numbers:
                others = len(workbook.sheet_names) - 1
                remarks = (f"the sheet {name!r} is read, the first with numbers",) if others else ()
                return log_of_lines(path, lines, settings, form="Excel", remarks=remarks)
    raise InputError(f"{path} has no sheet with numbers: save the table itself, not a chart of it")


def _require_dense(path: Path, sheet: IO[bytes]) -> None:
    """Refuse a sheet whose cells lie so far apart that the rectangle around them does not fit into memory."""
    found, n_rows, n_columns, rest = 0, 0, 0, b""
    while data := sheet.read(_BYTES_AT_ONCE):
        text = rest + data
        end = text.rfind(b">") + 1 or max(0, len(text) - _LONGEST_TAG)
        for letters, digits in _PLACE.findall(text[:end]):
            found, n_rows = found + 1, max(n_rows, int(digits))
            column = 0
            for letter in letters:
                column = 26 * column + letter - 64
            n_columns = max(n_columns, column)
        rest = text[end:]
    if n_rows * n_columns > max(_FEW_CELLS, _SPARSE * found):
        raise InputError(
            f"{path} has a sheet of {n_rows} rows and {n_columns} columns with {found} cells in them: "
            "delete what stands far from the table, and save it again"
        )


def _lines(sheet: object) -> tuple[list[str], bool]:
    """The rows of a sheet as lines of cells between tabs, and whether there are numbers in it."""
    lines, has_numbers = [], False
    for row in sheet.iter_rows():  # type: ignore[attr-defined]
        has_numbers = has_numbers or any(type(cell) in (int, float) for cell in row)
        line = "\t".join(map(_text, row))
        lines.append(line if line.strip() else "")
    return lines, has_numbers


def _text(cell: object) -> str:
    if type(cell) is float:
        return str(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return " ".join(str(cell).replace('"', "''").split())
