"""What a file holds before any of it is believed: channels that share a clock, read block by block.

A log may be longer than memory, may have gaps and missing values, channels of several rates, units that nobody stated.
`opid.signals.conversion` makes a `Recording` (in memory, uniform, finite, SI) of a part of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.provenance import ReadFile, read_file
from opid.signals.recording import FloatArray, Recording

BLOCK_VALUES = 1 << 20
"""Values that are read at a time: 8 MiB as float64, small beside any memory and large beside the cost of a call."""


@dataclass(frozen=True)
class LoggedChannel:
    """A channel as its file calls it.

    Args:
        name: of the channel.
        unit: as it is written; None where the file states none.
        is_clock: whether it runs with the time and is no signal; it is read where it is named.
    """

    name: str
    unit: str | None = None
    is_clock: bool = False


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive rows of a track.

    Args:
        samples: (n, n_channels) values as written, NaN where the file holds none.
        stamps: (n,) time of each row, s; None where the file states a rate.
    """

    samples: FloatArray
    stamps: FloatArray | None = None


# (columns, first row, end or None for the last row) -> blocks of about `BLOCK_VALUES` values, one after the other
Rows = Callable[[Sequence[int], int, int | None], Iterator[Block]]


@dataclass(frozen=True, eq=False)
class Track:
    """Channels that share a clock.

    Args:
        channels: in the order of the columns.
        rows: gives the blocks of some columns from one row to another.
        fs: rate that the file states, Hz; None where each row has a time stamp.
        start_s: time of the first row where there are no stamps, s.
        n_samples: number of rows; None where only reading shows it.
        name: distinguishes the tracks of a log; empty where there is but one.
        locate: row -> where it stands in the file, for messages: "line 7".
    """

    channels: tuple[LoggedChannel, ...]
    rows: Rows
    fs: float | None = None
    start_s: float = 0.0
    n_samples: int | None = None
    name: str = ""
    locate: Callable[[int], str] = lambda row: f"row {row + 1}"

    def blocks(self, columns: Sequence[int] | None = None, start: int = 0, stop: int | None = None) -> Iterator[Block]:
        """Yield the rows from `start` to before `stop` in blocks.

        Args:
            columns: numbers of the channels, from 0; all where left out.
            start: first row.
            stop: row after the last one; None for all.
        """
        wanted = range(len(self.channels)) if columns is None else columns
        yield from self.rows(wanted, start, stop)


@dataclass(frozen=True, eq=False)
class Log:
    """A log as its file holds it.

    Args:
        path: of the file; a name in brackets where there is none.
        format: what it is called.
        tracks: one for each clock.
        zero: the moment at which its times are zero, where the file states it: logs of several recorders are put on one
            time axis by it. Without a zone it is what the recorder's clock showed.
        history: what the file says was done to its samples before it was written.
        remarks: how it is read beside what it states, where that was found out: for `inspect` and the history.
    """

    path: Path
    format: str
    tracks: tuple[Track, ...]
    zero: datetime | None = None
    history: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @cached_property
    def files(self) -> tuple[ReadFile, ...]:
        """The file with the hash of what it holds; nothing where the log was made of a recording."""
        return (read_file(self.path),) if self.path.is_file() else ()

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each channel, track by track: "track/channel" where a name stands twice."""
        plain = [channel.name for track in self.tracks for channel in track.channels]
        full = [_full(track, channel) for track in self.tracks for channel in track.channels]
        times = Counter(plain)
        return tuple(one if times[one] == 1 else other for one, other in zip(plain, full, strict=True))

    @property
    def signals(self) -> tuple[str, ...]:
        """Those of the `names` that are no clock."""
        channels = [channel for track in self.tracks for channel in track.channels]
        return tuple(name for name, channel in zip(self.names, channels, strict=True) if not channel.is_clock)

    def find(self, channel: str | int) -> tuple[Track, int]:
        """Return the track of a channel and its column there.

        Args:
            channel: its name, or its number in `names`, counted from 1.

        Raises:
            InputError: there is none, or several of that name.
        """
        columns = [(track, column) for track in self.tracks for column in range(len(track.channels))]
        if isinstance(channel, int):
            if not 1 <= channel <= len(columns):
                raise InputError(f"there is no channel number {channel} in {self.path}: it has {len(columns)}")
            return columns[channel - 1]
        names = [_full(track, track.channels[column]) for track, column in columns]
        plain = [track.channels[column].name for track, column in columns]
        found = [i for i in range(len(columns)) if channel in (names[i], plain[i])]
        if not found:
            raise InputError(f"there is no channel {channel!r} in {self.path}: {nearest(channel, self.names)}")
        if len(found) > 1:
            several = ", ".join(repr(names[i]) for i in found)
            raise InputError(f"{len(found)} channels of {self.path} are called {channel!r}: write one of {several}")
        return columns[found[0]]


def rows_in_steps(
    n: int,
    read: Callable[[Any, Sequence[int], int, int], tuple[Iterable[np.ndarray], FloatArray | None]],
    open_file: Callable[[], AbstractContextManager[Any]] = nullcontext,
    *,
    width: int | None = None,
) -> Rows:
    """Return the rows of what can be read from any row on.

    Raises:
        ValueError: a column ends before its last row.
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
    """Return the rows of an array, in memory or mapped to it: only what is asked for is converted to float64.

    Args:
        samples: (n, n_channels) of any type of number.
        stamps: (n,) time of each row, s.

    >>> rows = rows_of_array(np.arange(6, dtype=np.int16).reshape(3, 2))
    >>> [block.samples.tolist() for block in rows([1], 1, None)]
    [[[3.0], [5.0]]]
    """

    def read(_: None, columns: Sequence[int], first: int, last: int) -> tuple[list[np.ndarray], FloatArray | None]:
        own = None if stamps is None else np.asarray(stamps[first:last], dtype=np.float64)
        return [samples[first:last, column] for column in columns], own

    return rows_in_steps(samples.shape[0], read)


def rows_from_start(all_blocks: Callable[[Sequence[int]], Iterable[Block]]) -> Rows:
    """Return the rows of what can only be read from its beginning."""

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
    """Return how many rows of so many columns make a block."""
    return max(1024, BLOCK_VALUES // max(n_columns, 1))


def make_distinct(names: Iterable[str], *, unnamed: str = "channel") -> tuple[str, ...]:
    """Return names that differ, for files that use one twice: the second "a" becomes "a (2)".

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
    """Return a recording as the log that it would be."""
    channels = tuple(LoggedChannel(channel.name, channel.unit) for channel in recording.channels)
    n = recording.n_samples
    track = Track(channels, rows_of_array(recording.samples), recording.fs, recording.start_s, n)
    return Log(Path("[recording]"), "recording", (track,), history=recording.history)


def _full(track: Track, channel: LoggedChannel) -> str:
    return f"{track.name}/{channel.name}" if track.name else channel.name
