"""Spikes: single samples that stand far out of their surroundings are found, counted and replaced.

A spike of height s from a cable or a converter lasts for one sample. It adds 0, -s/2, s, -s/2, 0 to the departures of
the samples from the mean of their neighbours, d_k = x_k - (x_{k-1} + x_{k+1}) / 2, and without that one sample the
signal is smooth. A jump of a force is not like that: where dry friction changes its sign the acceleration goes to
another value within a sample or two and stays there, and the sensor's filter makes it ring on both sides. Without any
one of its samples the jump is still there: a step between two samples leaves at least half of what was removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.signals.health.chunks import Chunk
from opid.signals.recording import FloatArray


@dataclass(frozen=True)
class SpikeSettings:
    """What counts as a spike.

    Args:
        least_sigma: a spike departs from its neighbours' mean by this many robust standard deviations. Gaussian noise
            never does.
        most_left: largest difference between the two departures on either side of a spike and those of a lone sample,
            over its height. Below 3 / least_sigma noise hides spikes that just stand out, and at 0.5 a jump between two
            samples passes for a spike. At 0.35 noise hides 1 of 1000 spikes that just stand out, and none of 14 million
            samples of dry friction behind a sharp anti-alias filter is called a spike.
        reach: so many samples after a spike are as smooth as those beside it. A structure that was struck rings on, and
            with 2 of them each of its first periods may look like a spike; spikes of a storm that are nearer to each
            other hide each other. What rattled before a spike does not count.
        quiet_ratio: a bin counts as at least this fraction as loud as the whole run, because a standstill has hardly
            any departures.
        least_moving: number of nonzero departures that show what is usual in a bin. A value that is held or clipped
            gives fewer.
    """

    least_sigma: float = 10.0
    most_left: float = 0.35
    reach: int = 6
    quiet_ratio: float = 0.1
    least_moving: int = 16


SPIKES = SpikeSettings()

_ROBUST = 1.4826  # median of |x| -> standard deviation, Gaussian
_PICKED = 512  # departures of a bin that give its median: to 4 %, ten times better than needed
_MOST_CANDIDATES = 50000  # number of candidates that are kept


def remove_spikes(samples: ArrayLike, *, fs: float) -> tuple[FloatArray, np.ndarray]:
    """Replace single samples that stand far out by the cubic through their four neighbours.

    The first 3 and the last 7 samples stay as they are, for a spike is recognised by those around it.

    Args:
        samples: (n,) one channel.
        fs: sampling rate, Hz.

    Returns:
        The mended samples, (n,), and the indices of the replaced ones.

    >>> signal = np.sin(np.arange(2000) / 20.0)
    >>> signal[700] += 30.0
    >>> signal[1200:] += 5.0
    >>> mended, indices = remove_spikes(signal, fs=500.0)
    >>> indices.tolist(), bool(abs(mended[700] - np.sin(35.0)) < 0.01)
    ([700], True)
    """
    mended = np.array(samples, dtype=np.float64)
    bin_rows = max(16, min(round(fs), mended.size))  # a second
    values = np.full((1, -(-mended.size // bin_rows) * bin_rows), np.nan)
    values[0, : mended.size] = mended
    search = SpikeSearch(0, bin_rows)
    search.add(Chunk(values, 0, 0, mended.size, bin_rows, np.zeros(1, dtype=bool), np.empty(0, dtype=np.int64)))
    indices = search.rows(None)
    near, far = mended[indices - 1] + mended[indices + 1], mended[indices - 2] + mended[indices + 2]
    mended[indices] = (4 * near - far) / 6
    return mended, indices


def _find_usual(size: FloatArray, least_moving: int) -> FloatArray:
    """Return the median of the positive values of each row, NaN where there are few: held values have no departures."""
    moving = size > 0
    if moving.all():
        return np.asarray(np.median(size, axis=1))
    n = moving.sum(axis=1)
    ordered = np.sort(np.where(moving, size, np.inf), axis=1)
    middle = np.maximum(n - 1, 0)[:, np.newaxis] // 2
    usual = np.take_along_axis(ordered, middle, axis=1)[:, 0]
    return np.where(n >= min(least_moving, size.shape[1]), usual, np.nan)


def _spread_to_neighbours(usual: FloatArray) -> FloatArray:
    """Return the largest usual departure of each bin and its neighbours, for motion may begin or end in a quiet bin."""
    around = np.concatenate([[np.nan], usual, [np.nan]])
    return np.asarray(np.fmax(np.fmax(around[:-2], around[2:]), usual))


def _is_lone(departure: FloatArray, indices: np.ndarray, most_left: float) -> np.ndarray:
    """Return whether the departures around each index are 0, -s/2, s, -s/2, 0 .. 0, up to a fraction of s.

    The cubic through its four neighbours is lower than the sample by s = (2 d_k - d_{k-1} - d_{k+1}) / 3.
    """
    before, after = departure[indices - 1], departure[indices + 1]
    height = (2 * departure[indices] - before - after) / 3
    further = [departure[indices + k] for k in (-2, *range(2, SPIKES.reach + 1))]
    left_over = np.stack([before + height / 2, after + height / 2, *further])
    return np.asarray(np.abs(left_over).max(axis=0) < most_left * np.abs(height))


class SpikeSearch:
    """Finds the spikes of one channel, chunk by chunk.

    Each bin has its own usual departure, so that the loud beginning of a braking run does not look like spikes.
    """

    def __init__(self, column: int, bin_rows: int) -> None:
        self._column, self._bin = column, bin_rows
        step = max(1, bin_rows // _PICKED)
        starts = np.arange(0, bin_rows - step + 1, step)
        # irregular indices do not meet a tone at one phase only
        self._picked = starts + np.floor(step * ((0.6180339887498949 * np.arange(starts.size)) % 1)).astype(np.intp)
        self._usual: list[FloatArray] = []
        self._has_usual = False
        self._before = np.inf
        self._found: list[np.ndarray] = []
        self._n_found = 0

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        lead, n = chunk.lead, chunk.n
        before, after = 3, SPIKES.reach + 1  # samples around a spike that recognise it
        begin = max(lead - before - after, 0)
        x = chunk.values[self._column, begin : lead + n]
        if x.size < before + after + 1:
            return
        departure = x[:-2] + x[2:]
        departure *= -0.5
        departure += x[1:-1]
        size = np.abs(departure)
        offset = begin - lead + 1  # departure k belongs to row `offset + k` of the chunk
        usual = self._find_usual_of_bins(size, offset, n)
        floor = 0.5 * SPIKES.quiet_ratio * self._compute_median() if self._has_usual else np.inf
        # those that the last chunk ended too early for, and those of this one that have their neighbours
        first, stop = -after if lead else before, n - after
        limit = np.repeat(SPIKES.least_sigma * _ROBUST * np.maximum(usual, floor), self._bin)
        centres = size[first - offset : stop - offset]
        far = np.flatnonzero(centres > limit[self._bin + first : self._bin + stop]) + first
        far = far[_is_lone(departure, far - offset, SPIKES.most_left)]
        self._keep(far + chunk.first, size[far - offset])

    def rows(self, step: float | None) -> np.ndarray:
        """Return the rows of the spikes."""
        if not self._found or not self._has_usual:
            return np.empty(0, dtype=np.int64)
        rows, size = np.concatenate(self._found, axis=1)
        every = np.concatenate(self._usual)
        own = _spread_to_neighbours(every)[np.minimum(rows.astype(np.int64) // self._bin, every.size - 1)]
        floor = max(SPIKES.quiet_ratio * self._compute_median(), 0.5 * (step or 0.0))
        return rows[size > SPIKES.least_sigma * _ROBUST * np.fmax(own, floor)].astype(np.int64)

    def _compute_median(self) -> float:
        return float(np.nanmedian(np.concatenate(self._usual)))

    def _find_usual_of_bins(self, size: FloatArray, offset: int, n: int) -> FloatArray:
        """Return the usual departures of the bin before the chunk and of its bins; an unfilled bin takes the last."""
        full = n // self._bin
        own = np.empty(0)
        if full:
            indices = np.arange(full)[:, np.newaxis] * self._bin + self._picked - offset
            own = _find_usual(np.take(size, indices, mode="clip"), SPIKES.least_moving)
            self._usual.append(own)
            self._has_usual = self._has_usual or bool(np.isfinite(own).any())
        every = np.concatenate([[self._before], own, [np.nan]])
        for k in np.flatnonzero(np.isnan(every)):
            every[k] = every[k - 1]
        self._before = float(every[full])
        return every

    def _keep(self, rows: np.ndarray, size: FloatArray) -> None:
        room = _MOST_CANDIDATES - self._n_found
        if rows.size and room > 0:
            self._found.append(np.stack([rows.astype(np.float64), size])[:, :room])
            self._n_found += min(room, rows.size)
