"""A text as lines, rows, cells and numbers, block by block; compressed or not, in any encoding.

Numbers are read by numpy's parser, and cell by cell where a fault has to be named.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice, repeat
from pathlib import Path
from typing import IO

import numpy as np

from opid.errors import FileError, InputError
from opid.signals.log import LogSettings
from opid.signals.recording import FloatArray

LONGEST_LINE = 1 << 20
"""A file with longer lines is no table: these are characters of 40,000 numbers of full precision."""

BYTES_AT_ONCE = 1 << 20
"""A block of text: 1 MiB, which is about 4 MiB as lines and numbers."""

HEAD_BYTES = 1 << 17
"""The beginning of a text that shows its encoding and its header."""

MOST_COLUMNS = 4096
"""More columns are a transposed matrix, with a line for each channel."""

BLANKS = " "
"""The delimiter of columns with any number of blanks or tabs between them."""

COMMENTS = ("#", "%", "//")
"""Lines that begin with one of these are remarks."""

MISSING = frozenset(("", "nan", "+nan", "-nan", "na", "n/a", "null", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"))
"""Cells in place of a missing value, in any case; the last four are those of Windows."""

_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_WESTERN = frozenset(  # found in headers in Western Europe, but rarely in damaged bytes: not ÿ, þ or ð
    "ÄÖÜäöüßÁÀÂÃÅÆÇÉÈÊËÍÌÎÏÑÓÒÔÕØÚÙÛáàâãåæçéèêëíìîïñóòôõøúùûŒœ°²³µ±·×½§€–—’“”…™®©"
)
_LATIN = "°²³µ".encode("latin-1")
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
    """A table of numbers in a text."""

    path: Path  # the file
    encoding: str | None  # encoding of the text; None where its first bytes decide
    delimiter: str  # one character, `BLANKS` for any number of blanks
    decimal: str  # "." or ","
    first_line: int  # number of the first line of numbers, counted from 1
    names: tuple[str, ...]  # names of all columns, for messages
    more: bool = False  # whether other cells may follow those of the columns, like the comments of a LabVIEW file
    time: int | None = None  # index of the column with the time, for messages
    # all lines of the text, header included, where they are in memory; None where they are in the file
    content: tuple[str, ...] | None = None


# ---- lines -----------------------------------------------------------------------------------------


def lines_of(
    path: Path, encoding: str | None = None, *, bytes_at_once: int = BYTES_AT_ONCE
) -> Generator[list[str], None, None]:
    r"""Yield the lines of a text, block by block, without their ends (\n, \r\n or \r)."""
    number, remainder = 0, ""  # number of complete lines so far, and the beginning of the next
    with _open(path) as file:
        data = file.read(bytes_at_once)
        # an explicit encoding of UTF-8 must not keep the mark as a part of the first name
        marked = next((own for mark, own in _MARKS.items() if data.startswith(mark)), "utf-8")
        known = marked if encoding is None or marked.startswith(encoding.lower()) else encoding
        decoder = io.IncrementalNewlineDecoder(_make_decoder(known), translate=True)
        while True:
            try:
                text = decoder.decode(data, final=not data)
            except UnicodeDecodeError as error:
                raise _describe_undecoded(path, number, error, known, stated=encoding is not None) from error
            except UnicodeError as error:
                raise FileError(f"{path} is not {known} text ({error}): give another `encoding` in [log]") from error
            if "\0" in text:
                line = number + 1 + text[: text.index("\0")].count("\n")
                raise FileError(
                    f"{path} line {line} is binary or UTF-16 without its mark, not text: export the log as UTF-8 text, "
                    "or give `encoding` in [log]"
                )
            lines = (remainder + text).split("\n")
            remainder = lines.pop() if data else ""
            may_be_long = len(remainder) + len(text) > LONGEST_LINE
            for at, line_text in enumerate((*lines, remainder) if may_be_long else (), start=1):
                if len(line_text) > LONGEST_LINE:
                    raise FileError(
                        f"{path} line {number + at} has more than {LONGEST_LINE} characters, as no log has: "
                        "write one line for each sample, one column for each channel"
                    )
            if not data and lines[-1:] == [""]:
                lines.pop()  # nothing follows the end of the last line
            number += len(lines)
            if lines:
                yield lines
            if not data:
                return
            data = file.read(bytes_at_once)


def with_encoding(path: Path, settings: LogSettings) -> tuple[LogSettings, tuple[str, ...]]:
    """Return the settings, with the encoding that was found in the text where they state none; and a remark on it."""
    if settings.encoding or not _is_western(path):
        return settings, ()
    return replace(settings, encoding="cp1252"), ("the text is no UTF-8 and is read as cp1252 (Western Windows)",)


def _is_western(path: Path) -> bool:
    """Return whether a text does not begin as UTF-8, but with ASCII and the usual Western Windows signs of headers."""
    with _open(path) as file:
        head = file.read(HEAD_BYTES)
    with suppress(UnicodeDecodeError):
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last character may be cut
        return False
    if any(map(head.startswith, _MARKS)) or not head.decode("utf-8", "ignore").isascii():
        return False
    with suppress(UnicodeDecodeError):
        text = head.decode("cp1252")
        return all(sign.isascii() or sign in _WESTERN for sign in text) and "\0" not in text
    return False


def _open(path: Path) -> IO[bytes] | gzip.GzipFile:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rb")
    return path.open("rb")


def _make_decoder(encoding: str) -> codecs.IncrementalDecoder:
    try:
        # a wrapper refuses encodings of other things than text, like "hex"
        io.TextIOWrapper(io.BytesIO(), encoding=encoding).detach()
        return codecs.getincrementaldecoder(encoding)()
    except (LookupError, ValueError) as error:
        raise InputError(
            f"the encoding {encoding!r} is not known: give one like 'utf-8', 'latin-1', 'cp1252'"
        ) from error


def _describe_undecoded(
    path: Path, number: int, error: UnicodeDecodeError, encoding: str, *, stated: bool
) -> InputError:
    byte = error.object[error.start]
    line = number + 1 + error.object[: error.start].count(b"\n")
    name = "UTF-8" if encoding in ("utf-8", "utf-8-sig") else encoding
    remedy = "give another `encoding` in [log]" if stated else "give `encoding` in [log], or export the log as UTF-8"
    if not stated and byte in _LATIN and name == "UTF-8":
        sign = bytes([byte]).decode("latin-1")
        remedy = f"""if that stands for {sign!r}, give encoding = "latin-1" in [log], or export the log as UTF-8"""
    return FileError(f"{path} line {line} is not {name} text (byte 0x{byte:02x}): {remedy}")


# ---- rows and cells --------------------------------------------------------------------------------


def table_lines(table: TextTable) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a table in blocks, each with the number of its first line."""
    number = 1
    held = table.content or ()
    in_memory = (list(held[first : first + _LINES_AT_ONCE]) for first in range(0, len(held), _LINES_AT_ONCE))
    for lines in lines_of(table.path, table.encoding) if table.content is None else in_memory:
        skipped = max(0, min(table.first_line - number, len(lines)))
        if skipped < len(lines):
            yield number + skipped, lines[skipped:]
        number += len(lines)


