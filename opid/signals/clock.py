"""From time stamps to a uniform rate: steps that rounding explains are accepted, others are refused.

Columns of a log that run with its time (counters, a second time) are found here as well.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.log import Log, Track
from opid.signals.recording import LARGEST_RATE_HZ, LEAST_RATE_HZ, FloatArray
from opid.signals.units import si_unit, time_name

JITTER_LIMIT = 0.02
"""Largest accepted error of one step between stamps beyond the rounding, over the period.

Two stamps 1 % early and late make a step 2 % wrong. A sample at a tenth of the rate is then off by less than
2 pi 0.1 0.01 = 0.6 % of its amplitude, below the gain error of an ordinary accelerometer."""

COARSE_STAMPS = 0.6
"""Resolution of the stamps over the period, above which rounding can no longer be distinguished from a lost sample.

Rounded to q, the steps of a uniform clock of period p lie between p - q and p + q; a lost sample makes one of
at least 2 p - q. Three decimals at 512 Hz (q = 0.51 p) still distinguish them, at 1024 Hz they do not."""

GAP = 1.5
"""A step longer than this many periods is a gap: halfway between a usual step and one lost sample."""

LONGEST_OF_STEPS = 3.0
"""A step this many times longer than the one that 1 % of the steps exceed: the host stalled, or samples were lost."""

LEAST_BINS = 8
"""With at least this many bins of rows, a few may be left out of the line through the stamps."""

_ROWS_TO_TELL = 1000
_LEAST_ROWS = 10
_OFF_THE_LINE = 0.6
"""How far a clock may lie off a straight line, over its step: half a step is rounding."""

_RESOLUTIONS = sorted([10.0**-k for k in range(10)] + [2.0**-k for k in range(1, 25)], reverse=True)


class ClockError(InputError):
    """The time stamps are not those of a uniform clock; `sample` is the first that is wrong."""

    def __init__(self, message: str, sample: int) -> None:
        super().__init__(message)
        self.sample = sample


@dataclass(frozen=True)
class Clock:
    """A uniform sampling clock recovered from time stamps."""

    fs: float  # sampling rate, Hz, rounded to few decimals where the stamps allow it
    start_s: float  # the first stamp, s
    fs_as_written: float  # the rate before that rounding, Hz
    stray_s: float = 0.0  # largest distance of the stamps from this clock, s; 0 where it was not computed


def uniform_clock(stamps: ArrayLike) -> Clock:
    """Return the uniform clock behind time stamps with any number of digits.

    The period p is the slope of the least-squares line through the stamps. Each step between stamps may
    differ from p by the resolution of the stamps or by 2 % of p, and no stamp may stray from the line by half
    a period.

    Raises:
        ClockError: a repeated or decreasing stamp, a gap, jitter, or a rate that wanders.

    >>> uniform_clock(np.round(np.arange(20480) / 512, 3)).fs
    512.0
    """
    time_s = np.asarray(stamps, dtype=np.float64)
    steps = np.diff(time_s)
    require_clock(time_s, may_repeat=False)
    resolution_s = resolution_of(time_s)
    float_noise = 4 * float(np.spacing(np.abs(time_s).max()))

    count = np.arange(time_s.size) - 0.5 * (time_s.size - 1)
    elapsed = time_s - time_s[0]
    period = float(count @ elapsed / (count @ count))
    worst_step = float(np.abs(steps - period).max())
    # the rounding of the first and the last of few stamps leaves the period uncertain
    longest_s = period + resolution_s / (time_s.size - 1)
    rounding = resolution_s if resolution_s < COARSE_STAMPS * longest_s else 0.0
    if worst_step > max(rounding * (1 + 1e-6), JITTER_LIMIT * period) + float_noise:
        raise _describe_irregular(time_s, steps, resolution_s)
    stray = elapsed - elapsed.mean() - period * count
    if np.ptp(stray) >= period:
        sample = int(np.abs(stray).argmax())
        raise ClockError(
            f"the sampling rate wanders: at {time_s[sample]:.6g} s the samples are "
            f"{abs(stray[sample]) / period:.1f} periods away from a clock of {1 / period:.6g} Hz: "
            "resample the signals to a uniform rate",
            sample,
        )

    uncertainty = float_noise if worst_step <= 1e-6 * period + float_noise else resolution_s
    relative = 1e-10 + uncertainty / float(elapsed[-1])
    return Clock(plain_number(1 / period, relative / period), float(time_s[0]), 1 / period)


def reconstructed_clock(stamps: ArrayLike) -> Clock:
    """Return the uniform clock through stamps that come in bursts, as from a host that empties a buffer.

    The rows are assumed to be equally spaced. The rate is the slope of the least-squares line through the stamps
    without those that came late because the host stalled. A lost sample goes unnoticed; `stray_s` shows how far the
    stamps lie off the line.

    Raises:
        ClockError: a decreasing stamp, or stamps that are all equal.

    >>> true = np.arange(2000) / 117.0
    >>> clock = reconstructed_clock(np.floor(true / 0.03) * 0.03)  # about four rows have the same stamp
    >>> bool(abs(clock.fs - 117.0) < 0.1), bool(clock.stray_s < 0.031)
    (True, True)
    """
    time_s = np.asarray(stamps, dtype=np.float64)
    steps = np.diff(time_s)
    require_clock(time_s, may_repeat=True)
    usual = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    longest_s = longest_usual_step(steps, usual)
    rows_a_bin = max(1, time_s.size // 1000)
    bins = sum_bins(0, time_s - time_s[0], usual, rows_a_bin)
    period, first_s, _ = line_without_stalls(bins, usual, longest_s)
    start_s = float(time_s[0]) + first_s
    stray = time_s - (start_s + period * np.arange(time_s.size))
    return Clock(1 / period, start_s, 1 / period, float(np.abs(stray).max()))


def longest_usual_step(steps: FloatArray, period_s: float) -> float:
    """Return the longest step between a host's stamps that shows neither a stall nor lost samples, s."""
    return max(GAP * period_s, LONGEST_OF_STEPS * float(np.quantile(steps[steps > 0], 0.99)))


