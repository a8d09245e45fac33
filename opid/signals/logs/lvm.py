"""Logs of LabVIEW as text: a header of the file, then segments of a header and one line for each sample.

They follow "Specification for the LabVIEW Measurement File (.lvm)", National Instruments, white paper 4139. The usual
library (lvm_read) holds the whole file in memory and unpickles files beside it, so it is not used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import chain
from pathlib import Path

import numpy as np

from opid.errors import FileError
from opid.signals.log import Block, Log, LoggedChannel, LogSettings, Track, rows_from_start
from opid.signals.logs import reader
from opid.signals.logs.text.stamps import moment, nanoseconds
from opid.signals.logs.text.table import (
    BYTES_AT_ONCE,
    MOST_COLUMNS,
    TextTable,
    lines_of,
    number_of,
    numbers_of,
    with_encoding,
)
from opid.signals.recording import FloatArray

_END = "***End_of_Header***"
_MOST_HEADER_LINES = 1000
_HEAD_BYTES = 1 << 16
_LINES_AT_ONCE = 1 << 15
_LABVIEW_ZERO = datetime(1904, 1, 1, tzinfo=UTC)
_ABSOLUTE_S = 1e9, 1e11  # X values between these count from LabVIEW's zero, smaller ones from Date and Time


@dataclass(frozen=True)
class _File:
    """The header of the file: how its segments are written."""

    path: Path
    encoding: str | None
    separator: str
    decimal: str
    x_columns: str  # "one", "multi" or "no"
    began: str  # date and time of day


@dataclass(frozen=True, eq=False)
class _Segment:
    """The header of a segment."""

    line: int  # number of the line with its column names
    names: tuple[str, ...]  # names of all columns before the comments
    n_channels: int
    entries: dict[str, list[str]]

    def entry(self, key: str, channel: int) -> str:
        """Return the entry of a channel, counted from 0; empty where there is none."""
        cells = self.entries.get(key, [])
        return cells[channel].strip() if channel < len(cells) else ""


@dataclass(frozen=True)
class _Clock:
    """The channels of a segment that have the same clock."""

    x: int | None  # column of their times, None where only a period is stated
    columns: tuple[int, ...]  # columns of their values
    channels: tuple[int, ...]  # their numbers among the channels of the file, from 0
    later_s: float = 0.0  # time by which the clock began later than the first clock
    has_shared_rows: bool = False  # whether its rows also hold channels of another period


@reader(".lvm", name="LabVIEW LVM", magic=(b"LabVIEW Measurement", b"\xef\xbb\xbfLabVIEW Measurement"), text=True)
def open_lvm(path: Path, settings: LogSettings) -> Log:
    """Open a LabVIEW measurement file; its segments are put on one time axis by their times of day.

    Stamps are the X values, because `Delta_X` is often rounded; without X values they are X0 plus multiples of
    `Delta_X`. They count from the earliest Date and Time of the channels of the first segment, or of the file, or from
    LabVIEW's zero in 1904 where they are large enough. `Time_Pref` decides nothing, for "Absolute" stands above both
    kinds of X values.
    """
    settings, remarks = with_encoding(path, settings)
    with _number_lines(path, settings.encoding, _HEAD_BYTES) as numbered:
        file = _read_file_header(path, numbered, settings)
        segment = _read_segment_header(file, numbered)
        if segment is None:
            raise FileError(f"{path} has no segment of data below its header: it is cut off; export the log again")
        first = next(numbered, (0, ""))[1].split(file.separator)
    clocks, zero = _put_on_one_axis(file, segment, _find_clocks(file, segment), first, settings)
    tracks = tuple(_make_track(file, segment, clock, settings, len(clocks)) for clock in clocks)
    return Log(path, "LabVIEW LVM", tracks, zero, remarks=remarks)


# ---- headers -------------------------------------------------------------------------------------


@contextmanager
def _number_lines(path: Path, encoding: str | None, bytes_at_once: int) -> Iterator[Iterator[tuple[int, str]]]:
    """Number the lines of the file from 1; the file is closed at the end, also after an error."""
    with closing(lines_of(path, encoding, bytes_at_once=bytes_at_once)) as blocks:
        yield enumerate(chain.from_iterable(blocks), start=1)


def _read_header(path: Path, numbered: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Return the lines of a header up to its end, without those that other programs put between special marks."""
    special = False
    for at, (number, line) in enumerate(numbered):
        if at > _MOST_HEADER_LINES:
            raise FileError(f"{path} line {number}: a header of {at} lines has no {_END}: export the log again")
        if line.startswith(_END):
            return
        special = (special or line.startswith("***Start_Special***")) and not line.startswith("***End_Special***")
        if not special:
            yield number, line


