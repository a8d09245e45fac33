"""A log as its file holds it, read block by block, and the user's settings for reading it.

A log may be longer than memory, have gaps and missing values, channels of several rates, and units that are not stated.
`opid.signals.conversion` makes a `Recording` (in memory, uniform, finite, SI) of a part of it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from opid.errors import FileError, InputError, nearest
from opid.provenance import ReadFile, read_file
from opid.signals.recording import FloatArray, Recording
from opid.signals.units import RATE_RANGE_HZ, to_si

BLOCK_VALUES = 1 << 20
"""Values that are read at a time: 8 MiB as float64, little memory but long to read beside the cost of a call."""


@dataclass(frozen=True)
class LoggedChannel:
    """A channel with the name and the unit that its file states."""

    name: str  # name of the channel
    unit: str | None = None  # unit as it is written; None where the file states none
    is_clock: bool = False  # whether it runs with the time and is no signal; it is only read where the user names it

    def is_in(self, unit: str) -> bool:
        """Whether its unit is of the kind of `unit`, of SI; an unknown one is refused when the channel is read."""
        try:
            return bool(self.unit) and to_si(str(self.unit))[1] == unit
        except InputError:
            return False


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive rows of a track."""

    samples: FloatArray  # (n, n_channels) values as written, NaN where the file holds none
    stamps: FloatArray | None = None  # (n,) time of each row, s; None where the file states a rate


# (columns, first row, row after the last one or None for all) -> consecutive blocks of about `BLOCK_VALUES` values
Rows = Callable[[Sequence[int], int, int | None], Iterator[Block]]


@dataclass(frozen=True, eq=False)
class Track:
    """Channels that have the same clock.

    Args:
        channels: the channels in the order of the columns.
        rows: function that yields the blocks of some columns from one row to another.
        fs: rate that the file states, Hz; None where each row has a time stamp.
        start_s: time of the first row where there are no stamps, s.
        n_samples: number of rows; None where only reading shows it.
        name: name that distinguishes the tracks of a log; empty where there is only one.
        locate: function from a row to its position in the file, for messages: "line 7".
    """

    channels: tuple[LoggedChannel, ...]
    rows: Rows
    fs: float | None = None
    start_s: float = 0.0
    n_samples: int | None = None
    name: str = ""
    locate: Callable[[int], str] = lambda row: f"row {row + 1}"

    def blocks(self, columns: Sequence[int] | None = None, start: int = 0, stop: int | None = None) -> Iterator[Block]:
        """Yield the rows from `start` to before `stop` in blocks, of all columns where none are chosen."""
        wanted = range(len(self.channels)) if columns is None else columns
        yield from self.rows(wanted, start, stop)


