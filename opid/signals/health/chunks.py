"""A log of any length in bounded memory: chunks of one size, and summaries whose length is bounded.

Blocks come in any size; what is found in the chunks that are made of them does not depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.log import Block
from opid.signals.recording import FloatArray

UNITS = 64
"""A bin has 64 times a number of rows with small factors, so that its Fourier transform is fast."""

CHUNK_VALUES = 1 << 19
"""Approximate values of a chunk: 4 MiB, so that the processor's cache holds a channel of it."""

MOST_BIN_ROWS, MOST_BIN_VALUES = 1 << 16, 1 << 21
"""Rows and values of a bin, at the most (4096 rows are always allowed): above 65 kHz a bin is below a second."""

LARGEST = 1e60
"""Larger values count as missing, like those that are no number: nothing measures them, and their squares overflow."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive rows, channel by channel."""

    # (n_channels, lead + whole bins) in SI, NaN where a value is missing: the bin before the chunk, then the bins of
    # the chunk; the last bin of the log is filled up with NaN
    values: FloatArray
    lead: int  # rows of the bin before the chunk, 0 for the first chunk
    first: int  # row of the log with which the chunk begins
    n: int  # rows of the log in the chunk
    bin: int  # rows of a bin
    missing: np.ndarray  # (n_channels,) whether a value of this chunk or of the one before is missing
    breaks: np.ndarray  # rows of the log before which the clock jumps

    @property
    def new(self) -> FloatArray:
        """The values without the bin before the chunk, (n_channels, whole bins)."""
        return self.values[:, self.lead :]

    @property
    def new_bins(self) -> FloatArray:
        """The values without the bin before the chunk, (n_channels, bins, rows)."""
        return self.new.reshape(self.values.shape[0], -1, self.bin)


