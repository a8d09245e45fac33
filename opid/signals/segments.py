"""Which stretch of a log is sound and in motion, so that an identification can use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from opid.errors import InputError, nearest
from opid.signals.health.result import Health, RmsHistory
from opid.signals.recording import FloatArray


@dataclass(frozen=True)
class SegmentSettings:
    """Which stretches are worth an identification.

    Args:
        most_s: length of a stretch beyond which an identification gains little: some hundred periods of the slowest
            resonance, s.
        least_s: length of a stretch below which it has too few periods of the suspension's resonance, s.
        still: a vehicle whose rms is below this fraction of its usual motion stands still: 34 dB.
        idle: the same where the rms is steady, as with an engine that idles. A vehicle that rolls out slowly may be as
            quiet, but its rms halves or doubles from bump to bump.
        idle_scatter: largest robust standard deviation of the logarithm of a steady rms.
        still_s: the vehicle stands still for at least this time, s: a moment between two bumps is no standstill.
        usual_s: the usual motion is the strongest motion that lasts for this time, s.
        usual: in a short log the usual motion lasts for this fraction of it, for the vehicle may stand still in the
            remainder.
        nearly: among stretches longer than this fraction of the longest one, the most energetic is chosen.
    """

    most_s: float = 300.0
    least_s: float = 10.0
    still: float = 0.02
    idle: float = 0.1
    idle_scatter: float = 0.25
    still_s: float = 5.0
    usual_s: float = 30.0
    usual: float = 1 / 3
    nearly: float = 0.8


SEGMENTS = SegmentSettings()

Channels = Sequence[str | tuple[str, ...]]
"""Names of channels; the axes of one sensor are a tuple, because one of them may hardly move."""

Why = Literal["faulty", "standstill", "short", "not chosen"]


@dataclass(frozen=True)
class LeftOut:
    """A stretch that is not used, and why."""

    why: Why
    start_s: float
    stop_s: float


@dataclass(frozen=True)
class Segment:
    """A stretch of a log.

    Args:
        start_s: time of its beginning, s; None for the beginning of the log.
        stop_s: time of its end, s; None for the end of the log.
        reason: reason for the choice, in a sentence; empty for a whole log that is sound and in motion.
        left_out: the remainder of the log.
    """

    start_s: float | None
    stop_s: float | None
    reason: str = ""
    left_out: tuple[LeftOut, ...] = ()


@dataclass(frozen=True, eq=False)
class _Course:
    """The motion and the faults of a log's channels second by second, on all their clocks: all arrays are (n,)."""

    start_s: FloatArray
    stop_s: FloatArray
    relative_rms: FloatArray  # the largest ratio of a sensor's rms to its usual motion; NaN where none is known
    sound: np.ndarray
    complete: np.ndarray


def sound_segments(
    health: Health, channels: Sequence[str], *, least_s: float = SEGMENTS.least_s
) -> tuple[Segment, ...]:
    """Return the stretches in which nothing is wrong with any of the channels, in order of time.

    Single spikes do not end a stretch. A stretch that begins (ends) with the log has no start (stop).

    Args:
        health: the result of `opid.inspect`.
        channels: names of the channels that must be sound.
        least_s: length of the shortest accepted stretch, s.

    Raises:
        InputError: a channel that was not inspected.
    """
    course = _make_course(health, channels)
    runs = [run for run in _find_runs(course.sound) if _measure_length(course, run) >= least_s]
    return tuple(_make_segment(course, run, "nothing is wrong with it") for run in runs)


def taxi_segment(health: Health, channels: Channels) -> Segment:
    """Return the stretch of sustained motion to identify from; the whole log if it is in motion from end to end.

    Faulty stretches and standstill are left out. Of the remaining stretches the longest is chosen (of nearly equal ones
    the most energetic), and of a stretch longer than five minutes the part with the steadiest motion.

    Args:
        health: the result of `opid.inspect`.
        channels: names of the channels to identify from; the axes of one sensor are a tuple of names.

    Raises:
        InputError: a channel that was not inspected.
    """
    course = _make_course(health, channels)
    moving = ~_find_standstill(course)
    usable, cut = course.sound, "at fault"
    runs = _find_long_runs(course, usable & moving)
    if not runs:
        # Every stretch is clipped or held. The log is used all the same, and the findings name the faults.
        usable, cut = course.complete, "incomplete"
        runs = _find_long_runs(course, usable & moving)
    if not runs:
        reason = f"no stretch of {SEGMENTS.least_s:g} s is sound and in motion, so the whole log is taken"
        return Segment(None, None, reason)
    parts = [_find_steadiest(course, run) for run in runs]
    longest = max(_measure_length(course, part) for part in parts)
    near = [part for part in parts if _measure_length(course, part) >= SEGMENTS.nearly * longest]
    energy = np.nan_to_num(course.relative_rms) ** 2 * (course.stop_s - course.start_s)
    chosen = max(near, key=lambda part: energy[slice(*part)].sum())
    left_out = _list_left_out(course, chosen, usable, moving)
    return _make_segment(course, chosen, _give_reason(course, chosen, left_out, cut, len(runs)), left_out)


