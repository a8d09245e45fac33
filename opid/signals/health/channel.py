"""Checks of channels, chunk by chunk: offset, rms, extremes, clipping, held and missing values, resolution.

What is wrong with a channel, and what to do about it, is said in one sentence each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.health.chunks import Chunk, RowStretches, Thinning
from opid.signals.health.result import ChannelHealth, Kind, Sentences, Severity
from opid.signals.health.settings import HEALTH
from opid.signals.recording import FloatArray
from opid.signals.units import STANDARD_GRAVITY

_HELD_VALUES = 4  # runs are kept at this number of the largest values that were held
MOST_BINS = 20000
"""Bins whose rms is kept: seconds in logs of up to five and a half hours, and longer bins beyond."""

ENVELOPE = 2000
"""Stretches of a picture's envelope: about the pixels of a wide screen."""

_KEPT_VALUES = 4_000_000  # numbers in the bins, or in the envelopes, of all channels
_TOP = 16  # extreme values that are counted
_RESOLUTION_ROWS = 1 << 17  # rows that show the resolution


@dataclass(frozen=True, eq=False)
class Bins:
    """Moments of all channels in bins of rows."""

    rows: int  # number of rows of a bin
    n: FloatArray  # (n_bins, n_channels) number of values
    mean: FloatArray  # (n_bins, n_channels), NaN where there is no value
    rms: FloatArray  # (n_bins, n_channels) about the mean, NaN where there is no value
    lowest: FloatArray  # (n_channels,) least value of all bins
    highest: FloatArray  # (n_channels,) largest value of all bins

    def moments(self, i: int) -> tuple[float, float, float]:
        """Return the mean of channel i, the rms about it and the largest distance from it; NaN without a value."""
        n = self.n[:, i]
        total = n.sum()
        if not total:
            return np.nan, np.nan, np.nan
        means, squares = np.nan_to_num(self.mean[:, i]), np.nan_to_num(self.rms[:, i]) ** 2
        mean = float(n @ means / total)
        rms = float(np.sqrt(n @ (squares + (means - mean) ** 2) / total))
        return mean, rms, max(float(self.highest[i]) - mean, mean - float(self.lowest[i]))

    def drift(self, i: int, fs: float) -> tuple[float, float]:
        """Return the range of the means of long parts, and their length, s; 0 where there are not two of them."""
        n = self.n[:, i]
        length_s = n.size * self.rows / fs
        parts = min(HEALTH.drift_parts, int(n.sum() / fs / HEALTH.drift_part_s), n.size)
        if parts < 2:
            return 0.0, length_s
        edges = np.arange(parts) * n.size // parts
        count = np.add.reduceat(n, edges)
        means = np.add.reduceat(n * np.nan_to_num(self.mean[:, i]), edges)[count > 0] / count[count > 0]
        return float(np.ptp(means)), length_s / parts

    def rms_beside(self, i: int, stretches: np.ndarray) -> FloatArray:
        """Return the larger rms of channel i half a bin before and after each stretch, (n, 2) rows."""
        rms, half = np.nan_to_num(self.rms[:, i]), self.rows // 2
        before = np.clip((stretches[:, 0] - half) // self.rows, 0, rms.size - 1)
        after = np.clip((stretches[:, 1] + half) // self.rows, 0, rms.size - 1)
        return np.maximum(rms[before], rms[after])

    def touched_by(self, stretches: np.ndarray) -> np.ndarray:
        """Return whether each bin holds a row of a stretch, (n, 2) rows."""
        n = self.n.shape[0]
        edges = np.zeros(n + 1)
        np.add.at(edges, np.minimum(stretches[:, 0] // self.rows, n), 1)
        np.add.at(edges, np.minimum((stretches[:, 1] - 1) // self.rows + 1, n), -1)
        return np.cumsum(edges[:-1]) > 0


class MomentCheck:
    """The check of all channels for mean, rms and extremes, bin by bin."""

    def __init__(self, n_channels: int, *, envelope: bool) -> None:
        most = max(64, _KEPT_VALUES // n_channels)
        self._bins = Thinning({"n": np.add, "sum": np.add, "squares": np.add}, min(MOST_BINS, most))
        joins = {"lowest": np.fmin, "highest": np.fmax}
        self._envelope = Thinning(joins, min(ENVELOPE, most)) if envelope else None
        self._shift = np.zeros(n_channels)
        self._lowest, self._highest = np.full(n_channels, np.nan), np.full(n_channels, np.nan)

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        bins = chunk.new_bins
        lowest, highest = np.fmin.reduce(bins, axis=2), np.fmax.reduce(bins, axis=2)
        if chunk.first == 0:
            self._shift = np.where(np.isfinite(bins), bins, 0.0).sum(axis=(1, 2)) / max(1, chunk.n)
        n = np.full(bins.shape[:2], float(chunk.bin))
        total, squares = np.empty(bins.shape[:2]), np.empty(bins.shape[:2])
        for i, own in enumerate(bins):
            off = own - self._shift[i]
            if chunk.missing[i]:
                there = np.isfinite(off)
                n[i] = there.sum(axis=1)
                off[~there] = 0.0
            total[i], squares[i] = off.sum(axis=1), np.einsum("ij,ij->i", off, off)
        self._bins.add({"n": n.T, "sum": total.T, "squares": squares.T})
        self._lowest = np.fmin(self._lowest, np.fmin.reduce(lowest, axis=1))
        self._highest = np.fmax(self._highest, np.fmax.reduce(highest, axis=1))
        if self._envelope is not None and self._envelope.n_halvings >= 6:  # a stretch is a bin (2^6 units) or longer
            self._envelope.add({"lowest": lowest.T, "highest": highest.T}, n_halvings=6)
        elif self._envelope is not None:
            units = chunk.new.reshape(chunk.values.shape[0], -1, chunk.bin // 64)
            self._envelope.add({"lowest": np.fmin.reduce(units, axis=2).T, "highest": np.fmax.reduce(units, axis=2).T})

    def bins(self, rows: int) -> Bins:
        """Return the bins; each joins one or several bins of so many rows."""
        items = self._bins.items()
        n = items["n"]
        some = np.maximum(n, 1.0)
        off = items["sum"] / some
        rms = np.sqrt(np.maximum(items["squares"] / some - off**2, 0.0))
        empty = n == 0
        rows *= 2**self._bins.n_halvings
        mean, rms = np.where(empty, np.nan, off + self._shift), np.where(empty, np.nan, rms)
        return Bins(rows, n, mean, rms, self._lowest, self._highest)

    def envelope(self) -> tuple[int, FloatArray, FloatArray]:
        """Return the length of a stretch in 64ths of a bin, and the least and largest values, (n, n_channels)."""
        assert self._envelope is not None
        items = self._envelope.items()
        return 2**self._envelope.n_halvings, items["lowest"], items["highest"]


class RunCheck:
    """The check of one channel for runs of one value (held, clipped), missing values, and its resolution.

    So many equal samples in a row as `flat_rows` are suspicious.
    """

    def __init__(self, column: int, *, bin_rows: int, flat_rows: int) -> None:
        self._column, self._flat_rows = column, max(3, flat_rows)
        self.flat = RowStretches(coarse=bin_rows)
        self.missing = RowStretches(coarse=bin_rows)
        self.n_missing, self.n_values = 0, 0
        self.longest = 0
        self.tops = (_Extreme(1.0, bin_rows), _Extreme(-1.0, bin_rows))
        self._open = -1  # first row of the run that the last row continues, -1 where there is none
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
        """Whether there are only few distinct values."""
        return self.tops[0].values.size <= HEALTH.mute_values

    def step(self) -> float | None:
        """Return the resolution: the values are multiples of this step; None where no step is visible."""
        values = np.unique(np.concatenate(self._values)) if self._values else np.empty(0)
        return None if self.is_mute or values.size < 2 else find_quantisation_step(values)

    def find_clipping(self, step: float | None) -> tuple[int, list[float], np.ndarray]:
        """Return the number of samples that are held at an extreme value, these values, and the rows, (n, 2)."""
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
                # a standstill with few values does not count: motion has to show the resolution as well
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
    def __init__(self, value: float, bin_rows: int) -> None:
        self.value, self.samples, self.runs = value, 0, 0
        self.rows = RowStretches(near=bin_rows)


class _Extreme:
    """The largest values of a channel (the least where `sign` is -1), and the runs at the largest held values."""

    def __init__(self, sign: float, bin_rows: int) -> None:
        self._sign, self._bin = sign, bin_rows
        self.values, self.counts = np.empty(0), np.empty(0, dtype=np.int64)  # times sign, the largest first
        self._held: dict[float, _Held] = {}  # by value times sign

    def look(self, x: FloatArray) -> None:
        """Take the values of a chunk that are at least as large as the last of a full list."""
        least = self._sign * self.values[-1]
        own = x[x >= least] if self._sign > 0 else x[x <= least]
        if own.size:
            self.take(*np.unique(own, return_counts=True))

    def take(self, values: FloatArray, counts: np.ndarray) -> None:
        """Take distinct values in increasing order, and how often each occurs."""
        if self._sign > 0:
            values, counts = values[::-1][:_TOP], counts[::-1][:_TOP]
        else:
            values, counts = -values[:_TOP], counts[:_TOP]
        every, index = np.unique(np.concatenate([self.values, values]), return_inverse=True)
        total = np.bincount(index, np.concatenate([self.counts, counts]), minlength=every.size).astype(np.int64)
        self.values, self.counts = every[::-1][:_TOP], total[::-1][:_TOP]

    def hold(self, starts: np.ndarray, stops: np.ndarray, values: FloatArray) -> None:
        """Take runs in order of time, and the values that they hold."""
        own = self._sign * values
        if len(self._held) == _HELD_VALUES:
            large = own >= min(self._held)
            if not large.any():
                return
            starts, stops, own = starts[large], stops[large], own[large]
        for value in np.unique(own)[-_HELD_VALUES:].tolist():
            held = self._held.setdefault(value, _Held(self._sign * value, self._bin))
            at = own == value
            held.samples += int((stops[at] - starts[at]).sum())
            held.runs += int(np.count_nonzero(at))
            held.rows.add(starts[at], stops[at])
        for value in sorted(self._held)[:-_HELD_VALUES]:
            del self._held[value]

    def find_clipping(self, step: float | None) -> _Held | None:
        """Return the runs at the end of the range: the largest value, or one that only single samples exceed."""
        for value in sorted(self._held, reverse=True):
            held = self._held[value]
            beyond = int(self.counts[self.values > value].sum())
            least_runs = max(HEALTH.least_peaks, HEALTH.clip_crowding * beyond) if beyond else 0
            if value >= self.values[-1] and held.runs >= least_runs and self._is_certain(held, value, step):
                return held
        return None

    def _is_certain(self, held: _Held, value: float, step: float | None) -> bool:
        """Return whether a value occurs more often than rounding explains, compared with the next levels."""
        if step is None:
            return True
        below = value - self.values
        next_levels = self.counts[(below > 0.5 * step) & (below < 2.5 * step)].sum() / 2
        # with the 1, a single rounded peak of few samples does not count as clipped
        return bool(held.samples > HEALTH.clip_crowding * (next_levels + 1))


def find_quantisation_step(values: FloatArray) -> float | None:
    """Return the smallest distance between values, which grow, if most neighbours are 1 to 10 times as far apart."""
    distances = np.diff(values)
    # values that differ only by the rounding of the conversion to SI are one level
    distances = distances[distances > 1e-9 * (values[-1] - values[0])]
    smallest = distances.min()
    step = float(distances[distances < 1.5 * smallest].mean())
    multiples = distances / step
    regular = (multiples < 10.5) & (np.abs(multiples - np.round(multiples)) < 0.1)
    return step if regular.mean() > 0.5 else None


# ---- sentences -------------------------------------------------------------------------------------


def describe_channel(
    channel: ChannelHealth,
    *,
    n_values: int,
    clipped_at: Sequence[float],
    held_s: float,
    held_from_s: float,
    drift_part_s: float,
) -> Sentences:
    """Yield what is wrong with a channel; its longest dropout lasts `held_s`, the means of parts show its drift."""
    if channel.missing and np.isnan(channel.mean):
        yield "fault", "no_values", "holds no value at all: leave the channel out, or export the log again"
        return
    if channel.missing:
        yield (
            "warning",
            "missing_values",
            f"{channel.missing} value(s) are missing, the first at {_find_first_s(channel, 'missing'):.4f} s: choose a "
            "stretch without them (start_s, stop_s); `identify` leaves them out by itself",
        )
    if channel.mute:
        yield from _describe_mute(channel)
        return
    if channel.clipped_fraction > 0:
        ends = " or ".join(f"{value:.5g}" for value in sorted(clipped_at))
        yield (
            "warning",
            "clipped",
            f"{channel.clipped_fraction:.2%} of the samples are clipped at {_with_unit(ends, channel.unit)}, the "
            f"first at {_find_first_s(channel, 'clipped'):.3f} s: measure again with a larger range",
        )
    elif held_s:
        yield (
            "warning",
            "held_value",
            f"one value is held for {held_s:.3g} s from {held_from_s:.3f} s: leave this dropout out "
            "with start_s and stop_s",
        )
    if channel.spikes and channel.unit == "N" and _is_made_of_spikes(channel, n_values):
        yield (
            "note",
            "short_blows",
            f"{channel.spikes} blow(s) of one sample, the first at {_find_first_s(channel, 'spike'):.4f} s: a hammer, "
            "whose force needs a rate that gives a blow four samples and more, or a softer tip",
        )
    elif channel.spikes:
        yield (
            "warning",
            "spikes",
            f"{channel.spikes} spike(s) of one sample, the first at {_find_first_s(channel, 'spike'):.4f} s: check the "
            "cable, or leave them out with start_s and stop_s",
        )
    step = channel.quantisation_step
    if step is not None and channel.rms < HEALTH.coarse_steps * step:
        yield (
            "warning",
            "coarse_resolution",
            f"the rms is only {channel.rms / step:.1f} steps of the resolution "
            f"({_with_unit(f'{step:.3g}', channel.unit)}): measure with a smaller range or more bits",
        )
    yield from _describe_supply(channel)
    if channel.unit == "m/s^2":
        yield from _describe_offset(channel, drift_part_s)


def _is_made_of_spikes(channel: ChannelHealth, n_values: int) -> bool:
    """Return whether single samples hold most of the energy: the channel of a hammer, which is quiet between blows."""
    return bool(channel.spikes * channel.peak**2 > HEALTH.blow_energy * channel.rms**2 * n_values)


def _describe_mute(channel: ChannelHealth) -> Sentences:
    mean = _with_unit(f"{channel.mean:.4g}", channel.unit)
    # A thermometer may be constant and a switch has two states, but an accelerometer in operation moves.
    if channel.unit not in ("m/s^2", "?"):
        if channel.rms == 0:
            yield "note", "constant", f"all samples lie at {mean}"
    elif channel.rms == 0:
        yield "fault", "mute", f"mute, all samples lie at {mean}: check the sensor and its cable"
    else:
        yield (
            "fault",
            "few_values",
            f"mute, it has only two or three values about {mean}: check the sensor, its cable and its range",
        )


def _describe_offset(channel: ChannelHealth, drift_part_s: float) -> Sentences:
    mean = channel.mean
    if abs(abs(mean) / STANDARD_GRAVITY - 1) < HEALTH.gravity_tolerance:
        yield "note", "gravity", f"the mean, {mean:.3f} m/s^2, is gravity: nothing to do, `identify` takes it off"
    elif abs(abs(mean) - 1) < HEALTH.gravity_tolerance:
        yield "note", "gravity_in_g", f"the mean, {mean:.3f} m/s^2, would be gravity in g: check the unit"
    elif abs(mean) > HEALTH.most_gravities * STANDARD_GRAVITY:
        yield (
            "warning",
            "false_offset",
            f"the mean, {mean:.4g} m/s^2, is more than gravity makes: a false offset or a wrong unit; check the "
            "sensor's zero and range, and give `offset` in its table of [channels]",
        )
    elif abs(mean) > HEALTH.offset_rms * channel.rms:
        yield (
            "note",
            "large_offset",
            f"the offset, {mean:.3g} m/s^2, is large beside the rms, {channel.rms:.3g} m/s^2: nothing to do, "
            "`identify` takes it off",
        )
    if channel.drift > HEALTH.drift_rms * channel.rms:
        yield (
            "note",
            "drift",
            f"the offset drifts by {channel.drift:.3g} m/s^2 (means of {drift_part_s:.3g} s), as the sensor "
            "warms up, or the vehicle tilts or brakes: nothing to do, the high-pass of `identify` takes it off",
        )


def _describe_supply(channel: ChannelHealth) -> Sentences:
    named = [line for line in channel.lines if line.name]
    hum = float(np.sqrt(sum(line.rms**2 for line in named)))
    if hum < 0.2 * HEALTH.hum_rms * channel.rms:
        return
    severity: Severity = "warning" if hum > HEALTH.hum_rms * channel.rms else "note"
    lines = ", ".join(f"{line.frequency_hz:.4g} Hz: {line.name}" for line in named[:3])
    lines += " and more" if len(named) > 3 else ""
    yield (
        severity,
        "supply_lines",
        f"{_with_unit(f'{hum:.2g}', channel.unit)} rms of the electric supply ({lines}): earth the shield at one end, "
        "keep the cable away from power lines, and choose a band without these lines",
    )


def _with_unit(value: str, unit: str) -> str:
    return value if unit == "?" else f"{value} {unit}"


def _find_first_s(channel: ChannelHealth, kind: Kind) -> float:
    return next((stretch.start_s for stretch in channel.stretches if stretch.kind == kind), np.nan)
