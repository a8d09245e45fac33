"""The blocks of a track, however they come, as chunks of one size: what is found does not depend on the blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.log import Block
from opid.signals.recording import FloatArray

UNITS = 64
"""Parts of a bin: a bin of 64 times a round number of rows has a fast Fourier transform."""

CHUNK_VALUES = 1 << 19
"""Values of a chunk, about: 4 MiB, so that the processor's cache holds a channel of it."""
MOST_BIN_ROWS, MOST_BIN_VALUES = 1 << 16, 1 << 21
"""A bin has no more rows, nor, but for 4096 rows, more values: above 65 kHz it is less than a second."""

LARGEST = 1e60
"""Values beyond, and those that are no number, count as missing: they measure nothing, and their squares overflow."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive rows, channel by channel.

    Args:
        values: (n_channels, lead + n) in SI, NaN where there is none: the bin before, then whole bins; the last chunk
            is filled up with NaN.
        lead: rows of the bin before, 0 for the first chunk.
        first: number of the first row after them.
        n: rows after them that the log has.
        bin: rows of a bin.
        missing: (n_channels,) whether a value of these rows, or of those before, is not there.
        breaks: rows (numbers in the log) before which the clock jumps.
    """

    values: FloatArray
    lead: int
    first: int
    n: int
    bin: int
    missing: np.ndarray
    breaks: np.ndarray

    @property
    def new(self) -> FloatArray:
        """(n_channels, whole bins) without the bin before."""
        return self.values[:, self.lead :]

    @property
    def new_bins(self) -> FloatArray:
        """(n_channels, bins, rows) without the bin before."""
        return self.new.reshape(self.values.shape[0], -1, self.bin)


def rows_of_a_bin(fs: float, n_channels: int = 1) -> int:
    """Return the rows of about a second, 64 times a number of small factors; 64 at least, and no more than fit memory.

    >>> rows_of_a_bin(512.0), rows_of_a_bin(5000.0), rows_of_a_bin(117.0), rows_of_a_bin(1e7)
    (512, 5120, 128, 65536)
    """
    from scipy import fft

    most = min(MOST_BIN_ROWS, max(4096, MOST_BIN_VALUES // n_channels)) // UNITS
    # a number with the factors 2, 3 and 5 alone
    return UNITS * fft.next_fast_len(max(1, int(np.ceil(min(fs / UNITS, most) - 1e-9))), real=True)


def chunk_rows(bin_rows: int, n_channels: int) -> int:
    """Return the rows of a chunk: a power of two of bins, at least two."""
    bins = CHUNK_VALUES // max(1, n_channels * bin_rows)
    return bin_rows * 2 ** max(1, bins.bit_length() - 1)


def regroup(blocks: Iterator[Block], n_channels: int, rows: int) -> Iterator[tuple[FloatArray, FloatArray | None]]:
    """Yield samples (n_channels, rows) and stamps (rows,), the last ones shorter; both are used again."""
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


class ChunkMaker:
    """Makes chunks of samples: SI, the bin before in front, what is missing marked."""

    def __init__(self, to_si: Sequence[Callable[[FloatArray], FloatArray]], bin_rows: int, rows: int) -> None:
        self._to_si, self._bin, self._rows = tuple(to_si), bin_rows, rows
        self._values = np.empty((len(self._to_si), bin_rows + rows))
        self._missing_before = np.zeros(len(self._to_si), dtype=bool)
        self._first = 0

    def chunk(self, samples: FloatArray, breaks: np.ndarray) -> Chunk:
        """Return the next chunk; it is valid until the one after it is made.

        Args:
            samples: (n_channels, n) as written.
        """
        n, values = samples.shape[1], self._values
        lead = self._bin if self._first else 0
        if lead:
            values[:, :lead] = values[:, -lead:]
        whole = -(-n // self._bin) * self._bin
        used = values[:, self._bin - lead : self._bin + whole]
        used[:, lead + n :] = np.nan
        missing = np.zeros(len(self._to_si), dtype=bool)
        for i, (own, convert) in enumerate(zip(samples, self._to_si, strict=True)):
            used[i, lead : lead + n] = convert(own)
            part = used[i, lead : lead + n]
            if not (part.max() <= LARGEST and part.min() >= -LARGEST):
                part[~(np.abs(part) <= LARGEST)] = np.nan
                missing[i] = True
        before, self._missing_before = self._missing_before, missing
        first, self._first = self._first, self._first + n
        return Chunk(used, lead, first, n, self._bin, missing | before | (whole > n), breaks)
