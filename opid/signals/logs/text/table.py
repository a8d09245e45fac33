"""The numbers of a table in a text, block by block: by numpy's parser, cell by cell where a fault is to be named."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, repeat
from pathlib import Path

import numpy as np

from opid.errors import InputError
from opid.signals.logs.text.lines import lines_of
from opid.signals.recording import FloatArray

MOST_COLUMNS = 4096
"""More is a matrix that was written across: a line for each channel."""

BLANKS = " "
"""The delimiter of columns that are set apart by any number of blanks or tabs."""

COMMENTS = ("#", "%", "//")
"""What lines begin with that are remarks."""

MISSING = frozenset(("", "nan", "+nan", "-nan", "na", "n/a", "null", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"))
"""What stands where a logger had no value, without regard to case; the last four are those of Windows."""

_LINES_AT_ONCE = 1 << 15
_NUMBERS_BEGIN = frozenset("0123456789+-.")
# 1,234.5 or 1,234,567 but not 1,234, which may be a decimal comma; a blank may be a delimiter, unless decimals follow
_THOUSANDS = {
    decimal: re.compile(
        rf"[+-]?[1-9]\d{{0,2}}(?:(?:[{mark} ]\d{{3}})+[{decimal}]\d+|(?:[{mark}]\d{{3}}){{2,}}"
        rf"|(?:['\u2019\u00a0\u202f]\d{{3}})+(?:[{decimal}]\d+)?)",
        re.ASCII,
    )
    for decimal, mark in ((".", ","), (",", "."))
}
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:[,.]\d{3})+", re.ASCII)
_INFINITE = frozenset(("inf", "+inf", "-inf", "infinity", "+infinity", "-infinity", "1.#inf", "-1.#inf"))


@dataclass(frozen=True)
class TextTable:
    """Where the numbers of a text stand.

    Args:
        path: the file.
        encoding: of the text, None for what it says itself.
        delimiter: one character, `BLANKS` for runs of blanks.
        decimal: "." or ",".
        first_line: of the numbers, counted from 1.
        names: of all columns, for messages.
        more: whether cells may follow those of the columns, like the comments of a LabVIEW file.
        time: number of the column with the time, from 0, for messages.
        content: its lines, header and all, where they are in memory; None where the file is the text.
    """

    path: Path
    encoding: str | None
    delimiter: str
    decimal: str
    first_line: int
    names: tuple[str, ...]
    more: bool = False
    time: int | None = None
    content: tuple[str, ...] | None = None


def table_lines(table: TextTable) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a table in blocks, each with the number of its first line."""
    number = 1
    for lines in lines_of(table.path, table.encoding) if table.content is None else _split_blocks(table.content):
        skipped = max(0, min(table.first_line - number, len(lines)))
        if skipped < len(lines):
            yield number + skipped, lines[skipped:]
        number += len(lines)


def is_row(line: str, delimiter: str) -> bool:
    """Return whether a line is a row: neither blank nor a remark."""
    bare = line.strip(" " if delimiter == "\t" else None)
    return bool(bare) and not bare.startswith(COMMENTS)


def rows_of(lines: Sequence[str], delimiter: str) -> list[str]:
    """Return those lines that are rows."""
    return [line for line in lines if line[:1] in _NUMBERS_BEGIN or is_row(line, delimiter)]


