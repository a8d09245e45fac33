"""From what a file holds to a `Recording`: chosen channels of one stretch, in SI units, on one uniform clock."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from opid.errors import FileError, InputError, list_names
from opid.signals.clock import Clock, ClockError, reconstructed_clock, uniform_clock
from opid.signals.log import AS_WRITTEN, ChannelSettings, Log, LogSettings, Track
from opid.signals.recording import Channel, FloatArray, Recording, has_usual_size
from opid.signals.resampling import on_common_clock, resampled
from opid.signals.stamps import StampEvidence, at_equal_steps, is_uniform, may_be_irregular


def recording_of(
    log: Log,
    settings: LogSettings = AS_WRITTEN,
    *,
    channels: Sequence[str] | Mapping[str, ChannelSettings] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    fs_hz: float | None = None,
) -> Recording:
    """Return a stretch of a log in SI units on one uniform clock.

    `settings`, `channels`, `start_s`, `stop_s` and `fs_hz` are those of `opid.read_log`.

    Raises:
        InputError: a channel that does not exist, an unknown unit, stamps that are no uniform clock, a missing value, a
            stretch without samples, or no choice of channels where the log has several clocks.
    """
    return read_with_stamps(log, settings, channels=channels, start_s=start_s, stop_s=stop_s, fs_hz=fs_hz)[0]


def read_with_stamps(
    log: Log,
    settings: LogSettings = AS_WRITTEN,
    *,
    channels: Sequence[str] | Mapping[str, ChannelSettings] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    fs_hz: float | None = None,
) -> tuple[Recording, tuple[StampEvidence, ...]]:
    """Return what `recording_of` returns, and how irregular stamps were judged: one for each clock that has them.

    Args:
        log: the log.
        settings: how it is read.
        channels: names of the channels, or their settings by the names that they will have; None for all signals.
        start_s: first time, s; None for the beginning of the log.
        stop_s: end, s; None for the end of the log.
        fs_hz: the rate of the recording, Hz; None for that of the log.

    Raises:
        InputError: as `recording_of`.
    """
    if channels is None and len(log.tracks) > 1:
        known = list_names(map(repr, log.names), 12)
        raise FileError(f"{log.path} has {len(log.tracks)} clocks: name the channels wanted, of {known}")
    wanted = choose_channels(log, channels)
    positions = {name: log.find(own.channel) for name, own in wanted.items()}
    parts, judged = [], list[StampEvidence]()
    for track in log.tracks:
        own = {name: column for name, (where, column) in positions.items() if where is track}
        if own:
            part, evidence = _read_track(log, track, own, wanted, settings, start_s, stop_s)
            parts.append(part)
            judged += [evidence] if evidence else []
    if len(parts) > 1:
        return on_common_clock(parts, order=tuple(wanted), fs_hz=fs_hz), tuple(judged)
    whole = parts[0] if fs_hz is None or fs_hz == parts[0].fs else resampled(parts[0], fs_hz)
    return whole, tuple(judged)


def choose_channels(
    log: Log, channels: Sequence[str] | Mapping[str, ChannelSettings] | None
) -> dict[str, ChannelSettings]:
    """Return the settings of the channels by their names in the result; None stands for all signals."""
    if isinstance(channels, Mapping):
        return dict(channels)
    return {name: ChannelSettings(name) for name in (log.signals if channels is None else channels)}


def _read_track(
    log: Log,
    track: Track,
    columns: Mapping[str, int],
    wanted: Mapping[str, ChannelSettings],
    settings: LogSettings,
    start_s: float | None,
    stop_s: float | None,
) -> tuple[Recording, StampEvidence | None]:
    samples, clock, first, evidence = _read_stretch(log, track, list(columns.values()), settings, start_s, stop_s)
    history = [
        *log.history,
        f"read {samples.shape[0]} samples from {log.path.name}",
        *log.remarks,
        _describe_rate(track, settings, clock, is_judged=evidence is not None),
        *([evidence.sentence] if evidence else []),
    ]
    if start_s is not None or stop_s is not None:
        history.append(f"section {_describe_time(start_s, 'start')} to {_describe_time(stop_s, 'end')}")
    converted, channels = [], []
    with _name_log_in_errors(log):
        for (name, column), values in zip(columns.items(), samples.T, strict=True):
            written = track.channels[column].unit
            si, unit = wanted[name].to_si(values, written or settings.unit)
            converted.append(si)
            channels.append(Channel(name, unit))
            words = wanted[name].words(written, settings.unit)
            history += [words] if words else []
    _require_finite(log, track, columns.values(), samples, first)
    with _name_log_in_errors(log):
        recording = Recording(
            np.stack(converted, axis=1), clock.fs, tuple(channels), clock.start_s, tuple(history), log.files
        )
    return recording, evidence


@contextmanager
def _name_log_in_errors(log: Log) -> Iterator[None]:
    """Put the name of the log before an error."""
    try:
        yield
    except InputError as error:
        raise FileError(f"{log.path}: {error}") from None


def _require_finite(log: Log, track: Track, columns: Iterable[int], samples: FloatArray, first: int) -> None:
    for column, values in zip(columns, samples.T, strict=True):
        missing = np.flatnonzero(~np.isfinite(values))
        if missing.size:
            more = f", nor in {missing.size - 1} more row(s)" * (missing.size > 1)
            raise FileError(
                f"{log.path} {track.locate(first + int(missing[0]))}: channel {track.channels[column].name!r} has no "
                f"number there{more}: mend the log, or take a sound part of it (start_s and stop_s in a study)"
            )


def _read_stretch(
    log: Log,
    track: Track,
    columns: Sequence[int],
    settings: LogSettings,
    start_s: float | None,
    stop_s: float | None,
) -> tuple[FloatArray, Clock, int, StampEvidence | None]:
    """Return the samples between two times, their clock, the index of the first row, and how stamps were judged."""
    low, high = -np.inf if start_s is None else start_s, np.inf if stop_s is None else stop_s
    whole = _find_clock(log, track, settings)
    if whole is not None:
        # half a sample of slack keeps times that are written with few digits from losing a sample
        first = 0 if start_s is None else max(0, int(np.ceil((low - whole.start_s) * whole.fs - 0.5)))
        stop = None if stop_s is None else max(first, int(np.ceil((high - whole.start_s) * whole.fs - 0.5)))
        samples = _join(log, [block.samples for block in track.blocks(columns, first, stop)], low, high)
        return samples, replace(whole, start_s=whole.start_s + first / whole.fs), first, None
    parts, times, row = [], [], 0
    begun: int | None = None
    for block in track.blocks(columns):
        if block.stamps is None:
            raise FileError(f"{log.path} states neither a rate nor time stamps: give fs_hz in [log]")
        slack = 0.5 * float(np.median(np.diff(block.stamps))) if block.stamps.size > 1 else 0.0
        keep = (block.stamps >= low - slack) & (block.stamps < high - slack)
        if keep.any():
            begun = row + int(np.argmax(keep)) if begun is None else begun
            parts.append(block.samples[keep])
            times.append(block.stamps[keep])
        elif begun is not None and block.stamps[0] >= high:
            break
        row += keep.size
    samples = _join(log, parts, low, high)
    first = begun or 0
    stamps = np.concatenate(times)
    try:
        samples, clock, evidence = _space_equally(samples, stamps, settings)
    except ClockError as error:
        raise FileError(f"{log.path} {track.locate(first + error.sample)}: {error}") from error
    return samples, clock, first, evidence


def _space_equally(
    samples: FloatArray, stamps: FloatArray, settings: LogSettings
) -> tuple[FloatArray, Clock, StampEvidence | None]:
    """Return samples at equal steps, their clock, and how irregular stamps were judged; None where they are regular."""
    is_usual = has_usual_size(samples)  # those that are not are refused when all is read
    if settings.clock == "own_times" and is_usual:
        return at_equal_steps(samples, stamps, taken="own times")
    is_strict = settings.clock == "stamps" or not may_be_irregular(stamps) or not is_usual
    try:
        clock = uniform_clock(stamps)
        if is_strict or is_uniform(stamps, clock):
            return samples, clock, None
    except ClockError:
        if is_strict:
            raise
    return at_equal_steps(samples, stamps)


def _find_clock(log: Log, track: Track, settings: LogSettings) -> Clock | None:
    """Return the clock of all rows if it is stated or reconstructed: part of the stamps would give another rate."""
    if settings.fs_hz:
        return Clock(settings.fs_hz, track.start_s if track.fs else 0.0, settings.fs_hz)
    if track.fs is not None:
        return Clock(track.fs, track.start_s, track.fs)
    if settings.clock != "reconstructed":
        return None
    stamps = [block.stamps for block in track.blocks([0]) if block.stamps is not None]
    if sum(part.size for part in stamps) < 2:
        raise FileError(f"{log.path} holds no time stamps to reconstruct a clock from: give fs_hz in [log]")
    try:
        return reconstructed_clock(np.concatenate(stamps))
    except ClockError as error:
        raise FileError(f"{log.path} {track.locate(error.sample)}: {error}") from error


def _join(log: Log, parts: list[FloatArray], low: float, high: float) -> FloatArray:
    n = sum(part.shape[0] for part in parts)
    if n < 2:
        held = ("no samples", "one sample")[n]
        if np.isfinite(low) or np.isfinite(high):
            raise FileError(
                f"the section {low:g} s to {high:g} s of {log.path} holds {held}: choose start and stop inside the log"
            )
        raise FileError(f"{log.path} holds {held} below its header: give a run of some tens of seconds")
    return np.concatenate(parts)


def _describe_rate(track: Track, settings: LogSettings, clock: Clock, *, is_judged: bool) -> str:
    if settings.fs_hz:
        instead = f"the file states {track.fs:.9g} Hz" if track.fs else "time stamps are not looked at"
        return f"rate {clock.fs:.9g} Hz as the user states ({instead})"
    if track.fs is not None:
        return f"rate {clock.fs:.9g} Hz as the file states"
    if settings.clock == "reconstructed":
        return (
            f"rate {clock.fs:.9g} Hz reconstructed: the stamps lie up to {clock.stray_s:.3g} s off a uniform clock, "
            "the rows are assumed to be equally spaced"
        )
    rate = f"rate {clock.fs:.9g} Hz from the time stamps"
    if is_judged:
        return f"{rate}, which give {clock.fs_as_written:.9g} Hz"
    if abs(clock.fs / clock.fs_as_written - 1) > 1e-9:
        rate += f" ({clock.fs_as_written:.9g} Hz as written, rounded within the resolution of the stamps)"
    return rate


def _describe_time(value: float | None, word: str) -> str:
    return word if value is None else f"{value:g} s"


def require_distinct(log: Log, channels: Mapping[str, ChannelSettings]) -> None:
    """Raise an error if two of `channels` are the same channel of a log.

    Raises:
        InputError: two are the same, or the log does not have one of them.
    """
    positions: dict[tuple[int, int], str] = {}
    for name, settings in channels.items():
        track, column = log.find(settings.channel)
        other = positions.setdefault((id(track), column), name)
        if other != name:
            raise FileError(
                f"{other!r} and {name!r} are both channel {settings.channel!r} of {log.path}: name two channels"
            )