def is_row(line: str, delimiter: str) -> bool:
    """Return whether a line is a row, neither blank nor a remark."""
    bare = line.strip(" " if delimiter == "\t" else None)
    return bool(bare) and not bare.startswith(COMMENTS)


def rows_of(lines: Sequence[str], delimiter: str) -> list[str]:
    """Return the lines that are rows."""
    return [line for line in lines if line[:1] in _NUMBERS_BEGIN or is_row(line, delimiter)]


def line_of_row(table: TextTable, row: int) -> int:
    """Return the number of the line that holds a row of a table."""
    numbers = (
        number + at
        for number, lines in table_lines(table)
        for at, line in enumerate(lines)
        if is_row(line, table.delimiter)
    )
    return next(islice(numbers, row, None))


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line with this delimiter, without quotes and the blanks around them.

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
        if not _is_even(table, rows):
            list(_number_rows(table, number, lines))  # raises an error at the first row with a wrong number of cells
        return np.empty((len(rows), 0))
    values = _parse(table, rows, columns)
    if values is None:
        values = _read_cell_by_cell(table, number, lines, columns)
    values[np.isinf(values)] = np.nan  # an overload is no value either
    return values


def column_of(table: TextTable, number: int, lines: Sequence[str], column: int) -> list[str]:
    """Return the cells of one column as they are written."""
    rows = rows_of(lines, table.delimiter)
    if _is_even(table, rows):
        separator = None if table.delimiter == BLANKS else table.delimiter
        return [row.split(separator, column + 1)[column] for row in rows]
    return [cells[column] for _, cells in _number_rows(table, number, lines)]