def line_of_row(table: TextTable, row: int) -> int:
    """Return the number of the line in which a row of a table stands."""
    numbers = (
        number + at
        for number, lines in table_lines(table)
        for at, line in enumerate(lines)
        if is_row(line, table.delimiter)
    )
    return next(islice(numbers, row, None))


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line with this delimiter, quotes and the blanks around them removed.

    >>> cells_of('0, 1 ,"a, b"', ",")
    ['0', '1', 'a, b']
    """
    if '"' not in line:
        cells = line.split() if delimiter == BLANKS else line.split(delimiter)
    else:
        try:
            bare = " ".join(line.split()) if delimiter == BLANKS else line
            cells = next(csv.reader([bare], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error as error:
            raise InputError(f"is no line of a table ({error}): mend it") from error
    return [cell.strip() for cell in cells]


def numbers_of(table: TextTable, number: int, lines: Sequence[str], columns: Sequence[int]) -> FloatArray:
    """Return the numbers of some lines, (n_rows, n_columns): NaN where a cell is empty or not finite."""
    rows = rows_of(lines, table.delimiter)
    if not rows:
        return np.empty((0, len(columns)))
    if not columns:
        require_cells(table, number, lines)
        return np.empty((len(rows), 0))
    values = _parse(table, rows, columns)
    if values is None:
        values = _cell_by_cell(table, number, lines, columns)
    values[np.isinf(values)] = np.nan  # an overload is no value either
    return values


def column_of(table: TextTable, number: int, lines: Sequence[str], column: int) -> list[str]:
    """Return the cells of one column as they are written."""
    rows = rows_of(lines, table.delimiter)
    if _is_even(table, rows):
        separator = None if table.delimiter == BLANKS else table.delimiter
        return [row.split(separator, column + 1)[column] for row in rows]
    return [cells[column] for _, cells in _numbered_rows(table, number, lines)]


def require_cells(table: TextTable, number: int, lines: Sequence[str]) -> None:
    """Raise the error that names the first line with too few or too many cells, if there is one."""
    if not _is_even(table, rows_of(lines, table.delimiter)):
        for _ in _numbered_rows(table, number, lines):
            pass


def number_of(cell: str, decimal: str) -> float | None:
    """Return the number, written with this decimal mark, that a cell holds.

    NaN where the cell says that there is none, None where it holds something else.

    >>> number_of("1,5", ","), number_of("1_000", "."), number_of(" ", ".")
    (1.5, None, nan)
    """
    bare = cell.strip().casefold()
    if bare in MISSING:
        return np.nan
    if bare in _INFINITE:
        return -np.inf if bare.startswith("-") else np.inf
    if decimal == ",":
        if "." in bare or not bare[-1].isdigit():
            return None
        bare = bare.replace(",", ".")
    # Python reads 1_000 as a thousand, and the digits of every script; no logger writes these
    if "_" in bare or not bare.isascii():
        return None
    try:
        return float(bare)
    except ValueError:
        return None


def has_thousands_mark(cell: str, decimal: str, *, perhaps: bool = False) -> bool:
    """Return whether a cell holds a number whose thousands are set apart.

    >>> has_thousands_mark("1,234.5", "."), has_thousands_mark("1.234,5", ","), has_thousands_mark("1,234", ".")
    (True, True, False)
    """
    return bool(_THOUSANDS[decimal].fullmatch(cell) or (perhaps and _GROUPED.fullmatch(cell)))


def _split_blocks(lines: Sequence[str]) -> Iterator[list[str]]:
    for first in range(0, len(lines), _LINES_AT_ONCE):
        yield list(lines[first : first + _LINES_AT_ONCE])


# ---- all cells at once ---------------------------------------------------------------------------


def _is_even(table: TextTable, rows: Sequence[str]) -> bool:
    """Whether plain splitting gives every row its cells."""
    n = len(table.names)
    if table.delimiter == BLANKS:
        counts = {len(row.split()) for row in rows}
    else:
        counts = {found + 1 for found in set(map(str.count, rows, repeat(table.delimiter)))}
    right = min(counts, default=n) >= n if table.more else counts <= {n}
    return right and '"' not in "".join(rows)


def _parse(table: TextTable, rows: list[str], columns: Sequence[int]) -> FloatArray | None:
    """The numbers by numpy's parser, which knows neither empty cells nor line numbers; None where it fails."""
    mark = table.delimiter
    if mark == table.decimal:
        return None
    even = _is_even(table, rows)
    if table.decimal == ",":
        # a point is then not a decimal, and must not be read as one
        rows = "\n".join(rows).replace(".", "_").replace(",", ".").split("\n")
    if not even:
        # numpy counts quoted cells, but only if it is to parse all of them
        values = None if table.more else _load(rows, mark, None)
        return values[:, list(columns)] if values is not None and values.shape[1] == len(table.names) else None
    values = _load(rows, mark, columns)
    if values is None and mark != BLANKS:
        text = "\n".join(("", *rows, ""))
        filled = text.replace(mark + mark, f"{mark}nan{mark}").replace(mark + mark, f"{mark}nan{mark}")
        filled = filled.replace("\n" + mark, "\nnan" + mark).replace(mark + "\n", mark + "nan\n")
        values = _load(filled[1:-1].split("\n"), mark, columns)
    return values


def _load(rows: Sequence[str], delimiter: str, columns: Sequence[int] | None) -> FloatArray | None:
    try:
        return np.loadtxt(
            rows,
            delimiter=None if delimiter == BLANKS else delimiter,
            comments=None,
            quotechar='"',
            usecols=None if columns is None else tuple(columns),
            ndmin=2,
        )
    except ValueError:
        return None


# ---- cell by cell --------------------------------------------------------------------------------


def _numbered_rows(table: TextTable, number: int, lines: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each row, and the error of the first with a wrong count of them."""
    n = len(table.names)
    for at, line in enumerate(lines, start=number):
        if not is_row(line, table.delimiter):
            continue
        try:
            cells = cells_of(line, table.delimiter)
        except InputError as error:
            raise InputError(f"{table.path} line {at} {error}") from error
        if len(cells) < n or (len(cells) > n and not table.more):
            raise InputError(
                f"{table.path} line {at} has {len(cells)} cell(s) where the header has {n}: "
                "mend the line, or delete it if the log was cut off there"
            )
        yield at, cells


def _cell_by_cell(table: TextTable, number: int, lines: Sequence[str], columns: Sequence[int]) -> FloatArray:
    values = []
    for at, cells in _numbered_rows(table, number, lines):
        own = [number_of(cells[column], table.decimal) for column in columns]
        if None in own:
            column = columns[own.index(None)]
            fault = _fault(cells[column], table.decimal, is_time=column == table.time)
            raise InputError(f"{table.path} line {at}, column {table.names[column]!r}: {fault}")
        values.append(own)
    return np.array(values, dtype=np.float64)


def _fault(cell: str, decimal: str, *, is_time: bool) -> str:
    other = "," if decimal == "." else "."
    if has_thousands_mark(cell, decimal) or has_thousands_mark(cell, other):
        return f"{cell[:40]!r} has a mark between the thousands: export the log again without it"
    if number_of(cell, other) is not None:
        word = "comma" if other == "," else "point"
        if _GROUPED.fullmatch(cell):
            return (
                f"{cell!r} has a decimal {word} or a mark between the thousands, unlike the lines before it: "
                "give `decimal` in [log], or export the log again without thousands marks"
            )
        return f"{cell!r} has a decimal {word}, unlike the lines before it: give `decimal` in [log], or mend the line"
    if is_time:
        return (
            f"{cell[:40]!r} is not a number: every row needs its time; "
            "mend the line, cut the log there, or give `fs_hz` in [log]"
        )
    return (
        f"{cell[:40]!r} is not a number: give numbers only below the header, leave the cell empty where there is none, "
        "or name the channels that are wanted without this one"
    )