@dataclass(frozen=True, eq=False)
class Log:
    """A log as its file holds it.

    Args:
        path: path of the file; a name in brackets where there is no file.
        format: usual name of the format.
        tracks: the tracks, one for each clock.
        zero: the moment at which its times are zero, where the file states it; it puts logs of several recorders on one
            time axis. Without a time zone it is the time that the recorder's clock showed.
        history: steps applied to the samples before the file was written, as the file states them.
        remarks: sentences on how the file is read, for `inspect` and the history.
    """

    path: Path
    format: str
    tracks: tuple[Track, ...]
    zero: datetime | None = None
    history: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @cached_property
    def files(self) -> tuple[ReadFile, ...]:
        """The file with the hash of its content; empty where the log was made from a recording."""
        return (read_file(self.path),) if self.path.is_file() else ()

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each channel, track by track; "track/channel" where two channels have one name."""
        plain = [channel.name for track in self.tracks for channel in track.channels]
        full = [_join_name(track, channel) for track in self.tracks for channel in track.channels]
        times = Counter(plain)
        return tuple(one if times[one] == 1 else other for one, other in zip(plain, full, strict=True))

    @property
    def signals(self) -> tuple[str, ...]:
        """The `names` of the channels that are no clocks."""
        channels = [channel for track in self.tracks for channel in track.channels]
        return tuple(name for name, channel in zip(self.names, channels, strict=True) if not channel.is_clock)

    def find(self, channel: str | int) -> tuple[Track, int]:
        """Return the track of a channel and its column there.

        Args:
            channel: its name, or its number in `names`, counted from 1.

        Raises:
            InputError: no channel, or several, have that name.
        """
        columns = [(track, column) for track in self.tracks for column in range(len(track.channels))]
        if isinstance(channel, int):
            if not 1 <= channel <= len(columns):
                raise FileError(f"there is no channel number {channel} in {self.path}: it has {len(columns)}")
            return columns[channel - 1]
        full = {place: _join_name(place[0], place[0].channels[place[1]]) for place in columns}
        found = [(track, i) for track, i in columns if channel in (full[track, i], track.channels[i].name)]
        if not found:
            raise FileError(f"there is no channel {channel!r} in {self.path}: {nearest(channel, self.names)}")
        if len(found) > 1:
            several = ", ".join(repr(full[place]) for place in found)
            raise FileError(f"{len(found)} channels of {self.path} are called {channel!r}: write one of {several}")
        return found[0]


def rows_in_steps(
    n: int,
    read: Callable[[Any, Sequence[int], int, int], tuple[Iterable[np.ndarray], FloatArray | None]],
    open_file: Callable[[], AbstractContextManager[Any]] = nullcontext,
    *,
    width: int | None = None,
) -> Rows:
    """Return the n rows of a source that can be read from any row on.

    `read` takes the opened source, columns, the first row and the row after the last one. It returns the values of each
    column, and the stamps, s, or None. A source that always reads more columns than the chosen ones states its `width`.

    Raises:
        ValueError: a column ends before row n.
    """

    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        end = n if stop is None else min(stop, n)
        step = rows_at_once(width or len(columns))
        with open_file() as file:
            for first in range(start, end, step):
                last = min(first + step, end)
                values, stamps = read(file, columns, first, last)
                samples = np.empty((last - first, len(columns)))
                for index, own in enumerate([*values, *([] if stamps is None else [stamps])]):
                    if own.shape != (last - first,):
                        raise ValueError(f"it ends at row {first + own.size + 1} of {n}")
                    if index < len(columns):
                        samples[:, index] = own
                yield Block(samples, stamps)

    return rows


def rows_of_array(samples: np.ndarray, stamps: np.ndarray | None = None) -> Rows:
    """Return the rows of an array (n, n_channels); only the requested part is converted to float64.

    >>> rows = rows_of_array(np.arange(6, dtype=np.int16).reshape(3, 2))
    >>> [block.samples.tolist() for block in rows([1], 1, None)]
    [[[3.0], [5.0]]]
    """

    def read(_: None, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], FloatArray | None]:
        own = None if stamps is None else np.asarray(stamps[first:last], dtype=np.float64)
        return [samples[first:last, column] for column in columns], own

    return rows_in_steps(samples.shape[0], read)


def rows_from_start(all_blocks: Callable[[Sequence[int]], Iterable[Block]]) -> Rows:
    """Return the rows of a source that can only be read from its beginning."""

    def rows(columns: Sequence[int], start: int, stop: int | None) -> Iterator[Block]:
        first = 0
        for block in all_blocks(columns):
            last = first + block.samples.shape[0]
            inside = slice(max(start - first, 0), None if stop is None else max(stop - first, 0))
            own = block.samples[inside]
            if own.shape[0]:
                yield Block(own, None if block.stamps is None else block.stamps[inside])
            first = last
            if stop is not None and first >= stop:
                return

    return rows


def rows_at_once(n_columns: int) -> int:
    """Return the number of rows of a block of n columns."""
    return max(1024, BLOCK_VALUES // max(n_columns, 1))


def make_distinct(names: Iterable[str], *, unnamed: str = "channel") -> tuple[str, ...]:
    """Return names of which no two are equal: the second "a" becomes "a (2)".

    >>> make_distinct(["a", "b", "a", ""])
    ('a', 'b', 'a (2)', 'channel')
    """
    found: dict[str, None] = {}
    counts: dict[str, int] = {}
    for name in names:
        plain = own = name.strip() or unnamed
        while own in found:
            counts[plain] = counts.get(plain, 1) + 1
            own = f"{plain} ({counts[plain]})"
        found[own] = None
    return tuple(found)


def log_of_recording(recording: Recording) -> Log:
    """Return a log that holds a recording."""
    channels = tuple(LoggedChannel(channel.name, channel.unit) for channel in recording.channels)
    n = recording.n_samples
    track = Track(channels, rows_of_array(recording.samples), recording.fs, recording.start_s, n)
    return Log(Path("[recording]"), "recording", (track,), history=recording.history)


def _join_name(track: Track, channel: LoggedChannel) -> str:
    return f"{track.name}/{channel.name}" if track.name else channel.name


# ---- settings of the user --------------------------------------------------------------------------

CLOCKS = ("auto", "stamps", "own_times", "reconstructed")

LONGEST_SHIFT_S = 600.0
"""The largest standard deviation of a shift: records of a run that began farther apart are no records of one run."""

LARGEST_DRIFT_PPM = 2e4
"""The largest standard deviation of a drift: the rates of cheap inertial sensors are 1 to 2 % off."""


@dataclass(frozen=True)
class LogSettings:
    """How to read a log: the table `[log]` of a study file.

    Args:
        names: names of all columns of a text, the time among them, in place of its header.
        time: name or number (from 1) of the column with the time stamps; by default it is found by its name.
        time_unit: unit of the stamps, where the file states none or a wrong one.
        clock: "auto": the samples show whether irregular stamps are their times; "stamps": the stamps must be those of
            a uniform clock, apart from their rounding; "own_times": samples were taken at their stamps, however
            irregular; "reconstructed": rows are assumed to be equally spaced, and stamps that come in bursts (a host
            empties a buffer) only give the rate.
        fs_hz: the rate, Hz; the stamps are then ignored.
        unit: unit of every channel for which the file states none.
        full_scale: the value at a WAV file's full scale, in the unit.
        delimiter: delimiter between the columns of a text; by default it is found.
        decimal: decimal mark, "." or ","; by default it is found.
        encoding: encoding of a text; by default it is found.
        skip_lines: number of lines of a text before its header, or before its numbers if `names` is given.

    Raises:
        InputError: an impossible value.
    """

    names: tuple[str, ...] = ()
    time: str | int | None = None
    time_unit: str | None = None
    clock: Literal["auto", "stamps", "own_times", "reconstructed"] = "auto"
    fs_hz: float | None = None
    unit: str | None = None
    full_scale: float | None = None
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    skip_lines: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        for name in self.names:
            if not isinstance(name, str) or not name:
                raise InputError(f"names holds {name!r}: give the name of each column as text")
        if self.clock not in CLOCKS:
            raise InputError(f"clock is {self.clock!r}: give one of {', '.join(map(repr, CLOCKS))}")
        if self.full_scale is not None and not (math.isfinite(self.full_scale) and self.full_scale > 0):
            raise InputError(f"full_scale is {self.full_scale}: give a positive number")
        if self.fs_hz is not None and not RATE_RANGE_HZ[0] <= self.fs_hz <= RATE_RANGE_HZ[1]:
            raise InputError(f"fs_hz is {self.fs_hz:g}: give a rate in Hz that a recorder can have")
        if self.decimal not in (None, ".", ","):
            raise InputError(f"decimal is {self.decimal!r}: give '.' or ','")
        if self.skip_lines is not None and self.skip_lines < 0:
            raise InputError(f"skip_lines is {self.skip_lines}: give 0 or more")
        for unit, needed in ((self.unit, None), (self.time_unit, "s")):
            if unit is not None and to_si(unit)[1] != (needed or to_si(unit)[1]):
                raise InputError(f"time_unit is {unit!r}: give a unit of time")


AS_WRITTEN = LogSettings()
"""Settings of a user who states nothing: the file states everything."""


@dataclass(frozen=True)
class ChannelSettings:
    """Where one channel is found, and what its values mean: `value in unit = sign (scale written + offset)`.

    Args:
        channel: name of the channel in the log, or its number there, counted from 1.
        file: the file that holds it, where that is not the log of the run.
        unit: unit of the value; by default the one that the file states.
        scale: factor of the values as they are written.
        offset: value added to the scaled values, in `unit`.
        sign: 1, or -1 for a sensor that was mounted upside down.
        shift_s: time added to the times of its file, whose clock began at another moment, s.
        shift_tolerance_s: standard deviation of `shift_s`, s; if it is not 0, the clock of its file is matched to that
            of the other files by the motion that both recorded. None for 60 s where no file states a shift, and for 0
            where one does.
        drift_tolerance_ppm: standard deviation of the rate of that clock against the others, parts per million.

    Raises:
        InputError: an impossible value.

    >>> import numpy as np
    >>> settings = ChannelSettings("az", unit="g", scale=16 / 32767, sign=-1)
    >>> settings.to_si(np.array([32767.0]), None)
    (array([-156.9064]), 'm/s^2')
    """

    channel: str | int
    file: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    sign: int = 1
    shift_s: float = 0.0
    shift_tolerance_s: float | None = None
    drift_tolerance_ppm: float = 100.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and self.scale != 0):
            raise InputError(f"scale is {self.scale}: give a finite number other than 0")
        for name in ("offset", "shift_s"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} is {getattr(self, name)}: give a finite number")
        if self.shift_tolerance_s is not None and not 0.0 <= self.shift_tolerance_s <= LONGEST_SHIFT_S:
            raise InputError(
                f"shift_tolerance_s is {self.shift_tolerance_s}: give 0 to {LONGEST_SHIFT_S:g} s, or leave it out"
            )
        if not 0.0 <= self.drift_tolerance_ppm <= LARGEST_DRIFT_PPM:
            raise InputError(f"drift_tolerance_ppm is {self.drift_tolerance_ppm}: give 0 to {LARGEST_DRIFT_PPM:g}")
        if self.sign not in (1, -1):
            raise InputError(f"sign is {self.sign}: give 1 or -1")
        if self.unit is not None:
            to_si(self.unit)

    def to_si(self, samples: FloatArray, written_unit: str | None) -> tuple[FloatArray, str]:
        """Return values in SI, and the name of their unit.

        Args:
            samples: (n,) values as written.
            written_unit: unit that the file states.

        Raises:
            InputError: no unit is stated, or an unknown one.
        """
        unit = self.unit or written_unit
        if unit is None:
            raise InputError(
                f"channel {self.channel!r} states no unit: write it in the log's header, like `{self.channel} [g]`, or "
                "give `unit` in its table of [channels] in a study file, or in [log] for all (--unit without a study)"
            )
        factor, name = to_si(unit)
        # a damaged file may hold the kind of NaN that warns when it is multiplied
        with np.errstate(invalid="ignore"):
            if (self.scale, self.offset, self.sign) == (1.0, 0.0, 1):
                return samples * factor, name
            return self.sign * (self.scale * samples + self.offset) * factor, name

    def words(self, written_unit: str | None, unit_of_all: str | None = None) -> str | None:
        """Return a line of the history that says what is done to the values; None where nothing is.

        Args:
            written_unit: unit that the file states.
            unit_of_all: unit of every channel for which the file states none.
        """
        unit = self.unit or written_unit or unit_of_all
        if unit is None:
            return None
        factor, name = to_si(unit)
        parts = [f"times {self.scale:.9g}"] * (self.scale != 1)
        parts += [f"plus {self.offset:.9g} {unit}"] * (self.offset != 0) + ["sign reversed"] * (self.sign < 0)
        parts += [f"{unit} -> {name}, times {factor:.9g}"] * (factor != 1)
        parts += [f"the file states {written_unit}"] * (self.unit is not None and written_unit not in (None, self.unit))
        return f"{self.channel}: {', '.join(parts)}" if parts else None
