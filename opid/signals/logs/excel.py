"""Excel workbooks (.xlsx): the first sheet with numbers is read as if it were a text.

Header, units, time and channels are found as in a text (`opid.signals.logs.csv`), and the time may be dates. A workbook
is read whole when it is opened.
"""

from __future__ import annotations

from datetime import date, datetime, time, timedelta
from pathlib import Path

from opid.errors import FileError
from opid.signals.log import Log, LogSettings
from opid.signals.logs import reader
from opid.signals.logs.csv import log_of_lines


@reader(".xlsx", name="Excel", needs="python-calamine", extra="excel", magic=(b"PK\x03\x04",))
def open_excel(path: Path, settings: LogSettings) -> Log:
    """Open an Excel workbook: its first sheet with numbers."""
    import python_calamine

    with python_calamine.CalamineWorkbook.from_path(path) as workbook:
        for name in workbook.sheet_names:
            lines, has_numbers = _read_lines(workbook.get_sheet_by_name(name))
            if has_numbers:
                others = len(workbook.sheet_names) - 1
                remarks = (f"the sheet {name!r} is read, the first with numbers",) if others else ()
                return log_of_lines(path, lines, settings, form="Excel", remarks=remarks)
    raise FileError(f"{path} has no sheet with numbers: save the table itself, not a chart of it")


def _read_lines(sheet: object) -> tuple[list[str], bool]:
    lines, has_numbers = [], False
    for row in sheet.iter_rows():  # type: ignore[attr-defined]
        has_numbers = has_numbers or any(type(cell) in (int, float) for cell in row)
        line = "\t".join(map(_to_text, row))
        lines.append(line if line.strip() else "")
    return lines, has_numbers


def _to_text(cell: object) -> str:
    if type(cell) is float:
        return str(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return " ".join(str(cell).replace('"', "''").split())