def _read_file_header(path: Path, numbered: Iterator[tuple[int, str]], settings: LogSettings) -> _File:
    lines = [line for _, line in _read_header(path, numbered)]
    # the separator stands behind its own name: "Separator,Comma"
    separator = next((line[9:10] for line in lines if line.startswith("Separator")), "") or "\t"
    found = {key: value for key, _, value in (line.partition(separator) for line in lines)}
    decimal = settings.decimal or found.get("Decimal_Separator", ".")[:1] or "."
    x_columns = found.get("X_Columns", "One").strip(separator + " ").casefold()
    if separator not in "\t,;" or decimal not in ".," or x_columns not in ("one", "multi", "no"):
        raise FileError(
            f"{path}: its header says Separator {separator!r}, Decimal_Separator {decimal!r}, X_Columns {x_columns!r}: "
            "tab, comma or semicolon, point or comma, and One, Multi or No are known; export the log again"
        )
    began = " ".join(found.get(key, "").strip(separator + " ") for key in ("Date", "Time"))
    return _File(path, settings.encoding, settings.delimiter or separator, decimal, x_columns, began)


def _read_segment_header(file: _File, numbered: Iterator[tuple[int, str]]) -> _Segment | None:
    """Return the next header of a segment, its column names included; None at the end of the file."""
    entries: dict[str, list[str]] = {}
    for _, line in _read_header(file.path, numbered):
        if line.strip(file.separator + " "):
            key, *values = line.split(file.separator)
            entries[key.strip()] = values
    if not entries:
        return None
    number, names = next(numbered, (0, ""))
    where = f"{file.path} line {number}" if number else f"the end of {file.path}"
    written = (entries.get("Channels") or [""])[0].strip()
    if not (written.isascii() and written.isdecimal() and 1 <= int(written) <= MOST_COLUMNS):
        raise FileError(
            f"{where}: the header of the segment says Channels {written[:40]!r}: "
            f"a number from 1 to {MOST_COLUMNS} is needed; export the log again"
        )
    n = 2 * int(written) if file.x_columns == "multi" else int(written) + 1
    cells = [name.strip() for name in names.split(file.separator)]
    if cells[0] != "X_Value" or len(cells) < n or not all(cells[:n]):
        raise FileError(
            f"{where}: {n} names that begin with X_Value were expected for {written} channel(s), "
            f"found {sum(map(bool, cells))}: the file is cut off or damaged; export the log again"
        )
    return _Segment(number, tuple(cells[:n]), int(written), entries)


def _find_clocks(file: _File, segment: _Segment) -> list[_Clock]:
    """Return the clocks of a segment: channels with equal time columns, or equal stated periods, have the same one."""
    n = segment.n_channels
    if file.x_columns != "multi":
        # one column of X is that of the first channel
        stated = [number_of(segment.entry("Delta_X", channel), file.decimal) for channel in range(n)]
        periods = [each if each is not None and np.isfinite(each) and each > 0 else None for each in stated]
        usual = next((period for period in periods if period is not None), None)
        of_period: dict[float | None, list[int]] = {periods[0] or usual: []}
        for channel, period in enumerate(periods):
            of_period.setdefault(period or periods[0] or usual, []).append(channel)
        x = 0 if file.x_columns == "one" else None
        own_x = [x, *[None] * (len(of_period) - 1)]
        return [
            _Clock(column, tuple(each + 1 for each in own), tuple(own), has_shared_rows=len(of_period) > 1)
            for column, own in zip(own_x, of_period.values(), strict=True)
        ]
    alike: dict[tuple[str, ...], list[int]] = {}
    for channel in range(n):
        key = tuple(segment.entry(each, channel) for each in ("X0", "Delta_X", "Samples", "Date", "Time"))
        alike.setdefault(key if key[1] else (str(channel),), []).append(channel)
    return [_Clock(2 * own[0], tuple(2 * each + 1 for each in own), tuple(own)) for own in alike.values()]


