"""Logs as text: a header `time [s],lower_z [m/s^2],upper_z [g]`, or another, then one line for each sample."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from opid.errors import FileError, InputError, nearest
from opid.signals.files import write_whole
from opid.signals.log import AS_WRITTEN, Block, Log, LoggedChannel, LogSettings, Track, rows_from_start
from opid.signals.logs import reader, writer
from opid.signals.logs.text.header import (
    DATE,
    EMPTY,
    EXAMPLE,
    INDEX,
    NUMBER,
    STAMP,
    TEXT,
    UNREAD,
    TextHeader,
    cells_or_text,
    columns_of,
    header_of,
)
from opid.signals.logs.text.stamps import has_date, looks_dated, moment, nanoseconds, past_midnight
from opid.signals.logs.text.table import (
    HEAD_BYTES,
    LONGEST_LINE,
    MOST_COLUMNS,
    TextTable,
    cells_of,
    column_of,
    has_thousands_mark,
    is_row,
    line_of_row,
    lines_of,
    numbers_of,
    rows_of,
    table_lines,
    with_encoding,
)
from opid.signals.recording import Channel, Recording
from opid.signals.units import seconds_per_unit, si_unit, time_name

_ROWS_AT_ONCE = 1 << 16
_HEAD_LINES = 1000


@reader(".csv", ".tsv", ".txt", ".dat", ".asc", name="CSV", text=True)
def open_csv(path: Path, settings: LogSettings) -> Log:
    """Open a log that is a table in a text; columns of texts, and dates other than the time, are no channels.

    Times that are dates count from the first one, which is the zero of the log.
    """
    settings, remarks = with_encoding(path, settings)
    return _make_log(path, _read_head(path, settings), settings, "CSV", None, remarks)


def log_of_lines(
    path: Path, lines: Sequence[str], settings: LogSettings, *, form: str, remarks: tuple[str, ...] = ()
) -> Log:
    """Return the log of some lines in memory, whose cells are separated by tabs."""
    settings = replace(settings, delimiter="\t", decimal=".", encoding=None)
    head = list(lines[: (settings.skip_lines or 0) + _HEAD_LINES])
    return _make_log(path, head, settings, form, tuple(lines), remarks)


def _make_log(
    path: Path,
    head: Sequence[str],
    settings: LogSettings,
    form: str,
    lines: tuple[str, ...] | None,
    remarks: tuple[str, ...],
) -> Log:
    """Return the log whose first lines are `head`: of all lines in memory, or of the file where `lines` is None."""
    header = header_of(path, head, settings)
    columns = header.columns
    first = _read_first_cells(head, header)
    time = _find_time_column(path, header, settings)
    if time is None and settings.fs_hz is None:
        raise _describe_missing_time(path, header, settings)
    # a column that has a name may be empty so far
    empty = [each.kind == EMPTY and not each.name.startswith("column ") for each in columns]
    own = [i for i, each in enumerate(columns) if i != time and (each.kind == NUMBER or empty[i])]
    if columns[0].kind == INDEX and time != 0:
        remarks = (*remarks, "the first column has no name and counts the rows: it is left out")
    if not own:
        raise _describe_missing_channels(path, header, first)
    names = tuple(column.name for column in columns)
    layout = (header.delimiter, header.decimal, header.first_line)
    table = TextTable(path, settings.encoding, *layout, names, time=time, content=lines)
    factor = None if time is None or settings.fs_hz else _find_time_unit(path, header, time, first, settings)

    def blocks(chosen: Sequence[int]) -> Iterator[Block]:
        wanted = [own[each] for each in chosen]
        if settings.fs_hz or time is None:
            return (Block(numbers_of(table, *lines, wanted)) for lines in table_lines(table))
        if factor is None:
            return _read_dated_blocks(table, wanted, time)
        return _read_timed_blocks(table, wanted, time, factor)

    track = Track(
        tuple(LoggedChannel(columns[i].name, columns[i].unit) for i in own),
        rows_from_start(blocks),
        fs=settings.fs_hz,
        locate=lambda row: f"line {line_of_row(table, row)}",
    )
    zero = None if time is None or time >= len(first) else moment(first[time])
    return Log(path, form, (track,), zero, remarks=remarks)


@writer(".csv")
def write_csv(recording: Recording, path: Path) -> None:
    """Write a recording as comma-separated text that reads back to the last bit."""
    header = _make_header(recording, path)
    columns = (recording.time_s, *recording.samples.T)
    with write_whole(path) as file:
        file.write(header + "\n")
        for start in range(0, recording.n_samples, _ROWS_AT_ONCE):
            block = (map(repr, column[start : start + _ROWS_AT_ONCE].tolist()) for column in columns)
            file.writelines(",".join(row) + "\n" for row in zip(*block, strict=True))


# ---- columns -------------------------------------------------------------------------------------


def _read_head(path: Path, settings: LogSettings) -> list[str]:
    """Return the lines to be skipped, and about 100 KiB of the lines after them."""
    head: list[str] = []
    characters = 0
    for lines in lines_of(path, settings.encoding, bytes_at_once=HEAD_BYTES):
        head += lines
        characters += sum(map(len, lines[max(0, len(lines) + (settings.skip_lines or 0) - len(head)) :]))
        if characters > HEAD_BYTES // 2:
            break
    return head


def _read_first_cells(head: Sequence[str], header: TextHeader) -> list[str]:
    """Return the cells of the first row, at most one for each column; none where there is no row."""
    rows = rows_of(head[header.first_line - 1 :], header.delimiter)
    cells = cells_or_text(rows[0], header.delimiter) if rows else []
    return cells[: len(header.columns)]


def _find_time_column(path: Path, header: TextHeader, settings: LogSettings) -> int | None:
    columns = header.columns
    names = [column.name for column in columns]
    if isinstance(settings.time, int):
        if not 1 <= settings.time <= len(names):
            raise FileError(f"{path}: time is column {settings.time} in [log]: give a number from 1 to {len(names)}")
        return settings.time - 1
    if settings.time is not None:
        if settings.time not in names:
            raise FileError(f"{path} has no column {settings.time!r} (time in [log]): {nearest(settings.time, names)}")
        return names.index(settings.time)
    sure = [i for i, each in enumerate(columns) if each.kind == STAMP or si_unit(each.unit or "") == "s"]
    likely = time_name([names[i] for i in sure])
    if likely is not None:
        found = [i for i in sure if names[i].casefold() == likely.casefold()]
        if len(found) > 1:
            raise FileError(f"{_locate(path, header)} names {len(found)} columns {likely!r}: rename all but one")
        return found[0]
    stamps = [i for i in sure if columns[i].kind == STAMP]
    unsure = time_name([each.name for each in columns if si_unit(each.unit or "") is None])
    last = [] if unsure is None else [names.index(unsure)]
    last += [i for i, each in enumerate(columns) if each.kind == UNREAD]
    return next(iter([*(i for i in sure if i == 0), *stamps, *last]), None)


def _find_time_unit(
    path: Path, header: TextHeader, time: int, first: Sequence[str], settings: LogSettings
) -> float | None:
    """Return the unit of the time stamps, s; None where they are dates or times of day."""
    column = header.columns[time]
    if column.kind == STAMP:
        return None
    where = f"{_locate(path, header)}: column {column.name!r}"
    if column.kind == DATE:
        raise FileError(f"{where} holds dates without a time of day: give another as `time`, or `fs_hz`, in [log]")
    if column.kind in (TEXT, UNREAD):
        raise _describe_texts_as_time(where, first[time] if time < len(first) else "")
    unit = settings.time_unit or column.unit
    if unit is None:
        raise FileError(
            f"{where} has no unit: write it in brackets, like `{column.name} [s]`, or give `time_unit` in [log] of a "
            "study (--time-unit without one)"
        )
    return seconds_per_unit(unit, where=where)


def _describe_missing_time(path: Path, header: TextHeader, settings: LogSettings) -> InputError:
    where = _locate(path, header)
    if not header.line and not settings.names:
        return FileError(
            f"{where} is numbers, there is no header: begin with {EXAMPLE}, "
            "or give `names` and `time` (or `fs_hz`) in [log]"
        )
    column = header.columns[0]
    named = f"{column.name!r} in {column.unit}" if column.unit else f"{column.name!r}, without a unit"
    return FileError(
        f"{where}: there is no time column (the first is {named}): write {EXAMPLE}, "
        "or give `time` (name or number of the column) or `fs_hz` in [log]"
    )


def _describe_missing_channels(path: Path, header: TextHeader, first: Sequence[str]) -> InputError:
    grouped = [cell for cell in first if has_thousands_mark(cell, header.decimal, allow_ambiguous=True)]
    if grouped:
        return FileError(f"{path}: {_describe_thousands(grouped[0])}")
    if len(header.columns) == 1:
        return FileError(f"{_locate(path, header)} has one column, not time and one or more channels: write {EXAMPLE}")
    return FileError(f"{path} has no column of numbers beside the time: export the log again")


def _describe_texts_as_time(where: str, cell: str) -> InputError:
    """Return the error of a time column that holds texts, such as `cell`."""
    if looks_dated(cell):
        return FileError(
            f"{where} holds {cell[:40]!r}, a date or time in a form that is not read: "
            "write it as ISO 8601 does (2024-05-01T23:59:59.5), or give `fs_hz` in [log]"
        )
    if has_thousands_mark(cell, ".", allow_ambiguous=True) or has_thousands_mark(cell, ",", allow_ambiguous=True):
        return FileError(f"{where}: {_describe_thousands(cell)}")
    return FileError(f"{where} holds {cell[:40]!r}, which is no time: give another as `time`, or `fs_hz`, in [log]")


def _describe_thousands(cell: str) -> str:
    return f"{cell[:40]!r} has a mark between the thousands, or a decimal unlike the others: export the log without it"


def _locate(path: Path, header: TextHeader) -> str:
    return f"{path} line {header.line or header.first_line}"


# ---- blocks --------------------------------------------------------------------------------------


def _read_timed_blocks(table: TextTable, wanted: Sequence[int], time: int, factor: float) -> Iterator[Block]:
    for number, lines in table_lines(table):
        values = numbers_of(table, number, lines, [*wanted, time])
        written = values[:, -1]
        if np.isnan(written).any():
            raise _describe_missing_stamp(table, number, lines, time, int(np.argmax(np.isnan(written))))
        if written.size:
            yield Block(values[:, :-1], written * factor)


def _read_dated_blocks(table: TextTable, wanted: Sequence[int], time: int) -> Iterator[Block]:
    """Return the blocks of a table whose time column holds dates or times of day: seconds from the first."""
    origin: int | None = None
    before: int | None = None
    for number, lines in table_lines(table):
        cells = column_of(table, number, lines, time)
        if not cells:
            continue
        try:
            stamps = nanoseconds(cells)
        except ValueError as error:
            raise _describe_missing_stamp(table, number, lines, time, error.args[0]) from None
        if not has_date(cells[0]):
            stamps = past_midnight(stamps, before)
        before = int(stamps[-1])
        origin = int(stamps[0]) if origin is None else origin
        yield Block(numbers_of(table, number, lines, wanted), 1e-9 * (stamps - origin).astype(np.float64))


def _describe_missing_stamp(table: TextTable, number: int, lines: Sequence[str], time: int, row: int) -> InputError:
    at = [at for at, line in enumerate(lines, start=number) if is_row(line, table.delimiter)][row]
    cell = column_of(table, number, lines, time)[row].strip()
    fault = f"{cell[:40]!r} is not a finite number or a time" if cell else "the cell is empty"
    return FileError(
        f"{table.path} line {at}, column {table.names[time]!r}: {fault}: "
        "every row needs its time; mend the line, cut the log there, or give `fs_hz` in [log]"
    )


# ---- writing -------------------------------------------------------------------------------------


def _make_header(recording: Recording, path: Path) -> str:
    text = io.StringIO()
    cells = ("time [s]", *(f"{channel.name} [{channel.unit}]" for channel in recording.channels))
    csv.writer(text, lineterminator="\n").writerow(cells)
    line = text.getvalue().removesuffix("\n")
    read_back: tuple[Channel, ...] = ()
    if not set(line) & set("\n\r\0") and len(line) <= LONGEST_LINE and len(cells) <= MOST_COLUMNS:
        try:
            found = cells_of(line, ",")
            columns = columns_of(str(path), found, [None] * len(found), [NUMBER] * len(found))
            if _find_time_column(path, TextHeader(columns, ",", ".", 1, 2), AS_WRITTEN) == 0:
                read_back = tuple(Channel(column.name, column.unit or "") for column in columns[1:])
        except InputError as error:
            raise InputError(f"cannot write this recording: {error}") from error
    if read_back != recording.channels or any(si_unit(channel.unit) != channel.unit for channel in read_back):
        raise FileError(
            f"cannot write {path}: a header does not hold the names and units {recording.channels}: "
            "give one-line names and SI units"
        )
    return line
