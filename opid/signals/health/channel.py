"""The truth about a channel, chunk by chunk: offset, rms, extremes, clipping, held and missing values, resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.signals.health.chunks import Chunk
from opid.signals.health.settings import HEALTH
from opid.signals.health.thinning import RowStretches, Thinning
from opid.signals.recording import FloatArray

_HELD_LEVELS = 4  # runs are kept at so many of the largest values that were held


MOST_BINS = 20000
"""Stretches for which the rms is kept: seconds up to five and a half hours, doubled beyond."""

ENVELOPE = 2000
"""Stretches of the picture's envelope: about the pixels of a wide screen."""

_KEPT_VALUES = 4_000_000  # numbers that the bins, or the envelopes, of all channels may take
_TOP = 16
_RESOLUTION_ROWS = 1 << 17


@dataclass(frozen=True, eq=False)
class Bins:
    """Bins of all channels.

    Args:
        rows: of one.
        n: (n_bins, n_channels) values in each.
        mean: (n_bins, n_channels) NaN where there is none.
        rms: (n_bins, n_channels) about the mean.
    """

    rows: int
    n: FloatArray
    mean: FloatArray
    rms: FloatArray


class MomentCheck:
    """Mean, rms and extremes of all channels, bin by bin."""

    def __init__(self, n_channels: int, *, envelope: bool) -> None:
        most = max(64, _KEPT_VALUES // n_channels)
        self._bins = Thinning({"n": np.add, "sum": np.add, "squares": np.add}, min(MOST_BINS, most))
        joins = {"lowest": np.fmin, "highest": np.fmax}
        self._envelope = Thinning(joins, min(ENVELOPE, most)) if envelope else None
        self.shift = np.zeros(n_channels)
        self.lowest, self.highest = np.full(n_channels, np.nan), np.full(n_channels, np.nan)
        self.rows, self._begun = 0, False

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        bins = chunk.new_bins
        filled = chunk.missing
        lowest, highest = np.fmin.reduce(bins, axis=2), np.fmax.reduce(bins, axis=2)
        if not self._begun:
            first = np.where(np.isfinite(bins), bins, 0.0).sum(axis=(1, 2)) / max(1, chunk.n)
            self.shift, self._begun = first, True
        n = np.full(bins.shape[:2], float(chunk.bin))
        total, squares = np.empty(bins.shape[:2]), np.empty(bins.shape[:2])
        for i, own in enumerate(bins):
            off = own - self.shift[i]
            if filled[i]:
                there = np.isfinite(off)
                n[i] = there.sum(axis=1)
                off[~there] = 0.0
            total[i], squares[i] = off.sum(axis=1), np.einsum("ij,ij->i", off, off)
        self._bins.add({"n": n.T, "sum": total.T, "squares": squares.T})
        self.lowest = np.fmin(self.lowest, np.fmin.reduce(lowest, axis=1))
        self.highest = np.fmax(self.highest, np.fmax.reduce(highest, axis=1))
        self.rows = chunk.first + chunk.n
        if self._envelope is not None:
            self._add_envelope(chunk, lowest, highest)

    def _add_envelope(self, chunk: Chunk, lowest: FloatArray, highest: FloatArray) -> None:
        assert self._envelope is not None
        if self._envelope.n_halvings >= 6:  # a bin is 2^6 units
            self._envelope.add({"lowest": lowest.T, "highest": highest.T}, n_halvings=6)
            return
        units = chunk.new.reshape(chunk.values.shape[0], -1, chunk.bin // 64)
        self._envelope.add({"lowest": np.fmin.reduce(units, axis=2).T, "highest": np.fmax.reduce(units, axis=2).T})

    def bins(self, rows: int) -> Bins:
        """Return the bins, each of one or several of so many rows."""
        items = self._bins.items()
        n = items["n"]
        some = np.maximum(n, 1.0)
        off = items["sum"] / some
        rms = np.sqrt(np.maximum(items["squares"] / some - off**2, 0.0))
        empty = n == 0
        mean = np.where(empty, np.nan, off + self.shift)
        return Bins(2**self._bins.n_halvings * rows, n, mean, np.where(empty, np.nan, rms))

    def envelope(self) -> tuple[int, FloatArray, FloatArray]:
        """Return how many 64ths of a bin make a stretch, and the (n, n_channels) least and largest values of each."""
        assert self._envelope is not None
        items = self._envelope.items()
        return 2**self._envelope.n_halvings, items["lowest"], items["highest"]


class RunCheck:
    """Runs of one value in one channel: held values, clipping; missing values; the resolution.

    Args:
        column: of the channel.
        bin_rows: rows of a bin.
        flat_rows: samples of one value in a row that are suspicious.
    """

    def __init__(self, column: int, *, bin_rows: int, flat_rows: int) -> None:
        self._column, self._flat_rows = column, max(3, flat_rows)
        self.flat = RowStretches(coarse=bin_rows)
        self.missing = RowStretches(coarse=bin_rows)
        self.n_missing, self.n_values = 0, 0
        self.longest = 0
        self.tops = (_Extreme(1.0, bin_rows), _Extreme(-1.0, bin_rows))
        self._open = -1  # first row of the run that the last row belongs to, where that is longer than one row
        self._last = self._open_value = np.nan
        self._values: list[FloatArray] = []
        self._fed = 0

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        x = chunk.new[self._column, : chunk.n]
        if chunk.missing[self._column]:
            self._take_missing(x, chunk.first)
        self.n_values += x.size
        self._take_levels(x)
        same = np.empty(x.size, dtype=bool)
        same[0] = bool(x[0] == self._last)
        np.equal(x[1:], x[:-1], out=same[1:])
        self._last = float(x[-1])
        indices = np.flatnonzero(same)
        if indices.size:
            self._take_runs(x, indices, chunk.first)
        else:
            self._finish(chunk.first)
            self.longest = max(self.longest, 1)

    def finish(self) -> None:
        """Close the last run."""
        self._finish(self.n_values)
        self.n_values -= self.n_missing

    @property
    def is_mute(self) -> bool:
        """Whether there are but few distinct values."""
        return self.tops[0].values.size <= HEALTH.mute_values

    def step(self) -> float | None:
        """Return the resolution: the step of which the values are multiples, None where none is visible."""
        values = np.unique(np.concatenate(self._values)) if self._values else np.empty(0)
        return None if self.is_mute or values.size < 2 else _quantisation_step(values)

    def find_clipping(self, step: float | None) -> tuple[int, list[float], np.ndarray]:
        """Return how many samples are held at an extreme value, at which ones, and (n, 2) the rows."""
        found = [held for side in self.tops if not self.is_mute and (held := side.find_clipping(step)) is not None]
        stretches = [held.rows.rows() for held in found]
        joined = np.concatenate(stretches) if stretches else np.empty((0, 2), dtype=np.int64)
        joined = joined[np.argsort(joined[:, 0], kind="stable")]
        return sum(held.samples for held in found), [held.value for held in found], joined

    def _take_missing(self, x: FloatArray, first: int) -> None:
        gone = np.concatenate([[False], np.isnan(x), [False]])
        edges = np.flatnonzero(gone[1:] != gone[:-1]) + first
        self.n_missing += int(np.count_nonzero(gone))
        self.missing.add(edges[0::2], edges[1::2])

    def _take_levels(self, x: FloatArray) -> None:
        if self._fed < _RESOLUTION_ROWS or self.tops[0].values.size < _TOP:
            values, counts = np.unique(x[np.isfinite(x)], return_counts=True)
            for side in self.tops:
                side.take(values, counts)
            if self._fed < _RESOLUTION_ROWS and values.size:
                self._values.append(values)
                # a standstill of a few levels shows the resolution, but so would any stretch of motion
                self._fed += x.size if values.size > _TOP else 0
                if len(self._values) > 8:
                    self._values = [np.unique(np.concatenate(self._values))]
            return
        for side in self.tops:
            side.look(x)

    def _take_runs(self, x: FloatArray, indices: np.ndarray, first: int) -> None:
        cuts = np.flatnonzero(np.diff(indices) > 1)
        starts = indices[np.concatenate([[0], cuts + 1])] - 1 + first
        stops = indices[np.concatenate([cuts, [-1]])] + 1 + first
        if indices[0] == 0 and self._open >= 0:
            starts[0] = self._open
        else:
            self._finish(first)
        self._open = -1
        if stops[-1] == first + x.size:
            self._open, self._open_value = int(starts[-1]), float(x[-1])
            starts, stops = starts[:-1], stops[:-1]
        self._take(starts, stops, x[stops - 1 - first])

    def _finish(self, row: int) -> None:
        """The open run ends before this row."""
        if self._open >= 0:
            start, self._open = self._open, -1
            self._take(np.array([start]), np.array([row]), np.array([self._open_value]))

    def _take(self, starts: np.ndarray, stops: np.ndarray, values: FloatArray) -> None:
        if not starts.size:
            return
        length = stops - starts
        self.longest = max(self.longest, int(length.max()))
        long = length >= HEALTH.clip_run
        if long.any():
            starts, stops, length, values = starts[long], stops[long], length[long], values[long]
            for side in self.tops:
                side.hold(starts, stops, values)
            flat = length >= self._flat_rows
            self.flat.add(starts[flat], stops[flat])


class _Held:
    """The runs at one value."""

    def __init__(self, value: float, bin_rows: int) -> None:
        self.value, self.samples, self.runs = value, 0, 0
        self.rows = RowStretches(near=bin_rows)


class _Extreme:
    """The largest values (of the least, where `sign` is -1) of a channel, and the runs at the largest that have any."""

    def __init__(self, sign: float, bin_rows: int) -> None:
        self._sign, self._bin = sign, bin_rows
        self.values, self.counts = np.empty(0), np.empty(0, dtype=np.int64)  # times sign, the largest first
        self._held: dict[float, _Held] = {}  # by value times sign

    def look(self, x: FloatArray) -> None:
        """Take the values of a chunk when there is a full list to compare them with."""
        least = self._sign * self.values[-1]
        own = x[x >= least] if self._sign > 0 else x[x <= least]
        if own.size:
            self.take(*np.unique(own, return_counts=True))

    def take(self, values: FloatArray, counts: np.ndarray) -> None:
        """Take distinct values in rising order and how often each occurs."""
        if self._sign > 0:
            values, counts = values[::-1][:_TOP], counts[::-1][:_TOP]
        else:
            values, counts = -values[:_TOP], counts[:_TOP]
        every, index = np.unique(np.concatenate([self.values, values]), return_inverse=True)
        total = np.bincount(index, np.concatenate([self.counts, counts]), minlength=every.size).astype(np.int64)
        self.values, self.counts = every[::-1][:_TOP], total[::-1][:_TOP]

    def hold(self, starts: np.ndarray, stops: np.ndarray, values: FloatArray) -> None:
        """Take runs in order, and the values that are held."""
        own = self._sign * values
        if len(self._held) == _HELD_LEVELS:
            large = own >= min(self._held)
            if not large.any():
                return
            starts, stops, own = starts[large], stops[large], own[large]
        for value in np.unique(own)[-_HELD_LEVELS:].tolist():
            held = self._held.setdefault(value, _Held(self._sign * value, self._bin))
            at = own == value
            held.samples += int((stops[at] - starts[at]).sum())
            held.runs += int(np.count_nonzero(at))
            held.rows.add(starts[at], stops[at])
        for value in sorted(self._held)[:-_HELD_LEVELS]:
            del self._held[value]

    def find_clipping(self, step: float | None) -> _Held | None:
        """Return the runs at the end of the range: at the largest value, or at one with but single samples beyond."""
        for value in sorted(self._held, reverse=True):
            held = self._held[value]
            beyond = int(self.counts[self.values > value].sum())
            if value < self.values[-1] or (
                beyond and not held.runs >= max(HEALTH.least_peaks, HEALTH.clip_crowding * beyond)
            ):
                continue
            if self._is_certain(held, value, step):
                return held
        return None

    def _is_certain(self, held: _Held, value: float, step: float | None) -> bool:
        """Whether it is held more often than rounding makes it, by the levels next to it."""
        if step is None:
            return True
        below = value - self.values
        next_levels = self.counts[(below > 0.5 * step) & (below < 2.5 * step)].sum() / 2
        # the one keeps a single rounded peak of few samples from passing for a clipped one
        return bool(held.samples > HEALTH.clip_crowding * (next_levels + 1))


def _quantisation_step(values: FloatArray) -> float | None:
    """Return the smallest distance between values if most neighbouring values are 1 to 10 of it apart."""
    distances = np.diff(values)
    # two values that conversion to SI has rounded apart are one level
    distances = distances[distances > 1e-9 * (values[-1] - values[0])]
    smallest = distances.min()
    step = float(distances[distances < 1.5 * smallest].mean())
    multiples = distances / step
    regular = (multiples < 10.5) & (np.abs(multiples - np.round(multiples)) < 0.1)
    return step if regular.mean() > 0.5 else None