def rows_of_a_bin(fs: float, n_channels: int = 1) -> int:
    """Return the rows of about a second: 64 times a number with small factors, limited by memory.

    >>> rows_of_a_bin(512.0), rows_of_a_bin(5000.0), rows_of_a_bin(117.0), rows_of_a_bin(1e7)
    (512, 5120, 128, 65536)
    """
    from scipy import fft

    most = min(MOST_BIN_ROWS, max(4096, MOST_BIN_VALUES // n_channels)) // UNITS
    # the number has the factors 2, 3 and 5 only
    return UNITS * fft.next_fast_len(max(1, int(np.ceil(min(fs / UNITS, most) - 1e-9))), real=True)


def chunk_rows(bin_rows: int, n_channels: int) -> int:
    """Return the rows of a chunk: a power of two of bins, at least two."""
    bins = CHUNK_VALUES // max(1, n_channels * bin_rows)
    return bin_rows * 2 ** max(1, bins.bit_length() - 1)


def regroup(blocks: Iterator[Block], n_channels: int, rows: int) -> Iterator[tuple[FloatArray, FloatArray | None]]:
    """Yield samples (n_channels, rows) and stamps (rows,) of blocks of any size; both arrays are reused.

    The last ones may be shorter.
    """
    samples = np.empty((n_channels, rows))
    stamps: FloatArray | None = None
    filled = 0
    for block in blocks:
        if block.stamps is not None and stamps is None:
            stamps = np.empty(rows)
        done, n = 0, block.samples.shape[0]
        while done < n:
            step = min(rows - filled, n - done)
            samples[:, filled : filled + step] = block.samples[done : done + step].T
            if stamps is not None and block.stamps is not None:
                stamps[filled : filled + step] = block.stamps[done : done + step]
            done, filled = done + step, filled + step
            if filled == rows:
                yield samples, stamps
                filled = 0
    if filled:
        yield samples[:, :filled], None if stamps is None else stamps[:filled]


def make_chunks(
    pieces: Iterable[tuple[FloatArray, np.ndarray]],
    to_si: Sequence[Callable[[FloatArray], tuple[FloatArray, str]]],
    bin_rows: int,
    rows: int,
) -> Iterator[Chunk]:
    """Yield the chunk of each piece; it is valid until the next one.

    A piece is samples as written, (n_channels, at most `rows`), and the rows of the log before which the clock jumps.
    """
    n_channels, first = len(to_si), 0
    values = np.empty((n_channels, bin_rows + rows))
    is_missing_before = np.zeros(n_channels, dtype=bool)
    for samples, breaks in pieces:
        n, lead = samples.shape[1], bin_rows if first else 0
        values[:, :lead] = values[:, values.shape[1] - lead :]
        whole = -(-n // bin_rows) * bin_rows
        used = values[:, bin_rows - lead : bin_rows + whole]
        used[:, lead + n :] = np.nan
        is_missing = np.zeros(n_channels, dtype=bool)
        for i, (own, convert) in enumerate(zip(samples, to_si, strict=True)):
            used[i, lead : lead + n] = convert(own)[0]
            new = used[i, lead : lead + n]
            if not (new.max() <= LARGEST and new.min() >= -LARGEST):
                new[~(np.abs(new) <= LARGEST)] = np.nan
                is_missing[i] = True
        yield Chunk(used, lead, first, n, bin_rows, is_missing | is_missing_before | (whole > n), breaks)
        is_missing_before, first = is_missing, first + n


# ---- series of bounded length ----------------------------------------------------------------------


Items = dict[str, np.ndarray]


class Thinning:
    """A series of at most `most` items in order of time: when there are more, each two neighbours are joined.

    The arrays of an item are joined by `np.add`, `np.fmin` or `np.fmax`.

    >>> series = Thinning({"highest": np.fmax}, most=2)
    >>> for value in (1.0, 3.0, 2.0, 0.0, 5.0):
    ...     series.add({"highest": np.array([value])})
    >>> series.items()["highest"].tolist(), series.n_halvings
    ([3.0, 5.0], 2)
    """

    def __init__(self, joins: Mapping[str, np.ufunc], most: int) -> None:
        self._joins, self._most = dict(joins), max(2, most)
        self._kept: list[Items] = []
        self._n = 0
        self._waiting: list[Items | None] = []

    @property
    def n_halvings(self) -> int:
        """The number of times that neighbours were joined: an item stands for two to this power of the added ones."""
        return len(self._waiting)

    def add(self, items: Items, *, n_halvings: int = 0) -> None:
        """Append items, which already stand for two to the power of `n_halvings` each."""
        for i in range(n_halvings, self.n_halvings):
            items = self._join_pairs(i, items)
        if _count(items):
            self._kept.append(items)
            self._n += _count(items)
        while self._n >= self._most:  # an item without a neighbour waits beside the kept ones
            self._waiting.append(None)
            halved = self._join_pairs(self.n_halvings - 1, self._concatenate())
            self._kept, self._n = [halved], _count(halved)

    def items(self) -> Items:
        """Return the kept items; the last one may stand for fewer than the others. Nothing can be added afterwards."""
        last: Items | None = None
        for waiting in self._waiting:
            if waiting is not None:
                last = waiting if last is None else self._join(waiting, last)
        if last is not None:
            self._kept.append(last)
        self._waiting = [None] * self.n_halvings
        return self._concatenate()

    def _concatenate(self) -> Items:
        if len(self._kept) != 1:
            self._kept = [{name: np.concatenate([each[name] for each in self._kept]) for name in self._joins}]
        return self._kept[0]

    def _join_pairs(self, i: int, items: Items) -> Items:
        """Join each two neighbours, beginning with the waiting one; an item without a neighbour waits."""
        waiting = self._waiting[i]
        if waiting is not None:
            items = {name: np.concatenate([waiting[name], items[name]]) for name in self._joins}
        even = _count(items) // 2 * 2
        self._waiting[i] = {name: items[name][even:].copy() for name in self._joins} if even < _count(items) else None
        return self._join(_take_every_second(items, 0, even), _take_every_second(items, 1, even))

    def _join(self, one: Items, other: Items) -> Items:
        return {name: join(one[name], other[name]) for name, join in self._joins.items()}


def _take_every_second(items: Items, first: int, stop: int) -> Items:
    return {name: array[first:stop:2] for name, array in items.items()}


def _count(items: Items) -> int:
    return next(iter(items.values())).shape[0]


class RowStretches:
    """At most `most` stretches of rows in order; those that are at most `near` rows apart are joined.

    When there are more, `near` becomes `coarse` at least, and is doubled as often as needed.
    """

    def __init__(self, *, near: int = 0, most: int = 20000, coarse: int = 1) -> None:
        self._near, self._most, self._coarse = near, most, max(coarse, 1)
        self._parts: list[np.ndarray] = []
        self._n = 0

    def add(self, starts: np.ndarray, stops: np.ndarray) -> None:
        """Append stretches that begin after the kept ones."""
        if not starts.size:
            return
        self._parts.append(_merge(np.stack([starts, stops], axis=1).astype(np.int64), self._near))
        self._n += self._parts[-1].shape[0]
        while self._n > self._most:
            self._near = max(2 * self._near, self._coarse)
            self._parts = [self.rows()]
            self._n = self._parts[0].shape[0]

    def rows(self) -> np.ndarray:
        """Return (n, 2): first row, and the row after the last one, of each stretch."""
        if not self._parts:
            return np.empty((0, 2), dtype=np.int64)
        return _merge(np.concatenate(self._parts), self._near)


def _merge(stretches: np.ndarray, near: int) -> np.ndarray:
    if stretches.shape[0] < 2:
        return stretches
    begins = np.concatenate([[True], stretches[1:, 0] - stretches[:-1, 1] > near])
    first = np.flatnonzero(begins)
    return np.stack([stretches[first, 0], np.maximum.reduceat(stretches[:, 1], first)], axis=1)