def number_of(cell: str, decimal: str) -> float | None:
    """Return the number, with this decimal mark, in a cell.

    It is NaN where the cell says that a value is missing, and None where the cell holds something else.

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
    # Python also reads 1_000 as a thousand, and the digits of every script; no logger writes these
    if "_" in bare or not bare.isascii():
        return None
    try:
        return float(bare)
    except ValueError:
        return None


def has_thousands_mark(cell: str, decimal: str, *, allow_ambiguous: bool = False) -> bool:
    """Return whether a cell holds a number with marks between its thousands.

    >>> has_thousands_mark("1,234.5", "."), has_thousands_mark("1.234,5", ","), has_thousands_mark("1,234", ".")
    (True, True, False)
    """
    return bool(_THOUSANDS[decimal].fullmatch(cell) or (allow_ambiguous and _GROUPED.fullmatch(cell)))


# ---- all cells at once ---------------------------------------------------------------------------


def _is_even(table: TextTable, rows: Sequence[str]) -> bool:
    """Return whether plain splitting gives every row its cells."""
    n = len(table.names)
    if table.delimiter == BLANKS:
        counts = {len(row.split()) for row in rows}
    else:
        counts = {found + 1 for found in set(map(str.count, rows, repeat(table.delimiter)))}
    right = min(counts, default=n) >= n if table.more else counts <= {n}
    return right and '"' not in "".join(rows)


def _parse(table: TextTable, rows: list[str], columns: Sequence[int]) -> FloatArray | None:
    """Return the numbers by numpy's parser, which reads no empty cells and names no lines; None where it fails."""
    mark = table.delimiter
    if mark == table.decimal:
        return None
    even = _is_even(table, rows)
    if table.decimal == ",":
        # a point is no decimal mark then, and must not be read as one
        rows = "\n".join(rows).replace(".", "_").replace(",", ".").split("\n")
    if not even:
        # numpy counts quoted cells only where it parses all of them
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


def _number_rows(table: TextTable, number: int, lines: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Return the line number and cells of each row; an error at the first row with a wrong number of cells."""
    n = len(table.names)
    for at, line in enumerate(lines, start=number):
        if not is_row(line, table.delimiter):
            continue
        try:
            cells = cells_of(line, table.delimiter)
        except InputError as error:
            raise FileError(f"{table.path} line {at} {error}") from error
        if len(cells) < n or (len(cells) > n and not table.more):
            raise FileError(
                f"{table.path} line {at} has {len(cells)} cell(s) where the header has {n}: "
                "mend the line, or delete it if the log was cut off there"
            )
        yield at, cells


def _read_cell_by_cell(table: TextTable, number: int, lines: Sequence[str], columns: Sequence[int]) -> FloatArray:
    values = []
    for at, cells in _number_rows(table, number, lines):
        own = [number_of(cells[column], table.decimal) for column in columns]
        if None in own:
            column = columns[own.index(None)]
            fault = _describe_fault(cells[column], table.decimal, is_time=column == table.time)
            raise FileError(f"{table.path} line {at}, column {table.names[column]!r}: {fault}")
        values.append(own)
    return np.array(values, dtype=np.float64)


def _describe_fault(cell: str, decimal: str, *, is_time: bool) -> str:
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