def find_standstill(health: Health, channels: Channels) -> np.ndarray:
    """Return whether a vehicle stands still in each stretch of the rms history of the channels' clock, (n,).

    Args:
        health: the result of `opid.inspect`.
        channels: names of channels, of one clock; the axes of one sensor are a tuple of names.

    Raises:
        InputError: a channel that was not inspected.
    """
    return _find_standstill(_make_course(health, channels))


def _make_course(health: Health, channels: Channels) -> _Course:
    """Return the rms histories of all clocks on the stretches of the coarsest one."""
    names = [name for clock in health.clocks for name in clock.channels]
    sensors = [(each,) if isinstance(each, str) else each for each in channels]
    for name in (name for sensor in sensors for name in sensor):
        if name not in names:
            raise InputError(f"the channel {name!r} was not inspected: {nearest(name, names)}")
    own = []
    for clock, history in zip(health.clocks, health.rms_history, strict=True):
        columns = [[clock.channels.index(name) for name in each] for each in sensors if {*each} <= {*clock.channels}]
        if columns:
            own.append((history, clock.start_s + clock.duration_s, columns))
    main, end_s, columns = max(own, key=lambda each: each[0].length_s)
    # a stretch lasts until the next one begins, and a gap between them makes it unsound
    stop_s = np.append(main.start_s[1:], max(end_s, main.start_s[-1]))
    relative_rms = _divide_by_usual(main, columns)
    sound, complete = _combine_all(main.sound, columns), _combine_all(main.complete, columns)
    for history, _, others in own:
        if history is main:
            continue
        at = np.searchsorted(history.start_s, 0.5 * (main.start_s + stop_s), "right") - 1
        own_rms = _divide_by_usual(history, others)
        relative_rms = np.fmax(relative_rms, own_rms[np.clip(at, 0, own_rms.size - 1)])
        sound &= _is_good_within(history, _combine_all(history.sound, others), main.start_s, stop_s)
        complete &= _is_good_within(history, _combine_all(history.complete, others), main.start_s, stop_s)
    return _Course(main.start_s, stop_s, relative_rms, sound, complete)


def _combine_all(flags: np.ndarray, columns: Sequence[list[int]]) -> np.ndarray:
    return np.asarray(flags[:, [column for sensor in columns for column in sensor]].all(axis=1))


def _divide_by_usual(history: RmsHistory, columns: Sequence[list[int]]) -> FloatArray:
    """Return the largest ratio of a sensor's rms to its usual motion, (n,)."""
    rms = np.stack([np.sqrt((history.rms[:, sensor] ** 2).sum(axis=1)) for sensor in columns], axis=1)
    n = max(1, min(round(SEGMENTS.usual * rms.shape[0]), round(SEGMENTS.usual_s / history.length_s)))
    filled = np.nan_to_num(rms)
    usual = np.array([np.median(np.lib.stride_tricks.sliding_window_view(own, n), axis=1).max() for own in filled.T])
    return np.fmax.reduce(rms / np.where(usual > 0, usual, np.inf), axis=1)


def _is_good_within(history: RmsHistory, good: np.ndarray, start_s: FloatArray, stop_s: FloatArray) -> np.ndarray:
    """Return whether another clock has stretches in each of these, and all of them are good."""
    bad = np.concatenate([[0], np.cumsum(~good)])
    first = np.searchsorted(history.start_s, start_s + 1e-9, "right") - 1
    last = np.searchsorted(history.start_s, stop_s - 1e-9, "left")
    # nothing is missing where a clock begins up to a stretch later, or ends as much earlier
    near = stop_s > history.start_s[0]
    near &= start_s < history.start_s[-1] + history.length_s
    return (bad[np.maximum(last, 0)] - bad[np.clip(first, 0, good.size)] == 0) & near


def _find_standstill(course: _Course) -> np.ndarray:
    relative_rms = np.nan_to_num(course.relative_rms)
    logarithm = np.log(np.maximum(relative_rms, 1e-9))
    still = np.zeros(relative_rms.size, dtype=bool)
    for threshold in (SEGMENTS.still, SEGMENTS.idle):
        for run in _find_runs(relative_rms < threshold):
            own = logarithm[slice(*run)]
            scatter = 1.4826 * np.median(np.abs(own - np.median(own)))  # robust standard deviation
            is_steady = threshold == SEGMENTS.still or scatter < SEGMENTS.idle_scatter
            still[slice(*run)] |= is_steady and _measure_length(course, run) >= SEGMENTS.still_s
    return still


