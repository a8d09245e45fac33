"""Single samples that stand far out: found, counted, mended."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from opid.signals.chunks import Chunk
from opid.signals.recording import FloatArray

SPIKE_SIGMA = 10.0
"""Robust standard deviations by which a spike departs from its neighbours; Gaussian noise never does."""

SPIKE_BLOCK_S = 1.0
"""Stretch over which the usual departure is taken, lest a braking run's loud start be called spiky."""

QUIET_PART = 0.1
"""A stretch that is quieter than this part of the whole run is taken to be as loud as that: a standstill has hardly
any departure."""

LEAST_MOVING = 16
"""Departures other than none that tell what is usual in a stretch; where it is held or clipped there are fewer."""

_ROBUST = 1.4826  # median of |x| -> standard deviation, Gaussian
_PICKED = 512  # departures of a bin that its median is taken of: known to 4 %, with tenfold to spare
_MOST_CANDIDATES = 50000


def without_spikes(samples: ArrayLike, *, fs: float) -> tuple[FloatArray, np.ndarray]:
    """Replace single samples that stand far out by the cubic through their four neighbours.

    Args:
        samples: (n,) one channel.
        fs: sampling rate, Hz.

    Returns:
        The mended samples, (n,), and the places that were mended.

    >>> signal = np.sin(np.arange(2000) / 20.0)
    >>> signal[700] += 30.0
    >>> mended, places = without_spikes(signal, fs=500.0)
    >>> places.tolist(), bool(abs(mended[700] - np.sin(35.0)) < 0.01)
    ([700], True)
    """
    mended = np.array(samples, dtype=np.float64)
    places = _spikes(mended, fs)
    near, far = mended[places - 1] + mended[places + 1], mended[places - 2] + mended[places + 2]
    mended[places] = (4 * near - far) / 6
    return mended, places


def _spikes(samples: FloatArray, fs: float) -> np.ndarray:
    """Return the indices of single samples far from both neighbours, while those are close to each other.

    The departure from the neighbours' mean, d_k = x_k - (x_{k-1} + x_{k+1})/2, of a spike of height s is
    -s/2, s, -s/2; an impact that rings makes departures of one sign.
    """
    departure = samples[1:-1] - 0.5 * (samples[:-2] + samples[2:])
    block = max(16, round(SPIKE_BLOCK_S * fs))
    if departure.size < block:
        return np.empty(0, dtype=np.intp)
    size = np.abs(departure)
    n_blocks = departure.size // block
    usual = _beside(_usual(size[: n_blocks * block].reshape(n_blocks, block)))
    if not np.isfinite(usual).any():
        return np.empty(0, dtype=np.intp)
    usual = np.maximum(usual, QUIET_PART * float(np.nanmedian(usual)))
    limit = SPIKE_SIGMA * _ROBUST * usual[np.minimum(np.arange(departure.size) // block, n_blocks - 1)]
    far = np.flatnonzero(size[1:-1] > limit[1:-1]) + 1
    return far[_alone(departure, far)] + 1


def _usual(size: FloatArray) -> FloatArray:
    """Median of each row of what is not 0 or NaN, NaN where that is little: held values have no departure at all."""
    moving = size > 0
    if moving.all():
        return np.asarray(np.median(size, axis=1))
    n = moving.sum(axis=1)
    ordered = np.sort(np.where(moving, size, np.inf), axis=1)
    middle = np.maximum(n - 1, 0)[:, np.newaxis] // 2
    usual = np.take_along_axis(ordered, middle, axis=1)[:, 0]
    return np.where(n >= min(LEAST_MOVING, size.shape[1]), usual, np.nan)


def _beside(usual: FloatArray) -> FloatArray:
    """Of what is usual in each stretch and its neighbours the largest: motion may begin or end in a quiet one."""
    around = np.concatenate([[np.nan], usual, [np.nan]])
    return np.asarray(np.fmax(np.fmax(around[:-2], around[2:]), usual))


def _alone(departure: FloatArray, places: np.ndarray) -> np.ndarray:
    left, centre, right = departure[places - 1], departure[places], departure[places + 1]
    return np.maximum(np.sign(centre) * left, np.sign(centre) * right) < -0.25 * np.abs(centre)


class SpikeSearch:
    """Finds the spikes of one channel in chunks, as `without_spikes` does in a whole run.

    Args:
        column: of the channel.
        bin_rows: rows of a bin, over which the usual departure is taken.
    """

    def __init__(self, column: int, bin_rows: int) -> None:
        self._column, self._bin = column, bin_rows
        step = max(1, bin_rows // _PICKED)
        starts = np.arange(0, bin_rows - step + 1, step)
        # irregular places: a tone must not be met at one phase only
        self._picked = starts + np.floor(step * ((0.6180339887498949 * np.arange(starts.size)) % 1)).astype(np.intp)
        self._usual: list[FloatArray] = []
        self._some = False
        self._before = np.inf
        self._found: list[np.ndarray] = []
        self._n_found = 0

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk.

        Args:
            chunk: the next one.
        """
        lead, n = chunk.lead, chunk.n
        begin = max(lead - 4, 0)
        x = chunk.values[self._column, begin : lead + n]
        if x.size < 5:
            return
        departure = x[:-2] + x[2:]
        departure *= -0.5
        departure += x[1:-1]
        size = np.abs(departure)
        offset = begin - lead + 1  # departure k is that of row `offset + k` of the chunk
        usual = self._usual_of_bins(size, offset, n)
        floor = 0.5 * QUIET_PART * self._median() if self._some else np.inf
        # centres from two rows before the chunk to two before its end: each needs two neighbours on either side
        first, stop = (-2 if lead else 2), n - 2
        limit = np.repeat(SPIKE_SIGMA * _ROBUST * np.maximum(usual, floor), self._bin)
        centres = size[first - offset : stop - offset]
        far = np.flatnonzero(centres > limit[self._bin + first : self._bin + stop]) + first
        far = far[_alone(departure, far - offset)]
        self._keep(far + chunk.first, size[far - offset])

    def rows(self, step: float | None) -> np.ndarray:
        """Return the rows of the spikes.

        Args:
            step: of the channel's resolution; None where none is visible.
        """
        if not self._found or not self._some:
            return np.empty(0, dtype=np.int64)
        rows, size = np.concatenate(self._found, axis=1)
        every = np.concatenate(self._usual)
        own = _beside(every)[np.minimum(rows.astype(np.int64) // self._bin, every.size - 1)]
        floor = max(QUIET_PART * self._median(), 0.5 * (step or 0.0))
        return rows[size > SPIKE_SIGMA * _ROBUST * np.fmax(own, floor)].astype(np.int64)

    def _median(self) -> float:
        return float(np.nanmedian(np.concatenate(self._usual)))

    def _usual_of_bins(self, size: FloatArray, offset: int, n: int) -> FloatArray:
        """What is usual in the bin before and in each bin of the chunk; that before it where a bin is not full."""
        full = n // self._bin
        own = np.empty(0)
        if full:
            places = np.arange(full)[:, np.newaxis] * self._bin + self._picked - offset
            own = _usual(np.take(size, places, mode="clip"))
            self._usual.append(own)
            self._some = self._some or bool(np.isfinite(own).any())
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