def _put_on_one_axis(
    file: _File, segment: _Segment, clocks: Sequence[_Clock], first: Sequence[str], settings: LogSettings
) -> tuple[list[_Clock], datetime | None]:
    """Return the clocks with times from the earliest of their zeros, and that zero; None where a zero is not known."""
    zeros = [_find_zero(file, segment, clock, first, settings) for clock in clocks]
    known = [zero for zero in zeros if zero is not None]
    if len(known) < len(clocks) or len({zero.tzinfo for zero in known}) > 1:
        return list(clocks), None
    earliest = min(known)
    later = ((zero - earliest).total_seconds() for zero in known)
    return [replace(clock, later_s=later_s) for clock, later_s in zip(clocks, later, strict=True)], earliest


def _find_zero(
    file: _File, segment: _Segment, clock: _Clock, first: Sequence[str], settings: LogSettings
) -> datetime | None:
    """Return the moment at which X is zero, by the first row and the headers.

    Where a rate is given, it is the moment of the first row.
    """
    channel = clock.channels[0]
    cell = segment.entry("X0", channel) if clock.x is None else "".join(first[clock.x : clock.x + 1])
    x = number_of(cell, file.decimal)
    x = 0.0 if x is None or np.isnan(x) else x
    if abs(x) >= _ABSOLUTE_S[1]:
        return None
    own = moment(f"{segment.entry('Date', channel)} {segment.entry('Time', channel)}")
    zero = _LABVIEW_ZERO if x > _ABSOLUTE_S[0] else own or moment(file.began)
    return zero + timedelta(seconds=x) if zero is not None and settings.fs_hz else zero


# ---- samples -------------------------------------------------------------------------------------


def _make_track(file: _File, segment: _Segment, clock: _Clock, settings: LogSettings, n_clocks: int) -> Track:
    names = [segment.names[column] for column in clock.columns]
    if len(set(names)) < len(names):  # LabVIEW calls all channels of an untitled signal alike
        names = [f"{name} {channel + 1}" for name, channel in zip(names, clock.channels, strict=True)]
    units = [segment.entry("Y_Unit_Label", channel) or None for channel in clock.channels]

    def blocks(chosen: Sequence[int]) -> Iterator[Block]:
        return _read_blocks(file, clock, [clock.columns[each] for each in chosen], stamped=settings.fs_hz is None)

    return Track(
        tuple(LoggedChannel(name, unit) for name, unit in zip(names, units, strict=True)),
        rows_from_start(blocks),
        fs=settings.fs_hz,
        start_s=clock.later_s if settings.fs_hz else 0.0,
        name=f"clock {clock.channels[0] + 1}" if n_clocks > 1 else "",
        locate=lambda row: f"line {_find_line(file, row)}",
    )


def _read_pieces(file: _File) -> Iterator[tuple[_Segment, int, list[str]]]:
    """Yield the lines of samples in blocks, each with its segment and the number of its first line."""
    with _number_lines(file.path, file.encoding, BYTES_AT_ONCE) as numbered:
        for _ in _read_header(file.path, numbered):
            pass
        blank = file.separator + " "
        names: tuple[str, ...] | None = None
        while (segment := _read_segment_header(file, numbered)) is not None:
            if names not in (None, segment.names):
                raise FileError(
                    f"{file.path} line {segment.line}: this segment has other channels than the first: "
                    "write them to a file of their own"
                )
            names = segment.names
            first, lines = segment.line + 1, []
            for number, line in numbered:
                if not line.strip(blank):
                    break
                lines.append(line)
                if len(lines) == _LINES_AT_ONCE:
                    yield segment, first, lines
                    first, lines = number + 1, []
            if lines:
                yield segment, first, lines