def _find_runs(good: np.ndarray) -> list[tuple[int, int]]:
    """Return the index of the first stretch of each run of good ones, and of the stretch after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[0::2], edges[1::2], strict=True)]


def _measure_length(course: _Course, run: tuple[int, int]) -> float:
    return float(course.stop_s[run[1] - 1] - course.start_s[run[0]])


def _find_long_runs(course: _Course, good: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs that are long enough; a log that is good from end to end always is."""
    runs = _find_runs(good)
    return runs if good.all() else [run for run in runs if _measure_length(course, run) >= SEGMENTS.least_s]


def _find_steadiest(course: _Course, run: tuple[int, int]) -> tuple[int, int]:
    """Return the part of a run, no longer than `most_s`, in which the logarithm of the rms scatters least."""
    if _measure_length(course, run) <= SEGMENTS.most_s + 1e-6:
        return run
    typical = float(np.median(course.stop_s[slice(*run)] - course.start_s[slice(*run)]))
    n = max(1, int(SEGMENTS.most_s / typical + 1e-9)) if typical > 0 else run[1] - run[0]
    n = min(n, run[1] - run[0])
    logarithm = np.log(np.maximum(np.nan_to_num(course.relative_rms[slice(*run)]), 1e-9))
    sums, squares = (np.concatenate([[0.0], np.cumsum(each)]) for each in (logarithm, logarithm**2))
    mean = (sums[n:] - sums[:-n]) / n
    scatter = (squares[n:] - squares[:-n]) / n - mean**2
    # among parts of equal steadiness the one with the strongest motion is the most informative
    first = run[0] + int(np.argmin(np.sqrt(np.maximum(scatter, 0.0)) - 0.1 * (mean - mean.max())))
    return first, first + n


def _list_left_out(
    course: _Course, chosen: tuple[int, int], usable: np.ndarray, moving: np.ndarray
) -> tuple[LeftOut, ...]:
    """Return the remainder of the log by the reason; neighbours with the same reason are joined."""
    inside = np.zeros(usable.size, dtype=bool)
    inside[slice(*chosen)] = True
    short = np.zeros(usable.size, dtype=bool)
    for run in _find_runs(usable & moving):
        short[slice(*run)] = _measure_length(course, run) < SEGMENTS.least_s
    every: tuple[tuple[Why, np.ndarray], ...] = (
        ("faulty", ~usable),
        ("standstill", usable & ~moving),
        ("short", short & ~inside),
        ("not chosen", usable & moving & ~short & ~inside),
    )
    parts = [
        LeftOut(why, float(course.start_s[first]), float(course.stop_s[stop - 1]))
        for why, where in every
        for first, stop in _find_runs(where)
    ]
    return tuple(sorted(parts, key=lambda part: part.start_s))


def _give_reason(course: _Course, chosen: tuple[int, int], left_out: Sequence[LeftOut], cut: str, n_runs: int) -> str:
    if not left_out:
        return ""
    of_why = {why: sum(part.stop_s - part.start_s for part in left_out if part.why == why) for why in _WORDS}
    lost = ", ".join(
        f"{_format_seconds(seconds)} {_WORDS[why].format(cut=cut)}" for why, seconds in of_why.items() if seconds
    )
    if _measure_length(course, chosen) > SEGMENTS.most_s - 2 and of_why["not chosen"]:
        which = f"the {_format_seconds(_measure_length(course, chosen))} with the steadiest motion"
    else:
        which = "the longest stretch in motion" if n_runs > 1 else "the stretch in motion"
    begin, end = course.start_s[chosen[0]], course.stop_s[chosen[1] - 1]
    return f"{begin:.6g} s to {end:.6g} s is {which}; left out: {lost}"


def _format_seconds(length_s: float) -> str:
    return f"{length_s:.0f} s" if length_s >= 100 else f"{length_s:.3g} s"


_WORDS: dict[Why, str] = {
    "faulty": "{cut}",
    "standstill": "of standstill",
    "short": f"in pieces shorter than {SEGMENTS.least_s:g} s",
    "not chosen": "of other motion",
}


def _make_segment(course: _Course, run: tuple[int, int], reason: str, left_out: tuple[LeftOut, ...] = ()) -> Segment:
    first, stop = run
    return Segment(
        start_s=None if first == 0 else float(course.start_s[first]),
        stop_s=None if stop == course.start_s.size else float(course.stop_s[stop - 1]),
        reason=reason,
        left_out=left_out,
    )