def sum_bins(first: int, elapsed_s: FloatArray, period_s: float, rows_a_bin: int) -> FloatArray:
    """Return the sums over bins of rows from which a line through their stamps follows, (n_bins, 7).

    The columns are the number of rows, the sums of row, stamp, row^2 and row stamp, and the least and the greatest
    value of stamp - row `period_s`.
    """
    rows = np.arange(first, first + elapsed_s.size, dtype=np.float64)
    off = elapsed_s - rows * period_s
    starts = np.arange(0, rows.size, rows_a_bin)
    sums = [np.add.reduceat(each, starts) for each in (np.ones_like(rows), rows, elapsed_s, rows**2, rows * elapsed_s)]
    return np.stack([*sums, np.minimum.reduceat(off, starts), np.maximum.reduceat(off, starts)], axis=1)


def line_without_stalls(bins: FloatArray, period_s: float, longest_s: float) -> tuple[float, float, np.ndarray]:
    """Return the period and the stamp of row 0 by least squares, and which bins of rows lie on that line.

    A host that stalls stamps some rows late and then catches up. The bins of such rows are left out: they lie far from
    a line whose slope is the median of the slopes over half of the rows.
    """
    n, row, stamp = bins[:, 0], bins[:, 1], bins[:, 2]
    x, t = row / n, stamp / n
    keep = np.ones(len(bins), dtype=bool)
    half = len(bins) // 2
    if half >= LEAST_BINS // 2:
        slope = float(np.median((t[half:] - t[:-half]) / (x[half:] - x[:-half])))
        start = float(np.median(t - slope * x))
        for _ in range(2):
            tilt = (period_s - slope) * x - start
            off = np.maximum(np.abs(bins[:, 5] + tilt), np.abs(bins[:, 6] + tilt))
            keep = off <= max(longest_s, 4 * float(np.median(off)))
            slope, start = _fit_line(bins[keep])
    slope, start = _fit_line(bins[keep])
    return slope, start, keep


def _fit_line(bins: FloatArray) -> tuple[float, float]:
    n, row, stamp, squares, products = bins[:, :5].sum(axis=0)
    spread = squares - row * row / n
    slope = float((products - row * stamp / n) / spread) if spread > 0 else 0.0
    return slope, float(stamp / n - slope * row / n)