def _read_blocks(file: _File, clock: _Clock, wanted: Sequence[int], *, stamped: bool) -> Iterator[Block]:
    begun: int | None = None  # when the first segment began, ns
    segment: _Segment | None = None
    offset, last, row, ended = clock.later_s, -np.inf, 0, False
    for piece, number, lines in _read_pieces(file):
        table = TextTable(file.path, file.encoding, file.separator, file.decimal, number, piece.names, True, clock.x)
        values = numbers_of(table, number, lines, [*wanted, *([] if clock.x is None else [clock.x])])
        if not stamped:
            yield Block(values[:, : len(wanted)])
            continue
        new, segment = piece is not segment, piece
        row = 0 if new else row
        x = _make_stamps(file, piece, clock, row, len(values)) if clock.x is None else values[:, -1]
        row += len(values)
        if clock.has_shared_rows:  # the channels with more samples continue
            values, ended = _cut_at_end(file, number, values, ended=ended and not new)
            x = x[: len(values)]
        held = ~np.isnan(x)
        if file.x_columns == "multi":  # the longer channels continue
            values, x = values[held], x[held]
        elif not held.all():
            at = number + int(np.argmin(held))
            raise FileError(f"{file.path} line {at}, column 'X_Value': the cell is empty: cut the log there")
        if not x.size:
            continue
        if new and begun is None:
            begun = _read_begin(piece, clock)
        elif new:
            offset = clock.later_s + (0.0 if x[0] + clock.later_s > last else _find_offset(file, piece, clock, begun))
        last = float(x[-1] + offset)
        yield Block(values[:, : len(wanted)], x + offset)


def _make_stamps(file: _File, segment: _Segment, clock: _Clock, row: int, n: int) -> FloatArray:
    """Return the X values of the n rows from `row` on, where the file states only the first one and their distance."""
    stated = [segment.entry(key, clock.channels[0]) for key in ("X0", "Delta_X")]
    first, period = (number_of(cell, file.decimal) for cell in stated)
    if first is None or period is None or not (np.isfinite(first) and np.isfinite(period) and period > 0):
        raise FileError(
            f"{file.path} line {segment.line}: the segment has no X values, and says X0 {stated[0]!r}, "
            f"Delta_X {stated[1]!r}: give `fs_hz` in [log]"
        )
    return first + period * np.arange(row, row + n, dtype=np.float64)


def _cut_at_end(file: _File, number: int, values: FloatArray, *, ended: bool) -> tuple[FloatArray, bool]:
    """Return the rows before the first row that is empty for all channels of a clock, and whether there is one."""
    full = np.asarray(~np.isnan(values).all(axis=1)) if values.shape[1] else np.ones(len(values), dtype=bool)
    n = 0 if ended else len(full) if full.all() else int(np.argmin(full))
    if full[n:].any():
        raise FileError(
            f"{file.path} line {number + n + int(np.argmax(full[n:]))}: numbers follow empty cells, and channels have "
            "different Delta_X: their times are not known; write each rate to a file of its own"
        )
    return values[:n], n < len(full)


def _read_begin(segment: _Segment, clock: _Clock) -> int | None:
    stamp = f"{segment.entry('Date', clock.channels[0])} {segment.entry('Time', clock.channels[0])}"
    try:
        return int(nanoseconds([stamp])[0])
    except ValueError:
        return None


def _find_offset(file: _File, segment: _Segment, clock: _Clock, begun: int | None) -> float:
    begin = _read_begin(segment, clock)
    if begin is None or begun is None:
        raise FileError(
            f"{file.path} line {segment.line}: the segment does not go on where the one before ends, and Date and Time "
            "do not say when it began: write segments to files of their own"
        )
    return 1e-9 * (begin - begun)


def _find_line(file: _File, row: int) -> int:
    for _, number, lines in _read_pieces(file):
        if row < len(lines):
            return number + row
        row -= len(lines)
    raise IndexError(row)
