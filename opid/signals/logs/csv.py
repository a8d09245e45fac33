"""Logs as text: a header `time [s],lower_z [m/s^2],upper_z [g]`, then one line for each sample."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from opid.errors import InputError
from opid.signals.clock import Clock, ClockError, uniform_clock
from opid.signals.files import written_whole
from opid.signals.logs import reader, writer
from opid.signals.recording import Channel, FloatArray, Recording
from opid.signals.units import to_si

_EXAMPLE = "`time [s],lower_z [m/s^2],upper_z [m/s^2]`"
_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_ROWS_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class _Column:
    name: str
    unit: str  # SI
    factor: float
    written_unit: str


@dataclass(frozen=True)
class _Header:
    columns: tuple[_Column, ...]
    time: int  # which column is the time
    separator: str
    lines: int  # lines of the file up to the first line of numbers


@reader(".csv", ".tsv", ".txt", ".dat")
def read_csv(path: Path) -> Recording:
    """Read a comma-, semicolon- or tab-separated log with names and units in its header.

    One column is the time: the one called `time` or `t`, else the first. Every other column is a channel.
    Units stand in brackets or parentheses. The rate comes from the time stamps, however few their digits.

    Args:
        path: the file, UTF-8; a byte-order mark, blank lines, comment lines (#) and quoted cells are welcome.

    Raises:
        InputError: the first fault found, with file, line, column and remedy.
    """
    try:
        header = _read_header(path)
        table = _read_table(path, header)
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise InputError(f"{path} is not UTF-8 text (byte 0x{byte:02x}): export the log as UTF-8") from error
    except csv.Error as error:
        raise InputError(f"{path} is no table ({error}): begin with {_EXAMPLE}") from error
    if len(table) < 2:
        raise InputError(
            f"{path} holds {['no samples', 'one sample'][len(table)]} below its header: "
            "give a run of some tens of seconds"
        )
    try:
        clock = uniform_clock(table[:, header.time], seconds_per_unit=header.columns[header.time].factor)
    except ClockError as error:
        raise InputError(f"{path} line {_line_of_row(path, header, error.sample)}: {error}") from error
    factors = np.array([column.factor for column in header.columns])
    channels = [index for index in range(len(factors)) if index != header.time]
    return Recording(
        table[:, channels] * factors[channels],
        fs=clock.fs,
        channels=tuple(Channel(header.columns[index].name, header.columns[index].unit) for index in channels),
        start_s=clock.start_s,
        history=_history(path, header, clock, len(table)),
    )


@writer(".csv")
def write_csv(recording: Recording, path: Path) -> None:
    """Write a recording as comma-separated text that reads back to the last bit.

    Args:
        recording: what to write, in SI units.
        path: the file to write.

    Raises:
        InputError: a channel's name or unit that a header cannot hold, or a place that cannot be written to.
    """
    header = _header_line(recording, path)
    columns = (recording.time_s, *recording.samples.T)
    with written_whole(path) as file:
        file.write(header + "\n")
        for start in range(0, recording.n_samples, _ROWS_AT_ONCE):
            block = (map(repr, column[start : start + _ROWS_AT_ONCE].tolist()) for column in columns)
            file.writelines(",".join(row) + "\n" for row in zip(*block, strict=True))


# ---- header --------------------------------------------------------------------------------------


def _read_header(path: Path) -> _Header:
    with path.open("rb") as file:
        if b"\0" in file.read(4096):
            raise InputError(f"{path} is binary or UTF-16, not UTF-8 text: export the log as UTF-8 text")
    comment = ""
    with path.open(encoding="utf-8-sig") as lines:
        for number, line in enumerate(lines, start=1):
            text = line.strip("\r\n")
            if text.lstrip().startswith("#"):
                comment = text.lstrip().lstrip("# ")
            elif text.strip():
                if not _is_numbers(text):
                    return _parse_header(path, text, number, number)
                # numpy.savetxt and others write the header as a comment
                if "[" in comment or "(" in comment:
                    return _parse_header(path, comment, number - 1, number - 1)
                raise InputError(f"{path} line {number} is numbers, there is no header: begin with {_EXAMPLE}")
    raise InputError(f"{path} has no header and no samples: begin with {_EXAMPLE}")


def _is_numbers(line: str) -> bool:
    cells = [cell for cell in re.split(r"[,;\t]", line) if cell.strip()]
    return bool(cells) and all(_number(cell) is not None for cell in cells)


def _parse_header(path: Path, text: str, number: int, lines: int) -> _Header:
    where = f"{path} line {number}"
    # most cells win, the comma on a tie: names may hold a stray comma or semicolon
    separator = max(_SEPARATORS, key=lambda mark: len(_cells(text, mark)))
    cells = [cell.strip() for cell in _cells(text, separator)]
    if len(cells) < 2:
        raise InputError(f"{where} has one column, not time and one or more channels: write {_EXAMPLE}")
    columns = tuple(_column(where, number, cell) for number, cell in enumerate(cells, start=1))
    names = [column.name for column in columns]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{where} names {names.count(twice)} columns {twice!r}: rename all but one")
    return _Header(columns, _time_column(where, columns), separator, lines)


def _time_column(where: str, columns: tuple[_Column, ...]) -> int:
    for wanted in ("time", "t"):
        found = [i for i, each in enumerate(columns) if each.unit == "s" and each.name.casefold() == wanted]
        if len(found) > 1:
            raise InputError(f"{where} names {len(found)} columns {wanted!r}: rename all but one")
        if found:
            return found[0]
    if columns[0].unit == "s":
        return 0
    raise InputError(f"{where}: there is no time column (the first is in {columns[0].unit}): write {_EXAMPLE}")


def _cells(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _split(cell: str) -> tuple[str, str | None]:
    """Split `upper_z [m/s^2]` or `upper_z (m/s^2)` into name and unit (None where there is none)."""
    for opening, closing in ("[]", "()"):
        depth = 0
        for at in range(len(cell) - 1, -1, -1) if cell.endswith(closing) else ():
            depth += (cell[at] == closing) - (cell[at] == opening)
            if depth == 0:
                return cell[:at].strip(), cell[at + 1 : -1].strip()
    return cell, None


def _column(where: str, number: int, cell: str) -> _Column:
    name, written_unit = _split(cell)
    if not name:
        raise InputError(f"{where}: column {number} has no name: write one, or remove the separator before it")
    if not written_unit:
        example = "time [s]" if name.casefold() in ("time", "t") else f"{name} [m/s^2]"
        raise InputError(f"{where}: column {name!r} has no unit: write it in brackets, like `{example}`")
    try:
        factor, unit = to_si(written_unit)
    except InputError as error:
        raise InputError(f"{where}: column {name!r}: {error}") from error
    return _Column(name, unit, factor, written_unit)


def _header_line(recording: Recording, path: Path) -> str:
    text = io.StringIO()
    cells = ("time [s]", *(f"{channel.name} [{channel.unit}]" for channel in recording.channels))
    csv.writer(text, lineterminator="\n").writerow(cells)
    line = text.getvalue().removesuffix("\n")
    try:
        columns = _parse_header(path, line, 1, 1).columns[1:]
    except (InputError, csv.Error) as error:
        raise InputError(f"cannot write this recording: {error}") from error
    read_back = tuple(Channel(column.name, column.written_unit) for column in columns)
    if read_back != recording.channels or any(column.factor != 1.0 for column in columns) or "\n" in line:
        raise InputError(
            f"cannot write {path}: a header does not hold the names and units {recording.channels}: "
            "give one-line names and SI units"
        )
    return line


# ---- numbers -------------------------------------------------------------------------------------


def _read_table(path: Path, header: _Header) -> FloatArray:
    """Return the numbers: by numpy's parser, or line by line where it cannot or a fault is to be named."""
    if next(_data_lines(path, header), None) is None:
        return np.empty((0, len(header.columns)))
    try:
        table = np.loadtxt(
            str(path.resolve()),
            delimiter=header.separator,
            skiprows=header.lines,
            comments=None,
            quotechar='"',
            ndmin=2,
            encoding="utf-8",
        )
    except UnicodeDecodeError:
        raise
    except ValueError:
        table = _read_by_line(path, header)
    if table.shape[1] != len(header.columns) or not np.isfinite(table).all():
        table = _read_by_line(path, header)
    return table


def _data_lines(path: Path, header: _Header) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line below the header that is neither blank nor a comment."""
    with path.open(encoding="utf-8") as lines:
        for number, line in islice(enumerate(lines, start=1), header.lines, None):
            text = line.strip("\r\n")
            if text.strip() and not text.lstrip().startswith("#"):
                yield number, text


def _line_of_row(path: Path, header: _Header, row: int) -> int:
    return next(islice(_data_lines(path, header), row, None))[0]


def _read_by_line(path: Path, header: _Header) -> FloatArray:
    rows = [_read_line(f"{path} line {number}", text, header) for number, text in _data_lines(path, header)]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(header.columns))


def _read_line(where: str, text: str, header: _Header) -> list[float]:
    cells = _cells(text, header.separator)
    if len(cells) != len(header.columns):
        raise InputError(
            f"{where} has {len(cells)} cell(s) where the header has {len(header.columns)}: "
            "mend the line, or delete it if the log was cut off there"
        )
    values = []
    for column, cell in zip(header.columns, cells, strict=True):
        value = _number(cell)
        if value is None or not np.isfinite(value):
            raise InputError(f"{where}, column {column.name!r}: {_fault_of_cell(cell, value)}")
        values.append(value)
    return values


def _number(cell: str) -> float | None:
    try:
        # Python reads 1_000 as a thousand; no logger writes that
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _fault_of_cell(cell: str, value: float | None) -> str:
    if not cell.strip():
        return "the cell is empty: give a number, or cut the log there"
    if value is not None:
        return f"{cell.strip()!r} is not a finite number: mend the sample, or cut the log there"
    if _number(cell.replace(",", ".")) is not None:
        return f"{cell.strip()!r} has a decimal comma: export the log with decimal points"
    return f"{cell.strip()[:40]!r} is not a number: give numbers only below the header"


def _history(path: Path, header: _Header, clock: Clock, n_samples: int) -> tuple[str, ...]:
    rate = f"rate {clock.fs:.9g} Hz from the time stamps"
    if abs(clock.fs / clock.fs_as_written - 1) > 1e-9:
        rate += f" ({clock.fs_as_written:.9g} Hz as written, rounded within the resolution of the stamps)"
    conversions = (
        f"{column.name}: {column.written_unit} -> {column.unit}, times {column.factor:.9g}"
        for column in header.columns
        if column.factor != 1.0
    )
    return (f"read {n_samples} samples from {path.name}", rate, *conversions)