def resolution_of(stamps: FloatArray) -> float:
    """Return the coarsest decimal or binary step of which the last stamps are multiples.

    The last stamps are used because in scientific notation and in single precision large stamps are the coarsest.
    """
    # at least ten stamps are used: two may lie a round number apart by chance
    block = stamps[-min(max(10, stamps.size // 2), 1000) :]
    offsets = block - block[0]
    noise = float(np.spacing(np.abs(block).max()))
    for step in _RESOLUTIONS:
        if noise >= 1e-4 * step:
            continue
        multiples = offsets / step
        if np.abs(multiples - np.round(multiples)).max() < 1e-6 + 4 * noise / step:
            return step
    return 2 * noise


def plain_number(value: float, uncertainty: float) -> float:
    """Return the number of fewest decimals within the uncertainty of `value`, or `value`.

    >>> plain_number(1 / 1.52588e-05, 0.22)
    65536.0
    """
    for decimals in range(7):
        if abs(round(value, decimals) - value) <= uncertainty:
            return round(value, decimals)
    return value


def require_clock(time_s: FloatArray, *, may_repeat: bool) -> None:
    """Refuse time stamps that no clock of a recorder makes.

    Raises:
        ClockError: a stamp that goes back, stamps that are all equal, a mean rate beyond that of any recorder, or a
            stamp that stands twice where none `may_repeat`.
    """
    steps = np.diff(time_s)
    wrong = steps < 0 if may_repeat else steps <= 0
    if wrong.any():
        sample = int(np.argmax(wrong)) + 1
        if steps[sample - 1] == 0:
            raise ClockError(
                f"the time {time_s[sample]:.9g} s stands twice in a row ({int((steps == 0).sum())} such pair(s) in the "
                "log): remove the repeated samples, or write the time with more digits",
                sample,
            )
        raise ClockError(
            f"the time goes back from {time_s[sample - 1]:.9g} s to {time_s[sample]:.9g} s: "
            "put the samples in order, or split the log here if two were joined",
            sample,
        )
    if not (steps > 0).any():
        raise ClockError(f"all stamps are {time_s[0]:.9g} s: state the rate (fs_hz in [log])", 0)
    require_step(float(time_s[-1] - time_s[0]) / steps.size)


def require_step(usual_s: float) -> None:
    """Refuse a step of time that no recorder makes.

    Raises:
        ClockError: it is shorter or longer than that of any.
    """
    if not 1 / LARGEST_RATE_HZ <= usual_s <= 1 / LEAST_RATE_HZ:
        raise ClockError(
            f"the time goes on by {usual_s:.3g} s a sample, and that of a recorder by {1 / LARGEST_RATE_HZ:g} to "
            f"{1 / LEAST_RATE_HZ:g} s: check its unit (time_unit in [log])",
            0,
        )


def _describe_irregular(time_s: FloatArray, steps: FloatArray, resolution_s: float) -> ClockError:
    """Return the error that names the first gap, or the largest jitter where there is no gap."""
    # the median over some steps withstands both gaps and coarse rounding
    stride = min(8, steps.size)
    period = float(np.median(time_s[stride:] - time_s[:-stride])) / stride
    gaps = np.flatnonzero(steps > GAP * period)
    if gaps.size:
        first = int(gaps[0])
        period = float(np.delete(steps, gaps).mean()) if gaps.size < steps.size else period
        lost = max(1, int(np.round(steps[gaps] / period - 1).sum()))
        coarse = "" if resolution_s < COARSE_STAMPS * period else ", or write the time with more digits"
        return ClockError(
            f"the time jumps from {time_s[first]:.9g} s to {time_s[first + 1]:.9g} s where steps of "
            f"{period:.6g} s are usual ({gaps.size} gap(s), about {lost} sample(s) lost in the log): "
            f"split the log at the gaps or resample it to a uniform rate{coarse}",
            first + 1,
        )
    sample = int(np.abs(steps - period).argmax()) + 1
    off = abs(steps[sample - 1] / period - 1)
    return ClockError(
        f"the time stamps are not uniform: the step to {time_s[sample]:.9g} s lasts "
        f"{steps[sample - 1]:.6g} s, {off:.0%} off the usual {period:.6g} s "
        f"({JITTER_LIMIT:.0%} or the rounding of the stamps is accepted): "
        "resample the log to a uniform rate, or write the time with more digits",
        sample,
    )


# ---- columns that run with the time ----------------------------------------------------------------


def mark_clocks(log: Log) -> Log:
    """Return the log with those channels marked that run with its time.

    Such a channel states no unit or a unit of time, and increases in each of the first rows: along a straight line over
    the time (over the rows where there are no stamps), or along any curve if its name is a name of the time.
    """
    tracks = tuple(_mark_track(track) for track in log.tracks)
    names = [channel.name for track in tracks for channel in track.channels if channel.is_clock]
    remarks = tuple(f"{name!r} runs with the time and is not read as a signal: name it if it is one" for name in names)
    return replace(log, tracks=tracks, remarks=(*log.remarks, *remarks)) if names else log


def _mark_track(track: Track) -> Track:
    columns = [i for i, each in enumerate(track.channels) if each.unit is None or si_unit(each.unit) == "s"]
    if not columns:
        return track
    values = np.empty((0, len(columns)))
    stamps: FloatArray | None = None
    with suppress(InputError):  # an error there is raised where the track is read
        blocks = list(track.blocks(columns, 0, _ROWS_TO_TELL))
        values = np.concatenate([values, *(block.samples for block in blocks)])
        known = [block.stamps for block in blocks if block.stamps is not None]
        stamps = np.concatenate(known) if known else None
    time_s = np.arange(len(values), dtype=np.float64) if stamps is None else stamps
    clocks = {
        column
        for column, own in zip(columns, values.T, strict=True)
        if _is_clock(own, time_s, is_called_time=time_name([track.channels[column].name]) is not None)
    }
    if not clocks or len(clocks) == len(track.channels):
        return track
    channels = (replace(each, is_clock=column in clocks) for column, each in enumerate(track.channels))
    return replace(track, channels=tuple(channels))


def _is_clock(values: FloatArray, time_s: FloatArray, *, is_called_time: bool) -> bool:
    if len(values) < _LEAST_ROWS or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    is_rising = bool((steps > 0).all())
    if is_called_time or not is_rising:
        return is_rising
    if not (np.isfinite(time_s).all() and np.ptp(time_s) > 0):
        return False
    beside = time_s - time_s.mean()
    own = values - values.mean()
    off = own - beside * float(beside @ own / (beside @ beside))
    return float(np.abs(off).max()) <= _OFF_THE_LINE * float(np.median(steps))
